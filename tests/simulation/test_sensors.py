"""Sensors that cannot be are refused in one line that names the field, its value and what was expected."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.simulation.loop.sensors import Sensors
from physics.arms import arm
from simulation.fields import scenario_of


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"counts": "x"}, r"sensors\.counts = 'x'"),
        ({"counts": 0}, "sensors.counts = 0.0: expected counts above 0"),
        ({"counts": [4096, -1]}, r"sensors\.counts\[1\] = -1\.0"),
        ({"counts": np.inf}, "sensors.counts = inf: expected counts above 0"),
        ({"counts": True}, r"sensors\.counts = True"),
        ({"velocity": "filtered", "cutoff_hz": "x"}, r"sensors\.cutoff_hz = 'x'"),
        ({"velocity": "filtered", "cutoff_hz": [1, 2]}, r"sensors\.cutoff_hz = \[1, 2\]"),
        ({"velocity": "observer"}, r"sensors\.cutoff_hz = None"),
        ({"cutoff_hz": 50}, r"sensors\.cutoff_hz = 50"),
        ({"velocity": "filterd", "cutoff_hz": 50}, r"sensors\.velocity = 'filterd'"),
        ({"velocity": np.zeros(2)}, r"sensors\.velocity = \[0\.0, 0\.0\]"),
        ({"side": "load"}, r"sensors\.side = 'load'"),
        ({"position_noise": "x"}, r"sensors\.position_noise = 'x'"),
        ({"position_noise": [1, 2]}, r"sensors\.position_noise = \[1, 2\]"),
        ({"velocity_noise": np.inf}, "sensors.velocity_noise = inf: expected a number of 0 or more"),
        ({"current_noise": -1}, "sensors.current_noise = -1.0: expected a number of 0 or more"),
        ({"current_noise": None}, r"sensors\.current_noise = None"),
    ],
)
def test_bad_sensors_are_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        Sensors(**fields)


def test_counts_are_one_number_or_one_for_each_joint():
    law = lambda t, r, y: 0.0 * y.q  # noqa: E731
    common = {"controller": law, "period": 1e-3, "duration": 0.01}
    said = r"sensors\.counts = \[1, 2\]"
    with pytest.raises(ScenarioError, match=said):
        aw.simulate(scenario_of(arm("cmu-dd"), sensors=Sensors(counts=[1, 2]), **common))
    each = aw.simulate(scenario_of(arm("cmu-dd"), sensors=Sensors(counts=[4096] * 6), **common))
    same = aw.simulate(scenario_of(arm("cmu-dd"), sensors=Sensors(counts=4096), **common))
    np.testing.assert_array_equal(each.q_measured.values, same.q_measured.values)
