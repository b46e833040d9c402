"""Features of robot files and scenarios, and how each consumer of arms and scenarios treats them.

A consumer is a function or command that takes an arm or a scenario. Every feature is to it one of four things:

    exact            counted in full
    approximated     counted in another way, or left out: its notes say how
    without effect   absent from what it computes, by definition: the answer has the same bits with and without
    refused          an error names the feature before anything is computed

A consumer declares, in its own file, a `Support` with all that is not exact. Its notes are made from that, and so are the page
*What works with what* and the tests that hold every pair against it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from armwright.errors import ModelError
from armwright.friction_laws import LAWS

Outcome = Literal["exact", "approximated", "without effect", "refused"]


@dataclass(frozen=True)
class Feature:
    """An optional part of a robot file or a scenario that changes motion, torque or commands.

    Attributes:
        key: its place in the file; refusals name the last part of it.   about: words by which notes call it.
        where: arm or scenario → names of the joints, or of other parts, that have it.
    """

    key: str
    about: str
    where: Callable[[Any], Iterable[str]]


def _joints(has: Callable[[Any], bool]) -> Callable[[Any], list[str]]:
    """Names of the joints whose body has something."""
    return lambda arm: [body.joint for body in arm.bodies if has(body)]


def _motors(name: str) -> Callable[[Any], list[str]]:
    """Names of the joints whose drive has a field that is neither None, False nor empty."""
    return _joints(lambda body: getattr(body.drive, name) not in (None, False, ()))


def _friction(key: str, about: str, has: Callable[[Any], bool]) -> Feature:
    """A feature of the joints whose friction has something; its key in the table of friction."""
    return Feature(
        f"joints.friction.{key}", about, _joints(lambda body: body.friction is not None and has(body.friction))
    )


def _elasticities(name: str) -> Callable[[Any], list[str]]:
    return _joints(lambda body: body.elasticity is not None and getattr(body.elasticity, name) is not None)


def _by_temperature(friction: Any) -> bool:
    slopes = ("viscous_fall", "viscous_temperature_coefficient", "coulomb_temperature_coefficient")
    return any(getattr(friction, name) is not None for name in slopes)


def _is_smoothed(friction: Any) -> bool:
    return friction.is_dry and LAWS[friction.law].sticks and not friction.sticks


def _by_direction(friction: Any) -> bool:
    positive, negative = friction.coulomb_positive, friction.coulomb_negative
    return positive is not negative and bool(positive != negative)


def _branching(arm: Any) -> list[str]:
    """Names of the joints on a body that carries several."""
    parents = [body.parent for body in arm.bodies]
    return [body.joint for body in arm.bodies if parents.count(body.parent) > 1]


def _mimicking(arm: Any) -> list[str]:
    """Names of the joints that follow others."""
    own = set(arm.names)
    return [body.joint for body in arm.bodies if body.joint not in own]


def _is_table(efficiency: Any) -> bool:
    return hasattr(efficiency, "torques")


def _of_laws() -> dict[str, Feature]:
    """A feature for every friction law that has one."""
    return {
        law.feature: _friction("law", f"friction law {name}", lambda friction, name=name: friction.law == name)
        for name, law in LAWS.items()
        if law.feature
    }


ARM = {
    "screw joints": Feature(
        "joints.pitch_m_per_rad", "helical joints", _joints(lambda body: body.kind.turns and body.kind.slides)
    ),
    "branches": Feature("joints.parent", "branches", _branching),
    "mimic joints": Feature("joints.mimic", "joints that follow others", _mimicking),
    "payload": Feature("with_payload", "a payload of the record", lambda arm: ()),
    "locked joints": Feature("with_locked", "locked joints", lambda arm: ()),
    "coupled motors": Feature("joints.motor.coupling", "motors that several joints turn", _motors("coupling")),
    "gear efficiency": Feature(
        "joints.motor.gear_efficiency",
        "gear efficiency",
        _joints(lambda body: body.drive.efficiency is not None and not _is_table(body.drive.efficiency)),
    ),
    "efficiency table": Feature(
        "joints.motor.gear_efficiency_table",
        "gear efficiency by load",
        _joints(lambda body: _is_table(body.drive.efficiency)),
    ),
    "load coefficient": _friction(
        "load_coefficient", "friction by load", lambda each: each.load_coefficient is not None
    ),
    "dry friction": _friction("coulomb_positive_n_m", "dry friction", lambda each: each.sticks),
    "smoothed friction": _friction("smoothing_rad_per_s", "dry friction with a smoothing speed", _is_smoothed),
    "friction by direction": _friction("coulomb_negative_n_m", "friction by direction", _by_direction),
    "friction offset": _friction("offset_n_m", "friction offset", lambda each: each.offset != 0.0),
    "Stribeck friction": _friction("stribeck_torque_n_m", "Stribeck friction", lambda each: each.stribeck is not None),
    **_of_laws(),
    "motor-side friction": _friction("side", "friction of the motor", lambda each: each.on_motor),
    "friction by temperature": _friction("viscous_fall_k", "friction by temperature", _by_temperature),
    "springs": Feature("joints.spring", "springs", _joints(lambda body: body.spring is not None)),
    "cylinders": Feature("cylinders", "cylinders", lambda arm: [each.name for each in arm.cylinders]),
    "elasticity": Feature("joints.elasticity", "elastic gears", _joints(lambda body: body.elasticity is not None)),
    "play": Feature("joints.elasticity.backlash_rad", "play", _elasticities("backlash")),
    "kinematic error": Feature("joints.elasticity.error_rad", "kinematic error", _elasticities("error")),
    "stops": Feature("joints.stops", "stops", _joints(lambda body: body.stops is not None)),
    "brakes": Feature("joints.brake", "brakes", _joints(lambda body: body.brake is not None)),
    "cogging": Feature("joints.motor.cogging", "cogging", _motors("cogging")),
    "heat": Feature("joints.motor.thermal", "heat of the motor", _motors("thermal")),
    "inductance": Feature("joints.motor.inductance_h", "inductance", _motors("inductance")),
    "current loop": Feature("joints.motor.current_loop_hz", "bandwidth of the current loop", _motors("current_loop")),
    "coasting": Feature("joints.motor.pwm", "coasting PWM", _motors("coasts")),
    "dead zone": Feature("joints.motor.dead_zone_v", "dead zone", _motors("dead_zone")),
    "servo": Feature("joints.firmware", "servos' firmware", _motors("firmware")),
    "servo counts": Feature(
        "joints.firmware.counts_per_turn",
        "counts of servos",
        _joints(lambda body: body.drive.firmware is not None and body.drive.firmware.count is not None),
    ),
    "supply": Feature("supply", "supply", lambda arm: [] if arm.supply is None else ["supply"]),
}


def _reference(about: str, has: Callable[[Any], bool]) -> Feature:
    """A feature of loops whose reference has something."""
    place = "loop.reference"
    return Feature(place, about, lambda each: [place] if each.loop is not None and has(each.loop.reference) else [])


def _set(part: str, *names: str) -> Callable[[Any], list[str]]:
    """Places of the fields of a scenario's part that are neither absent nor 0."""
    return lambda scenario: [f"{part}.{name}" for name in names if _is_set(_part(scenario, part), name)]


