"""Sensors that cannot be are refused in one line that names the field, its value and what was expected."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.simulation.loop.sensors import Sensors
from physics.arms import arm


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"counts": "x"}, "sensors: counts = 'x': expected counts above 0 in one turn, or one for each joint"),
        ({"counts": 0}, "sensors: counts = 0: expected counts above 0"),
        ({"counts": [4096, -1]}, "sensors: counts = -1 of joint 1: expected counts above 0"),
        ({"counts": np.inf}, "sensors: counts = inf: expected counts above 0"),
        ({"counts": True}, "sensors: counts = True: expected counts above 0"),
        ({"velocity": "filtered", "cutoff_hz": "x"}, "sensors: cutoff_hz = 'x': expected a frequency above 0"),
        ({"velocity": "filtered", "cutoff_hz": [1, 2]}, r"sensors: cutoff_hz = \[1, 2\]: expected a frequency above 0"),
        ({"velocity": "observer"}, "sensors: cutoff_hz = None: expected a frequency above 0"),
        ({"cutoff_hz": 50}, "sensors: cutoff_hz goes with velocity = 'filtered' or 'observer', not 'exact'"),
        ({"velocity": "filterd", "cutoff_hz": 50}, "sensors: velocity = 'filterd': unknown; did you mean filtered"),
        ({"velocity": np.zeros(2)}, r"sensors: velocity = \[0.0, 0.0\]: unknown"),
        ({"side": "load"}, "sensors: side = 'load': unknown; there is link, motor"),
        ({"position_noise": "x"}, "sensors: position_noise = 'x': expected a number of 0 or more"),
        ({"position_noise": [1, 2]}, r"sensors: position_noise = \[1, 2\]: expected a number of 0 or more"),
        ({"velocity_noise": np.inf}, "sensors: velocity_noise = inf: expected a number of 0 or more"),
        ({"current_noise": -1}, "sensors: current_noise = -1: expected a number of 0 or more"),
        ({"current_noise": None}, "sensors: current_noise = None: expected a number of 0 or more"),
    ],
)
def test_bad_sensors_are_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        Sensors(**fields)


def test_counts_are_one_number_or_one_for_each_joint():
    law = lambda t, r, y: 0.0 * y.q  # noqa: E731
    common = {"controller": law, "sample_period": 1e-3, "duration": 0.01}
    said = r"sensors: counts = \[1, 2\] holds 2; expected one number, or 6: joint1"
    with pytest.raises(ScenarioError, match=said):
        aw.simulate(aw.Scenario(arm("cmu-dd"), sensors=Sensors(counts=[1, 2]), **common))
    each = aw.simulate(aw.Scenario(arm("cmu-dd"), sensors=Sensors(counts=[4096] * 6), **common))
    same = aw.simulate(aw.Scenario(arm("cmu-dd"), sensors=Sensors(counts=4096), **common))
    np.testing.assert_array_equal(each.q_measured.values, same.q_measured.values)
