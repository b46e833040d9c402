"""Friction that the simulation knows is found again, and no term stays that the log does not ask for."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.arm.friction import friction_over_speed, identify_friction, with_identified_friction
from armwright.identification.arm.friction_law import FrictionLaw, FrictionRows, choose_terms, fitted_law
from armwright.model import build_model
from identification.arm.moved_arm import moved

USUAL = {"viscous": 1.5, "coulomb_positive": 2.0, "coulomb_negative": 2.6}


def rows(terms, values, seed=0, noise=0.2, count=3000) -> FrictionRows:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 60, count)
    speed = 2 * np.sin(t) + 0.8 * np.sin(2.3 * t + 1)
    q, load, warming = np.cumsum(speed) * 0.02, 20 * np.sin(0.7 * t) ** 2, 20 * (1 - np.exp(-t / 20))
    empty = FrictionRows(q, speed, 0 * t, load, warming)
    torque = FrictionLaw(tuple(terms), values)(empty) + noise * rng.normal(size=count)
    return FrictionRows(q, speed, torque, load, warming)


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
    path = aw.write_into(again, found, tmp_path / "rubbed.toml", key="friction")
    assert aw.load(path).record.joints[0].friction.viscous_n_m_s_per_rad.std > 0


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


def test_bad_input_is_refused(tmp_path):
    arm = aw.load("lwa4p")
    log = moved(tmp_path, "arm", arm, seconds=2.0)
    with pytest.raises(IdentificationError, match="unknown"):
        identify_friction(log, arm, candidates=("magic",))
