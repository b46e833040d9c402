"""A fit with the gear loss of the record: its model is the law of the dynamics, and it finds what lies beside the loss."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import armwright as aw
from armwright.actuators.coupling import motor_shares
from armwright.errors import IdentificationError
from armwright.identification.arm.gear_loss import LossyModel, lossy_model
from armwright.identification.arm.options import ArmTerms
from armwright.identification.arm.payload import identify_payload
from armwright.identification.arm.samples import stream_of
from armwright.identification.arm.torque_model import random_states, torque_model
from armwright.model import build_model
from identification.arm.moved_arm import moved, multisine, written_log
from raises_at import raises_at

PATH = Path(__file__).resolve().parents[3] / "tools" / "gear_loss_seeds.py"
TABLE = {
    "torque_n_m": [2.0, 10.0, 40.0],
    "rows": [
        {"speed_rad_per_s": 0.2, "driving": [0.5, 0.7, 0.8], "driven_back": [0.4, 0.6, 0.75]},
        {"speed_rad_per_s": 2.0, "driving": [0.45, 0.65, 0.77], "driven_back": [0.35, 0.55, 0.7]},
    ],
}
MOTION = {"seconds": 16.0, "rate": 250.0, "harmonics": 10, "size": 0.7}


@pytest.fixture(scope="module")
def seeds():
    spec = importlib.util.spec_from_file_location("gear_loss_seeds", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["gear_loss_seeds"] = module  # dataclasses look for it
    try:
        spec.loader.exec_module(module)
        yield module
    finally:
        del sys.modules["gear_loss_seeds"]


@pytest.fixture(scope="module")
def arm(seeds, tmp_path_factory):
    return seeds.four_joints(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def log(arm, tmp_path_factory):
    return moved(tmp_path_factory.mktemp("log"), "moved", arm, **MOTION, torque_noise=0.2)


def changed(arm: aw.Arm, *, motor: dict | None = None, friction: dict | None = None, joint: str = "") -> aw.Arm:
    """The arm with keys of motors or friction changed, of all joints or of one; None takes a key away."""
    joints = []
    for each in arm.record.joints:
        if joint in ("", each.name):
            drive = each.motor.replace(**(motor or {}))
            each = each.replace(motor=drive, friction=each.friction.replace(**(friction or {})))
        joints.append(each)
    return build_model(arm.record.replace(joints=tuple(joints)))


def number(value: float) -> dict:
    return {"value": value, "source": "definition"}


def on_motors(arm: aw.Arm) -> aw.Arm:
    """The arm with its friction on the motors, by load too."""
    joints = []
    for each in arm.record.joints:
        n, old = abs(float(each.motor.gear_ratio)), each.friction
        own = {
            "side": "motor",
            "viscous_n_m_s_per_rad": number(float(old.viscous_n_m_s_per_rad) / n**2),
            "coulomb_positive_n_m": number(float(old.coulomb_positive_n_m) / n),
            "coulomb_negative_n_m": number(float(old.coulomb_negative_n_m) / n),
            "load_coefficient": number(0.08),
        }
        joints.append(each.replace(friction=own))
    return build_model(arm.record.replace(joints=tuple(joints)))


VARIANTS = {
    "efficiency": lambda arm: arm,
    "one motor": lambda arm: changed(
        arm.replace(efficiency=None), motor={"gear_efficiency": number(0.6)}, joint="elbow"
    ),
    "friction by load": lambda arm: changed(arm, friction={"load_coefficient": number(0.1)}),
    "friction by load alone": lambda arm: changed(
        arm, motor={"gear_efficiency": None}, friction={"load_coefficient": number(0.1)}
    ),
    "motor side": on_motors,
    "smoothing": lambda arm: changed(arm, friction={"smoothing_rad_per_s": number(0.05)}),
    "table": lambda arm: changed(arm, motor={"gear_efficiency": None, "gear_efficiency_table": TABLE}),
    "coupled": lambda arm: changed(
        arm, motor={"coupling": [{"joint": "elbow", "ratio": number(-40.0)}]}, joint="wrist"
    ),
}


def record_of(arm: aw.Arm) -> aw.Arm:
    """The arm without its fitted numbers: other masses, and no friction but its side, smoothing and load coefficient."""
    return arm.with_values({f"{body.link}.mass_kg": 1.2 * float(body.mass) for body in arm.bodies})


@pytest.mark.parametrize("variant", VARIANTS)
def test_about_the_truth_the_model_is_the_law_of_the_dynamics(arm, variant):
    lossy = VARIANTS[variant](arm)
    model = lossy_model(torque_model(lossy))
    assert model is not None
    model = model.at(np.nan_to_num(model.prior))
    q, qd, qdd = random_states(lossy, 300, seed=4)
    qd[:20, 2], qd[20:30] = 0.0, 0.0
    rows, known = model.terms(q, qd, qdd)
    expected = aw.compile(lossy).inverse_dynamics(q, qd, qdd) @ motor_shares(lossy)
    np.testing.assert_allclose(rows @ model.about + known, expected, atol=1e-10)
    assert np.abs(rows[:, ~model.of_joint]).max() < 1e-9


def test_the_derivative_by_an_efficiency_is_that_of_the_dynamics(arm):
    model = lossy_model(torque_model(arm), "all")
    assert model is not None
    model = model.at(np.nan_to_num(model.prior))
    q, qd, qdd = random_states(arm, 50, seed=5)
    step = 1e-4
    ends = [
        aw.compile(changed(arm, motor={"gear_efficiency": number(0.75 + h)}, joint="elbow")).inverse_dynamics(
            q, qd, qdd
        )
        for h in (-step, step)
    ]
    column = model.rows(q, qd, qdd)[:, :, model.index("eta3")]
    np.testing.assert_allclose(column, (ends[1] - ends[0]) / (2 * step), rtol=1e-5, atol=1e-5)


@pytest.mark.sample(1)
@pytest.mark.parametrize("variant", VARIANTS)
def test_a_log_without_noise_gives_the_truth(tmp_path, arm, variant):
    lossy = VARIANTS[variant](arm)
    t, *state = multisine(arm.n, 16.0, 250.0, 2, 0.7, 10)
    tau = aw.compile(lossy).inverse_dynamics(*state) @ motor_shares(lossy)
    log = written_log(tmp_path, "exact", lossy.names, t, state[0], tau)
    found = aw.identification.identify_arm(log, record_of(lossy), record=False, checks=())
    model = lossy_model(torque_model(lossy))
    assert model is not None
    truth = found.fit.base.of(np.nan_to_num(model.prior))
    fitted = found.fit.equations.model
    wrong = fitted.rows(*state)[:, :, found.fit.base.independent] @ (found.fit.values - truth)
    assert found.verdict == "identified", found.estimate.remarks
    assert (np.abs(wrong).std(axis=0) < 0.003 * tau.std(axis=0)).all()
    assert np.nanmin(found.fit.r2) > 0.9999


@pytest.mark.study
def test_a_fit_that_does_not_know_the_loss_is_wrong(arm, log):
    """What this is for: links far from the truth by their stated deviations."""
    known = aw.identification.identify_arm(log, arm, record=False, checks=())
    ignored = aw.identification.identify_arm(log, arm.replace(efficiency=None), record=False, checks=())
    assert not isinstance(ignored.fit.equations.model, LossyModel)
    for found, fits in ((known, True), (ignored, False)):
        truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
        z = np.abs(found.fit.values - truth) / found.fit.std
        assert bool(np.mean(z < 3) > 0.95) is fits
        assert bool(np.nanmin(found.fit.r2) > 0.999) is fits


@pytest.mark.sample(1)
@pytest.mark.parametrize("method", ["ols", "irls", "tukey"])
def test_methods_that_know_gear_loss_agree(arm, log, method):
    wls, other = (
        aw.identification.identify_arm(log, arm, method=each, record=False, checks=()) for each in ("wls", method)
    )
    assert other.verdict == "identified"
    assert (np.abs(other.fit.values - wls.fit.values) < 4 * np.maximum(wls.fit.std, other.fit.std)).all()


@pytest.mark.parametrize("method", ["essential", "recursive", "iv", "didim", "cloe"])
def test_other_methods_are_refused_by_name(arm, log, method):
    with raises_at(IdentificationError, "method", "gear loss.*'yaw'.*wls", value=method):
        aw.identification.identify_arm(log, arm, method=method)


def test_a_torque_without_gravity_is_refused(arm, log):
    with raises_at(IdentificationError, "lacks", "gravity.*'yaw'"):
        aw.identification.identify_arm(log, arm, terms=ArmTerms(lacks=["gravity"]))


def test_efficiencies_are_fitted_with_their_deviations(tmp_path, arm, log):
    stated = arm
    for joint in ("shoulder", "elbow"):
        stated = changed(stated, motor={"gear_efficiency": None}, joint=joint)
    found = aw.identification.identify_arm(log, stated, terms=ArmTerms(fit_efficiency=["shoulder", "elbow"]), checks=())
    assert found.verdict == "identified"
    for name in ("eta2", "eta3"):
        k = found.estimate.number(name)
        assert found.estimate.std[k] < 0.01
        assert abs(found.estimate.values[k] - 0.75) < 4 * found.estimate.std[k]
    again = aw.load(found.write(tmp_path / "found.toml"))
    efficiencies = [float(body.drive.efficiency) for body in again.coordinates]
    assert efficiencies == pytest.approx([0.75, found.estimate["eta2"], found.estimate["eta3"], 0.75])
    assert "elbow.motor.gear_efficiency" in (tmp_path / "found.toml").read_text(encoding="utf-8")


@pytest.mark.study
def test_an_efficiency_that_the_log_hardly_tells_is_refused_or_stays(tmp_path, arm):
    """The yaw's own friction takes what its inertia gives: its load hardly ever drives its gear."""
    arm = changed(arm, friction={"viscous_n_m_s_per_rad": number(40.0)}, joint="yaw")
    log = moved(tmp_path, "braked", arm, **MOTION, torque_noise=0.2)
    with raises_at(IdentificationError, "fit_efficiency", "'yaw'.*gear back"):
        aw.identification.identify_arm(log, arm, terms=ArmTerms(fit_efficiency=["yaw", "elbow"]))
    found = aw.identification.identify_arm(log, arm, terms=ArmTerms(fit_efficiency="all"), record=False, checks=())
    assert "eta1" not in found.fit.base.names
    assert "eta3" in found.fit.base.names
    assert any("yaw: gear efficiency stays the record's" in each for each in found.estimate.remarks)


