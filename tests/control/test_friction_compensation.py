"""Friction compensation: a joint that sticks reaches its dead band, rests there, and hunts with too much of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from simulation.plants import pendulum

DRY = {"coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.0}
SERVO = aw.JointPID(kp=60.0, kd=10.0)


def end(law, goal=0.02, duration=2.0):
    """Positions in the second half of a move that PD alone does not begin: kp · goal is below the friction."""
    model = pendulum("torque", gravity=0.0, friction=DRY)
    run = aw.simulate(aw.Scenario(model, duration=duration, loop=aw.Loop(law, np.array([goal]), 1e-3)))
    assert run.attrs["controller"] == "compiled"
    return run.q.values[500 * int(duration) :, 0] - goal


def test_pd_sticks_and_compensation_reaches_the_dead_band_and_rests():
    assert end(SERVO)[-1] == -0.02
    for band in (0.004, 0.001):
        rest = end(aw.FrictionCompensation(SERVO, dead_band=band, rest_speed=1e-3))
        assert np.abs(rest).max() <= band
        assert np.ptp(rest) == 0.0


def test_more_than_the_friction_hunts():
    """It drives the joint past its reference until kp e makes up for what is too much, (share - 1) Fc / kp."""
    hunting = end(aw.FrictionCompensation(SERVO, dead_band=0.0, rest_speed=1e-3, share=1.5), duration=4.0)
    assert hunting.min() < -0.005
    assert 0.005 < hunting.max() < 0.5 * 2.0 / 60.0


def test_bad_fields_are_refused():
    for fields, said in (({"rest_speed": 0.0}, "rest_speed of joint"), ({"share": -1.0}, "share of joint")):
        given: dict[str, Any] = {"dead_band": 0.0, "rest_speed": 1e-3, **fields}
        law = aw.FrictionCompensation(SERVO, **given)
        with pytest.raises(ScenarioError, match=said):
            law.configure(pendulum("torque"), 1e-3)
