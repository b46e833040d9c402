"""Kernels with fixed arrays: the same bits, nothing allocated."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ShapeError


def test_bound_is_the_same_kernel():
    """One state or many, own arrays or given ones: the bits of the ordinary call."""
    dyn = aw.compile(aw.load("puma560"))
    rng = np.random.default_rng(0)
    for lead in ((), (3,), (2, 9)):
        bound = dyn.bind("inverse_dynamics", lead=lead)
        for _ in range(3):
            states = {name: rng.normal(size=(*lead, 6)) for name in ("q", "qd", "qdd")}
            for name, values in states.items():
                bound.inputs[name][...] = values
            assert bound() is bound.result
            assert np.array_equal(bound.result, dyn.inverse_dynamics(**states))
            assert bound.outputs["tau"] is bound.result


def test_given_arrays_are_used():
    """An array of the caller's is read and written where it is."""
    dyn = aw.compile(aw.load("puma560"))
    q, m = np.linspace(0, 1, 6), np.zeros((6, 6))
    bound = dyn.bind("mass_matrix", q=q, M=m)
    bound()
    assert np.array_equal(m, dyn.mass_matrix(q))
    q += 0.1
    assert np.array_equal(bound(), dyn.mass_matrix(q))


def test_optional_inputs_and_options():
    """A wrench, a frame."""
    dyn = aw.compile(aw.load("panda"))
    bound = dyn.bind("inverse_dynamics", "wrench")
    bound.inputs["wrench"][:] = [1, 2, 3, 4, 5, 6]
    assert np.array_equal(bound(), dyn.inverse_dynamics(np.zeros(7), np.zeros(7), np.zeros(7), np.arange(1.0, 7.0)))
    pose = dyn.bind("forward_kinematics", options={"frame": "link3"})
    assert np.array_equal(pose(), dyn.forward_kinematics(np.zeros(7), frame="link3"))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"p": np.zeros(6)}, "array = 'p': there is M, q"),
        ({"q": np.zeros(5)}, "q: float64 (5,); expected writeable contiguous float64 (6,)"),
        ({"q": np.zeros(6, np.float32)}, "q: float32 (6,)"),
        ({"M": np.zeros((6, 6)).T[::-1]}, "M: float64 (6, 6); expected writeable contiguous"),
        ({"q": [0] * 6}, "q: list"),
    ],
)
def test_what_cannot_be_bound(arrays, message):
    """Checked once, when it is bound."""
    with pytest.raises(ShapeError) as error:
        aw.compile(aw.load("puma560")).bind("mass_matrix", **arrays)
    assert str(error.value).startswith(f"mass_matrix: {message}")
