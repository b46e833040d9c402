"""The reference of the robot file: every table and key with unit and meaning, made from the record types."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
import textwrap
import types
import typing
from collections.abc import Iterable, Sequence
from typing import Any

from armwright_api import entries_of, escaped
from armwright_tables import table
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from armwright.description import built_from, defaults, drive, drive_effects, fits, robot, springs
from armwright.identification.geometry import measurement_file as geometry
from armwright.identification.logs import log_file as log
from armwright.lazy_schema import Later
from armwright.modules import assembly, library, task
from armwright.motions import records as motions
from armwright.parts import materials, records as parts
from armwright.quantity import Quantity, Source
from armwright.scenarios import records as scenario, tuning_records as tuning
from armwright.scenarios.kinds import keys_of, kinds_of
from armwright.solids import shapes as solids, visual
from armwright.trajectory.limits import QUANTITIES

TABLES: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...] = (
    ("The file itself", "", (robot.RobotDescription,)),
    ("[sources.KEY]", "", (Source,)),
    (
        "[[joints]]",
        'Every joint has exactly one of `dh`, `modified_dh` and `frame`. `servo = "NAME"` takes motor, friction, limits and '
        "firmware from the [library of servos](../servos.md); numbers beside it stand before the library's.",
        (*robot.JOINTS.values(), robot.FixedJoint),
    ),
    (
        "dh, modified_dh",
        "The keys that vary with the joint's type.",
        (robot.RevoluteDH, robot.PrismaticDH, robot.FixedDH),
    ),
    ("frame", "", (robot.JointFrame,)),
    ("mimic", "", (robot.RotaryMimic, robot.LinearMimic)),
    ("[joints.motor]", "", (drive.Motor,)),
    ("motor: coupling", "A list of them.", (drive_effects.Coupling,)),
    ("motor: gear_efficiency_table", "", (drive_effects.GearEfficiencyTable,)),
    ("motor: gear_efficiency_table.rows", "A list of them.", (drive_effects.EfficiencyRow,)),
    ("motor: thermal", "", (drive_effects.ThermalRecord,)),
    ("motor: cogging", "", (drive_effects.CoggingRecord,)),
    ("[joints.friction]", "", (drive.RotaryFriction, drive.LinearFriction)),
    (
        "[defaults]",
        "`[defaults.motor]` and `[defaults.friction]` hold keys of `[joints.motor]` and `[joints.friction]` for all joints that "
        "do not state them. A joint's own keys stand before them; a friction with its own `law`, and a joint with `servo` or "
        '`mimic`, take none. A default friction in N m does not go into a joint that slides, unless `side = "motor"`.',
        (defaults.Defaults,),
    ),
    ("[joints.limits]", "", (drive.RotaryLimits, drive.LinearLimits)),
    ("elasticity", "", (drive_effects.RotaryElasticity, drive_effects.LinearElasticity)),
    ("stops", "", (drive_effects.RotaryStops, drive_effects.LinearStops)),
    ("brake", "", (drive_effects.RotaryBrake, drive_effects.LinearBrake)),
    ("[joints.spring]", "", (springs.RotarySpringRecord, springs.LinearSpringRecord)),
    ("[supply]", "", (drive_effects.SupplyRecord,)),
    ("[[links]]", "", (robot.Link,)),
    ("inertia_kg_m2", "", (robot.Inertia,)),
    ("[[links.visuals]]", "Solids are those of the [parts file](parts-file.md).", (visual.Visual,)),
    ("[[frames]]", "", (robot.NamedFrame,)),
    ("[[cylinders]]", "", (springs.CylinderRecord,)),
    ("[built_from]", "", (built_from.BuiltFrom,)),
    ("[fits.KEY]", "", (fits.FitRecord,)),
    ("A number with its source", "", (Quantity,)),
)
PARTS_TABLES: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...] = (
    ("The file itself", "", (parts.PartsDatabase,)),
    ("[materials.KEY]", "", (materials.Material,)),
    ("[[links]]", "", (parts.PartsLink,)),
    ("[[links.parts]]", "", (parts.Part,)),
    ("[[links.parts.pendulums]]", "", (parts.Pendulum,)),
    ("[[links.parts.sections]]", "", (parts.Section,)),
    ("Patterns of copies", "", (parts.LinearPattern, parts.PolarPattern)),
    ("Solids", "", tuple(solids.SHAPES.values())),
)
SCENARIO_TABLES: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...] = (
    ("The file itself", "", (scenario.ScenarioTable,)),
    ("[start]", "", (scenario.StartTable,)),
    ("[commands]", "", (scenario.CommandsTable,)),
    ("[loop]", "", (scenario.LoopTable,)),
    ("[loop.sensors]", "", (scenario.SensorsTable,)),
    ("[loop.command_filter]", "", (scenario.CommandFilterTable,)),
    ("[loop.timing]", "", (scenario.TimingTable,)),
    ("[inputs]", "", (scenario.InputsTable,)),
    ("[[inputs.payload]]", "", (scenario.PayloadTable,)),
    ("[[inputs.payload]]: inertia_kg_m2", "", (scenario.Tensor,)),
    ("[solver]", "", (scenario.SolverTable,)),
    ("[recording]", "", (scenario.RecordingTable,)),
    ("[lanes]", "", (scenario.LanesTable,)),
    ("Numbers that differ by lane", "", (scenario.LaneValues,)),
    ("[tuning]", "", (tuning.TuningTable,)),
    ("[tuning.draws]", "", (tuning.DrawsTable,)),
)
KINDS = (  # of tables of a scenario file, beside those above
    (
        "controller",
        "Kinds of [loop.controller]",
        "`[loop.controller]` has `kind` and the keys of that kind. Gains are one number, or one for each joint.",
    ),
    ("filter", "Kinds of filters", "A table of `filters` has `kind` and the keys of that kind."),
    (
        "reference",
        "Kinds of [loop.reference]",
        "`[loop.reference]` has `kind` and the keys of that kind. `pose` and `expression` take `q`, `schedule` and `motion` take "
        "`file`. Poses (n,) are one number, or one for each joint.",
    ),
)
ALSO = {"reference": "The table of the reference that it shapes.", "inner": "The table of another controller."}
MOTION_TABLES = (
    ("The file", "", (motions.MotionTable,)),
    ("[limits]", "", (motions.LimitsTable,)),
    (
        "[[segments]]",
        "",
        (
            motions.MoveSegment,
            motions.WaypointsSegment,
            motions.TimeOptimalSegment,
            motions.ToolSegment,
            motions.LinePiece,
            motions.ArcPiece,
            motions.CirclePiece,
            motions.DwellSegment,
            motions.GripSegment,
            motions.ReleaseSegment,
        ),
    ),
    ("[[obstacles]]", "", (motions.PlaneTable, motions.BoxTable, motions.SphereTable)),
)
LOG_TABLES: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...] = (
    ("The file itself", "", (log.LogTable,)),
    ("[files.KEY]", "", (log.FileTable,)),
    ("[files.KEY.time]", "", (log.OwnTime,)),
    ("[[runs]]", "", (log.RunTable,)),
    ("[time]", "", (log.TimeTable,)),
    ("[gears]", "", (log.GearsTable,)),
    ("[[signals]]", "", (log.SignalTable,)),
)
CALIBRATION_TABLES: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...] = (
    ("The file itself", "", (geometry.MeasurementFile,)),
    ("[file]", "", (log.FileTable,)),
    ("[[joints]]", "", (geometry.JointTable,)),
    ("[[measured]]", "", (geometry.QuantityTable,)),
    ("[measuring_frame]", "", (geometry.FrameTable,)),
)
MODULE_TABLES: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...] = (
    ("A module library, `*.modules.toml`", "", (library.ModuleLibrary,)),
    ("[[modules]] of a library", "", (library.Module,)),
    ("[[modules.bodies]]", "", (library.ModuleBody,)),
    (
        "[[modules.joints]]",
        "As `[[joints]]` of a robot file, with `frame` only, and with the child's own frame.",
        (library.JOINTS["revolute"],),
    ),
    ("[[modules.connectors]]", "", (library.Connector,)),
    ("An assembly, `*.assembly.toml`", "", (assembly.Assembly,)),
    ("[[modules]] of an assembly", "", (assembly.Placed,)),
    ("A task, `*.task.toml`", "", (task.Task,)),
    ("[[poses]]", "", (task.Pose,)),
)
UNITS = {  # endings of keys, the longest first
    "_n_m_s_per_rad": "N m s/rad",
    "_per_n_m": "1/(N m)",
    "_per_n": "1/N",
    "_n_m_per_rad3": "N m/rad³",
    "_n_m_per_rad": "N m/rad",
    "_n_per_m3": "N/m³",
    "_n_per_m": "N/m",
    "_j_per_k": "J/K",
    "_k_per_w": "K/W",
    "_per_k": "1/K",
    "counts_per_m": "1/m",
    "_v_s_per_rad": "V s/rad",
    "_n_m_per_a": "N m/A",
    "_rad_per_s": "rad/s",
    "_s_per_rad": "s/rad",
    "_n_s_per_m": "N s/m",
    "_s_per_m": "s/m",
    "_rad_per_s2": "rad/s²",
    "_m_per_s2": "m/s²",
    "_m_per_s": "m/s",
    "_kg_m2": "kg m²",
    "_m_s2": "m/s²",
    "_n_m": "N m",
    "_ohm": "Ω",
    "_rad": "rad",
    "_kg": "kg",
    "_m": "m",
    "_n": "N",
    "_v": "V",
    "_a": "A",
    "_hz": "Hz",
    "_h": "H",
    "_f": "F",
    "_c": "°C",
    "_k": "K",
    "_s": "s",
}
INERTIA = ("xx", "xy", "xz", "yy", "yz", "zz")
KEY = re.compile(r"\[([A-Z][A-Za-z]+\d{4})\]")
SOURCE = "Source of the numbers in this table that name none of their own."


def unit(key: str) -> str:
    """Unit by the ending of a key: kg for `mass_kg`."""
    if key in INERTIA:
        return "kg m²"
    return next((text for ending, text in UNITS.items() if key.endswith(ending)), "")


def units() -> str:
    """Table of the endings of keys and their units."""
    return table(("a key that ends in", "has the unit"), [[f"`{ending}`", text] for ending, text in UNITS.items()])


def meaning(name: str, field: FieldInfo) -> str:
    """Meaning of a key."""
    return field.description or (SOURCE if name == "source" else "")


def expected(annotation: Any, metadata: Sequence[Any] = ()) -> str:
    """Values that a key takes, in words."""
    words = _noted(metadata) or _noted(
        note for part in _parts(annotation) for note in getattr(part, "__metadata__", ())
    )
    if words:
        return words
    later = next((note.kind for note in metadata if isinstance(note, Later)), annotation)
    found = list(dict.fromkeys(_told(kind) for kind in _kinds(later)))
    return ", or ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found) + _bounds(metadata)


def _told(kind: Any) -> str:
    """Name of a type of value."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    inner = tuple(float if getattr(part, "__origin__", None) is float else part for part in inner)  # strict ones too
    if origin is typing.Literal:
        return " | ".join(f'`"{choice}"`' for choice in inner)
    if origin is tuple:
        if set(inner) <= {float, Ellipsis}:
            return "numbers" if Ellipsis in inner else f"{len(inner)} numbers"
        each = expected(inner[0])
        several = {"a table": "tables", "text": "a list of texts", "numbers": "lists of numbers"}
        return several.get(each, f"a list of {each}")
    if origin is dict:
        return "a table by joint" if inner[1] is float else "a table"
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return "a number" if kind is Quantity else "a table"
    return {bool: "`true` or `false`", int: "a whole number", float: "a number"}.get(kind, "text")


