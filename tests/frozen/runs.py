"""Reference runs: short simulations that use every part of the loop, each stating its rule, step and substeps.

A run is a function without arguments that makes a Scenario. The numbers are arbitrary; their bits are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright import scalar
from armwright.control import Cascade, ComputedTorque, JointPID
from armwright.description.database import read_toml
from armwright.model import Model, build_model
from armwright.simulation.integrate.events import joint_stops
from physics.arms import arm
from simulation.fields import scenario_of
from simulation.plants import BRAKE, COULOMB, ELASTIC, MANY, MOTOR, STOPS, chain, pendulum

EXAMPLES = Path(__file__).parents[2] / "examples"
RULES = ("rk3", "rk4", "semi_implicit_euler")
COMMANDS = {
    "cmu-dd": [8.0, 12.0, 8.0, 4.0, 2.0, 1.0],
    "puma560": [6.0, -9.0, 7.0, 3.0, -2.0, 1.5],
    "lwa4p": [1.0, -2.0, 1.5, 0.5, -0.4, 0.3],
    "panda": [5.0, -20.0, 3.0, 8.0, 1.0, -1.0, 0.5],
    "two-link": [12.0, -3.0],
}
STEPS = {"lwa4p": 1e-4, "panda": 2.5e-4}  # [s] where 0.5 ms is too long
KP, KD = np.array([400.0, 150.0]), np.array([40.0, 12.0])


@cache
def scara() -> Model:
    """The example's arm: lossy gears, a ball screw, limits."""
    return build_model(read_toml(EXAMPLES / "scara.toml"))


def wave(n: int, scale: float = 0.3) -> np.ndarray:
    """(n,) positions or speeds that no joint shares."""
    return scale * np.sin(1.0 + 1.7 * np.arange(n))


def laned(count: int, n: int, scale: float = 0.3) -> np.ndarray:
    """(count, n) positions that no lane shares."""
    return scale * np.sin(1.0 + 1.7 * np.arange(n) + 0.37 * np.arange(count)[:, None])


def open_loop(name: str, rule: str, lanes: int | None = None) -> aw.Scenario:
    """Constant commands on a built-in arm."""
    model = arm(name)
    start = wave(model.n) if lanes is None else aw.Batch(laned(lanes, model.n))
    return aw.Scenario(
        model, command=COMMANDS[name], duration=0.05, start=aw.Start(start, wave(model.n, 0.5)),
        solver=aw.Solver(step=STEPS.get(name, 5e-4), integrator=rule),
    )  # fmt: skip


def chosen(name: str, solver: aw.Solver, *, smoothed: bool = True) -> aw.Scenario:
    """Lanes of a built-in arm that choose their steps; with friction that sticks unless it is smoothed."""
    model = arm(name)
    if not smoothed:
        bodies = (
            body if body.friction is None else replace(body, friction=replace(body.friction, smoothing=None))
            for body in model.bodies
        )
        model = replace(model, bodies=tuple(bodies))
    command = aw.Batch(laned(9, model.n) * 10.0)
    return aw.Scenario(model, command=command, duration=0.03, solver=solver)


def effect(name: str, rule: str = "rk3", step: float = 1e-4) -> aw.Scenario:
    """An arm with one effect of its drives, or all of them."""
    model = MANY[name]
    return aw.Scenario(
        model, command=wave(model.n, 9.0), duration=0.03, start=aw.Start(wave(model.n), wave(model.n, 1.5)),
        solver=aw.Solver(step=step, integrator=rule),
    )  # fmt: skip


GEARED = chain(
    [
        {"command": command, "motor": MOTOR, "friction": COULOMB, "limits": {"current_a": 9.0, "voltage_v": 36.0}}
        for command in ("voltage", "current")
    ]
)


def swing(t):
    """Positions of two joints at a time."""
    return scalar.array([0.3 * scalar.sin(3.0 * t), 0.1 - 0.2 * scalar.cos(4.0 * t)])


def pd(t, r, y):
    """Volts and amperes from errors of position and speed."""
    return KP * (r.q - y.q) + KD * (r.qd - y.qd)


