"""Work that only some lanes need: left out where no lane of a tile needs it, and a lane has the bits that it has alone."""

from __future__ import annotations

import ctypes
import time

import numpy as np
import pytest

from armwright import scalar
from armwright.kernels.batch import Kernel
from armwright.kernels.c import c_source
from armwright.kernels.llvm import batch_module
from armwright.kernels.target import select_target
from armwright.program import WhereNeeded, call, interpret, trace
from kernels.c_compilers import BITS, batch_function, build, compiler, run_batch


def above_one(given):
    """a² + shift where a > 1, else a, by a function that takes `shift` from the trace around it."""
    a, shift = given
    square = WhereNeeded("square", lambda x: x * x + 3.0 * shift, {"x": (1,)})
    return square(scalar.less(1.0, a), scalar.array([a]), scalar.array([a]))


PROGRAM = trace("above", above_one, {"given": (2,)}, ("y",))
GIVEN = np.random.default_rng(3).uniform(-3.0, 3.0, (1003, 2))
TRUTH = np.where(GIVEN[:, 0] > 1.0, GIVEN[:, 0] ** 2 + 3.0 * GIVEN[:, 1], GIVEN[:, 0])


def test_floats_and_every_back_end_say_the_same():
    np.testing.assert_allclose([above_one(row)[0] for row in GIVEN], TRUTH, rtol=1e-15)
    np.testing.assert_allclose(interpret(PROGRAM, GIVEN)[:, 0], TRUTH, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(Kernel(PROGRAM, select_target())(GIVEN)[:, 0], TRUTH, rtol=1e-14, atol=1e-15)


def test_a_lane_has_the_bits_that_it_has_alone():
    """Lanes sorted so that whole tiles need nothing, against the same lanes mixed, and -0 that is handed through."""
    given = np.concatenate([GIVEN, [[-0.0, 1.0], [np.nan, 1.0], [np.inf, 1.0]]])
    kernel, order = Kernel(PROGRAM, select_target()), np.argsort(given[:, 0])
    mixed, tiles = kernel(given), np.empty((len(given), 1))
    tiles[order] = kernel(np.ascontiguousarray(given[order]))
    np.testing.assert_array_equal(mixed.view(np.int64), tiles.view(np.int64))


def test_it_is_left_out_behind_a_branch(tmp_path):
    assert "call void @square" in batch_module(4, PROGRAM).text()
    text = c_source(PROGRAM)
    assert text.count("!= 0)") == 1
    (tmp_path / "a.c").write_text(text + batch_function("above", [2, 1], 1), encoding="ascii")
    build([compiler("gcc"), *BITS, "-shared", "-fPIC", tmp_path / "a.c", "-o", tmp_path / "a.so", "-lm"])
    (found,) = run_batch(ctypes.CDLL(str(tmp_path / "a.so")), "above", [GIVEN], [(1,)])
    np.testing.assert_array_equal(found, Kernel(PROGRAM, select_target())(GIVEN))


@pytest.mark.study
@pytest.mark.parametrize("lanes", [16, 64])
def test_what_no_lane_needs_costs_next_to_nothing(lanes):
    """Two thousand operations that no lane needs, beside the same that one lane of every tile needs."""

    def long(x):
        value = x[0]
        for k in range(1000):
            value = 0.999 * value + scalar.sin(value) * (0.001 * k)
        return scalar.array([value])

    def either(given):
        return WhereNeeded("long", long, {"x": (1,)})(scalar.less(0.0, given[0]), given, given)

    kernel = Kernel(trace("either", either, {"given": (1,)}, ("y",)), select_target())
    idle, busy = np.full((lanes, 1), -1.0), np.full((lanes, 1), 1.0)

    def seconds(values: np.ndarray) -> float:
        began = time.process_time()
        for _ in range(20):
            kernel(values)
        return time.process_time() - began

    seconds(busy)
    least = np.array([[seconds(idle), seconds(busy)] for _ in range(8)]).min(axis=0)
    assert 3.0 * least[0] < least[1]


def test_calls_with_some_new_arguments_keep_the_others():
    """The second call sets only what has changed, in the same places."""
    inner = trace(
        "inner", lambda a, b: scalar.array([a[0] - 2.0 * b[0], a[0] * b[0]]), {"a": (1,), "b": (1,)}, noinline=True
    )

    def twice(a, b):
        first = call(inner, a, b)
        second = call(inner, a, b + 1.0)
        return scalar.array([*first, *second, *call(inner, a, b)])

    a, b = np.random.default_rng(4).normal(size=(2, 37, 1))
    program = trace("twice", twice, {"a": (1,), "b": (1,)}, ("y",))
    found = Kernel(program, select_target())(a, b)
    expected = np.concatenate([a - 2 * b, a * b, a - 2 * b - 2, a * b + a, a - 2 * b, a * b], axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-14)
