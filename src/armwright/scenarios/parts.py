"""Parts of a scenario from the values of its file: the loop, its reference, and tables over time from the files it names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ExpressionError, ScenarioError
from armwright.expressions import expression
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.scalar import Scalar
from armwright.scenarios.files import Files
from armwright.scenarios.kinds import controller_of, from_fields
from armwright.scenarios.mistakes import Mistakes
from armwright.scenarios.values import Fields
from armwright.simulation.inputs.input_schedule import WRENCH
from armwright.simulation.inputs.schedule import Schedule, parse_schedule
from armwright.simulation.loop.command_filter import CommandFilter
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.timing import Timing
from armwright.trajectory.motion import Motion
from armwright.trajectory.motion_files import parse_motion

OF_LOOP = {"sensors": Sensors, "command_filter": CommandFilter, "timing": Timing}


def make_parts(values: dict[str, Fields], arm: Model, files: Files, mistakes: Mistakes) -> None:
    """Puts tables over time, references and the controller in the places of their values.

    Args:
        values: by the part; those of lanes are put in.   arm: the model.   files: that it names.
        mistakes: where those of every part are noted.
    """
    commands, inputs = values["commands"], values["inputs"]
    braked = [body.joint for body in arm.coordinates if body.brake is not None]
    servos = [body.joint for body in arm.coordinates if body.drive.firmware is not None]
    over_time = (
        ("wrench", WRENCH, ["N"] * 3 + ["N m"] * 3),
        ("brake", braked, None),
        ("supply", ("supply",), ["V"]),
        ("enabled", servos, None),
    )
    for name, columns, units in over_time:
        if isinstance(inputs.get(name), str):
            with mistakes.noted():
                inputs[name] = _schedule(f"inputs.{name}", inputs[name], columns, units, files)
    if commands.get("schedule") is not None:
        with mistakes.noted():
            commands["constant"] = _joint_schedule("commands.schedule", commands["schedule"], "u", arm, files)
    for part in ("recording", "loop"):
        if values.get(part, {}).get("reference") is not None:
            with mistakes.noted():
                values[part]["reference"] = _reference(part, values[part]["reference"], arm, files)
    if "controller" in values.get("loop", {}):
        with mistakes.noted():
            values["loop"]["controller"] = controller_of("loop.controller", values["loop"]["controller"], arm)
    for name, part in OF_LOOP.items():
        if "loop" in values:
            with mistakes.noted("loop"):
                values["loop"][name] = part(**values["loop"][name])


def _reference(part: str, fields: Fields, arm: Model, files: Files) -> Any:
    """A reference of the scenario, or the one that another shapes."""
    place, kind = f"{part}.reference", fields["kind"]
    if "reference" in fields:
        fields = fields | {"reference": _reference(place, fields["reference"], arm, files)}
    if kind == "pose":
        return fields["q"]
    if kind == "expression":
        return Formulas(tuple(fields["q"]), f"{place}.q")
    if kind == "schedule":
        return _joint_schedule(f"{place}.file", fields["file"], "q", arm, files)
    if kind == "motion":
        return _motion(f"{place}.file", fields["file"], arm, files)
    return from_fields("reference", place, fields, arm)


def _joint_schedule(place: str, name: str, signal: str, arm: Model, files: Files) -> Schedule:
    """A table over time with a column for each joint, of positions "q" or commands "u"."""
    return _schedule(place, name, arm.names, joint_units(arm, signal), files)


def _schedule(place: str, name: str, columns: Sequence[str], units: Sequence[str] | None, files: Files) -> Schedule:
    """A table over time with these columns."""
    return parse_schedule(*files.table(place, name), columns, units)


def _motion(place: str, name: str, arm: Model, files: Files) -> Motion:
    """The motion of a motion file, planned, or of a table of rows."""
    from armwright.motions.plan import plan_text  # which reads files as scenarios do

    text, file = files.table(place, name)
    if not name.endswith(".motion.toml"):
        return parse_motion(text, file, arm).from_file(file)
    plan = plan_text(text, file, files)
    if (plan.arm.name, *plan.arm.names) != (arm.name, *arm.names):
        expected = f"a motion of {arm.name}: {', '.join(arm.names)}"
        raise ScenarioError(f"is one of {plan.arm.name}", place=place, value=name, expected=expected)
    return plan.motion


@dataclass(frozen=True, eq=False)
class Formulas:
    """q(t) from one formula a joint.

    Args:
        texts: (n,) of the joints.   place: of them in the file, for errors.
    Raises:
        ScenarioError: a text that is no formula of t.
    """

    texts: Sequence[str]
    place: str = "loop.reference.q"

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "_formulas", [expression(text, ("t",)) for text in self.texts])
        except ExpressionError as error:
            raise ScenarioError.of(*error.within(self.place).problems) from None

    def __call__(self, t: Scalar) -> np.ndarray:
        """q (n,) [rad | m] at t [s]."""
        try:
            return scalar.array([formula({"t": t}) for formula in self._formulas])  # type: ignore[attr-defined]
        except ExpressionError as error:  # whoever asks names the part: loop or recording
            raise ScenarioError.of(*error.within(self.place.partition(".")[2]).problems) from None