def six(t, r, y):
    """Volts of six joints."""
    return np.array([400.0, 900, 300, 150, 30, 20]) * (r.q - y.q) - np.array([40.0, 90, 30, 12, 3, 2]) * y.qd


def stubborn(t, r, y):
    """A law that cannot be traced."""
    return np.array([float(v) for v in pd(t, r, y)])


@dataclass(frozen=True)
class Integral:
    """PI with back-calculation."""

    ki: float = 5.0

    def init(self, arm, y):
        return scalar.zeros(arm.n)

    def step(self, t, r, y, s):
        u = pd(t, r, y) + s
        return u, s + self.ki * (r.q - y.q) * 2e-3 + 0.1 * (y.applied - u)


@dataclass(frozen=True)
class AtOnce:
    """A law for all lanes at once, in Python."""

    vectorised = True

    def init(self, arm, y):
        return np.zeros_like(y.q)

    def step(self, t, r, y, s):
        return KP * (r.q - y.q) - KD * y.qd + s, s + 0.5 * (r.q - y.q)


def controlled(**more: Any) -> aw.Scenario:
    """Two geared rods that swing under a sampled law."""
    given = {
        "controller": pd, "reference": swing, "period": 2e-3, "substeps": 8, "integrator": "rk3", "duration": 0.1,
        "q0": wave(2, 0.1),
    }  # fmt: skip
    return scenario_of(GEARED, **(given | more))


def two_link(**more: Any) -> aw.Scenario:
    """Two links with torque commands under joint PID."""
    given = {
        "controller": JointPID(kp=[90.0, 40.0], ki=30.0, kd=[12.0, 6.0]), "reference": [0.5, -0.4], "period": 1e-3,
        "substeps": 1, "integrator": "rk3", "duration": 0.1, "q0": [0.3, -0.5], "qd0": [0.4, 0.2],
    }  # fmt: skip
    return scenario_of(arm("two-link"), **(given | more))


def wall(rule: str, **more: Any) -> aw.Scenario:
    """A rod that runs into its stop and away again."""
    model = pendulum(motor=MOTOR, friction=COULOMB, stops=STOPS, limits={"position_rad": [-0.4, 0.5]})
    return scenario_of(
        model, command=[12.0], duration=0.15, step=5e-5, integrator=rule, q0=[0.4], qd0=[3.0], **more
    )  # fmt: skip


def play(rule: str) -> aw.Scenario:
    """A gear with play that is driven to and fro."""
    model = pendulum(motor=MOTOR, friction=COULOMB, elasticity={**ELASTIC, "backlash_rad": 0.02})
    rows = aw.Schedule([0.0, 0.03, 0.0612], [[9.0], [-9.0], [4.0]], ["joint0"])
    return aw.Scenario(model, command=rows, duration=0.1, solver=aw.Solver(step=5e-5, integrator=rule))


def adaptive(name: str, **more: Any) -> aw.Scenario:
    """Steps that lanes choose by themselves."""
    model = MANY[name]
    given = {
        "command": wave(model.n, 9.0),
        "duration": 0.05,
        "step": 1e-3,
        "integrator": "rk45",
        "rtol": 1e-7,
        "atol": 1e-9,
    }
    return scenario_of(model, **(given | {"q0": wave(model.n)} | more))


def braked(**more: Any) -> aw.Scenario:
    """A brake that falls in and is released, under a controller."""
    model = pendulum(motor=MOTOR, brake=BRAKE, limits={"voltage_v": 24.0, "current_a": 6.0}, friction=COULOMB)
    law = JointPID(
        kp=120.0, ki=360.0, kd=12.0, gravity=True, limit=24.0, anti_windup="back-calculation", tracking_time=0.1
    )
    applied = aw.Schedule([0.0, 0.0205, 0.06], [[0], [1], [0]], ["joint0"])
    given = {
        "controller": law,
        "reference": [0.6],
        "brake": applied,
        "period": 1e-3,
        "substeps": 8,
        "duration": 0.1,
    }
    return scenario_of(model, integrator="rk3", **(given | more))


