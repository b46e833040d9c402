"""The passes: fewer operations, the same meaning; and compiled code does exactly what is left."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.kernels.batch import Kernel
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.kernels.target import select_target
from armwright.model.changes import without_servos
from armwright.program import evaluate, interpret, trace
from armwright.program.passes import (
    PASSES,
    after_each,
    fused_products,
    in_ready_order,
    in_recursion_order,
    optimised,
    shared_reciprocals,
    turns_first,
)
from physics.arms import FORMS
from reference.chains import chain


def counts(instructions) -> Counter[str]:
    """Number of instructions by name."""
    return Counter(i.operation for i in instructions)


def small(function, size=3):
    """The instructions of a traced function of one vector."""
    return trace("small", lambda x: scalar.array(function(x)), {"x": (size,)}).instructions


def test_a_product_used_once_is_fused():
    """a b + c, a b - c and c - a b take one rounding each."""
    for function, name in (
        (lambda x: [x[0] * x[1] + x[2]], "FMA"),
        (lambda x: [x[0] * x[1] - x[2]], "FMS"),
        (lambda x: [x[2] - x[0] * x[1]], "FNMA"),
        (lambda x: [x[0] * x[0] + x[2]], "FMA"),
    ):
        assert counts(fused_products(small(function))) == {"INPUT": len(counts_inputs(function)), name: 1, "OUTPUT": 1}


def counts_inputs(function) -> list:
    """The input instructions of a function."""
    return [i for i in small(function) if i.operation == "INPUT"]


def test_the_program_is_printed_after_each_pass():
    program = trace("small", lambda x: scalar.array([x[0] * x[1] + x[2] / x[1], x[0] / x[1]]), {"x": (3,)})
    texts = {name: program.listing(instructions) for name, instructions in after_each(program.instructions)}
    assert list(texts) == [each.__name__ for each in PASSES]
    assert "inv" in texts["shared_reciprocals"]
    assert "fma" not in texts["shared_reciprocals"]
    assert "fma" in texts["fused_products"]
    assert sorted(texts["in_need_order"].split("\n")) == sorted(texts["fused_products"].split("\n"))


def test_a_product_used_twice_is_not():
    """It would be computed twice."""
    left = counts(fused_products(small(lambda x: [x[0] * x[1] + x[2], x[0] * x[1]])))
    assert left["MUL"] == 1
    assert left["ADD"] == 1


def test_two_products_in_one_sum():
    """Only one of them can be fused; the one computed last."""
    left = counts(fused_products(small(lambda x: [x[0] * x[1] + x[2] * x[0]])))
    assert (left["MUL"], left["FMA"], left["ADD"]) == (1, 1, 0)


def test_reciprocals_are_shared():
    """Three divisions by one divisor are one reciprocal and three products; a lone division stays."""
    left = counts(shared_reciprocals(small(lambda x: [1.5 / x[2], x[0] / x[2], x[1] / x[2], x[2] / x[0]])))
    assert (left["INV"], left["DIV"]) == (1, 1)


def test_fma_is_one_rounding():
    """(1 + 2⁻³⁰)² - 1 keeps its last bit only where it is fused."""
    x = np.array([[1 + 2**-30, 1 + 2**-30, -1.0]])
    instructions = small(lambda x: [x[0] * x[1] + x[2]])
    assert evaluate(fused_products(instructions), x)[0][0, 0] == 2**-29 + 2**-60
    assert evaluate(instructions, x)[0][0, 0] == 2**-29


@pytest.mark.parametrize("each", PASSES, ids=lambda each: each.__name__)
@pytest.mark.parametrize("name", [*FORMS, "koch"])
def test_passes_keep_the_meaning(each, name):
    """Every pass by itself, on the forward arm, within rounding of the untouched program and of CasADi's interpreter."""
    arm = without_servos(aw.load(name))
    program = trace_kernel(arm, SIGNATURES["forward_arm"])
    inputs = np.random.default_rng(3).normal(size=(3, 4, arm.n))
    plain = evaluate(program.instructions, *inputs)[0]
    passed = evaluate(each(program.instructions), *inputs)[0]
    scale = np.abs(plain).max(axis=1, keepdims=True)
    assert np.all(np.abs(passed - plain) <= 1e-10 * scale)
    assert np.all(np.abs(interpret(program, *inputs) - plain) <= 1e-10 * scale)
    # a reciprocal each for inertia, friction
    assert len(each(program.instructions)) <= len(program.instructions) + 2 * arm.n


