"""Built-in arms identified from logs of their own inverse dynamics: their numbers come back."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.description.paths import with_values
from armwright.identification.arm.torque_model import USUAL_FRICTION
from armwright.model import build_model
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


@pytest.mark.parametrize(
    ("name", "share"),
    [("open-manipulator-x", 0.7)]
    + [
        pytest.param(name, share, marks=pytest.mark.study)
        for name in ("open-manipulator-x", "koch")
        for share in (0.5, 0.97, 1.3, 1.5)
    ],
)
def test_a_record_with_other_friction_by_load_does_not_count_as_identified(name, share, tmp_path):
    """What loads add is the record's: where that is wrong, masses make up for it, far beyond their intervals."""
    arm = aw.load(name)
    loads = [path for path in arm.parameters.names if ".friction.load_" in path]
    others = {path: share * float(arm.parameters[path].value) for path in loads}
    wrong = build_model(with_values(arm.record, others))
    found = aw.identification.identify_arm(own_log(tmp_path, arm), wrong, checks=())
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    masses = [b for b, k in enumerate(found.fit.base.independent) if found.fit.base.columns[k].kind == "inertial"]
    assert np.abs((found.fit.values - truth) / found.fit.std)[masses].max() > 4.5
    assert found.verdict == "not identified"
    assert any("what loads add to its friction" in each for each in found.sentences())
