"""The library of servos: entries in an arm of one joint, against the published files, the makers' figures and the serial twin."""

from __future__ import annotations

import json
from math import exp, pi
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import armwright as aw
from armwright.description.paths import quantities
from armwright.description.servos import servo_library, servos
from armwright.errors import DescriptionError
from armwright.identification.estimate import write_numbers
from armwright.quantity import Source
from armwright.twin.serial.frames import FRAMINGS
from armwright.twin.serial.registers import servo_model
from raises_at import raises_at

PUBLISHED = Path(__file__).resolve().parents[3] / "shared" / "data" / "servos"
SERVOS = servos()
POSITION = [name for name, servo in SERVOS.items() if servo.command == "position"]
WITH_SHEET = [name for name, servo in SERVOS.items() if servo.data_sheet is not None]
FILES = {
    "sts3215-7.4v": "feetech_sts3215_7_4V/m1",
    "xl330-m288": "xl330/m6",
    "mx-64": "mx64/m6",
    "mx-106": "mx106/m6",
    "xl-320": "xl320/m6",
    "erob80-50": "erob80_50/m6",
    "erob80-100": "erob80_100/m6",
}
REGISTERS = {
    "sts3215-7.4v": "sts3215",
    "sts3215-12v": "sts3215",
    "xl330-m288": "xl330-m288",
    "xl430-w250": "xl430-w250",
}
GRAVITY, LENGTH = 9.81, 0.1
ARM = """
name = "one"
source = "definition"
gravity_m_s2 = [0.0, 0.0, -9.81]
[[links]]
name = "rod"
mass_kg = {mass}
com_m = [0.1, 0.0, 0.0]
inertia_kg_m2 = {{ xx = 1e-9, yy = 1e-9, zz = 1e-9, xy = 0.0, xz = 0.0, yz = 0.0 }}
[[joints]]
name = "q"
type = "revolute"
parent = "base"
child = "rod"
axis = [0.0, -1.0, 0.0]
frame = {{ xyz_m = [0.0, 0.0, 0.0], rpy_rad = [0.0, 0.0, 0.0] }}
servo = "{servo}"
{extra}
"""


def arm_of(folder, servo, mass=0.01, extra="", change=("", "")):
    """A mass on a rod, level at 0 and lifted by q > 0."""
    path = folder / "one.toml"
    path.write_text(ARM.format(mass=mass, servo=servo, extra=extra).replace(*change), encoding="utf-8")
    return aw.load(path)


def settled(arm, goal, start, duration=3.0):
    """Positions from the start on."""
    schedule = aw.Schedule([0.0], [[goal]], ["q"])
    run = aw.simulate(aw.Scenario(arm, duration=duration, command=schedule, start=[start]), progress=False)
    return run.q.values[:, 0]


def resists(servo, speed, tau_m, tau_e):
    """Torque that the friction resists with, in the published equations."""
    p = {key: 0.0 if value is None else getattr(value, "value", value) for key, value in dict(servo.friction).items()}
    coulomb, viscous = p["coulomb_positive_n_m"], p["viscous_n_m_s_per_rad"] * abs(speed)
    if servo.friction.law == "coulomb":
        return coulomb + viscous
    left = exp(-((abs(speed) / p["stribeck_speed_rad_per_s"]) ** p["stribeck_exponent"]))
    square = 0.0
    if tau_m * tau_e < 0 and abs(tau_m) != abs(tau_e):
        of_external = abs(tau_m) > abs(tau_e)
        key, torque = ("load_external", tau_e) if of_external else ("load_motor", tau_m)
        square = p[f"{key}_quadratic_per_n_m"] * torque**2
    load = abs(p["load_external"] * tau_e - p["load_motor"] * tau_m)
    still = abs(p["load_external_stribeck"] * tau_e - p["load_motor_stribeck"] * tau_m)
    return viscous + coulomb + load + left * (p["stribeck_torque_n_m"] - coulomb + still + square)


@pytest.mark.parametrize("name", SERVOS)
def test_constants_of_the_shaft_are_those_of_the_joint(tmp_path, name):
    """armature = n² J, Kt_shaft = n Kt; the record knows the standard deviations too."""
    arm, shaft = arm_of(tmp_path, name), SERVOS[name].shaft
    drive, motor = arm.coordinates[0].drive, arm.description.joints[0].motor
    n = drive.gear_ratio
    assert drive.command == SERVOS[name].command
    assert n**2 * drive.rotor_inertia == pytest.approx(float(shaft.armature_kg_m2), rel=1e-12)
    assert n * drive.torque_constant == pytest.approx(float(shaft.torque_constant_n_m_per_a), rel=1e-12)
    assert drive.resistance == float(shaft.resistance_ohm)
    assert n * motor.torque_constant_n_m_per_a.std == pytest.approx(shaft.torque_constant_n_m_per_a.std)
    assert aw.mass_matrix(arm, [0.0])[0, 0] == pytest.approx(float(shaft.armature_kg_m2) + 0.01 * LENGTH**2 + 1e-9)