def current_cascade(**more: Any) -> aw.Scenario:
    """Position, speed and current loops at their own rates over a motor with inductance."""
    model = pendulum(motor={**MOTOR, "inductance_h": 1e-3}, friction=COULOMB, limits={"voltage_v": 48.0})
    law = Cascade(
        position_kp=20.0, speed_kp=3.0, speed_ki=30.0, current_kp=4.0, current_ki=900.0, effort_limit=8.0, voltage_limit=48.0,
        speed_limit=4.0, position_every=4, speed_every=2, speed_phase=1,
    )  # fmt: skip
    given = {"controller": law, "reference": [0.4], "period": 2.5e-4, "substeps": 2, "duration": 0.05}
    return scenario_of(model, integrator="rk3", **(given | more))


def continued() -> aw.Scenario:
    """A run that goes on from another one's last row."""
    model = MANY["all"]
    common = {"command": wave(2, 9.0), "duration": 0.01, "step": 1e-4, "integrator": "rk3"}
    return scenario_of(model, **common, start=aw.simulate(scenario_of(model, q0=wave(2), **common)))


HELD = (2.0, [0.05, -0.02, 0.1], [[0.012, 0.001, -0.002], [0.001, 0.01, 0.0005], [-0.002, 0.0005, 0.009]])

