"""Published numbers: the PUMA 560 of two papers, the LWA 4P's gravity torques, the two-link arm's closed form."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.description import read_description
from armwright.description.database import parse
from armwright.dynamics import bias_torques, gravity_torques, inverse_dynamics, mass_matrix
from armwright.kinematics import forward_kinematics, jacobian
from armwright.model import Model, build_model

# Test vectors of cdsousa/SymPyBotics 5d4613ab, sympybotics/tests/test_results.py (BSD), computed there with Corke's toolbox.
Q = np.array(
    [
        0.7504516826728697,
        0.8395156106908136,
        0.16851233582594916,
        0.3849629637427072,
        0.5252993946810777,
        0.6701207256444748,
    ]
)
QD = np.array(
    [
        0.24721855939629367,
        0.9805915670454258,
        0.9895299755642817,
        0.7861135739668947,
        0.273842245476577,
        0.17182358900767503,
    ]
)
QDD = np.array(
    [
        0.707405815485141,
        0.25295715193420953,
        0.9763909835998361,
        0.8412822676113918,
        0.4867768296473465,
        0.11480270540937143,
    ]
)

CORKE_TAU = [
    0.986185688341252,
    16.1055550633721,
    -6.54839494827661,
    0.00626452648190803,
    -0.0208972707132494,
    5.59805923645945e-5,
]
CORKE_G = [0.0, 16.8135891283022, -7.29033633567802, 0.00449992182015992, -0.026719893613902, 0.0]
CORKE_C = [
    -0.240237883763956,
    -1.0843848843681,
    0.365583586254475,
    -0.000123404998742911,
    0.00359951257553373,
    1.1075729558421e-5,
]
CORKE_M = [
    [
        2.05591694561963,
        -0.607149114401804,
        -0.0772414386669633,
        0.00110264316988551,
        0.000264135330891356,
        2.74006873318143e-6,
    ],
    [2.00048563124708, 0.306870038373922, -0.000227846077158843, 0.000780985328855223, 7.53260796283046e-6],
    [0.361368447500762, -0.000267122764221431, 0.00156301630001611, 7.53260796283046e-6],
    [0.00169083802882858, 0.0, 3.4606953693396e-5],
    [0.00064216, 0.0],
    [4.0e-5],
]  # upper rows
CORKE_T = [
    [-0.655113870655343, -0.474277925274361, -0.588120962109346, 0.0540498757911011],
    [0.524340309498464, 0.275038163391149, -0.805866768463298, -0.154761559833806],
    [0.543960528264717, -0.836310025215452, 0.0685017183295358, 0.568944734102513],
    [0.0, 0.0, 0.0, 1.0],
]

AKB_TAU = [
    2.71610302653938,
    -28.7944111980059,
    -7.07013200484716,
    0.00682888994276653,
    -0.0220889100229662,
    5.59805923645946e-5,
]
AKB_G = [0.0, -31.1492065095002, -7.04528104551999, 0.00449992182016002, -0.026719893613902, 0.0]
AKB_M = {(0, 0): 2.88092539107775, (0, 1): 0.454967124647697, (1, 1): 2.16866309038072, (2, 2): 0.315830104422493}

DIGITS = 1e-12  # relative: twelve significant digits
ZERO = 1e-14  # what a printed zero may be, in vectors whose largest entries are 1 to 30


def assert_digits(ours, published) -> None:
    """Twelve significant digits of every entry, however small."""
    ours, published = np.asarray(ours), np.asarray(published)
    zero = published == 0.0
    np.testing.assert_allclose(ours[~zero], published[~zero], rtol=DIGITS)
    np.testing.assert_allclose(ours[zero], 0.0, atol=ZERO)


@pytest.fixture(scope="module")
def corke() -> Model:
    """The built-in PUMA 560 without its drives."""
    return build_model(read_description("puma560")).replace(friction=None, rotors=None)


def test_torques_of_the_puma_560(corke):
    """Inverse dynamics: tau as the tests of SymPyBotics print them."""
    assert_digits(inverse_dynamics(corke, Q, QD, QDD), CORKE_TAU)


def test_gravity_torques_of_the_puma_560(corke):
    """Gravity torques: g as the tests of SymPyBotics print them."""
    assert_digits(gravity_torques(corke, Q), CORKE_G)


def test_velocity_torques_of_the_puma_560(corke):
    """Coriolis and centrifugal torques, bias less gravity: c as the tests of SymPyBotics print them."""
    without_gravity = corke.replace(gravity=[0.0, 0.0, 0.0])
    assert_digits(bias_torques(without_gravity, Q, QD), CORKE_C)
    np.testing.assert_allclose(bias_torques(corke, Q, QD) - gravity_torques(corke, Q), CORKE_C, rtol=1e-10, atol=1e-14)


def test_mass_matrix_of_the_puma_560(corke):
    """M as the tests of SymPyBotics print them, every entry of the printed upper half."""
    ours = mass_matrix(corke, Q)
    for i, row in enumerate(CORKE_M):
        assert_digits(ours[i, i:], row)
        assert_digits(ours[i:, i], row)


def test_tip_pose_of_the_puma_560(corke):
    """T06 as the tests of SymPyBotics print them."""
    assert_digits(forward_kinematics(corke, Q), CORKE_T)


def akb() -> Model:
    """Armstrong, Khatib, Burdick 1986 in modified DH, the table of the Robotics Toolbox; no drives."""
    right = np.pi / 2
    alpha, a = [0, -right, 0, right, -right, right], [0, 0, 0.4318, -0.0203, 0, 0]
    d, mass = [0, 0.2435, -0.0934, 0.4331, 0, 0], [0, 17.4, 4.8, 0.82, 0.34, 0.09]
    com = [[0, 0, 0], [0.068, 0.006, -0.016], [0, -0.070, 0.014], [0, 0, -0.019], [0, 0, 0], [0, 0, 0.032]]
    inertia = [
        [0, 0, 0.35],
        [0.13, 0.524, 0.539],
        [0.066, 0.0125, 0.066],
        [1.8e-3, 1.8e-3, 1.3e-3],
        [0.3e-3, 0.3e-3, 0.4e-3],
        [0.15e-3, 0.15e-3, 0.04e-3],
    ]
    joints, links = [], []
    for k in range(6):
        row = {"alpha_rad": alpha[k], "a_m": a[k], "r_m": d[k], "offset_rad": 0}
        place = {"parent": f"link{k}" if k else "base", "child": f"link{k + 1}", "modified_dh": row}
        joints.append({"name": f"joint{k + 1}", "type": "revolute", **place})
        xx, yy, zz = inertia[k]
        tensor = {"xx": xx, "xy": 0, "xz": 0, "yy": yy, "yz": 0, "zz": zz}
        link = {"name": f"link{k + 1}", "mass_kg": mass[k], "com_m": com[k], "inertia_kg_m2": tensor}
        links.append(link | ({"accept_impossible": "published so"} if k == 0 else {}))
    return build_model(
        parse(
            {
                "name": "puma560-akb",
                "source": "publication",
                "command": "torque",
                "gravity_m_s2": [0, 0, -9.81],
                "joints": joints,
                "links": links,
            },
            "AKB",
        )
    )


def test_modified_dh_puma_560():
    """tau, g and the printed entries of M of the AKB block as the tests of SymPyBotics print them."""
    arm = akb()
    assert_digits(inverse_dynamics(arm, Q, QD, QDD), AKB_TAU)
    assert_digits(gravity_torques(arm, Q), AKB_G)
    ours = mass_matrix(arm, Q)
    for entry, published in AKB_M.items():
        assert_digits(ours[entry], published)


def test_gravity_torques_of_the_lwa4p():
    """The published model of Liu, Giusti and Althoff, N m, to the digits printed there."""
    arm = build_model(read_description("lwa4p"))
    upright = gravity_torques(arm, np.zeros(6))
    level = gravity_torques(arm, np.array([0, np.pi / 2, 0, 0, 0, 0]))
    np.testing.assert_allclose(upright, [0, 0.0018, -0.0018, 0, 0, 0], atol=0.5e-4)
    np.testing.assert_allclose(level, [0, -44.98, 14.05, 0.68, 1.87, 0], atol=0.5e-2)


def two_link(q, qd):
    """M, C q̇, g, tip and Jacobian of the built-in `two-link`, as textbooks print them; x level, y up."""
    l1, c1, c2, m1, m2, i1, i2, g, l2 = 1.0, 0.5, 0.4, 6.0, 4.0, 0.5, 0.2133, 9.81, 0.8
    k = m2 * l1 * c2
    m12 = i2 + m2 * c2**2 + k * np.cos(q[1])
    m22 = i2 + m2 * c2**2
    m = [[i1 + m1 * c1**2 + m2 * l1**2 + m12 + k * np.cos(q[1]), m12], [m12, m22]]
    s = k * np.sin(q[1])
    c = [-s * (2 * qd[0] * qd[1] + qd[1] ** 2), s * qd[0] ** 2]
    hanging = m2 * c2 * g * np.cos(q[0] + q[1])
    gravity = [(m1 * c1 + m2 * l1) * g * np.cos(q[0]) + hanging, hanging]
    x, y = l2 * np.cos(q[0] + q[1]), l2 * np.sin(q[0] + q[1])
    tip = [l1 * np.cos(q[0]) + x, l1 * np.sin(q[0]) + y]
    jac = [[-tip[1], -y], [tip[0], x], [0, 0], [0, 0], [0, 0], [1, 1]]
    return m, c, gravity, tip, jac


@pytest.mark.parametrize("seed", range(5))
def test_two_link_closed_form(seed):
    """M, C q̇, g, tip and Jacobian of two links in a plane, Spong and Vidyasagar's closed form."""
    arm = build_model(read_description("two-link"))
    q, qd, qdd = np.random.default_rng(seed).normal(size=(3, 2))
    m, c, g, tip, jac = two_link(q, qd)
    np.testing.assert_allclose(mass_matrix(arm, q), m, rtol=1e-13)
    np.testing.assert_allclose(gravity_torques(arm, q), g, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(bias_torques(arm, q, qd), np.add(c, g), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(inverse_dynamics(arm, q, qd, qdd), m @ qdd + np.add(c, g), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(forward_kinematics(arm, q)[:2, 3], tip, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(jacobian(arm, q), jac, rtol=1e-13, atol=1e-14)
