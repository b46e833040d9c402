"""Many lanes through a compiled loop: in groups that fit a cache, one after another or one a thread, each in short pieces."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

PIECE = 0.05  # [s] after which native code comes back, for progress and Ctrl-C
TILES_A_GROUP = 32

Progress = Callable[[int, int], None]
Group = Callable[[int, int], "Work"]
Work = tuple[Callable[[int, int], None], Callable[[], None]]


def run_groups(lanes: int, width: int, ticks: int, begin: Group, progress: Progress | None, workers: int) -> None:
    """Takes all lanes through all ticks.

    Args:
        lanes: how many.   width: of a tile.   ticks: how many.
        begin: (first lane, count) of a group → (advance, end): advance(first tick, last tick), and what to do behind the last.
        progress: called now and then with the lane-ticks done and those there are.
        workers: threads that share the groups.
    """
    tiles = -(-lanes // width)
    size = width * max(1, min(TILES_A_GROUP, -(-tiles // workers)))
    starts = list(range(0, lanes, size))
    done, stopped = [0] * len(starts), threading.Event()

    def go(which: int) -> None:
        first = starts[which]
        count = min(size, lanes - first)
        advance, end = begin(first, count)
        tick, piece = 0, 100
        while tick < ticks and not stopped.is_set():
            last, start = min(ticks, tick + piece), time.perf_counter()
            advance(tick, last)
            spent = time.perf_counter() - start
            done[which] += (last - tick) * count
            tick, piece = last, max(1, int(piece * min(4.0, PIECE / max(spent, 1e-6))))
            if progress is not None and threading.current_thread() is threading.main_thread():
                progress(sum(done), lanes * ticks)
        if tick == ticks:
            end()

    if workers == 1 or len(starts) == 1:
        for which in range(len(starts)):
            go(which)
    else:
        with ThreadPoolExecutor(workers) as pool:
            try:
                waiting = {pool.submit(go, which) for which in range(len(starts))}
                while waiting:
                    finished, waiting = wait(waiting, timeout=PIECE, return_when=FIRST_COMPLETED)
                    for future in finished:
                        future.result()
                    if progress is not None and waiting:
                        progress(sum(done), lanes * ticks)
            finally:  # on Ctrl-C every thread comes back after the piece it is in
                stopped.set()
                pool.shutdown(cancel_futures=True)
    if progress is not None:
        progress(lanes * ticks, lanes * ticks)
