"""A joint at rest is held by any torque of a band: its verdict does not hang on the sign of a rounding."""

from __future__ import annotations

import tomllib
from importlib import resources

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.description.database import parse
from armwright.model import build_model
from armwright.session import Session
from armwright.session.listing import TextLine
from armwright.trajectory.limits_report import limits_report
from armwright.trajectory.piecewise import PiecewisePolynomial
from armwright.trajectory.rest import torques

DRY = 6.0  # [N m] of the shoulder's friction


def dry_arm(tmp_path=None, torque=None, **motor):
    """The two-link arm with dry friction without smoothing in its shoulder."""
    data = tomllib.loads((resources.files("armwright.robots") / "two-link.toml").read_text(encoding="utf-8"))
    shoulder = data["joints"][0]
    shoulder["friction"] = {
        "viscous_n_m_s_per_rad": 0.5,
        "coulomb_positive_n_m": DRY,
        "coulomb_negative_n_m": DRY - 1.0,
    }
    if torque is not None:
        shoulder.setdefault("limits", {})["torque_n_m"] = torque
    if motor:
        shoulder["motor"] = {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 1e-5, **motor}
    robot = parse(data, "dry.toml")
    if tmp_path is not None:
        aw.robotfiles.write_toml(robot, tmp_path / "dry.toml")
    return build_model(robot)


@pytest.mark.parametrize("rounding", [0.0, 1e-13, -1e-13, 9e-10, -9e-10])
def test_the_band_is_that_of_the_friction(rounding):
    arm = dry_arm()
    q, qd, qdd = np.array([[0.3, 0.4]] * 2), np.array([[rounding, 1.0], [0.5, 1.0]]), np.array([[0.0, 0.2]] * 2)
    found = torques(arm, aw.compile(arm), q, qd, qdd)
    exact = aw.compile(arm.replace(friction=None)).inverse_dynamics(q, np.where(np.abs(qd) < 1e-9, 0.0, qd), qdd)
    np.testing.assert_allclose(found.tau[0], exact[0], rtol=1e-12)
    np.testing.assert_allclose(
        [found.low[0, 0], found.high[0, 0]], [exact[0, 0] - DRY + 1.0, exact[0, 0] + DRY], rtol=1e-7
    )
    assert found.held.tolist() == [[True, False], [False, False]]
    np.testing.assert_array_equal(found.tau[1], found.high[1])
    (note,) = found.notes(arm.names, ["N m"] * 2)
    assert note.startswith("shoulder stands in row 1: any torque of ")


def test_a_lossy_gear_holds_too():
    """Of a load t the motor needs η t at least where the load would drive it, t/η at most where it drives."""
    arm = dry_arm(gear_efficiency=0.8).replace(friction=None)
    q, zero = np.array([[0.3, 0.4]]), np.zeros((1, 2))
    found = torques(arm, aw.compile(arm), q, np.array([[1e-14, 1.0]]), zero)
    load = found.tau[0, 0]
    np.testing.assert_allclose([found.low[0, 0], found.high[0, 0]], [0.8 * load, load / 0.8], rtol=1e-6)
    assert load > 1.0


def test_smoothed_friction_has_no_band():
    """Its law is continuous: the arm creeps, and the torque at rest is one number."""
    arm = aw.load("lwa4p")
    qd = np.array([[1e-13, 0.5, 0.0, 0.0, 0.0, 0.0]])
    found = torques(arm, aw.compile(arm), np.full((1, 6), 0.3), qd, np.zeros((1, 6)))
    assert not found.held.any()
    assert found.notes(arm.names, ["N m"] * 6) == []


def standing(rounding):
    """The elbow moves, the shoulder does not but for a rounding."""
    ends = np.array([[0.3, -0.2], [0.3 + rounding, 0.6]])
    rest = np.zeros((2, 2))
    return PiecewisePolynomial.hermite(np.array([0.0, 1.0]), ends, rest, rest)


@pytest.mark.sample(1)
@pytest.mark.parametrize("rounding", [0.0, 1e-13, -1e-13])
def test_the_verdict_is_that_of_the_least_torque(rounding):
    """Friction holds what the motor does not: a limit is kept down to the least torque of the band, and not below."""
    without = limits_report(dry_arm().replace(friction=None), standing(rounding)).highest["torque"][0]
    least = without - (DRY - 1.0)
    for limit, kept in ((0.5 * (least + without), True), (1.001 * least, True), (0.999 * least, False)):
        report = limits_report(dry_arm(torque=limit), standing(rounding))
        low, high = report.bands["torque"][0]
        assert report.kept == kept
        assert report.share["torque"][0] == pytest.approx(least / limit, rel=1e-6)
        assert high == pytest.approx(without + DRY, rel=1e-6)
        assert f"{low:.3g} … {high:.3g} N m" in str(report)
        assert np.isnan(report.bands["torque"][1]).all()


def test_all_signs_of_a_rounding_give_one_report():
    reports = [limits_report(dry_arm(torque=60.0), standing(rounding)) for rounding in (0.0, 1e-13, -1e-13)]
    for report in reports[1:]:
        np.testing.assert_allclose(report.share["torque"], reports[0].share["torque"], rtol=1e-6)
    rows = [standing(rounding).dataset(dry_arm(), 100.0).tau.values for rounding in (1e-13, -1e-13)]
    np.testing.assert_allclose(*rows, rtol=1e-6)


def test_the_command_says_the_band(tmp_path):
    dry_arm(tmp_path)
    head = "q_shoulder,q_elbow,qd_shoulder,qd_elbow,qdd_shoulder,qdd_elbow\n"
    outputs = []
    for rounding in (1e-13, -1e-13):
        (tmp_path / "in.csv").write_text(f"{head}0.3,0.4,{rounding},1,0,0\n0.3,0.4,0.5,1,0,0\n")
        result = CliRunner().invoke(app, ["inverse-dynamics", str(tmp_path / "dry.toml"), str(tmp_path / "in.csv")])
        assert result.exit_code == 0
        outputs.append(result.output)
    assert outputs[0] == outputs[1]
    assert "note: shoulder stands in row 1: any torque of " in outputs[0]
    assert "elbow stands" not in outputs[0]


def test_the_session_says_the_band(tmp_path):
    """And compares its least torque with the limit."""
    least = torques(arm := dry_arm(), aw.compile(arm), *np.array([[[0.3, 0.4]], [[1e-13, 1.0]], [[0.0, 0.0]]])).least[
        0, 0
    ]
    for limit, beyond in ((1.01 * least, False), (0.99 * least, True)):
        dry_arm(tmp_path, torque=limit)
        session = Session(str(tmp_path / "dry.toml"))
        for line in ("theta = 0.3 0.4", "omega = 1e-13 1", "alpha = 0 0"):
            session.run(line)
        notes = [part.text for part in session.run("inverse-arm") if isinstance(part, TextLine)]
        assert any(note.startswith("shoulder stands: any torque of ") for note in notes)
        assert any("beyond its limit" in note for note in notes) == beyond
