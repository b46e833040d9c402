"""Designed gains and what limits them, linear models of arms, and controllers compared on the same motions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.comparison import measures
from armwright.control.comparison.compare import command_limits
from armwright.control.design.designer import Designer, current_gains
from armwright.control.design.joint_plants import JointPlants
from armwright.control.design.rest_errors import rest_errors, rest_sentences
from armwright.control.design.rules import RULES, DesignTask
from armwright.model.drive import Friction
from frozen.cases.control_loops import answers
from frozen.numbers import Case
from physics.arms import arm
from simulation.plants import COULOMB, ELASTIC, MANY, MOTOR, chain, pendulum

PID = aw.JointPID(kp=100.0, ki=50.0, kd=10.0, gravity=True)
PD = replace(PID, ki=0.0)
CASCADE = aw.Cascade(position_kp=5.0, speed_kp=10.0, speed_ki=20.0)
TORQUE = aw.ComputedTorque(kp=100.0, kd=10.0)
CURRENT = aw.Cascade(5.0, 10.0, 20.0, current_kp=1.0)
FEW = {"poses": 12, "seed": 2}
LIMITS = {"torque_n_m": 60.0, "current_a": 9.0, "voltage_v": 36.0}
WINDING = {**MOTOR, "inductance_h": 1e-3}
SOFT = chain(
    [
        {"command": "voltage", "motor": WINDING, "friction": COULOMB, "elasticity": ELASTIC, "limits": LIMITS},
        {"command": "current", "motor": {**MOTOR, "gear_ratio": -30.0}, "friction": COULOMB, "limits": LIMITS},
    ]
)
VOLTS = pendulum(motor=WINDING, friction=COULOMB, limits=LIMITS)


def scenario(law: Any, model: Any = "two-link", period: float = 1e-3, **loop: Any) -> aw.Scenario:
    """A loop whose commands act a tick later, unless it has a timing of its own."""
    given = {"timing": aw.Timing("one-tick"), **loop}
    return aw.Scenario(model, duration=100 * period, loop=aw.Loop(law, period=period, **given))


def designed(
    law: Any, model: Any = "two-link", method: str | None = None, loop: Any = None, **asked: Any
) -> dict[str, Any]:
    """A design in numbers and words, without what it was made for."""
    found = aw.loops.design_gains(scenario(law, model, **(loop or {})), method, **(FEW | asked))
    left_out = {"scenario", "notes"}
    return {name: each for name, each in vars(found).items() if name not in left_out} | {
        "words": found.sentences(),
        "rows": found.tables()[0].rows(),
        "repr": repr(found),
    }


SENSORS = aw.Sensors(velocity="filtered", cutoff_hz=80.0)
DESIGNS: dict[str, tuple[Any, ...]] = {
    **{f"{kind} by {method}": (law, "two-link", method)
       for kind, law in (("PID", PID), ("PD", PD)) for method in RULES if law is PID or method != "lqr"},
    "cascade": (CASCADE,),
    "cascade without an integral": (replace(CASCADE, speed_ki=0.0),),
    "cascade by loop shaping": (CASCADE, "two-link", "loop-shaping"),
    "cascade of a filtered speed": (CASCADE, "two-link", None, {"sensors": SENSORS}),
    "cascade of an observed speed": (CASCADE, "two-link", "loop-shaping", {"sensors": replace(SENSORS, velocity="observer")}),
    "cascade of slow speed": (replace(CASCADE, speed_every=2, position_every=4),),
    "computed torque": (TORQUE,),
    "computed torque, integrating": (replace(TORQUE, ki=1.0),),
    "within others": (aw.FeedForward(aw.Filtered(PD, [aw.LowPass(200.0)]), gravity=True),),
    "without weight compensated": (replace(PD, gravity=False),),
    "soft gear": (replace(CASCADE, speed_ki=0.0), SOFT),
    "current loop": (CURRENT, VOLTS, None, {"period": 2.5e-4}),
    "springs": (PID, MANY["springs"], "pole-placement"),
}  # fmt: skip
STATED = {
    "stated bandwidth": {"bandwidth": [20.0, 40.0]},
    "stated bandwidth of all": {"bandwidth": 25.0, "damping": 0.7},
    "stated bandwidth without margins": {"bandwidth": 300.0, "gain_margin": 3.0},
    "margins": {"gain_margin": 3.0, "phase_margin": 0.9, "damping": 0.8},
}


def limits(law: Any, model: Any, **loop: Any) -> list[Any]:
    """What limits the joints of a design, in numbers and words."""
    found = aw.loops.design_gains(scenario(law, model, **loop), **FEW).limits
    return [[each, each.slow, str(each)] for each in found]


LIMITED: dict[str, tuple[Any, Any, dict[str, Any]]] = {
    "delay and encoder": (CASCADE, "two-link", {"sensors": SENSORS, "period": 2e-3}),
    "soft gear": (PD, SOFT, {"timing": aw.Timing(command_delay=0.4e-3)}),
    "current loop": (CURRENT, VOLTS, {"period": 2.5e-4}),
    "volts": (PD, VOLTS, {"period": 2e-3, "timing": aw.Timing()}),
}


def rules(_: Path) -> dict[str, Any]:
    """Every rule at bandwidths from slow to fast, with and without an integral, for joints with and without damping."""
    found: dict[str, Any] = {}
    for name, model in (("two-link", arm("two-link")), ("damped", SOFT)):
        law = scenario(CASCADE, model, sensors=SENSORS)
        joints = JointPlants.of(LinearLoop(law), CASCADE, 12, 2)
        found[f"{name}, plants"] = [joints, joints.worst, joints.largest[0]]
        bandwidth = np.array([2.0, 15.0, 60.0])[:, None] * np.ones(model.n)
        for rule, function in RULES.items():
            for integral in (True, False):
                task = DesignTask(model, joints, 0.9, integral, 1e-3, 1.2e-3)
                found[f"{name}, {rule}, {integral}"] = function(task, bandwidth)
    return found


def refusals(_: Path) -> list[str]:
    """Periods and delays that a refusal proposes."""
    late = {"timing": aw.Timing(command_delay=4e-3)}
    said = []
    for law, loop, phase in ((PD, {}, 1.4), (CASCADE, late, 1.35), (TORQUE, {"timing": aw.Timing()}, 1.55)):
        try:
            aw.loops.design_gains(scenario(law, period=4e-3, **loop), phase_margin=phase, gain_margin=4.0, poses=2)
            said.append("designed")
        except aw.ArmwrightError as error:
            said.append(str(error))
    return said


def rests(_: Path) -> dict[str, Any]:
    """Errors at rest by friction and weight, of laws that compensate and do not, and of drives of all kinds."""
    rubbing = [Friction(0.1, 2.0, 3.0), Friction(0.1, 1.0, 0.5, stribeck=4.0, stribeck_speed=0.1)]
    own = arm("two-link")
    own = replace(
        own, bodies=tuple(replace(body, friction=each) for body, each in zip(own.bodies, rubbing, strict=True))
    )
    poses, stiffness = np.array([[0.4, -0.7], [0.0, 0.2], [-1.5, 1.0]]), np.array([300.0, 90.0])
    laws = {
        "pd": PD,
        "weight": replace(PD, gravity=False),
        "torque": TORQUE,
        "wrapped": aw.FeedForward(replace(PD, gravity=False)),
    }
    inner = {"torque": TORQUE, "wrapped": replace(PD, gravity=False)}
    found = {name: rest_errors(own, law, inner.get(name, law), stiffness, poses) for name, law in laws.items()}
    found["volts"] = rest_errors(SOFT, CASCADE, CASCADE, stiffness, poses)
    found["current"] = rest_errors(VOLTS, CURRENT, CURRENT, stiffness[:1], poses[:, :1])
    words = [rest_sentences(own, *each) for each in (*found.values(), np.zeros((2, 2))) if len(each[0]) == 2]
    return found | {"words": words}


def currents(_: Path) -> list[Any]:
    """Gains of current loops at two periods and delays."""
    late = {"timing": aw.Timing(command_delay=1e-4), "period": 2.5e-4}
    return [current_gains(scenario(CURRENT, VOLTS)), current_gains(scenario(CURRENT, VOLTS, **late), 1e-4)]


def designer(_: Path) -> dict[str, Any]:
    """Bandwidths alone and together, from given ones on, and the margins that single ones keep."""
    found: dict[str, Any] = {}
    for name, law, method in (
        ("pid", PID, "pole-placement"),
        ("cascade", CASCADE, "symmetric-optimum"),
    ):
        one = Designer.of(scenario(law, period=4e-3), law, method, 1.0, (8, 1), (2.0, 0.6))
        grid = np.geomspace(1.0, 0.05, 6)[:, None] * one.highest
        found[name] = {
            "highest": one.highest, "alone": one.alone(), "together": one.together(one.highest),
            "from": one.alone(0.2 * one.highest), "stiffness": one.stiffness(grid), "keeping": one.keeping(grid),
            "elbow": one.keeping(grid, 1),
        }  # fmt: skip
    return found


def models(_: Path) -> dict[str, Any]:
    """Linear models of arms with drives: continuous, sampled, late, of all kinds of states."""
    of = aw.loops.state_space
    return {
        "torques": answers(of("two-link", [0.4, -0.7])),
        "at zero": answers(of("two-link")),
        "sampled": answers(of("two-link", [0.4, -0.7], period=1e-2)),
        "late": answers(of("two-link", [0.4, -0.7], period=1e-2, delay=1.4e-2)),
        "soft": answers(of(SOFT, [0.2, 0.3])),
        "all": answers(of(MANY["all"], [0.2, 0.3], period=1e-3)),
    }


# --- comparison -------------------------------------------------------------------------------------------------------

T = np.linspace(0.0, 2.0, 61)


def path_of(height: float = 0.0, late: float = 0.0) -> np.ndarray:
    """(61, 3) an eight that dwells in the middle, at another height and later."""
    angle = np.pi * np.clip(np.where(T - late > 1.0, T - late - 0.2, np.minimum(T - late, 0.8)), 0.0, 1.6)
    return np.stack([0.3 * np.cos(angle), 0.2 * np.sin(2.0 * angle), 0.1 + height * np.sin(3.0 * angle)], axis=-1)


def tool(_: Path) -> dict[str, Any]:
    """Path, crossings and errors of some runs, one of which stops short and comes back."""
    path = measures.tool_path(T, path_of(), 23)
    assert path is not None
    short = np.where(T[:, None] > 1.3, path_of()[40], path_of(2e-3))
    runs = np.array([path_of(1e-3, 0.02), path_of(-3e-3, 0.05), short])
    attained = measures.attained_points(path, T, runs)
    there = 0.3 * np.sin(np.pi * T)[:, None] * np.array([1.0, 0.0, 0.5])
    back = measures.tool_path(T, there, 15)
    assert back is not None
    turned = measures.attained_points(back, T, np.array([0.93 * there + [0.0, 2e-3, 0.0], there[::-1] * 0.5]))
    several, single = measures.path_errors(path, attained), measures.path_errors(path, attained[:1])
    return {"path": path, "attained": attained, "errors": [several, single], "turned": turned}


def settling(_: Path) -> dict[str, Any]:
    """Settling, overshoot and last directions of joints that swing, creep, stay away and rest."""
    ways = [
        0.5 * np.exp(-4.0 * T) * np.cos(9.0 * T),
        0.2 * np.exp(-2.0 * T),
        0.3 + 0.0 * T,
        0.0 * T,
        np.where(T > 1.99, 0.1, 0.0),
    ]
    error = np.stack(ways, axis=-1)
    both, band = np.array([error, -0.5 * error]), np.array([0.01, 0.02, 0.01, 0.01, 0.05])
    speeds = np.stack(
        [np.sin(4.0 * T), np.where(T < 1.0, -T, 0.0), 0.0 * T, 1e-12 * T, np.where(T < 0.5, 0.2, 1e-10)], axis=-1
    )
    return {
        "settled": [measures.settling_time(T, both, end, band) for end in (0.0, 0.7, 2.0)],
        "over": measures.overshoot(both + 1.0, np.full(5, 1.1), np.array([1.0, -1.0, 1.0, 0.0, -1.0])),
        "directions": measures.last_direction(speeds),
    }


HAND = {"tip": "hand", "frames": [{"name": "hand", "link": "rod1", "xyz_m": [0.5, 0.0, 0.1], "rpy_rad": [0, 0, 0]}]}
LIMITED_ARM = chain(
    [
        {"command": "torque", "motor": MOTOR, "friction": COULOMB, "limits": LIMITS},
        {"command": "current", "motor": MOTOR, "friction": COULOMB, "limits": LIMITS},
    ],
    robot=HAND,
)


def compared(_: Path) -> dict[str, Any]:
    """Laws on two motions with two payloads: noise, drives at their limits, one that runs away, one that is unstable."""
    pd = aw.JointPID(kp=[900.0, 60.0], kd=[90.0, 6.0], gravity=True)
    laws = {"pd": pd, "model": aw.FeedForward(pd, friction=True, inertia="full"), "wild": replace(pd, kp=1e7),
            "unstable": replace(pd, kd=[90.0, 1e3])}  # fmt: skip
    motions = {
        "move": aw.trajectories.Quintic([0.0, 0.2], [0.6, -0.5], 0.3),
        "ramp": aw.trajectories.Ramp([0.3, 0.0], [-1.5, 0.0], 0.2),
    }
    sensors = aw.Sensors(position_noise=1e-4, velocity_noise=1e-3)
    base = aw.Scenario(LIMITED_ARM, 0.5, loop=aw.Loop(pd, period=2e-3, sensors=sensors), seed=4)
    hands = {"nothing": None, "load": aw.Payload(0.0, 1.5, [0.0, 0.0, 0.1])}
    found = aw.loops.compare_controllers(
        base, laws, motions, hands, runs=3, band=[2e-2, 5e-2], settle=0.15, progress=False
    )
    rows = [table.rows() for table in found.tables()]
    return {"data": found.data, "rows": rows, "notes": found.sentences(), "height": found.height, "band": found.band}


CASES = {
    **{f"design of {name}": Case(lambda _, each=each: designed(*each), close=1e-5) for name, each in DESIGNS.items()},
    **{f"design with {name}": lambda _, more=more: designed(PID, **more) for name, more in STATED.items()},
    **{f"limits by {name}": Case(lambda _, each=each: limits(each[0], each[1], **each[2]), close=1e-5)
       for name, each in LIMITED.items()},
    "rules": Case(rules, close=1e-5),
    "refused designs": refusals,
    "errors at rest": rests,
    "current loops": currents,
    "designer": Case(designer, close=1e-5),
    "linear models": models,
    "limits of commands": lambda _: {name: command_limits(arm(name)) for name in ("two-link", "cmu-dd", "lwa4p", "so101")},
    "limits of commands by motors": lambda _: command_limits(SOFT),
    "path of a tool": tool,
    "settling": settling,
    "comparison": Case(compared, close=1e-4, study=True),
}  # fmt: skip