def _part(scenario: Any, part: str) -> Any:
    """A part of a scenario by its path; None without a loop."""
    *outer, name = part.split(".")
    for each in outer:
        scenario = getattr(scenario, each)
    return None if scenario is None else getattr(scenario, "joint_sensors" if name == "sensors" else name)


def _is_set(part: Any, name: str) -> bool:
    value = getattr(part, name, None)
    values = getattr(value, "values", value)  # of a batch
    return values is not None and not (isinstance(values, (int, float)) and values == 0)


def _is_pose(reference: Any) -> bool:
    if isinstance(reference, (list, tuple)):
        return not any(isinstance(each, (list, tuple)) for each in reference)
    return getattr(reference, "ndim", 0) == 1


SCENARIO = {
    "commands over time": Feature(
        "command", "commands over time", lambda scenario: [] if scenario.command is None else ["command"]
    ),
    "pose": _reference("a pose as reference", _is_pose),
    "schedule of poses": _reference(
        "a schedule as reference", lambda each: hasattr(each, "times") and hasattr(each, "commands")
    ),
    "motion": _reference("a motion as reference", callable),
    "grips of a motion": _reference("what a motion grips", lambda each: bool(getattr(each, "payloads", ()))),
    "delays": Feature("loop.timing.command_delay", "delays", _set("loop.timing", "measurement_delay", "command_delay")),
    "jitter": Feature("loop.timing.jitter", "jitter", _set("loop.timing", "jitter")),
    "lost samples": Feature(
        "loop.timing.measurement_loss", "lost samples", _set("loop.timing", "measurement_loss", "command_loss")
    ),
    "clock drift": Feature("loop.timing.clock_drift", "clock drift", _set("loop.timing", "clock_drift")),
    "loops at several rates": Feature(
        "loop.controller.position_every",
        "loops at several rates",
        lambda each: ["loop.controller"] if getattr(each.controller, "position_every", 1) != 1 else [],
    ),
    "encoder counts": Feature("loop.sensors.counts", "encoder counts", _set("loop.sensors", "counts", "counts_per_m")),
    "sensor noise": Feature(
        "loop.sensors.position_noise",
        "noise of sensors",
        _set("loop.sensors", "position_noise", "velocity_noise", "current_noise"),
    ),
    "speed filter": Feature("loop.sensors.cutoff_hz", "a filter of speeds", _set("loop.sensors", "cutoff_hz")),
    "command filter": Feature(
        "loop.command_filter", "a command filter", _set("loop.command_filter", "rate", "limit", "resolution")
    ),
    "wrench": Feature("inputs.wrench", "wrenches", _set("inputs", "wrench")),
    "applied brakes": Feature("inputs.brake", "brakes that are applied", _set("inputs", "brake")),
    "supply over time": Feature("inputs.supply", "the supply's voltage over time", _set("inputs", "supply")),
    "servos off": Feature("inputs.enabled", "servos that are off", _set("inputs", "enabled")),
    "payloads over time": Feature("inputs.payload", "payloads over time", _set("inputs", "payload")),
    "moving start": Feature(
        "start.qd",
        "a start in motion",
        lambda scenario: ["start.qd"] if getattr(scenario.start, "qd", None) is not None else [],
    ),
    "lanes": Feature("lanes", "lanes", lambda scenario: ["lanes"] if (scenario.lane_count or 1) > 1 else []),
}
FEATURES = {**ARM, **SCENARIO}
GROUPS = {  # which a declaration may name together
    "effects of the simulator": (
        *("elasticity", "play", "kinematic error", "stops", "cogging", "heat", "friction by temperature"),
        *("inductance", "current loop", "coasting", "dead zone", "supply"),
    ),
    "servos": ("servo", "servo counts", "servos off"),
    "gear loss": ("gear efficiency", "efficiency table", "load coefficient"),
    "friction": (
        *("dry friction", "smoothed friction", "friction by direction", "friction offset", "Stribeck friction"),
        *_of_laws(),
        *("motor-side friction", "friction by temperature"),
    ),
    "all but geometry": tuple(
        name for name in ARM if name not in ("screw joints", "branches", "mimic joints", "payload", "locked joints")
    ),
}


