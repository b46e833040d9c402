"""Delays, jitter and the drive's own clock, against a plain account of which command arrived when."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armwright.errors import ScenarioError
from armwright.kernels.stages import NEVER
from armwright.simulation.timing import Delays, Timing, lateness, planned

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
        ({"command_delay": -1e-3}, "command_delay = -0.001: expected a time of 0 s or more"),
        ({"command_loss": 1.5}, "expected a probability"),
        ({"jitter": np.nan}, "expected a time"),
        ({"measurement_delay": "late"}, "expected a time"),
        ({"clock_drift": 0.5}, "within ±0.1"),
    ],
)
def test_bad_timing_is_refused(bad, said):
    with pytest.raises(ScenarioError, match=said):
        Timing(**bad)
