"""Friction that the simulation knows is found again, and no term stays that the log does not ask for."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.arm.friction import friction_over_speed, identify_friction, with_identified_friction
from armwright.identification.arm.friction_law import FittedFriction, FrictionRows, choose_terms, fitted_law
from armwright.model import build_model
from armwright.results.csv_tables import write_table
from identification.arm.moved_arm import moved, multisine, written_log
from identification.arm.two_runs import two_runs

USUAL_KEYS = {"viscous_n_m_s_per_rad": 1.5, "coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.6}
USUAL = {"viscous": 1.5, "coulomb_positive": 2.0, "coulomb_negative": 2.6}


def rows(terms, values, seed=0, noise=0.2, count=3000) -> FrictionRows:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 60, count)
    speed = 2 * np.sin(t) + 0.8 * np.sin(2.3 * t + 1)
    q, load, warming = np.cumsum(speed) * 0.02, 20 * np.sin(0.7 * t) ** 2, 20 * (1 - np.exp(-t / 20))
    empty = FrictionRows(q, speed, 0 * t, load, warming)
    torque = FittedFriction(tuple(terms), values)(empty) + noise * rng.normal(size=count)
    return FrictionRows(q, speed, torque, load, warming)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("term", "values"),
    [
        (None, {}),
        ("stribeck", {"stribeck_torque": 4.0, "stribeck_speed": 0.3}),
        ("load", {"load_coefficient": 0.08}),
        ("coulomb by temperature", {"coulomb_temperature_coefficient_per_k": -0.02}),
        ("viscous by temperature", {"viscous_temperature_coefficient_per_k": -0.02}),
        ("counterbalance", {"sine": 1.0, "cosine": -0.7}),
    ],
)
def test_terms_that_are_there_stay_and_others_go(term, values):
    terms = ("viscous", "coulomb", *([term] if term else []))
    measured = rows(terms, {**USUAL, **values})
    choice = choose_terms(measured)
    assert set(choice.terms) == set(terms)
    law = fitted_law(measured, choice.terms)
    for stem, value in {**USUAL, **values}.items():
        assert law.values[stem] == pytest.approx(value, rel=0.05, abs=0.02), stem


def test_the_sigmoid_law_is_told_from_coulombs():
    values = {"viscous": 0.5, "sigmoid_amplitude": 4.0, "sigmoid_slope": 3.0, "sigmoid_shift": 0.05, "offset": 0.3}
    choice = choose_terms(rows(("viscous", "sigmoid"), values))
    assert choice.terms == ("viscous", "sigmoid")
    law = fitted_law(rows(("viscous", "sigmoid"), values), choice.terms)
    for stem, value in values.items():
        assert law.values[stem] == pytest.approx(value, rel=0.05, abs=0.05), stem


def test_a_table_over_speed():
    table = friction_over_speed(rows(("viscous", "coulomb"), USUAL))
    np.testing.assert_allclose(table[:, 1], 1.5 * table[:, 0] + np.where(table[:, 0] > 0, 2.0, -2.6), atol=0.1)
    assert (np.diff(table[:, 0]) > 0).all()


def test_friction_of_a_whole_arm(tmp_path):
    arm = aw.load("lwa4p")
    log = moved(tmp_path, "arm", arm, seconds=20.0, torque_noise=0.3, position_noise=1e-5)
    found = identify_friction(log, arm.replace(friction=None), candidates=("stribeck", "load"))
    for body in arm.coordinates:
        viscous, level = f"{body.joint}.friction.viscous_n_m_s_per_rad", f"{body.joint}.friction.coulomb_positive_n_m"
        assert found[viscous] == pytest.approx(
            float(body.friction.viscous), rel=0.03, abs=4 * found.std[found.number(viscous)]
        )
        assert found[level] == pytest.approx(float(body.friction.coulomb_positive), rel=0.05)
    again = with_identified_friction(arm, found)
    assert float(again.coordinates[0].friction.viscous) == pytest.approx(found["joint1.friction.viscous_n_m_s_per_rad"])
    path = aw.identification.write_into(again, found, tmp_path / "rubbed.toml", key="friction")
    assert aw.load(path).record.joints[0].friction.viscous_n_m_s_per_rad.std > 0


def test_friction_takes_the_place_of_that_of_an_earlier_fit():
    """The earlier fit keeps its other numbers, with their correlation."""
    arm = aw.load("lwa4p")
    joints = list(arm.record.joints)
    joints[0] = joints[0].replace(friction={**USUAL_KEYS, "offset_n_m": 0.1})
    names = ("joint1.friction.offset_n_m", "joint2.friction.viscous_n_m_s_per_rad", "joint1.motor.rotor_inertia_kg_m2")
    earlier = {
        "source": "old",
        "method": "least squares",
        "log_sha256": "0" * 64,
        "verdict": "identified",
        "names": names,
    }
    earlier |= {"correlation": [[], [0.1], [0.2, 0.3]], "at_bound": names[:1]}
    sources = {**arm.record.sources, "old": {"kind": "fit", "text": "an earlier one"}}
    fitted = build_model(arm.record.replace(joints=tuple(joints), fits={"old": earlier}, sources=sources))
    keys = tuple(f"joint1.friction.{key}" for key in USUAL_KEYS)
    found = aw.identification.Estimate(keys, np.array([*USUAL_KEYS.values()]), np.eye(3), "1" * 64, "friction")
    record = with_identified_friction(fitted, found).record
    assert record.joints[0].friction.offset_n_m is None
    assert record.fits["old"].names == names[1:]
    assert record.fits["old"].correlation == ((), (0.3,))
    assert record.fits["old"].at_bound == ()


def test_springs_reach_the_record(tmp_path):
    """The record that is written has the torque of a spring that stays."""
    arm = aw.load("lwa4p")
    joints = list(arm.record.joints)
    spring = {"stiffness_n_m_per_rad": 30.0, "rest_rad": 0.2}
    joints[1] = joints[1].replace(spring=spring)
    sprung = build_model(arm.record.replace(joints=tuple(joints)))
    log = moved(tmp_path, "sprung", sprung, seconds=20.0, torque_noise=0.3)
    found = identify_friction(log, arm, candidates=("spring",))
    again = with_identified_friction(arm, found).bodies
    assert [k for k, body in enumerate(again) if body.spring is not None] == [1]
    assert float(again[1].spring.stiffness) == pytest.approx(30.0, rel=0.03)
    friction = again[1].friction  # what the spring holds at 0 is the difference of Coulomb's levels
    constant = friction.offset + 0.5 * (friction.coulomb_positive - friction.coulomb_negative)
    assert float(constant) == pytest.approx(-30 * 0.2, abs=0.6)


PENDULUM = """
name = "pendulum"
source = "estimate"
command = "torque"
[[joints]]
name = "hinge"
type = "revolute"
parent = "base"
child = "rod"
axis = [0.0, 1.0, 0.0]
frame = { xyz_m = [0.0, 0.0, 0.0], rpy_rad = [0.0, 0.0, 0.0] }
motor = { gear_ratio = 50.0, rotor_inertia_kg_m2 = 2e-4, resistance_ohm = 1.2, torque_constant_n_m_per_a = 0.06 }
[[links]]
name = "rod"
mass_kg = 3.0
com_m = [0.0, 0.0, -0.4]
inertia_kg_m2 = { xx = 0.2, yy = 0.2, zz = 0.01, xy = 0.0, xz = 0.0, yz = 0.0 }
"""
BODY = "ambient_c = 25.0, reference_c = 20.0, winding_capacity_j_per_k = 8.0, winding_resistance_k_per_w = 1.5"
WARMS = f"0.06, thermal = {{ {BODY} }}"


def warming_log(folder, arm):
    """A log whose Coulomb level falls by 1 % a kelvin and whose viscous friction falls by 2 %, from 20 °C on."""
    t, q, qd, qdd = multisine(1, 60.0, 200.0, seed=3, harmonics=40)
    celsius = 20.0 + 25.0 * (1 - np.exp(-t / 25.0))
    warming = (celsius - 20.0)[:, None]
    friction = 1.5 * (1 - 0.02 * warming) * qd + 3.0 * (1 - 0.01 * warming) * np.sign(qd)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd) + friction
    tau = tau + 0.1 * np.random.default_rng(4).normal(size=tau.shape)
    written_log(folder, "warm", arm.names, t, q, tau)
    write_table(folder / "warm.csv", {"t": t, "q0": q[:, 0], "u0": tau[:, 0], "T": np.round(celsius, 1)})
    path = folder / "warm.log.toml"
    path.write_text(path.read_text(encoding="utf-8") + WARM, encoding="utf-8")
    return aw.identification.read_log(path)


WARM = """
[[signals]]
quantity = "temperature"
columns = "T"
unit = "°C"
"""


def test_friction_over_a_logged_temperature(tmp_path):
    (tmp_path / "arm.toml").write_text(PENDULUM.replace("0.06", WARMS), encoding="utf-8")
    arm = aw.load(tmp_path / "arm.toml")
    log = warming_log(tmp_path, arm)
    candidates = ("coulomb by temperature", "viscous by temperature")
    found = identify_friction(log, arm, candidates=candidates)
    truth = {"viscous_n_m_s_per_rad": 1.5, "coulomb_positive_n_m": 3.0, "coulomb_negative_n_m": 3.0}
    truth |= {"viscous_temperature_coefficient_per_k": -0.02, "coulomb_temperature_coefficient_per_k": -0.01}
    for key, value in truth.items():
        assert found[f"hinge.friction.{key}"] == pytest.approx(value, rel=0.05), key
    path = aw.identification.write_into(
        with_identified_friction(arm, found), found, tmp_path / "warm.toml", key="friction"
    )
    assert float(aw.load(path).bodies[0].friction.coulomb_temperature_coefficient) == pytest.approx(-0.01, rel=0.05)
    (tmp_path / "plain.toml").write_text(PENDULUM, encoding="utf-8")
    found = identify_friction(log, aw.load(tmp_path / "plain.toml"), candidates=candidates)
    assert "hinge.friction.viscous_temperature_coefficient_per_k" not in found.names
    assert any("reference_c" in remark for remark in found.remarks)


@pytest.mark.parametrize("is_warm", [False, True])
def test_runs_held_out_judge_the_friction(tmp_path, is_warm):
    """Fitted to a run with a third of the friction, as of a warm arm, the record predicts the cold run worse than the old one."""
    record, arms = aw.load("two-link").record, []
    for share in (1.0, 0.3):
        friction = {key: share * value for key, value in USUAL_KEYS.items()}
        arms.append(
            build_model(record.replace(joints=tuple(each.replace(friction=friction) for each in record.joints)))
        )
    cold, warm = arms
    log = aw.identification.read_log(two_runs(tmp_path / "log", warm if is_warm else cold, seconds=10.0, fresh=cold))
    found = identify_friction(log, cold, candidates=())
    judged = aw.identification.validate(with_identified_friction(cold, found), log, simulation=False)
    for joint in cold.names:
        assert found.fit[f"torque of {joint} (held out)"]["r2"] == judged.of("torque", joint).overall.r2
    before = found.fit["torque of elbow (held out, by the record before)"]["rms"]
    assert (found.fit["torque of elbow (held out)"]["rms"] > 2 * before) is is_warm
    assert found.verdict == ("not identified" if is_warm else "identified"), found.remarks


def test_numbers_that_no_record_can_have_are_not_identified(tmp_path):
    """Torques that miss more than the load, along with the speed's sign: the masses are not those of the record."""
    arm = aw.load("two-link")
    t, q, qd, qdd = multisine(arm.n, 10.0, 200.0, seed=0)
    known = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    log = written_log(tmp_path, "other", list(arm.names), t, q, known + 1.5 * np.abs(known) * np.sign(qd))
    found = identify_friction(log, arm, candidates=("load",))
    assert found["elbow.friction.load_coefficient"] == pytest.approx(1.5, rel=0.1)
    assert found.verdict == "not identified"
    assert any("shoulder.friction.load_coefficient = " in remark for remark in found.remarks)


def test_bad_input_is_refused(tmp_path):
    arm = aw.load("lwa4p")
    log = moved(tmp_path, "arm", arm, seconds=2.0)
    with pytest.raises(IdentificationError, match="unknown"):
        identify_friction(log, arm, candidates=("magic",))
