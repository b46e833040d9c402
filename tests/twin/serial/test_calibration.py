"""Stored calibrations: files of ours and of LeRobot, what they decide, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import BusError
from armwright.twin.serial.arm_servos import ServoFit
from armwright.twin.serial.calibration import Calibration, StoredServo, read_calibration
from armwright.twin.serial.capture import plan_capture
from armwright.twin.serial.servo_arm import Line
from raises_at import raises_at
from simulation.test_servo import PLAIN, pendulum

JOINTS = ("hip", "knee")
LIMITS = {"voltage_v": 5.0, "position_rad": [-1.5, 1.5], "velocity_rad_per_s": 4.0}
# As LeRobot 0.4.4 writes it, with a joint that the arm does not have.
LEROBOT = {
    "knee": {"id": 3, "drive_mode": 0, "homing_offset": -1021, "range_min": 1600, "range_max": 3061},
    "hip": {"id": 7, "drive_mode": 0, "homing_offset": 14, "range_min": 830, "range_max": 3061},
    "gripper": {"id": 6, "drive_mode": 0, "homing_offset": 1, "range_min": 2034, "range_max": 3500},
}


@pytest.fixture(scope="module")
def arm():
    return pendulum(PLAIN, JOINTS, limits=LIMITS)


def written(path, table):
    path.write_text(json.dumps(table), encoding="utf-8")
    return path


def test_a_file_of_lerobot_decides_ids_and_limits(arm, tmp_path):
    fit = ServoFit.of(arm, Line(), read_calibration(written(tmp_path / "so.json", LEROBOT)))
    assert fit.ids == [7, 3]
    count = 2.0 * np.pi / 4096.0
    assert fit.allowed[0] == pytest.approx([-(2048 - 830) * count if (2048 - 830) * count < 1.5 else -1.5, 1.5])
    assert fit.allowed[1] == pytest.approx([-(2048 - 1600) * count, 1.5])
    moved = aw.trajectories.Waypoints([[0.0, -0.8], [0.0, 0.0]], times=[0.0, 1.0])
    with raises_at(BusError, "joint 'knee'", r"-0\.8 rad.*encoder"):
        plan_capture(arm, moved, Line(), calibration=fit.calibration)


def test_a_file_comes_back_with_zeros_and_directions(arm, tmp_path):
    servo = StoredServo(id=1, homing_offset=0, range_min=0, range_max=4095, model_number=777, firmware="3.10")
    mine = Calibration({"hip": servo.replace(zero=1000.0), "knee": servo.replace(id=2, reversed=True)})
    mine.write(tmp_path / "arm.calibration.json")
    found = read_calibration(tmp_path / "arm.calibration.json")
    assert found.joints == mine.joints
    fit = ServoFit.of(arm, Line(), found)
    assert [at.zero for at in fit.mountings] == [1000.0, 2048.0]
    assert [at.direction for at in fit.mountings] == [1, -1]
    for field, line in (
        ("zeros", Line(zeros=[1.0, 2.0])),
        ("reversed", Line(reversed=["hip"])),
        ("ids", Line(ids=[2, 1])),
    ):
        with pytest.raises(BusError, match=rf"{field} = "):
            ServoFit.of(arm, line, found)


def test_every_difference_is_named():
    servo = StoredServo(id=4, homing_offset=7, range_min=100, range_max=4000, model_number=777, firmware="3.10")
    stored = Calibration({"hip": servo}, "arm.json")
    stored.check(Calibration({"hip": servo}))
    for key, value in {"homing_offset": 8, "range_min": 99, "range_max": 1, "firmware": "3.9", "drive_mode": 1}.items():
        found = Calibration({"hip": servo.replace(**{key: value})})
        with raises_at(BusError, f"{key} of joint 'hip', servo 4", r"arm\.json", value=value):
            stored.check(found)
        plain = replace(stored, joints={"hip": servo.replace(**{key: None})}) if key == "firmware" else None
        if plain:
            plain.check(found)


WRONG = {
    "no JSON": ("no", "no JSON"),
    "a list": ([1], "expected a table of joints, by name"),
    "no joints": ({}, "expected a table of joints, by name"),
    "a key that is missing": ({"hip": {"id": 1, "homing_offset": 0, "range_min": 0}}, "joint 'hip' range_max: missing"),
    "an unknown key": ({"hip": {**LEROBOT["hip"], "offset": 0}}, "joint 'hip' offset = 0: unknown key"),
    "a number that is none": (
        {"hip": {**LEROBOT["hip"], "id": 1.5}},
        r"joint 'hip' id = 1\.5: expected a whole number",
    ),
    "an id twice": ({"hip": LEROBOT["hip"], "knee": LEROBOT["hip"]}, "joint 'hip' id = 7: of several joints"),
    "a range upside down": (
        {"hip": {**LEROBOT["hip"], "range_min": 3061}},
        "range_max = 3061: expected above range_min",
    ),
}


@pytest.mark.parametrize(("table", "words"), WRONG.values(), ids=WRONG)
def test_a_file_that_is_wrong_is_refused_by_name(tmp_path, table, words):
    path = tmp_path / "arm.json"
    path.write_text(table if isinstance(table, str) else json.dumps(table), encoding="utf-8")
    with pytest.raises(BusError, match=words) as error:
        read_calibration(path)
    assert str(path) in str(error.value)


def test_a_calibration_of_another_arm_is_refused(arm, tmp_path):
    found = read_calibration(written(tmp_path / "arm.json", {"hip": LEROBOT["hip"]}))
    with raises_at(BusError, "calibration", value="knee"):
        ServoFit.of(arm, Line(), found)
    turned = {name: {**servo, "drive_mode": 1} for name, servo in LEROBOT.items()}
    turned = read_calibration(written(tmp_path / "turned.json", turned))
    with raises_at(BusError, "joint 'hip' drive_mode", "--reverse", value=1):
        ServoFit.of(arm, Line(), turned)
    assert ServoFit.of(arm, Line("xl330-m288"), turned).ids == [7, 3]
