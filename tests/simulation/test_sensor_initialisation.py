"""An arm at rest is measured at rest from the first tick on, however coarse its encoders are. Design section 4."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.control import JointPID
from simulation.fields import scenario_of

Q = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.sample(1)
@pytest.mark.parametrize("velocity", ["difference", "filtered", "observer"])
@pytest.mark.parametrize("side", ["motor", "link"])
def test_coarse_counts_give_no_speed_at_rest(velocity, side):
    cutoff = None if velocity == "difference" else 100.0
    sensors = aw.Sensors(counts=1000, side=side, velocity=velocity, cutoff_hz=cutoff)
    more = {"controller": JointPID(kp=0.0, kd=40.0), "sensors": sensors, "period": 1e-3}
    run = aw.simulate(scenario_of(aw.load("cmu-dd"), q0=Q, reference=Q, duration=0.002, **more))
    assert run.q_measured[0, 1] != Q[1]
    np.testing.assert_allclose(run.qd_measured[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(run.u_issued[0], 0.0, atol=1e-9)
