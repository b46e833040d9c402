"""identify_arm on logs with known truth and on the measured logs of two real arms."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import armwright as aw
from armwright.actuators.springs import spring_torque
from armwright.description.robot import Source
from armwright.errors import IdentificationError, LogError
from armwright.identification.arm.equations import equations_of
from armwright.identification.arm.fit import cross_validated, fit_arm
from armwright.identification.arm.options import ArmTerms, FitRows
from armwright.identification.arm.samples import stream_of
from armwright.identification.arm.spring_record import spring_keys
from armwright.identification.logs.prepared import logged_motion
from armwright.identification.validation.torque import predict_torque
from armwright.model import build_model
from identification.arm.moved_arm import multisine, written_log
from identification.arm.simulated_log import write_log
from identification.arm.tx40 import tx40_urdf
from identification.logs.example_logs import write_joint_states
from identification.real_logs import DATA, LWA_4P, TX40, log_of
from raises_at import raises_at

FIT = {"fit": Source(kind="fit", text="a test")}


@pytest.mark.study
def test_record_with_fitted_numbers_moves_as_the_truth(tmp_path):
    arm = aw.load("lwa4p")
    log = aw.identification.read_log(write_log(tmp_path, arm, seconds=40))
    found = aw.identification.identify_arm(log, arm.replace(name="lwa4p"))
    assert found.verdict == "identified", str(found)
    assert found.structural == len(found.formulas) == 58
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    z = (found.fit.values - truth) / found.fit.std
    assert np.sqrt(np.mean(z**2)) < 1.6
    path = found.write(tmp_path / "found.toml")
    again = aw.load(path)
    q, qd, qdd = np.random.default_rng(9).uniform(-1, 1, (3, 50, 6))
    expected = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    error = aw.compile(again).inverse_dynamics(q, qd, qdd) - expected
    assert (error.std(axis=0) < 0.03 * expected.std(axis=0)).all()
    prepared = aw.identification.choose_preparation(log, cutoff=found.estimate.preparation["cutoff_hz"])
    # dry friction leaves the low-pass as in the fit
    prediction = predict_torque(again, log, logged_motion(log, None, prepared))
    rms = np.sqrt(np.nanmean((prediction.measured - prediction.predicted) ** 2, axis=0))
    assert (rms < 1.02 * found.fit.rms).all()
    number = next(n for n in again.parameters if n.name == "joint3.friction.viscous_n_m_s_per_rad")
    assert again.provenance(number.name).kind == "fit"
    assert number.std is not None
    assert again.record.fits["fit"].log_sha256 == log.sha256


def test_smoothing_speeds_go_with_friction_to_the_other_side(tmp_path):
    """A fit writes friction of the joints where the record has that of the motors; Coulomb's sign stays as it was fitted."""
    arm = aw.load("puma560")
    assert {body.friction.on_motor for body in arm.coordinates} == {True}
    found = aw.identification.identify_arm(
        aw.identification.read_log(write_log(tmp_path, arm, seconds=20)), arm, checks=()
    )
    again = aw.load(found.write(tmp_path / "found.toml"))
    assert {body.friction.on_motor for body in again.coordinates} == {False}
    before, after = ([body.friction.smoothing for body in each.coordinates] for each in (arm, again))
    np.testing.assert_allclose(after, before, rtol=1e-14)


@pytest.mark.study
def test_kinematics_alone_are_enough(tmp_path):
    """The same log without masses, motors and friction of the record: base parameters are the same."""
    arm = aw.load("lwa4p")
    log = aw.identification.read_log(write_log(tmp_path, arm, seconds=40))
    nothing = dict.fromkeys(("xx", "xy", "xz", "yy", "yz", "zz"), 0.0)
    bare = [link.replace(mass_kg=0.0, inertia_kg_m2=nothing) for link in arm.record.links]
    joints = [joint.replace(motor=None, friction=None) for joint in arm.record.joints]
    aw.robotfiles.write_toml(
        arm.record.replace(links=tuple(bare), joints=tuple(joints), command="torque"), tmp_path / "bare.toml"
    )
    kinematics = aw.load(tmp_path / "bare.toml")
    found, full = (aw.identification.identify_arm(log, each, checks=()) for each in (kinematics, arm))
    q, qd, qdd = np.random.default_rng(9).uniform(-1, 1, (3, 50, 6))
    qd += 0.2 * np.sign(qd)  # the bare arm has no smoothing speed
    mine, expected = (each.fit.equations.model.rows(q, qd, qdd) @ each.fit.parameters for each in (found, full))
    assert (np.abs(mine - expected).std(axis=0) < 0.02 * expected.std(axis=0)).all()
    again = aw.load(found.write(tmp_path / "found.toml"))
    assert again.bodies[3].mass > 0


