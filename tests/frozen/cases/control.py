"""Controllers, tick by tick beside a motion that does not depend on them: every law, option and family of drive."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import armwright as aw
from armwright import scalar
from armwright.control.anti_windup import LimitedStage, shortfall, within
from armwright.control.commands import command_signs, torque_commands
from armwright.control.filters import sampled
from armwright.control.gains import gain_units, per_joint, positive_limit
from armwright.interfaces import JointReference, Measurement
from armwright.parameters import lane_values
from physics.arms import arm
from simulation.plants import COULOMB, MANY, MOTOR, chain, pendulum

PERIOD, TICKS = 2e-3, 12
SERVOED = "so101"
TWO_DRIVES = chain(  # a voltage that turns its joint backward, and a current
    [
        {"command": "voltage", "motor": {**MOTOR, "gear_ratio": -50.0, "inductance_h": 1e-3}, "friction": COULOMB},
        {"command": "current", "motor": {**MOTOR, "gear_ratio": -30.0}, "friction": COULOMB},
    ]
)
VOLTS = pendulum(motor={**MOTOR, "gear_ratio": -50.0, "inductance_h": 1e-3}, friction=COULOMB)


def wave(n: int, t: float, phase: float, scale: float = 0.3) -> np.ndarray:
    """(n,) numbers that no joint shares, over time."""
    return scale * np.sin(9.0 * t + phase + 1.7 * np.arange(n))


def measured(n: int, t: float, applied: np.ndarray) -> Measurement:
    """What is measured of a swing, whatever is commanded."""
    return Measurement(wave(n, t, 0.3), wave(n, t, 1.1, 2.0), wave(n, t, 2.0, 1.5), applied)


def driven(law: Any, model: Any = "two-link", least: float = 0.6, ticks: int = TICKS) -> dict[str, Any]:
    """Commands of a controller, and its last state; drives do no more than `least` of the first command's largest."""
    model = arm(model) if isinstance(model, str) else model
    n, late, given = model.n, int(getattr(law, "delay_ticks", 0) or 0), []
    law = law.configure(model, PERIOD)
    applied = wave(n, 0.0, 0.7, 4.0)
    state = law.init(model, measured(n, 0.0, applied))
    for k in range(ticks):
        t = k * PERIOD * 20.0  # the reference is far from what is measured, now on this side, now on that
        reference = JointReference(wave(n, t, 1.9, 0.5), wave(n, t, 2.6, 3.0), wave(n, t, 0.2, 9.0))
        command, state = law.step(t, reference, measured(n, t, applied), state)
        given.append(np.array(command, dtype=float))
        most = least * np.abs(given[0]).max()
        applied = np.clip(given[max(k - late, 0)], -most, most)
    return {"commands": np.array(given), "state": np.array(state, dtype=float)}


def stage(rule: str, **options: Any) -> Any:
    """A limited stage whose joints are cut off above, below and not, whose errors change their sense."""
    tracking = 0.03 if rule == "back-calculation" else None
    each = LimitedStage(np.array([9.0, 4.0, 2.0, 7.0]), np.array([50.0, 30.0, 20.0, 10.0]), np.array([1.0, 2.0, 1e9, 0.5]),
                        PERIOD, rule, tracking)  # fmt: skip
    integral = np.array([0.4, -3.0, 0.3, -4.0])
    return [each.step(way * np.array([0.5, -0.2, 0.3, 0.4]), integral, **options) for way in (1.0, -1.0, 0.0)]


AHEAD = {"ahead": np.array([0.0, 1.0, 1.0, -1.0])}
MISSING = {"missing": np.array([0.0, 0.3, -0.2, 0.1]), "feedforward": np.array([0.1, 0.2, -0.3, 0.4])}