@pytest.mark.parametrize("name", SERVOS)
def test_every_number_has_a_complete_source(tmp_path, name):
    """Publications and data sheets can be found, published fits have a licence, motor constants an uncertainty."""
    servo = SERVOS[name]
    record = arm_of(tmp_path, name).description
    used = {source for _, _, source in quantities(record)} - {"definition"}
    assert used <= set(record.sources)
    of_servo = {source or servo.source for _, _, source in quantities(servo)}
    for key in used | of_servo:
        source = servo_library().sources[key]
        assert source.url or source.kind in ("estimate", "definition")
        if source.kind == "publication":
            assert source.licence == "Apache-2.0"
            assert source.date
        if source.kind in ("publication", "measurement", "estimate"):
            assert any(word in source.text for word in ("std", "uncertainty", "factor", "Chosen", "on their bench")), (
                key
            )
    assert all(number.std is not None for _, number, _ in quantities(servo.shaft))


def test_every_source_is_used():
    used = {source for _, _, source in quantities(servo_library())} | {servo.source for servo in SERVOS.values()}
    assert set(servo_library().sources) == used


@pytest.mark.parametrize("name", FILES)
def test_numbers_are_those_of_the_published_files(name):
    path = PUBLISHED / f"{FILES[name]}.json"
    if not path.is_file():
        pytest.skip(f"the published parameters are not here: {path}")
    p, servo = json.loads(path.read_text(encoding="utf-8")), SERVOS[name]
    friction = servo.friction
    assert float(servo.shaft.armature_kg_m2) == p["armature"]
    assert float(servo.shaft.torque_constant_n_m_per_a) == p["kt"]
    if "R" in p:
        assert float(servo.shaft.resistance_ohm) == p["R"]
    keys = {"viscous_n_m_s_per_rad": "friction_viscous", "coulomb_positive_n_m": "friction_base"}
    keys["coulomb_negative_n_m"] = "friction_base"
    if name != "sts3215-7.4v":
        for load in ("motor", "external"):
            keys |= {f"load_{load}{end}": f"load_friction_{load}{end}" for end in ("", "_stribeck")}
            keys[f"load_{load}_quadratic_per_n_m"] = f"load_friction_{load}_quad"
        keys |= {"stribeck_speed_rad_per_s": "dtheta_stribeck", "stribeck_exponent": "alpha"}
        assert float(friction.stribeck_torque_n_m) == p["friction_base"] + p["friction_stribeck"]
    assert {key: float(getattr(friction, key)) for key in keys} == {key: p[other] for key, other in keys.items()}


@pytest.mark.parametrize("name", WITH_SHEET)
@pytest.mark.parametrize("key", ["stall_torque_n_m", "no_load_speed_rad_per_s"])
def test_motor_and_friction_give_the_figures_of_the_data_sheet(name, key):
    """Within two standard deviations, or the library says that they disagree, and then they do."""
    servo = SERVOS[name]
    sheet, kt, ohm = servo.data_sheet, float(servo.shaft.torque_constant_n_m_per_a), float(servo.shaft.resistance_ohm)

    def motor(speed):
        return kt * (float(sheet.voltage_v) - kt * speed) / ohm

    if key == "stall_torque_n_m":
        found = brentq(lambda load: motor(0.0) - load - resists(servo, 0.0, motor(0.0), -load), 0.0, motor(0.0))
    else:
        top = float(sheet.voltage_v) / kt
        found = brentq(lambda speed: motor(speed) - resists(servo, speed, motor(speed), 0.0), 1e-6, top)
    stated = getattr(sheet, key)
    assert (abs(found - float(stated)) > 2 * stated.std) == (key in servo.disagrees), (found, float(stated))


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", POSITION)
def test_a_servo_goes_to_its_goal_and_sags_under_load(tmp_path, name):
    """With a tenth of its stall torque it stays below the goal from below, and on each side of it without load."""
    servo = SERVOS[name]
    sheet = servo.data_sheet
    loaded = settled(arm_of(tmp_path, name, mass=0.04 * float(sheet.stall_torque_n_m) / GRAVITY / LENGTH), 0.5, 0.0)
    free = arm_of(tmp_path, name, change=("-9.81", "0.0"))
    from_below, from_above = settled(free, 0.5, 0.0), settled(free, 0.5, 1.0)
    assert np.isfinite([loaded, from_below, from_above]).all()
    assert loaded[-1] < from_below[-1] + 2 * pi / 4096
    assert 0.2 < loaded[-1] < 0.5
    assert from_below[-1] == pytest.approx(0.5, abs=0.15)
    assert from_above[-1] == pytest.approx(0.5, abs=0.15)


