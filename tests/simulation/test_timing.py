"""Delays, jitter and the drive's own clock, against a plain account of which command arrived when."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import ScenarioError
from armwright.kernels.stages import NEVER
from armwright.simulation.loop.timing import Delays, Timing, lateness, planned
from physics.arms import arm
from simulation.fields import scenario_of

PERIOD = 2e-3


def in_force(begins, commands, at):
    """The command among a plan's that acts at a time in the tick [ticks]: the newest that has begun."""
    chosen = commands[0]
    for begin, command in zip(begins, commands[1:], strict=True):
        chosen = command if begin <= at else chosen
    return chosen


def run(late, waits):
    """Commands in force just behind every quarter of a tick, through `planned`; command k is k + 1, before them 0."""
    waiting, arrivals, base = np.zeros((waits, 1)), np.full(waits, NEVER), np.zeros(1)
    found = []
    for k, lag in enumerate(late):
        u_plan, u_from, waiting, arrivals, base = planned(float(k), np.array([k + 1.0]), lag, waiting, arrivals, base)
        found += [in_force(u_from, u_plan[:, 0], quarter) for quarter in (0.0, 0.25, 0.5, 0.75)]
    return found


def account(late):
    """The same by its meaning: the newest of all commands that have arrived."""
    arrival = np.arange(len(late)) + np.array(late)
    found = []
    for k in range(len(late)):
        for quarter in (0.0, 0.25, 0.5, 0.75):
            arrived = [i for i in range(k + 1) if arrival[i] <= k + quarter]
            found.append(float(max(arrived) + 1) if arrived else 0.0)
    return found


@settings(deadline=None, max_examples=60)
@given(st.lists(st.sampled_from([0.0, 0.25, 0.5, 1.0, 1.25, 1.75, 2.0, 2.5, NEVER]), min_size=1, max_size=12))
def test_the_newest_command_that_arrived_is_in_force(late):
    assert run(late, 2) == account(late)


@pytest.mark.parametrize(
    ("timing", "late"),
    [
        (Timing("ideal"), 0.0),
        (Timing("one-tick"), 1.0),
        (Timing("sync"), 1.0),
        (Timing("sync", command_delay=0.9 * PERIOD), 1.0),
        (Timing("sync", command_delay=1.2 * PERIOD), 2.0),
        (Timing("ideal", command_delay=1.5 * PERIOD), 1.5),
        (Timing("one-tick", command_delay=0.25 * PERIOD), 1.25),
        (Timing("ideal", command_delay=3 * PERIOD), 3.0),
        (Timing("ideal", command_delay=0.4 * PERIOD, clock_drift=0.0), 0.4),
    ],
)
def test_presets_and_delays(timing, late):
    delays = Delays.of(timing, PERIOD)
    behind = lateness(delays, 7.0, delays.later[0], delays.jitter[0], delays.drift[0], 0.5)
    assert delays.commanded[0] + behind == pytest.approx(late, abs=1e-12)
    assert behind < delays.pending + 1
    assert delays.fractional or behind == 0.0


def test_jitter_spreads_arrivals_and_a_synchronous_drive_hides_it():
    w = np.linspace(0.001, 0.999, 9)
    free = Delays.of(Timing("ideal", command_delay=0.5 * PERIOD, jitter=0.8 * PERIOD), PERIOD)
    late = np.array([lateness(free, 0.0, free.later[0], free.jitter[0], 0.0, each) for each in w])
    np.testing.assert_allclose(late, 0.5 + 0.8 * w)
    assert free.pending == 1
    held = Delays.of(Timing("sync", command_delay=0.1 * PERIOD, jitter=0.8 * PERIOD), PERIOD)
    assert {float(lateness(held, 0.0, held.later[0], held.jitter[0], 0.0, each)) for each in w} == {0.0}


@settings(deadline=None, max_examples=300)
@given(
    st.one_of(st.floats(0.0, 900.0), st.integers(0, 900).map(float)),
    st.sampled_from([0.0, 0.3, 1.0, 2.75, 40.0]),
    st.floats(1e-9, 1.0 - 1e-9),
)
def test_a_synchronous_drive_acts_at_the_first_sync_behind_the_arrival_however_long_the_delay(delay, jitter, w):
    """Whole ticks wait in the queue: how many commands are planned for depends on the jitter alone."""
    delays = Delays.of(Timing("sync", command_delay=delay * PERIOD, jitter=jitter * PERIOD), PERIOD)
    behind = lateness(delays, 7.0, delays.later[0], delays.jitter[0], delays.drift[0], w)
    arrival = delay + jitter * w
    if abs(arrival - np.rint(arrival)) > 1e-6 or jitter == 0.0:
        whole = np.rint(arrival) if abs(arrival - np.rint(arrival)) <= 1e-9 else np.ceil(arrival)
        assert delays.commanded[0] + behind == max(whole, 1.0)
    assert behind < delays.pending + 1
    assert delays.pending <= np.ceil(jitter) + 1
    assert delays.fractional == (jitter > 0.0)