PID = aw.JointPID(kp=[90.0, 40.0], ki=[300.0, 150.0], kd=[12.0, 6.0])
LIMITED = replace(PID, limit=[9.0, 5.0])
CASCADE = aw.Cascade(position_kp=[15.0, 12.0], speed_kp=[8.0, 5.0], speed_ki=[20.0, 30.0])
CURRENT = aw.Cascade(20.0, 3.0, 30.0, current_kp=4.0, current_ki=900.0)  # position, speed and current


def pd(t: Any, r: JointReference, y: Measurement) -> Any:
    """A function without memory, which sees the drives' feedback."""
    return scalar.array(30.0 * (r.q - y.q) + 2.0 * (r.qd - y.qd) + 0.1 * y.applied)


LAWS = {
    "PD": aw.JointPID(kp=90.0, kd=12.0),
    "PID": PID,
    "PID, damped by the measurement": replace(PID, derivative="measurement"),
    "PID with a filtered speed": replace(PID, cutoff_hz=80.0),
    "PID with feed-forward": replace(PID, speed_feedforward=[3.0, 2.0], acceleration_feedforward=[0.4, 0.2]),
    "PID with gravity": replace(PID, gravity=True),
    "PID with another arm's gravity": replace(PID, gravity=True, model=arm("two-link").replace(gravity=[1.0, 2.0, -5.0])),
    "PID, limited": LIMITED,
    "PID, clamping": replace(LIMITED, anti_windup="clamping"),
    "PID, back-calculation": replace(LIMITED, anti_windup="back-calculation", tracking_time=0.05),
    "PID, delayed": replace(PID, anti_windup="back-calculation", tracking_time=0.05, delay_ticks=2),
    "PID, delayed, filtered": replace(PID, anti_windup="clamping", cutoff_hz=50.0, delay_ticks=1),
    "PID with slack": replace(PID, anti_windup="back-calculation", tracking_time=0.05, slack=[6.0, 1.0]),
    "cascade": CASCADE,
    "cascade with the reference's speed": replace(CASCADE, speed_feedforward=[1.0, 0.7]),
    "cascade, limited": replace(CASCADE, speed_limit=[2.0, 3.0], effort_limit=[12.0, 9.0]),
    "cascade, no anti-windup": replace(CASCADE, effort_limit=12.0, anti_windup="none"),
    "cascade, back-calculation": replace(CASCADE, effort_limit=12.0, anti_windup="back-calculation", tracking_time=0.04),
    "cascade, delayed, with slack": replace(CASCADE, delay_ticks=2, slack=[0.5, 3.0]),
    "cascade of several rates": replace(CASCADE, position_every=4, speed_every=2, position_phase=3, speed_phase=1),
    "cascade of a slow position": replace(CASCADE, position_every=3),
    "computed torque": aw.ComputedTorque(kp=[400.0, 300.0], kd=[40.0, 30.0]),
    "computed torque, integrating": aw.ComputedTorque(kp=400.0, kd=40.0, ki=[900.0, 500.0]),
    "computed torque of another arm": aw.ComputedTorque(400.0, 40.0, model=arm("two-link").replace(gravity=[0.0, 0.0, 0.0])),
    "observer": aw.DisturbanceObserver(PID, inertia=[9.7, 0.85], hz=10.0),
    "observer of a delayed law": aw.DisturbanceObserver(replace(PID, delay_ticks=2, ki=9.0), inertia=2.0, hz=30.0),
    "observer of a function": aw.DisturbanceObserver(pd, inertia=2.0, hz=30.0),
    "feed-forward": aw.FeedForward(PID),
    "feed-forward of nothing": aw.FeedForward(PID, gravity=False),
    "feed-forward of each joint": aw.FeedForward(PID, inertia="joint"),
    "feed-forward of the arm": aw.FeedForward(PID, inertia="full"),
    "low-pass": aw.Filtered(PID, [aw.LowPass(50.0)]),
    "notch": aw.Filtered(PID, [aw.Notch(40.0, width_hz=10.0)]),
    "filters in series": aw.Filtered(PID, [aw.Notch(40.0, 10.0, depth=0.3), aw.LowPass(100.0, damping=1.2)]),
    "observer of a filter of an anti-windup": aw.DisturbanceObserver(
        aw.Filtered(replace(LIMITED, anti_windup="back-calculation", tracking_time=0.05), [aw.LowPass(60.0)]), 3.0, 20.0
    ),
}  # fmt: skip

