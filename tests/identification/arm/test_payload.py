"""A payload that the simulation knows is found, and what the motion cannot tell is said."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import LogError
from armwright.identification.arm.payload import (
    NAMES,
    identify_payload,
    payload_model,
    with_identified_payload,
)
from armwright.identification.arm.samples import stream_of
from identification.arm.moved_arm import moved
from identification.arm.two_runs import two_runs

MASS, COM = 2.0, (0.02, -0.03, 0.08)
INERTIA = np.array([[0.012, 0.001, 0.002], [0.001, 0.010, -0.001], [0.002, -0.001, 0.006]])
TRUTH = np.array([MASS, *COM, 0.012, 0.001, 0.002, 0.010, -0.001, 0.006])
NOISE = {"torque_noise": 0.5, "position_noise": 2e-5}


@pytest.fixture(scope="module")
def arm():
    return aw.load("lwa4p")


def test_columns_are_those_of_the_arm_with_a_payload(arm):
    model, loaded = payload_model(arm), arm.with_payload(MASS, COM, INERTIA)
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.normal(size=(3, 20, arm.n))
    more = aw.compile(loaded).inverse_dynamics(q, qd, qdd) - aw.compile(arm).inverse_dynamics(q, qd, qdd)
    c = np.array(COM)
    about = INERTIA + MASS * (c @ c * np.eye(3) - np.outer(c, c))
    parameters = [MASS, *(MASS * c), *(about[i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))]
    np.testing.assert_allclose(model.rows(q, qd, qdd) @ parameters, more, atol=1e-9)


@pytest.mark.study
def test_two_kilograms_within_one_per_cent_from_one_log(arm, tmp_path):
    log = moved(tmp_path, "loaded", arm.with_payload(MASS, COM, INERTIA), **NOISE)
    found = identify_payload(log, arm)
    assert found.verdict == "identified"
    assert found["payload.mass_kg"] == pytest.approx(MASS, rel=0.01)
    assert (np.abs(found.values - TRUTH)[:4] < 4 * found.std[:4]).all()
    assert (found.std[:4] < [0.02, 0.005, 0.005, 0.005]).all()
    assert "it leaves the mass least uncertain" in found.remarks[-1]
    again = with_identified_payload(arm, found)
    assert float(again.record.link("payload").mass_kg) == pytest.approx(MASS, rel=0.01)


@pytest.mark.study
def test_two_kilograms_within_one_per_cent_from_two_logs(arm, tmp_path):
    """The arm's own masses are not needed: another arm with the same kinematics and gears does."""
    unloaded = moved(tmp_path, "unloaded", arm, **NOISE)
    loaded = moved(tmp_path, "loaded", arm.with_payload(MASS, COM, INERTIA), seed=3, **NOISE)
    wrong = arm.with_values({"link2.mass_kg": 5.0, "link4.mass_kg": 0.1})
    found = identify_payload(unloaded, wrong, loaded_log=loaded)
    assert found.verdict == "identified"
    assert found["payload.mass_kg"] == pytest.approx(MASS, rel=0.01)
    assert (np.abs(found.values - TRUTH)[:4] < 4 * found.std[:4]).all()
    assert found.names == NAMES
    carrying = aw.identification.write_into(
        with_identified_payload(wrong, found), found, tmp_path / "carrying.toml", key="payload"
    )
    assert aw.load(carrying).record.fits["payload"].log_sha256 == found.sha256
    assert unloaded.sha256 in found.method


def test_torques_of_the_arm_pass_the_low_pass(arm, tmp_path):
    """Without noise the torques that are left are the payload's alone, at turns too."""
    log = moved(tmp_path, "loaded", arm.with_payload(MASS, COM, INERTIA), rate=500.0)
    model, chosen = payload_model(arm), aw.identification.choose_preparation(log)
    c = np.array(COM)
    about = INERTIA + MASS * (c @ c * np.eye(3) - np.outer(c, c))
    parameters = [MASS, *(MASS * c), *(about[i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))]
    rows = list(stream_of(log, arm, None, chosen).samples(model))
    left = [each.unknown_torque(model) - each.regressor(model) @ parameters for each in rows]
    sharp = [
        each.tau - aw.compile(arm.with_payload(MASS, COM, INERTIA)).inverse_dynamics(each.q, each.qd, each.qdd)
        for each in rows
    ]
    assert np.concatenate(left).std() < 0.2 * np.concatenate(sharp).std()


def test_a_planar_arm_has_its_payload_written(tmp_path):
    """The coordinate across the plane is not told, and 0 in the record; torques are those of the true payload."""
    planar = aw.load("two-link")
    true = planar.with_payload(1.5, (0.1, 0.04, 0.0), np.zeros((3, 3)))
    found = identify_payload(moved(tmp_path, "planar", true, torque_noise=0.05), planar)
    assert found.verdict == "identified", str(found)
    assert not np.asarray(found.identifiable)[:4].all()
    path = aw.identification.write_into(
        with_identified_payload(planar, found), found, tmp_path / "carrying.toml", key="payload"
    )
    q, qd, qdd = np.random.default_rng(2).normal(size=(3, 30, 2))
    expected, got = (aw.compile(each).inverse_dynamics(q, 0.3 * qd, 0 * qdd) for each in (true, aw.load(path)))
    own = aw.compile(planar).inverse_dynamics(q, 0.3 * qd, 0 * qdd)
    assert np.abs(got - expected).max() < 0.05 * np.abs(expected - own).max()


