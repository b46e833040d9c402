"""Laws of joint friction: what design section 3 and the record's docstring say of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

import armwright as aw
from actuators.drives import one_joint
from armwright.actuators import friction_torques
from armwright.friction_laws import LAWS
from armwright.model import Model
from armwright.program import interpret, trace

SYMMETRIC = {
    "viscous": {"viscous_n_m_s_per_rad": 2.0},
    "coulomb": {"coulomb_positive_n_m": 3.0, "coulomb_negative_n_m": 3.0, "smoothing_rad_per_s": 0.1},
    "stribeck": {
        "viscous_n_m_s_per_rad": 0.5,
        "coulomb_positive_n_m": 3.0,
        "coulomb_negative_n_m": 3.0,
        "stribeck_torque_n_m": 5.0,
        "stribeck_speed_rad_per_s": 0.3,
        "smoothing_rad_per_s": 0.001,
    },
    "motor side": {
        "side": "motor",
        "viscous_n_m_s_per_rad": 2e-4,
        "coulomb_positive_n_m": 0.01,
        "coulomb_negative_n_m": 0.01,
        "smoothing_rad_per_s": 5.0,
    },
}
STICKING = {  # without a smoothing speed
    "coulomb": {"coulomb_positive_n_m": 3.0, "coulomb_negative_n_m": 1.0, "viscous_n_m_s_per_rad": 2.0},
    "motor side": {"side": "motor", "coulomb_positive_n_m": 0.01, "coulomb_negative_n_m": 0.03},
    "stribeck": {
        "coulomb_positive_n_m": 3.0,
        "coulomb_negative_n_m": 2.0,
        "stribeck_torque_n_m": 5.0,
        "stribeck_speed_rad_per_s": 0.3,
    },
    "lugre": {
        "law": "lugre",
        "coulomb_positive_n_m": 3.0,
        "coulomb_negative_n_m": 2.0,
        "bristle_stiffness_n_m_per_rad": 1e4,
        "bristle_damping_n_m_s_per_rad": 10.0,
    },
    "load": {"coulomb_positive_n_m": 0.0, "coulomb_negative_n_m": 0.0, "load_coefficient": 0.1},
}
LOPSIDED = {
    "coulomb": {"coulomb_positive_n_m": 3.0, "coulomb_negative_n_m": 1.0, "smoothing_rad_per_s": 0.1},
    "stribeck": {**SYMMETRIC["stribeck"], "coulomb_negative_n_m": 4.0},
    "sigmoid": {
        "law": "sigmoid",
        "sigmoid_amplitude_n_m": 1.3,
        "sigmoid_slope_s_per_rad": 5.6,
        "sigmoid_shift_rad_per_s": 0.036,
    },
}
BY_LOADS = {
    "law": "load-dependent",
    "coulomb_positive_n_m": 3.0,
    "coulomb_negative_n_m": 3.0,
    "stribeck_torque_n_m": 5.0,
    "stribeck_speed_rad_per_s": 0.3,
    "stribeck_exponent": 1.3,
    "load_motor": 0.2,
    "load_external": 0.1,
    "load_motor_stribeck": 0.05,
    "load_external_stribeck": 0.1,
    "load_motor_quadratic_per_n_m": 0.02,
    "load_external_quadratic_per_n_m": 0.01,
}
MOTOR = {"gear_ratio": -100.0, "rotor_inertia_kg_m2": 0.0}
speeds = st.floats(-50.0, 50.0)


def friction_at(model: Model, speed: float) -> float:
    """The only joint's friction torque [N m]."""
    return float(friction_torques(model, np.array([speed]))[0])


@pytest.mark.sample(1)
@pytest.mark.parametrize("law", SYMMETRIC)
@given(speed=speeds)
def test_equal_both_ways_is_odd(law, speed):
    """f(-q̇) = -f(q̇) where the record says the same of both directions."""
    model = one_joint(SYMMETRIC[law], MOTOR)
    assert friction_at(model, -speed) == -friction_at(model, speed)