COMPENSATED = aw.FrictionCompensation(
    aw.JointPID(kp=50.0, kd=3.0), dead_band=0.15, rest_speed=[0.3, 0.9, 1.6, 0.5, 0.8], share=[0.8, 1.0, 0.9, 0.7, 0.6]
)
OF_DRIVES: dict[str, tuple[Any, Any]] = {
    "PID of volts": (aw.JointPID(kp=40.0, ki=90.0, kd=3.0, gravity=True, limit=20.0), "workshop"),
    "PID of a coupled wrist": (replace(PID, kp=9.0, ki=1.0, kd=0.5, gravity=True), MANY["all"]),
    "PID of servos": (aw.JointPID(kp=0.8, kd=0.01, ki=0.3), SERVOED),
    "PID of volts and amperes": (replace(PID, gravity=True, anti_windup="clamping", limit=30.0), TWO_DRIVES),
    "cascade of volts and amperes": (replace(CASCADE, effort_limit=30.0), TWO_DRIVES),
    "cascade of servos": (aw.Cascade(position_kp=3.0, speed_kp=0.2, speed_ki=0.1), SERVOED),
    "current loop": (CURRENT, VOLTS),
    "current loop, limited": (replace(CURRENT, effort_limit=8.0, voltage_limit=24.0, speed_limit=4.0), VOLTS),
    "current loop, limited, back-calculation": (
        replace(CURRENT, effort_limit=8.0, voltage_limit=24.0, anti_windup="back-calculation", tracking_time=0.02), VOLTS,
    ),
    "current loop of several rates": (replace(CURRENT, position_every=4, speed_every=2, voltage_limit=30.0), VOLTS),
    "computed torque of volts": (aw.ComputedTorque(kp=100.0, kd=20.0, ki=5.0), "workshop"),
    "computed torque of a coupled wrist": (aw.ComputedTorque(kp=100.0, kd=20.0), MANY["all"]),
    "computed torque of servos": (aw.ComputedTorque(kp=100.0, kd=20.0), SERVOED),
    "observer of volts": (aw.DisturbanceObserver(aw.JointPID(kp=40.0), inertia=[1.0, 9.0, 2.0, 1.5, 0.5], hz=15.0), "workshop"),
    "observer of a coupled wrist": (aw.DisturbanceObserver(aw.JointPID(kp=40.0), inertia=[1.0, 2.0], hz=15.0), MANY["all"]),
    "feed-forward of friction": (aw.FeedForward(aw.JointPID(kp=9.0), friction=True), "workshop"),
    "feed-forward of friction alone": (aw.FeedForward(aw.JointPID(kp=9.0), gravity=False, friction=True), "workshop"),
    "feed-forward of springs": (aw.FeedForward(aw.JointPID(kp=9.0)), "sprung"),
    "feed-forward without springs": (aw.FeedForward(aw.JointPID(kp=9.0), gravity=False, inertia="full"), "sprung"),
    "feed-forward of each joint's inertia": (aw.FeedForward(aw.JointPID(kp=9.0), friction=True, inertia="joint"), "workshop"),
    "feed-forward of all": (aw.FeedForward(aw.JointPID(kp=9.0), friction=True, inertia="full"), "workshop"),
    "feed-forward of servos": (aw.FeedForward(aw.JointPID(kp=1.0), friction=True, inertia="joint"), SERVOED),
    "friction compensated": (COMPENSATED, "workshop"),
    "friction compensated without a dead band": (replace(COMPENSATED, dead_band=0.0, share=1.2), "rough"),
    "friction of servos compensated": (aw.FrictionCompensation(aw.JointPID(kp=1.0), 0.1, 0.5, 0.7), SERVOED),
    "friction of a coupled wrist compensated": (aw.FrictionCompensation(aw.JointPID(kp=1.0), 0.1, 0.5), MANY["all"]),
}  # fmt: skip


