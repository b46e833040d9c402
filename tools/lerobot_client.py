"""LeRobot's bus classes against simulated servos: connect, configure, homing, calibration, sync read and write, a new id.

    python tools/lerobot_client.py feetech PORT | dynamixel PORT

Runs where LeRobot is, in an environment of its own, made with
`pip install --no-deps lerobot==0.4.4` and `pip install deepdiff tqdm draccus pyserial numpy dynamixel-sdk feetech-servo-sdk`.
What LeRobot imports beside its buses (torch, accelerate, datasets) is replaced by empty modules. The servos are those of
`python -m armwright.twin.serial --servo sts3215:1-6 --path PORT` or `--servo xl330-m288:1-6 --voltage 5 --set baud_rate=3`.
"""

from __future__ import annotations

import importlib
import sys
import time
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock

STUBS = ("torch", "accelerate", "datasets", "datasets.utils", "datasets.utils.logging")
CLASSES = {"feetech": ("FeetechMotorsBus", "sts3215"), "dynamixel": ("DynamixelMotorsBus", "xl330-m288")}
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


class Stub(ModuleType):
    """A module that has every name."""

    __path__: list[str] = []  # noqa: RUF012

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return MagicMock()


def bus(kind: str, port: str, first: int = 1) -> Any:
    """LeRobot's bus with six motors."""
    motors = importlib.import_module("lerobot.motors")
    name, model = CLASSES[kind]
    mode = motors.MotorNormMode.RANGE_M100_100
    joints = {joint: motors.Motor(first + k, model, mode) for k, joint in enumerate(JOINTS)}
    return getattr(importlib.import_module(f"lerobot.motors.{kind}"), name)(port, joints)


def main(kind: str, port: str) -> None:
    """Walks what LeRobot does with an arm, and fails where it does not work."""
    for name in STUBS:
        sys.modules.setdefault(name, Stub(name))
    line = bus(kind, port)
    line.connect()
    with line.torque_disabled():
        line.configure_motors()
        for joint in JOINTS:
            line.write("Operating_Mode", joint, 0 if kind == "feetech" else 3)
            line.write(*(("P_Coefficient", joint, 16) if kind == "feetech" else ("Position_P_Gain", joint, 600)))
    line.disable_torque()
    offsets = line.set_half_turn_homings()
    positions = line.sync_read("Present_Position", normalize=False)
    assert set(positions.values()) == {2047}, (offsets, positions)
    motors = importlib.import_module("lerobot.motors")
    line.write_calibration(
        {joint: motors.MotorCalibration(k + 1, 0, offsets[joint], 1000, 3000) for k, joint in enumerate(JOINTS)}
    )
    assert line.is_calibrated
    line.enable_torque()
    line.sync_write("Goal_Position", dict.fromkeys(JOINTS, 50.0))
    time.sleep(1.0)
    shown = line.sync_read("Present_Position")
    assert all(abs(value - 50.0) < 0.2 for value in shown.values()), shown
    began, times = time.perf_counter(), []
    for _ in range(250):
        due = began + 0.02 * (len(times) + 1)
        start = time.perf_counter()
        line.sync_read("Present_Position")
        line.sync_write("Goal_Position", dict.fromkeys(JOINTS, 40.0))
        times.append(time.perf_counter() - start)
        time.sleep(max(due - time.perf_counter(), 0.0))
    times.sort()
    spent = f"{1e3 * times[125]:.2f} ms, at most {1e3 * times[-1]:.2f} ms"
    print(f"{kind}: 250 cycles at 50 Hz, 0 failed; read and write of six in {spent}")
    line.disable_torque()
    line._disable_torque(6, CLASSES[kind][1])
    address = {"feetech": (5, 1), "dynamixel": (7, 1)}[kind]
    line._write(*address, 6, 16)
    line.disconnect(disable_torque=False)
    assert sorted(bus(kind, port).scan_port(port)[1_000_000]) == [1, 2, 3, 4, 5, 16]
    print(f"{kind}: connected, configured, homed, calibrated, moved, a new id found")


if __name__ == "__main__":
    main(*sys.argv[1:])
