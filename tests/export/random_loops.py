"""Loops of the library's blocks with numbers at random: hypothesis draws them, and makes one that fails smaller."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

import armwright as aw
from armwright import scalar
from armwright.errors import ScenarioError
from armwright.export.controller.sil import SoftwareInTheLoop
from armwright.model import Model
from export.controllers import swinging

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ARMS = ("two-link", "hot-lift", "scara", "cmu-dd", "lwa4p")  # torque; volts, with and without a current loop; current
TICKS = 120
Draw = Any  # hypothesis's function


@functools.cache
def model(name: str) -> Model:
    """An arm of `ARMS`."""
    path = EXAMPLES / f"{name}.toml"
    return aw.load(path if path.exists() else name)


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


def gains(arm: Model, high: float) -> st.SearchStrategy[Any]:
    """One gain for all joints, or one a joint."""
    return number(0.01 * high, high) | st.lists(number(0.01 * high, high), min_size=arm.n, max_size=arm.n)


def perhaps(strategy: st.SearchStrategy[Any], otherwise: Any = None) -> st.SearchStrategy[Any]:
    return st.just(otherwise) | strategy


@st.composite
def anti_windup(draw: Draw) -> dict[str, Any]:
    rule = draw(st.sampled_from(["none", "clamping", "back-calculation"]))
    time = draw(number(0.01, 0.5)) if rule == "back-calculation" else None
    slack = draw(perhaps(number(1e-6, 1e-2), 0.0))
    return {"anti_windup": rule, "tracking_time": time, "delay_ticks": draw(st.integers(0, 2)), "slack": slack}


@st.composite
def pids(draw: Draw, arm: Model) -> aw.JointPID:
    return aw.JointPID(
        kp=draw(gains(arm, 100.0)), ki=draw(perhaps(gains(arm, 50.0), 0.0)), kd=draw(perhaps(gains(arm, 5.0), 0.0)),
        derivative=draw(st.sampled_from(["error", "measurement"])), cutoff_hz=draw(perhaps(number(5.0, 400.0))),
        speed_feedforward=draw(perhaps(gains(arm, 5.0), 0.0)), acceleration_feedforward=draw(perhaps(gains(arm, 1.0), 0.0)),
        gravity=draw(st.booleans()), limit=draw(perhaps(gains(arm, 50.0))), **draw(anti_windup()),
    )  # fmt: skip


@st.composite
def cascades(draw: Draw, arm: Model) -> aw.Cascade:
    """Position, speed and, under volts, current, each at a rate and a phase of its own."""
    every = {name: draw(st.integers(1, 6)) for name in ("position", "speed")}
    phases = {f"{name}_phase": draw(st.integers(0, count - 1)) for name, count in every.items()}
    volts = all(b.drive.command == "voltage" and b.drive.torque_constant is not None for b in arm.coordinates)
    current = {"current_kp": draw(gains(arm, 10.0)), "current_ki": draw(gains(arm, 500.0))} if volts else {}
    if current:
        current["voltage_limit"] = draw(perhaps(gains(arm, 48.0)))
    return aw.Cascade(
        position_kp=draw(gains(arm, 40.0)), speed_kp=draw(gains(arm, 20.0)), speed_ki=draw(perhaps(gains(arm, 200.0), 0.0)),
        speed_feedforward=draw(perhaps(number(0.1, 1.0), 0.0)), speed_limit=draw(perhaps(gains(arm, 3.0))),
        effort_limit=draw(perhaps(gains(arm, 40.0))), position_every=every["position"], speed_every=every["speed"],
        **phases, **(current if draw(st.booleans()) else {}), **draw(anti_windup()),
    )  # fmt: skip


@st.composite
def computed_torques(draw: Draw, arm: Model) -> aw.ComputedTorque:
    return aw.ComputedTorque(
        kp=draw(gains(arm, 400.0)), kd=draw(gains(arm, 40.0)), ki=draw(perhaps(gains(arm, 100.0), 0.0))
    )


def own_law(t: Any, r: Any, y: Any) -> Any:
    """A law of the user's, with sines of the state and of time."""
    return 20.0 * scalar.sin(r.q - y.q) - 2.0 * y.qd + 0.1 * scalar.cos(40.0 * t)


@st.composite
def filters(draw: Draw) -> list[Any]:
    low = st.builds(aw.LowPass, number(5.0, 400.0), number(0.2, 1.5))
    notch = st.builds(aw.Notch, number(5.0, 400.0), number(1.0, 50.0), number(0.0, 0.9))
    return draw(st.lists(low | notch, min_size=1, max_size=3))


