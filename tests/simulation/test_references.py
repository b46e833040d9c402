"""References as functions of time are differentiated exactly; what cannot be is told."""

import math
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.errors import ScenarioError
from armwright.simulation.loop.references import reference_notes, reference_rows
from armwright.simulation.loop.state import LoopState
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of

T = np.linspace(0.0, 1.0, 11)


def test_speed_and_acceleration_follow_from_the_position():
    model = arm("cmu-dd")
    rows = reference_rows(model, lambda t: scalar.array([0.3 * scalar.sin(3.0 * t), t * t, 0.1, 0.0, 0.0, 0.0]), T)
    np.testing.assert_allclose(rows[:, 0], 0.3 * np.sin(3 * T), atol=1e-15)
    np.testing.assert_allclose(rows[:, 6], 0.9 * np.cos(3 * T), atol=1e-14)
    np.testing.assert_allclose(rows[:, 12], -2.7 * np.sin(3 * T), atol=1e-14)
    np.testing.assert_allclose(rows[:, [1, 7, 13]], np.stack([T * T, 2 * T, 2 + 0 * T], axis=1), atol=1e-14)
    assert not rows[:, [8, 14]].any()
    assert reference_notes(model, rows, T) == []


def wobble(t):
    """Of `math`, which takes no symbols."""
    return [0.1 * math.sin(t), 0.0, 0.0, 0.0, 0.0, 0.0]


def test_what_cannot_be_traced_has_no_speeds_and_the_run_says_so():
    model, notes = arm("cmu-dd"), []
    rows = reference_rows(model, wobble, T, notes)
    np.testing.assert_allclose(rows[:, 0], 0.1 * np.sin(T), atol=1e-16)
    assert not rows[:, 6:].any()
    (note,) = notes
    assert note.startswith("reference 'wobble' cannot be traced (SymbolError: ")
    assert note.endswith(
        "called tick by tick, its speeds and accelerations are taken as 0; written with armwright.scalar it is differentiated, "
        "or let it give (q, qd, qdd)"
    )
    assert "\n" not in note
    run = aw.simulate(
        aw.Scenario(
            model,
            duration=0.01,
            loop=aw.Loop(controller=lambda t, r, y: 10.0 * (r.q - y.q), reference=wobble, period=1e-3),
        )
    )
    assert note in run.attrs["notes"].splitlines()
    assert not run.qd_reference.values.any()


def test_speeds_that_it_gives_itself_are_kept():
    def given(t):
        return np.full(6, math.sin(t)), np.full(6, math.cos(t)), np.full(6, -math.sin(t))

    notes = []
    rows = reference_rows(arm("cmu-dd"), given, T, notes)
    np.testing.assert_allclose(rows[:, 6:12], np.cos(T)[:, None] * np.ones(6), atol=1e-16)
    assert notes[0].endswith("called tick by tick, with the speeds and accelerations that it gave")


def test_a_traced_one_leaves_no_note():
    notes = []
    reference_rows(arm("cmu-dd"), lambda t: scalar.array([scalar.sin(t), 0.0, 0.0, 0.0, 0.0, 0.0]), T, notes)
    assert notes == []


def test_it_is_called_once_a_tick():
    calls = []

    def counted(t):
        calls.append(t)
        return [math.sin(t), 0.0, 0.0, 0.0, 0.0, 0.0]

    reference_rows(arm("cmu-dd"), counted, T)
    assert calls[-len(T) :] == list(T)
    assert len(calls) <= len(T) + 1  # and once to see whether it can be traced


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda: np.zeros(6), r"reference '<lambda>': takes \(\); expected \(t\)"),
        (lambda t: np.zeros(5), r"gave shape \(5,\); .*q \(6,\) or"),
        (lambda t: [math.nan] * 6, "of joint1 at t = 0 s = nan"),
    ],
)
def test_functions_of_other_things_are_refused(function, said):
    with pytest.raises(ScenarioError, match=said):
        reference_rows(arm("cmu-dd"), function, T)


def test_a_reference_has_its_time_after_a_thousand_hours():
    """To 1 µs, as a position of one radian a second shows."""
    common = {
        "controller": lambda t, r, y: 0.0 * r.q, "period": 1e-3, "duration": 0.01, "integrator": "rk3",
        "reference": lambda t: scalar.array([t - 3.6e6, 0.0]),
    }  # fmt: skip
    state = LoopState.of_run(aw.simulate(scenario_of(arm("two-link"), **common)))
    assert state is not None
    run = aw.simulate(scenario_of(arm("two-link"), **common, start=replace(state, tick=3_600_000_000)))
    np.testing.assert_allclose(run.q_reference.values[:, 0], 1e-3 * np.arange(11), atol=1e-6)


class OnlyAt:
    """Has positions at times, and cannot be called."""

    def at(self, t):
        return np.zeros((len(t), 6))


@pytest.mark.parametrize(
    ("reference", "place", "found"),
    [
        (OnlyAt(), "reference 'OnlyAt'", "`__call__`"),
        (object(), "reference 'object'", r"a trajectory: .*\(q, qd, qdd\)"),
        ([[0.0] * 6, [0.0]], "reference", "unequal length"),
    ],
)
def test_an_object_that_is_no_trajectory_is_refused_with_what_is_missing(reference, place, found):
    with raises_at(ScenarioError, place, found) as caught:
        reference_rows(arm("cmu-dd"), reference, T)
    assert "(0,)" not in str(caught.value)


def test_lanes_have_poses_or_schedules_and_no_trajectories():
    schedule, other = (
        aw.Schedule([0.0], [[0.1, 0.2]], ["shoulder", "elbow"]),
        aw.trajectories.Quintic([0.0] * 2, [0.1] * 2, 1.0),
    )
    loop = aw.Loop(aw.JointPID(10.0), reference=aw.Batch([schedule, other]), period=1e-3)
    with raises_at(ScenarioError, "loop.reference", "poses or schedules"):
        aw.simulate(aw.Scenario("two-link", 0.01, loop=loop))
