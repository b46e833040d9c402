"""The example of the page on drives is a robot, with every state that the page speaks of."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np

import armwright as aw
from armwright.description.firmware import FirmwareRecord
from armwright.simulation.plant.plant import Plant

PAGE = Path(__file__).resolve().parents[2] / "docs" / "drives.md"


def test_the_example_is_a_robot_that_moves(tmp_path):
    table, servo, text = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    with_table = text.replace("[joints.motor.thermal]", f"{table}\n[joints.motor.thermal]")
    (tmp_path / "table.toml").write_text(with_table, encoding="utf-8")
    assert aw.load(tmp_path / "table.toml").bodies[0].drive.efficiency.speeds == (0.5, 2.0)
    assert FirmwareRecord(**tomllib.loads(servo)["joints"]["firmware"]).p.number == 16
    (tmp_path / "pendulum.toml").write_text(text, encoding="utf-8")
    plant = Plant.of(aw.load(tmp_path / "pendulum.toml"), brakes=True)
    assert plant.layout.names == (
        *("q", "qd", "motor_q", "motor_qd", "current", "bristle", "brake"),
        *("winding_temperature", "housing_temperature", "bus_voltage"),
    )
    assert np.isfinite(plant.derivative(plant.initial([0.1], [0.2]), np.array([12.0]))).all()
