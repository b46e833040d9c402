"""Torque constants that the simulation knows are found by a known payload, whatever the record says of them."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.arm.drive_gains import identify_drive_gains
from identification.arm.moved_arm import moved, multisine, written_log

MASS, COM, INERTIA = 6.0, (0.15, -0.05, 0.2), np.diag([0.03, 0.04, 0.02])
FACTORS = np.array([0.8, 1.0, 1.15, 1.3, 0.9, 1.0])  # true torque constants by the record's


@pytest.fixture(scope="module")
def arm():
    return aw.load("lwa4p")


def log_of_currents(folder, name, arm, carrying, seed, noise=0.02):
    """Currents that move the arm, of motors whose constants are FACTORS times the record's, with noise [A]."""
    t, q, qd, qdd = multisine(arm.n, 20.0, 200.0, seed)
    constants = np.array([float(b.drive.gear_ratio) * float(b.drive.torque_constant) for b in arm.coordinates])
    current = aw.compile(carrying).inverse_dynamics(q, qd, qdd) / (constants * FACTORS)
    current += noise * np.random.default_rng(seed).normal(size=current.shape)
    return written_log(folder, name, arm.names, t, q, current, "current")


def test_torque_constants_by_a_known_payload(arm, tmp_path):
    empty = log_of_currents(tmp_path, "empty", arm, arm, 0)
    loaded = log_of_currents(tmp_path, "loaded", arm, arm.with_payload(MASS, COM, INERTIA), 5)
    wrong = arm.with_values({"link2.mass_kg": 5.0, "link4.mass_kg": 0.1})  # masses of the arm do not count
    found = identify_drive_gains(empty, loaded, wrong, MASS, COM, INERTIA)
    assert found.verdict == "identified", str(found)
    true = FACTORS * [float(body.drive.torque_constant) for body in arm.coordinates]
    assert found.names[0] == "joint1.motor.torque_constant_n_m_per_a"
    np.testing.assert_allclose(found.values, true, rtol=0.03)
    assert (np.abs(found.values - true) < 4 * found.std).all()
    again = aw.load(aw.write_into(arm, found, tmp_path / "gains.toml"))
    assert float(again.coordinates[2].drive.torque_constant) == pytest.approx(found.values[2])


def test_factors_of_torques_and_what_a_light_payload_does_not_tell(arm, tmp_path):
    empty = moved(tmp_path, "empty", arm, torque_noise=0.3)
    loaded = moved(tmp_path, "loaded", arm.with_payload(MASS, COM, INERTIA), seed=3, torque_noise=0.3)
    found = identify_drive_gains(empty, loaded, arm, MASS, COM, INERTIA)
    assert found.names[1] == "joint2: drive gain"
    known = np.asarray(found.identifiable)
    assert known[1:3].all()
    assert (np.abs(found.values - 1.0)[known] < 4 * found.std[known]).all()
    light = moved(tmp_path, "light", arm.with_payload(0.01, COM, 0.01 * INERTIA), seed=3, torque_noise=0.3)
    vague = identify_drive_gains(empty, light, arm, 0.01, COM)
    assert vague.verdict == "not identified"
    assert not np.asarray(vague.identifiable).any()
    assert any("joint1: the payload hardly loads its motor" in remark for remark in vague.remarks)


def test_bad_input_is_refused(arm, tmp_path):
    log = moved(tmp_path, "empty", arm, seconds=2.0)
    with pytest.raises(IdentificationError, match="mass"):
        identify_drive_gains(log, log, arm, 0.0, COM)
    currents = log_of_currents(tmp_path, "currents", arm, arm, 0)
    with pytest.raises(IdentificationError, match="different signals"):
        identify_drive_gains(log, currents, arm, MASS, COM)
