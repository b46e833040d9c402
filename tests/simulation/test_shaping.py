"""The controller's output stage: rate, limit and steps, each exactly and all together."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import ScenarioError
from armwright.simulation.loop.command_filter import CommandFilter
from physics.arms import arm
from simulation.fields import scenario_of

PERIOD = 1e-3


def issued(shaping, asked, period=PERIOD):
    """Commands that leave for what is asked for, tick by tick."""
    kept, rows = np.zeros(1), []
    for each in asked:
        u, kept = shaping.filtered(period, np.array([each]), kept)
        rows.append(u[0])
    return np.array(rows)


@pytest.mark.parametrize(("rate", "resolution"), [(100.0, 0.25), (400.0, 0.5), (100.0, 3.0), (1e4, 0.01)])
def test_a_coarse_converter_does_not_stop_a_slow_ramp(rate, resolution):
    """A change of less than half a step in a tick adds up: what leaves is the nearest step to the ramp."""
    found = issued(CommandFilter(rate=rate, resolution=resolution), np.full(400, 10.0))
    ramp = np.minimum(rate * PERIOD * np.arange(1, 401), 10.0)
    assert np.abs(found - ramp).max() <= 0.5 * resolution * (1 + 1e-9)
    assert np.all(np.diff(found) >= 0.0)


def test_a_step_of_ten_volts_arrives_in_the_run():
    model = arm("cmu-dd")
    fields = {"period": PERIOD, "duration": 0.15, "initial_command": np.zeros(6)}
    law = lambda t, r, y: [10.0] + [0.0] * 5  # noqa: E731
    run = aw.simulate(
        scenario_of(model, controller=law, command_filter=CommandFilter(rate=100.0, resolution=0.25), **fields)
    )
    np.testing.assert_allclose(run.u.values[:, 0], 0.25 * np.floor(np.minimum(0.4 * np.arange(1, 152), 40) + 0.5))


@pytest.mark.parametrize(
    ("limit", "resolution", "most"),
    [(11.0, 3.0, 9.0), (12.0, 3.0, 12.0), (0.3, 0.1, 0.3), (24.0, 0.1, 24.0), (1.0, 0.7, 0.7)],
)
def test_rounding_does_not_pass_the_limit(limit, resolution, most):
    found = issued(CommandFilter(limit=limit, resolution=resolution), [1e3, -1e3, limit, -limit])
    np.testing.assert_allclose(found, [most, -most, most, -most], rtol=1e-12)
    assert np.abs(found).max() <= limit


@settings(deadline=None, max_examples=200)
@given(
    st.lists(st.floats(-100, 100), min_size=1, max_size=30),
    st.none() | st.sampled_from([1.0, 3.7, 11.0, 24.0]),
    st.none() | st.sampled_from([1.0, 250.0, 3e4]),
    st.none() | st.sampled_from([0.01, 0.1, 0.3, 1.0]),
)
def test_what_leaves_is_within_the_limit_on_a_step_and_no_faster_than_the_rate(asked, limit, rate, resolution):
    found = issued(CommandFilter(limit, rate, resolution), asked)
    if limit is not None:
        assert np.abs(found).max() <= limit
    if resolution is not None:
        np.testing.assert_allclose(found / resolution, np.rint(found / resolution), atol=1e-9)
    if rate is not None:
        slack = (0.0 if resolution is None else resolution) + 1e-9
        steps = np.diff(np.concatenate([[0.0], found]))
        assert np.abs(steps).max() <= rate * PERIOD + slack
    if limit is rate is resolution is None:
        np.testing.assert_array_equal(found, asked)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(-40, 40), min_size=1, max_size=40), st.integers(1, 9), st.integers(1, 7))
def test_it_is_what_exact_numbers_say(asked, change, step):
    """Rate and resolution, with fractions: the ramp knows nothing of the steps."""
    kept, rows = Fraction(0), []
    for each in asked:
        kept = max(min(Fraction(each), kept + Fraction(change, 8)), kept - Fraction(change, 8))
        rows.append(float((kept / step + Fraction(1, 2)).__floor__() * step))
    found = issued(
        CommandFilter(rate=128.0 * change, resolution=float(step)), [float(each) for each in asked], 2.0**-10
    )
    np.testing.assert_array_equal(found, rows)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"limit": "x"}, r"command_filter\.limit = 'x'"),
        ({"limit": True}, r"command_filter\.limit = True"),
        ({"limit": 0}, "command_filter.limit = 0.0: expected a number above 0"),
        ({"limit": np.array([3.0, -1.0])}, r"command_filter\.limit\[1\] = -1\.0"),
        ({"limit": [[1.0]]}, r"command_filter\.limit = \[\[1\.0\]\]"),
        ({"limit": [[1.0], [1.0, 2.0]]}, r"command_filter\.limit = \[\[1\.0\], \[1\.0, 2\.0\]\]"),
        ({"rate": np.nan}, "command_filter.rate = nan: .*number above 0"),
        ({"rate": {}}, r"command_filter\.rate = \{\}"),
        ({"resolution": np.inf}, "command_filter.resolution = inf"),
        ({"resolution": [0.1, None]}, r"command_filter\.resolution = \[0\.1, None\]"),
    ],
)
def test_bad_shaping_is_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        CommandFilter(**fields)


@pytest.mark.parametrize(
    ("shaping", "said"),
    [
        (
            CommandFilter(limit=[1.0, 2.0]),
            r"command_filter\.limit = \[1\.0, 2\.0\]",
        ),
        (CommandFilter(rate=np.ones(3)), r"command_filter\.rate = \[1\.0, 1\.0, 1\.0\]"),
        (
            CommandFilter(limit=1.0, resolution=3.0),
            r"command_filter\.resolution = 3\.0",
        ),
    ],
)
def test_shaping_that_does_not_fit_the_arm_is_refused(shaping, said):
    law = lambda t, r, y: 0.0 * y.q  # noqa: E731
    with pytest.raises(ScenarioError, match=said):
        aw.simulate(
            aw.Scenario(
                arm("cmu-dd"), duration=0.01, loop=aw.Loop(controller=law, command_filter=shaping, period=PERIOD)
            )
        )
