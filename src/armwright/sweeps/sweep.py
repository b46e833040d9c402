"""Sweep: lanes of a scenario simulated in chunks on a Dask cluster, into a store from which a later call can continue."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import AnyScenario
from armwright.errors import ArmwrightError, OutputError, ScenarioError
from armwright.output import check_destination
from armwright.progress import Shown, automatic
from armwright.results.reducers import REDUCERS
from armwright.results.result import Result
from armwright.scenarios.records import MOST_LANES
from armwright.simulation.checks import check_whole
from armwright.simulation.scenario import Scenario
from armwright.simulation.simulation import SUPPORT as SIMULATED, simulate
from armwright.sweeps.cluster import connected
from armwright.sweeps.source import LaneSource, source_of
from armwright.sweeps.store import About, SweepStore, by_lane, difference, import_zarr

if TYPE_CHECKING:
    import xarray as xr

SUPPORT = SIMULATED.named("sweep")

CHUNKS = 16  # by default, so that several workers have some each; within these:
ENOUGH = 4e7  # joints times ticks of a chunk's lanes, some seconds: a chunk begins with up to 0.1 s of preparation
ENDLESS = 20.0  # times that: a kill costs no more than a minute or two
LEAST, MOST = 64, 100_000  # lanes
AHEAD = 3  # tasks for each thread of the cluster that wait or run, so that memory stays bounded
Outcome = tuple[dict[str, np.ndarray], dict[str, str]]


@dataclass(frozen=True)
class Sweep(Result):
    """Summary of a finished or stopped sweep.

    Attributes:
        path: of the store.   lanes: of the whole sweep.   done: that this call simulated.   kept: that were there before.
        failed: reasons by chunk of those that failed again.   chunk: lanes in a chunk.   seconds: that this call took.
    """

    path: Path
    lanes: int
    done: int
    kept: int
    failed: dict[int, str]
    chunk: int
    seconds: float

    def load(self) -> xr.Dataset:
        """The results, as `load_sweep` gives them."""
        from armwright.sweeps.store import load_sweep

        return load_sweep(self.path)


def sweep(
    scenario: AnyScenario,
    path: str | os.PathLike[str],
    *,
    lanes: float,
    client: Any = None,
    chunk: int | None = None,
    rows: bool = False,
    retries: int = 2,
    progress: Shown = None,
) -> Sweep:
    """Simulates many lanes of a scenario, chunk by chunk on a Dask cluster, and stores each chunk as it finishes.

    A lane has the same bits whatever the chunks, workers and their order. Where the store is there already, only chunks that are
    not done, or whose files are damaged, are simulated; so a sweep that was stopped or killed goes on with the same call.

    Args:
        scenario: what to run, or the path of a scenario file. Its draws are drawn for as many lanes as are asked for here.
        path: of the store, a folder that ends in .zarr.   lanes: of the whole sweep.
        client: a `distributed.Client`, or the address of a Dask scheduler; default: a cluster on this machine.
        chunk: lanes in a task, by default so many that it takes seconds; a store that is there keeps its own.
        rows: whether recorded rows are stored too; else only what the scenario reduces.
        retries: how often a chunk is tried again after an error before it is marked as failed.
        progress: True or None: a bar in terminals and notebooks; False: none; a function is called with (done, total) lanes.
    Returns:
        sweep: what was done, and what failed; `load` reads the results.
    Raises:
        ScenarioError: what cannot be run, no scheduler at the address, or the extra `sweep` is not installed.
        OutputError: the store holds a sweep of another scenario or version, or cannot be written; finished chunks are kept.
    Example:
        >>> from distributed import Client
        >>> with Client(processes=False, dashboard_address=None) as client:
        ...     scenario = "examples/robust.scenario.toml"
        ...     done = aw.sweeps.sweep(scenario, "runs.zarr", lanes=4, client=client)
        >>> done.done, done.failed
        (4, {})
    """
    began, path = time.perf_counter(), Path(path)
    import_zarr()
    count = _checked_lanes(lanes)
    for name, value, least in (("chunk", chunk, 1), ("retries", retries, 0)):
        if value is not None:
            check_whole(name, value, least)
    source = source_of(scenario)
    reduced = _part(source, range(1), rows)
    source.part(range(count - 1, count))  # refuses lanes that batches do not have
    if not rows and not reduced.recording.reduce:
        expected = f"what is kept of a lane, of {', '.join(REDUCERS)}"
        raise ScenarioError("stores nothing", place="recording.reduce", value=[], expected=expected)
    first = simulate(_part(source, range(1), rows).without_global_error)
    about = About(source.digest, count, min(chunk or count, count), rows, json.loads(first.attrs["made_with"]))
    store = _begun(path, about)
    done = kept = 0
    if store is None or store.missing:
        with connected(client) as cluster, automatic(progress, f"sweeping into {path.name}", "lanes") as tell:
            if store is None:
                about = about if chunk else replace(about, chunk=_usual_chunk(reduced, count, _threads(cluster)))
                store = SweepStore.create(path, about, source.document, first)
            kept = store.lanes_done
            for which, result in _results(cluster, source, store.about, store.missing, retries):
                if isinstance(result, str):
                    store.fail(which, result)
                    continue
                store.write(which, result)
                done += len(store.about.lanes_of(which))
                tell(kept + done, count)
    spent = time.perf_counter() - began
    return Sweep(path, count, done, store.lanes_done - done, dict(store.failures), store.about.chunk, spent)


def _checked_lanes(lanes: Any) -> int:
    """The number of lanes as an integer; 1e7 is one.

    Raises:
        ScenarioError: no whole number of lanes.
    """
    whole = isinstance(lanes, (int, float, np.integer)) and not isinstance(lanes, bool) and float(lanes).is_integer()
    if not whole or not 1 <= lanes <= 100 * MOST_LANES:
        raise ScenarioError(place="lanes", value=lanes, expected=f"a whole number from 1 to {100 * MOST_LANES:.0e}")
    return int(lanes)


def _usual_chunk(scenario: Scenario, count: int, threads: int) -> int:
    """Lanes in a chunk that takes seconds, of a sweep of so many lanes; as many chunks for each thread of the cluster."""
    least = ENOUGH / (scenario.ticks * scenario.arm.n)
    usual = np.clip(np.clip(-(-count // CHUNKS), least, ENDLESS * least), LEAST, MOST)
    rounds = np.ceil(count / (threads * usual))
    return max(min(LEAST, count), int(np.ceil(count / (threads * rounds))))


def _threads(cluster: Any) -> int:
    """Threads of all workers; 1 while there are none."""
    return max(1, sum(cluster.nthreads().values()))


def _part(source: LaneSource, lanes: range, rows: bool) -> Scenario:
    """The scenario of some lanes, which records its reduced results, and rows where they are wanted."""
    scenario = source.part(lanes)
    if rows or not scenario.recording.reduce:
        return scenario
    return replace(scenario, recording=replace(scenario.recording, what="none", every=0, period=None))


def _begun(path: Path, about: About) -> SweepStore | None:
    """The store of this sweep that was begun before; None where there is nothing.

    Raises:
        OutputError: something else is there, the sweep is another one, or a store cannot be written.
    """
    if not os.path.exists(path):
        check_destination(path, (".zarr",))
        return None
    if not os.path.isfile(path / "zarr.json"):
        raise OutputError("is there, and is no store of a sweep", file=path, expected="another name, ending in .zarr")
    store = SweepStore(path)
    store.about.check(about, path)
    return store


@lru_cache(maxsize=2)
def _unpickled(data: bytes) -> LaneSource:
    """The source that a worker was sent; the same one for all its chunks."""
    import cloudpickle

    return cloudpickle.loads(data)


def simulate_chunk(data: bytes, lanes: range, rows: bool) -> Outcome:
    """Results of a chunk by name, with versions and processor; the task of a worker.

    Args:
        data: the pickled source.   lanes: of the chunk.   rows: whether recorded rows are wanted.
    """
    run = simulate(_part(_unpickled(data), lanes, rows).without_global_error, threads=1)
    return {name: variable.values for name, variable in by_lane(run).items()}, json.loads(run.attrs["made_with"])


def _results(
    cluster: Any, source: LaneSource, about: About, chunks: list[int], retries: int
) -> Iterator[tuple[int, dict[str, np.ndarray] | str]]:
    """Results of the chunks as they finish, or the reason why a chunk failed; few are under way at a time.

    Raises:
        OutputError: the scheduler has gone.
    """
    import cloudpickle
    import distributed

    whole, following, running = cloudpickle.dumps(source), iter(chunks), {}

    def submit() -> Any:
        chunk = next(following, None)
        if chunk is None:
            return None
        lanes = about.lanes_of(chunk)
        sent = source.sent(lanes)
        data = whole if sent is source else cloudpickle.dumps(sent)
        future = cluster.submit(simulate_chunk, data, lanes, about.rows, retries=retries, pure=False)
        running[future.key] = chunk
        return future

    with _as_lost_cluster():
        ahead = AHEAD * _threads(cluster)
        first = [future for future in (submit() for _ in range(min(ahead, len(chunks)))) if future is not None]
        waiting = distributed.as_completed(first, loop=cluster.loop)
    while running:
        with _as_lost_cluster():
            future = next(waiting)
            chunk = running.pop(future.key)
            result = _result(future, about)
            further = submit()
            if further is not None:
                waiting.add(further)
        del future  # frees the worker's memory
        yield chunk, result


def _result(future: Any, about: About) -> dict[str, np.ndarray] | str:
    """Results of a chunk, or the reason why it failed."""
    if future.status == "cancelled":
        raise OSError("the scheduler has dropped the tasks")
    error = future.exception(timeout=60)
    if error is not None:
        return f"{type(error).__name__}: {' '.join(str(error).split())}"[:500]
    values, made_with = future.result(timeout=600)
    found = difference(about.made_with, made_with)
    return f"simulated with {found}; set solver.target to one that all workers have" if found else values


@contextlib.contextmanager
def _as_lost_cluster() -> Iterator[None]:
    """Turns the loss of the scheduler into our error."""
    try:
        yield
    except ArmwrightError:
        raise
    except (OSError, TimeoutError, RuntimeError, StopIteration) as error:
        what = f"the Dask scheduler has gone ({' '.join(str(error).split()) or type(error).__name__})"
        raise OutputError(f"{what}; finished chunks are kept, and the same sweep goes on from there") from None
