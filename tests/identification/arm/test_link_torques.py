"""Torques of sensors behind the gears: links alone, whatever rotors and friction the motors have, and the sensors' zeros."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from identification.arm.logged_machine import Machine, Motion, read, written
from raises_at import raises_at

ZEROS = np.array([0.4, -0.3, 0.2])  # of the sensors [N m]
KINEMATICS = """
name = "bench"
source = "definition"
[[joints]]
name = "j1"
type = "revolute"
parent = "base"
child = "l1"
dh = { a_m = 0.0, alpha_rad = 0.0, r_m = 0.4, offset_rad = 0.0 }
motor = { gear_ratio = 50 }
[[joints]]
name = "j2"
type = "revolute"
parent = "l1"
child = "l2"
dh = { a_m = 0.3, alpha_rad = 0.0, r_m = 0.0, offset_rad = 0.0 }
"""


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    return Machine.written(tmp_path_factory.mktemp("links"), 3)


@pytest.fixture(scope="module")
def log(machine):
    t = np.arange(8000) / 400
    motion, rng = Motion.of(3, 1).at(t), np.random.default_rng(2)
    torque = machine.torque(*motion, link_only=True) + ZEROS
    torque = torque + 0.01 * torque.std(axis=0) * rng.normal(size=torque.shape)
    path = written(machine.path.parent, "links", machine.names, {"t": t, "position": motion[0], "link torque": torque})
    return read(path)


def test_links_and_zeros_are_found_and_the_record_passes(machine, log, tmp_path):
    found = aw.identification.identify_arm(log, machine.arm)
    base, model = found.fit.base, found.fit.equations.model
    assert {base.columns[k].kind for k in base.independent} == {"inertial", "zero"}
    z = (found.fit.values - base.of(np.nan_to_num(machine.truth(model)))) / found.fit.std
    links = np.array([base.columns[k].kind == "inertial" for k in base.independent])
    assert np.sqrt(np.mean(z[links] ** 2)) < 1.6
    zeros = [found.estimate[f"zero{k}"] for k in (1, 2, 3)]
    np.testing.assert_allclose(zeros, ZEROS, atol=0.02)
    path = found.write(tmp_path / "arm.toml")
    joint = aw.load(path).record.joints[0]
    assert joint.friction is None
    assert joint.motor is None
    assert aw.identification.validate(path, log, simulation=False).passed


def test_friction_of_motors_is_refused(machine, log):
    with raises_at(IdentificationError, "friction", value="viscous"):
        aw.identification.identify_arm(log, machine.arm, friction=("viscous",))


def test_kinematics_need_neither_a_command_nor_rotors(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(KINEMATICS)
    arm = aw.load(path, kinematics_only=True)
    assert arm.names == ["j1", "j2"]
    assert any("no rotor inertia is known" in each for each in arm.record.remarks)
    assert any("no command is stated" in each for each in arm.record.remarks)
