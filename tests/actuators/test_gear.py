"""Laws of the gear's loss: design section 3, *Gear loss*."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from actuators.drives import one_joint
from armwright.actuators.gear import GearLoss, gear_loss, holds_by_loss
from armwright.model import Model

ETA, SMOOTH = 0.6, 0.05
speeds, torques = st.floats(-20.0, 20.0), st.floats(-100.0, 100.0)


def lossy() -> Model:
    """A gear of efficiency ETA; the smoothing speed is its friction's."""
    friction = {"viscous_n_m_s_per_rad": 0.0, "smoothing_rad_per_s": SMOOTH}
    return one_joint(friction, {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 0.0, "gear_efficiency": ETA})


GEAR = lossy()


def loss_at(speed: float) -> GearLoss:
    """The gear at a speed."""
    loss = gear_loss(GEAR.bodies[0].drive, speed)
    assert loss is not None
    return loss


def transmitted(speed: float, torque: float) -> float:
    """G(t), the torque that leaves the gear."""
    return float(loss_at(speed).output(torque))


def test_driving_and_driven_back():
    """Far from rest the arm receives η tau when driven, tau/η when it drives back."""
    assert transmitted(20.0, 10.0) == pytest.approx(ETA * 10.0, rel=1e-5)
    assert transmitted(-20.0, -10.0) == pytest.approx(-ETA * 10.0, rel=1e-5)
    assert transmitted(-20.0, 10.0) == pytest.approx(10.0 / ETA, rel=1e-5)
    assert transmitted(20.0, -10.0) == pytest.approx(-10.0 / ETA, rel=1e-5)


def test_the_formula():
    """e = 1 - (1-η)s driving, 1 + (1/η-1)s driven back, s = |q̇|/√(q̇² + qd_smooth²)."""
    s = 0.03 / np.hypot(0.03, SMOOTH)
    assert transmitted(0.03, 2.0) == pytest.approx(2.0 * (1 - (1 - ETA) * s), rel=1e-14)
    assert transmitted(-0.03, 2.0) == pytest.approx(2.0 * (1 + (1 / ETA - 1) * s), rel=1e-14)


@given(torques)
def test_without_a_smoothing_speed(torque):
    """η and 1/η at any speed, and nothing lost at rest."""
    motor = {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 0.0, "gear_efficiency": ETA}
    body = one_joint(None, motor).bodies[0]
    assert holds_by_loss(body)
    assert not holds_by_loss(GEAR.bodies[0])
    for speed in (1e-12, 3.0, -1e-12, -3.0):
        factor = ETA if speed * torque >= 0.0 else 1.0 / ETA
        assert gear_loss(body.drive, speed).output(torque) == pytest.approx(factor * torque, rel=1e-15)
    assert gear_loss(body.drive, 0.0).output(torque) == torque
    assert gear_loss(body.drive, 0.0).input(torque) == torque


@given(speeds, torques)
def test_dissipative(speed, torque):
    """The arm never gets more power than the motor gives."""
    assert transmitted(speed, torque) * speed <= torque * speed + 1e-12


@given(torques)
def test_continuous_through_rest(torque):
    """At rest nothing is lost, whichever way it goes on; through torque 0 the arm's torque goes through 0."""
    assert transmitted(0.0, torque) == torque
    for speed in (1e-9, -1e-9):
        assert transmitted(speed, torque) == pytest.approx(torque, rel=1e-7)
    assert abs(transmitted(5.0, 1e-12)) < 1e-11
    assert abs(transmitted(5.0, -1e-12)) < 1e-11


@given(speeds, torques)
def test_invertible_from_either_side(speed, torque):
    """What enters follows from what leaves: inverse dynamics divides by what forward dynamics multiplies with."""
    assert loss_at(speed).input(transmitted(speed, torque)) == pytest.approx(torque, rel=1e-14, abs=1e-300)


@given(speeds, torques)
def test_mirrored(speed, torque):
    """Turning the other way round changes nothing but signs."""
    assert transmitted(-speed, -torque) == -transmitted(speed, torque)


def test_no_efficiency_is_no_loss():
    """η absent = 1, exactly."""
    model = one_joint(None, {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 0.0})
    assert gear_loss(model.bodies[0].drive, 3.0) is None
    assert gear_loss(GEAR.replace(efficiency=None).bodies[0].drive, 3.0) is None


def test_self_locking_is_warned_of():
    """A real gear below 0.5 holds its load by itself, the model does not: loading says so."""
    friction = {"viscous_n_m_s_per_rad": 0.0, "smoothing_rad_per_s": SMOOTH}
    motor = {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 0.0}
    (warning,) = one_joint(friction, {**motor, "gear_efficiency": 0.4}).warnings
    assert "hinge" in warning
    assert "self-locking" in warning
    assert not GEAR.warnings
