"""Subproblems against brute force: roots of their equations on a grid, least squares where there are none, and at the edge."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from armwright.ik.closed_form.subproblems import (
    ON_AXIS,
    Turn,
    turn_onto,
    turns_to_distance,
    turns_to_level,
    two_turns,
)
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.program import trace

GRID = np.linspace(-np.pi, np.pi, 2001)
INSTEAD = Turn.by(0.7)
ROUNDING = 1e-14


def turned(u, angle):
    """u (3,) or (2,) turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * u[0] - s * u[1], s * u[0] + c * u[1], *u[2:]])


def roots(f):
    """Angles where f is 0, from sign changes on a grid."""
    values = f(GRID)
    places = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    return np.sort([brentq(f, GRID[k], GRID[k + 1], xtol=1e-15) for k in places])


def angles(turns):
    """Sorted angles, each checked for cos² + sin² = 1."""
    assert all(abs(t.cos**2 + t.sin**2 - 1.0) < ROUNDING for t in turns)
    return np.sort([t.angle for t in turns])


@pytest.mark.parametrize("seed", range(20))
def test_turn_onto_is_the_nearest_on_a_grid(seed):
    rng = np.random.default_rng(seed)
    u, v = rng.normal(size=(2, 2))
    turn = turn_onto(u, v, INSTEAD)
    reached = np.linalg.norm(turned(u, turn.angle) - v)
    every = np.hypot(*(turned(u, GRID).reshape(2, -1) - v[:, None]))
    assert reached <= every.min()
    assert abs(turn_onto(u, turned(u, 0.3), INSTEAD).angle - 0.3) < ROUNDING


@pytest.mark.parametrize("seed", range(20))
def test_turns_to_level_and_distance_are_the_roots_on_a_grid(seed):
    rng = np.random.default_rng(seed)
    u, a, true = rng.normal(size=2), rng.normal(size=2), rng.uniform(-3.0, 3.0)
    level = a @ turned(u, true)
    found = angles(turns_to_level(u, a, level, (a @ a) * (u @ u) - level**2, INSTEAD))
    np.testing.assert_allclose(found, roots(lambda x: a @ turned(u, x) - level), atol=1e-12)
    square = np.sum((a + turned(u, true)) ** 2)
    found = angles(turns_to_distance(u, a, square, INSTEAD))
    np.testing.assert_allclose(found, roots(lambda x: np.hypot(*(turned(u, x).T + a).T) ** 2 - square), atol=1e-11)


@pytest.mark.parametrize("seed", range(20))
def test_two_turns_are_the_roots_on_a_grid(seed):
    rng = np.random.default_rng(seed)
    u, between = rng.normal(size=3), Rotation.random(rng=rng).as_matrix()
    v = turned(between @ turned(u, rng.uniform(-3.0, 3.0)), rng.uniform(-3.0, 3.0))
    pairs = two_turns(u, between, v, INSTEAD, INSTEAD)
    for first, second in pairs:
        np.testing.assert_allclose(first.of(between @ second.of(u)), v, atol=10.0 * ROUNDING)

    def height(x):
        return between[2, :2] @ turned(u[:2], x) + between[2, 2] * u[2] - v[2]

    np.testing.assert_allclose(angles([second for _, second in pairs]), roots(height), atol=1e-10)


@pytest.mark.parametrize("excess", [1e-3, 0.1, 2.0])
def test_without_a_solution_the_nearest_comes_back(excess):
    u, b = np.array([0.3, 0.4]), np.array([-0.2, 0.7])
    every = np.hypot(*(turned(u, GRID).reshape(2, -1) + b[:, None]))
    for distance in (every.max() + excess, max(every.min() - excess, 0.0)):
        for turn in turns_to_distance(u, b, distance**2, INSTEAD):
            reached = np.linalg.norm(b + turned(u, turn.angle))
            assert abs(reached - distance) <= np.abs(every - distance).min() + ROUNDING
    size = np.linalg.norm(u) * np.linalg.norm(b)
    for level in (size + excess, -size - excess):
        for turn in turns_to_level(u, b, level, size**2 - level**2, INSTEAD):
            assert abs(b @ turned(u, turn.angle) - np.sign(level) * size) < ROUNDING


@pytest.mark.parametrize("small", [0.0, 1e-16, 1e-13, 1e-11, 1e-9, 1e-8, 1e-7, 1e-5, 1e-3])
def test_close_to_an_axis_no_digits_are_lost(small):
    """Wrists of right angles, elbows of equal links folded and stretched: what is reached is within rounding.

    Closer to the axis than `ON_AXIS` any turn will do: that is the error then.
    """
    off = max(10.0 * ROUNDING, 2.0 * ON_AXIS)
    right = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    tilted = Rotation.from_euler("x", 0.4).as_matrix()
    for between, u in ((right, np.array([0.0, -1.0, 0.0])), (tilted, tilted[2])):
        v = turned(between @ turned(u, small), 1.1)
        for first, second in two_turns(u, between, v, INSTEAD, INSTEAD):
            np.testing.assert_allclose(first.of(between @ second.of(u)), v, atol=off)
        for first, second in two_turns(v, between.T, u, INSTEAD, INSTEAD):
            np.testing.assert_allclose(first.of(between.T @ second.of(v)), u, atol=off)
    u, b = np.array([0.0, 0.4]), np.array([0.4, 0.0])
    for angle in (np.pi / 2.0 - small, -np.pi / 2.0 - small):  # folded, stretched
        v = b + turned(u, angle)
        for turn in turns_to_distance(u, b, v @ v, INSTEAD):
            reached = b + turned(u, turn.angle)
            assert abs(np.linalg.norm(reached) - np.linalg.norm(v)) < ROUNDING


def test_where_any_turn_does_the_one_that_is_wished_comes_back():
    nothing, u = np.zeros(2), np.array([0.0, 0.0, 1.0])
    assert turn_onto(nothing, nothing, INSTEAD) == INSTEAD
    assert turns_to_level(nothing, np.ones(2), 0.0, 0.0, INSTEAD) == (INSTEAD, INSTEAD)
    assert turns_to_distance(nothing, np.ones(2), 2.0, INSTEAD) == (INSTEAD, INSTEAD)
    right = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    v = right @ u
    assert all(second == INSTEAD for _, second in two_turns(u, right, v, INSTEAD, INSTEAD))
    assert all(first == INSTEAD for first, _ in two_turns(right.T @ u, right, u, INSTEAD, INSTEAD))


def test_compiled_they_are_what_they_are_on_floats():
    rng = np.random.default_rng(0)

    def both(u, between, v):
        pairs = two_turns(u, between, v, INSTEAD, INSTEAD)
        sides = turns_to_distance(u, v, v[2] * v[2], INSTEAD)
        return np.array([turn.angle for turn in (*pairs[0], *pairs[1], *sides)])

    kernel = Kernel(trace("both", both, {"u": (3,), "between": (3, 3), "v": (3,)}, ("angles",)), select_target())
    us, betweens = rng.normal(size=(50, 3)), Rotation.random(50, rng=rng).as_matrix()
    vs = np.array([turned(r @ turned(u, 0.4), 1.0) for u, r in zip(us, betweens, strict=True)])
    expected = [both(*each) for each in zip(us, betweens, vs, strict=True)]
    np.testing.assert_allclose(kernel(us, betweens, vs), expected, atol=1e-9)