def _kinds(annotation: Any) -> list[Any]:
    """Alternatives of a type: the members of a union except None."""
    if typing.get_origin(annotation) is typing.Annotated:
        kind, *notes = typing.get_args(annotation)
        return _kinds(next((note.kind for note in notes if isinstance(note, Later)), kind))
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return [kind for part in typing.get_args(annotation) for kind in _kinds(part)]
    return [] if annotation is types.NoneType else [annotation]


def _bounds(metadata: Sequence[Any]) -> str:
    """The least and the most that a number may be."""
    names = {"ge": "{:g} or more", "gt": "above {:g}", "le": "at most {:g}", "lt": "below {:g}"}
    found = [
        text.format(getattr(note, name)) for name, text in names.items() for note in metadata if hasattr(note, name)
    ]
    return f", {' and '.join(found)}" if found else ""


def _parts(annotation: Any) -> list[Any]:
    return [annotation, *(inner for part in typing.get_args(annotation) for inner in _parts(part))]


def _noted(notes: Iterable[Any]) -> str:
    """Expectation that a reading states."""
    return next((note.expected for note in notes if hasattr(note, "expected")), "")


def robot_file() -> str:
    """A section for every table of a robot file."""
    return _sections(TABLES)


def parts_file() -> str:
    """A section for every table of a parts file that a robot file does not have, and for every solid."""
    return _sections(PARTS_TABLES)