@pytest.mark.study
def test_joint_that_rests_is_not_identified_and_said(tmp_path):
    arm = aw.load("lwa4p")
    log = aw.identification.read_log(write_log(tmp_path, arm, still=(5,)))
    found = aw.identification.identify_arm(log, arm, checks=())
    assert found.verdict == "not identified"
    assert len(found.formulas) < found.structural
    text = "\n".join(found.estimate.remarks)
    assert "joint6" in text or "link6" in text


@pytest.mark.study
def test_what_the_torque_lacks_is_read_from_the_log(tmp_path):
    arm = aw.load("lwa4p")
    floating = arm.replace(gravity=(0.0, 0.0, 0.0))
    log = aw.identification.read_log(write_log(tmp_path, floating, extra='lacks = ["gravity"]'))
    found = aw.identification.identify_arm(log, arm, checks=(), record=False)
    assert found.verdict == "identified"
    assert found.fit.r2.min() > 0.99
    wrong = aw.identification.identify_arm(log, arm, checks=(), record=False, terms=ArmTerms(lacks=()))
    assert np.nanmax(np.abs(wrong.fit.values - 0.0)) > 0  # gravity at work, and absent from the torque
    assert wrong.fit.r2.min() < found.fit.r2.min()


def test_springs_stay_where_they_lower_the_held_out_error(tmp_path):
    arm = aw.load("lwa4p")
    joints = list(arm.record.joints)
    joints[1] = joints[1].replace(spring={"stiffness_n_m_per_rad": 30.0, "rest_rad": 0.2})
    aw.robotfiles.write_toml(arm.record.replace(joints=tuple(joints)), tmp_path / "sprung.toml")
    sprung = aw.load(tmp_path / "sprung.toml")
    log = aw.identification.read_log(write_log(tmp_path, sprung))
    found = aw.identification.identify_arm(log, arm, terms=ArmTerms(springs=("joint2", "joint3")), checks=())
    names = found.estimate.names
    assert "k2" in names
    assert "k3" not in names
    assert abs(found.estimate["k2"] - 30.0) < 4 * found.estimate.std[names.index("k2")]
    again = aw.load(found.write(tmp_path / "found.toml"))
    assert again.bodies[1].spring is not None
    assert again.bodies[2].spring is None
    q, qd, qdd = np.random.default_rng(9).uniform(-1, 1, (3, 50, 6))
    expected = aw.compile(sprung).inverse_dynamics(q, qd, qdd)
    error = aw.compile(again).inverse_dynamics(q, qd, qdd) - expected
    assert (error.std(axis=0) < 0.03 * expected.std(axis=0)).all()


