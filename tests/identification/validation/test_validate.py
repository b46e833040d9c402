"""A record passes against a log of its own truth, and what is wrong with another one is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, LogError
from armwright.identification.validation.validate import validate
from identification.validation.made_logs import driven, motor_file, random_steps, written_log
from raises_at import raises_at

PERIOD = 2e-3
SEEN = ("position", "speed", "torque")


@pytest.fixture(scope="module")
def two_link(tmp_path_factory):
    """The log of a two-link arm under smooth torques, and its own model."""
    folder, arm = tmp_path_factory.mktemp("two"), aw.load("two-link")
    return arm, written_log(folder, list(arm.names), {name: _motion(arm, k) for k, name in enumerate(("fit", "held"))})


def _motion(arm, seed: int) -> dict:
    """A sum of sines and the torques that it takes, with noise of 0.1 %."""
    t = PERIOD * np.arange(3000)
    rng = np.random.default_rng(seed)
    q, qd, qdd = (np.zeros((len(t), 2)) for _ in range(3))
    for k in range(1, 5):
        a, phase = rng.uniform(-0.4, 0.4, 2) / k, rng.uniform(0, 6, 2)
        w = 2 * np.pi * 0.33 * k
        x = w * t[:, None] + phase
        q, qd, qdd = q + a * np.sin(x), qd + a * w * np.cos(x), qdd - a * w**2 * np.sin(x)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    noise = 1e-3 * tau.std(axis=0) * rng.normal(size=tau.shape)
    return {"t": t, "position": q, "speed": qd, "torque": tau + noise}


@pytest.fixture(scope="module")
def motor_log(tmp_path_factory):
    """The log of a geared motor with friction under steps of voltage, and the path of its record."""
    folder = tmp_path_factory.mktemp("motor")
    path = motor_file(folder)
    arm = aw.load(path)
    tables = {
        name: driven(arm, random_steps(2000, 100, [6.0], k), PERIOD, ("speed", "voltage"), 0.005)
        for k, name in enumerate(("fit", "held"))
    }
    return path, written_log(folder, ["motor"], tables)


def test_the_true_record_passes_and_predicts_torques(two_link):
    arm, log = two_link
    found = validate(arm, log, simulation=False)
    assert found.passed
    assert found.held_out
    assert found.runs == ("held",)
    assert [each.overall.r2 > 0.999 for each in found.measures] == [True, True]
    assert all(not each.remarks for each in found.measures)
    assert found.sentences()[0] == found.verdict == "passes: all 2 limits are kept"
    assert found.verdict in str(found)


def test_a_free_simulation_of_the_truth_stays_on_the_log_within_its_windows(two_link):
    arm, log = two_link
    found = validate(arm, log, window=0.2)
    assert {each.quantity for each in found.measures} == {"torque", "position", "speed"}
    assert all(each.overall.r2 > 0.999 for each in found.measures)
    assert any("windows of 0.2 s" in note for note in found.notes)
    assert found.of("position", "elbow").overall.rms < 2e-3


def test_a_wrong_sign_is_named(two_link):
    arm, log = two_link
    text = log.read_text().replace('unit = "N m"', 'unit = "N m"\nsigns = [1, -1]')
    other = log.with_name("sign.log.toml")
    other.write_text(text)
    log = aw.identification.read_log(other)
    found = validate(arm, log, simulation=False)
    assert not found.passed
    assert found.of("torque", "elbow").overall.correlation < -0.99
    assert "the sign of the torque looks wrong" in found.of("torque", "elbow").remarks[0]


def test_a_wrong_scale_is_named(two_link):
    arm, log = two_link
    other = log.with_name("scale.log.toml")
    other.write_text(log.read_text().replace('columns = ["tau0", "tau1"]', 'columns = ["tau0", "tau1"]\nsigns = 1'))
    half = aw.load("two-link").replace(gravity=2 * arm.gravity)
    doubled = half.with_values({f"{link}.mass_kg": 2 * value for link, value in (("upper_arm", 6.0), ("forearm", 4.0))})
    heavy = doubled.replace(gravity=arm.gravity)
    found = validate(heavy, other, simulation=False)
    remark = found.of("torque", "shoulder").remarks[0]
    assert found.of("torque", "shoulder").overall.gain == pytest.approx(0.5, abs=0.1)
    assert "this looks like a wrong gear ratio or torque constant" in remark


def test_a_missing_torque_costs_its_window_and_no_more(tmp_path, two_link):
    arm, _ = two_link
    table = _motion(arm, 1)
    table["torque"][[700, 701, 2000], [0, 1, 1]] = np.nan
    log = written_log(tmp_path, list(arm.names), {"fit": _motion(arm, 0), "held": table})
    found = validate(arm, log)
    (note,) = [each for each in found.notes if each.startswith("free simulation")]
    assert "of which 2 of " in note
    assert found.of("position", arm.names[0]).overall.r2 > 0.999
    table["torque"][::40] = np.nan
    log = written_log(tmp_path, list(arm.names), {"fit": _motion(arm, 0), "held": table})
    with raises_at(LogError, "signals"):
        validate(arm, log, window=0.5)


def test_free_simulation_of_a_motor_from_its_voltage(motor_log):
    record, log = motor_log
    found = validate(record, log)
    assert found.passed
    assert found.of("speed", "motor").overall.fit > 98.5  # 0.5 % of noise at both ends
    assert "no torque prediction" in found.notes[0]
    assert found.predictions[0].how.endswith("whole stretches")


def test_what_a_motor_without_its_friction_does(motor_log):
    record, log = motor_log
    frictionless = motor_file(record.parent, coulomb="", name="smooth.toml")
    found = validate(frictionless, log, limits={"speed": {"fit_at_least": 95}})
    assert not found.passed
    assert found.checks[0].key == "fit_at_least"
    assert "FAILS fit" in str(found)


def test_missing_coulomb_friction_shows_in_torques(tmp_path):
    arm = aw.load(motor_file(tmp_path))
    t = PERIOD * np.arange(3000)
    q = np.sin(3.0 * t)[:, None]
    qd, qdd = 3 * np.cos(3.0 * t)[:, None], -9 * np.sin(3.0 * t)[:, None]
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    table = {"t": t, "position": q, "current": tau / (10.0 * 0.04)}
    log = written_log(tmp_path, ["motor"], {"fit": table, "held": table})
    found = validate(motor_file(tmp_path, coulomb="", name="smooth.toml"), log, simulation=False)
    signature = found.of("torque", "motor").friction
    assert signature is not None
    assert signature.missing[0].name == "Coulomb"
    assert signature.missing[0].value == pytest.approx(0.15, rel=0.05)
    assert "torques measured from currents" in found.predictions[0].how


@pytest.mark.parametrize(("command", "size"), [("torque", 0.8), ("voltage", 8.0)])
def test_an_exact_record_lacks_no_friction_and_no_delay(tmp_path, command, size):
    """Commands that are held from row to row drive a motor with Coulomb friction; its own record predicts their torques."""
    record = motor_file(tmp_path)
    record.write_text(record.read_text().replace('command = "voltage"', f'command = "{command}"'))
    arm = aw.load(record)
    tables = {
        name: driven(arm, random_steps(3000, 50, [size], k), PERIOD, ("position", command))
        for k, name in enumerate(("fit", "held"))
    }
    log = written_log(tmp_path, ["motor"], tables)
    instants = validate(record, log, simulation=False).of("torque", "motor")
    assert instants.delay is not None
    assert instants.delay.samples == pytest.approx(-0.5, abs=0.1)
    assert "held = true" in " ".join(instants.remarks)

    unit = "V" if command == "voltage" else "N m"
    log.write_text(log.read_text().replace(f'unit = "{unit}"', f'unit = "{unit}"\nheld = true'))
    found = validate(record, log, simulation=False).of("torque", "motor")
    assert found.overall.r2 > 0.995
    assert found.overall.r2 > instants.overall.r2
    assert found.delay is not None
    assert abs(found.delay.samples) < 0.05
    assert found.friction is not None
    assert found.remarks == ()
    values = {term.name: term.value for term in found.friction.terms}
    assert abs(values["Coulomb"]) < 0.02 * 0.15
    assert abs(values["viscous"]) < 0.02 * 0.02


def test_without_held_out_runs_all_are_judged_and_that_is_said(two_link):
    arm, log = two_link
    other = log.with_name("all.log.toml")
    other.write_text(log.read_text().replace('use = "hold-out"', 'use = "fit"'))
    found = validate(arm, other, simulation=False)
    assert found.runs == ("fit", "held")
    assert not found.held_out
    assert "flatter" in found.notes[0]
    low, high = found.of("torque", "elbow").spread
    assert low < high


def test_joints_at_rest_are_reported_apart_and_not_judged(tmp_path):
    arm = aw.load("two-link")
    table = _motion(arm, 3)
    still = {name: np.array(values) for name, values in table.items()}
    still["position"] = np.tile(still["position"][:1], (3000, 1))
    still["speed"] = np.zeros((3000, 2))
    still["torque"] = np.tile(aw.compile(arm).gravity_torques(still["position"][0]), (3000, 1)) + 0.5
    log = written_log(tmp_path, list(arm.names), {"fit": table, "held": still})
    found = validate(arm, aw.identification.read_log(log, on_error="keep"), simulation=False)
    elbow = found.of("torque", "elbow")
    assert elbow.runs == {}
    rest = elbow.at_rest["held"]
    assert rest.measured - rest.predicted == pytest.approx(0.5, abs=1e-6)
    assert found.checks == ()
    assert not found.passed


def test_a_pass_names_the_joints_that_were_not_judged(tmp_path):
    """The shoulder moves and the elbow rests: nothing is said about the elbow's torques."""
    arm = aw.load("two-link")
    table = {name: np.array(values) for name, values in _motion(arm, 3).items()}
    table["position"][:, 1], table["speed"][:, 1] = 0.4, 0.0
    acceleration = np.gradient(table["speed"], table["t"], axis=0)
    table["torque"] = aw.compile(arm).inverse_dynamics(table["position"], table["speed"], acceleration)
    log = written_log(tmp_path, list(arm.names), {"fit": table, "held": table})
    found = validate(arm, aw.identification.read_log(log, on_error="keep"), simulation=False)
    assert found.passed
    assert found.unjudged == ("elbow",)
    assert found.verdict == "passes: all 1 limits that could be judged are kept; not judged: elbow"


