"""A toy member of each family, from one class, is met everywhere that its family is used."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import armwright as aw
import armwright.control
import armwright.trajectory
from armwright import scalar
from armwright.control.gains import gain_units
from armwright.identification.arm import methods
from armwright.identification.arm.identify import identify_arm
from armwright.scenarios import read_scenario, write_scenario
from armwright.signals import Signal
from armwright.trajectory.motion import Motion
from identification.arm.moved_arm import moved
from physics.arms import arm

SMALL = {"progress": False}


def test_a_toy_friction_law_and_a_toy_joint_kind(tmp_path):
    """In a process of their own, in which they are there before the first robot is read."""
    program = Path(__file__).with_name("toys.py")
    paths = os.pathsep.join(path for path in (str(program.parents[1]), os.environ.get("PYTHONPATH")) if path)
    environment = os.environ | {"PYTHONPATH": paths}
    done = subprocess.run(
        [sys.executable, program], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.stdout == "met everywhere\n", done.stderr


@dataclass(frozen=True, eq=False)
class ToySpring:
    """u = k (q_r - q) - d q̇."""

    gain_units: ClassVar[dict[str, str]] = {"stiffness": "U/Q", "damping": "U s/Q"}
    stiffness: Any
    damping: Any = 0.0

    def init(self, arm, y):
        return np.zeros(0)

    def step(self, t, r, y, s):
        return self.stiffness * (r.q - y.q) - self.damping * y.qd, s


@dataclass(frozen=True, eq=False)
class ToyWave(Motion):
    """amplitude (1 - cos(t)), one number for each joint."""

    amplitude: Any
    time: float = 0.0
    duration: float = np.inf

    @property
    def n(self):
        return len(self.amplitude)

    def __call__(self, t):
        a, c, s = scalar.array(self.amplitude), scalar.cos(t), scalar.sin(t)
        return scalar.array(a * (1.0 - c)), scalar.array(a * s), scalar.array(a * c)


@dataclass(frozen=True)
class ToyClock:
    """The time, as a sensor."""

    def signals(self, arm):
        return [Signal("phase", "rad", (1,), about="of the first joint")]

    def measure(self, plant, s, w):
        return {"phase": scalar.array([2.0 * plant.q[0]])}, s


@pytest.fixture
def toys(monkeypatch):
    """A toy controller and a toy trajectory in their rooms."""
    for room, member in ((armwright.control, ToySpring), (armwright.trajectory, ToyWave)):
        monkeypatch.setattr(room, member.__name__, member, raising=False)
        monkeypatch.setattr(room, "__all__", [*room.__all__, member.__name__])


def test_a_toy_controller_and_a_toy_trajectory_have_names_in_files(toys, tmp_path):
    """Read from a scenario file, run compiled, written to one and read again; gains with their units."""
    file = tmp_path / "toys.toml"
    text = """
robot = "two-link"
duration_s = 0.05
[loop]
period_s = 1e-3
[loop.controller]
kind = "toy_spring"
stiffness = [40.0, 20.0]
damping = 3.0
[loop.reference]
kind = "toy_wave"
amplitude = [0.2, 0.1]
"""
    file.write_text(text, encoding="utf-8")
    scenario = read_scenario(file)
    assert isinstance(scenario.loop.controller, ToySpring)
    assert isinstance(scenario.loop.reference, ToyWave)
    run = aw.simulate(scenario, **SMALL)
    assert run.attrs["controller"] == "compiled"
    asked = scenario.loop.controller.stiffness * (run.q_reference - run.q).values - 3.0 * run.qd.values
    np.testing.assert_allclose(run.u.values[:-1], asked[:-1], atol=1e-9)
    write_scenario(scenario, tmp_path / "again.toml")
    again = aw.simulate(read_scenario(tmp_path / "again.toml"), **SMALL)
    np.testing.assert_array_equal(again.q.values, run.q.values)
    assert gain_units(scenario.arm, scenario.loop.controller, "damping") == ["N m s/rad"] * 2
    file.write_text(text.replace("toy_spring", "toy_sprung"), encoding="utf-8")
    with pytest.raises(aw.ArmwrightError, match="toy_spring"):
        read_scenario(file)


def test_a_toy_sensor_is_measured_recorded_and_given_to_the_controller(tmp_path):
    law = lambda t, r, y: 30.0 * (r.q - y.q) - 2.0 * y.qd + 0.0 * y.phase[0]  # noqa: E731
    loop = aw.Loop(law, [0.2, -0.1], 1e-3, sensors=[aw.Sensors(), ToyClock()])
    run = aw.simulate(aw.Scenario(arm("two-link"), duration=0.02, loop=loop), **SMALL)
    np.testing.assert_allclose(run.phase_measured.values[:, 0], 2.0 * run.q.values[:, 0], atol=1e-12)
    assert run.phase_measured.attrs["units"] == "rad"


def test_a_toy_method_of_identification_is_used_by_its_name(monkeypatch, tmp_path):
    """A method is one row, whose words stand in the estimate."""
    toy = methods.Method("a toy's least squares", partial(methods._least_squares, "ols"))
    monkeypatch.setitem(methods.METHODS, "toy", toy)
    found = identify_arm(moved(tmp_path, "toy", arm("two-link")), arm("two-link"), method="toy")
    assert "a toy's least squares" in found.estimate.method
