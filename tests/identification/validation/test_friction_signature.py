"""The signature names the term of friction that was left out, with its size."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.identification.validation.friction_signature import friction_signature

T = np.linspace(0.0, 10.0, 4000)
SPEED = np.cos(2.0 * T) + 0.4 * np.cos(7.0 * T + 1.0)
ACCELERATION = np.gradient(SPEED, T)
NOISE = 0.1 * np.random.default_rng(0).normal(size=len(T))
MISSING = {
    "Coulomb": (1.3, 1.3 * np.sign(SPEED)),
    "viscous": (0.8, 0.8 * SPEED),
    "inertia": (0.2, 0.2 * ACCELERATION),
    "offset": (-0.6, np.full(len(T), -0.6)),
}


@pytest.mark.parametrize("name", MISSING)
def test_one_missing_term_is_named_and_no_other(name):
    value, torque = MISSING[name]
    found = friction_signature(torque + NOISE, SPEED, ACCELERATION)
    assert found is not None
    (term,) = found.missing
    assert term.name == name
    assert term.value == pytest.approx(value, rel=0.03)
    assert abs(term.value - value) < 4 * term.std


def test_too_much_of_a_term_is_below_zero():
    found = friction_signature(-MISSING["Coulomb"][1] + NOISE, SPEED, ACCELERATION)
    assert found is not None
    assert found.missing[0].value == pytest.approx(-1.3, rel=0.03)


def test_a_stribeck_peak_is_told_from_coulomb_friction():
    peak = 2.0 * np.sign(SPEED) * np.exp(-((SPEED / 0.1) ** 2))
    found = friction_signature(MISSING["Coulomb"][1] + peak + 0.2 * NOISE, SPEED, ACCELERATION)
    assert found is not None
    assert {"Coulomb", "Stribeck"} <= {term.name for term in found.missing}
    slowest = np.argmin(np.abs(found.speed))
    assert np.argmax(np.abs(found.mean)) in (slowest - 1, slowest, slowest + 1)


def test_noise_misses_nothing():
    found = friction_signature(NOISE, SPEED, ACCELERATION)
    assert found is not None
    assert found.missing == ()


def test_a_joint_at_rest_has_no_signature():
    assert friction_signature(NOISE, np.zeros(len(T)), np.zeros(len(T))) is None
    one_way = friction_signature(NOISE, np.abs(SPEED) + 0.1, ACCELERATION)  # offset and Coulomb cannot be told apart
    assert one_way is not None
    assert "Coulomb" not in [term.name for term in one_way.terms]
