"""Effects of drives in a robot file: read, written again, and refused with joint and key where they do not go together."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.actuators.coupling import from_motors, shares_of, to_motors
from armwright.actuators.friction import joint_friction
from armwright.description.database import parse
from armwright.description.writer import to_toml
from armwright.errors import DescriptionError, ModelError
from armwright.export.drive_file import drive_file
from armwright.export.losses import of_all_formats, of_friction
from armwright.model import build_model
from armwright.simulation.plant.plant import Plant
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
TABLE = {"torque_n_m": [5.0, 20.0], "rows": [{"driving": [0.5, 0.8], "driven_back": [0.3, 0.7]}]}
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


def test_a_brake_without_stiffness_is_rigid():
    """Its torque is referred to the joint, and the record is written back as it is."""
    description = parse(record(brake={"holding_torque_n_m": 0.5, "side": "motor"}), "one")
    assert parse(tomllib.loads(to_toml(description)), "one") == description
    (body,) = build_model(description).bodies
    assert body.brake is not None
    assert body.brake.is_rigid
    assert body.brake.holding == 0.5 * 50.0


def table(gear_efficiency=None, **keys):
    """Keys of a joint whose gear has a table with some keys changed; None takes one away."""
    record_ = {key: value for key, value in {**TABLE, **keys}.items() if value is not None}
    own = {} if gear_efficiency is None else {"gear_efficiency": gear_efficiency}
    return {"friction": COULOMB, "motor": {**MOTOR, "gear_efficiency_table": record_, **own}}


def test_a_table_is_read_written_and_varied():
    """Its numbers go through TOML and back, are parameters by path, vary, and are refused where none could stand."""
    rows = [
        {"speed_rad_per_s": 0.1, "driving": [0.5, 0.8], "driven_back": [0.3, 0.7]},
        {"speed_rad_per_s": 2.0, "driving": [0.4, 0.7]},
    ]
    description = parse(record(**table(rows=rows)), "one")
    assert parse(tomllib.loads(to_toml(description)), "one") == description
    model = build_model(description)
    efficiency = model.bodies[0].drive.efficiency
    assert efficiency.speeds == (0.1, 2.0)
    assert efficiency.driven_back == ((0.3, 0.7), (0.4, 0.7))
    assert model.replace(efficiency=None).bodies[0].drive.efficiency is None
    path = "hinge.motor.gear_efficiency_table"
    assert model.parameters[f"{path}.rows[1].driving[0]"].value == 0.4
    assert model.parameters[f"{path}.torque_n_m[1]"].unit == "N m"
    names = [f"{path}.rows[1].driving", f"{path}.torque_n_m[0]", f"{path}.rows[0].speed_rad_per_s"]
    dynamics, given = aw.compile(model, vary=names), (np.zeros(1), np.array([1.3]), np.array([2.0]))
    other = aw.compile(build_model(parse(record(**table(
        torque_n_m=[6.0, 20.0], rows=[{**rows[0], "speed_rad_per_s": 0.3}, {**rows[1], "driving": [0.45, 0.75]}]
    )), "one")))  # fmt: skip
    expected = other.inverse_dynamics(*given)
    np.testing.assert_allclose(dynamics.inverse_dynamics(*given, [0.45, 0.75, 6.0, 0.3]), expected, rtol=1e-13)
    for values, place in (
        ([0.4, 1.2, 5.0, 0.1], f"parameters[0] {path}.rows[1].driving"),
        ([0.9, 0.1, 5.0, 0.1], f"parameters[0] {path}.rows[1].driving"),
        ([0.4, 0.7, 30.0, 0.1], f"parameters[0] {path}.torque_n_m"),
        ([0.4, 0.7, 5.0, 3.0], f"parameters[0] {path}.rows[1].speed_rad_per_s"),
    ):
        with pytest.raises(ModelError) as raised:
            dynamics.inverse_dynamics(*given, values)
        assert raised.value.place == place


def test_a_table_that_locks_itself_is_warned_of():
    """By its efficiency under the largest load."""
    (warning,) = build_model(parse(record(**table(rows=[{"driving": [0.4, 0.45]}])), "one")).warnings
    assert "gear_efficiency_table.rows[0].driving" in warning
    assert "self-locking" in warning
    assert not build_model(parse(record(**table()), "one")).warnings


def test_friction_changes_with_temperature_in_the_plant():
    """Torque that a joint resists with at 25 and at 85 °C: level · (1 + α ΔT) of both parts, from 20 °C on, never below 0."""
    friction = {**COULOMB, "viscous_n_m_s_per_rad": 0.8, "viscous_temperature_coefficient_per_k": -0.01}
    friction["coulomb_temperature_coefficient_per_k"] = 0.005
    model = build_model(parse(record(friction=friction, motor={**MOTOR, "thermal": THERMAL}), "one"))
    (sliding,) = (body.friction for body in model.bodies)
    s = 3.0 / np.hypot(3.0, 0.05)
    for warming, viscous, coulomb in ((5.0, 0.95, 1.025), (65.0, 0.35, 1.325), (120.0, 0.0, 1.6)):
        expected = viscous * 0.8 * 3.0 + coulomb * 2.0 * s
        assert joint_friction(sliding, 3.0, warming=warming) == pytest.approx(expected, rel=1e-13)
    assert joint_friction(sliding, 3.0) == pytest.approx(0.8 * 3.0 + 2.0 * s, rel=1e-13)
    plant = Plant.of(model)
    x = plant.initial([0.0], [3.0])
    cold = plant.outputs(x, np.zeros(1))["friction_loss"][0]
    plant.part(x, "winding_temperature")[:] = 85.0
    warm = plant.outputs(x, np.zeros(1))["friction_loss"][0]
    assert cold == pytest.approx(3.0 * joint_friction(sliding, 3.0, warming=5.0), rel=1e-12)
    assert warm == pytest.approx(3.0 * joint_friction(sliding, 3.0, warming=65.0), rel=1e-12)


def test_other_formats_say_that_they_cannot_hold_it(tmp_path):
    """URDF and MJCF list the table, the load and the temperature; the drive file beside a URDF has them."""
    friction = {**COULOMB, "load_coefficient": 0.1, "coulomb_temperature_coefficient_per_k": -0.003}
    motor = {**MOTOR, "gear_efficiency_table": TABLE, "thermal": THERMAL}
    description = parse(record(friction=friction, motor=motor), "one")
    losses = [*of_all_formats(description), *of_friction(description)]
    for what in ("gear efficiency", "load_coefficient", "coulomb_temperature_coefficient_per_k"):
        assert any(what in loss and "hinge" in loss for loss in losses)
    written = tomllib.loads(drive_file(description))["joints"]["hinge"]
    assert written["motor"]["gear_efficiency_table"]["rows"][0]["driven_back"] == [0.3, 0.7]
    assert written["friction"]["load_coefficient"] == 0.1


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
    ({"friction": {**COULOMB, "load_coefficient": 1.0}}, "friction.load_coefficient", "a number of 0 or more, below 1"),
    ({"friction": {**COULOMB, "viscous_temperature_coefficient_per_k": -0.01}}, "friction.viscous_temperature_coefficient_per_k",
     "needs viscous friction, which changes"),
    ({"friction": {"viscous_n_m_s_per_rad": 1.0, "coulomb_temperature_coefficient_per_k": -0.01}},
     "friction.coulomb_temperature_coefficient_per_k", "needs coulomb_positive_n_m and coulomb_negative_n_m, which change"),
    ({"friction": {"viscous_n_m_s_per_rad": 1.0, "viscous_fall_k": 30.0, "viscous_temperature_coefficient_per_k": -0.01}},
     "friction.viscous_temperature_coefficient_per_k", "goes without viscous_fall_k"),
    ({"friction": {**COULOMB, "coulomb_temperature_coefficient_per_k": -0.01}},
     "friction.coulomb_temperature_coefficient_per_k", "needs motor.thermal, which knows the temperature"),
    (table(gear_efficiency=0.8), "motor.gear_efficiency_table", "goes without gear_efficiency"),
    (table(torque_n_m=None, force_n=[5.0, 20.0]), "motor.gear_efficiency_table.force_n", "torque_n_m"),
    (table(force_n=[5.0, 20.0]), "motor.gear_efficiency_table", "either torque_n_m or force_n"),
    (table(torque_n_m=[5.0, 5.0]), "motor.gear_efficiency_table.torque_n_m", "numbers above 0, each above the one before"),
    (table(torque_n_m=[5.0, 5.0 + 1e-12]), "motor.gear_efficiency_table.torque_n_m",
     "numbers above 0, each above the one before"),
    (table(torque_n_m=[0.0, 5.0]), "motor.gear_efficiency_table.torque_n_m", "numbers above 0, each above the one before"),
    (table(torque_n_m=[5.0]), "motor.gear_efficiency_table.rows[0].driving", "1 numbers, one for each of torque_n_m"),
    (table(rows=[]), "motor.gear_efficiency_table.rows", "1 or more, not 0"),
    (table(rows=[{"driving": [0.5, 1.1]}]), "motor.gear_efficiency_table.rows[0].driving", "numbers above 0, at most 1"),
    (table(torque_n_m=[5.0, 6.0]), "motor.gear_efficiency_table.rows[0].driving",
     "the torque into the gear, T / η, does not rise from torque_n_m 5 to 6"),
    (table(rows=[{"driving": [0.9, 0.9], "driven_back": [0.8, 0.2]}]), "motor.gear_efficiency_table.rows[0].driven_back",
     "the torque into the gear, T η, does not rise from torque_n_m 5 to 20"),
    (table(rows=[{"driving": [0.8, 0.2]}]), "motor.gear_efficiency_table.rows[0].driving",
     "the torque into the gear, T η, does not rise from torque_n_m 5 to 20"),
    (table(rows=[{"driving": [0.5, 0.8]}, {"driving": [0.5, 0.8]}]), "motor.gear_efficiency_table.rows[0].speed_rad_per_s",
     "a speed in each of several rows"),
    (table(rows=[{"speed_rad_per_s": 1.0, "driving": [0.5, 0.8]}] * 2), "motor.gear_efficiency_table.rows[1].speed_rad_per_s",
     "more than 1, that of the row before"),
    (table(rows=[{"speed_rad_per_s": w, "driving": [0.5, 0.8]} for w in (1.0, 1.0 + 1e-8, 1e9)]),
     "motor.gear_efficiency_table.rows[1].speed_rad_per_s", "more than 1, that of the row before"),
    (table(rows=[{"speed_m_per_s": 1.0, "driving": [0.5, 0.8]}]), "motor.gear_efficiency_table.rows[0].speed_m_per_s",
     "speed_rad_per_s"),
    ({"motor": {**MOTOR, "current_loop_hz": 100.0}}, "motor.current_loop_hz",
     "needs inductance_h: without, the current follows at once"),
    ({"motor": {**MOTOR, "inductance_h": 1e-3, "current_loop_hz": 100.0}}, "motor.current_loop_hz",
     'command = "current" or "torque": a voltage needs no current loop'),
    ({"motor": {**MOTOR, "pwm": "coast"}}, "motor.pwm", "needs limits.voltage_v or [supply], the voltage that is switched"),
    ({"motor": {**MOTOR, "pwm": "coast"}, "command": "current"}, "motor.pwm", 'command = "voltage", not \'current\''),
    ({"motor": {**MOTOR, "dead_zone_v": 0.5}, "command": "current"}, "motor.dead_zone_v",
     'command = "voltage", not \'current\''),
    ({"motor": {**MOTOR, "pwm": "coast", "inductance_h": 1e-3}}, "motor.pwm",
     "goes without inductance_h: its law is of a current that dies away in"),
    ({"motor": {**MOTOR, "coupling": [{"joint": "hing", "ratio": 1}]}}, "motor.coupling[0].joint", "hinge"),
    ({"motor": {**MOTOR, "coupling": [{"joint": "hinge", "ratio": 1}]}}, "motor.coupling[0].joint",
     "the joint itself, whose share is gear_ratio"),
    ({"motor": {**MOTOR, "thermal": {**THERMAL, "housing_capacity_j_per_k": 1}}}, "motor.thermal.housing_capacity_j_per_k",
     "needs housing_resistance_k_per_w beside it"),
    ({"motor": {**MOTOR, "resistance_ohm": None, "thermal": THERMAL}, "command": "current"}, "motor.thermal",
     "needs resistance_ohm, whose heat warms the winding"),
    ({"brake": {"holding_torque_n_m": 30.0, "stiffness_n_m_per_rad": 1e4}}, "brake.stiffness_n_m_per_rad",
     "needs damping_n_m_s_per_rad and release_time_s beside it"),
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


def coupled_pair(share_of_first: float, share_of_second: float) -> dict[str, Any]:
    """Two joints whose motors, of ratio 50 or as in MOTOR, each turn with both."""
    data = record()
    first, link = data["joints"][0], data["links"][0]
    second = {**first, "name": "second", "parent": "rod", "child": "tip"}
    first = {**first, "motor": {**MOTOR, "coupling": [{"joint": "second", "ratio": share_of_first}]}}
    second["motor"] = {**MOTOR, "coupling": [{"joint": "hinge", "ratio": share_of_second}]}
    return {**data, "joints": [first, second], "links": [link, {**link, "name": "tip"}]}


def test_motors_that_cannot_turn_every_joint_are_refused():
    """N singular, or nearly so."""
    n = MOTOR["gear_ratio"]
    for close in (0.0, 1e-8):
        with pytest.raises(DescriptionError) as raised:
            parse(coupled_pair(n, n * (1.0 + close)), "two")
        check_report(raised.value, "joint 'hinge' motor.coupling", "invertible matrix")


def test_strongly_coupled_motors_lose_no_more_digits_than_they_must():
    """q̈ → tau → q̈ with det N at 1e-4 of its size: by elimination, not by its square."""
    n = MOTOR["gear_ratio"]
    arm = build_model(parse(coupled_pair(n, n * (1.0 + 1e-4)), "two"))
    q, qd, qdd = np.array([0.3, -0.8]), np.array([1.5, -0.4]), np.array([3.0, 7.0])
    back = aw.forward_dynamics(arm, q, qd, aw.inverse_dynamics(arm, q, qd, qdd))
    np.testing.assert_allclose(back, qdd, rtol=1e-7)
    np.testing.assert_allclose(from_motors(shares_of(arm), to_motors(shares_of(arm), qd)), qd, rtol=1e-11)


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
