"""Tables made from the kernels' signatures, the units of results, the robots' files, the command line and a program."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from csv import reader
from pathlib import Path
from typing import Any

import typer.main

import armwright as aw
from armwright.cli.app import app
from armwright.cli.tables import number
from armwright.description.drive import DC_EQUIVALENT
from armwright.description.paths import quantities
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.kinematics.reach import reach
from armwright.model.joint_signals import LONG_NAMES, UNITS
from armwright.twin.serial.frames import FRAMINGS
from armwright.twin.serial.registers import servo_model

KINDS_OF_INPUT = {
    "assembly": "assemblies and module libraries",
    "bus": "arguments of runs over a bus, which stay on a bus of the process",
    "command": "command lines, each a process of its own, with the files that they name",
    "csv": "schedules and tables",
    "csv dialect": "CSV with other delimiters, decimal marks, line ends, encodings and headers",
    "eds": "data sheets of drives (EDS)",
    "formula": "formulas that are typed",
    "function": "arrays for the plain functions of an arm",
    "kernel": "arrays for the compiled functions, outputs included",
    "log": "logs of measurements and their CSV",
    "mcap": "MCAP recordings",
    "mesh": "STL, OBJ and PLY, as text and binary",
    "mjcf": "MJCF",
    "motion": "motion files",
    "object": "arguments of schedules, references, controllers, sensors and other parts of a scenario",
    "other": "arguments of further functions",
    "parquet": "Parquet logs",
    "parts": "parts files",
    "robot": "robot files",
    "run": "saved runs (NetCDF)",
    "scenario": "scenario files",
    "scenario-in-python": "fields of `aw.Scenario`",
    "session": "scripts of `armwright sim`",
    "task": "task files",
    "urdf": "URDF and drive files",
    "zarr": "stores of sweeps",
}


def table(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(_cell(cell) for cell in line)} |" for line in lines)


def _cell(value: Any) -> str:
    return str(value).replace("|", "\\|")


def shape(argument: Any) -> str:
    """Name, shape and unit of a kernel's input or output."""
    return f"`{argument.name}` ({', '.join(['…', *map(str, argument.shape)])}) [{argument.unit}]"


def kernels() -> str:
    """The table of kernels."""
    rows = []
    for name, signature in SIGNATURES.items():
        inputs = [shape(a) for a in signature.inputs] + [f"{shape(a)}, optional" for a in signature.optional]
        most = f"<br>up to {signature.most_joints} joints" if signature.most_joints is not None else ""
        rows.append(
            [f"`{name}`{most}", "<br>".join(inputs), "<br>".join(shape(output) for output in signature.outputs)]
        )
    return table(("kernel", "inputs", "output"), rows)


def results() -> str:
    """Table of the variables of a run."""
    rows = []
    for name, text in LONG_NAMES.items():
        units = ["V", "A", "N m", "N"] if name == "u" else list(dict.fromkeys(UNITS[name]))
        rows.append([f"`{name}`", text, " | ".join(units)])
    return table(("variable", "what it is", "unit"), rows)


def fuzz() -> str:
    """Outcomes of the campaign of damaged inputs, by kind."""
    data = json.loads((Path(__file__).parents[2] / "tests" / "fuzz" / "counts.json").read_text(encoding="utf-8"))
    heads, kinds = ("accepted", "refused", "other"), data["kinds"]
    rows = [[f"{name}: {KINDS_OF_INPUT[name]}", *(f"{row[head]:,}" for head in heads)] for name, row in kinds.items()]
    sums = [sum(row[head] for row in kinds.values()) for head in heads]
    effort = f"{sum(sums):,} inputs in {data['minutes']:.0f} minutes of one process"
    counted = table(
        ("kind of input", "accepted", "refused in one line", "anything else"),
        [*rows, ["all", *(f"{n:,}" for n in sums)]],
    )
    return f"{counted}\n\n{effort}, which never took more than {data['peak_mib']} MiB."


SIGNS = {"exact": "●", "approximated": "◐", "without effect": "–", "refused": "✕"}


