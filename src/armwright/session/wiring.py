"""Controllers that DACOut's reference input can be wired to: the laws of `armwright.control`, with gains as they are typed."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Any

from armwright.errors import SessionError, nearest
from armwright.model.joint_signals import joint_units
from armwright.session.state import State, Wiring
from armwright.session.values import number, split, vector
from armwright.session.variables import lookup, same

MADE = ("model", "period", "signs")  # fields that the loop fills in


def laws() -> dict[str, type]:
    """Control laws by the names a session gives them: JointPID is joint-pid."""
    from armwright import control  # here, since a session asks for it only when something is wired

    found = [getattr(control, name) for name in control.__all__]
    kinds = [kind for kind in found if dataclasses.is_dataclass(kind) and hasattr(kind, "step")]
    return {
        re.sub(r"(?<=[a-z])(?=[A-Z])", "-", kind.__name__).lower(): kind for kind in kinds if isinstance(kind, type)
    }


def settings(kind: type) -> list[str]:
    """The fields of a law that may be typed; those without a default first."""
    return [field.name for field in dataclasses.fields(kind) if field.name not in MADE]  # type: ignore[arg-type]


def wired(state: State, kind: str, scale: str | None, given: Mapping[str, str]) -> Wiring:
    """A controller behind DACOut.

    Args:
        state: the session's.   kind: name of the law.   scale: what one volt asks for, one or one a joint.
        given: its gains as they were typed, numbers in the law's own units.
    Raises:
        SessionError: an unknown law or gain, a gain or the scale that is missing.   ScenarioError: a gain that does not do.
    """
    kinds = {same(name): name for name in laws()}
    if same(kind) not in kinds:
        raise SessionError(f"controller: no {kind!r}; {nearest(kind, [*laws(), 'none'])}")
    name = kinds[same(kind)]
    if scale is None:
        raise SessionError(
            'controller: scale is missing: what one volt of DACOut asks for; expected such as scale="10 deg"'
        )
    factors = vector("controller: scale", scale, state.arm.names, joint_units(state.arm, "q"), lookup(state))
    if not factors.all():
        raise SessionError(
            f"controller: scale = {scale!r}: a volt that asks for nothing; expected numbers other than 0"
        )
    wiring = Wiring(name, dict(given), tuple(float(f) for f in factors))
    _built(state, wiring)
    return wiring


def law(state: State) -> Any:
    """The controller of a state, built from what was typed."""
    assert state.wiring is not None
    return _built(state, state.wiring)


def _built(state: State, wiring: Wiring) -> Any:
    kind = laws()[wiring.kind]
    fields = {same(field.name): field for field in dataclasses.fields(kind) if field.name not in MADE}
    values = {}
    for name, text in wiring.settings.items():
        if same(name) not in fields:
            expected = nearest(name, [field.name for field in fields.values()])
            raise SessionError(f"controller {wiring.kind}: no gain {name!r}; {expected}")
        field = fields[same(name)]
        values[field.name] = _value(state, f"controller {wiring.kind}: {name}", str(field.type), text)
    needed = [f.name for f in fields.values() if f.default is dataclasses.MISSING and f.name not in values]
    if needed:
        raise SessionError(f"controller {wiring.kind}: {needed[0]} is missing; expected {needed[0]}=…")
    built = kind(**values)
    if hasattr(built, "configure"):
        built.configure(state.arm, state.dac_period)  # refuses now what the loop would refuse
    return built


def _value(state: State, place: str, kind: str, text: str) -> Any:
    """A field as its type wants it."""
    if kind.startswith("str"):
        return text
    if kind == "bool":
        if text not in ("yes", "no"):
            raise SessionError(f"{place} = {text!r}: expected yes or no")
        return text == "yes"
    if kind.startswith("int"):
        value = number(place, text, "-")
        if value != int(value):
            raise SessionError(f"{place} = {text!r}: expected a whole number")
        return int(value)
    if kind.startswith("float"):
        return number(place, text, "-")
    parts = split(place, text)
    if any(unit for _, unit in parts):
        raise SessionError(f"{place} = {text!r}: has a unit; expected a plain number in the law's own units")
    if len(parts) == 1:
        return number(place, text, "-")
    return vector(place, text, state.arm.names, ["-"] * state.arm.n, lambda name, index: None)
