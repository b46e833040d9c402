"""Price of a sweep beside the same lanes in one process, and the memory that sweeps of many lanes take.

    python tools/sweep_overhead.py overhead --lanes 400000
    python tools/sweep_overhead.py memory --lanes 2e6 --lanes 1e7

`overhead`: `examples/robust.scenario.toml` in one process with a thread for each processor, and as a sweep on a cluster of as
many workers, in turns. The first lanes of each are simulated before, so that both have compiled. Times are of the wall, and of
the processors for all processes together, which other work on the machine does not lengthen as much.
`memory`: short runs of two links, each number of lanes in a fresh process; the largest resident set of the process that calls
`sweep`, and of its workers.
"""

from __future__ import annotations

import argparse
import logging
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import armwright as aw
from armwright.scenarios.file import parse_scenario
from armwright.scenarios.files import FolderFiles
from armwright.sweeps.cluster import connected, local_cluster

ROOT = Path(__file__).resolve().parents[1]
ROBUST = ROOT / "examples" / "robust.scenario.toml"
SHORT = """
robot = "two-link"
duration_s = 0.02

[solver]
integrator = "rk3"

[loop]
period_s = 1e-3
controller = { kind = "joint_pid", kp = 60.0, kd = 4.0 }
reference = { kind = "step", start = [0.0, 0.0], goal = [0.5, 0.2] }

[recording]
reduce = ["rms_error"]

[lanes]
kind = "draws"
count = 3
seed = 1
vary = { "forearm.mass_kg" = { uniform = [3.5, 4.5] } }
"""
WARM = 2000  # lanes that every process simulates before


def overhead(lanes: int, repetitions: int) -> None:
    """Prints seconds of both, of the wall and of all processors."""
    import psutil

    own, workers = psutil.Process(), os.cpu_count() or 1
    text = ROBUST.read_text(encoding="utf-8")

    def alone() -> None:
        every = parse_scenario(text, str(ROBUST), FolderFiles(ROBUST.parent), range(lanes))
        keep = replace(every.recording, what="none", every=0, period=None)  # as sweeps keep it
        aw.simulate(replace(every, recording=keep), threads=workers)

    found: dict[str, list[tuple[float, float]]] = {"one process": [], "sweep": []}
    with (
        tempfile.TemporaryDirectory() as folder,
        local_cluster() as cluster,
        connected(cluster.scheduler_address) as it,
    ):
        it.wait_for_workers(workers, timeout=120)

        def swept(count: int, name: str) -> None:
            done = aw.sweeps.sweep(ROBUST, Path(folder) / f"{name}.zarr", lanes=count, client=it, progress=False)
            assert done.done == count

        def spent() -> float:
            processes = [own, *own.children(recursive=True)]
            return sum(sum(each.cpu_times()[:2]) for each in processes)

        swept(WARM * workers, "warm")
        for turn in range(-1, repetitions):  # the first turn is not counted
            for name, work in (("one process", alone), ("sweep", lambda turn=turn: swept(lanes, str(turn)))):
                wall, processors = time.perf_counter(), spent()
                work()
                seconds = time.perf_counter() - wall, spent() - processors
                print(f"{name}: {seconds[0]:.1f} s of the wall, {seconds[1]:.1f} s of processors", flush=True)
                if turn >= 0:
                    found[name].append(seconds)
    for k, what in enumerate(("wall", "processors")):
        shares = [b[k] / a[k] - 1.0 for a, b in zip(found["one process"], found["sweep"], strict=True)]
        spread = ", ".join(f"{100.0 * share:+.1f}" for share in shares)
        print(f"{what}: {100.0 * statistics.median(shares):+.1f} % (of each turn: {spread})")


def highest_memory() -> float:
    """Largest resident set of this process so far [MB]."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) / 1e3


def memory(lanes: int) -> None:
    """Prints the largest resident sets of a sweep."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "short.scenario.toml"
        file.write_text(SHORT, encoding="utf-8")
        with local_cluster() as cluster, connected(cluster.scheduler_address) as client:
            client.wait_for_workers(os.cpu_count() or 1, timeout=120)
            done = aw.sweeps.sweep(file, Path(folder) / "runs.zarr", lanes=lanes, client=client, progress=False)
            workers: dict[str, Any] = client.run(highest_memory)
        size = sum(each.stat().st_size for each in (Path(folder) / "runs.zarr").rglob("*") if each.is_file()) / 1e6
    each = ", ".join(f"{value:.0f}" for value in workers.values())
    print(
        f"{lanes:,} lanes in chunks of {done.chunk:,}: {done.seconds:.0f} s, {size:.0f} MB stored; "
        f"at most {highest_memory():.0f} MB here, {each} MB in the workers",
        flush=True,
    )


def main() -> None:
    """Measures what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kind", choices=("overhead", "memory"))
    parser.add_argument("--lanes", type=float, action="append")
    parser.add_argument("--repetitions", type=int, default=3)
    asked = parser.parse_args()
    logging.disable(logging.INFO)
    if asked.kind == "overhead":
        overhead(int((asked.lanes or [400_000])[0]), asked.repetitions)
        return
    counts = [int(each) for each in asked.lanes or [2e6, 1e7]]
    if len(counts) == 1:
        memory(counts[0])
        return
    for count in counts:  # the highest mark of a process never falls
        subprocess.run([sys.executable, __file__, "memory", "--lanes", str(count)], check=True)


if __name__ == "__main__":
    main()