def features() -> str:
    """A table of outcomes for each group of consumers, and the words of all that is not exact."""
    from armwright.features import CONSUMERS, declared

    parts, count = [], dict.fromkeys(SIGNS, 0)
    for title, places in CONSUMERS.items():
        supports = [declared(place) for place in places]
        known = {name: feature for each in supports for name, feature in each.features.items()}
        rows: list[list[str]] = []
        for name in known:
            outcomes = [each.outcome(name)[0] if name in each.features else "" for each in supports]
            for outcome in filter(None, outcomes):
                count[outcome] += 1
            rows.append([name, *(SIGNS.get(outcome, "") for outcome in outcomes)])
        parts.append(
            f"## {title}\n\n{table(['', *(each.consumer for each in supports)], rows)}\n\n"
            + "\n".join(_words(supports))
        )
    total = sum(count.values())
    shares = ", ".join(
        f"{SIGNS[outcome]} {outcome} {number} ({number / total:.0%})" for outcome, number in count.items()
    )
    return f"{total} pairs: {shares}.\n\n" + "\n\n".join(parts)


def _words(supports: Sequence[Any]) -> list[str]:
    """A line for each declared reason, with the consumers that have it and the features that it is about."""
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for each in supports:
        own: dict[tuple[str, str], list[str]] = {}
        for name in each.features:
            outcome, words = each.outcome(name)
            if outcome != "exact":
                own.setdefault((outcome, words), []).append(name)
        for (outcome, words), names in own.items():
            reasons.setdefault((outcome, ", ".join(names), words), []).append(each.consumer)
    return [
        f"- {SIGNS[outcome]} **{features}**: {words} ({', '.join(consumers)})"
        for (outcome, features, words), consumers in sorted(reasons.items())
    ]