@dataclass(frozen=True)
class Support:
    """Features that a consumer does not count exactly; all others it does.

    Attributes:
        consumer: its name, as users call it.   scenario: False if it takes an arm alone, True if a scenario as well.
        approximated: how, by feature or group.   without_effect: why, likewise.   refused: what is expected, likewise.
    """

    consumer: str
    scenario: bool = False
    approximated: Mapping[str, str] = field(default_factory=dict)
    without_effect: Mapping[str, str] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = {name for _, declared in self._declared for name in declared} - set(FEATURES) - set(GROUPS)
        assert not unknown, f"{self.consumer}: {unknown}"

    def named(self, consumer: str) -> Support:
        """The declaration for another consumer."""
        return replace(self, consumer=consumer)

    @property
    def features(self) -> dict[str, Feature]:
        """All features of what the consumer takes."""
        return FEATURES if self.scenario else ARM

    @property
    def _declared(self) -> tuple[tuple[Outcome, Mapping[str, str]], ...]:
        return ("approximated", self.approximated), ("without effect", self.without_effect), ("refused", self.refused)

    def outcome(self, feature: str) -> tuple[Outcome, str]:
        """Outcome of a feature for the consumer, with the declared words; its own go before those of its groups."""
        for name in (feature, *(group for group, features in GROUPS.items() if feature in features)):
            for outcome, declared in self._declared:
                if name in declared:
                    return outcome, declared[name]
        return "exact", ""

    def refuse(self, arm: Any, *names: str) -> None:
        """Refuses an arm with one of these features, which are declared so.

        Raises:
            ModelError: names the feature, who has it, and what is expected.
        """
        for name in names:
            feature, (outcome, expected) = FEATURES[name], self.outcome(name)
            assert outcome == "refused", name
            if found := list(feature.where(arm)):
                what = f"{self.consumer} takes no {feature.about}"
                raise ModelError(what, place=feature.key, value=", ".join(found), expected=expected, file=arm.name)

    def notes(self, arm: Any, scenario: Any = None) -> tuple[str, ...]:
        """Sentences about what the consumer approximates of an arm and a scenario, with the joints or fields that have it."""
        found: dict[str, list[str]] = {}
        for features, subject in ((ARM, arm), (SCENARIO, scenario)):
            for name, feature in features.items() if subject is not None else ():
                outcome, how = self.outcome(name)
                parts = list(feature.where(subject)) if outcome == "approximated" else []
                if parts:
                    joints = f" of {', '.join(parts)}" if subject is arm and parts != [feature.key] else ""
                    found.setdefault(how, []).append(f"{feature.about}{joints}")
        return tuple(f"{', '.join(features)}: {how}" for how, features in found.items())