def test_limits_by_joint_and_default(two_link):
    arm, log = two_link
    limits = {"torque": {"r2_at_least": 0.5}, "joints": {"elbow": {"torque": {"rms_at_most_n_m": 1e-9}}}}
    found = validate(arm, log, limits=limits, simulation=False)
    kept = {(check.joint, check.key): check.passed for check in found.checks}
    assert kept == {
        ("shoulder", "r2_at_least"): True,
        ("elbow", "r2_at_least"): True,
        ("elbow", "rms_at_most_n_m"): False,
    }


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"joints": {"wrist": {}}}, "wrist"),
        ({"torque": {"r2_at_last": 0.9}}, "r2_at_least"),
        ({"torque": {"r2_at_least": 1.5}}, "r2_at_least"),
        ({"joints": {"elbow": {"torque": {"rms_at_most_n": 1.0}}}}, "N m"),
        ({"speed": {"fit_at_least": 50}}, "was not predicted"),
        (5, "TOML"),
        ("no-such.toml", "no such file"),
    ],
)
def test_limits_that_cannot_be(two_link, limits, words):
    arm, log = two_link
    with pytest.raises(LogError, match=words):
        validate(arm, log, limits=limits, simulation=False)


def test_arms_and_logs_that_do_not_match(two_link, motor_log):
    arm, log = two_link
    record, _ = motor_log
    with raises_at(LogError, "joints", r"2 \('shoulder', 'elbow'\).*1 \('motor'\)"):
        validate(record, log)
    with raises_at(LogError, "run", value="third"):
        validate(arm, log, runs=["third"])
    massless = replace(
        arm,
        bodies=tuple(
            replace(body, mass=0.0, first_moment=np.zeros(3), inertia=np.zeros((3, 3))) for body in arm.bodies
        ),
    )
    with pytest.raises(ArmwrightError, match="no masses"):
        validate(massless, log)


