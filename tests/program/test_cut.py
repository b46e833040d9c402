"""Long programs in pieces: the same operations, the same bits."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.kernels import llvm
from armwright.kernels.batch import Kernel
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.kernels.target import select_target
from armwright.program import call, evaluate, trace
from armwright.program.cut import cut
from armwright.program.passes import optimised


@pytest.fixture(scope="module")
def instructions():
    """The forward arm of the Panda, after the passes."""
    return optimised(trace_kernel(aw.load("panda"), SIGNATURES["forward_arm"]).instructions)


@pytest.mark.parametrize("longest", [1, 7, 50, 100_000])
def test_pieces_put_together_are_the_program(instructions, longest):
    """Run piece by piece through slots, every value arrives where it is needed."""
    parts = cut(instructions, longest)
    inputs = np.random.default_rng(0).normal(size=(3, 4, 7))
    expected = evaluate(instructions, *inputs)[0]
    slots: dict[int, int] = {}
    sequence = []
    for piece in parts.pieces:
        for value, slot in piece.loads.items():
            assert slots[slot] == value  # nobody has written over it
        made = {value for i in piece.instructions for value in i.results}
        known = made | set(piece.loads)
        assert all(value in known for i in piece.instructions for value in i.arguments)
        sequence += [i for i in piece.instructions if i.operation != "CONST" or i not in sequence]
        slots.update({slot: value for value, slot in piece.stores.items()})
        assert all(slot < parts.slots for slot in piece.stores.values())
    assert np.array_equal(evaluate(sequence, *inputs)[0], expected)


def test_slots_are_used_again(instructions):
    """Work memory is what is alive at a cut, not all that was ever made."""
    assert cut(instructions, 50).slots < 0.3 * len(instructions)


def test_cut_code_has_the_same_bits(monkeypatch):
    """A kernel in pieces, and one that calls another, against the same kernels whole."""
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")
    arm = aw.load("puma560")
    program = trace_kernel(arm, SIGNATURES["forward_arm"])
    inner = trace("inner", lambda q: aw.gravity_torques(arm, q), {"q": (6,)}, noinline=True)
    outer = trace("outer", lambda q: call(inner, q) + call(inner, 2.0 * q), {"q": (6,)}, ("g",))
    inputs = np.random.default_rng(1).normal(size=(3, 37, 6))
    whole = [Kernel(program, select_target())(*inputs), Kernel(outer, select_target())(inputs[0])]
    monkeypatch.setattr(llvm, "WHOLE", 5)
    monkeypatch.setattr(llvm, "cut", lambda instructions: cut(instructions, 40))
    cut_up = [Kernel(program, select_target())(*inputs), Kernel(outer, select_target())(inputs[0])]
    for a, b in zip(whole, cut_up, strict=True):
        assert np.array_equal(a, b)


def test_next_tiles_are_fetched_ahead(monkeypatch):
    """Code in pieces asks for the rows of the next tile, also behind the last: nothing is read there, and the bits stay."""
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")
    program = trace_kernel(aw.load("puma560"), SIGNATURES["forward_arm"])
    inputs = np.random.default_rng(2).normal(size=(3, 37, 6))
    whole = Kernel(program, select_target())(*inputs)
    assert "prefetch" not in llvm.batch_module(8, program).text()
    monkeypatch.setattr(llvm, "WHOLE", 5)
    text = llvm.batch_module(8, program).text()
    rows = sum(port.size for port in (*program.inputs, *program.outputs)) * 8 * 8
    assert text.count("call void @llvm.prefetch") == rows // llvm.CACHE_LINE
    assert np.array_equal(Kernel(program, select_target())(*inputs), whole)
