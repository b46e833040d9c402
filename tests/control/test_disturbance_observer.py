"""A disturbance observer against its closed form: what it estimates, and that no error is left without an integrator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from physics.arms import arm
from simulation.plants import MOTOR, pendulum

PERIOD, HZ, PUSH = 1e-3, 20.0, 3.0
INERTIA = 0.1 + 3.0 * 0.3**2  # of the rod about its hinge
TIP = {"tip": "tip", "frames": [{"name": "tip", "link": "rod0", "xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}]}
ABOUT_HINGE = [0.0, 0.0, 0.0, 0.0, PUSH, 0.0]


def pushed(law, duration, model=None, **loop: Any):
    """A run at rest, pushed by a constant moment about the hinge."""
    model = pendulum("torque", gravity=0.0, robot=TIP) if model is None else model
    scenario = aw.Scenario(
        model, duration=duration, loop=aw.Loop(law, np.zeros(1), PERIOD, **loop), inputs=aw.Inputs(wrench=ABOUT_HINGE)
    )
    return aw.simulate(scenario)


def nothing(t, r, y):
    return 0.0 * r.q


def test_the_estimate_is_the_closed_form():
    """With the exact inertia d̂_k = d (1 - e^{-ωTk}), whatever the loop does; alone it is the command, turned round."""
    run = pushed(aw.DisturbanceObserver(nothing, INERTIA, HZ), 0.1)
    assert run.attrs["controller"] == "compiled"
    k = np.arange(len(run.time) - 1)
    expected = -PUSH * (1.0 - np.exp(-2.0 * np.pi * HZ * PERIOD * k))
    np.testing.assert_allclose(run.u.values[:-1, 0], expected, atol=1e-6 * PUSH)


@pytest.mark.sample(1)
@pytest.mark.parametrize("share", [0.7, 1.0, 1.5])
def test_a_constant_load_is_rejected_without_an_integrator(share):
    """PD leaves d/kp; with the observer, whose inertia may be wrong, nothing."""
    servo = aw.JointPID(kp=60.0, kd=8.0)
    alone, observed = pushed(servo, 2.0), pushed(aw.DisturbanceObserver(servo, share * INERTIA, HZ), 2.0)
    assert alone.q.values[-1, 0] == pytest.approx(PUSH / 60.0, rel=1e-4)
    assert abs(observed.q.values[-1, 0]) < 1e-6 * PUSH / 60.0
    assert observed.u.values[-1, 0] == pytest.approx(-PUSH, rel=1e-6)


def test_a_limit_winds_nothing_up():
    """The drive gives at most 2 N m; the estimate stays the load, since what was applied is counted."""
    model = pendulum("torque", gravity=0.0, robot=TIP, limits={"torque_n_m": 2.0})
    run = pushed(aw.DisturbanceObserver(nothing, INERTIA, HZ), 0.3, model)
    assert np.abs(run.u.values).max() == pytest.approx(PUSH, rel=1e-3)


def test_voltages_and_gravity():
    """With a voltage drive it holds the weight that PD gives way to by  m g l / (kp n Kt / R)."""
    model = pendulum("voltage", motor=MOTOR)
    servo = aw.JointPID(kp=60.0, kd=8.0)
    alone, observed = (
        aw.simulate(aw.Scenario(model, duration=2.0, loop=aw.Loop(law, np.zeros(1), PERIOD))).q.values[-1, 0]
        for law in (servo, aw.DisturbanceObserver(servo, INERTIA + 2e-4 * 50.0**2, 10.0))
    )
    stall = 50.0 * 0.06 / 1.2  # [N m/V]
    assert abs(alone) == pytest.approx(3.0 * 9.81 * 0.3 * np.cos(alone) / (60.0 * stall), rel=1e-4)
    assert abs(observed) < 1e-5


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"hz": -1.0}, r"DisturbanceObserver\.hz = -1\.0"),
        ({"inertia": [1.0, 0.0]}, r"DisturbanceObserver\.inertia of joint"),
        ({"inertia": [1.0]}, r"DisturbanceObserver\.inertia"),
    ],
)
def test_bad_fields_are_refused(fields, said):
    given = {"inner": nothing, "inertia": 1.0, "hz": 10.0, **fields}
    with pytest.raises(ScenarioError, match=said):
        aw.DisturbanceObserver(**given).configure(arm("two-link"), PERIOD)
