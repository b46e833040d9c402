"""identify_arm judges the record that it writes on the runs held out, with the numbers of `validate`."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.fitting.measures import rms
from armwright.identification.arm.held_out import error_by_noise
from armwright.identification.arm.samples import stream_of
from armwright.identification.logs.preparation import shared_preparations
from armwright.identification.validation.comparison import largest_explained
from identification.arm.two_runs import two_runs

FRICTION = {"viscous_n_m_s_per_rad": 0.8, "coulomb_positive_n_m": 1.0, "coulomb_negative_n_m": 1.0}
STRIBECK = {"stribeck_torque_n_m": 4.0, "stribeck_speed_rad_per_s": 0.3}


class Arms:
    """two-link with viscous and Coulomb friction, and with more dry friction at low speed: path, arm and log of two runs."""

    def __init__(self, folder: Path):
        self.paths, self.arms, self.logs = {}, {}, {}
        record = aw.load("two-link").record
        for name, friction in (("plain", FRICTION), ("stribeck", {**FRICTION, **STRIBECK})):
            joints = tuple(each.replace(friction=friction) for each in record.joints)
            self.paths[name] = folder / f"{name}.toml"
            aw.robotfiles.write_toml(record.replace(joints=joints), self.paths[name])
            self.arms[name] = aw.load(self.paths[name])
            self.logs[name] = two_runs(folder / name, self.arms[name])


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return Arms(tmp_path_factory.mktemp("arms"))


@pytest.mark.study
def test_numbers_of_runs_held_out_are_those_of_validate_bit_by_bit(arms, tmp_path):
    log, arm = aw.identification.read_log(arms.logs["plain"]), arms.arms["plain"]
    found = aw.identification.identify_arm(log, arm)
    assert found.hold_out is not None
    path = found.write(tmp_path / "found.toml")
    cutoff = found.estimate.preparation["cutoff_hz"]
    written = aw.identification.validate(path, log)
    before = aw.identification.validate(arms.paths["plain"], log, cutoff=cutoff)  # rows of the same low-pass
    alone = aw.identification.validate(path, arms.logs["plain"], simulation=False)
    assert [each.joint for each in found.hold_out.rows] == arm.names
    for each in found.hold_out.rows:
        assert each.written == written.of("torque", each.joint).overall == alone.of("torque", each.joint).overall
        assert each.before == before.of("torque", each.joint).overall
        own = found.estimate.fit[f"torque of {each.joint} (held out)"]
        assert (own["r2"], own["rms"], own["fit_percent"]) == (each.written.r2, each.written.rms, each.written.fit)
        stored = aw.load(path).record.fits["fit"].measures[f"torque of {each.joint} (held out)"]
        assert stored["rms"] == pytest.approx(each.written.rms, rel=1e-5)


def test_a_cut_off_of_the_fit_is_that_of_the_measure(arms, tmp_path):
    """The filter that the fit was told to take stands in the record, and judges it, now and in `validate`."""
    log = aw.identification.read_log(arms.logs["plain"])
    found = aw.identification.identify_arm(
        log, arms.arms["plain"], rows=aw.identification.FitRows(cutoff=3.0), checks=()
    )
    assert found.hold_out is not None
    (first, *_) = found.hold_out.written.predictions
    judged = aw.identification.validate(found.write(tmp_path / "arm.toml"), log, simulation=False).predictions[0]
    assert (first.rate, len(first.t)) == (judged.rate, len(judged.t))
    assert first.rate < 10.0


def test_a_fit_as_good_as_the_record_that_came_in_is_identified(arms):
    """The record is the truth, the fit has its noise: a little worse, and no more than noise makes it."""
    found = aw.identification.identify_arm(
        aw.identification.read_log(arms.logs["plain"]), arms.arms["plain"], checks=()
    )
    assert found.hold_out is not None
    assert any(each.before and each.written.rms > each.before.rms for each in found.hold_out.rows)
    assert found.verdict == found.sentences()[0] == "identified", str(found)
    assert not found.hold_out.worse


def test_a_fit_worse_than_the_record_that_came_in_is_not_identified(arms, tmp_path):
    """Friction of a law that the fit does not have: the limits of validate are kept, and the old record was better."""
    path, stribeck = arms.logs["stribeck"], arms.arms["stribeck"]
    found = aw.identification.identify_arm(aw.identification.read_log(path), stribeck, checks=())
    assert found.hold_out is not None
    assert found.hold_out.written.passed
    assert found.verdict == "not identified"
    (remark,) = [each for each in found.estimate.remarks if each.startswith("elbow: on the runs held out")]
    assert "worse than the record that it replaces" in remark
    again = aw.load(found.write(tmp_path / "found.toml"))
    assert again.record.fits["fit"].verdict == "not identified"


@pytest.mark.study
def test_a_fit_better_than_a_wrong_record_is_identified(arms):
    """The same fit, beside a record without any friction."""
    found = aw.identification.identify_arm(
        aw.identification.read_log(arms.logs["stribeck"]), aw.load("two-link"), checks=()
    )
    assert found.hold_out is not None
    assert all(each.before and each.written.rms < each.before.rms for each in found.hold_out.rows)
    assert found.verdict == "identified", str(found)


def test_kinematics_alone_have_nothing_to_compare_with(arms, tmp_path):
    arm = aw.load("two-link")
    nothing = dict.fromkeys(("xx", "xy", "xz", "yy", "yz", "zz"), 0.0)
    bare = tuple(link.replace(mass_kg=0.0, inertia_kg_m2=nothing) for link in arm.record.links)
    joints = tuple(joint.replace(motor=None, friction=None) for joint in arm.record.joints)
    aw.robotfiles.write_toml(arm.record.replace(links=bare, joints=joints, command="torque"), tmp_path / "bare.toml")
    found = aw.identification.identify_arm(
        aw.identification.read_log(arms.logs["plain"]), aw.load(tmp_path / "bare.toml"), checks=()
    )
    assert found.hold_out is not None
    assert found.hold_out.before is None
    assert [each.before for each in found.hold_out.rows] == [None, None]
    assert "states no masses" in "\n".join(found.estimate.remarks)
    assert found.verdict == "identified", str(found)
    assert not [name for name in found.estimate.fit if "record before" in name]


def test_a_log_without_runs_held_out_says_so(arms, tmp_path):
    path = arms.logs["plain"]
    text = path.read_text()
    path.with_name("all.log.toml").write_text(text.replace('use = "hold-out"', 'use = "fit"'))
    found = aw.identification.identify_arm(
        aw.identification.read_log(path.with_name("all.log.toml")), arms.arms["plain"], checks=()
    )
    assert found.hold_out is None
    assert found.verdict == "identified"
    assert [each for each in found.estimate.remarks if "no run is held out" in each]


@pytest.mark.study
@pytest.mark.parametrize("name", ["plain", "stribeck"])
def test_command_and_report_have_one_verdict(arms, tmp_path, name):
    output, page = tmp_path / "found.toml", tmp_path / "page.html"
    for more in (["-o", str(output), "--report", str(page)], []):
        result = CliRunner().invoke(app, ["identify", "arm", str(arms.paths[name]), str(arms.logs[name]), *more])
        assert result.exit_code == (0 if name == "plain" else 1), result.output
        verdict = "identified" if name == "plain" else "not identified"
        assert [line for line in result.output.splitlines() if re.match(rf"{verdict}\b", line)], result.output
    assert "R² before" in result.output
    verdicts = re.findall(r'<p class="verdict[^>]*>([^<]*)<', page.read_text(encoding="utf-8"))
    assert verdicts == ["Identified" if name == "plain" else "Not identified"]


def test_99_of_100_fits_with_the_same_deviations_have_a_smaller_error(arms):
    """δ drawn from the fit's covariance, its torque error on the run held out from the columns there."""
    log = aw.identification.read_log(arms.logs["plain"])
    fit = aw.identification.identify_arm(log, arms.arms["plain"], checks=()).fit
    model, prepared = fit.equations.model, shared_preparations(log, ["fresh"])
    blocks = list(stream_of(log, model.arm, ["fresh"], prepared).samples(model))
    bound = error_by_noise(fit, blocks)
    columns = np.concatenate([block.regressor(model) for block in blocks])[:, :, fit.base.independent]
    errors = np.random.default_rng(0).multivariate_normal(np.zeros(len(fit.base)), fit.covariance, size=4000)
    for j, joint in enumerate(model.arm.names):
        squares = ((columns[:, j] @ errors.T) ** 2).mean(axis=0)
        assert np.mean(squares < bound[joint].error) == pytest.approx(0.99, abs=0.006)