@pytest.mark.sample(1)
@pytest.mark.parametrize("law", [*SYMMETRIC, *(f"lopsided {law}" for law in LOPSIDED)])
@given(speed=speeds)
def test_dissipative(law, speed):
    """f q̇ ≥ 0 for every law without an offset: friction never drives."""
    record = LOPSIDED[law.removeprefix("lopsided ")] if "lopsided" in law else SYMMETRIC[law]
    assert friction_at(one_joint(record, MOTOR), speed) * speed >= 0.0


@pytest.mark.parametrize("record", [*SYMMETRIC.values(), *LOPSIDED.values()])
def test_nothing_at_rest(record):
    """f(0) = 0, and f passes through it without a jump."""
    model = one_joint(record, MOTOR)
    assert friction_at(model, 0.0) == 0.0
    assert abs(friction_at(model, 1e-9)) < 1e-4
    assert abs(friction_at(model, -1e-9)) < 1e-4


def test_offset_acts_at_rest():
    """The offset is the only term that does."""
    assert friction_at(one_joint({"viscous_n_m_s_per_rad": 2.0, "offset_n_m": -0.3}), 0.0) == -0.3
    assert friction_at(one_joint({"viscous_n_m_s_per_rad": 2.0, "offset_n_m": -0.3}), 0.5) == pytest.approx(0.7)


def test_coulomb_by_direction():
    """f = Fc+ s for q̇ > 0, Fc- s for q̇ < 0, s = q̇/√(q̇² + smoothing²)."""
    model = one_joint(LOPSIDED["coulomb"])
    s = 0.2 / np.hypot(0.2, 0.1)
    assert friction_at(model, 0.2) == pytest.approx(3.0 * s)
    assert friction_at(model, -0.2) == pytest.approx(-1.0 * s)
    assert friction_at(model, 1e3) == pytest.approx(3.0)
    assert friction_at(model, -1e3) == pytest.approx(-1.0)


def test_stribeck_falls_from_its_level_to_coulomb():
    """Fs just off standstill, Fc + (Fs - Fc)/e at the Stribeck speed, Fc + viscous q̇ far beyond."""
    model = one_joint(SYMMETRIC["stribeck"])
    assert friction_at(model, 0.02) == pytest.approx(5.0, rel=0.01)
    assert friction_at(model, 0.3) == pytest.approx(0.5 * 0.3 + 3.0 + 2.0 / np.e, rel=1e-4)
    assert friction_at(model, 10.0) == pytest.approx(0.5 * 10.0 + 3.0, rel=1e-6)


def test_sigmoid_is_gaz():
    """f = a/(1 + exp(-b(q̇ + c))) - a/(1 + exp(-b c)). [Gaz2019]"""
    model, a, b, c = one_joint(LOPSIDED["sigmoid"]), 1.3, 5.6, 0.036
    for speed in (-2.0, -0.1, 0.05, 1.7):
        expected = a / (1 + np.exp(-b * (speed + c))) - a / (1 + np.exp(-b * c))
        assert friction_at(model, speed) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("record", [*SYMMETRIC.values(), *LOPSIDED.values()])
def test_slopes_are_numbers_at_any_speed(record, dtype):
    """∂f/∂q̇ far from standstill is that of the torques there: no exponential overflows."""
    model = one_joint(record, MOTOR)
    speed = np.array([[-1e4], [-150.0], [150.0], [1e4]], dtype)
    still = np.zeros_like(speed)
    _, slope, _ = aw.compile(model, dtype=dtype).inverse_dynamics_derivatives(still, speed, still)
    expected = [friction_at(model, v + 0.5) - friction_at(model, v - 0.5) for v in speed[:, 0].astype(float)]
    assert slope.ravel() == pytest.approx(expected, rel=1e-5, abs=1e-5)


