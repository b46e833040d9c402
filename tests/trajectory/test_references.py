"""Named references: their ends, and that speed and acceleration are the derivatives of what is before them."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.errors import ScenarioError
from armwright.simulation.loop.references import reference_rows
from armwright.trajectory import Fourier, Quintic, Ramp, Sine, Step
from physics.arms import arm

START, GOAL = np.array([0.1, -0.2]), np.array([0.9, 0.4])
SMOOTH = [
    Ramp(START, GOAL, 0.5, time=0.2),
    Quintic(START, GOAL, 0.5, time=0.2),
    Sine(START, GOAL, 1.3, phase=0.4),
    Fourier(START, [[0.3, -0.1], [0.2, 0.1]], [[0.1, 0.2], [-0.2, 0.05]], 0.7),
]


@pytest.mark.parametrize("reference", SMOOTH, ids=lambda reference: type(reference).__name__)
def test_speed_and_acceleration_are_derivatives(reference):
    h = 1e-5
    for t in (0.05, 0.31, 0.5, 0.64, 0.9):
        before, at, after = (reference(t + k * h) for k in (-1, 0, 1))
        np.testing.assert_allclose(at[1], (after[0] - before[0]) / (2 * h), atol=1e-6)
        np.testing.assert_allclose(at[2], (after[1] - before[1]) / (2 * h), atol=1e-5)


@pytest.mark.parametrize("reference", [Step(START, GOAL, 0.3), *SMOOTH[:2]], ids=lambda r: type(r).__name__)
def test_they_begin_and_end_at_rest(reference):
    for t, pose in ((0.0, START), (1.0, GOAL)):
        q, qd, qdd = reference(t)
        np.testing.assert_allclose(q, pose, rtol=1e-15)
        np.testing.assert_array_equal([qd, qdd], 0.0)


def every_kind() -> list[aw.trajectories.Motion]:
    """A motion of each kind that answers many times at once."""
    limits = aw.trajectories.MotionLimits.of("two-link", velocity=1.0, acceleration=4.0, jerk=40.0)
    quintic, ways = SMOOTH[1], [START, [0.3, 0.1], GOAL]
    return [
        Step(START, GOAL, 0.3), *SMOOTH, aw.trajectories.Cubic(START, GOAL, 0.5), aw.trajectories.SCurve(START, GOAL, limits),
        aw.trajectories.InputShaper(quintic, hz=10.0, damping=0.1),
        aw.trajectories.Joined([quintic, aw.trajectories.Quintic(GOAL, START, 0.5, time=0.7)]),
        aw.trajectories.time_optimal("two-link", ways, limits),
    ]  # fmt: skip


def test_a_time_that_is_not_a_number_has_no_pose():
    for motion in every_kind():
        for times in (np.nan, [np.nan], [[0.1, np.nan, 9.0]]):
            unknown = np.isnan(times)
            for rows in motion.at(times):
                assert rows.shape == (*np.shape(times), 2), motion
                np.testing.assert_array_equal(np.isnan(rows), np.repeat(unknown[..., None], 2, axis=-1), str(motion))


def test_a_step_jumps_at_its_tick():
    t = np.arange(11) * 0.1  # 3 ticks are 0.30000000000000004 s
    rows = reference_rows(arm("two-link"), Step(START, GOAL, 0.3), t)
    np.testing.assert_array_equal(rows[2, :2], START)
    np.testing.assert_array_equal(rows[3, :2], GOAL)
    late = reference_rows(arm("two-link"), Step(START, GOAL, 0.7), np.array([0.7 - 1e-9, 7 * 0.1 - 1e-16]))
    np.testing.assert_array_equal(late[:, :2], [START, GOAL])


def test_a_scenario_takes_them():
    run = aw.simulate(
        aw.Scenario(
            arm("two-link"), duration=0.8, start=START,
            loop=aw.Loop(controller=aw.ComputedTorque(kp=100.0, kd=20.0), reference=Ramp(START, GOAL, 0.5), period=1e-3),
        )
    )  # fmt: skip
    np.testing.assert_allclose(run.q.values[-1], GOAL, atol=0.05)
    np.testing.assert_allclose(run.q_reference.values[250], 0.5 * (START + GOAL), atol=1e-12)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Quintic(START, GOAL, 0.0), r"Quintic\.duration = 0.0: expected a number above 0"),
        (lambda: Ramp(START, [1.0], 1.0), "Ramp: .*2 of start, 1 "),
        (lambda: Step(START, [np.nan, 0.0]), "Step\\.goal = .*expected finite numbers"),
        (lambda: Sine(START, "wide", 1.0), r"Sine\.amplitude = 'wide'"),
        (lambda: Sine(START, GOAL, True), "frequency_hz = True"),
        (lambda: Fourier(START, [[1.0]], [[1.0]], 1.0), r"Fourier\.sine: shape \(1, 1\); expected \(2, harmonics\)"),
        (lambda: Fourier(START, [[1.0], [2.0]], [[1.0, 0.0], [2.0, 0.0]], 1.0), r"Fourier\.cosine: shape \(2, 2\)"),
        (lambda: Fourier(START, [[1.0], [2.0, 3.0]], [[1.0], [2.0]], 1.0), r"Fourier\.sine = .*harmonics"),
        (lambda: Fourier(START, [[1.0], [np.inf]], [[1.0], [2.0]], 1.0), r"Fourier\.sine = .*finite numbers"),
        (
            lambda: Fourier(START, [[1.0], [2.0]], [[1.0], [2.0]], 0.0),
            r"Fourier\.cycle = 0.0: expected a number above 0",
        ),
    ],
)
def test_bad_references_are_refused(make, said):
    with pytest.raises(ScenarioError, match=said):
        make()


def test_another_number_of_joints_is_refused():
    with pytest.raises(ScenarioError, match="gave shapes"):
        reference_rows(arm("cmu-dd"), Step(START, GOAL), np.zeros(1))


class Alone:
    """A swing whose `at` gives positions alone."""

    def __call__(self, t):
        return np.stack([scalar.sin(2.0 * t), 0.5 * t])

    def at(self, t):
        return np.stack([np.sin(2.0 * t), 0.5 * t], axis=1)


def test_positions_alone_of_all_times_are_differentiated():
    t = np.linspace(0.0, 1.0, 5)
    rows = reference_rows(arm("two-link"), Alone(), t)
    expected = [np.sin(2 * t), 0.5 * t, 2 * np.cos(2 * t), 0.5 + 0 * t, -4 * np.sin(2 * t), 0 * t]
    np.testing.assert_allclose(rows, np.stack(expected, axis=1), atol=1e-12)


@pytest.mark.parametrize("duration", [1e300, 1e-300, 10**400, 5e-324])
@pytest.mark.parametrize("kind", [aw.trajectories.Quintic, aw.trajectories.Ramp])
def test_durations_whose_square_is_no_float_are_refused(kind, duration):
    with pytest.raises(ScenarioError, match=r"\.duration = "):
        kind([0.0], [1.0], duration)