def test_noise_explains_what_another_run_could_give_and_no_more():
    """Of runs of white noise of the same size 97 % stay below, of correlated noise 95 %; one of 1.5 times the size does not."""
    rng = np.random.default_rng(0)
    for correlation, share in ((0.0, 0.97), (0.9, 0.95)):
        runs = [(_noise(rng, 4000, correlation), _noise(rng, 4000, correlation)) for _ in range(400)]
        allowed = np.array([largest_explained(first, 1e-3 * first) for first, _ in runs])
        assert np.mean([rms(second) for _, second in runs] <= allowed) >= share
        assert (1.5 * np.array([rms(first) for first, _ in runs]) > allowed).mean() > 0.95


@pytest.mark.study
@pytest.mark.parametrize(("seconds", "noise"), [(5.0, 0.1), (20.0, 1.0)])
def test_fits_to_noise_are_not_called_worse_than_the_truth(tmp_path, seconds, noise):
    """6 logs of an arm of 6 joints, 58 base parameters; the record that comes in is the truth, which no fit can beat."""
    arm = aw.load("lwa4p")
    for seed in range(6):
        log = aw.identification.read_log(two_runs(tmp_path / str(seed), arm, seconds=seconds, noise=noise, seed=seed))
        found = aw.identification.identify_arm(log, arm, checks=())
        assert found.hold_out is not None
        assert found.hold_out.worse == []


def _noise(rng: np.random.Generator, rows: int, correlation: float) -> np.ndarray:
    return np.asarray(lfilter([1.0], [1.0, -correlation], rng.normal(size=rows + 100)))[100:]