@st.composite
def controllers(draw: Draw, arm: Model) -> Any:
    """A law, and up to three blocks around it."""
    law = draw(st.one_of(pids(arm), cascades(arm), computed_torques(arm), st.just(own_law)))
    around = {
        "feed-forward": lambda inner: aw.FeedForward(
            inner, draw(st.booleans()), draw(st.booleans()), draw(st.sampled_from([None, "joint", "full"]))
        ),
        "observer": lambda inner: aw.DisturbanceObserver(inner, draw(gains(arm, 2.0)), draw(number(1.0, 100.0))),
        "filters": lambda inner: aw.Filtered(inner, draw(filters())),
        "friction": lambda inner: aw.FrictionCompensation(
            inner, draw(number(0.0, 0.01)), draw(number(1e-3, 0.1)), draw(number(0.1, 1.2))
        ),
        "reference": lambda inner: aw.trajectories.ReferenceFilter(
            inner, draw(number(0.2, 4.0)), draw(number(1.0, 50.0)), draw(number(10.0, 2000.0))
        ),
    }
    for name in draw(st.lists(st.sampled_from(sorted(around)), max_size=3, unique=True)):
        law = around[name](law)
    return law


@st.composite
def references(draw: Draw, arm: Model) -> Any:
    """A swing of all joints, a step, or a motion behind an input shaper."""
    kind = draw(st.sampled_from(["swing", "step", "shaped"]))
    if kind == "swing":
        return swinging(arm, draw(number(0.05, 0.5)), draw(number(0.2, 2.0)))
    goal = np.full(arm.n, draw(number(-0.5, 0.5)))
    if kind == "step":
        return goal
    quintic = aw.trajectories.Quintic(np.full(arm.n, 0.1), goal, duration=0.1)
    return aw.trajectories.InputShaper(
        quintic, draw(number(10.0, 60.0)), draw(number(0.0, 0.3)), draw(st.sampled_from(["zv", "zvd"]))
    )


@st.composite
def loops(draw: Draw) -> aw.Scenario:
    """A scenario of such a controller, with anything that sensors, converters and a bus do to it."""
    arm = model(draw(st.sampled_from(ARMS)))
    velocity = draw(st.sampled_from(["exact", "difference", "filtered", "observer"]))
    cutoff = draw(number(10.0, 300.0)) if velocity in ("filtered", "observer") else None
    noise = {name: draw(perhaps(number(1e-6, 1e-3), 0.0)) for name in ("position_noise", "velocity_noise")}
    turns = {} if any(b.kind.units.linear for b in arm.coordinates) else {"side": "link"}
    sensors = aw.Sensors(
        counts=draw(perhaps(st.integers(100, 2**18))), velocity=velocity, cutoff_hz=cutoff, **noise, **turns
    )
    limited = aw.CommandFilter(
        draw(number(1.0, 50.0)), draw(perhaps(number(1e2, 1e5))), draw(perhaps(number(1e-4, 0.1)))
    )
    timing = aw.Timing(
        draw(st.sampled_from(["ideal", "one-tick", "sync"])),
        measurement_delay=draw(perhaps(number(0.0, 3e-3), 0.0)), command_delay=draw(perhaps(number(0.0, 3e-3), 0.0)),
        jitter=draw(perhaps(number(1e-5, 1e-3), 0.0)), measurement_loss=draw(perhaps(number(0.01, 0.5), 0.0)),
        command_loss=draw(perhaps(number(0.01, 0.5), 0.0)),
    )  # fmt: skip
    period = draw(st.sampled_from([1e-3, 5e-4]))
    loop = aw.Loop(draw(controllers(arm)), draw(references(arm)), period, sensors, limited, timing)
    start = np.full(arm.n, 0.1)
    solver = aw.Solver(integrator="semi_implicit_euler", substeps=2)
    return aw.Scenario(arm, TICKS * period, loop=loop, start=start, solver=solver, seed=draw(st.integers(0, 2**16)))


def compared(scenario: aw.Scenario, folder: str | Path) -> SoftwareInTheLoop | None:
    """Comparison of the controller in C with its simulation; None for a loop that diverges, which has no commands to compare.

    Raises:
        ModelError: commands of other bits.
    """
    try:
        return aw.export.export_controller(scenario, folder).comparison
    except ScenarioError as error:
        if "diverged to infinite numbers" not in str(error):
            raise
        return None
