"""Campaign: workers that do cases within limits of memory and time, counts of the outcomes, and failures as files."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import queue
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import psutil

from fuzz import buses
from fuzz.attempt import LIMIT, OTHER, Guard, Outcome, attempt
from fuzz.buses import BUSES_AND_SHEETS
from fuzz.calls import CALLS
from fuzz.case import Case
from fuzz.commands import COMMAND, run_command
from fuzz.files import FILES
from fuzz.logs import LOGS

KINDS = {**FILES, **LOGS, **CALLS, **BUSES_AND_SHEETS, **COMMAND}
MEMORY = 4 << 30  # bytes of address space of a worker
MOST_CASES = 50_000  # of a worker before another takes its place, so that caches and leaks stay small
# s of the processor's time without a word, in C that no signal interrupts: a worker is then killed
PATIENCE = LIMIT + 20
LONGEST = 600.0  # s of the clock, likewise: of a worker that waits for ever
COUNTS = Path(__file__).parent / "counts.json"
FAILURES = Path(__file__).parents[1] / "regressions"
SHRINKS = 150  # attempts to make a failure smaller


def case_of(seed: int, worker: int, index: int, kinds: tuple[str, ...]) -> Case:
    """The case with that number; the same every time."""
    rng = Random(f"{seed} {worker} {index}")
    kind = rng.choices(kinds, [KINDS[name][0] for name in kinds])[0]
    return KINDS[kind][1](rng)


def done(case: Case, guard: Guard) -> Outcome:
    """Outcome of a case of any kind."""
    if case.kind in COMMAND:
        return attempt(case, lambda one: run_command(one, guard), guard)
    return attempt(case, KINDS[case.kind][2], guard)


def smaller(case: Case, guard: Guard, signature: str) -> Case:
    """The case with lines of its files left out, as long as it fails in the same way."""
    end = time.monotonic() + 3 * LIMIT
    tries = 0
    for name in case.files:
        size = max(1, case.files[name].count(b"\n") // 2)
        while size and tries < SHRINKS and time.monotonic() < end:
            lines, k, shrunk = case.files[name].split(b"\n"), 0, False
            while k < len(lines) and tries < SHRINKS and time.monotonic() < end:
                tries += 1
                without = b"\n".join(lines[:k] + lines[k + size :])
                less = Case(case.kind, {**case.files, name: without}, case.call)
                if done(less, guard).signature == signature:
                    case, lines, shrunk = less, lines[:k] + lines[k + size :], True
                else:
                    k += size
            size = size // 2 if not shrunk else min(size, max(1, len(lines) // 2))
            if not shrunk and size == 0:
                break
    return case


def prepare() -> None:
    """Imports what the cases need, before the limits hold and files are watched."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot
    import mujoco  # noqa: F401 - which looks about the machine once

    from public_names import PUBLIC

    assert PUBLIC  # each imported
    rng = Random(0)
    for kind in ("urdf", "mjcf", "mesh", "run", "mcap", "parquet", "zarr"):
        KINDS[kind][1](rng)
    buses.prepare()


def replayed(folder: Path) -> Iterator[tuple[str, Outcome]]:
    """Outcomes of the cases that once failed, by the names of their files; in this process, which is changed by it."""
    with tempfile.TemporaryDirectory(prefix="armwright-fuzz-") as outside:
        prepare()
        guard = Guard(Path(outside))
        for file in sorted(folder.resolve().glob("*.json")):
            yield file.name, done(Case.from_json(file.read_text(encoding="utf-8")), guard)
        os.chdir("/")


