"""Computed torque: with the exact model errors die away as designed, with a wrong one they do not."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.control import ComputedTorque
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from physics.arms import arm
from raises_at import raises_at


@pytest.mark.parametrize("name", ["two-link", "cmu-dd", "lwa4p", "puma560", "workshop"])
def test_the_arm_accelerates_as_it_is_asked(name):
    """forward(command(inverse)) is the identity, whatever the drives take."""
    from armwright.actuators import drive_torque

    model = arm(name)
    rows = np.random.default_rng(3).normal(size=(5, model.n)) * 0.3
    r, y = JointReference(*rows[:3]), Measurement(rows[3], rows[4], np.zeros(model.n), np.zeros(model.n))
    law = ComputedTorque(kp=25.0, kd=8.0).configure(model, 1e-3)
    u, _ = law.step(0.0, r, y, law.init(model, y))
    qdd = aw.forward_dynamics(model, y.q, y.qd, drive_torque(model, y.qd, u))
    np.testing.assert_allclose(qdd, r.qdd + 8.0 * (r.qd - y.qd) + 25.0 * (r.q - y.q), rtol=1e-6, atol=1e-6)


def tracking(model, period, reckoned=None):
    start = np.array([0.2, -0.4, 0.1, 0.3, 0.2, -0.1])[: model.n]
    motion = aw.trajectories.Quintic(start, start + 0.4, 0.8)
    law = ComputedTorque(kp=100.0, kd=20.0, model=reckoned)
    run = aw.simulate(
        aw.Scenario(model, duration=1.0, start=start, loop=aw.Loop(controller=law, reference=motion, period=period))
    )
    return np.abs(run.q.values - run.q_reference.values).max()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["two-link", "cmu-dd"])
def test_an_exact_model_tracks_but_for_what_is_held_over_a_period(name):
    errors = [tracking(arm(name), period) for period in (2e-3, 1e-3, 5e-4)]
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.2)


def test_a_model_may_deliberately_be_another():
    model = arm("two-link")
    heavy = tracking(model, 1e-3, model.replace(gravity=[0.0, -7.0, 0.0]))
    assert heavy > 20 * tracking(model, 1e-3)


def test_an_offset_dies_away_with_the_chosen_poles():
    model = arm("two-link")
    law = ComputedTorque(kp=100.0, kd=20.0)
    run = aw.simulate(
        aw.Scenario(model, duration=0.5, loop=aw.Loop(controller=law, reference=np.array([0.1, 0.2]), period=2e-4))
    )
    t = run.time.values[:, None]
    expected = np.array([0.1, 0.2]) * (1.0 - (1.0 + 10.0 * t) * np.exp(-10.0 * t))
    np.testing.assert_allclose(run.q.values, expected, atol=1e-3)


def test_a_model_of_other_joints_is_refused():
    law = ComputedTorque(kp=1.0, kd=1.0, model=arm("cmu-dd"))
    with raises_at(ScenarioError, "ComputedTorque.model", "6 joints.* 2 of two-link: shoulder, elbow"):
        aw.Scenario(arm("two-link"), duration=0.1, loop=aw.Loop(controller=law, period=1e-3))


def test_what_is_no_model_is_refused():
    with raises_at(ScenarioError, "ComputedTorque.model", value="puma560"):
        ComputedTorque(kp=100.0, kd=20.0, model="puma560")
