"""Tracing plain functions: what is recorded, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.errors import HiddenStateError, ProgramError, SymbolError
from armwright.program import call, interpret, trace


def swing(q, w):
    """A small function with a shared subexpression, a vector and a scalar output."""
    s = scalar.sin(q[0]) * w
    return scalar.array([s + q[1], s - q[1]]), scalar.hypot(s, 2.0)


def test_trace_equals_float_run():
    """The traced program through CasADi's interpreter is the function on floats."""
    program = trace("swing", swing, {"q": (2,), "w": ()}, ("pair", "length"))
    q, w = np.random.default_rng(0).normal(size=(7, 2)), np.random.default_rng(1).normal(size=7)
    pair, length = interpret(program, q, w)
    assert pair.shape == (7, 2)
    assert length.shape == (7,)
    for k in range(7):
        expected = swing(q[k], w[k])
        assert np.allclose(pair[k], expected[0], rtol=1e-15, atol=0)
        assert length[k] == pytest.approx(expected[1], rel=1e-15)


def test_shared_subexpressions_are_recorded_once():
    """Two sines of one value are one operation."""
    program = trace("twice", lambda q: scalar.array([scalar.sin(q[0]) + q[1], scalar.sin(q[0]) * q[1]]), {"q": (2,)})
    assert program.operation_counts()["SIN"] == 1


def test_constants_fold_away():
    """A robot of zeros costs nothing: gravity on a vertical axis is no operation at all."""
    arm = aw.load("two-link").replace(gravity=[0, 0, -9.81])
    program = trace("g", lambda q: aw.gravity_torques(arm, q), {"q": (2,)})
    assert sum(program.operation_counts().values()) == 0
    assert np.array_equal(interpret(program, np.ones((3, 2))), np.zeros((3, 2)))


def test_call_keeps_a_program_whole():
    """A noinline program that is called twice stays two calls, with the same results as inlined."""
    inner = trace("inner", lambda q: scalar.cos(q) * q, {"q": (2,)}, noinline=True)
    outer = trace("outer", lambda q: call(inner, q) + call(inner, 2.0 * q), {"q": (2,)})
    assert [i.callee.name for i in outer.instructions if i.callee is not None] == ["inner", "inner"]
    q = np.random.default_rng(2).normal(size=(5, 2))
    assert np.allclose(interpret(outer, q), np.cos(q) * q + np.cos(2 * q) * 2 * q, rtol=1e-14, atol=0)


def test_operations_are_counted_with_those_of_called_programs():
    """Each call of a program counts all that it does; what reads, writes or stands still counts nothing."""
    inner = trace("inner", lambda q: scalar.cos(q) * q, {"q": (2,)}, noinline=True)
    outer = trace("outer", lambda q: call(inner, q) + call(inner, 3.0 * scalar.sin(q)), {"q": (2,)})
    assert inner.operation_counts() == {"COS": 2, "MUL": 2}
    assert outer.operation_counts() == {"COS": 4, "MUL": 6, "SIN": 2, "ADD": 2}


def test_wrong_number_of_results():
    """Outputs have names; another number of arrays is an error that lists them."""
    with pytest.raises(ProgramError) as error:
        trace("pair", lambda q: (q, q), {"q": (2,)}, ("a", "b", "c"))
    assert (error.value.place, error.value.what, error.value.expected) == ("pair", "returns 2 arrays", "3: a, b, c")


def test_branch_on_a_symbol_names_its_place():
    """A branch on a value names file, line and what to use."""

    def branching(q):
        return q if q[0] < 1.0 else -q

    with pytest.raises(SymbolError, match=r"test_trace\.py:\d+: a comparison .*scalar\.less"):
        trace("branching", branching, {"q": (2,)})
    with pytest.raises(SymbolError, match=r"test_trace\.py:\d+: a branch .*scalar\.where"):
        trace("branching", lambda q: q if q[0] else -q, {"q": (2,)})


def test_program_prints_itself():
    """One line an operation, ports by name."""
    program = trace("line", lambda q: scalar.array([2.0 * q[0] + q[1]]), {"q": (2,)}, ("y",))
    text = str(program)
    assert text.splitlines()[0] == "line(q[2])"
    assert "= q[1]" in text
    assert text.splitlines()[-1].strip().startswith("y[0] = output")


def test_a_symbol_that_another_call_left_is_refused():
    """A function that keeps what it was given is no function of its arguments; CasADi would say so in many lines."""
    kept = []

    def follows(q):
        kept.append(q[0])
        return q - kept[0]

    trace("follows", follows, {"q": (2,)})
    with pytest.raises(HiddenStateError) as error:
        trace("follows", follows, {"q": (2,)})
    assert (error.value.place, error.value.what) == ("follows", "computes with q_0 of another call")