def work(
    seed: int, worker: int, first: int, last: int, end: float, kinds: tuple[str, ...], beat: Any, results: Any
) -> None:
    """Does cases `first` to `last`, or until `end` (of the wall clock); reports counts now and then, and failures at once."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    outside = Path(tempfile.mkdtemp(prefix="armwright-fuzz-"))
    try:
        prepare()
        guard = Guard(outside)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        counts: dict[str, dict[str, int]] = {}
        known: set[str] = set()
        reported = time.time()
        for index in range(first, min(last, first + MOST_CASES)):
            beat[0], beat[1], beat[2] = index, time.time(), time.process_time()
            case = case_of(seed, worker, index, kinds)
            outcome = done(case, guard)
            if outcome.signature.startswith("hang"):  # a machine that was stopped meanwhile counts its time too
                outcome = done(case, guard)
            of_kind = counts.setdefault(case.kind, {})
            of_kind[outcome.what] = of_kind.get(outcome.what, 0) + 1
            if outcome.what == OTHER and outcome.signature not in known:
                known.add(outcome.signature)
                results.put(
                    ("failure", smaller(case, guard, outcome.signature).to_json(), outcome.signature, outcome.detail)
                )
            is_last = time.time() > end or index + 1 == min(last, first + MOST_CASES)
            if time.time() > reported + 2 or is_last:
                whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)  # of the largest child: one command
                results.put(("counts", counts, max(resource.getrusage(who).ru_maxrss for who in whose) >> 10))
                counts, reported = {}, time.time()
            if is_last:
                return
    finally:
        os.chdir("/")
        shutil.rmtree(outside, ignore_errors=True)


class Counts:
    """Counts of outcomes by kind, of all campaigns together."""

    def __init__(self, file: Path):
        self.file = file
        self.data: dict[str, Any] = (
            json.loads(file.read_text()) if file.exists() else {"kinds": {}, "peak_mib": 0, "minutes": 0}
        )

    def add(self, counts: dict[str, dict[str, int]], peak: int) -> None:
        """Adds the counts of a worker, and its peak memory [MiB]."""
        for kind, outcomes in counts.items():
            row = self.data["kinds"].setdefault(kind, {"accepted": 0, "refused": 0, "other": 0})
            for what, count in outcomes.items():
                row[what] += count
        self.data["peak_mib"] = max(self.data["peak_mib"], peak)

    def write(self) -> None:
        """Writes them, kinds in alphabetical order."""
        self.data["kinds"] = dict(sorted(self.data["kinds"].items()))
        self.file.write_text(json.dumps(self.data, indent=1) + "\n")

    def __str__(self) -> str:
        rows = [f"{'kind':20}{'accepted':>10}{'refused':>10}{'other':>10}"]
        rows += [
            f"{kind:20}{row['accepted']:10}{row['refused']:10}{row['other']:10}"
            for kind, row in self.data["kinds"].items()
        ]
        total = sum(sum(row.values()) for row in self.data["kinds"].values())
        return "\n".join([*rows, f"{total} inputs, at most {self.data['peak_mib']} MiB a process"])


class Worker:
    """A process that does cases, watched from here."""

    def __init__(self, seed: int, number: int, first: int, *settings: Any):
        """Starts it; `settings` are those of `work` behind `first`."""
        context = multiprocessing.get_context("spawn")
        self.seed, self.number, self.settings = seed, number, settings
        self.beat = context.Array("d", [first - 1, time.time() + 60, 60.0])  # a minute to start
        last, end, kinds, results = settings
        self.last, self.end = last, end
        arguments = (seed, number, first, last, end, kinds, self.beat, results)
        self.process = context.Process(target=work, args=arguments, daemon=False)
        self.process.start()

    @property
    def _spent(self) -> float:
        """[s] of the processor's time that the worker has had; 0 if it has just ended."""
        with contextlib.suppress(psutil.Error):
            times = psutil.Process(self.process.pid).cpu_times()
            return times.user + times.system
        return 0.0

    def successor(self) -> tuple[Worker | None, str]:
        """Another worker in its place if it ended or hangs, and what was wrong; None after the end."""
        index, code = int(self.beat[0]), self.process.exitcode
        what = ""
        if code is None:
            spent, since = self._spent - self.beat[2], time.time() - self.beat[1]
            if spent < PATIENCE and since < LONGEST:
                return self, ""
            self.process.kill()
            self.process.join()
            what = f"hang: no end after {spent:.0f} s of the processor's time and {since:.0f} s, killed"
        elif code != 0:
            what = f"crash: the process ended with {code}"
        if time.time() > self.end or index + 1 >= self.last:
            return None, what
        return Worker(self.seed, self.number, index + 1, *self.settings), what


def campaign(
    minutes: float, cases: int, processes: int, seed: int, kinds: tuple[str, ...], counts: Counts
) -> Iterator[tuple[Case, str, str]]:
    """Failures as they are found: the case, its signature, and what happened; counts are added up meanwhile."""
    results: Any = multiprocessing.get_context("spawn").Queue()
    start = time.time()
    end = start + 60 * minutes
    workers = [Worker(seed, number, 0, cases, end, kinds, results) for number in range(processes)]
    known: set[str] = set()
    while workers or not results.empty():
        try:
            what, *rest = results.get(timeout=0.5)
        except queue.Empty:
            what, rest = "", []
        if what == "counts":
            counts.add(rest[0], rest[1])
        elif what == "failure" and rest[1] not in known:
            known.add(rest[1])
            yield Case.from_json(rest[0]), rest[1], rest[2]
        for worker in list(workers):
            after, wrong = worker.successor()
            if wrong:
                case = case_of(seed, worker.number, int(worker.beat[0]), kinds)
                counts.add({case.kind: {OTHER: 1}}, 0)
                yield case, wrong, wrong
            workers.remove(worker)
            if after is not None:
                workers.append(after)
    counts.data["minutes"] = round(counts.data["minutes"] + (time.time() - start) * processes / 60, 1)
