"""The built-in arms against what their sources say: lengths that makers publish, and their URDF as Pinocchio reads it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.actuators import friction_torques
from armwright.model import Model
from reference.example_robots import robot_files

POSES = 5
ROUNDED = 2e-5  # m and rad: the sources write 1.5708 for a right angle
DEGREES = np.pi / 180.0

# Where the tip is [m] at positions [degrees], by lengths of the makers' drawings and tables.
PUBLISHED = {
    "ur5e": ([0.0] * 6, [-0.425 - 0.3922, -0.1333 - 0.0996, 0.1625 - 0.0997]),
    "ur10e": ([0.0] * 6, [-0.6127 - 0.57155, -0.17415 - 0.11655, 0.1807 - 0.11985]),
    "ur3": ([0.0] * 6, [-0.24365 - 0.21325, -0.11235 - 0.0819, 0.1519 - 0.08535]),
    "ur5": ([0.0] * 6, [-0.425 - 0.39225, -0.10915 - 0.0823, 0.089159 - 0.09465]),
    "ur10": ([0.0] * 6, [-0.612 - 0.5723, -0.163941 - 0.0922, 0.1273 - 0.1157]),
    "iiwa14": ([0.0] * 7, [0.0, 0.0, 0.36 + 0.42 + 0.4 + 0.126]),  # base to shoulder, arms, wrist to flange
    "xarm7": ([0.0] * 7, [0.206, 0.0, 0.1205]),
    "open-manipulator-x": ([0.0] * 4, [0.012 + 0.024 + 0.124 + 0.126, 0.0, 0.0595 + 0.128]),
    "widowx250": ([0.0] * 6, [0.04975 + 0.175 + 0.075 + 0.065 + 0.108, 0.0, 0.072 + 0.03865 + 0.25]),
}

# Arms whose source is in example-robot-data: its file, and what its base and last link are called there.
URDFS = {
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_base", "link7"),
    "so100": ("so_arm_description/urdf/so100.urdf", "base", "gripper"),
    "so101": ("so_arm_description/urdf/so101.urdf", "base_link", "gripper_link"),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_tip_is_where_the_maker_has_it(name: str) -> None:
    degrees, position = PUBLISHED[name]
    pose = aw.forward_kinematics(aw.load(name), np.array(degrees) * DEGREES)
    np.testing.assert_allclose(pose[:3, 3], position, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["ur5e", "ur10e", "ur3", "ur5", "ur10"])
def test_the_flange_of_a_ur_is_turned_as_its_table_says(name: str) -> None:
    """x along the base's x, z against its y: alpha of +90° twice and -90° once."""
    turned = aw.forward_kinematics(aw.load(name), np.zeros(6))[:3, :3]
    np.testing.assert_allclose(turned, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], rtol=0, atol=1e-12)


# Principal moments of inertia [kg m²] of gen3's links, as MuJoCo computed them from the maker's URDF for its Menagerie.
GEN3 = (
    (0.00488868, 0.00457, 0.00135132),
    (0.0113017, 0.011088, 0.00102532),
    (0.0111633, 0.010932, 0.00100671),
    (0.00834839, 0.008147, 0.000598606),
    (0.00165901, 0.001596, 0.000346988),
    (0.00170087, 0.001641, 0.00035013),
    (0.000657336, 0.000587019, 0.000320645),
)


def test_principal_moments_of_the_gen3() -> None:
    links = aw.load("gen3").record.links
    found = [np.linalg.eigvalsh(link.inertia_kg_m2.matrix())[::-1] for link in links]
    np.testing.assert_allclose(found, GEN3, rtol=1e-5)


@pytest.mark.parametrize(
    ("name", "link", "moments"),
    [
        ("koch", "upper_arm", (3.73065e-05, 3.3772e-05, 7.94901e-06)),
        ("koch", "jaw", (3.49922e-06, 2.45768e-06, 1.4645e-06)),
        ("widowx250", "shoulder_link", (0.000588946, 0.000555655, 0.000378999)),
        ("widowx250", "wrist_link", (3.29057e-05, 3.082e-05, 2.68343e-05)),
    ],
)
def test_tensors_turned_into_the_link_s_axes_keep_the_source_s_moments(
    name: str, link: str, moments: tuple[float, ...]
) -> None:
    tensor = aw.load(name).record.link(link).inertia_kg_m2.matrix()
    np.testing.assert_allclose(np.linalg.eigvalsh(tensor)[::-1], moments, rtol=1e-5)


