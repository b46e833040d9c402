"""Effects of drives in a robot file: read, written again, and refused with joint and key where they do not go together."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.description.writer import to_toml
from armwright.errors import DescriptionError
from armwright.model import build_model
from description.reports import check_report

MOTOR = {
    "gear_ratio": 50.0,
    "rotor_inertia_kg_m2": 2e-4,
    "torque_constant_n_m_per_a": 0.06,
    "resistance_ohm": 1.2,
}
COULOMB = {"coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.0, "smoothing_rad_per_s": 0.05}
SPRING = {"stiffness_n_m_per_rad": 4e3, "damping_n_m_s_per_rad": 6.0}
SUPPLY = {"voltage_v": 48.0, "source_resistance_ohm": 0.4, "capacitance_f": 5e-3}
THERMAL = {
    "ambient_c": 25.0,
    "reference_c": 20.0,
    "winding_capacity_j_per_k": 8.0,
    "winding_resistance_k_per_w": 1.5,
}
BRAKE = {**SPRING, "holding_torque_n_m": 30.0, "release_time_s": 0.02}


def record(robot=None, **joint):
    frame = {"frame": {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}, "axis": [0, 1, 0]}
    own = {"name": "hinge", "type": "revolute", "parent": "base", "child": "rod", "command": "voltage", "motor": MOTOR}
    tensor = {"xx": 0.1, "xy": 0, "xz": 0, "yy": 0.1, "yz": 0, "zz": 0.1}
    link = {"name": "rod", "mass_kg": 1.0, "com_m": [0.3, 0, 0], "inertia_kg_m2": tensor}
    return {
        "name": "one",
        "source": "definition",
        "joints": [{**own, **frame, **joint}],
        "links": [link],
        **(robot or {}),
    }


def test_everything_at_once_is_read_and_written():
    lugre = {"law": "lugre", "bristle_stiffness_n_m_per_rad": 2e3, "bristle_damping_n_m_s_per_rad": 5.0}
    given = record(
        {"supply": {**SUPPLY, "chopper_voltage_v": 52.0, "chopper_band_v": 2.0, "chopper_resistance_ohm": 5.0}},
        motor={
            **MOTOR,
            "inductance_h": 1e-3,
            "thermal": THERMAL,
            "cogging": {"amplitude_n_m": 0.01, "periods": 7, "phase_rad": 0.3},
        },
        friction={**COULOMB, **lugre, "viscous_n_m_s_per_rad": 0.8, "viscous_fall_k": 30.0, "load_coefficient": 0.1},
        elasticity={**SPRING, "backlash_rad": 1e-3, "error_rad": 1e-4, "error_phase_rad": 0.0},
        stops=SPRING,
        limits={"position_rad": [-1, 1]},
        brake={**BRAKE, "side": "motor"},
    )
    description = parse(given, "one")
    assert parse(tomllib.loads(to_toml(description)), "one") == description
    (body,) = build_model(description).bodies
    assert body.friction is not None
    assert body.elasticity is not None
    assert body.brake is not None
    assert body.friction.parameters == (2e3, 5.0)
    assert body.elasticity.error == (1e-4, 0.0)
    assert (body.brake.holding, body.brake.stiffness) == (30.0 * 50.0, pytest.approx(4e3 * 2500.0))
    assert description.provenance("hinge.motor.thermal.ambient_c").kind == "definition"


REFUSED = [  # place in the joint, and some of what the error says
    ({"stops": SPRING}, "stops", "needs limits.position_rad, where they stand"),
    ({"elasticity": SPRING, "motor": {**MOTOR, "rotor_inertia_kg_m2": 0}}, "elasticity",
     "needs motor.rotor_inertia_kg_m2 above 0: the mass before the spring"),
    ({"elasticity": {**SPRING, "backlash_rad": 0.1, "cubic_n_m_per_rad3": 1.0}}, "elasticity",
     "cubic_n_m_per_rad3 or backlash_rad, not both: a stiffening gear has"),
    ({"elasticity": {**SPRING, "error_rad": 0.1}}, "elasticity.error_rad", "needs error_phase_rad beside it"),
    ({"elasticity": {**SPRING, "backlsh_rad": 0.1}}, "elasticity.backlsh_rad", "backlash_rad"),
    ({"friction": {**COULOMB, "law": "lugre"}}, "friction.law",
     "needs bristle_stiffness_n_m_per_rad and bristle_damping_n_m_s_per_rad"),
    ({"friction": {**COULOMB, "bristle_damping_n_m_s_per_rad": 1.0}}, "friction.bristle_damping_n_m_s_per_rad",
     'needs law = "lugre"'),
    ({"friction": {"viscous_n_m_s_per_rad": 1.0, "load_coefficient": 0.1}}, "friction.load_coefficient",
     "needs coulomb_positive_n_m and coulomb_negative_n_m, which rise with"),
    ({"friction": {"viscous_n_m_s_per_rad": 1.0, "viscous_fall_k": 9.0}}, "friction.viscous_fall_k",
     "needs motor.thermal, which knows the temperature"),
    ({"friction": {**COULOMB, "viscous_fall_k": 9.0}}, "friction.viscous_fall_k", "needs viscous friction, which falls"),
    ({"motor": {**MOTOR, "current_loop_hz": 100.0}}, "motor.current_loop_hz",
     "needs inductance_h: without, the current follows at once"),
    ({"motor": {**MOTOR, "inductance_h": 1e-3, "current_loop_hz": 100.0}}, "motor.current_loop_hz",
     'command = "current" or "torque": a voltage needs no current loop'),
    ({"motor": {**MOTOR, "pwm": "coast"}}, "motor.pwm", "needs limits.voltage_v or [supply], the voltage that is switched"),
    ({"motor": {**MOTOR, "pwm": "coast"}, "command": "current"}, "motor.pwm", 'command = "voltage", not \'current\''),
    ({"motor": {**MOTOR, "pwm": "coast", "inductance_h": 1e-3}}, "motor.pwm",
     "goes without inductance_h: its law is of a current that dies away in"),
    ({"motor": {**MOTOR, "coupling": [{"joint": "hing", "ratio": 1}]}}, "motor.coupling[0].joint", "hinge"),
    ({"motor": {**MOTOR, "coupling": [{"joint": "hinge", "ratio": 1}]}}, "motor.coupling[0].joint",
     "the joint itself, whose share is gear_ratio"),
    ({"motor": {**MOTOR, "thermal": {**THERMAL, "housing_capacity_j_per_k": 1}}}, "motor.thermal.housing_capacity_j_per_k",
     "needs housing_resistance_k_per_w beside it"),
    ({"motor": {**MOTOR, "resistance_ohm": None, "thermal": THERMAL}, "command": "current"}, "motor.thermal",
     "needs resistance_ohm, whose heat warms the winding"),
    ({"brake": {**BRAKE, "side": "motor"}, "motor": None, "command": "torque"}, "brake.side",
     "needs a [joints.motor] with its gear_ratio"),
]  # fmt: skip


@pytest.mark.parametrize(("joint", "place", "words"), REFUSED)
def test_refusals(joint, place, words):
    with pytest.raises(DescriptionError) as raised:
        parse(record(**joint), "one")
    check_report(raised.value, f"joint 'hinge' {place}", words)


def test_refusals_of_the_supply():
    chopper = {**SUPPLY, "chopper_voltage_v": 40.0, "chopper_band_v": 2.0, "chopper_resistance_ohm": 5.0}
    for supply, place, words in (
        (chopper, "supply.chopper_voltage_v", "more than voltage_v"),
        (
            {**SUPPLY, "chopper_band_v": 2.0},
            "supply.chopper_band_v",
            "needs chopper_voltage_v and chopper_resistance_ohm",
        ),
    ):
        with pytest.raises(DescriptionError) as raised:
            parse(record({"supply": supply}), "one")
        check_report(raised.value, place, words)


def test_a_bus_needs_direct_current_constants():
    with pytest.raises(DescriptionError) as raised:
        parse(record({"supply": SUPPLY}, motor={**MOTOR, "basis": "line_rms"}), "one")
    check_report(raised.value, "joint 'hinge' motor.basis", "[supply] goes with basis = 'dc'")


def test_motors_that_two_joints_turn():
    """tau = B⁻ᵀ r + n² J_m B q̈ and V = R i + n Ke B q̇ with B written out by hand, and back again."""
    data = record()
    first, link = data["joints"][0], data["links"][0]
    second = {**first, "name": "second", "parent": "rod", "child": "tip"}
    second["motor"] = {**MOTOR, "coupling": [{"joint": "hinge", "ratio": 10.0}]}
    arm = build_model(parse({**data, "joints": [first, second], "links": [link, {**link, "name": "tip"}]}, "two"))
    b = np.array([[1.0, 0.0], [10.0 / MOTOR["gear_ratio"], 1.0]])
    rotors = MOTOR["gear_ratio"] ** 2 * MOTOR["rotor_inertia_kg_m2"] * np.eye(2)
    q, qd, qdd = np.array([0.3, -0.8]), np.array([1.5, -0.4]), np.array([3.0, 7.0])
    links = aw.inverse_dynamics(arm.replace(rotors=None), q, qd, qdd)
    tau = aw.inverse_dynamics(arm, q, qd, qdd)
    np.testing.assert_allclose(tau, links + rotors @ b @ qdd, rtol=1e-13)
    bare = build_model(
        parse({**data, "joints": [first, {**second, "motor": MOTOR}], "links": [link, {**link, "name": "tip"}]}, "two")
    )
    np.testing.assert_allclose(
        links, np.linalg.solve(b.T, aw.inverse_dynamics(bare.replace(rotors=None), q, qd, qdd)), rtol=1e-13
    )
    np.testing.assert_allclose(aw.forward_dynamics(arm, q, qd, tau), qdd, rtol=1e-12)
    np.testing.assert_allclose(
        aw.mass_matrix(arm, q), aw.mass_matrix(bare.replace(rotors=None), q) + b.T @ rotors @ b, rtol=1e-13
    )
    kinetic, _ = aw.energy(arm, q, qd)
    assert kinetic == pytest.approx(0.5 * qd @ aw.mass_matrix(arm, q) @ qd, rel=1e-13)
    volts = aw.motor_voltage(arm, qd, tau)
    constant = MOTOR["gear_ratio"] * MOTOR["torque_constant_n_m_per_a"]
    np.testing.assert_allclose(volts, MOTOR["resistance_ohm"] * tau / constant + constant * (b @ qd), rtol=1e-13)
    np.testing.assert_allclose(aw.forward_arm(arm, q, qd, volts), qdd, rtol=1e-12)
    assert len(aw.gravity_torques(arm, [0, 0])) == 2
