"""Step responses of linear drives through the whole loop, and their exact solutions: matrix exponentials between changes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import armwright as aw
from armwright import scalar
from armwright.model import Model
from simulation.plants import MOTOR, pendulum

N, KT, R, L = 50.0, 0.06, 1.2, 2e-3  # of MOTOR, and its winding
J = 2500 * 2e-4 + 0.1 + 3.0 * 0.3**2  # rotor and rod at the joint
B = 0.8  # [N m s/rad]
PERIOD, TICKS = 5e-3, 24
WINDING = {**MOTOR, "inductance_h": L}
# keys of the joint; A and b of (q, q̇) or (q, q̇, i)
DRIVES: dict[str, tuple[dict[str, Any], np.ndarray, np.ndarray]] = {
    "integrator": ({"command": "torque"}, np.array([[0, 1], [0, 0]]), np.array([0, 1 / J])),
    "first order": (
        {"command": "torque", "friction": {"viscous_n_m_s_per_rad": B}},
        np.array([[0, 1], [0, -B / J]]),
        np.array([0, 1 / J]),
    ),
    "motor with load": (
        {"command": "voltage", "friction": {"viscous_n_m_s_per_rad": B}},
        np.array([[0, 1], [0, -(B + (N * KT) ** 2 / R) / J]]),
        np.array([0, N * KT / R / J]),
    ),
    "motor with inductance": (
        {"command": "voltage", "friction": {"viscous_n_m_s_per_rad": B}, "motor": WINDING},
        np.array([[0, 1, 0], [0, -B / J, N * KT / J], [0, -N * KT / L, -R / L]]),
        np.array([0, 0, 1 / L]),
    ),
}


@cache
def transition(name: str, time: float) -> np.ndarray:
    """exp of (A, b; 0, 0) time: takes (x, u) to what they are a while [s] later, u held."""
    _, a, b = DRIVES[name]
    n = len(b)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = a, b
    return expm(whole * time)


def at(name: str, changes: list[tuple[float, float]], time: float) -> np.ndarray:
    """The state at a time from rest, for commands (when, u) in the order of time; before the first the command is 0."""
    x, t = np.zeros(len(DRIVES[name][2]) + 1), 0.0
    for when, command in changes:
        if when >= time:
            break
        x, t = transition(name, round(when - t, 12)) @ x, when
        x[-1] = command
    return (transition(name, round(time - t, 12)) @ x)[:-1]


def arm(name: str) -> Model:
    joint: dict[str, Any] = {"motor": MOTOR, **DRIVES[name][0]}
    return pendulum(gravity=0.0, **joint)


def check(run: Any, expected: np.ndarray) -> None:
    """Position, speed and, where it is a state, current: (…, rows, 2 or 3), to 1e-9 of the largest."""
    found = np.concatenate([run.q.values, run.qd.values, run.current.values], axis=-1)[..., : expected.shape[-1]]
    scale = np.abs(expected).max(axis=tuple(range(expected.ndim - 1)))
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", DRIVES)
def test_steps_of_a_schedule(name):
    """Up and down again, the second time within a step of the integrator."""
    model = arm(name)
    changes = [(0.0, 9.0), (0.0333, -6.0)]
    plan = aw.Schedule(np.array([t for t, _ in changes]), np.array([[u] for _, u in changes]), tuple(model.names))
    run = aw.simulate(
        aw.Scenario(
            model,
            command=plan,
            duration=0.1,
            solver=aw.Solver(step=5e-5, integrator="rk4"),
            recording=aw.Recording(every=100),
        )
    )
    check(run, np.array([at(name, changes, t) for t in run.time.values]))


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", DRIVES)
def test_delayed_feedback(name):
    """Sampled P control of the speed (torques) or the position (volts); a lane for each pair of delays, in periods."""
    model = arm(name)
    speeds = DRIVES[name][0]["command"] == "torque"
    gain, what = (20.0, 1) if speeds else (40.0, 0)
    delays = [(late, old) for late in (0.0, 1.0, 2.0, 0.5, 1.5, 2.25) for old in (0.0, 1.0, 0.75)]
    expected = []
    for late, old in delays:
        changes: list[tuple[float, float]] = []
        for k in range(TICKS + 1):
            seen = at(name, changes, max(k - old, 0.0) * PERIOD)[what]
            changes.append(((k + late) * PERIOD, gain * (1.0 - seen)))
        expected.append([at(name, changes, k * PERIOD) for k in range(TICKS + 1)])

    def law(t, r, y):
        return gain * (1.0 - (y.qd if speeds else y.q)) + scalar.zeros(1)

    commands, measurements = PERIOD * np.array(delays).T
    run = aw.simulate(
        aw.Scenario(
            model, duration=TICKS * PERIOD,
            loop=aw.Loop(controller=law, period=PERIOD, timing=aw.Timing(command_delay=aw.Batch(commands),
                measurement_delay=aw.Batch(measurements)), initial_command=[0.0]),
            solver=aw.Solver(substeps=40, integrator="rk4"),
        )
    )  # fmt: skip
    assert run.attrs["controller"] == "compiled"
    check(run, np.array(expected))
