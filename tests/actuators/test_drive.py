"""Laws of drives with limits: what is asked for is given within them, and equations (11) and (12) hold of the result."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from actuators.drives import one_joint
from armwright.actuators import demanded_drive, holding_command, limited_drive
from armwright.actuators.motor import joint_constant, joint_current, joint_voltage
from armwright.actuators.winding import driven_winding
from armwright.model import Model
from armwright.program import evaluate, trace
from armwright.scalar import Symbol
from features.cases import arms

MOTOR = {"rotor_inertia_kg_m2": 1e-4, "torque_constant_n_m_per_a": 0.2, "resistance_ohm": 4.0}
LIMITS = [{}, {"current_a": 1.5}, {"torque_n_m": 2.0}, {"current_a": 1.5, "torque_n_m": 2.0}]
COMMANDS = ("voltage", "current", "torque")


def driven(command: str, gear: float, limits: dict[str, float], **motor: float) -> Model:
    return one_joint(None, {**MOTOR, "gear_ratio": gear, **motor}, command=command, limits=limits)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("gear", [10.0, -10.0])
@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("supply", [{}, {"voltage_v": 12.0}])
def test_limits_hold_and_the_result_is_one_motor(command, gear, limits, supply):
    """V = R i + n Ke q̇ and tau = n Kt i always; limits of current and torque unless the supply is too weak to hold them."""
    model = driven(command, gear, {**limits, **supply})
    drive = model.bodies[0].drive
    most = min(limits.get("current_a", np.inf), limits.get("torque_n_m", np.inf) / abs(gear * 0.2))
    for speed, u in product((-2.0, 0.0, 1.0, 30.0), (-50.0, -0.1, 0.0, 0.3, 50.0)):
        output = limited_drive(model, np.array([speed]), np.array([u]))
        tau, voltage, current = output.tau[0], output.voltage[0], output.current[0]
        assert current == pytest.approx(joint_current(drive, tau))
        assert voltage == pytest.approx(joint_voltage(drive, speed, tau))
        assert abs(voltage) <= supply.get("voltage_v", np.inf) * (1 + 1e-12)
        if abs(voltage) < supply.get("voltage_v", np.inf) * (1 - 1e-12):
            assert abs(current) <= most * (1 + 1e-12)
            asked = {"voltage": voltage, "current": current, "torque": tau}[command]
            assert asked == pytest.approx(u) or abs(current) == pytest.approx(most)


def test_a_torque_that_no_limit_touches_is_what_was_asked():
    """To the last bit: it does not go through amperes or volts and back."""
    model = driven("torque", 7.3, {"current_a": 100.0})
    u = np.random.default_rng(0).normal(size=100)
    assert all(limited_drive(model, np.array([0.4]), np.array([x])).tau[0] == x for x in u)


def test_magnets_that_lost_a_tenth_take_a_tenth_of_the_torque():
    """A drive that is commanded by torque gives the current of its record's constant, within its limit of current."""
    body = driven("torque", -7.3, {"current_a": 1.5}).bodies[0]
    warm = replace(body.drive, torque_constant=0.9 * 0.2, back_emf_constant=0.9 * 0.2)
    for asked, current in ((1.0, 1.0 / (-7.3 * 0.2)), (50.0, -1.5)):
        found = driven_winding(body, warm, 0.4, asked, np.inf)
        assert found.current == pytest.approx(current)
        assert found.torque == pytest.approx(0.9 * -7.3 * 0.2 * current)


@pytest.mark.parametrize("command", COMMANDS)
def test_limits_hold_for_a_constant_that_is_fitted(command):
    """With Kt a symbol the torque limit holds as it does for the number."""
    model = driven(command, -10.0, {"torque_n_m": 2.0, "current_a": 5.0})

    def with_constant(kt):
        (body,) = model.bodies
        drive = replace(body.drive, torque_constant=kt, back_emf_constant=kt)
        return replace(model, bodies=(replace(body, drive=drive),))

    def torque(kt, u):
        return limited_drive(with_constant(kt[0]), np.array([0.5]), u).tau

    program = trace("torque", torque, {"kt": (1,), "u": (1,)}, ("tau",))
    for u, kt in product((-50.0, 0.2, 50.0), (0.2, 0.05)):
        expected = limited_drive(with_constant(kt), np.array([0.5]), np.array([u])).tau
        assert abs(expected[0]) <= 2.0 * (1 + 1e-12)
        (tau,) = evaluate(program.instructions, [[kt]], [[u]])
        np.testing.assert_allclose(tau[0], expected, rtol=1e-12)


def test_what_torques_ask_of_the_motors():
    """Of one state or many; NaN where the record has not the constants."""
    model = driven("torque", 10.0, {"current_a": 0.1})
    drive = model.bodies[0].drive
    qd, tau = np.array([[1.0, 2.0, 3.0]]), np.array([[4.0, -5.0, 6.0]])
    asked = demanded_drive(model, qd, tau)
    np.testing.assert_array_equal(asked.current, tau / joint_constant(drive))
    np.testing.assert_array_equal(asked.voltage, joint_voltage(drive, qd, tau))
    bare = demanded_drive(one_joint(), qd[:, 0], tau[:, 0])
    assert np.isnan([*bare.current, *bare.voltage]).all()
    assert demanded_drive(model, np.array([Symbol.named("w")]), tau[:, 0]).voltage.shape == (1,)


def test_a_servo_without_proportional_gain_has_no_error_that_holds_a_load():
    servo = arms("servo")[0]
    loaded = servo.with_values({"joint1.firmware.p": 0.0})
    assert loaded.coordinates[1].drive.firmware.proportional == 0.0
    assert holding_command(loaded, np.array([0.0, 2.0]))[1] == 0.0
    assert holding_command(servo, np.array([0.0, 2.0]))[1] != 0.0
