"""Memory of large results is used again, and never while anybody holds a part of it."""

from __future__ import annotations

import gc
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import armwright as aw
from armwright.kernels import memory
from armwright.kernels.memory import KEPT, LINE, PAGED, address, empty

DOUBLE = np.dtype(np.float64)
LARGE = (PAGED // 8, 1)  # the least that is kept, a cache line more


@pytest.fixture(autouse=True)
def _nothing_waits(monkeypatch):
    monkeypatch.setattr(memory, "_waiting", {})


@pytest.mark.parametrize("shape", [(0, 3), (4, 3), (4095,), (4096,), (500, 6, 6), LARGE])
@pytest.mark.parametrize("dtype", [DOUBLE, np.dtype(np.float32)])
def test_an_array_is_like_numpys_and_a_large_one_begins_at_a_cache_line(shape, dtype):
    found = empty(shape, dtype)
    assert (found.shape, found.dtype) == (shape, dtype)
    assert found.flags.carray
    assert found.size < 4096 or address(found) % LINE == 0
    found[...] = 1.0


def test_memory_of_a_result_that_is_gone_is_that_of_the_next():
    first = empty(LARGE, DOUBLE)
    where = address(first)
    del first
    assert address(empty(LARGE, DOUBLE)) == where
    smaller = empty((PAGED // 8 - LINE, 1), DOUBLE)
    assert address(smaller) != where


def test_what_anybody_holds_is_not_written_over():
    dyn = aw.compile("puma560")
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (2, 16384, 6))
    part = dyn.mass_matrix(q[0])[7:9].T  # a view of a view
    before = part.copy()
    other = dyn.mass_matrix(q[1])
    assert not np.shares_memory(part, other)
    assert np.array_equal(part, before)
    where = address(other)
    del other
    again = dyn.mass_matrix(q[0])
    assert address(again) == where
    assert np.array_equal(again, np.stack([dyn.mass_matrix(row) for row in q[0]]))
    assert np.array_equal(again[7:9].T, before)


def test_results_shared_out_over_threads_take_it_too():
    dyn = aw.compile("puma560")
    dyn.threads = 2
    q = np.zeros((65536, 6))
    where = address(dyn.mass_matrix(q))  # its first call learns the shapes
    assert address(dyn.mass_matrix(q)) == where


def test_at_most_so_much_waits_and_sizes_used_last_stay():
    quarter = KEPT // 4 // 8 - LINE
    results = [empty((quarter - k, 1), DOUBLE) for k in range(6)]
    while results:
        results.pop()
    held = {size: len(waiting) for size, waiting in memory._waiting.items()}
    assert sum(size * count for size, count in held.items()) <= KEPT
    assert list(held.values()) == [1] * 4
    assert max(held) == quarter * 8 + LINE  # popped last
    memory._waiting.clear()
    whole = [empty((KEPT // 8, 1), DOUBLE), empty((quarter, 1), DOUBLE)]
    whole.clear()
    assert list(memory._waiting) == [quarter * 8 + LINE]  # more than may wait is given back


def test_calls_from_many_threads_keep_their_results():
    def one(k: int) -> bool:
        found = empty(LARGE, DOUBLE)
        found[...] = k
        gc.collect(0)
        return bool((found == k).all())

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(one, range(200)))


def test_a_process_that_ends_with_results_in_hand_says_nothing():
    text = """
import sys, numpy, armwright as aw
from armwright.kernels.memory import empty
kept = [empty((1 << 20,), numpy.dtype(float)) for _ in range(3)]
numpy.kept, aw.compile_kept, sys.kept = empty((1 << 20,), numpy.dtype(float)), kept[0], kept[1][:5]
kept.append(kept)
"""
    ran = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
