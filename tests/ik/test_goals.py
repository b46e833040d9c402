"""Secondary goals against SciPy's SLSQP with the pose as a constraint, and several solutions against the known branches."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import armwright as aw
from armwright.errors import ModelError
from armwright.kinematics.reach import reach
from ik.arms import arm_of, samples

COUNT = 4


def bounds_of(arm):
    """Lowest and highest joint positions (n,)."""
    return np.array([body.limits.position for body in arm.bodies]).T


def value_of(arm, goal, near):
    """h(q), by NumPy, and the gradient by differences that SLSQP makes."""
    dyn, (low, high) = aw.compile(arm), bounds_of(arm)

    def value(q):
        if goal == "nearest":
            return 0.5 * ((q - near) ** 2).sum()
        if goal == "limits":
            return 0.5 * (((q - (low + high) / 2) / ((high - low) / 2)) ** 2).sum()
        rows = dyn.jacobian(q)
        rows[3:] *= reach(arm) / 3.0
        return -0.5 * np.linalg.slogdet(rows @ rows.T)[1]

    return value


def best_by_slsqp(arm, goal, near, target, starts):
    """Least h of all starts on the pose that SLSQP brings back to it."""
    dyn, value = aw.compile(arm), value_of(arm, goal, near)

    def off(q):
        pose = dyn.forward_kinematics(q)
        turn = pose[:3, :3].T @ target[:3, :3]
        axis = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        return np.concatenate([pose[:3, 3] - target[:3, 3], axis])

    found = [
        minimize(value, q, method="SLSQP", bounds=[*zip(*bounds_of(arm), strict=True)],
                 constraints={"type": "eq", "fun": off}, options={"maxiter": 100, "ftol": 1e-10})
        for q in starts
    ]  # fmt: skip
    return min(each.fun for each in found if np.abs(off(each.x)).max() < 1e-7)


@pytest.mark.sample(1)
@pytest.mark.parametrize("goal", ["nearest", "limits", "manipulability"])
@pytest.mark.parametrize("name", ["panda", "iiwa"])
def test_the_goal_is_as_good_as_that_of_slsqp(name, goal, tmp_path):
    arm = arm_of(name, tmp_path)
    low, high = bounds_of(arm)
    near = np.clip(np.linspace(0.4, -0.3, arm.n), low, high)
    _, targets = samples(arm, COUNT, seed=5)
    asked = {"near": near} if goal == "nearest" else {}
    found = aw.inverse_kinematics(arm, targets, goal=goal, **asked)
    assert found.success.all()
    starts = aw.inverse_kinematics(arm, targets, solutions=6).q
    value = value_of(arm, goal, near)
    for k in range(COUNT):
        there = best_by_slsqp(arm, goal, near, targets[k], found.q[k : k + 1])
        assert value(found.q[k]) <= there + 2e-4 * max(abs(there), 1.0)  # no better one nearby
        truth = best_by_slsqp(arm, goal, near, targets[k], starts[k][np.isfinite(starts[k, :, 0])])
        assert value(found.q[k]) <= truth + 0.02 * max(abs(truth), 1.0)  # nor one that is much better elsewhere


def test_the_goal_beats_plain_solutions_and_bits_do_not_depend_on_the_batch(tmp_path):
    arm = arm_of("iiwa", tmp_path)
    _, targets = samples(arm, 60, seed=6)
    plain, found = aw.inverse_kinematics(arm, targets), aw.inverse_kinematics(arm, targets, goal="limits")
    value = value_of(arm, "limits", None)
    better = [value(a) - value(b) for a, b in zip(plain.q, found.q, strict=True)]
    assert min(better) > -1e-6
    assert np.median(better) > 0.05
    assert np.array_equal(aw.inverse_kinematics(arm, targets[7], goal="limits").q, found.q[7])
    assert np.array_equal(aw.inverse_kinematics(arm, targets[::-1], goal="limits", threads=2).q[::-1], found.q)


@pytest.mark.parametrize("name", ["panda", "puma560"])
def test_several_solutions_differ_and_are_solutions(name, tmp_path):
    arm = arm_of(name, tmp_path)
    low, high = bounds_of(arm)
    _, targets = samples(arm, 100, seed=7)
    found = aw.inverse_kinematics(arm, targets, solutions=8)
    assert found.q.shape == (100, 8, arm.n)
    assert found.success[:, 0].all()
    dyn = aw.compile(arm)
    for k in range(100):
        rows = found.q[k][found.success[k]]
        assert np.isnan(found.q[k][~found.success[k]]).all()
        assert ((rows >= low) & (rows <= high)).all()
        assert np.abs(dyn.forward_kinematics(rows) - targets[k]).max() < 3e-8
        difference = np.abs(rows[:, None] - rows[None]).max(axis=2) + np.eye(len(rows))
        assert difference.min() > 0.04
        assert (np.diff(found.margin[k][found.success[k]]) <= 1e-12).all()  # farthest from limits first
    assert "different solutions" in str(found)
    one = aw.inverse_kinematics(arm, targets[3], solutions=8)
    assert np.array_equal(one.q, found.q[3], equal_nan=True)


def test_several_solutions_are_the_branches_of_a_planar_arm():
    """Elbow up and elbow down, and nothing else."""
    arm = aw.load("two-link")
    _, targets = samples(arm, 50, seed=8)
    found = aw.inverse_kinematics(arm, targets[:, :3, 3], solutions=5)
    count = found.success.sum(axis=1)
    assert (count <= 2).all()
    elbow = np.abs(found.q[:, 0, 1])
    assert ((count == 2) | (elbow < 0.03)).all()  # closer to straight, the two are one
    two = found.q[count == 2][:, :2, 1]
    assert np.abs(two.sum(axis=1)).max() < 1e-6  # q2 and -q2


def test_out_of_reach_with_a_goal_and_several():
    arm = aw.load("puma560")
    plain = aw.inverse_kinematics(arm, [3.0, 0.0, 0.0])
    found = aw.inverse_kinematics(arm, [3.0, 0.0, 0.0], solutions=3, goal="limits")
    assert not found.success.any()
    assert found.position_error[0] == pytest.approx(float(plain.position_error), rel=1e-6)
    assert np.isnan(found.q[1:]).all()
    assert "0 of 1 solved" in str(found)


@pytest.mark.parametrize(
    ("options", "place"),
    [
        ({"goal": "speed"}, "goal"),
        ({"goal": "nearest"}, "goal"),
        ({"solutions": 0}, "solutions"),
        ({"solutions": 2.0}, "solutions"),
        ({"solutions": True}, "solutions"),
    ],
)
def test_bad_input_is_named(options, place):
    with pytest.raises(ModelError) as error:
        aw.inverse_kinematics(aw.load("two-link"), [0.3, 0.1, 0.0], **options)
    assert error.value.place == place


@pytest.mark.parametrize("length", [0.0, np.nan, True, "long"])
def test_a_length_that_is_none_is_refused(length):
    with pytest.raises(ModelError) as error:
        aw.kinematics.Goal(length=length)
    assert error.value.place == "length"
