"""Friction by loads in inverse and forward dynamics, beside its published equations; the torque that it itself depends on."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.actuators import friction_torques
from armwright.dynamics import articulated_body, composite_body
from armwright.errors import DescriptionError
from armwright.friction_laws import LAWS
from armwright.interfaces import JointReference, Measurement
from armwright.kernels.signatures import SIGNATURES
from physics.differences import assert_slope, differences
from raises_at import raises_at
from simulation.test_load_dependent_friction import MADE, SERVOS, level, loaded_arm, published, record

SMOOTHING = 0.05
SETS = sorted(str(path.relative_to(SERVOS).with_suffix("")) for path in SERVOS.glob("*/m?.json"))
LAW = LAWS["load-dependent"]
KERNELS = ("inverse_dynamics", "forward_dynamics", "bias_torques")
DERIVATIVES = ("inverse_dynamics_derivatives", "forward_dynamics_derivatives", "forward_arm_linearised")
NUMBERS = {  # of `MADE`, by the keys of a record
    "coulomb": ("coulomb_positive_n_m", "coulomb_negative_n_m"),
    "viscous": ("viscous_n_m_s_per_rad",),
    "still": ("stribeck_torque_n_m",),
    "speed": ("stribeck_speed_rad_per_s",),
    "exponent": ("stribeck_exponent",),
    "motor_quadratic": ("load_motor_quadratic_per_n_m",),
    "external_quadratic": ("load_external_quadratic_per_n_m",),
    **{name: (name,) for name in MADE if name.startswith("load")},
}


def arm_with(folder, p=MADE, extra=f"smoothing_rad_per_s = {SMOOTHING}"):
    """Two links with a spring each, whose joints have the friction of a servo, and the arm without it."""
    arm = loaded_arm(folder)
    text = (folder / "arm.toml").read_text(encoding="utf-8")
    text = text.replace("[joints.friction]", f"[joints.friction]\n{extra}")
    (folder / "arm.toml").write_text(text, encoding="utf-8")
    values = {key: p[name] for name, keys in NUMBERS.items() for key in keys}
    arm = aw.load(folder / "arm.toml")
    arm = arm.with_values({f"{joint}.friction.{key}": value for joint in arm.names for key, value in values.items()})
    return arm, arm.replace(friction=None)


def resisting(p, qd, tau, external):
    """Friction of a joint by the published equation of M6, with its sign smoothed."""
    return level(p, qd, tau, external) * qd / np.hypot(qd, SMOOTHING) + p["viscous"] * qd


def states(count, size=1.0, seed=2):
    """Positions, speeds from slow to fast, another vector and a wrench."""
    rng = np.random.default_rng(seed)
    speeds = rng.normal(size=(count, 2)) * 10.0 ** rng.uniform(-3, 1, (count, 2))
    return zip(
        rng.uniform(-3, 3, (count, 2)),
        speeds,
        size * rng.normal(size=(count, 2)),
        rng.normal(size=(count, 6)),
        strict=True,
    )


@pytest.mark.parametrize("extra", ["", 'side = "motor"'])
def test_forward_dynamics_is_the_published_equation(tmp_path, extra):
    """τ_m is the motor's torque and τ_e all that acts at the state but inertia: the level without acceleration."""
    arm, free = arm_with(tmp_path, extra=f"smoothing_rad_per_s = {SMOOTHING}\n{extra}")
    for q, qd, tau, wrench in states(40):
        external = -aw.bias_torques(free, q, qd, wrench)
        f = [resisting(MADE, *each) for each in zip(qd, tau, external, strict=True)]
        right = aw.forward_dynamics(free, q, qd, tau - f, wrench)
        for function in (aw.forward_dynamics, composite_body, articulated_body):
            np.testing.assert_allclose(function(arm, q, qd, tau, wrench), right, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("servo", ["made", *SETS])
def test_inverse_dynamics_meets_the_published_equation(tmp_path, servo):
    """The torque τ_m with  τ_m - f(q̇, τ_m, τ_e) = M q̈ - τ_e,  by the equation and by forward dynamics.

    Where Q jumps over the torque there may be none: the motor's is that of the jump then.
    """
    p = MADE if servo == "made" else published(servo)
    arm, free = arm_with(tmp_path, p)
    jumps = 0
    for q, qd, qdd, wrench in states(60, size=30.0):
        tau, external = aw.inverse_dynamics(arm, q, qd, qdd, wrench), -aw.bias_torques(free, q, qd, wrench)
        needed = aw.inverse_dynamics(free, q, qd, qdd, wrench)
        f = np.array([resisting(p, *each) for each in zip(qd, tau, external, strict=True)])
        scale = np.abs(tau) + np.abs(external) + np.abs(f)
        met = np.abs(tau - f - needed) < 1e-12 * scale
        assert (met | (np.abs(tau + external) < 1e-12 * scale)).all()
        jumps += (~met).sum()
        if met.all():
            back = aw.forward_dynamics(arm, q, qd, tau, wrench)
            np.testing.assert_allclose(back, qdd, rtol=1e-8, atol=1e-8)
    assert jumps == 0 if p["motor_quadratic"] == p["external_quadratic"] else jumps < 6


def test_inverse_dynamics_undoes_forward_dynamics(tmp_path):
    """Where the equation has one solution: without jumps of Q."""
    arm, _ = arm_with(tmp_path, {**MADE, "external_quadratic": 0.01, "motor_quadratic": 0.01})
    for q, qd, tau, wrench in states(50, size=2.0):
        qdd = aw.forward_dynamics(arm, q, qd, tau, wrench)
        np.testing.assert_allclose(aw.inverse_dynamics(arm, q, qd, qdd, wrench), tau, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("quadratic", "motor"), [((0.5, 0.1), 0.3), ((0.1, 0.5), 0.3), ((0.4, 0.4), 0.7), ((0.0, 0.6), 1.3)]
)
def test_the_torque_is_the_least_that_does(tmp_path, way, quadratic, motor):
    """In the direction of motion, of all torques on a fine grid: jumps up and down, one that locks, one that is driven back."""
    p = {**MADE, "motor_quadratic": quadratic[0], "external_quadratic": quadratic[1], "load_motor": motor}
    arm, _ = arm_with(tmp_path, p)
    friction = replace(arm.coordinates[0].friction, viscous=0.0)
    grid = np.linspace(-6.0, 6.0, 2001)
    none = 0
    for needed, external, speed in np.random.default_rng(4).uniform([-1, -1, 0.1], [1, 1, 2], (30, 3)):
        speed = way * speed
        s = speed / np.hypot(speed, SMOOTHING)
        found = float(LAW.motor_torque(friction, speed, needed, external))
        reached = np.array([way * (t - s * level(p, speed, t, external) - needed) >= 0 for t in way * grid])
        if np.isnan(found):
            assert not reached.any()
            none += 1
        else:
            assert abs(way * found - grid[reached.argmax()]) < 6.1e-3
    assert (none > 0) == (motor > 1)


def test_acceleration_within_a_jump_of_the_level(tmp_path):
    """No torque gives it: the motor's is that of the jump, from whose sides the accelerations on both sides of it follow."""
    p = {**MADE, "motor_quadratic": 0.0, "external_quadratic": 0.4}
    arm, free = arm_with(tmp_path, p)
    q, qd = np.array([1.0, -2.0]), np.array([-2.0, -2.0])
    external = -aw.bias_torques(free, q, qd)
    near = 1e-9 * np.abs(external)
    ends = [aw.forward_dynamics(arm, q, qd, -external + side * near) for side in (-1, 1)]
    for part in (0.2, 0.5, 0.8):
        tau = aw.inverse_dynamics(arm, q, qd, ends[0] + part * (ends[1] - ends[0]))
        either = [aw.inverse_dynamics(arm, q, qd, end) for end in ends]
        up = [k for k in range(2) if either[1][k] - either[0][k] > -1e-6]
        assert len(up) == 1
        np.testing.assert_allclose(tau[up], -external[up], rtol=1e-8)


def test_a_motor_that_its_friction_holds_gets_no_torque(tmp_path):
    """load_motor above 1: beyond a point no torque drives the joint, NaN; one does driven back, and in slow motion."""
    arm, _ = arm_with(tmp_path, {**MADE, "load_motor": 1.2})
    dyn, q = aw.compile(arm), np.zeros((4, 2))
    qd = np.array([[2.0, 0.01], [2.0, 2.0], [-2.0, -2.0], [0.01, 0.01]])
    qdd = np.array([[500.0, 0.0], [-500.0, -500.0], [500.0, 500.0], [500.0, 500.0]])
    tau = dyn.inverse_dynamics(q, qd, qdd)
    np.testing.assert_array_equal(np.isnan(tau), [[True, False], [False, False], [False, False], [False, False]])
    np.testing.assert_allclose(dyn.forward_dynamics(q, qd, tau)[1:], qdd[1:], rtol=1e-9)
    np.testing.assert_allclose(
        tau[1:], [aw.inverse_dynamics(arm, *row) for row in zip(q[1:], qd[1:], qdd[1:], strict=True)]
    )


def test_controllers_know_the_loads(tmp_path):
    """Feed-forward of one joint is inverse dynamics at the reference; compensation is the friction of a steady motion."""
    bench = aw.load(record(tmp_path, MADE, f"smoothing_rad_per_s = {SMOOTHING}"))
    law = aw.FeedForward(aw.JointPID(1.0, 0.0, 0.0), friction=True, inertia="joint").configure(bench, 1e-3)
    q, qd, qdd = np.array([[0.7], [1.2], [30.0]])
    reference = JointReference(q, qd, qdd)
    assert law.torques(reference) == pytest.approx(aw.inverse_dynamics(bench, q, qd, qdd), rel=1e-12)
    arm, free = arm_with(tmp_path)
    q, qd = np.array([0.3, -0.5]), np.array([1.0, -2.0])
    law = aw.FrictionCompensation(aw.JointPID(1.0, 0.0, 0.0), dead_band=0.01, rest_speed=0.02).configure(arm, 1e-3)
    y, none = Measurement(q, qd, np.zeros(2), np.zeros(2)), np.zeros(2)
    u, _ = law.changed(JointReference(q, qd, none), y, none, np.zeros(0))
    assert u == pytest.approx(aw.bias_torques(arm, q, qd) - aw.bias_torques(free, q, qd), rel=1e-9)


def test_bias_is_the_torque_without_acceleration(tmp_path):
    arm, free = arm_with(tmp_path)
    for q, qd, _, wrench in states(30):
        h = aw.bias_torques(arm, q, qd, wrench)
        np.testing.assert_allclose(h, aw.inverse_dynamics(arm, q, qd, np.zeros(2), wrench), rtol=1e-12)
        external = -aw.bias_torques(free, q, qd, wrench)
        np.testing.assert_allclose(friction_torques(arm, qd, external), h + external, rtol=1e-9, atol=1e-12)
        unloaded = [resisting(MADE, v, 0.0, 0.0) for v in qd]
        np.testing.assert_allclose(friction_torques(arm, qd), unloaded, rtol=1e-12)


def test_without_a_smoothing_speed_friction_is_0_at_rest(tmp_path):
    arm, free = arm_with(tmp_path, extra="")
    q, qd, qdd = np.array([0.3, -0.4]), np.array([0.0, 0.7]), np.array([1.0, -2.0])
    tau = aw.inverse_dynamics(arm, q, qd, qdd)
    needed = aw.inverse_dynamics(free, q, qd, qdd)
    external = -aw.bias_torques(free, q, qd)
    assert tau[0] == needed[0]
    f = level(MADE, 0.7, tau[1], external[1]) + MADE["viscous"] * 0.7
    assert tau[1] == pytest.approx(needed[1] + f, rel=1e-12)
    np.testing.assert_allclose(aw.forward_dynamics(arm, q, qd, tau), qdd, rtol=1e-10)


@pytest.mark.parametrize("seed", range(6))
def test_derivatives_are_differences(tmp_path, seed):
    """Also that by q̈ is: M by the share of the motor's torque that friction leaves."""
    arm, _ = arm_with(tmp_path)
    q, qd, qdd = np.random.default_rng(seed).normal(size=(3, 2))
    by_q, by_qd, by_qdd = aw.inverse_dynamics_derivatives(arm, q, qd, qdd)
    assert_slope(by_q, differences(lambda x: aw.inverse_dynamics(arm, x, qd, qdd), q))
    assert_slope(by_qd, differences(lambda x: aw.inverse_dynamics(arm, q, x, qdd), qd))
    assert_slope(by_qdd, differences(lambda x: aw.inverse_dynamics(arm, q, qd, x), qdd))
    tau = aw.inverse_dynamics(arm, q, qd, qdd)
    by_q, by_qd, by_tau = aw.forward_dynamics_derivatives(arm, q, qd, tau)
    assert_slope(by_q, differences(lambda x: aw.forward_dynamics(arm, x, qd, tau), q))
    assert_slope(by_qd, differences(lambda x: aw.forward_dynamics(arm, q, x, tau), qd))
    assert_slope(by_tau, differences(lambda x: aw.forward_dynamics(arm, q, qd, x), tau))
    assert_slope(by_tau @ by_qdd, np.eye(2), 1e-10)


def test_slopes_at_rest_are_those_of_motion_forward(tmp_path):
    arm, free = arm_with(tmp_path)
    q, qd, qdd = np.array([0.4, -0.7]), np.zeros(2), np.array([3.0, -2.0])
    tau, external = aw.inverse_dynamics(arm, q, qd, qdd), -aw.bias_torques(free, q, qd)
    levels = [level(MADE, 0.0, *each) for each in zip(tau, external, strict=True)]
    slope = np.array(levels) / SMOOTHING + MADE["viscous"]
    assert_slope(aw.inverse_dynamics_derivatives(arm, q, qd, qdd)[1], np.diag(slope), 1e-10)
    by_qd = aw.forward_dynamics_derivatives(arm, q, qd, tau)[1]
    assert_slope(by_qd, -np.linalg.solve(aw.mass_matrix(arm, q), np.diag(slope)), 1e-10)


@pytest.mark.sample(2)
@pytest.mark.parametrize("kernel", [*KERNELS, *DERIVATIVES])
def test_kernels_are_their_functions(tmp_path, kernel):
    arm, _ = arm_with(tmp_path)
    rng, signature = np.random.default_rng(5), SIGNATURES[kernel]
    inputs = rng.normal(size=(len(signature.inputs), 21, 2))
    inputs[1, ::5] = 0.0
    found = getattr(aw.compile(arm), kernel)(*inputs)
    right = [signature.function(arm, *row) for row in zip(*inputs, strict=True)]
    single = not isinstance(found, tuple)
    for k, each in enumerate((found,) if single else found):
        expected = np.array([row if single else row[k] for row in right])
        np.testing.assert_allclose(each, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_varied_shares_are_those_of_another_record(tmp_path):
    """Shares of 0 in the record, which a kernel of that arm leaves out, and of 1.2 as inputs."""
    arm, _ = arm_with(tmp_path, {**MADE, "load_motor": 0.0, "motor_quadratic": 0.0})
    names = ["servo.friction.load_motor", "servo2.friction.load_motor_quadratic_per_n_m"]
    dyn = aw.compile(arm, vary=names)
    q, qd, qdd = np.random.default_rng(6).normal(size=(3, 8, 2))
    values = np.array([[0.0, 0.0], [0.4, 0.1], [1.2, 0.3], [0.2, 0.0]] * 2)
    found = dyn.inverse_dynamics(q, qd, qdd, parameters=values)
    right = [
        aw.inverse_dynamics(arm.with_values(dict(zip(names, row, strict=True))), *state)
        for row, *state in zip(values, q, qd, qdd, strict=True)
    ]
    np.testing.assert_allclose(found, right, rtol=1e-11)


def test_a_gear_has_its_loss_by_efficiency_or_by_this_law(tmp_path):
    loaded_arm(tmp_path)
    path = tmp_path / "arm.toml"
    text = path.read_text(encoding="utf-8").replace("gear_ratio = 1.0", "gear_ratio = 1.0\ngear_efficiency = 0.8", 1)
    path.write_text(text, encoding="utf-8")
    with raises_at(DescriptionError, "joint 'servo' motor.gear_efficiency", "load-dependent"):
        aw.load(path)


def test_every_published_set_is_met():
    if not SERVOS.is_dir():
        pytest.skip(f"the published parameters are not here: {SERVOS}")
    assert len(SETS) >= 37
    assert {json.loads((SERVOS / f"{name}.json").read_text(encoding="utf-8"))["model"] for name in SETS} == {
        f"m{k}" for k in range(1, 7)
    }
