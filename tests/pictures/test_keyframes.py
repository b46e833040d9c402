"""Keyframes: few, at times that single precision holds, and nowhere further from the motion than they may be."""

import numpy as np
from hypothesis import example, given, settings, strategies as st

from armwright.pictures.keyframes import LARGEST_TURN, keyframes


@st.composite
def polylines(draw):
    gaps = draw(st.lists(st.floats(1e-4, 2.0), min_size=1, max_size=40))
    t = np.concatenate([[0.0], np.cumsum(gaps)])
    q = draw(st.lists(st.floats(-30, 30), min_size=len(t), max_size=len(t)))
    return t, np.array(q)


@settings(max_examples=200)
@example((np.array([0.0, 1.375, 3.375, 4.375, 5.375]), np.array([13.5, -2.0, -24.0, 0.0, 0.0])), 0.5, True)
@given(polylines(), st.sampled_from([1e-6, 1e-3, 0.5]), st.booleans())
def test_nowhere_off_by_more_than_the_tolerance(line, tolerance, turn):
    t, q = line
    times, positions = keyframes(t, q, tolerance, turn)
    assert times.dtype == np.float32
    assert (np.diff(times) > 0).all()
    exact = times.astype(float)
    assert np.allclose(positions, np.interp(exact, t, q), rtol=0, atol=1e-12)
    steepest = np.abs(np.diff(q) / np.diff(t)).max()
    moved = 2 * steepest * np.spacing(np.float32(t[-1]))  # a corner whose time was rounded is cut, not moved
    assert np.abs(np.interp(t, exact, positions) - q).max() <= tolerance + moved + 1e-12
    if turn:
        assert np.abs(np.diff(positions)).max(initial=0.0) <= LARGEST_TURN + moved + 1e-9


def test_what_moves_steadily_needs_two():
    t = np.linspace(0, 10, 5001)
    times, positions = keyframes(t, 0.1 * t - 3, 1e-9, turn=False)
    assert times.tolist() == [0.0, 10.0]
    assert np.allclose(positions, [-3, -2])


def test_steady_turns_are_cut_into_quarters():
    t = np.linspace(0, 10, 11)
    times, positions = keyframes(t, 20 * np.pi * t / 10, 1e-6, turn=True)
    assert len(times) >= 40
    assert np.abs(np.diff(positions)).max() < np.pi


def test_two_rows_at_one_single_precision_time_are_one():
    t = np.array([0.0, 1000.0, 1000.0 + 1e-9])
    times, _ = keyframes(t, np.array([0.0, 1.0, 2.0]), 1e-6, turn=False)
    assert times.tolist() == [0.0, 1000.0]
