"""Native code for many tasks: every lane takes the next one when its own is done."""

from __future__ import annotations

import numpy as np

from armwright.kernels.loop import LoopArrays, NativeLoop, Tasks
from armwright.kernels.stages import Call, Exchange
from armwright.kernels.target import select_target
from armwright.program import Program


class TaskLoop:
    """A program  task, attempt, fresh, state → state_next, over, fresh_next, result  run until every task has its result."""

    def __init__(self, program: Program, attempts: int = 1, ranked: int = 1):
        """`attempts`: of one task, at most.   `ranked`: how many of them every task names itself."""
        self._target, sizes = select_target(), {port.name: port.size for port in (*program.inputs, *program.outputs)}
        self._attempt, self._result = sizes.get("attempt", 1), sizes["result"]
        exchange = Exchange(sizes["task"], self._attempt, self._result, attempts, ranked)
        self._loop = NativeLoop((exchange, Call(program)), self._target)

    def run(self, tasks: np.ndarray, attempts: np.ndarray | None = None, ranks: np.ndarray | None = None) -> np.ndarray:
        """(k, result) of tasks (k, …).

        Args:
            tasks: one a row.   attempts: rows to begin from; by default one of zeros.
            ranks: (k, ranked) numbers of those that each task tries first; by default the first one.
        """
        lanes, found = self._loop.lanes(self._target.width), np.empty((len(tasks), self._result))
        lanes.blocks["over"].fill(2.0)
        lanes.blocks["task_number"].fill(-1.0)
        rows = np.zeros((1, self._attempt)) if attempts is None else attempts
        numbers = np.zeros((len(tasks), 1)) if ranks is None else ranks
        queue = np.array([0, len(tasks)])
        work = Tasks(queue, np.ascontiguousarray(tasks), rows, np.ascontiguousarray(numbers), found)
        self._loop.run(lanes, 0.0, (0, 2**62), LoopArrays(tasks=work))
        return found
