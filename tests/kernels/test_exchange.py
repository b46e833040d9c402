"""Lanes that work on tasks: every result is that of the same work in Python, whatever the lanes did before."""

from __future__ import annotations

import numpy as np
import pytest

from armwright import scalar
from armwright.kernels.loop import LoopArrays, NativeLoop, Tasks
from armwright.kernels.stages import Call, Exchange
from armwright.kernels.target import select_target
from armwright.program import trace

MOST, RANKED, ROWS = 5, 2, 7


def halving(task, attempt, fresh, state):
    """Counts how often a start is halved until it is below the task's bound; one above 100 fails after three."""
    new = scalar.less(0.0, fresh[0])
    value = scalar.where(new, attempt[0] + task[1], state[0] * 0.5)
    steps = scalar.where(new, 0.0, state[1] + 1.0)
    tried = scalar.where(scalar.less(1.0, fresh[0]), 1.0, scalar.where(new, state[2] + 1.0, state[2]))
    failed = scalar.where(scalar.less_equal(3.0, steps), scalar.less(100.0 / 8.0, value), 0.0)
    over = scalar.where(scalar.less(value, task[0]), 2.0, failed)
    state = scalar.array([value, steps, tried])
    return state, scalar.array([over]), scalar.zeros(1), state


SHAPES = {"task": (2,), "attempt": (1,), "fresh": (1,), "state": (3,)}
PROGRAM = trace("halving", halving, SHAPES, ("state_next", "over", "fresh_next", "result"))


def in_python(task, rows, ranks):
    for attempt in range(MOST):
        row = int(ranks[attempt]) if attempt < RANKED else (attempt - RANKED) % ROWS
        value, steps = rows[row, 0] + task[1], 0.0
        while not value < task[0] and not (steps >= 3.0 and value > 12.5):
            value, steps = value * 0.5, steps + 1.0
        if value < task[0]:
            break
    return [value, steps, attempt + 1.0]


@pytest.mark.parametrize("count", [0, 1, 5, 200])
def test_tasks_are_done_as_in_python(count):
    rng = np.random.default_rng(count)
    tasks = rng.uniform([0.1, 0.0], [9.0, 50.0], (count, 2))
    rows = rng.uniform(1.0, 300.0, (ROWS, 1))
    ranks = rng.integers(0, ROWS, (count, RANKED)).astype(float)
    loop = NativeLoop((Exchange(2, 1, 3, MOST, RANKED), Call(PROGRAM)), select_target())
    lanes = loop.lanes(loop.target.width)
    lanes.blocks["over"].fill(2.0)
    lanes.blocks["task_number"].fill(-1.0)
    results = np.full((count, 3), np.nan)
    loop.run(lanes, 0.0, (0, 2**62), LoopArrays(tasks=Tasks(np.array([0, count]), tasks, rows, ranks, results)))
    assert results.tolist() == [in_python(*each) for each in zip(tasks, [rows] * count, ranks, strict=True)]
