"""Many lanes through a compiled loop: in groups that fit a cache, one after another or one a thread, each in short pieces."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import Interrupted
from armwright.progress import Progress
from armwright.results.notes import notes_of

if TYPE_CHECKING:
    import xarray

PIECE = 0.05  # [s] after which native code comes back, for progress and Ctrl-C
PIECE_ON_GPU = 0.5  # [s] the same of a GPU, where the lanes' blocks are copied there and back
TILES_A_GROUP = 32

Group = Callable[[int, int], "Work"]
Work = tuple[Callable[[int, int], None], Callable[[], None]]


@dataclass(frozen=True, eq=False)
class Finished:
    """Lanes and ticks of a run that were finished.

    Attributes:
        lanes: (k,) numbers of those that came to the end, or of all where they are one group.
        ticks: that these came through.   stopped: true where Ctrl-C ended the run before all of them did.
    """

    lanes: np.ndarray
    ticks: int
    stopped: bool

    def rows(self, every: int, recorded: int) -> slice:
        """The recorded rows that were written: one is written as its tick begins, the last one in a tick of its own."""
        return slice(min(recorded, (self.ticks - 1) // every + 1 + (self.ticks == (recorded - 1) * every)))


def handed_out(run: xarray.Dataset, finished: Finished, ticks: int, lanes: int) -> xarray.Dataset:
    """The run; after Ctrl-C an exception with the finished part.

    Raises:
        Interrupted: says how far it came.
    """
    if not finished.stopped:
        return run
    extent = (
        f"{len(finished.lanes)} of {lanes} lanes"
        if finished.ticks == ticks
        else f"{finished.ticks} of {ticks} ticks of {'the run' if lanes == 1 else 'all lanes'}"
    )
    note = f"stopped by Ctrl-C after {extent}"
    run.attrs["notes"] = "\n".join([note, *notes_of(run)])
    raise Interrupted(note, run)


def run_groups(
    lanes: int,
    width: int,
    ticks: int,
    begin: Group,
    progress: Progress,
    workers: int,
    *,
    whole: bool = False,
    piece: float = PIECE,
) -> Finished:
    """Takes all lanes through all ticks.

    Ctrl-C ends it after the pieces that are under way; what was finished until then is returned, be it lanes or, where all
    lanes are one group, ticks.

    Args:
        lanes: how many.   width: of a tile.   ticks: how many.
        begin: (first lane, count) of a group → (advance, end): advance(first tick, last tick), and what to do behind the last.
        progress: called now and then with the lane-ticks done and those there are.
        workers: threads that share the groups.   whole: true where all lanes are one group.
        piece: [s] after which `advance` is to come back.
    Raises:
        KeyboardInterrupt: Ctrl-C came before anything was finished.
    """
    tiles = -(-lanes // width)
    size = width * (tiles if whole else max(1, min(TILES_A_GROUP, -(-tiles // workers))))
    starts = list(range(0, lanes, size))
    done, ended = [0] * len(starts), [False] * len(starts)
    stopped, following, turn = threading.Event(), iter(range(len(starts))), threading.Lock()

    def go(which: int) -> None:
        first = starts[which]
        count = min(size, lanes - first)
        advance, end = begin(first, count)
        tick, size_of_piece = 0, 100
        try:
            while tick < ticks and not stopped.is_set():
                last, start = min(ticks, tick + size_of_piece), time.perf_counter()
                advance(tick, last)
                spent = time.perf_counter() - start
                done[which] += (last - tick) * count
                tick, size_of_piece = last, max(1, int(size_of_piece * min(4.0, piece / max(spent, 1e-6))))
                if threading.current_thread() is threading.main_thread():
                    progress(sum(done), lanes * ticks)
        finally:
            if tick == ticks or len(starts) == 1:
                end()
                ended[which] = tick == ticks

    def work() -> None:
        while not stopped.is_set():
            with turn:
                which = next(following, None)
            if which is None:
                return
            go(which)

    def share() -> None:
        with ThreadPoolExecutor(min(workers, len(starts))) as pool:
            try:
                waiting = {pool.submit(work) for _ in range(min(workers, len(starts)))}
                while waiting:
                    ended_jobs, waiting = wait(waiting, timeout=PIECE, return_when=FIRST_EXCEPTION)
                    for future in ended_jobs:
                        future.result()
                    if waiting:
                        progress(sum(done), lanes * ticks)
            finally:  # on Ctrl-C every thread comes back after the piece it is in
                stopped.set()

    try:
        work() if workers == 1 or len(starts) == 1 else share()
        progress(lanes * ticks, lanes * ticks)
    except KeyboardInterrupt:
        reached = done[0] // lanes if len(starts) == 1 else ticks
        kept = [first for first, end in zip(starts, ended, strict=True) if end or len(starts) == 1]
        if not kept or not reached:
            raise
        numbers = np.concatenate([np.arange(first, min(first + size, lanes)) for first in kept])
        return Finished(numbers, reached, True)
    return Finished(np.arange(lanes), ticks, False)