def test_unknown_joints_and_tables_are_refused(arm, log):
    with pytest.raises(IdentificationError, match=r"fit_efficiency.*elbw.*elbow"):
        aw.identification.identify_arm(log, arm, terms=ArmTerms(fit_efficiency=["elbw"]))
    with raises_at(IdentificationError, "fit_efficiency", "'yaw'.*gear_efficiency_table"):
        aw.identification.identify_arm(log, VARIANTS["table"](arm), terms=ArmTerms(fit_efficiency=["yaw"]))


@pytest.mark.sample(1)
@pytest.mark.parametrize("variant", ["efficiency", "motor side", "table"])
def test_the_written_record_keeps_the_loss_and_predicts_new_motions(tmp_path, arm, variant):
    lossy = VARIANTS[variant](arm)
    log = moved(tmp_path, "moved", lossy, **MOTION, torque_noise=0.2, seed=7)
    found = aw.identification.identify_arm(log, record_of(lossy), checks=())
    assert found.record is not None
    assert np.nanmin(found.record.r2) > 0.999
    again = aw.load(found.write(tmp_path / "found.toml"))
    for body, true in zip(again.coordinates, lossy.coordinates, strict=True):
        assert str(body.drive.efficiency) == str(true.drive.efficiency)
        assert body.friction.on_motor == true.friction.on_motor
        assert body.friction.load_coefficient == true.friction.load_coefficient
    states = multisine(arm.n, 16.0, 50.0, 9, 0.7, 10)[1:]
    expected = aw.compile(lossy).inverse_dynamics(*states)
    error = aw.compile(again).inverse_dynamics(*states) - expected
    assert (error.std(axis=0) < 0.01 * expected.std(axis=0)).all()


