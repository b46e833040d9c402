"""Laws of the motor: equations (11) and (12), its power, and brushless constants on every basis."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from actuators.drives import one_joint
from armwright.actuators import drive_torque, motor_current, motor_torque, motor_voltage
from armwright.description.drive import DC_EQUIVALENT
from armwright.errors import ModelError
from physics.arms import arm, random_state

VOLTAGE_DRIVEN = ["cmu-dd", "puma560", "workshop"]


@pytest.mark.parametrize("name", VOLTAGE_DRIVEN)
@pytest.mark.parametrize("seed", range(5))
def test_voltage_and_torque_undo_each_other(name, seed):
    """(12) is the inverse of (11)."""
    model = arm(name)
    qd, tau, volts = random_state(model, seed)
    np.testing.assert_allclose(motor_torque(model, qd, motor_voltage(model, qd, tau)), tau, rtol=0, atol=1e-12)
    voltage = motor_voltage(model, qd, motor_torque(model, qd, volts))
    np.testing.assert_allclose(voltage, volts, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", VOLTAGE_DRIVEN)
@pytest.mark.parametrize("seed", range(5))
def test_electrical_power_is_heat_and_work(name, seed):
    """V i = R i² + tau q̇ where Ke = Kt, whatever the gear's ratio and sign."""
    model = arm(name)
    qd, tau, _ = random_state(model, seed)
    current, voltage = motor_current(model, tau), motor_voltage(model, qd, tau)
    heat = [body.drive.resistance * i**2 for body, i in zip(model.bodies, current, strict=True)]
    np.testing.assert_allclose(voltage * current, heat + tau * qd, rtol=0, atol=1e-12 * np.abs(voltage * current).max())


def test_the_report_direct_drive():
    """V = R tau/Kt + Kt q̇ of the CMU report for n = 1, and stall and no-load follow."""
    motor = {"gear_ratio": 1.0, "rotor_inertia_kg_m2": 0.0, "torque_constant_n_m_per_a": 2.0, "resistance_ohm": 4.0}
    model = one_joint(None, motor, command="voltage")
    assert motor_voltage(model, np.array([3.0]), np.array([5.0])) == 4.0 * 5.0 / 2.0 + 2.0 * 3.0
    assert motor_torque(model, np.array([0.0]), np.array([8.0])) == 2.0 * 8.0 / 4.0
    assert motor_torque(model, np.array([8.0 / 2.0]), np.array([8.0])) == 0.0


def test_back_emf_constant_of_its_own():
    """Ke = Kt unless the record gives both."""
    motor = {"gear_ratio": -10.0, "rotor_inertia_kg_m2": 0.0, "torque_constant_n_m_per_a": 2.0, "resistance_ohm": 4.0}
    model = one_joint(None, {**motor, "back_emf_constant_v_s_per_rad": 1.9}, command="voltage")
    assert motor_voltage(model, np.array([3.0]), np.array([5.0])) == pytest.approx(
        4.0 * 5.0 / (-10 * 2.0) - 10 * 1.9 * 3.0
    )


@pytest.mark.parametrize(
    ("name", "factor"),
    [("lwa4p", 160 * 0.0429), ("panda", 1.0)],
)
def test_commands_in_their_own_unit(name, factor):
    """Amperes give n Kt i, torque is torque."""
    model = arm(name)
    torque = drive_torque(model, np.ones(model.n), np.full(model.n, 2.0))
    assert torque[0] == pytest.approx(2.0 * factor, rel=1e-14)


def test_missing_constants_are_named():
    """A kernel without its constants is refused, naming joint and key."""
    with pytest.raises(ModelError, match="motor_voltage needs it") as error:
        motor_voltage(arm("lwa4p"), np.zeros(6), np.zeros(6))
    assert error.value.place == "joint1.motor.resistance_ohm"
    with pytest.raises(ModelError, match="motor_current needs it") as error:
        motor_current(arm("panda"), np.zeros(7))
    assert error.value.place == "joint1.motor.torque_constant_n_m_per_a"


def as_measured(basis: str) -> dict[str, float]:
    """One three-phase star-connected machine, as a record on that basis: tau = 3/2 k î, v̂ = k ω, R a phase."""
    k, phase_resistance, phase_inductance = 0.08, 0.4, 3e-4
    current = sqrt(0.5) if basis.endswith("rms") else 1.0  # measured amperes per peak phase ampere
    voltage = current * (sqrt(3) if basis.startswith("line") else 1.0)
    impedance = 2.0 if basis.startswith("line") else 1.0
    return {
        "torque_constant_n_m_per_a": 1.5 * k / current,
        "back_emf_constant_v_s_per_rad": k * voltage,
        "resistance_ohm": phase_resistance * impedance,
        "inductance_h": phase_inductance * impedance,
    }


@pytest.mark.parametrize("basis", ["phase_peak", "phase_rms", "line_peak", "line_rms"])
def test_brushless_bases_tell_one_motor(basis):
    """On every basis: Kt = Ke (tau ω = Ke i ω), heat 3/2 R î², flux 3/2 L î²/2, and limits in the same measure."""
    record = {"gear_ratio": 1.0, "rotor_inertia_kg_m2": 0.0, "basis": basis, **as_measured(basis)}
    amps, volts = (sqrt(0.5) if "rms" in basis else 1.0), (sqrt(3) if "line" in basis else 1.0)
    limits = {"current_a": 10.0 * amps, "voltage_v": 20.0 * amps * volts}
    model = one_joint(None, record, limits=limits)
    drive, i = model.bodies[0].drive, 10.0
    assert drive.torque_constant == pytest.approx(1.5 * 0.08, rel=1e-14)
    assert drive.back_emf_constant == pytest.approx(drive.torque_constant, rel=1e-14)
    assert drive.resistance * i**2 == pytest.approx(1.5 * 0.4 * i**2, rel=1e-14)
    assert drive.inductance == pytest.approx(1.5 * 3e-4, rel=1e-14)
    assert model.bodies[0].limits.current == pytest.approx(10.0, rel=1e-14)
    assert model.bodies[0].limits.voltage == pytest.approx(1.5 * 20.0, rel=1e-14)  # power: v i = 3/2 v̂ î
    assert not model.warnings


@pytest.mark.parametrize("basis", DC_EQUIVALENT)
def test_bases_are_power_consistent(basis):
    """Ohm's law holds among the factors: voltage = impedance · current of what was measured, star-connected."""
    factor = DC_EQUIVALENT[basis]
    assert factor.torque_constant * factor.current == pytest.approx(1.0)  # torque is what it is
    assert factor.back_emf_constant == pytest.approx(factor.voltage)  # and so is speed
    # measured volts per measured ohm and ampere: √3 a phase volt over 2 a phase ohm from line to line, else 1
    wiring = sqrt(3) / 2.0 if basis.startswith("line") else 1.0
    assert factor.voltage * wiring == pytest.approx(factor.impedance * factor.current)


def test_a_wrong_basis_is_warned_of():
    """Constants of one basis declared as another give Kt ≠ Ke, and the warning names the basis that would agree."""
    record = {"gear_ratio": 1.0, "rotor_inertia_kg_m2": 0.0, "basis": "dc", **as_measured("line_rms")}
    (warning,) = one_joint(None, record).warnings
    assert "hinge" in warning
    assert 'expected basis = "line_rms"' in warning