def test_a_servo_with_more_gain_sags_less(tmp_path):
    """P of the register, beside the entry: 16, as LeRobot writes it, and 32."""
    soft, hard = (
        0.5 - settled(arm_of(tmp_path, "sts3215-7.4v", 0.4, f"[joints.firmware]\np = {p}\n"), 0.5, 0.0)[-1]
        for p in (16, 32)
    )
    assert 0.0 < hard < soft


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["erob80-50", "erob80-100"])
def test_an_actuator_with_current_moves_by_its_torque_constant(tmp_path, name):
    """At rest it takes more than its friction to move it; the current is held to its limit."""
    arm = arm_of(tmp_path, name, mass=1.0)
    runs = [
        aw.simulate(aw.Scenario(arm, duration=0.2, command=[u], start=[0.0]), progress=False) for u in (0.1, 5.0, 50.0)
    ]
    assert np.ptp(runs[0].q.values) == 0.0
    assert runs[1].q.values[-1, 0] > 0.01
    assert runs[2].current.values.max() == pytest.approx(12.0)


@pytest.mark.parametrize("name", REGISTERS)
def test_factory_settings_are_those_of_the_serial_twin(name):
    """Registers of the twin at power-up: gain, counts, dead band, goal speed, baud rate, return delay."""
    servo, model = SERVOS[name], servo_model(REGISTERS[name])
    at_power_up = {register.name: register.default for register in model.registers}
    firmware, bus = servo.firmware, servo.bus
    assert FRAMINGS[bus.protocol] is model.framing
    assert float(bus.baud_bit_per_s) == model.bauds[at_power_up["baud_rate"]]
    assert float(bus.return_delay_s) == pytest.approx(2e-6 * at_power_up["return_delay_time"])
    assert float(firmware.p) == at_power_up["position_p_gain"]
    assert float(firmware.counts_per_turn) == model.counts
    if REGISTERS[name] == "sts3215":
        assert float(firmware.dead_band_counts) == at_power_up["cw_dead_band"]
        assert float(firmware.goal_speed_rad_per_s) == pytest.approx(at_power_up["profile_velocity"] * 2 * pi / 4096)


def test_numbers_of_the_file_stand_before_those_of_the_library(tmp_path):
    extra = """
    [joints.motor]
    gear_ratio = { value = 191.0, source = "estimate" }
    [joints.friction]
    coulomb_positive_n_m = 0.07
    [joints.limits]
    voltage_v = 6.0
    position_rad = [-1.0, 1.0]
    """
    joint = arm_of(tmp_path, "sts3215-7.4v", extra=extra).description.joints[0]
    assert (float(joint.motor.gear_ratio), joint.motor.gear_ratio.source) == (191.0, "estimate")
    assert (float(joint.limits.voltage_v), joint.limits.position_rad.value) == (6.0, (-1.0, 1.0))
    assert float(joint.friction.coulomb_positive_n_m) == 0.07
    assert joint.friction.coulomb_negative_n_m.source == "servos-bam-sts3215"
    other = '[joints.friction]\nlaw = "coulomb"\ncoulomb_positive_n_m = 0.1\ncoulomb_negative_n_m = 0.1\n'
    assert arm_of(tmp_path, "xl330-m288", extra=other).description.joints[0].friction.load_motor is None


@pytest.mark.parametrize(("place", "command"), [("joint", "voltage"), ("file", "current")])
def test_another_command_leaves_the_firmware_out(tmp_path, place, command):
    line = f'command = "{command}"'
    change = ('source = "definition"', f'source = "definition"\n{line}') if place == "file" else ("", "")
    joint = arm_of(tmp_path, "xl330-m288", extra=line if place == "joint" else "", change=change).description.joints[0]
    assert (joint.command, joint.firmware) == (command, None)


