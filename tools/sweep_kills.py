"""A sweep that is killed: SIGKILL for workers, the scheduler and the client at random moments while it runs.

    python tools/sweep_kills.py --kills 20

A scheduler, four workers and `armwright sweep` run as processes of their own. The moments are drawn evenly over the work: when so
many lanes are there, and chunks have finished since the last kill, one of the processes is killed within the time of a chunk.
What is gone is started again, and the same command goes on; after the last kill it runs to its end. Then the store is compared,
bit for bit, with all lanes simulated in this process.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

import armwright as aw
from armwright.scenarios.file import parse_scenario
from armwright.scenarios.files import FolderFiles

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from sweeps.test_sweeps import SCENARIO

WORKERS = 4
STORE = "runs.zarr"
CHUNK = 1000  # lanes
LONGER = SCENARIO.replace("duration_s = 0.05", "duration_s = 1.0")  # 0.1 s of work for a chunk
WITHIN = 0.3  # [s] after a moment's chunk: some chunk is then being simulated, sent or stored
ROOM = 0.85  # of the work, in which all kills are, so that work is left for each of them
PATIENCE = 300.0  # [s] for the next chunk


class Cluster:
    """A scheduler and workers as processes; those that are gone are started again."""

    def __init__(self, folder: Path):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address, self.folder = f"tcp://127.0.0.1:{self.port}", folder
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self) -> None:
        """Starts what is not running; without a scheduler its workers are no use."""
        if not self._runs("scheduler"):
            self.stop()
            self._start("scheduler", "scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        for name in (f"worker {k}" for k in range(WORKERS)):
            if not self._runs(name):
                self._start(
                    name, "worker", self.address, "--nworkers", "1", "--nthreads", "1", "--no-nanny", "--no-dashboard"
                )

    def stop(self) -> None:
        """Kills everything."""
        for process in self.processes.values():
            process.kill()
            process.wait()
        self.processes.clear()

    def _runs(self, name: str) -> bool:
        return name in self.processes and self.processes[name].poll() is None

    def _start(self, name: str, *words: str) -> None:
        command = [sys.executable, "-m", "dask", *words]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": self.folder}
        self.processes[name] = subprocess.Popen(command, **quiet)  # type: ignore[call-overload]


def sweep(folder: Path, lanes: int, address: str) -> subprocess.Popen[str]:
    """The client, on its way."""
    words = [
        "sweep",
        "arm.scenario.toml",
        "--lanes",
        str(lanes),
        "--chunk",
        str(CHUNK),
        "-o",
        STORE,
        "--scheduler",
        address,
    ]
    return subprocess.Popen(
        [sys.executable, "-m", "armwright", *words],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def marked(folder: Path) -> int:
    """Chunks that are marked in the store."""
    marks = folder / STORE / "chunk_mark" / "c"
    return len(list(marks.iterdir())) if marks.is_dir() else 0


def await_chunks(folder: Path, count: int, client: subprocess.Popen[str]) -> None:
    """Waits until so many chunks are marked.

    Raises:
        TimeoutError: they do not come, or the client has ended.
    """
    end = time.monotonic() + PATIENCE
    while marked(folder) < count:
        if time.monotonic() > end or client.poll() is not None:
            raise TimeoutError(f"{marked(folder)} chunks, not {count}; client: {client.poll()}")
        time.sleep(0.01)


def killed_run(folder: Path, cluster: Cluster, lanes: int, draw: random.Random, kills: int) -> tuple[int, float]:
    """Exit code of the last client, and the time [s] in which chunks went on, of a sweep with kills at random moments."""
    total, killed, running = lanes // CHUNK, Counter[str](), 0.0
    moments = sorted(draw.sample(range(1, int(ROOM * total)), kills))
    cluster.start()
    client = sweep(folder, lanes, cluster.address)
    for moment in moments:
        before = marked(folder)
        await_chunks(folder, before + 1, client)
        began = time.monotonic()
        await_chunks(folder, max(before + 1, moment), client)
        time.sleep(draw.uniform(0.0, WITHIN))
        running += time.monotonic() - began
        victim = draw.choice(["client", "scheduler", "worker"])
        name = f"worker {draw.randrange(WORKERS)}"
        process = {"client": client, "scheduler": cluster.processes["scheduler"], "worker": cluster.processes[name]}[
            victim
        ]
        if client.poll() is not None:
            break  # done already
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        killed[victim] += 1
        print(f"killed: {victim} at {marked(folder)} of {total} chunks", flush=True)
        if victim == "scheduler":
            words = client.communicate(timeout=60)[1].strip()
            assert (client.returncode, len(words.splitlines())) == (2, 1), (client.returncode, words)
            assert "goes on from there" in words, words
        cluster.start()
        if client.poll() is not None:
            client = sweep(folder, lanes, cluster.address)
    began = time.monotonic()
    code = client.wait(600)
    print("killed: " + ", ".join(f"{count} times the {what}" for what, count in sorted(killed.items())))
    return code, running + time.monotonic() - began


def main() -> int:
    """Exit code 1 where a bit differs or a lane is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--lanes", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="armwright-kills-") as name:
        folder = Path(name)
        (folder / "arm.scenario.toml").write_text(LONGER)
        cluster = Cluster(folder)
        try:
            code, seconds = killed_run(folder, cluster, options.lanes, random.Random(options.seed), options.kills)
        finally:
            cluster.stop()
        stored = aw.sweeps.load_sweep(folder / STORE)
        parsed = parse_scenario(LONGER, "arm", FolderFiles(folder), range(options.lanes))
        run = aw.simulate(parsed)
        names = [each for each in stored.data_vars if "lane" in stored[each].dims and each != "finished"]
        wrong = [each for each in names if not np.array_equal(stored[each].values, run[each].values, equal_nan=True)]
        missing = int((~stored["finished"].values).sum())
        print(
            f"chunks went on for {seconds:.0f} s; exit code of the last client {code}, {missing} of {options.lanes} lanes missing"
        )
        print(f"results that differ from those of one process: {wrong} of {', '.join(map(str, names))}")
        return 1 if wrong or code or missing else 0


if __name__ == "__main__":
    sys.exit(main())
