"""Distances of segments beside coal's capsules and beside SciPy's search."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import lsq_linear

from armwright.collision.distance import segment_to_box, segment_to_plane, segment_to_segment

FLOATS = st.floats(-2.0, 2.0, width=32)
POINT = st.tuples(FLOATS, FLOATS, FLOATS).map(np.array)


@pytest.mark.study
@given(POINT, POINT, POINT, POINT)
@settings(max_examples=200, deadline=None)
def test_segments(a, b, c, d):
    found = lsq_linear(np.column_stack([b - a, c - d]), c - a, (0.0, 1.0), method="bvls", tol=1e-14)
    assert segment_to_segment(a, b, c, d) == pytest.approx(np.linalg.norm(found.fun), abs=1e-6)
    assert segment_to_segment(a, b, c, d) == pytest.approx(segment_to_segment(d, c, b, a), abs=1e-9)


@given(POINT, POINT, st.tuples(*[st.floats(0.01, 1.0)] * 3).map(np.array))
@settings(max_examples=200, deadline=None)
def test_box(a, b, half):
    p = a + np.linspace(0, 1, 2001)[:, None] * (b - a)
    dense = np.linalg.norm(p - np.clip(p, -half, half), axis=1).min()
    assert dense - 1e-3 * np.linalg.norm(b - a) - 1e-9 <= segment_to_box(a, b, half) <= dense + 1e-9


def test_parallel_and_points():
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.3, 0.0])
    zero = np.zeros(3)
    assert segment_to_segment(zero, x, y, x + y) == pytest.approx(0.3, abs=1e-15)
    assert segment_to_segment(zero, x, 2 * x + y, 3 * x + y) == pytest.approx(np.hypot(1, 0.3), abs=1e-15)
    assert segment_to_segment(zero, zero, y, y) == pytest.approx(0.3, abs=1e-15)
    assert segment_to_segment(-x, x, -y, y) == 0.0
    nearly = x + 1e-9 * np.array([0.0, 0.0, 1.0])
    assert segment_to_segment(zero, x, y, nearly + y) == pytest.approx(0.3, abs=1e-12)
    assert segment_to_plane(zero, x, -y, y / 0.3) == pytest.approx(0.3)


def test_coal_finds_the_same():
    coal = pytest.importorskip("coal", reason="coal is the oracle of distances")
    from armwright.spatial import rotation_rpy

    def capsule(a, b, radius):
        from scipy.spatial.transform import Rotation

        along = b - a
        turn = Rotation.align_vectors([along / np.linalg.norm(along)], [[0.0, 0.0, 1.0]])[0].as_matrix()
        return coal.Capsule(radius, float(np.linalg.norm(along))), coal.Transform3s(turn, 0.5 * (a + b))

    def distance(one, two):
        return coal.distance(one[0], one[1], two[0], two[1], coal.DistanceRequest(), coal.DistanceResult())

    rng = np.random.default_rng(3)
    checked = 0
    for _ in range(300):
        a, b, c, d = rng.uniform(-1, 1, (4, 3))
        ours = segment_to_segment(a, b, c, d) - 0.1 - 0.05
        if ours > 1e-3:
            assert ours == pytest.approx(distance(capsule(a, b, 0.1), capsule(c, d, 0.05)), abs=1e-5)
            checked += 1
        size, rpy = rng.uniform(0.1, 0.8, 3), rng.uniform(-3, 3, 3)
        turn = rotation_rpy(*rpy).astype(float)
        box = coal.Box(*size), coal.Transform3s(turn, d)
        ours = segment_to_box(turn.T @ (a - d), turn.T @ (b - d), 0.5 * size) - 0.1
        if ours > 1e-3:
            assert ours == pytest.approx(distance(capsule(a, b, 0.1), box), abs=1e-5)
            checked += 1
    assert checked > 300