def test_springs_of_a_fit_add_to_those_of_the_record():
    """Motor torques of the record that is written are those of the old spring and of the fitted columns together."""
    arm, q = aw.load("lwa4p"), np.linspace(-2.5, 2.5, 41)
    linear = {"stiffness_n_m_per_rad": 10.0, "rest_rad": 0.3, "preload_n_m": 2.0}
    table = {"positions_rad": [-1.0, 0.0, 2.0], "torques_n_m": [3.0, 0.5, -4.0], "outside": "linear"}
    for old in (None, linear, table):
        for values in ({"spring": 7.0}, {"spring": 7.0, "sine": 3.0, "cosine": -2.0}):
            joint = arm.record.joints[1].replace(spring=old)
            joints = [joint if each.name == joint.name else each for each in arm.record.joints]
            body = build_model(arm.record.replace(joints=tuple(joints))).bodies[1]
            keys, path = spring_keys(body, values, "fit")
            after = [joint.replace(**keys) if each.name == joint.name else each for each in arm.record.joints]
            new = (
                build_model(arm.record.replace(joints=tuple(after), sources={**arm.record.sources, **FIT}))
                .bodies[1]
                .spring
            )
            before = 0.0 if body.spring is None else np.array([spring_torque(body.spring, x) for x in q])
            fitted = 7.0 * q + values.get("sine", 0.0) * np.sin(q) + values.get("cosine", 0.0) * np.cos(q)
            got = np.array([spring_torque(new, x) for x in q])
            np.testing.assert_allclose(got, before - fitted, atol=1e-9 if "sine" not in values else 4e-3)
            assert (path is None) == (old is not None or "sine" in values)


def test_logs_that_do_not_fit_the_arm_are_refused(tmp_path):
    arm = aw.load("lwa4p")
    log = aw.identification.read_log(write_log(tmp_path, arm, seconds=5))
    with pytest.raises(IdentificationError, match="arm"):
        aw.identification.identify_arm(log)
    with raises_at(LogError, "joints", r"6 \(.*7 \("):
        aw.identification.identify_arm(log, aw.load("panda"))
    with pytest.raises(IdentificationError, match="method"):
        aw.identification.identify_arm(log, arm, method="magic")
    with pytest.raises(LogError, match="cutoff"):
        aw.identification.identify_arm(log, arm, rows=FitRows(cutoff=1e6))


def test_joints_with_other_names_are_not_taken_by_order(tmp_path):
    arm = aw.load("lwa4p")
    path = write_log(tmp_path, arm, seconds=5)
    path.write_text(path.read_text().replace("'joint", "'j"))
    with raises_at(LogError, "joints", r"6 \('j1', .*6 \('joint1', "):
        aw.identification.identify_arm(aw.identification.read_log(path), arm)


@pytest.mark.sample(1)
@pytest.mark.parametrize("factor", [1e-3, 0.05, 1.0, 100.0])
def test_torques_of_another_unit_or_side_are_noticed(tmp_path, factor):
    """Torques N m for mN m, or of the motor for the joint's: R² is as good as ever, the links are not the record's."""
    arm = aw.load("lwa4p")
    path = write_log(tmp_path, arm)
    table = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    table[:, 1 + arm.n :] *= factor
    head = (tmp_path / "log.csv").read_text().splitlines()[0]
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=head, comments="", fmt="%.12g")
    found = aw.identification.identify_arm(aw.identification.read_log(path), arm, checks=(), record=False)
    said = [remark for remark in found.estimate.remarks if "times the torque of the record's own" in remark]
    assert found.verdict == ("identified" if factor == 1.0 else "not identified")
    assert len(said) == (factor != 1.0)
    if said:
        assert float(said[0].split("take ")[1].split()[0]) == pytest.approx(factor, rel=0.1)


@pytest.mark.parametrize("quantity", ["position", "torque"])
def test_a_wrong_sign_is_not_identified_and_said(tmp_path, quantity):
    """The friction of the joint would drive it, whatever else the fit finds to explain the rest."""
    arm = aw.load("lwa4p")
    path = write_log(tmp_path, arm, seconds=20.0)
    signs = f'quantity = "{quantity}"\nsigns = [1, 1, -1, 1, 1, 1]'
    path.write_text(path.read_text().replace(f'quantity = "{quantity}"', signs))
    found = aw.identification.identify_arm(aw.identification.read_log(path), arm, checks=(), record=False)
    assert found.verdict == "not identified"
    assert [each.split(":")[0] for each in found.estimate.remarks if "would drive it" in each] == ["joint3"]


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_mirrored_joint_that_hardly_moves_and_has_no_friction_is_said(tmp_path, mirrored):
    """No friction drives it, no inertia is below 0 and R² is 0.98: the other sign explains what is left."""
    arm = aw.load("two-link")
    t, q, qd, qdd = multisine(2, 10.0, 200.0, 3, 0.4)
    q[:, 1], qd[:, 1], qdd[:, 1] = 0.3 + 0.1 * (q[:, 1] - q[:, 1].mean()), 0.1 * qd[:, 1], 0.1 * qdd[:, 1]
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    tau += 0.05 * np.random.default_rng(0).normal(size=tau.shape)
    q[:, 1] *= -1 if mirrored else 1
    found = aw.identification.identify_arm(
        written_log(tmp_path, "log", arm.names, t, q, tau), arm, record=False, checks=()
    )
    said = [each for each in found.estimate.remarks if "goes with the other sign of its position" in each]
    assert [each.split(":")[0] for each in said] == ["elbow"] * mirrored
    assert found.verdict == ("not identified" if mirrored else "identified")