RUNS: dict[str, Callable[[], aw.Scenario]] = {
    **{f"{name} {rule}": lambda name=name, rule=rule: open_loop(name, rule) for name in COMMANDS for rule in RULES},
    **{f"{name} of 9 lanes": lambda name=name: open_loop(name, "rk3", 9) for name in ("puma560", "panda")},
    "two-link of 100 lanes": lambda: open_loop("two-link", "rk3", 100),
    **{f"effect {name}": lambda name=name: effect(name) for name in MANY},
    "effect all rk4": lambda: effect("all", "rk4"),
    "effect all semi_implicit_euler": lambda: effect("all", "semi_implicit_euler", 5e-5),
    "effect lugre rk4": lambda: effect("lugre", "rk4"),
    **{f"stop {rule}": lambda rule=rule: wall(rule) for rule in RULES},
    "stop rk45": lambda: wall("rk45", rtol=1e-7, atol=1e-9),
    **{f"play {rule}": lambda rule=rule: play(rule) for rule in RULES},
    "rk45": lambda: adaptive("plain"),
    "auto": lambda: chosen("puma560", aw.Solver("auto", accuracy=1e-4)),
    "rodas3": lambda: chosen("lwa4p", aw.Solver("rodas3", 1e-3, rtol=1e-5, atol=1e-7)),
    "auto sticking": lambda: chosen("puma560", aw.Solver("auto", accuracy=1e-4), smoothed=False),
    "rk3 sticking": lambda: chosen("puma560", aw.Solver("rk3", 1e-3), smoothed=False),
    "rk45 all": lambda: adaptive("all"),
    "rk45 events": lambda: adaptive("plain", events=joint_stops(MANY["plain"]), q0=aw.Batch(laned(20, 1))),
    "cvodes plain": lambda: adaptive("plain", integrator="cvodes", rtol=None, atol=None),
    "cvodes all": lambda: adaptive("all", integrator="cvodes", rtol=None, atol=None),
    "scara": lambda: aw.Scenario(
        scara(),
        command=[6.0, -5.0, 3.0, 1.0],
        duration=0.02,
        solver=aw.Solver(step=2e-5, integrator="rk3"),
        recording=aw.Recording(every=20),
    ),
    "schedule between ticks": lambda: aw.Scenario(
        arm("two-link"),
        command=aw.Schedule([0.0, 0.0103, 0.02], [[5, 1], [-5, 2], [0, 0]], ["shoulder", "elbow"]),
        duration=0.03,
        solver=aw.Solver(step=1e-3, integrator="rk3"),
    ),
    "schedule a lane": lambda: aw.Scenario(
        arm("two-link"),
        command=aw.Batch(
            [aw.Schedule([0.0, 0.01 + 0.0007 * k], [[5, 1], [-5, k]], ["shoulder", "elbow"]) for k in range(11)]
        ),
        duration=0.03,
        solver=aw.Solver(step=1e-3, integrator="rk3"),
    ),
    "wrench": lambda: aw.Scenario(
        arm("puma560"),
        command=COMMANDS["puma560"],
        duration=0.02,
        inputs=aw.Inputs(
            wrench=aw.Schedule(
                [0.0, 0.0071], [[0] * 6, [10, -5, 20, 1, 0.5, -0.2]], ("fx", "fy", "fz", "mx", "my", "mz")
            )
        ),
        solver=aw.Solver(step=5e-4, integrator="rk3"),
    ),
    "payload": lambda: aw.Scenario(
        arm("two-link"),
        command=[20.0, 5.0],
        duration=0.03,
        start=[0.3, -0.5],
        inputs=aw.Inputs(payload=[aw.Payload(0.0053, *HELD), aw.Payload(0.02, 0.0)]),
        solver=aw.Solver(step=1e-3, integrator="rk4"),
    ),
    "payload a lane": lambda: two_link(
        payload=[
            aw.Payload(
                aw.Batch(np.linspace(0.01, 0.05, 5)),
                aw.Batch(np.linspace(0.5, 2.5, 5)),
                [0, 0, 0.1],
                [0.01, 0.01, 0.01],
            )
        ]
    ),
    "varied": lambda: aw.Scenario(
        GEARED,
        command=[9.0, -3.0],
        duration=0.02,
        vary={"rod1.mass_kg": aw.Batch(np.linspace(0.5, 2.5, 17)), "joint0.motor.resistance_ohm": 1.4},
        start=wave(2),
        solver=aw.Solver(step=5e-4, integrator="rk3"),
    ),
    "varied under control": lambda: two_link(
        vary={"forearm.mass_kg": aw.Batch(np.linspace(0.5, 2.0, 70))}, reference=None
    ),
    "varied lugre": lambda: aw.Scenario(
        MANY["lugre"],
        command=[9.0],
        duration=0.01,
        vary={"joint0.friction.bristle_stiffness_n_m_per_rad": aw.Batch(np.linspace(1e3, 3e3, 5))},
        start=aw.Start(qd=[0.5]),
        solver=aw.Solver(step=1e-4, integrator="rk3"),
    ),
    "function": controlled,
    "function rk4": lambda: controlled(integrator="rk4"),
    "function semi_implicit_euler": lambda: controlled(integrator="semi_implicit_euler", substeps=16),
    "function rk45": lambda: controlled(integrator="rk45", substeps=1, rtol=1e-7, atol=1e-9),
    "function cvodes": lambda: controlled(integrator="cvodes", substeps=1, duration=0.02),
    "with memory": lambda: controlled(controller=Integral()),
    "in Python": lambda: controlled(controller=stubborn, duration=0.04),
    "in Python at once": lambda: controlled(controller=AtOnce(), q0=aw.Batch(laned(5, 2, 0.1)), duration=0.04),
    "cmu-dd under control": lambda: aw.Scenario(
        arm("cmu-dd"),
        duration=0.05,
        start=aw.Batch(laned(70, 6, 0.1)),
        loop=aw.Loop(controller=six, period=2e-3),
        solver=aw.Solver(substeps=2, integrator="rk3"),
    ),
    "pid": lambda: two_link(),
    "pid clamping": lambda: two_link(
        controller=JointPID(
            kp=[90.0, 40.0], ki=300.0, kd=[12.0, 6.0], limit=[12.0, 5.0], anti_windup="clamping", gravity=True
        )
    ),
    "pid back-calculation": lambda: two_link(
        controller=JointPID(
            kp=90.0,
            ki=300.0,
            kd=9.0,
            limit=9.0,
            anti_windup="back-calculation",
            tracking_time=0.05,
            cutoff_hz=80.0,
            derivative="measurement",
            delay_ticks=1,
        ),
        timing=aw.Timing("one-tick"),
    ),
    "gains a lane": lambda: two_link(controller=JointPID(kp=aw.Batch(40.0 + 10.0 * laned(6, 2, 1.0)), kd=9.0)),
    "cascade": current_cascade,
    "cascade of torques": lambda: two_link(
        controller=Cascade(
            position_kp=15.0, speed_kp=8.0, speed_ki=20.0, effort_limit=[30.0, 9.0], anti_windup="clamping"
        )
    ),
    "computed torque": lambda: aw.Scenario(
        arm("panda"),
        duration=0.05,
        start=wave(7),
        loop=aw.Loop(
            controller=ComputedTorque(kp=400.0, kd=40.0, ki=10.0),
            reference=aw.trajectories.Sine(centre=wave(7), amplitude=[0.1] * 7, frequency_hz=2.0),
            period=1e-3,
        ),
        solver=aw.Solver(substeps=4, integrator="rk3"),
    ),
    "difference": lambda: two_link(sensors=aw.Sensors(counts=4096, velocity="difference")),
    "filtered": lambda: two_link(
        sensors=aw.Sensors(counts=[4096, 8192], velocity="filtered", cutoff_hz=60.0, side="link")
    ),
    "observer": lambda: two_link(sensors=aw.Sensors(counts=4096, velocity="observer", cutoff_hz=60.0)),
    "noise": lambda: controlled(
        sensors=aw.Sensors(position_noise=1e-4, velocity_noise=1e-3, current_noise=1e-2),
        seed=7,
        q0=aw.Batch(laned(20, 2, 0.1)),
    ),
    "coupled encoders": lambda: aw.Scenario(
        MANY["all"],
        duration=0.03,
        loop=aw.Loop(
            controller=JointPID(kp=20.0, kd=1.0),
            reference=[0.1, -0.2],
            period=1e-3,
            sensors=aw.Sensors(counts=2048, velocity="difference"),
        ),
        solver=aw.Solver(substeps=8, integrator="rk3"),
    ),
    "one-tick": lambda: controlled(timing=aw.Timing("one-tick")),
    "sync": lambda: controlled(timing=aw.Timing("sync", command_delay=0.7e-3, jitter=2.5e-3), seed=3),
    "old measurement": lambda: controlled(timing=aw.Timing(measurement_delay=4e-3)),
    "sampled between ticks": lambda: controlled(timing=aw.Timing(measurement_delay=2.5e-3)),
    "late between ticks": lambda: controlled(timing=aw.Timing("one-tick", command_delay=2.5e-3)),
    "jitter and losses": lambda: controlled(
        timing=aw.Timing("one-tick", jitter=1.5e-3, measurement_loss=0.1, command_loss=0.1),
        seed=11,
        q0=aw.Batch(laned(9, 2, 0.1)),
    ),
    "drift": lambda: controlled(timing=aw.Timing(clock_drift=1e-2)),
    "delay a lane": lambda: controlled(
        timing=aw.Timing(
            measurement_delay=aw.Batch(np.linspace(0.0, 5e-3, 6)), command_delay=aw.Batch(np.linspace(6e-3, 0.0, 6))
        )
    ),
    "shaped": lambda: controlled(command_filter=aw.CommandFilter(limit=30.0, rate=5e3, resolution=0.25)),
    "brake": braked,
    "brake observer": lambda: braked(
        sensors=aw.Sensors(counts=4096, velocity="observer", cutoff_hz=60.0), reference=[0.2]
    ),
    "reduced": lambda: two_link(what="none", reduce=["rms_error", "peak_error", "overshoot"], q0=aw.Batch(laned(9, 2))),
    "reduced and recorded": lambda: controlled(reduce=["rms_error", "peak_voltage", "energy"], every=10),
    "reference a lane": lambda: two_link(
        reference=None, q0=aw.Batch(laned(7, 2)), qd0=None, wrench=[1.0, 2.0, 3.0, 0.0, 0.0, 0.0]
    ),
    "continued": continued,
    "scenario file": lambda: aw.read_scenario(EXAMPLES / "swing.scenario.toml"),
}