def test_lanes_with_and_without_jitter_are_split_each_by_itself():
    delay, jitter = np.array([0.0, 0.5, 3.0, 3.4, 3.4]), np.array([0.0, 0.0, 0.0, 0.0, 0.2])
    delays = Delays.of(Timing("sync", command_delay=aw.Batch(delay * PERIOD), jitter=aw.Batch(jitter * PERIOD)), PERIOD)
    np.testing.assert_array_equal(delays.commanded, [1.0, 1.0, 3.0, 4.0, 3.0])
    np.testing.assert_allclose(delays.later, [0.0, 0.0, 0.0, 0.0, 1.4])


def test_a_long_synchronous_delay_is_that_many_ticks_in_the_run():
    """30.3 periods: the same as 31, and as 30 behind one-tick."""
    model = arm("two-link")
    law = lambda t, r, y: 20.0 * (r.q - y.q) - y.qd  # noqa: E731
    fields = {"controller": law, "reference": [0.3, 0.1], "period": PERIOD, "duration": 50 * PERIOD}
    timings = (
        Timing("sync", command_delay=30.3 * PERIOD),
        Timing("sync", command_delay=30.3 * PERIOD, jitter=0.6 * PERIOD),
        Timing("one-tick", command_delay=30 * PERIOD),
    )
    runs = [aw.simulate(scenario_of(model, timing=each, **fields)) for each in timings]
    assert runs[0].u.values[32, 0] != runs[0].u.values[30, 0]
    for run in runs[1:]:
        np.testing.assert_array_equal(run.u.values, runs[0].u.values)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (
            {"jitter": 2.0},
            r"timing\.jitter = 2\.0",
        ),
        ({"jitter": 1e6, "preset": "sync"}, r"timing\.jitter = 1000000\.0"),
        ({"jitter": aw.Batch([0.0, 0.2])}, r"timing\.jitter = 0\.2"),
        (
            {"command_delay": 1e5},
            r"timing\.command_delay = 100000\.0",
        ),
        ({"command_delay": 1e5, "preset": "sync"}, r"timing\.command_delay = 100000\.0"),
        ({"measurement_delay": 1e5}, r"timing\.measurement_delay = 100000\.0"),
    ],
)
def test_more_than_can_be_under_way_is_refused_before_anything_is_compiled(fields, said):
    with pytest.raises(ScenarioError, match=said):
        Delays.of(Timing(**fields), PERIOD)
    assert Delays.of(Timing(jitter=64 * PERIOD), PERIOD).pending == 63


def test_a_drive_with_its_own_clock_acts_at_its_own_ticks():
    drift = 0.01
    delays = Delays.of(Timing("ideal", clock_drift=drift), PERIOD)
    ticks = np.arange(200.0)
    acts = np.array([k + lateness(delays, k, 0.0, 0.0, drift, 0.5) for k in ticks])
    np.testing.assert_allclose(np.rint(acts / (1 + drift)), acts / (1 + drift), atol=1e-9)
    assert np.all((acts - ticks >= -1e-9) & (acts - ticks < 1.0 + drift))
    assert len(np.unique(np.rint(acts / (1 + drift)))) == len(ticks) - 1  # a slower clock drops a command now and then


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ({"preset": "onetick"}, "did you mean one-tick"),
        (
            {"command_delay": -1e-3},
            "timing.command_delay = -0.001",
        ),
        ({"command_loss": 1.5}, "expected a probability"),
        ({"jitter": np.nan}, "expected a time"),
        ({"measurement_delay": "late"}, "expected a time"),
        ({"clock_drift": 0.5}, "within ±0.1"),
        (
            {"command_delay": aw.Batch([0.0, -1.0])},
            "timing.command_delay of lane 1 = -1.0",
        ),
        ({"jitter": [0.0, 0.2]}, r"timing\.jitter = \[0\.0, 0\.2\]"),
        ({"jitter": np.zeros((1, 2))}, r"timing\.jitter = \[\[0\.0, 0\.0\]\]"),
        ({"command_loss": True}, r"timing\.command_loss = True"),
        ({"preset": 5}, r"timing\.preset = 5"),
    ],
)
def test_bad_timing_is_refused(bad, said):
    with pytest.raises(ScenarioError, match=said):
        Timing(**bad)