def module_files() -> str:
    """A section for every table of a module library, an assembly and a task that a robot file does not have."""
    return _sections(MODULE_TABLES)


def scenario_file() -> str:
    """A section for every table of a scenario file."""
    kinds = [_keys_of_kinds(*each) for each in KINDS]
    return "\n\n".join([_sections(SCENARIO_TABLES), *kinds])


def _keys_of_kinds(home: str, title: str, about: str) -> str:
    """A section for the kinds of a table, with the keys of each."""
    parts = [f"## {title}", about]
    for kind, record in kinds_of(home).items():
        text = inspect.cleandoc(record.__doc__ or "")
        meanings = _arguments(text)
        keys = keys_of(home, record)
        if not keys:
            continue
        rows = [
            [f"`{key}`", _default(field), meanings.get(field.name) or meanings.get(key) or ALSO.get(key, "")]
            for key, field in keys.items()
        ]
        if "limits" in {field.name for field in dataclasses.fields(record)}:
            rows.append(
                [", ".join(f"`{each}`" for each in QUANTITIES), "the arm's", "Limits, in place of the record's."]
            )
        about_kind = escaped(text.partition("\n")[0])
        parts += [f'### kind = "{kind}"', about_kind, table(("key", "default", "meaning"), rows)]
    return "\n\n".join(parts)