def test_terms_that_the_torques_lack_are_taken_off_the_record(tmp_path):
    arm = aw.load("two-link")
    table = _motion(arm.replace(gravity=np.zeros(3)), 0)
    log = written_log(tmp_path, list(arm.names), {"fit": table, "held": table})
    assert not validate(arm, log, simulation=False).passed
    log.write_text(log.read_text().replace('unit = "N m"', 'unit = "N m"\nlacks = ["gravity"]'))
    found = validate(arm, log, simulation=False)
    assert found.of("torque", "shoulder").overall.r2 > 0.999
    assert "lack gravity" in found.notes[0]


def test_a_log_of_currents_needs_motor_constants(tmp_path):
    arm = aw.load("two-link")
    table = _motion(arm, 0)
    table = {"t": table["t"], "position": table["position"], "current": table["torque"]}
    log = written_log(tmp_path, list(arm.names), {"fit": table, "held": table})
    with pytest.raises(LogError, match="torque_constant_n_m_per_a"):
        validate(arm, log)


def test_a_log_of_motion_alone(tmp_path):
    arm = aw.load("two-link")
    table = {name: values for name, values in _motion(arm, 0).items() if name != "torque"}
    log = written_log(tmp_path, list(arm.names), {"fit": table, "held": table})
    with raises_at(LogError, "signals", "torque nor current"):
        validate(arm, log)


def test_speeds_alone_do_not_do_for_an_arm_under_gravity(tmp_path):
    arm = aw.load("two-link")
    table = {name: values for name, values in _motion(arm, 0).items() if name != "position"}
    log = written_log(tmp_path, list(arm.names), {"fit": table, "held": table})
    with raises_at(LogError, "position", "torques of two-link"):
        validate(arm, log)


def test_a_scenario_beside_its_own_log(tmp_path):
    arm = aw.load("two-link")
    loop = aw.Loop(
        aw.ComputedTorque(kp=100.0, kd=20.0), reference=aw.trajectories.Sine([0.0, 0.0], [0.4, 0.3], 0.5), period=0.004
    )
    scenario = aw.Scenario(arm, 2.0, loop=loop)
    run = aw.simulate(scenario)
    table = {"t": run["time"].values, "position": run["q"].values, "speed": run["qd"].values}
    log = written_log(tmp_path, list(arm.names), {"fit": table, "held": table})
    found = validate(scenario, log)
    assert found.passed
    assert found.of("position", "elbow").overall.rms < 1e-6
    heavy = arm.with_values({"forearm.mass_kg": 8.0})
    nominal = aw.Loop(aw.ComputedTorque(kp=100.0, kd=20.0, model=arm), reference=loop.reference, period=0.004)
    worse = validate(aw.Scenario(heavy, 2.0, loop=nominal), log)
    assert worse.of("position", "elbow").overall.rms > 100 * found.of("position", "elbow").overall.rms