@pytest.mark.study
def test_no_payload_is_no_answer(arm, tmp_path):
    found = identify_payload(moved(tmp_path, "empty", arm, **NOISE), arm)
    assert found.verdict == "not identified"
    assert abs(found.values[0]) < 0.05
    assert any("the payload's mass is" in remark for remark in found.remarks)


def test_a_flat_arm_does_not_tell_all(tmp_path):
    """Two joints in a vertical plane: no centre across it, one moment of inertia."""
    flat = aw.load("two-link")
    found = identify_payload(moved(tmp_path, "flat", flat.with_payload(MASS, COM, INERTIA)), flat)
    identifiable = dict(zip(NAMES, found.identifiable, strict=True))
    assert found["payload.mass_kg"] == pytest.approx(MASS, rel=1e-3)
    assert sum(identifiable[name] for name in NAMES[1:4]) == 2
    assert not any(identifiable[name] for name in NAMES[4:])
    (never,) = [each for each in found.remarks if each.startswith("no motion of two-link tells")]
    assert [name in never for name in NAMES] == [not each for each in found.identifiable]
    with pytest.raises(LogError, match="joint"):
        identify_payload(moved(tmp_path, "other", aw.load("lwa4p"), seconds=2.0), flat)


@pytest.mark.parametrize("stays", [True, False])
def test_runs_held_out_judge_the_payload(tmp_path, stays):
    """A payload that was not there in the run held out: the arm without it predicts that run better."""
    arm = aw.load("two-link")
    loaded = arm.with_payload(MASS, COM, INERTIA)
    log = aw.identification.read_log(two_runs(tmp_path / "log", loaded, seconds=10.0, fresh=loaded if stays else arm))
    found = identify_payload(log, arm)
    r2, before = (found.fit[f"torque of elbow (held out{each})"]["r2"] for each in ("", ", by the record before"))
    assert (r2 > before) is stays
    assert found.verdict == ("identified" if stays else "not identified"), found.remarks


PAN_TILT = """
name = "pan-tilt"
source = "estimate"
command = "torque"
tip = "camera"
frames = [{ name = "camera", link = "tray", xyz_m = [0.1, 0.02, 0.0], rpy_rad = [0.0, 0.0, 0.0] }]
"""
TURNED = """
[[joints]]
name = "{joint}"
type = "revolute"
parent = "{parent}"
child = "{child}"
frame = {{ xyz_m = [0.0, 0.0, 0.2], rpy_rad = [0.0, 0.0, 0.0] }}
axis = {axis}
[[links]]
name = "{child}"
mass_kg = 1.0
com_m = [0.02, 0.0, 0.03]
inertia_kg_m2 = {{ xx = 0.004, yy = 0.005, zz = 0.003, xy = 0.0, xz = 0.0, yz = 0.0 }}
"""


def pan_tilt(folder: Path) -> aw.Model:
    """A head whose two axes intersect."""
    pan = TURNED.format(joint="pan", parent="base", child="yoke", axis=[0, 0, 1])
    tilt = TURNED.format(joint="tilt", parent="yoke", child="tray", axis=[0, 1, 0])
    (folder / "head.toml").write_text(PAN_TILT + pan + tilt, encoding="utf-8")
    return aw.load(folder / "head.toml")


@pytest.mark.parametrize("stays", [True, False])
def test_runs_held_out_judge_combinations_of_a_payload_without_a_mass(tmp_path, stays):
    """What the log tells of the payload predicts the run held out to its noise; not a run without the payload."""
    head = pan_tilt(tmp_path)
    loaded = head.with_payload(MASS, COM, INERTIA)
    path = two_runs(tmp_path / "log", loaded, seconds=10.0, noise=0.02, fresh=loaded if stays else head)
    found = identify_payload(path, head)
    assert not found.identifiable[0]
    after, before = (found.fit[f"torque of tilt (held out{each})"]["rms"] for each in ("", ", by the record before"))
    assert (after < 0.03 < 0.3 < before) is stays
    assert (before < 0.03 < 0.3 < after) is not stays
    assert any(remark.startswith("tilt:") for remark in found.remarks) is not stays


def test_no_motion_of_intersecting_axes_tells_a_mass(tmp_path):
    """Eight combinations of a payload turn a pan-tilt head; they come out with deviations, and none is called a mass."""
    head = pan_tilt(tmp_path)
    found = identify_payload(moved(tmp_path, "loaded", head.with_payload(MASS, COM, INERTIA), torque_noise=0.02), head)
    assert found.verdict == "not identified"
    assert not np.any(found.identifiable[:10])
    c, about = np.array(COM), INERTIA + MASS * (np.dot(COM, COM) * np.eye(3) - np.outer(COM, COM))
    truth = {"mL": MASS} | {f"mc{x}L": MASS * value for x, value in zip("xyz", c, strict=True)}
    truth |= {f"I{x}{y}L": about[i, j] for i, x in enumerate("xyz") for j, y in enumerate("xyz")}
    assert len(found.names) == 18
    for k, formula in enumerate(found.names[10:], start=10):
        expected = eval(re.sub(r"(\d) (\w)", r"\1 * \2", formula), truth)
        assert abs(found.values[k] - expected) < 4 * found.std[k] < 0.02, formula
    assert any("mcxL + 0.1 mL" in remark for remark in found.remarks)
    assert not any("would" in remark for remark in found.remarks)
