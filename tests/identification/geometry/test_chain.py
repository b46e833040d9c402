"""The chain of a calibration is that of the arm: same poses as `forward_kinematics`, derivatives as by differences."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.identification.geometry.arm_chain import TERMS, ArmChains, Columns, gravity_loads
from armwright.identification.geometry.chain import moved

KINDS = """
name = "kinds"
command = "torque"
source = "estimate"
tip = "probe"
[[joints]]
name = "slide"
type = "prismatic"
parent = "base"
child = "a"
frame = { xyz_m = [0.1, 0.2, 0.3], rpy_rad = [0.3, -0.2, 0.5] }
axis = [0.0, 1.0, 1.0]
[[joints]]
name = "mount"
type = "fixed"
parent = "a"
child = "b"
frame = { xyz_m = [0.0, 0.1, 0.0], rpy_rad = [0.0, 0.4, 0.0] }
[[joints]]
name = "screw"
type = "helical"
pitch_m_per_rad = 0.01
parent = "b"
child = "c"
modified_dh = { alpha_rad = 0.3, r_m = 0.2, a_m = 0.1, offset_rad = 0.2 }
[[joints]]
name = "follower"
type = "revolute"
parent = "c"
child = "d"
frame = { xyz_m = [0.2, 0.0, 0.0], rpy_rad = [1.0, 0.0, 0.0] }
axis = [1.0, 0.0, 0.0]
mimic = { joint = "slide", multiplier = 2.0, offset_rad = 0.1 }
[[joints]]
name = "rail"
type = "prismatic"
parent = "d"
child = "e"
dh = { alpha_rad = -0.4, theta_rad = 0.3, a_m = 0.05, offset_m = 0.02 }
[[frames]]
name = "probe"
link = "e"
xyz_m = [0.0, 0.1, 0.2]
rpy_rad = [0.1, 0.2, 0.3]
"""


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """A slide, a screw, a follower, a fixed joint, three ways of placing joints, a tool."""
    link = '[[links]]\nname = "{}"\nmass_kg = 1.0\ncom_m = [0.1, 0.05, 0.2]\n'
    link += "inertia_kg_m2 = { xx = 0.1, xy = 0.0, xz = 0.0, yy = 0.1, yz = 0.0, zz = 0.1 }\n"
    path = tmp_path_factory.mktemp("arm") / "kinds.toml"
    path.write_text(KINDS + "".join(link.replace("{}", name) for name in "abcde"))
    return aw.load(path)


def _arm(name, kinds):
    return kinds if name == "kinds" else aw.load(name, on_impossible="warn")


@pytest.mark.parametrize("name", ["kinds", "panda", "lwa4p", "puma560", "cmu-dd"])
def test_poses_are_those_of_forward_kinematics_and_derivatives_of_differences(name, kinds):
    """All terms, at corrections that are not 0."""
    arm = _arm(name, kinds)
    chains = ArmChains(arm, TERMS, Columns())
    factors = chains.to(None)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, arm.n))
    count = len(chains.columns.found)
    placed = moved(factors, q, np.zeros(count)).placement
    assert np.allclose(placed, [aw.forward_kinematics(arm, each) for each in q], atol=1e-12)
    values = np.random.default_rng(1).normal(0, 1e-3, count)
    here, step = moved(factors, q, values), 1e-6
    for k, change in enumerate(step * np.eye(count)):
        up, down = (moved(factors, q, values + sign * change).placement for sign in (1.0, -1.0))
        slope = (up - down) / (2.0 * step)
        assert np.allclose(here.shifting[:, :, k], slope[:, :3, 3], atol=1e-7 * max(1.0, np.abs(slope).max()))
        spin = slope[:, :3, :3] @ here.placement[:, :3, :3].transpose(0, 2, 1)
        turning = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        assert np.allclose(here.turning[:, :, k], turning, atol=1e-7 * max(1.0, np.abs(slope).max()))


@pytest.mark.parametrize("name", ["panda", "puma560", "cmu-dd"])
def test_loads_about_the_axes_are_the_gravity_torques(name):
    """The moment about z, with the opposite sign of what the joint holds."""
    arm = _arm(name, None)
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (4, arm.n))
    loads = gravity_loads(arm, q)
    assert np.allclose(-loads[:, :, 5], [aw.gravity_torques(arm, each) for each in q], atol=1e-9)
