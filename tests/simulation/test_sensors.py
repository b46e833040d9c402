"""Sensors that cannot be are refused in one line that names the field, its value and what was expected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.simulation.loop.sensors import Sensors
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"counts": "x"}, r"sensors\.counts = 'x'"),
        ({"counts": 0}, "sensors.counts = 0.0: expected counts above 0"),
        ({"counts": [4096, -1]}, r"sensors\.counts\[1\] = -1\.0"),
        ({"counts": np.inf}, "sensors.counts = inf: .*counts above 0"),
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
        ({"velocity_noise": np.inf}, "sensors.velocity_noise = inf"),
        ({"current_noise": -1}, "sensors.current_noise = -1.0"),
        ({"current_noise": None}, r"sensors\.current_noise = None"),
        ({"side": "link", "counts_per_m": 0}, r"sensors\.counts_per_m = 0\.0: .* in one metre"),
        (
            {"counts_per_m": 1e6},
            r"sensors\.counts_per_m = 1000000\.0: goes with side = 'link'; .*sensors\.counts",
        ),
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


SCARA = "examples/scara.toml"  # its third joint is a quill on a ball screw
POSES = np.array([0.3123, -0.4321, 0.0456789, 0.2345])
SHORT = {"period": 1e-3, "duration": 2e-3}


def measured(model, sensors):
    run = aw.simulate(scenario_of(model, sensors=sensors, controller=lambda t, r, y: 0.0 * y.q, q0=POSES, **SHORT))
    return run.q_measured.values[0]


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("sensors", "steps"),
    [
        ({"counts": 1000, "side": "link", "counts_per_m": 2000}, [2e-3 * np.pi, 2e-3 * np.pi, 5e-4, 2e-3 * np.pi]),
        ({"side": "link", "counts_per_m": 2000}, [None, None, 5e-4, None]),
        ({"counts": [500, 1000, 7, 400], "side": "link", "counts_per_m": [1, 1, 2000, 1]},
            [4e-3 * np.pi, 2e-3 * np.pi, 5e-4, 5e-3 * np.pi]),
        ({"counts": 100}, "motor"),
    ],
)  # fmt: skip
def test_positions_are_whole_counts(sensors, steps):
    """Of an encoder on a prismatic joint in metres; of its motor through the gear, in radians a metre."""
    model = aw.load(SCARA)
    if steps == "motor":
        steps = [2.0 * np.pi / 100 / abs(body.drive.gear_ratio) for body in model.coordinates]
        assert steps[2] == pytest.approx(16e-3 / 100)  # a screw of 16 mm a turn
    found = measured(model, Sensors(**sensors))
    expected = [q if step is None else np.round(q / step) * step for q, step in zip(POSES, steps, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)
    if steps[0] is not None:
        assert np.abs(found - POSES)[2] > 1e-6


@pytest.mark.parametrize("side", ["link", "motor"])
def test_counts_without_a_length_are_refused(side):
    model = aw.load(SCARA)
    if side == "motor":  # as of a record that says nothing of the quill's motor
        body = model.coordinates[2]
        bare = replace(body, drive=replace(body.drive, gear_ratio=1.0))
        model = replace(model, bodies=tuple(bare if each is body else each for each in model.bodies))
    with pytest.raises(ScenarioError) as raised:
        measured(model, Sensors(counts=4096, side=side))
    assert raised.value.place == "loop.sensors.counts"
    assert raised.value.value == 4096
    assert "'quill'" in str(raised.value)
    assert "sensors.counts_per_m" in raised.value.expected
    assert measured(model, Sensors(counts_per_m=1e5, side="link")) is not None


def test_linear_counts_need_a_prismatic_joint():
    with raises_at(ScenarioError, "loop.sensors.counts_per_m", "cmu-dd .*prismatic", value=1e5):
        scenario_of(
            arm("cmu-dd"), sensors=Sensors(counts_per_m=1e5, side="link"), controller=lambda t, r, y: y.q, **SHORT
        )


@pytest.mark.study
def test_noisy_currents_are_recorded_as_measured():
    """As a drive's log has them; without noise they are the run's current, and stored once."""
    model, law = arm("cmu-dd"), {"controller": lambda t, r, y: 5.0 + 0.0 * y.q, "period": 1e-3, "duration": 0.5}
    run = aw.simulate(scenario_of(model, sensors=Sensors(current_noise=0.02), **law))
    noise = (run.current_measured - run.current).values[1:]
    assert noise.std() == pytest.approx(0.02, rel=0.1)
    assert run.current_measured.attrs["units"] == "A"
    assert "current_measured" not in aw.simulate(scenario_of(model, sensors=Sensors(position_noise=1e-4), **law))


def test_a_list_of_sensors_holds_nothing_else():
    with raises_at(ScenarioError, "loop.sensors", "list of sensors"):
        aw.Loop(sensors=[aw.Sensors(), 3])
