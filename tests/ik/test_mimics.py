"""Inverse kinematics of arms whose joints mimic others: solved for the joints in q, the followers where these put them."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw

JOINTS = {  # name: axis, origin [m], limits [rad]
    "a": ("0 0 1", "0 0 0.3", (-2.5, 2.5)),
    "b": ("0 1 0", "0 0 0.1", (-1.0, 1.5)),
    "c": ("0 1 0", "0 0 0.4", (-3.0, 3.0)),
    "d": ("1 0 0", "0.3 0 0", (-3.2, 3.2)),
    "e": ("0 1 0", "0.2 0 0", (-2.0, 2.0)),
    "f": ("1 0 0", "0.1 0 0", (-2.9, 2.9)),
}
FOLLOWERS = {  # follower: master, multiplier
    "parallelogram": {"c": ("b", -0.5)},
    "of the first joint": {"d": ("a", 0.7)},
    "of a joint that turns around": {"e": ("d", 0.5)},
    "followers come first": {"a": ("c", 0.6)},
    "a chain of followers": {"c": ("b", -0.5), "e": ("c", 1.5)},
}


def mimicking(followers, folder):
    """The arm of six joints, with those that follow others."""
    links = "".join(f'<link name="l{k}"/>' for k in range(len(JOINTS) + 1))
    joints = ""
    for k, (name, (axis, origin, (low, high))) in enumerate(JOINTS.items()):
        master, factor = followers.get(name, (None, 0.0))
        mimic = f'<mimic joint="{master}" multiplier="{factor}" offset="0.2"/>' if master else ""
        joints += (
            f'<joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="{origin}"/>'
            f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="2" effort="100"/>{mimic}</joint>'
        )
    path = folder / "mimicking.urdf"
    path.write_text(f'<robot name="mimicking">{links}{joints}</robot>')
    return aw.load(path, kinematics_only=True)


def by_hand(arm, followers, q):
    """Poses of the tip with every joint moving by itself, the followers' positions computed here."""
    every = dict(zip(arm.names, q.T, strict=True))
    while len(every) < len(JOINTS):
        every |= {name: k * every[of] + 0.2 for name, (of, k) in followers.items() if of in every and name not in every}
    return aw.compile(arm.tree).forward_kinematics(np.stack([every[name] for name in JOINTS], axis=1))


@pytest.mark.sample(1)
@pytest.mark.parametrize("goal", [None, "limits"])
@pytest.mark.parametrize("name", FOLLOWERS)
def test_targets_are_met_with_the_followers_where_their_masters_put_them(name, goal, tmp_path):
    followers = FOLLOWERS[name]
    arm = mimicking(followers, tmp_path)
    assert arm.n == len(JOINTS) - len(followers)
    low, high = np.array([JOINTS[joint][2] for joint in arm.names]).T
    q = np.random.default_rng(0).uniform(low, high, (200, arm.n))
    targets = by_hand(arm, followers, q)
    found = aw.inverse_kinematics(arm, targets, goal=goal)
    assert found.success.mean() >= 0.995
    solved = found.success
    assert np.abs(by_hand(arm, followers, found.q)[solved] - targets[solved]).max() <= 3e-8
    assert ((found.q >= low) & (found.q <= high)).all()


def test_a_position_that_no_follower_allows_is_not_solved(tmp_path):
    """A pose that the six joints reach by themselves, and the five of the arm do not: its error is told."""
    arm = mimicking(FOLLOWERS["parallelogram"], tmp_path)
    free = np.array([[0.3, 0.5, 1.0, 0.4, 0.6, -0.2]])
    found = aw.inverse_kinematics(arm, aw.compile(arm.tree).forward_kinematics(free))
    assert not found.success.any()
    assert max(found.position_error[0], found.angle_error[0]) > 1e-3
    assert "target 0: not reached, the nearest pose is" in str(found)