@pytest.mark.parametrize("name", SERVOS)
def test_a_written_file_holds_all_numbers(tmp_path, name):
    """Nothing of it names the library: it reads the same with another one."""
    arm = arm_of(tmp_path, name)
    text = aw.robotfiles.to_toml(arm.description)
    assert "servo =" not in text
    path = tmp_path / "written.toml"
    path.write_text(text, encoding="utf-8")
    assert aw.load(path).description == arm.description


@pytest.mark.parametrize("joint", ["shoulder", "elbow"])
def test_two_servos_side_by_side_are_twice_one(joint):
    """Each of WidowX' pair has half of the torques: 2 f(q̇, τ_m, τ_e) = f_pair(q̇, 2 τ_m, 2 τ_e), at the voltage of one."""
    joints = {each.name: each for each in aw.load("widowx250").record.joints}
    pair, one = joints[joint], joints["wrist_angle"]
    for speed, tau_m, tau_e in ((0.0, 1.5, -1.0), (0.4, 0.7, -1.2), (2.0, -0.6, 0.5), (3.0, 1.0, 0.2)):
        twice = resists(pair, speed, 2 * tau_m, 2 * tau_e)
        assert twice == pytest.approx(2 * resists(one, speed, tau_m, tau_e), rel=1e-9)
    assert float(pair.motor.rotor_inertia_kg_m2) == pytest.approx(2 * float(one.motor.rotor_inertia_kg_m2))
    assert float(pair.motor.resistance_ohm) == float(one.motor.resistance_ohm) / 2
    assert pair.motor.torque_constant_n_m_per_a == one.motor.torque_constant_n_m_per_a
    assert float(pair.limits.current_a) == 2 * float(one.limits.current_a)


def test_a_fit_stands_beside_the_servo(tmp_path):
    """A file that names a servo keeps its line; the fitted number gets a table of its own."""
    arm_of(tmp_path, "xl330-m288")
    path, fit = tmp_path / "fitted.toml", Source(kind="fit", text="a log")
    write_numbers(tmp_path / "one.toml", {"q.friction.load_motor": (0.3, 0.01)}, fit, path, "fit")
    assert 'servo = "xl330-m288"' in path.read_text(encoding="utf-8")
    found, before = aw.load(path).description.joints[0], aw.load(tmp_path / "one.toml").description.joints[0]
    assert (float(found.friction.load_motor), found.friction.load_motor.source) == (0.3, "fit")
    assert found.friction.load_external == before.friction.load_external
    assert found.motor == before.motor


def test_a_drive_file_beside_a_urdf_names_servos(tmp_path):
    urdf = """<robot name="one"><link name="base"/><link name="rod"><inertial><origin xyz="0.1 0 0"/><mass value="0.1"/>
    <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="q" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 -1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="10"/><dynamics damping="0.6" friction="0.05"/></joint></robot>"""
    (tmp_path / "one.urdf").write_text(urdf, encoding="utf-8")
    (tmp_path / "one.drive.toml").write_text('[joints.q]\nservo = "sts3215-7.4v"\n', encoding="utf-8")
    joint = aw.load(tmp_path / "one.urdf").description.joints[0]
    assert joint.command == "position"
    assert joint.friction.viscous_n_m_s_per_rad.source == "servos-bam-sts3215"
    assert float(joint.limits.velocity_rad_per_s) == pytest.approx(5.4454)
    (tmp_path / "one.drive.toml").write_text('[joints.q]\nservo = "sts32"\n', encoding="utf-8")
    with raises_at(
        DescriptionError, "joints.q.servo", "sts3215", value="sts32", file=f"{tmp_path / 'one.drive.toml'}:2"
    ):
        aw.load(tmp_path / "one.urdf")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('servo = "sts3215-7.4v"', 'servo = "sts3215"'), "'q' servo = 'sts3215': no such"),
        (('servo = "sts3215-7.4v"', "servo = 3"), "'q' servo = 3: no such"),
        (
            ('type = "revolute"', 'type = "prismatic"'),
            "'q' servo = 'sts3215-7.4v': .*'prismatic'",
        ),
        (
            ("[[links]]", '[sources.servos-bam-code]\nkind = "fit"\ntext = "mine"\n[[links]]'),
            r"sources\.servos-bam-code: .*another key",
        ),
    ],
)
def test_what_no_servo_is_refused_with_its_place(tmp_path, change, words):
    with pytest.raises(DescriptionError, match=words):
        arm_of(tmp_path, "sts3215-7.4v", change=change)
