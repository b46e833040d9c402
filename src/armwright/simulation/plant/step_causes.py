"""Causes of a step limit: the effect of a joint that makes a mode of the linearised plant fast, and its key in the record.

Every effect is weakened a thousandfold, one at a time, in one traced program. The cause of a limit is the effect without which
the same state of the same arm allows the largest step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from armwright import scalar
from armwright.actuators.friction import smoothing_key
from armwright.friction_laws import LAWS
from armwright.joint_kinds import ROTARY, JointUnits
from armwright.model import Body, EfficiencyTable, Model, TableSpring
from armwright.scalar import Array, Scalar

LEFT = 1e-3  # of a weakened effect
UNSMOOTHED = "no {key} in the record: friction then sticks"


@dataclass(frozen=True)
class Cause:
    """An effect that makes a mode fast.

    Attributes:
        effect: in words, "the dry friction of joint 'elbow'".   key: in that joint's record, or in the robot's.
        remedy: a change of the record that makes the mode slower, beside a smaller step; empty if there is none.
    """

    effect: str
    key: str
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.effect} ({self.key})"


@dataclass(frozen=True)
class Weakened:
    """An arm with one scale factor per effect, each an input of what is traced.

    Attributes:
        arm: with its numbers.   causes: its effects, in the order of the inputs.
    """

    arm: Model
    causes: tuple[Cause, ...]
    _changes: tuple[Callable[[Model, Scalar], Model], ...]

    @classmethod
    def of(cls, arm: Model) -> Weakened:
        """The arm with all effects that can limit a step."""
        effects = list(_effects(arm))
        return cls(arm, tuple(cause for cause, _ in effects), tuple(change for _, change in effects))

    @property
    def names(self) -> tuple[str, ...]:
        """The effects, one for each input."""
        return tuple(map(str, self.causes))

    def model(self, values: Array) -> Model:
        """The arm with its effects multiplied by these (k,)."""
        model = self.arm
        for change, value in zip(self._changes, values, strict=True):
            model = change(model, value)
        return model


Change = Callable[[Any, Scalar], Any]  # a part of an arm and a factor → that part, one effect multiplied by the factor


def _effects(arm: Model) -> Iterator[tuple[Cause, Callable[[Model, Scalar], Model]]]:
    """Causes, and what multiplies each by a factor in a model."""
    for i, body in enumerate(arm.bodies):
        for name, key, change, remedy in _effects_of_joint(body):
            yield Cause(f"{name} of joint {body.joint!r}", key, remedy.format(key=key)), _in_tuple("bodies", i, change)
    for i, cylinder in enumerate(arm.cylinders):
        change = _scaled("stiffness", "preload")
        yield Cause(f"the spring of cylinder {cylinder.name!r}", "stiffness_n_per_m"), _in_tuple("cylinders", i, change)
    if arm.supply is not None:
        cause = Cause("the bus that drives load", "supply.capacitance_f", "a larger supply.capacitance_f")
        yield cause, lambda model, w: replace(model, supply=_scaled(inverse=("capacitance",))(model.supply, w))
    if any(arm.gravity):
        yield (
            Cause("the arm's swing under its weight", "gravity_m_s2"),
            lambda model, w: replace(model, gravity=model.gravity * w),
        )


def _effects_of_joint(body: Body) -> Iterator[tuple[str, str, Change, str]]:
    """Name, key, change and remedy of each effect of one joint."""
    units = body.kind.units
    if body.friction is not None:
        yield from _effects_of_friction(body, ROTARY if body.friction.on_motor else units)
    drive = body.drive
    if drive.efficiency is not None or (body.friction is not None and body.friction.load_coefficient is not None):
        key = "motor.gear_efficiency" if drive.smoothing is None else smoothing_key(body)
        yield "the gear loss", key, _less_gear_loss, "" if drive.smoothing is None else UNSMOOTHED
    if drive.back_emf_constant is not None:
        yield "the winding", "motor.resistance_ohm", _in_part("drive", _scaled("back_emf_constant")), ""
    if drive.cogging is not None:
        cogging = _in_part("drive", _in_part("cogging", _scaled("amplitude")))
        yield "the cogging", "motor.cogging.amplitude_n_m", cogging, ""
    if drive.thermal is not None:
        change = _in_part("drive", _in_part("thermal", _slower_heat))
        yield "the motor's heat", "motor.thermal.winding_capacity_j_per_k", change, ""
    springs = (("elasticity", "the elastic gear", units), ("stops", "the end stop", units))
    if body.brake is not None and not body.brake.is_rigid:
        springs = (*springs, ("brake", "the brake", ROTARY if body.brake.on_motor else units))
    for part, name, own in springs:
        if getattr(body, part) is None:
            continue
        stiff = ("stiffness", "cubic") if part == "elasticity" else ("stiffness",)
        stiffness, damping = (f"{part}.{own.key(stem, stem)}" for stem in ("stiffness", "damping"))
        yield f"the spring of {name}", stiffness, _in_part(part, _scaled(*stiff)), ""
        yield f"the damper of {name}", damping, _in_part(part, _scaled("damping")), ""
    if isinstance(body.spring, TableSpring):
        yield "the spring", f"spring.{units.key('torques', 'torque')}", _in_part("spring", _scaled("torques")), ""
    elif body.spring is not None:
        key = f"spring.{units.key('stiffness', 'stiffness')}"
        yield "the spring", key, _in_part("spring", _scaled("stiffness")), ""


def _effects_of_friction(body: Body, units: JointUnits) -> Iterator[tuple[str, str, Change, str]]:
    friction = body.friction
    assert friction is not None
    if scalar.is_symbolic(friction.viscous) or friction.viscous != 0:
        key = f"friction.{units.key('viscous', 'damping')}"
        yield "the viscous friction", key, _in_part("friction", _scaled("viscous")), ""
    law = LAWS[friction.law]
    for name, place, scaled in law.step_limits:
        own = law.own[place]
        key = f"friction.{units.key(own.stem, own.dimension)}"
        yield name, key, _in_part("friction", _scaled_law_parameter(scaled)), ""
    if not law.step_limits and friction.is_dry:
        smoothed = friction.smoothing is not None
        key = smoothing_key(body) if smoothed else f"friction.{units.key('stribeck_speed', 'speed')}"
        levels = _scaled("coulomb_positive", "coulomb_negative", "stribeck")
        yield "the dry friction", key, _in_part("friction", levels), UNSMOOTHED if smoothed else ""


def _in_tuple(name: str, i: int, change: Change) -> Callable[[Model, Scalar], Model]:
    def changed(model: Model, w: Scalar) -> Model:
        parts: Sequence[Any] = getattr(model, name)
        return replace(model, **{name: (*parts[:i], change(parts[i], w), *parts[i + 1 :])})

    return changed


def _in_part(name: str, change: Change) -> Change:
    return lambda whole, w: replace(whole, **{name: change(getattr(whole, name), w)})


def _scaled(*names: str, inverse: Sequence[str] = ()) -> Change:
    """Some numbers multiplied by the factor, others divided by it; absent ones stay so."""

    def changed(part: Any, w: Scalar) -> Any:
        found = {name: getattr(part, name) for name in (*names, *inverse)}
        times = {name: 1.0 / w if name in inverse else w for name in found}
        return replace(part, **{name: _times(value, times[name]) for name, value in found.items() if value is not None})

    return changed


def _times(value: Any, w: Scalar) -> Any:
    return tuple(v * w for v in value) if isinstance(value, tuple) else value * w


def _scaled_law_parameter(place: int) -> Change:
    def changed(friction: Any, w: Scalar) -> Any:
        parameters = list(friction.parameters)
        parameters[place] = parameters[place] * w
        return replace(friction, parameters=tuple(parameters))

    return changed


def _less_gear_loss(body: Body, w: Scalar) -> Body:
    def less(efficiency: Any) -> Any:
        if isinstance(efficiency, EfficiencyTable):
            rows = {name: tuple(map(less, getattr(efficiency, name))) for name in ("driving", "driven_back")}
            return replace(efficiency, **rows)
        return tuple(map(less, efficiency)) if isinstance(efficiency, tuple) else 1.0 - (1.0 - efficiency) * w

    if body.drive.efficiency is not None:
        body = replace(body, drive=replace(body.drive, efficiency=less(body.drive.efficiency)))
    if body.friction is not None and body.friction.load_coefficient is not None:
        body = replace(body, friction=_scaled("load_coefficient")(body.friction, w))
    return body


def _slower_heat(thermal: Any, w: Scalar) -> Any:
    slower = {
        name: (body[0] / w, body[1]) for name in ("winding", "housing") if (body := getattr(thermal, name)) is not None
    }
    return replace(thermal, **slower)