@pytest.mark.sample(1)
@pytest.mark.parametrize("ending", ["parquet", "nc", "mcap"])
def test_every_format_gives_the_fit_of_the_csv_file(tmp_path, ending):
    arm = aw.load("two-link")
    t, q, qd, qdd = multisine(2, 8.0, 200.0, 1, 0.5)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    first = aw.identification.identify_arm(
        written_log(tmp_path, "log", arm.names, t, q, tau), arm, record=False, checks=()
    )
    text = (tmp_path / "log.log.toml").read_text().replace("log.csv", f"log.{ending}")
    columns = {"t": t, **{f"q{k}": q[:, k] for k in (0, 1)}, **{f"u{k}": tau[:, k] for k in (0, 1)}}
    if ending == "mcap":
        pytest.importorskip("mcap_ros2.writer")
        write_joint_states(tmp_path / "log.mcap", list(arm.names), t, q, qd, tau)
        for k, name in enumerate(arm.names):
            text = text.replace(f"'q{k}'", f"'position/{name}'").replace(f"'u{k}'", f"'effort/{name}'")
        text = text.replace('column = "t"\nunit = "s"', 'column = "stamp"')
    elif ending == "nc":
        xr.Dataset({name: ("row", each) for name, each in columns.items()}).to_netcdf(tmp_path / "log.nc")
    else:
        pytest.importorskip("pyarrow")
        pd.DataFrame(columns).to_parquet(tmp_path / "log.parquet")
    (tmp_path / "log.log.toml").write_text(text)
    found = aw.identification.identify_arm(
        aw.identification.read_log(tmp_path / "log.log.toml"), arm, record=False, checks=()
    )
    np.testing.assert_allclose(found.fit.values, first.fit.values, atol=1e-5)
    assert found.verdict == first.verdict


@pytest.mark.sample(1)
@pytest.mark.parametrize("held", [False, True])
def test_a_joint_that_is_not_predicted_is_not_identified(tmp_path, held):
    """The torque of joint 1 is mostly something else: fitted with R² above 0, on parts or runs held out below 0.5."""
    arm = aw.load("lwa4p")
    for folder, seed in (("a", 0), ("b", 7)):
        (tmp_path / folder).mkdir()
        write_log(tmp_path / folder, arm, seconds=20, seed=seed)
        data = tmp_path / folder / "log.csv"
        head, table = data.read_text().splitlines()[0], np.loadtxt(data, delimiter=",", skiprows=1)
        table[:, 1 + arm.n] += 1.3 * table[:, 1 + arm.n].std() * 2**0.5 * np.sin(2 * np.pi * 0.77 * table[:, 0])
        np.savetxt(data, table, delimiter=",", header=head, comments="", fmt="%.12g")
    runs = "".join(
        f'[[runs]]\nname = "{name}"\nfiles.log = "{name}/log.csv"\n' + 'use = "hold-out"\n' * (name == "b")
        for name in ("a", "b")[: 1 + held]
    )
    text = (tmp_path / "a" / "arm.log.toml").read_text().replace('path = "log.csv"\n', "")
    path = tmp_path / "arm.log.toml"
    path.write_text(text.replace("[time]", runs + "[time]"))
    found = aw.identification.identify_arm(aw.identification.read_log(path), arm, checks=(), record=False)
    where = "on the runs held out" if held else "on parts held out"
    assert found.fit.r2[0] > 0
    assert found.verdict == "not identified"
    assert [r.split(":")[0] for r in found.estimate.remarks if f"{where}, below 0.5" in r] == ["joint1"], str(found)


