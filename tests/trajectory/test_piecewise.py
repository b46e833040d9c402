"""Piecewise polynomials: SciPy's values, exact extrema, and thousands of pieces in a loop."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import PPoly

import armwright as aw
from armwright.errors import ScenarioError
from armwright.program import interpret, trace
from armwright.trajectory.piecewise import PiecewisePolynomial
from physics.arms import arm


def random_motion(seed: int, pieces: int = 4, n: int = 2, degree: int = 5) -> PiecewisePolynomial:
    draw = np.random.default_rng(seed)
    coefficients = draw.normal(size=(pieces, n, degree + 1)) * draw.integers(0, 2, size=(pieces, n, degree + 1))
    return PiecewisePolynomial(draw.normal() + np.cumsum(draw.uniform(0.1, 2.0, pieces + 1)), coefficients)


@given(st.integers(0, 2**31), st.integers(0, 5))
@settings(max_examples=50, deadline=None)
def test_values_and_extrema_are_those_of_scipy(seed, degree):
    motion = random_motion(seed, degree=degree)
    oracle = PPoly(motion.coefficients.transpose(2, 0, 1)[::-1], motion.knots)
    t = np.linspace(motion.knots[0], motion.knots[-1], 997)[:-1]
    for derivative, values in enumerate(motion.at(t)):
        np.testing.assert_allclose(values, oracle(t, nu=derivative), rtol=1e-12, atol=1e-11)
    for derivative in range(4):
        low, high = motion.extrema(derivative)
        rows = oracle(t, nu=derivative)
        tolerance = 1e-12 * np.abs(rows).max()
        assert (low.min(axis=0) <= rows.min(axis=0) + tolerance).all()
        assert (high.max(axis=0) >= rows.max(axis=0) - tolerance).all()
        for i, (begin, end) in enumerate(zip(motion.knots[:-1], motion.knots[1:], strict=True)):
            inside = oracle(np.linspace(begin, np.nextafter(end, begin), 4001), nu=derivative)
            size = 1e-6 * (1.0 + np.abs(inside).max())  # of what lies between the points of that grid
            np.testing.assert_allclose(low[i], inside.min(axis=0), atol=size)
            np.testing.assert_allclose(high[i], inside.max(axis=0), atol=size)


def test_a_derivative_and_a_trace_agree_with_it():
    motion = random_motion(3)
    t = np.linspace(motion.time - 0.5, motion.time + motion.duration + 0.5, 100)
    inside = (t >= motion.time) & (t <= motion.time + motion.duration)
    np.testing.assert_allclose(motion.derivative().at(t[inside])[0], motion.at(t[inside])[1], rtol=1e-12, atol=1e-12)
    program = trace("motion", lambda x: np.concatenate(motion(x[0])), {"t": (1,)}, ("motion",))
    np.testing.assert_allclose(interpret(program, t[:, None]), np.concatenate(motion.at(t), axis=1), atol=1e-12)


def test_the_arm_stands_before_and_after():
    motion = random_motion(4)
    before, after = motion.at(motion.time - 1.0), motion.at(motion.time + motion.duration + 1.0)
    np.testing.assert_array_equal(before[0], motion.at(motion.time)[0])
    np.testing.assert_array_equal(after[0], motion.at(motion.time + motion.duration)[0])
    np.testing.assert_array_equal([before[1:], after[1:]], 0.0)


def test_a_thousand_pieces_cost_nothing_in_a_loop():
    def spent(pieces):
        draw = np.random.default_rng(0)
        q = 0.2 * np.cumsum(0.05 * draw.normal(size=(pieces + 1, 2)), axis=0)
        rows = np.stack([q[:-1], np.diff(q, axis=0) * pieces], axis=-1)
        motion = PiecewisePolynomial(np.linspace(0.0, 1.0, pieces + 1), rows)
        loop = aw.Loop(controller=aw.ComputedTorque(kp=100.0, kd=20.0), reference=motion, period=1e-3)
        begin = time.process_time()
        run = aw.simulate(aw.Scenario(arm("two-link"), duration=1.0, start=q[0], loop=loop))
        np.testing.assert_allclose(run.q_reference.values, motion.at(run.time.values)[0], atol=1e-14)
        return time.process_time() - begin

    spent(10)
    assert spent(5000) < 5.0 * spent(10) + 0.5


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: PiecewisePolynomial([0.0, 1.0, 1.0], np.zeros((2, 1, 2))), r"knots\[2\] = 1.0: not after 1"),
        (lambda: PiecewisePolynomial([0.0, 2.0, 1.0], np.zeros((2, 1, 2))), r"knots\[2\] = 1.0: not after 2"),
        (lambda: PiecewisePolynomial([0.0, np.nan], np.zeros((1, 1, 2))), "finite numbers"),
        (lambda: PiecewisePolynomial([0.0, 1.0], np.full((1, 1, 2), np.inf)), "finite numbers"),
        (lambda: PiecewisePolynomial([0.0, 1.0], np.zeros((2, 1, 2))), "do not fit"),
        (lambda: PiecewisePolynomial("soon", np.zeros((2, 1, 2))), "knots = 'soon'"),
    ],
)
def test_bad_pieces_are_refused(make, said):
    with pytest.raises(ScenarioError, match=said):
        make()


def test_a_segment_shorter_than_rounding_is_left_out():
    """A cruise of 1e-17 s, as h / v less the time of both ramps leaves it."""
    jerk = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    motion = aw.trajectories.PiecewisePolynomial.of_segments(1.0, [0.1, 1e-17, 0.1], jerk, 0.0)
    np.testing.assert_allclose(motion.knots, [1.0, 1.1, 1.2], rtol=1e-14)
