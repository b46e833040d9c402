"""Ranges that poses are drawn from: limits hold, also beyond half a turn, and what turns for ever stays within a turn."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.control.analysis.workspace import sampled_poses
from armwright.identification.geometry.setting import random_positions
from armwright.joint_kinds import KINDS
from armwright.model.drive import DriveLimits

PI, TURN = np.pi, 2.0 * np.pi


@pytest.mark.parametrize(
    ("kind", "limits", "expected"),
    [
        ("revolute", (-1.0, 2.0), (-1.0, 2.0)),
        ("revolute", (-0.02, 3.75), (-0.02, 3.75)),
        ("revolute", (4.0, 6.0), (4.0, 6.0)),
        ("revolute", (0.0, TURN), (0.0, TURN)),
        ("revolute", (-TURN, TURN), (-PI, PI)),
        ("revolute", (1.0, 9.0), (1.0, 1.0 + TURN)),
        ("revolute", (-9.0, 1.0), (1.0 - TURN, 1.0)),
        ("revolute", (-np.inf, np.inf), (-PI, PI)),
        ("revolute", (2.0, np.inf), (2.0, 2.0 + TURN)),
        ("helical", (0.0, 40.0), (0.0, 40.0)),
        ("prismatic", (0.0, 9.0), (0.0, 9.0)),
        ("prismatic", (-np.inf, np.inf), (-PI, PI)),
    ],
)
def test_samples_stay_within_limits_and_within_a_turn(kind, limits, expected):
    body = replace(aw.load("two-link").bodies[1], limits=DriveLimits(position=limits))
    made = KINDS[kind](pitch=0.01) if kind == "helical" else KINDS[kind]()
    assert replace(body, kind=made).sampled_range == pytest.approx(expected)


@pytest.mark.parametrize("draw", [sampled_poses, random_positions])
def test_poses_are_drawn_from_all_of_a_range_beyond_half_a_turn(draw):
    arm = aw.load("two-link")
    elbow = replace(arm.bodies[1], limits=replace(arm.bodies[1].limits, position=(4.0, 6.0)))
    q = draw(replace(arm, bodies=(arm.bodies[0], elbow)), 200)[:, 1]
    assert (q >= 4.0).all()
    assert (q <= 6.0).all()
    assert np.ptp(q) > 1.9