def _arguments(text: str) -> dict[str, str]:
    """Meanings of arguments by their names, from the section Args of a docstring."""
    meanings = {}
    for entry in entries_of(text, "Args"):
        names, colon, about = entry.partition(": ")
        meanings |= {name.strip(): escaped(about) for name in names.split(",") if colon}
    return meanings


def _default(field: dataclasses.Field) -> str:
    if field.default is dataclasses.MISSING:
        return "needed" if field.default_factory is dataclasses.MISSING else ""
    if field.default is None or field.default == ():
        return ""
    return f"`{json.dumps(field.default)}`" if isinstance(field.default, (str, int, float)) else f"`{field.default}`"


def motion_file() -> str:
    """A section for every table of a motion file."""
    return _sections(MOTION_TABLES)


def log_file() -> str:
    """A section for every table of a log file."""
    return _sections(LOG_TABLES)


def calibration_file() -> str:
    """A section for every table of a file of measurements for a calibration."""
    return _sections(CALIBRATION_TABLES)


def _sections(tables: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...]) -> str:
    parts = []
    for title, about, records in tables:
        parts += [
            f"## {title}"
            if not title.startswith(("[", "dh", "frame", "inertia", "motor", "elast", "stops", "brake"))
            else f"## `{title}`",
            about,
        ]
        for record in records:
            parts += [_record(record)]
    return "\n\n".join(part for part in parts if part)


def _record(record: type[BaseModel]) -> str:
    rows = []
    last = {name: name == "source" for name in record.model_fields}
    for name, field in sorted(record.model_fields.items(), key=lambda item: last[item[0]]):
        needed = "needed" if field.is_required() else ""
        default = field.get_default(call_default_factory=False)
        if not field.is_required() and isinstance(default, (str, int, float)):
            needed = f"default `{json.dumps(default)}`"
        takes = expected(field.annotation, field.metadata)
        rows.append([f"`{name}`", takes, unit(name).replace(" ", "\u00a0"), needed, meaning(name, field)])
    return "\n\n".join([_prose(record), table(("key", "takes", "unit", "", "meaning"), rows)])


def _prose(record: type[BaseModel]) -> str:
    """The docstring: its first paragraph as text, equations below it line by line."""
    head, _, rest = inspect.cleandoc(record.__doc__ or "").partition("\n\n")
    if not rest:
        return KEY.sub(lambda key: rf"[\[{key[1]}\]](@references.md#{key[1].lower()})", head)
    lines = [textwrap.fill(line.replace("`", ""), 84, subsequent_indent="    ") for line in rest.splitlines()]
    return "\n".join([head, "", "```text", *lines, "```"])


GENERATORS = {
    "units": units,
    "robot-file": robot_file,
    "log-file": log_file,
    "calibration-file": calibration_file,
    "module-files": module_files,
    "parts-file": parts_file,
    "scenario-file": scenario_file,
    "motion-file": motion_file,
}