def units(_: Any) -> dict[str, Any]:
    """Units of gains in words, of drives and joints of all kinds."""
    laws = (PID, CASCADE, CURRENT, aw.ComputedTorque(1.0, 1.0))
    models = (arm("workshop"), arm("two-link"), arm("lwa4p"), TWO_DRIVES)
    return {
        f"{type(law).__name__}{k} {model.name} {name}": gain_units(model, law, name)
        for k, law in enumerate(laws)
        for model in models
        for name in (*law.gain_units, "slack")
    }


def gains(_: Any) -> list[Any]:
    """Gains of one number, of several, of lanes; limits that are there and not."""
    one = arm("two-link")
    given = [3.0, [1.0, 2.0], 0.0, aw.Batch([1.0, 2.0, 3.0]), aw.Batch([[1.0, 2.0], [3.0, 4.0]])]
    limits = [positive_limit(one, "law", "limit", value) for value in (None, 5.0, [1.0, np.inf], aw.Batch([1.0, 2.0]))]
    return [np.array(lane_values(each)) for each in (*(per_joint(one, "law", "kp", value) for value in given), *limits)]


def feedback(_: Any) -> list[np.ndarray]:
    """What drives missed, with slack and rounding; values within limits that are finite or not."""
    applied, asked = np.array([1.0, 2.0, -3.0, 4e3, 0.5]), np.array([1.5, 2.1, -2.0, 4e3 + 3e-3, 0.5])
    slack = np.array([0.1, 0.2, 0.3, 0.0, 0.0])
    limit = np.array([0.9, np.inf, 2.5, 1.0, 0.5])
    further = shortfall(applied, asked + 2e-2 * np.sign(asked), 0.0 * slack)
    return [shortfall(applied, asked, slack), further, within(applied, limit), within(-applied, limit)]


def commands(_: Any) -> dict[str, Any]:
    """Commands of torques at speeds, and signs of all drives."""
    models = {name: arm(name) for name in ("two-link", "puma560", "cmu-dd", "lwa4p", SERVOED, "workshop")}
    models |= {"coupled": MANY["all"], "volts and amperes": TWO_DRIVES}
    given = {
        name: torque_commands(model, wave(model.n, 0.2, 0.5), wave(model.n, 0.1, 1.0, 20.0))
        for name, model in models.items()
    }
    found = {name: np.array(value, dtype=float) for name, value in given.items()}
    return found | {f"signs of {name}": command_signs(model) for name, model in models.items()}


RULES = ("none", "clamping", "back-calculation")
BESIDE = {"behind another": AHEAD, "of a drive that misses": MISSING, "of both": AHEAD | MISSING}

CASES = {
    **{f"stage {rule}": lambda _, rule=rule: stage(rule) for rule in RULES},
    **{
        f"stage {rule} {name}": lambda _, rule=rule, more=more: stage(rule, **more)
        for rule in RULES
        for name, more in BESIDE.items()
    },
    **{name: lambda _, law=law: driven(law) for name, law in LAWS.items()},
    **{name: lambda _, law=law, model=model: driven(law, model) for name, (law, model) in OF_DRIVES.items()},
    "drives that do all": lambda _: driven(replace(PID, anti_windup="clamping"), least=1e3),
    "filters' coefficients": lambda _: [
        sampled(each, PERIOD) for each in (aw.LowPass(20.0), aw.LowPass(200.0, 0.3), aw.Notch(30.0, 8.0, 0.2))
    ],
    "units of gains": units,
    "gains": gains,
    "feedback": feedback,
    "commands of torques": commands,
}
