"""Reach: no pose puts the tip further out, and a straight arm comes just so far."""

import numpy as np
import pytest

from armwright.errors import ModelError
from armwright.kinematics import forward_kinematics
from armwright.kinematics.reach import reach
from armwright.model import DriveLimits
from physics.arms import NAMES, OWN, arm
from raises_at import raises_at
from simulation.runs import mixed_arm


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", [name for name in NAMES if name not in OWN])
def test_no_pose_is_further_out(name):
    model = arm(name)
    poses = np.random.default_rng(3).uniform(-np.pi, np.pi, size=(200, model.n))
    furthest = max(np.linalg.norm(forward_kinematics(model, q)[:3, 3]) for q in poses)
    assert furthest <= reach(model) * (1 + 1e-12)
    assert furthest > 0.6 * reach(model)


def test_a_planar_arm_reaches_the_sum_of_its_links():
    assert reach(arm("two-link")) == pytest.approx(1.8, rel=1e-12)


def test_a_slide_counts_with_the_longer_of_its_ends(tmp_path):
    model = mixed_arm(tmp_path)
    slid = np.hypot(0.1, 0.0)  # a of the slide's row, behind the motion
    assert reach(model) == pytest.approx(0.2 + 0.6 + np.hypot(slid, 0.3), rel=1e-12)
    lowest = forward_kinematics(model, np.array([0.0, -0.1, 0.0]))
    assert np.linalg.norm(lowest[:3, 3]) < reach(model)


def test_a_slide_without_limits_has_no_end(tmp_path):
    import dataclasses

    model = mixed_arm(tmp_path)
    endless = tuple(dataclasses.replace(body, limits=DriveLimits()) for body in model.bodies)
    assert reach(dataclasses.replace(model, bodies=endless)) == np.inf


def test_a_tree_without_a_tip_has_none(tmp_path):
    import dataclasses

    with raises_at(ModelError, "tip", "column, carriage, hand"):
        reach(dataclasses.replace(mixed_arm(tmp_path), tip=None))