def test_a_wrong_sign_is_not_identified(tmp_path, arm):
    t, q, qd, qdd = multisine(arm.n, 16.0, 250.0, 3, 0.7, 10)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd) * [1, 1, -1, 1]
    log = written_log(tmp_path, "wrong", arm.names, t, q, tau)
    assert aw.identification.identify_arm(log, arm, record=False, checks=()).verdict == "not identified"


def test_rests_are_left_out(tmp_path, arm):
    """At rest a lossy gear passes on any torque of a range: such rows say nothing, and all others stay."""
    t, q, *_ = multisine(arm.n, 16.0, 250.0, 3, 0.7, 10)
    stop = np.clip((t - 14.0) / 1.5, 0, 1)
    share = 1 - stop**3 * (10 - 15 * stop + 6 * stop**2)  # of the speed, which ends smoothly
    when = np.concatenate([np.cumsum(share), np.full(4000, share.sum())]) / 250.0
    clock = np.arange(len(when)) / 250.0
    moves = CubicSpline(clock, np.stack([np.interp(when, t, each) for each in q.T], axis=1))
    state = [moves(clock, order) for order in range(3)]
    tau = aw.compile(arm).inverse_dynamics(*state)
    tau[len(t) + 250 :] *= 1.3  # holding: friction and gear pass on any torque of a range
    log = written_log(tmp_path, "rests", arm.names, clock, state[0], tau)
    found = aw.identification.identify_arm(log, arm, record=False, checks=())
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    z = np.abs(found.fit.values - truth) / found.fit.std
    blocks = list(stream_of(log, arm).samples(found.fit.equations.model))
    resting = np.concatenate([~each.fitted for each in blocks])
    t = np.concatenate([each.t for each in blocks])
    assert resting[t > 18].all()
    assert resting[t < 14].mean() < 0.05
    assert np.mean(z < 4) > 0.9
    assert np.nanmin(found.fit.r2) > 0.999


