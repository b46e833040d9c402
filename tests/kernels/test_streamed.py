"""Results that are written past the cache: the same bits, wherever the arrays lie, and nothing beside them."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.kernels import llvm, target
from armwright.kernels.batch import Kernel
from armwright.kernels.format import FORMATS
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.kernels.target import select_target
from physics.arms import arm

COUNT = 203  # states: some tiles, and a tail


@pytest.fixture(autouse=True)
def without_cache(monkeypatch):
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ["mass_matrix", "regressor", "inverse_dynamics_derivatives"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("level", [None, "x86-64"])
def test_bits_are_those_of_usual_stores(name, dtype, level, monkeypatch):
    """Into new arrays, and into arrays that begin at any number, of three threads too; what lies around them stays."""
    format = FORMATS[dtype]
    program, target = trace_kernel(arm("puma560"), SIGNATURES[name]), select_target(level, format)
    inputs = [np.random.default_rng(k).normal(size=(COUNT, 6)).astype(dtype) for k in range(len(program.inputs))]
    expected = results(Kernel(program, target, format=format), inputs)
    monkeypatch.setattr(llvm, "STREAMED", 1)
    kernel = Kernel(program, target, format=format)
    assert "nontemporal" in llvm.batch_module(target.width, program, format.name).text()
    for ours, theirs in zip(results(kernel, inputs), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    for begin in range(9):
        rooms = [np.full(each.size + 16, np.nan, dtype) for each in expected]
        outs = [room[begin:][: each.size].reshape(each.shape) for room, each in zip(rooms, expected, strict=True)]
        kernel(*inputs, out=outs[0] if len(outs) == 1 else tuple(outs))
        for room, ours, theirs in zip(rooms, outs, expected, strict=True):
            np.testing.assert_array_equal(ours, theirs)
            assert np.isnan(room).sum() == 16


def results(kernel: Kernel, inputs: list[np.ndarray]) -> tuple[np.ndarray, ...]:
    found = kernel(*inputs)
    return found if isinstance(found, tuple) else (found,)


@pytest.mark.parametrize("name", ["mass_matrix", "regressor", "inverse_dynamics_derivatives"])
def test_entries_of_one_value_wait_in_one_place(name, monkeypatch):
    """Halves of symmetric matrices, and zeros, of programs in pieces: whole rows are written all the same, with the same bits."""
    program = trace_kernel(arm("puma560"), SIGNATURES[name])
    inputs = [np.random.default_rng(k).normal(size=(COUNT, 6)) for k in range(len(program.inputs))]
    expected = results(Kernel(program, select_target()), inputs)
    monkeypatch.setattr(llvm, "WHOLE", 5)
    for wide in (1000, 8):  # stored in a line, and in a loop
        monkeypatch.setattr(llvm, "WIDE", wide)
        for ours, theirs in zip(results(Kernel(program, select_target()), inputs), expected, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert f"@{program.name}.{program.outputs[-1].name}.places" in llvm.batch_module(4, program).text()


def test_arrays_between_two_numbers(monkeypatch):
    """An array of odd bytes, as packed records have, is written in the usual way."""
    program = trace_kernel(arm("puma560"), SIGNATURES["mass_matrix"])
    q = np.random.default_rng(0).normal(size=(COUNT, 6))
    expected = Kernel(program, select_target())(q)
    monkeypatch.setattr(llvm, "STREAMED", 1)
    odd = np.zeros(expected.nbytes + 3, np.uint8)[3:].view(float).reshape(expected.shape)
    Kernel(program, select_target())(q, out=odd)
    np.testing.assert_array_equal(odd, expected)


def test_large_batches_of_a_compiled_arm():
    """As they come, over the threshold, by one thread and by two: what a loop over parts gives."""
    dyn = aw.compile(arm("puma560"))
    count = llvm.STREAMED // (8 * 36) * 2 + 5
    q = np.random.default_rng(1).normal(size=(count, 6))
    parts = np.concatenate([dyn.mass_matrix(q[first : first + 1000]) for first in range(0, count, 1000)])
    for threads in (1, 2):
        dyn.threads = threads
        np.testing.assert_array_equal(dyn.mass_matrix(q), parts)


def test_few_columns_are_stored_as_ever():
    """Torques and poses leave the cache no sooner than they are computed."""
    for name in ("inverse_dynamics", "forward_kinematics"):
        program = trace_kernel(arm("puma560"), SIGNATURES[name])
        assert "nontemporal" not in llvm.batch_module(4, program).text()


@pytest.mark.parametrize(("said", "bytes"), [("32768K\n", 32 << 20), ("all of it", 0), (None, 0)])
def test_the_last_cache_is_as_large_as_the_system_says(said, bytes, tmp_path, monkeypatch):
    monkeypatch.setattr(target, "LAST_CACHE", tmp_path / "size")
    if said is not None:
        (tmp_path / "size").write_text(said)
    assert target.last_cache() == bytes


@pytest.mark.parametrize("name", ["mass_matrix", "regressor", "inverse_dynamics_derivatives"])
def test_rows_are_taken_from_columns_in_the_last_round(name):
    """No lanes are taken out of a register a second time: those instructions took a tenth of the time of such results."""
    text = llvm.batch_module(8, trace_kernel(arm("puma560"), SIGNATURES[name])).text()
    assert text.count("store <4 x double>") > 30
    assert "poison, <4 x i32>" not in text