def test_native_code_does_exactly_the_instructions():
    """No contraction, reassociation or other liberty of a compiler: the bits of NumPy doing the same list."""

    def function(x):
        total, rows = 0.0, []
        for k in range(6):
            total = total + x[k] * x[(k + 1) % 6] - x[(k + 2) % 6] / (1.5 + x[k] * x[k])
            rows.append(scalar.sqrt(scalar.abs(total)) - x[k] * x[0] + 0.1 * total * 3.0 - (total - x[1]) - x[1])
        return scalar.array([*rows, scalar.clip(total, -1.0, 1.0), scalar.where(scalar.less(total, 0.0), x[0], x[1])])

    program = trace("exact", function, {"x": (6,)})
    x = np.random.default_rng(4).normal(size=(257, 6))
    kernel = Kernel(program, select_target())
    assert np.array_equal(kernel(x), evaluate(optimised(program.instructions), x)[0])


def test_fewer_operations_than_the_literature():
    """Inverse dynamics of a general 6R in 425 products and 369 sums [KhalilKleinfinger1987]: ours, before fusing."""
    for name in ("puma560", "lwa4p", "cmu-dd"):
        arm = aw.load(name).replace(friction=None, rotors=None)
        count = trace_kernel(arm, SIGNATURES["inverse_dynamics"]).operation_counts()
        products, sums = count["MUL"] + count["SQ"], count["ADD"] + count["SUB"] + count["TWICE"]
        assert products < 300
        assert sums < 260
        assert math.isclose(count["SIN"], 5)


def alive(instructions) -> int:
    """The most values that wait at one time for their last use, constants and inputs apart."""
    last = {a: k for k, i in enumerate(instructions) for a in i.arguments}
    waiting, most = set(), 0
    for k, i in enumerate(instructions):
        waiting |= {r for r in i.results if last.get(r, k) > k and i.operation not in ("CONST", "INPUT")}
        waiting -= {a for a in i.arguments if last[a] <= k}
        most = max(most, len(waiting))
    return most


@pytest.mark.parametrize("kernel", ["inverse_dynamics", "forward_dynamics", "mass_matrix"])
def test_other_orders_are_the_same_operations(kernel):
    """Each instruction once, behind those that it needs, to the same bits."""
    program = trace_kernel(aw.load("puma560"), SIGNATURES[kernel])
    inputs = np.random.default_rng(0).normal(size=(len(program.inputs), 5, 6))
    usual = optimised(program.instructions)
    expected = evaluate(usual, *inputs)[0]
    orders = [order(usual) for order in (in_ready_order, in_recursion_order, turns_first)]
    for order in (*orders, turns_first(in_ready_order(usual)), turns_first(in_recursion_order(usual))):
        assert sorted(map(id, order)) == sorted(map(id, usual))
        assert np.array_equal(evaluate(order, *inputs)[0], expected)


@pytest.mark.parametrize("kernel", ["inverse_dynamics", "forward_dynamics"])
def test_fewer_values_wait_along_a_chain(kernel):
    """On the way out a body leaves force and moment behind, not all that they are made of."""
    usual = optimised(trace_kernel(chain(20), SIGNATURES[kernel]).instructions)
    assert alive(in_ready_order(usual)) < 0.75 * alive(usual)


def test_a_recursion_goes_joint_by_joint():
    """Newton and Euler's leaves sine, cosine, force and moment of each body for the way back: eight values, and no more."""
    per_joint = (
        alive(in_recursion_order(optimised(trace_kernel(chain(n), SIGNATURES["inverse_dynamics"]).instructions)))
        for n in (20, 40)
    )
    few, many = per_joint
    assert many - few <= 8.5 * 20


def test_turns_come_first():
    """Before anything is computed from them, sine beside cosine."""
    order = turns_first(optimised(trace_kernel(aw.load("puma560"), SIGNATURES["inverse_dynamics"]).instructions))
    places = [k for k, i in enumerate(order) if i.operation in ("SIN", "COS")]
    assert {i.operation for i in order[: places[-1] + 1]} <= {"INPUT", "CONST", "ADD", "SUB", "SIN", "COS"}
    angles = [order[k].arguments[0] for k in places]
    assert angles == sorted(angles, key=angles.index)