def test_an_arm_without_loss_has_the_plain_model(arm, log):
    plain = arm.replace(efficiency=None)
    assert lossy_model(torque_model(plain)) is None


def test_a_payload_behind_lossy_gears(tmp_path, arm):
    mass, com = 1.5, (0.02, -0.03, 0.06)
    carrying = arm.with_payload(mass, com, np.diag([0.004, 0.004, 0.002]), arm.tip)
    noise = {"torque_noise": 0.1}
    loaded = moved(tmp_path, "loaded", carrying, **MOTION, **noise, seed=1)
    unloaded = moved(tmp_path, "unloaded", arm, **MOTION, **noise, seed=2)
    for found in (identify_payload(loaded, arm), identify_payload(unloaded, record_of(arm), loaded_log=loaded)):
        assert found.verdict == "identified"
        assert found["payload.mass_kg"] == pytest.approx(mass, rel=0.02)
        known = np.flatnonzero(found.identifiable)[:4]
        assert (np.abs(found.values - [mass, *com, *[0] * 6])[known] < 4 * found.std[known]).all()


def test_friction_behind_lossy_gears(tmp_path, arm):
    log = moved(tmp_path, "moved", arm, **MOTION, torque_noise=0.1)
    found = aw.identification.identify_friction(log, arm.replace(friction=None), candidates=())
    for body in arm.coordinates:
        value = found[f"{body.joint}.friction.coulomb_positive_n_m"]
        assert value == pytest.approx(float(body.friction.coulomb_positive), rel=0.05)
    assert not any("at the motor" in each for each in found.remarks)
    moved_friction = aw.identification.identify_friction(log, on_motors(arm), candidates=())
    assert any("the record has friction at the motor" in each for each in moved_friction.remarks)


@pytest.mark.study
def test_errors_beside_those_without_loss(tmp_path, seeds):
    """A few of the seeds of tools/gear_loss_seeds.py."""
    case = seeds.cases(tmp_path)["four-joint"]
    row = seeds.study("four-joint", case, tmp_path, range(3), validated=1)
    assert row.passed == ("1/1", "1/1")
    assert row.failures == []
    assert row.share[1] > 0.95


@pytest.mark.study
def test_errors_of_many_seeds_beside_those_without_loss(tmp_path, seeds):
    row = seeds.study("four-joint", seeds.cases(tmp_path)["four-joint"], tmp_path, range(24))
    assert row.failures == []


@pytest.mark.study
def test_the_study_finds_a_fit_without_the_loss(tmp_path, seeds):
    """With an efficiency that the record does not know, errors are too large."""
    case = seeds.cases(tmp_path)["four-joint"]
    blind = seeds.one_seed(
        tmp_path, case.arm, seeds.nominal(seeds.with_efficiency(case.arm, None)), case.friction, 0, False
    )
    seeing = seeds.one_seed(tmp_path, case.arm, seeds.nominal(case.arm), case.friction, 0, False)
    found = replace(
        seeds.study("four-joint", case, tmp_path, range(1)),
        share=(1.0, float(np.mean(np.abs(blind.errors) <= 3 * blind.std))), r2=(seeing.r2, blind.r2),
    )  # fmt: skip
    assert len(found.failures) >= 1
