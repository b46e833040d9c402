"""Built-in arms identified from logs of their own inverse dynamics: their numbers come back."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.torque_model import USUAL_FRICTION
from identification.arm.moved_arm import written_log
from identification.arm.simulated_log import motion

NOISE = 0.002  # of a joint's root mean square torque
BY_DIRECTION = ("puma560", "ur10")  # Coulomb friction has a level each way
SIGMOID = ("panda",)  # no fit of an arm has that law
TWINS = ("so100", "ur3")  # so101 and ur5 in other sizes


def own_log(folder, arm, seconds=40.0, rate=200.0):
    """A log of the arm's torques along five sines for each joint, with noise in proportion to them."""
    t, q, qd, qdd = motion(arm.n, seconds, rate)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    noise = NOISE * np.sqrt(np.mean(tau**2, axis=0))
    return written_log(folder, "log", arm.names, t, q, tau + noise * np.random.default_rng(1).normal(size=tau.shape))


@pytest.mark.study
@pytest.mark.parametrize("name", [name for name in aw.builtin_names() if name not in SIGMOID + TWINS])
def test_its_own_log_returns_its_numbers(name, tmp_path):
    arm = aw.load(name)
    friction = ("viscous", "asymmetric") if name in BY_DIRECTION else USUAL_FRICTION
    found = aw.identification.identify_arm(own_log(tmp_path, arm), arm, friction=friction, checks=())
    assert found.verdict == "identified", str(found)
    assert found.structural == len(found.formulas)
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    z = (found.fit.values - truth) / found.fit.std
    loaded = any(body.friction is not None and body.friction.law == "load-dependent" for body in arm.coordinates)
    assert np.sqrt(np.mean(z**2)) < (2.0 if loaded else 1.4)  # a low-pass rounds the kinks of what loads add
    assert np.abs(z).max() < 4.5
    again = aw.load(found.write(tmp_path / "found.toml"))
    q, qd, qdd = np.random.default_rng(9).uniform(-1.0, 1.0, (3, 50, arm.n))
    expected = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    error = aw.compile(again).inverse_dynamics(q, qd, qdd) - expected
    assert (error.std(axis=0) < 1e-3 * expected.std(axis=0)).all()
