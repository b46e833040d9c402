"""Laws of the effects by themselves: they dissipate, they are odd, they are what their energies say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from armwright.actuators.backlash import beyond_gap, flank_depths, pushed
from armwright.actuators.brake import holding
from armwright.actuators.cogging import cogging_energy, cogging_torque
from armwright.actuators.elasticity import transmitted
from armwright.actuators.friction import joint_friction, viscous_torque
from armwright.actuators.lugre import bristle_friction, sliding
from armwright.actuators.stops import stopped
from armwright.actuators.supply import bus
from armwright.actuators.thermal import warmed, warming_rates
from armwright.friction_laws.levels import dry_level
from armwright.model import Brake, Cogging, Drive, Elasticity, Friction, Stops, Supply, Thermal

SPEED = st.floats(-5.0, 5.0)
ANGLE = st.floats(-0.3, 0.3)
COULOMB = Friction(0.8, 2.0, 2.4, 0.0, 3.0, 0.1, 0.05, "lugre", (2e3, 5.0), load_coefficient=0.1, viscous_fall=30.0)
ELASTIC = Elasticity(4e3, 6.0, 1e6, None, (2e-3, 0.4))
PLAY = Elasticity(4e3, 6.0, None, 0.05)


def slope(function, at, step=1e-6):
    return (function(at + step) - function(at - step)) / (2.0 * step)


@given(SPEED)
def test_steady_bristles_are_the_static_map(speed):
    bent = bristle_friction(COULOMB, speed, sliding(COULOMB, speed))
    assert bent.speed == pytest.approx(0.0, abs=1e-12)
    assert bent.torque == pytest.approx(0.8 * speed + np.sign(speed) * dry_level(COULOMB, speed))
    assert bent.rate <= 0.0


@given(SPEED, st.floats(-1e-3, 1e-3), st.floats(-50.0, 50.0))
def test_a_bristle_is_linear_in_itself(speed, z, load):
    """ż(z) = ż(0) + λ z, which the exponential rule rests on."""
    at, nought = (bristle_friction(COULOMB, speed, value, load) for value in (z, 0.0))
    assert at.speed == pytest.approx(nought.speed + nought.rate * z, rel=1e-12, abs=1e-12)


def test_friction_rises_with_load_and_falls_with_temperature():
    assert dry_level(COULOMB, 1.0, -40.0) == pytest.approx(dry_level(COULOMB, 1.0) + 4.0)
    assert viscous_torque(COULOMB, 2.0, 30.0) == pytest.approx(1.6 / np.e)
    assert joint_friction(COULOMB, 2.0, 0.0, 0.0) == joint_friction(COULOMB, 2.0)


@pytest.mark.parametrize(("warming", "share"), [(30.0, 0.7), (1000.0, 1e-3)])
def test_a_warm_gear_grips_less_and_never_nothing(warming, share):
    """By 1 % a kelvin, down to a thousandth of its dry level."""
    warm = replace(COULOMB, load_coefficient=None, coulomb_temperature_coefficient=-0.01)
    cold = bristle_friction(warm, 0.3, 0.0, None, 0.0)
    assert bristle_friction(warm, 0.3, 0.0, None, warming).rate == pytest.approx(cold.rate / share, rel=1e-12)


@given(ANGLE, SPEED, ANGLE, SPEED)
@pytest.mark.parametrize("spring", [ELASTIC, PLAY], ids=["harmonic", "play"])
def test_a_gear_loses_no_power_but_in_its_damper(spring, motor, motor_speed, link, link_speed):
    """In by the motor = out to the link + loss + d/dt energy, and the loss is never negative."""
    at = transmitted(spring, 50.0, motor, motor_speed, link, link_speed)
    assert at.loss >= -1e-9

    def energy(t):
        return transmitted(spring, 50.0, motor + t * motor_speed, 0.0, link + t * link_speed, 0.0).energy

    change = slope(energy, 0.0, 1e-7)
    given_ = at.torque * (at.slope * motor_speed - link_speed)
    assert given_ == pytest.approx(at.loss + change, rel=1e-3, abs=2e-2 * (1.0 + abs(at.torque)))


@given(st.floats(-0.1, 0.1))
def test_flanks_never_pull(deflection):
    pressed = beyond_gap(deflection, 0.05)
    assert abs(pressed) == pytest.approx(max(abs(deflection) - 0.025, 0.0))
    touching = tuple(float(depth >= 0.0) for depth in flank_depths(deflection, 0.05))
    for torque in (-3.0, 0.0, 3.0):
        assert pushed(touching, torque) * deflection >= 0.0
        assert pressed != 0.0 or abs(deflection) == 0.025 or pushed(touching, torque) == 0.0


@given(st.floats(-1.5, 1.5), SPEED)
def test_stops_push_back_and_dissipate(q, speed):
    at = stopped(Stops(5e3, 20.0), -1.0, 1.0, q, speed)
    if abs(q) < 1.0:
        assert (at.torque, at.loss, at.energy) == (0.0, 0.0, 0.0)
    else:
        assert at.torque * np.sign(q) <= 0.0
        assert at.energy == pytest.approx(2500.0 * (abs(q) - 1.0) ** 2)
        assert at.loss >= -1e-9


@given(st.floats(-7.0, 7.0))
def test_cogging_is_the_slope_of_its_energy(angle):
    cogging = Cogging(0.02, 12.0, 0.4)
    assert cogging_torque(cogging, angle) == pytest.approx(
        -slope(lambda a: cogging_energy(cogging, a), angle), abs=1e-7
    )


def test_a_brake_is_a_spring_until_it_slips():
    brake = Brake(30.0, 1e4, 20.0, 0.02, on_motor=False)
    assert holding(brake, 0.0, 1e-3, 1.0).torque == 10.0
    assert holding(brake, 2.0, 30.0 / 1e4, 1.0).speed == pytest.approx(0.0)
    released = holding(brake, 2.0, 1e-3, 0.0)
    assert (released.torque, released.speed, released.rate) == (10.0, pytest.approx(-0.05), pytest.approx(-50.0))


def test_the_rectifier_takes_nothing_back():
    supply = Supply(48.0, 0.4, 5e-3, (52.0, 2.0, 5.0))
    assert bus(supply, 50.0, -100.0).source == 0.0
    assert bus(supply, 50.0, -100.0).speed == pytest.approx(100.0 / 50.0 / 5e-3)
    at = bus(supply, 47.0, 94.0)
    assert (at.source, at.loss) == (pytest.approx(48.0 * 2.5), pytest.approx(0.4 * 2.5**2))
    assert at.speed == pytest.approx((2.5 - 2.0) / 5e-3)
    assert bus(supply, 56.0, 0.0).loss == pytest.approx(56.0**2 / 5.0)


def test_a_warm_motor():
    thermal = Thermal(25.0, 20.0, (8.0, 1.5), (200.0, 3.0), 0.004, -0.001)
    drive = Drive("voltage", torque_constant=0.06, back_emf_constant=0.06, resistance=1.2, thermal=thermal)
    now = warmed(drive, 120.0, 70.0)
    assert now.resistance == pytest.approx(1.2 * 1.4)
    assert now.torque_constant == pytest.approx(0.06 * 0.95) == now.back_emf_constant
    assert warming_rates(thermal, 30.0, 70.0, 25.0) == (pytest.approx(0.0), pytest.approx(0.15))