INFO = Support("info")  # which shows all of an arm; its command imports nothing heavy before it runs
CONSUMERS = {  # where each declaration stands in this package, by what the consumers are for
    "Dynamics and motions": (
        *("kernels.compiled.KERNELS", "kernels.compiled.CASADI", "export.c.SUPPORT", "ik.solve.SUPPORT"),
        *("trajectory.limits_report.SUPPORT", "trajectory.time_optimal.plan.SUPPORT"),
        "identification.experiments.excitation.SUPPORT",
    ),
    "Simulation and control": (
        *("simulation.simulation.SUPPORT", "simulation.integrate.cvodes.SUPPORT", "simulation.sensitivity.SUPPORT"),
        *("sweeps.sweep.SUPPORT", "control.comparison.compare.SUPPORT", "tuning.tune.SUPPORT"),
        *("control.analysis.small_signal.SUPPORT", "control.design.design_gains.SUPPORT"),
    ),
    "Identification and validation": (
        *("identification.arm.torque_model.SUPPORT", "identification.arm.friction.SUPPORT"),
        *("identification.arm.payload.SUPPORT", "identification.motor.identify.SUPPORT"),
        *("identification.validation.validate.SUPPORT", "shadow.shadow.SUPPORT"),
    ),
    "Deployment and files": (
        *("export.controller.write.SUPPORT", "export.fmu.write.SUPPORT", "twin.on_bus.SUPPORT"),
        *("twin.serial.servo_arm.SUPPORT", "export.ros2.SUPPORT"),
        *("export.urdf.SUPPORT", "export.mjcf.SUPPORT", "robotfiles.difference.SUPPORT", "features.INFO"),
    ),
}


def declared(place: str) -> Support:
    """The declaration that stands at a place in this package."""
    module, _, name = place.rpartition(".")
    return getattr(importlib.import_module(f"armwright.{module}"), name)