@pytest.mark.sample(1)
@pytest.mark.parametrize("ratio", [40.0, -40.0])
@given(speed=speeds)
def test_motor_side_is_referred(ratio, speed):
    """Viscous by n², torques by |n|, speeds by 1/|n|; the sign of n turns no direction around."""
    n = abs(ratio)
    motor_side = {
        "side": "motor",
        "viscous_n_m_s_per_rad": 1e-3,
        "coulomb_positive_n_m": 0.03,
        "coulomb_negative_n_m": 0.01,
        "offset_n_m": 0.002,
        "stribeck_torque_n_m": 0.05,
        "stribeck_speed_rad_per_s": 8.0,
        "smoothing_rad_per_s": 2.0,
    }
    power = {"viscous_n_m_s_per_rad": n * n, "stribeck_speed_rad_per_s": 1 / n, "smoothing_rad_per_s": 1 / n}
    joint_side = {key: v * power.get(key, n) for key, v in motor_side.items() if isinstance(v, float)}
    motor = {"gear_ratio": ratio, "rotor_inertia_kg_m2": 0.0}
    ours, referred = friction_at(one_joint(motor_side, motor), speed), friction_at(one_joint(joint_side, motor), speed)
    assert ours == pytest.approx(referred, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("ratio", [40.0, -40.0])
def test_positive_is_the_joints_direction_on_the_motor_side(ratio):
    """n < 0: levels and offset by the direction of the joint, not of the motor; what resists the joint resists the motor too."""
    motor = {"gear_ratio": ratio, "rotor_inertia_kg_m2": 0.0}
    levels = {
        "coulomb_positive_n_m": 0.03,
        "coulomb_negative_n_m": 0.01,
        "offset_n_m": 0.002,
        "smoothing_rad_per_s": 1e-6,
    }
    model = one_joint({"side": "motor", **levels}, motor)
    assert friction_at(model, 2.0) == pytest.approx(40.0 * (0.03 + 0.002))
    assert friction_at(model, -2.0) == pytest.approx(40.0 * (-0.01 + 0.002))
    assert friction_at(model, 0.0) == pytest.approx(40.0 * 0.002)


@pytest.mark.sample(1)
@pytest.mark.parametrize("ratio", [40.0, -40.0])
@given(speed=speeds)
def test_sigmoid_on_the_motor_side(ratio, speed):
    """a |n|/(1 + exp(-b |n| (q̇ + c/|n|))) less its value at rest: the motor's torque at the motor's speed."""
    model = one_joint({"side": "motor", **LOPSIDED["sigmoid"]}, {"gear_ratio": ratio, "rotor_inertia_kg_m2": 0.0})
    on_joint = one_joint(LOPSIDED["sigmoid"])
    expected = 40.0 * friction_at(on_joint, 40.0 * speed)
    assert friction_at(model, speed) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("law", STICKING)
def test_the_sign_of_the_speed_without_a_smoothing_speed(law):
    """f = Fc sgn q̇ and the rest of each law, 0 at rest: the limit of the smoothed law, which it is far above its speed."""
    record = STICKING[law]
    model, smooth = one_joint(record, MOTOR), one_joint({**record, "smoothing_rad_per_s": 1e-9}, MOTOR)
    assert friction_at(model, 0.0) == 0.0
    for speed in (-3.0, -0.2, 1e-3, 0.4):
        assert friction_at(model, speed) == pytest.approx(friction_at(smooth, speed), rel=1e-9)
    friction = model.bodies[0].friction
    assert friction.is_dry
    assert friction.sticks == (law != "lugre")
    assert not smooth.bodies[0].friction.sticks


def test_what_is_not_dry_does_not_stick():
    """Viscous friction, an offset and a sigmoid vanish with the speed, or act at rest as they do beside it."""
    for record in (SYMMETRIC["viscous"], LOPSIDED["sigmoid"], {"offset_n_m": 1.0}):
        assert not one_joint(record).bodies[0].friction.sticks


def test_the_torques_that_hold_a_joint():
    """Static levels by direction; of the sigmoid, which has none, its values far from standstill."""
    level = LOPSIDED["stribeck"]["stribeck_torque_n_m"]
    for record, expected in ((STICKING["coulomb"], (-1.0, 3.0)), (LOPSIDED["stribeck"], (-level, level))):
        friction = one_joint(record).bodies[0].friction
        assert LAWS[friction.law].holding(friction) == expected
    sliding = one_joint(LOPSIDED["sigmoid"])
    far = friction_at(sliding, -100.0), friction_at(sliding, 100.0)
    assert LAWS["sigmoid"].holding(sliding.bodies[0].friction) == pytest.approx(far, rel=1e-14)


@pytest.mark.parametrize("loads", [(3.0, -2.0), (-1.0, 2.5), (2.0, 1.0)])
def test_friction_by_loads_falls_from_standstill_by_what_it_says(loads):
    friction = one_joint(BY_LOADS, MOTOR).bodies[0].friction
    law = LAWS["load-dependent"]
    level, stribeck = law.level(friction, 0.0, loads), BY_LOADS["stribeck_torque_n_m"]
    assert level > stribeck
    assert law.falling(friction, loads) == pytest.approx(level - law.level(friction, 1e3, loads), rel=1e-12)
    assert law.falling(friction) == stribeck - min(BY_LOADS["coulomb_positive_n_m"], BY_LOADS["coulomb_negative_n_m"])


@pytest.mark.parametrize("record", [*SYMMETRIC.values(), *LOPSIDED.values(), *STICKING.values()])
def test_traced_is_the_same(record):
    """The law through trace and interpreter, both directions and rest."""
    model = one_joint(record, MOTOR)
    q = np.array([[-3.0], [-0.01], [0.0], [0.02], [4.0]])
    traced = interpret(trace("friction", lambda qd: friction_torques(model, qd), {"qd": (1,)}), q)
    np.testing.assert_allclose(traced, [friction_torques(model, row) for row in q], rtol=1e-14, atol=1e-14)


def test_nan_stays():
    """A diverged speed has no friction torque."""
    assert np.isnan(friction_at(one_joint(LOPSIDED["coulomb"]), np.nan))


def test_linear_friction_of_a_slide():
    """A prismatic joint's record in N and m/s is the same law."""
    row = {"coulomb_positive_n": 3.0, "coulomb_negative_n": 1.0, "viscous_n_s_per_m": 2.0, "smoothing_m_per_s": 0.1}
    model = one_joint(row, type="prismatic")
    assert friction_at(model, 0.2) == pytest.approx(0.4 + 3.0 * 0.2 / np.hypot(0.2, 0.1))
    assert friction_at(model, -0.2) == pytest.approx(-0.4 - 1.0 * 0.2 / np.hypot(0.2, 0.1))


def test_friction_that_holds_a_joint_against_its_motor_is_warned_of():
    """Of either side; a level below the largest torque is none."""
    levels = {"coulomb_positive_n_m": 3.0, "coulomb_negative_n_m": 4.0}
    limits = {"torque_n_m": 3.0}
    (warning,) = one_joint(levels, limits=limits).warnings
    assert "'hinge' friction.coulomb_positive_n_m = 3.0" in warning
    assert "dry friction of 3 N m holds the joint: its motor gives 3 N m at most" in warning
    assert not one_joint({**levels, "coulomb_negative_n_m": 2.9}, limits=limits).warnings
    on_motor = {"side": "motor", "coulomb_positive_n_m": 0.04, "coulomb_negative_n_m": 0.04}
    assert "dry friction of 4 N m" in one_joint(on_motor, MOTOR, limits=limits).warnings[0]
    slide = {"coulomb_positive_n": 5.0, "coulomb_negative_n": 5.0}
    assert "5 N holds" in one_joint(slide, type="prismatic", limits={"force_n": 2.0}).warnings[0]