def csv(name: str) -> str:
    """A file of `docs/data` as a table."""
    with (Path(__file__).parents[1] / "data" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        heads, *rows = reader(file)
    return table(heads, rows)


def brushless() -> str:
    """Factors to DC-equivalent constants."""
    rows = []
    for basis, f in DC_EQUIVALENT.items():
        factors = (f.torque_constant, f.back_emf_constant, f.impedance, f.voltage, f.current)
        rows.append([f"`{basis}`", *(f"{x:.6g}" for x in factors)])
    return table(("`basis`", "Kt ×", "Ke ×", "R, L ×", "voltage ×", "current ×"), rows)


EVIDENCE = {  # words of the overview for kinds of sources
    **dict.fromkeys(("definition", "drawing", "cad", "datasheet", "publication", "import"), "published"),
    **dict.fromkeys(("measurement", "fit"), "measured"),
    "estimate": "estimated",
}
KNOWLEDGE = {  # columns of the overview, and the parts of a path of which one makes a number belong there
    "kinematics": ("dh", "modified_dh", "frame", "axis", "xyz_m", "rpy_rad"),
    "masses": ("mass_kg", "com_m", "inertia_kg_m2"),
    "motors": ("motor",),
    "friction": ("friction",),
    "limits": ("limits",),
}


def robots() -> str:
    """An overview of what is known of the built-in arms, and a section for each."""
    return "\n\n".join([_known(), *(_robot(name) for name in aw.builtin_names())])


def _known() -> str:
    """Table of the arms: what is published, measured, estimated."""
    rows = []
    for name in aw.builtin_names():
        arm = aw.load(name, on_impossible="warn")
        record = arm.description
        assert record is not None
        found: dict[str, dict[str, None]] = {head: {} for head in KNOWLEDGE}
        for path, _, key in quantities(record):
            parts = set(re.split(r"[.\[]", path))
            for head in [head for head, words in KNOWLEDGE.items() if parts.intersection(words)]:
                found[head][EVIDENCE[record.source_of(key or "").kind]] = None
        drive = ", ".join(dict.fromkeys(body.drive.command for body in arm.bodies))
        cells = [
            ", ".join(word for word in dict.fromkeys(EVIDENCE.values()) if word in words) for words in found.values()
        ]
        rows.append([f"[{name}](#{name})", arm.n, drive, *cells])
    return table(("arm", "joints", "driven by", *KNOWLEDGE), rows)


def _robot(name: str) -> str:
    arm = aw.load(name, on_impossible="warn")
    record = arm.description
    assert record is not None
    drive = ", ".join(dict.fromkeys(body.drive.command for body in arm.bodies))
    facts = [
        ("joints", f"{arm.n}: {', '.join(arm.names)}"),
        ("mass", f"{number(record.total_mass)} kg, all links"),
        ("reach", f"{number(reach(arm))} m at most, base to {arm.tip}"),
        ("driven by", drive),
        ("gravity", f"({', '.join(f'{g:g}' for g in arm.gravity)}) m/s², base axes"),
    ]
    picture = f"![{name} in one pose](images/robot-{name}.png)"
    parts = [f"## {name}", f"{record.title}.", record.notes or "", picture, table(("", ""), facts), _joints(arm)]
    parts += ["Where the numbers come from:", _sources(record)]
    parts += [f"> **Note:** {warning}" for warning in arm.warnings]
    return "\n\n".join(part for part in parts if part)


def _joints(arm: Any) -> str:
    """Table with one row for each moving joint, without empty columns."""
    columns: dict[str, list[str]] = {"joint": [body.joint for body in arm.bodies], "mass [kg]": []}
    for body in arm.bodies:
        columns["mass [kg]"].append(number(body.mass))
        drive, limits = body.drive, body.limits
        motor = drive.torque_constant is not None or drive.armature
        known = {
            "gear": drive.gear_ratio if motor else None,
            "rotor at the joint [kg m²]": drive.armature or None,
            "Kt [N m/A]": drive.torque_constant,
            "R [Ω]": drive.resistance,
            "voltage ≤ [V]": limits.voltage,
            "current ≤ [A]": limits.current,
            "torque ≤ [N m]": limits.torque,
            "velocity ≤ [rad/s]": limits.velocity,
        }
        for head, value in known.items():
            columns.setdefault(head, []).append("" if value in (None, float("inf")) else number(value))
    used = {head: cells for head, cells in columns.items() if any(cells)}
    heads = [re.sub(r"(?<=\w) (?=[^\[]*\])", "\u00a0", head) for head in used]  # units stay in one piece
    return table(heads, zip(*used.values(), strict=True))


def _sources(record: Any) -> str:
    counts: dict[str, int] = {}
    for _, _, key in quantities(record):
        counts[key or ""] = counts.get(key or "", 0) + 1
    rows = []
    for key, count in counts.items():
        source = record.source_of(key)
        date = source.date if source.date and source.date[:4] not in source.text else None
        text = ", ".join(part for part in (source.text, date, source.licence) if part)
        rows.append([f"`{key}`", source.kind, count, text])
    return table(("source", "kind", "numbers", "what it is"), rows)


def commands() -> str:
    """A section for every command."""
    parts = []
    for name, command in _single("", typer.main.get_command(app)):
        parameters = [p for p in command.params if not getattr(p, "hidden", False)]
        arguments = [p for p in parameters if p.param_type_name == "argument"]
        options = [p for p in parameters if p.param_type_name == "option"]
        usage = " ".join([f"armwright {name}", *(_argument(p) for p in arguments), *(["[options]"] if options else [])])
        parts += [f"## {name}", f"```text\n{usage}\n```", _help(command.help or "")]
        if arguments:
            parts.append(table(("argument", ""), [[f"`{p.metavar}`", _unmarked(p.help)] for p in arguments]))
        if options:
            parts.append(table(("option", "", "default"), [_option(p) for p in options]))
    return "\n\n".join(parts)


def _single(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    """Every command with its full name; a group such as `export` by what is in it."""
    if not hasattr(command, "commands"):
        yield name.strip(), command
        return
    for word in command.list_commands(None):  # in the order of the help
        yield from _single(f"{name} {word}", command.commands[word])


def _argument(parameter: Any) -> str:
    return parameter.metavar if parameter.required else f"[{parameter.metavar}]"


def _option(parameter: Any) -> list[str]:
    names = ", ".join(f"`{name}`" for name in parameter.opts)
    value = f" `{parameter.metavar}`" if parameter.metavar else ""
    default = "" if parameter.default is None or parameter.is_flag else f"`{parameter.default}`"
    return [names + value, _unmarked(parameter.help), default]


def _unmarked(text: str | None) -> str:
    """A help text without the backslashes that keep its brackets from being markup."""
    return (text or "").replace("\\[", "[")


def _help(text: str) -> str:
    """The help text; what stands behind a \\b are examples."""
    prose, _, examples = text.partition("\b")
    lines = [line.removeprefix("  ").rstrip() for line in examples.strip().splitlines()]
    prose = re.sub(r"(\b[a-zτ]+_JOINT\b)", r"`\1`", prose.strip())
    return prose + (f"\n\n```sh\n{chr(10).join(lines[1:])}\n```" if lines else "")


def program() -> str:
    """The two-link arm's gravity torques, traced."""
    arm = aw.load("two-link")
    return f"```text\n{trace_kernel(arm, SIGNATURES['gravity_torques'])}\n```"


def benchmark(name: str) -> str:
    """A table of the newest result that `make bench` saved, with the columns of `BENCHMARK`; or "machine", what it ran on."""
    newest = sorted((Path(__file__).parents[2] / "benchmarks" / "results").glob("*.md"))[-1]
    head, *sections = re.split(r"^##? ", newest.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    if name == "machine":
        return head.replace("\n", ":\n", 1)
    beginning, wanted = BENCHMARK[name]
    section = next((section for section in sections if section.startswith(beginning)), "")
    rows = [[c.strip() for c in line.strip("|").split(" | ")] for line in section.splitlines() if line.startswith("|")]
    if not rows:
        return f"*{newest.name} has no table of this.*"
    kept = [k for k, column in enumerate(rows[0]) if not wanted or column in wanted]
    heads = [rows[0][k] for k in kept]
    cells = table(heads, [[row[k].replace("_", " ") for k in kept] for row in rows[2:]])
    # of another day than the rest
    dated = [line[2:] for line in section.splitlines() if line.startswith("- measured on ")]
    return "\n\n".join([cells, *(f"This table was {line}." for line in dated)])


# how a table's title begins, and its columns here; () is all of them
BENCHMARK: dict[str, tuple[str, tuple[str, ...]]] = {
    "kernels": (
        "Kernels",
        ("arm", "kernel", "ours, batch", "Pinocchio C++", "Pinocchio C++ ÷ ours", "MuJoCo", "MuJoCo ÷ ours"),
    ),
    "limit": (
        "Kernels",
        ("arm", "kernel", "ours, batch", "operations", "at the machine's limit", "of the limit", "as flops"),
    ),
    "calls": (
        "One call, from Python",
        (
            "arm",
            "kernel",
            "states",
            "plain",
            "Pinocchio",
            "Pinocchio ÷ plain",
            "bound",
            "bound ÷ plain",
            "general path",
        ),
    ),
    "joints": ("Cost per joint", ()),
    "forms": ("Other forms", ("kernel", "form", "this form", "usual ÷ this", "Pinocchio C++ ÷ ours")),
    "simulation": ("Simulation", ("work", "form", "ours", "MuJoCo Euler", "Euler ÷ ours", "MuJoCo RK4", "RK4 ÷ ours")),
    "threads": ("Threads", ("work", "threads", "ours", "times as fast as one")),
    "start": (
        "From nothing",
        ("work", "all", "load", "kernel", "import numpy", "import casadi", "import llvmlite", "import pydantic"),
    ),
    "commands": ("Commands", ("work", "all", "import packages", "above packages")),
    "compile": ("Tracing and compiling", ("arm", "kernel", "operations", "all")),
    "ik": (
        "Inverse kinematics",
        ("arm", "work", "ours", "ours, by default", "EAIK", "EAIK ÷ ours", "tol 1e-6 ÷ ours", "tol 1e-16 ÷ ours"),
    ),
    "planning": (
        "Planning",
        ("arm", "work", "points", "ours", "toppra", "toppra ÷ ours", "our motion, s", "toppra's motion, s"),
    ),
}


def instructions() -> str:
    """Instructions of bus servos that the twin answers, one row for each name."""
    framings = FRAMINGS.values()
    names = dict.fromkeys(name for framing in framings for name in framing.instructions.values())
    codes = [{name: f"0x{code:02X}" for code, name in framing.instructions.items()} for framing in framings]
    return table(("instruction", *FRAMINGS), ([name, *(each.get(name, "") for each in codes)] for name in names))


def registers(name: str) -> str:
    """Registers of a model of servos."""
    model = servo_model(name)
    rows = [
        (
            r.address,
            r.size,
            f"`{r.name}`",
            "EEPROM" if r.address < model.eeprom else "RAM",
            "read, write" if r.writable else "read",
            "" if r.default is None else r.default,
            "" if r.low is None else f"{r.low} to {r.high}",
            r.unit.strip("-"),
            {"u": "", "s": "two's complement"}.get(r.form, f"sign in bit {r.form[1:]}"),
        )
        for r in model.registers
    ]
    return table(("address", "bytes", "name", "kept in", "access", "at power-up", "range", "unit", "sign"), rows)


ORIGINS = {"publication": "measured", "measurement": "measured", "estimate": "estimated"}  # others are known


def servos() -> str:
    """Constants of the servos of the library at their shafts, beside the figures of data sheets."""
    rows = []
    for name, servo in aw.robotfiles.servos().items():
        shaft, sheet = servo.shaft, servo.data_sheet
        stated = ("—", "—") if sheet is None else (sheet.stall_torque_n_m, sheet.no_load_speed_rad_per_s)
        marks = [f"{it if it == '—' else number(it)}" for it in stated]
        keys = ("stall_torque_n_m", "no_load_speed_rad_per_s")
        marks = [f"{mark} ✕" if key in servo.disagrees else mark for key, mark in zip(keys, marks, strict=True)]
        constants = (shaft.gear_ratio, shaft.torque_constant_n_m_per_a, shaft.resistance_ohm, shaft.armature_kg_m2)
        law = "viscous, Coulomb" if servo.friction.law == "coulomb" else "by load"
        rows.append([f"`{name}`", servo.title, number(servo.limits.voltage_v), *map(number, constants), law, *marks])
    heads = ("name", "servo", "supply [V]", "gear", "Kt [N m/A]", "R [Ω]", "armature [kg m²]", "friction")
    return table((*heads, "stall torque [N m]", "no-load speed [rad/s]"), rows)


def servo_origins() -> str:
    """Table of the servos of the library: each part known, measured, estimated or unknown."""
    from armwright.description.servos import servo_library

    parts = {
        "gear": "shaft.gear_ratio",
        "Kt, R": "shaft.torque_constant_n_m_per_a shaft.resistance_ohm",
        "armature": "shaft.armature_kg_m2",
        "friction": "friction.viscous_n_m_s_per_rad",
        "supply": "limits.voltage_v",
        "resolution": "firmware.counts_per_turn",
        "P to duty": "firmware.p_scale_per_rad",
        "period of the loop": "firmware.period_s",
        "play": "play_rad",
        "bus": "bus.baud_bit_per_s",
    }
    rows = []
    for name, servo in aw.robotfiles.servos().items():
        kinds = {path: servo_library().sources[source].kind for path, _, source in quantities(servo)}
        found = {part: [kinds.get(path) for path in paths.split()] for part, paths in parts.items()}
        words = (dict.fromkeys(ORIGINS.get(kind, "known") if kind else "—" for kind in each) for each in found.values())
        rows.append([f"`{name}`", *(", ".join(each) for each in words)])
    return table(("name", *parts), rows)


def servo_notes() -> str:
    """List of the servos of the library with their doubtful numbers and effects that are not modelled."""
    return "\n".join(f"- **{servo.title}**: {servo.notes}" for servo in aw.robotfiles.servos().values())


def servo_sources() -> str:
    """Sources of the library of servos."""
    from armwright.description.servos import servo_library

    rows = []
    for key, source in servo_library().sources.items():
        about = ", ".join(part for part in (source.text, source.date, source.licence) if part)
        rows.append([f"`{key}`", source.kind, about])
    return table(("source", "kind", "what it is"), rows)


GENERATORS = {
    "servos": servos,
    "servo-origins": servo_origins,
    "servo-notes": servo_notes,
    "servo-sources": servo_sources,
    "instructions": instructions,
    "registers": registers,
    "benchmark": benchmark,
    "kernels": kernels,
    "results": results,
    "brushless": brushless,
    "csv": csv,
    "robots": robots,
    "commands": commands,
    "fuzz": fuzz,
    "features": features,
    "program": program,
}
