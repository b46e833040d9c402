"""Iterations in a trace: steps that change nothing are left out, and the bits are those of all of them."""

from __future__ import annotations

import ctypes

import numpy as np

from armwright import scalar
from armwright.kernels.c import c_source
from armwright.kernels.llvm import batch_module
from armwright.program import evaluate, repeated, trace
from armwright.program.passes import optimised
from kernels.c_compilers import BITS, batch_function, build, compiler, run_batch

STEPS = 9


def root(given):
    """√a by Newton's method, and how many steps changed it."""
    a = given[0]

    def step(state, given):
        better = 0.5 * (state[0] + given[0] / state[0])
        rests = scalar.equal(better, state[0])
        return scalar.array([scalar.where(rests, state[0], better), state[1] + (1.0 - rests)])

    return repeated("heron", step, scalar.array([a, 0.0]), (given,), STEPS)


PROGRAM = trace("root", root, {"a": (1,)}, ("y",))
A = np.abs(np.random.default_rng(0).normal(size=1003)) * 10.0 ** np.random.default_rng(1).integers(-3, 4, 1003)


def test_floats_stop_by_themselves():
    value, steps = root(np.array([2.0]))
    assert value == np.nextafter(np.sqrt(2.0), 0.0)
    assert steps == 5


def test_one_step_is_one_function():
    """Called as often as there are steps, each but the first behind a test."""
    assert [i.operation for i in PROGRAM.instructions].count("CALL") == STEPS
    text = c_source(PROGRAM)
    assert text.count("if (v") == STEPS - 1
    module = batch_module(4, PROGRAM).text()
    assert module.count("call void @heron") == STEPS


def test_steps_that_are_left_out_change_no_bit(tmp_path):
    """C, which leaves them out, against NumPy, which does them all."""
    (tmp_path / "r.c").write_text(c_source(PROGRAM) + batch_function("root", [1, 2], 1), encoding="ascii")
    build([compiler("gcc"), *BITS, "-shared", "-fPIC", tmp_path / "r.c", "-o", tmp_path / "r.so", "-lm"])
    (found,) = run_batch(ctypes.CDLL(str(tmp_path / "r.so")), "root", [A], [(2,)])
    (expected,) = evaluate(optimised(PROGRAM.instructions), A[:, None])
    np.testing.assert_array_equal(found, expected)
    assert (found[:, 1] < STEPS).any()
    np.testing.assert_allclose(found[found[:, 1] < STEPS, 0], np.sqrt(A[found[:, 1] < STEPS]), rtol=3e-16)