@pytest.fixture(scope="module")
def tx40(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tx40")
    log = aw.identification.read_log(log_of(folder, "staubli_tx40", TX40))
    return log, aw.load(tx40_urdf(folder), kinematics_only=True)


def test_tx40(tx40, tmp_path):
    """Rank, R², rotors and friction beside the references of SOURCE.md there."""
    log, arm = tx40
    found = aw.identification.identify_arm(log, arm, rows=FitRows(cutoff=100, decimate=20))
    assert found.structural == len(found.formulas) == 61
    assert (found.fit.r2 >= np.array([0.990, 0.977, 0.961, 0.973, 0.960, 0.963]) - 0.003).all()
    assert found.record is not None
    assert (found.fit.r2 - found.record.r2 <= 0.01).all()
    values = dict(zip(found.estimate.names, found.fit.values, strict=True))
    reference = {
        "fv1": 8.05,
        "fv2": 5.53,
        "fv3": 1.97,
        "fv4": 1.11,
        "fvm6": 0.616,
        "fc1": 7.14,
        "fc2": 8.26,
        "fc3": 6.34,
        "fc4": 2.48,
        "fc5": 3.03,
        "fcm6": 1.95,
    }
    for name, expected in reference.items():
        assert values[name] == pytest.approx(expected, rel=0.05), name
    rotors = {"Ia3": 0.0988, "Ia4": 0.0313, "Iam6": 0.00964}
    for name, expected in rotors.items():
        assert abs(values[name] - expected) < 2 * found.estimate.std[found.estimate.names.index(name)], name
    # The reference's joint 5 has once more what turns with it of motor 6.
    assert values["fv5"] + values["fvm6"] == pytest.approx(1.86, rel=0.05)
    assert values["Ia5"] + values["Iam6"] == pytest.approx(0.0468, rel=0.1)
    # the rotor turns with joint 5
    assert abs(values["Ia6"]) < 2 * found.estimate.std[found.estimate.names.index("Ia6")]
    again = aw.load(found.write(tmp_path / "tx40.toml"))
    assert again.record.fits["fit"].verdict == "identified"
    assert again.bodies[5].drive.coupling == (("joint5", 32.0),)


@pytest.mark.study
def test_tx40_predicts_seconds_that_it_has_not_seen(tx40):
    log, arm = tx40
    found = aw.identification.identify_arm(log, arm, rows=FitRows(cutoff=100, decimate=20), record=False, checks=())
    model = found.fit.equations.model
    prepared = aw.identification.choose_preparation(log, cutoff=100, decimate=20)
    equations = equations_of(stream_of(log, arm, None, prepared).samples(model), model, part_seconds=1.0)
    held = cross_validated(fit_arm(equations, found.fit.base))
    assert [each.at_rest for each in held] == [False] * 8 + [True]
    assert max(each.error for each in held) <= 0.16


@pytest.mark.study
def test_lwa_4p_is_predicted_on_runs_held_out(tmp_path):
    """Joint 2 least: its R² was below 0.5 with the cut-off of the motion's band, and is 0.70 with the one that predicts best."""
    folders = sorted((DATA / "schunk_lwa4p").glob("measurement_*[1234]"))
    if not folders:
        pytest.skip(f"the measurements are not here: {DATA}")
    fit, held = ([each.as_posix() for each in folders[k::2]] for k in (0, 1))
    log = aw.identification.read_log(log_of(tmp_path, "schunk_lwa4p", LWA_4P, fit=fit, held=held))
    found = aw.identification.identify_arm(log, aw.load("lwa4p"), friction=("viscous",), record=False, checks=())
    assert found.hold_out is not None
    found_r2 = np.array([each.written.r2 for each in found.hold_out.rows])
    assert (found_r2[[0, 2, 3, 4, 5]] > 0.7).all()
    assert found_r2.argmin() == 1
    assert found_r2[1] > 0.65
