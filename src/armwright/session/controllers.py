"""Controllers with DACOut as reference: those of `armwright.control`, with typed gains."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np

from armwright.errors import SessionError
from armwright.model.joint_signals import joint_units
from armwright.session.arguments import same
from armwright.session.listing import Output, Sheet, TextLine, significant
from armwright.session.state import ControllerSettings, SessionState
from armwright.session.values import number, split, vector
from armwright.session.variables import lookup
from armwright.session.workspace import Workspace

NONE = "none"
BY_THE_LOOP = ("arm", "model", "period", "signs")  # fields that the loop fills in


def controller(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`controller KIND scale=… GAIN=…`: DACOut becomes the reference of a controller; `controller none` drives the motors."""
    state, kind = session.state, arguments["kind"]
    if kind == NONE:
        if arguments["pairs"] or arguments["scale"]:
            raise SessionError("takes no gains", place="controller none")
        session.state = state.replace(controller=None, dac=np.zeros(state.arm.n))
        return [TextLine("DACOut is wired to the motors", "good")]
    if kind is not None:
        settings = _settings(state, kind, arguments["scale"], arguments["pairs"])
        session.state = state.replace(controller=settings, dac=np.zeros(state.arm.n))
    return _output(session.state)


def _output(state: SessionState) -> list[Output]:
    """The present controller, or a list of all controllers."""
    settings = state.controller
    if settings is None:
        rows = tuple((name, " ".join(gain_names(kind))) for name, kind in laws().items())
        none = TextLine("DACOut is wired to the motors; there is no controller")
        return [none, Sheet("controllers", ("kind", "gains"), rows, words=2)]
    built_controller(state, settings)
    gains = ", ".join(f"{name} = {text}" for name, text in settings.gains.items())
    units = [body.kind.units.position for body in state.arm.coordinates]
    scale = ", ".join(
        f"{significant(s)} {unit}/V" for s, unit in dict.fromkeys(zip(settings.scale, units, strict=True))
    )
    return [TextLine(f"DACOut asks {settings.kind} for positions, {scale}; {gains}", "good")]


def laws() -> dict[str, type]:
    """Controllers by their names in a session: JointPID is joint-pid."""
    from armwright import control  # late: few sessions need it

    members = [getattr(control, name) for name in control.__all__]
    kinds = [kind for kind in members if dataclasses.is_dataclass(kind) and hasattr(kind, "step")]
    # around another controller, which one line does not hold
    kinds = [kind for kind in kinds if not hasattr(kind, "changed")]
    return {
        re.sub(r"(?<=[a-z])(?=[A-Z])", "-", kind.__name__).lower(): kind for kind in kinds if isinstance(kind, type)
    }


def gain_names(kind: type) -> list[str]:
    """The fields of a controller that may be typed; required ones first."""
    return [field.name for field in dataclasses.fields(kind) if field.name not in BY_THE_LOOP]  # type: ignore[arg-type]


def _settings(state: SessionState, kind: str, scale: str | None, gains: dict[str, str]) -> ControllerSettings:
    """Settings that were checked by building the controller.

    Args:
        state: the session's.   kind: name of the controller.   scale: position that one volt asks for, one or one per joint.
        gains: as they were typed, numbers in the controller's own units.
    Raises:
        SessionError: an unknown law or gain, a gain or the scale that is missing.   ScenarioError: a gain that is refused.
    """
    kinds = {same(name): name for name in laws()}
    if same(kind) not in kinds:
        raise SessionError("no such controller", place="controller kind", value=kind, choices=[*laws(), NONE])
    place = "controller scale"
    if scale is None:
        raise SessionError("missing", place=place, expected='position that one volt asks for, such as scale="10 deg"')
    factors = vector(place, scale, state.arm.names, joint_units(state.arm, "q"), lookup(state))
    if not factors.all():
        raise SessionError(place=place, value=scale, expected="numbers other than 0")
    settings = ControllerSettings(kinds[same(kind)], dict(gains), tuple(float(f) for f in factors))
    built_controller(state, settings)
    return settings


def built_controller(state: SessionState, settings: ControllerSettings) -> Any:
    """The controller of these settings.

    Raises:
        SessionError: a gain that is unknown, missing or no number.   ScenarioError: a gain that the controller refuses.
    """
    kind, place = laws()[settings.kind], f"controller {settings.kind}"
    fields = {same(field.name): field for field in dataclasses.fields(kind) if field.name not in BY_THE_LOOP}
    values = {}
    for name, text in settings.gains.items():
        if same(name) not in fields:
            raise SessionError(
                "no such gain", place=f"{place} gain", value=name, choices=[field.name for field in fields.values()]
            )
        field = fields[same(name)]
        values[field.name] = _value(state, f"{place} {name}", str(field.type), text)
    for field in fields.values():
        if field.default is dataclasses.MISSING and field.name not in values:
            raise SessionError("missing", place=f"{place} {field.name}", expected=f"{field.name}=…")
    law = kind(**values)
    if hasattr(law, "configure"):
        law.configure(state.arm, state.dac_period)  # refuses now what the loop would refuse
    return law


def _value(state: SessionState, place: str, kind: str, text: str) -> Any:
    """A gain as the type of its field asks for."""
    if kind.startswith(("str", "Literal")):
        return text
    if kind == "bool":
        if text not in ("yes", "no"):
            raise SessionError(place=place, value=text, expected="yes or no")
        return text == "yes"
    if kind.startswith("int"):
        value = number(place, text, "-")
        if value != int(value):
            raise SessionError(place=place, value=text, expected="a whole number")
        return int(value)
    if kind.startswith("float"):
        return number(place, text, "-")
    parts = split(place, text)
    if any(unit for _, unit in parts):
        raise SessionError(
            "has a unit", place=place, value=text, expected="a plain number in the controller's own units"
        )
    if len(parts) == 1:
        return number(place, text, "-")
    return vector(place, text, state.arm.names, ["-"] * state.arm.n, lambda name, index: None)