@pytest.mark.study
@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_a_ur_of_the_cb3_series_moves_as_its_urdf(name: str) -> None:
    """From the controller's base to its tool at zero TCP; masses of that older description are not the maker's."""
    pin: Any = pytest.importorskip("pinocchio", exc_type=ImportError)
    file = f"ur_description/urdf/{name}_robot.urdf"
    if file not in robot_files():
        pytest.skip("needs the robots: pip install example-robot-data")
    ours, theirs = aw.load(name), pin.buildModelFromUrdf(str(robot_files()[file]))
    data = theirs.createData()
    assert list(theirs.names)[1:] == list(ours.names)
    for q in np.random.default_rng(5).uniform(-3.0, 3.0, (POSES, 6)):
        pin.framesForwardKinematics(theirs, data, q)
        base, tool = (data.oMf[theirs.getFrameId(frame)] for frame in ("base", "tool0"))
        there = (base.inverse() * tool).homogeneous
        np.testing.assert_allclose(aw.forward_kinematics(ours, q), there, rtol=0, atol=1e-9)


def test_the_friction_of_the_ur10_is_that_of_its_identification() -> None:
    """Levels and slopes far from standstill of the authors' sigmoid of currents [A], times their drive gains [N m/A]."""
    gains = np.array([13.5841, 14.2959, 11.3716, 11.2408, 11.7681, 11.7682])
    viscous = np.array([1.064043537, 0.994406350, 0.679578357, 0.315921847, 0.224394889, 0.235839271])
    offset = np.array([-1.006569688, 0.956270099, -0.811994880, -0.176720085, -0.192362457, -0.245334512])
    rise = np.array([2.050627184, -2.401744449, 1.647842359, 0.468777484, 0.475975500, 0.597950407])
    slope = np.array([7.946667, -59.953552, 19.825139, 134.898249, 331.442055, 459.193349])
    shift = np.array([-0.018479435, -0.001949875, -0.005295096, -0.018576852, -0.011778096, -0.012953200])
    arm = aw.load("ur10")
    for speed in (-2.0, -1.0, 1.0, 2.0):
        level = rise * 0.5 * (1.0 + np.tanh(0.5 * slope * (speed + shift)))  # rise / (1 + exp(-slope (speed + shift)))
        published = gains * (viscous * speed + offset + level)
        np.testing.assert_allclose(friction_torques(arm, np.full(6, speed)), published, rtol=0, atol=0.02)
    drives = [body.drive for body in arm.coordinates]
    np.testing.assert_allclose([drive.gear_ratio * drive.torque_constant for drive in drives], gains, rtol=1e-6)


def bare(name: str) -> Model:
    """A built-in arm without its drives, which its source does not have."""
    return aw.load(name).replace(friction=None, rotors=None, efficiency=None)


@pytest.mark.study
@pytest.mark.parametrize("name", URDFS)
def test_kinematics_and_masses_are_those_of_the_source(name: str) -> None:
    """Pose of the last link, mass matrix and gravity torques, of Pinocchio on the source's own file."""
    pin: Any = pytest.importorskip("pinocchio", exc_type=ImportError)
    file, base, last = URDFS[name]
    if file not in robot_files():
        pytest.skip("needs the robots: pip install example-robot-data")
    ours, theirs = bare(name), pin.buildModelFromUrdf(str(robot_files()[file]))
    theirs.gravity.linear = ours.gravity
    data = theirs.createData()
    at = [theirs.joints[theirs.getJointId(joint)].idx_v for joint in ours.names]
    assert theirs.nv == ours.n
    for q in np.random.default_rng(4).uniform(-1.5, 1.5, (POSES, ours.n)):
        there = np.zeros(ours.n)
        there[at] = q
        pin.framesForwardKinematics(theirs, data, there)
        first, end = (data.oMf[theirs.getFrameId(link, pin.FrameType.BODY)] for link in (base, last))
        pose = first.inverse() * end
        np.testing.assert_allclose(
            aw.forward_kinematics(ours.replace(tip=last), q), pose.homogeneous, rtol=0, atol=ROUNDED
        )
        upper = np.triu(pin.crba(theirs, data, there))
        mass = (upper + np.triu(upper, 1).T)[np.ix_(at, at)]
        np.testing.assert_allclose(aw.mass_matrix(ours, q), mass, rtol=0, atol=1e-4 * np.abs(mass).max())
        weight = pin.computeGeneralizedGravity(theirs, data, there)[at]
        np.testing.assert_allclose(aw.gravity_torques(ours, q), weight, rtol=0, atol=1e-4 * np.abs(weight).max())
