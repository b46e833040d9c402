"""Native calls in great number: right, wrong, foreign, read-only, huge, empty, subclassed and freed arrays, in threads.

    python tools/native_calls.py --calls 10_000_000

Every call is compared with what the general path gives, error or bits. Some calls are made while an exception is handled, in
finalisers, and with memory that is allocated by Python failing. At the end, reference counts, blocks of Python's allocator
and pages of the process are compared with those after the first tenth of the calls.
"""

from __future__ import annotations

import argparse
import gc
import random
import sys
import threading
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from kernels.native_cases import LEADS, general, odd_calls, outcome, states

KERNELS = ("inverse_dynamics", "mass_matrix", "inverse_dynamics_derivatives", "energy", "forward_kinematics")
ODD = 0.05  # share of the calls that do not fit


class Calls:
    """Cases with their expected outcomes, and threads that try them."""

    def __init__(self) -> None:
        self.dyn = aw.compile(aw.load("puma560"))
        rng = np.random.default_rng(0)
        self.usual: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self.odd: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        for name in KERNELS:
            for _ in range(3):
                getattr(self.dyn, name)(*states(self.dyn, name, (), rng))
            self.usual += [
                (name, tuple(states(self.dyn, name, lead, rng)), {}) for lead in LEADS if np.prod(lead) < 100
            ]
            self.odd += [(name, arrays, named) for _, arrays, named in odd_calls(self.dyn, name, rng)]
        self.expected = [outcome(general(self.dyn, name), *a, **n) for name, a, n in (*self.usual, *self.odd)]
        self.count: Counter[str] = Counter()
        self.wrong: list[str] = []

    def run(self, calls: int, threads: int, seed: int) -> None:
        """Makes so many calls, shared by threads."""
        workers = [
            threading.Thread(target=self._work, args=(calls // threads, random.Random(1000 * seed + k)))
            for k in range(threads)
        ]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()

    def _work(self, calls: int, chance: random.Random) -> None:
        done: Counter[str] = Counter()
        for _ in range(calls):
            kind = chance.random()
            if kind < ODD:
                k = len(self.usual) + chance.randrange(len(self.odd))
            else:
                k = chance.randrange(len(self.usual))
            if kind % 0.01 < 0.001:
                try:
                    raise LookupError(k)
                except LookupError:
                    self._try(k)
                done["while an exception is handled"] += 1
            elif kind % 0.01 < 0.002:
                _Last(self, k)
                done["in a finaliser"] += 1
            elif kind % 0.01 < 0.01 * 0.5:
                self._try(k, fresh=True)
                done["with arrays that are freed"] += 1
            else:
                self._try(k)
                done["with arrays that stay"] += 1
        self.count.update(done)

    def _try(self, k: int, fresh: bool = False) -> None:
        name, arrays, named = self._case(k)
        if fresh:
            arrays = tuple(
                a.copy() if type(a) is np.ndarray and a.size < 10_000 and a.dtype == float else a for a in arrays
            )
        if outcome(getattr(self.dyn, name), *arrays, **named) != self.expected[k]:
            self.wrong.append(f"case {k}: {name}")

    def _case(self, k: int) -> tuple[str, tuple[Any, ...], dict[str, Any]]:
        return self.usual[k] if k < len(self.usual) else self.odd[k - len(self.usual)]

    def without_memory(self) -> Counter[str]:
        """Outcomes of calls of which the n-th allocation of Python's fails, for n from 0."""
        try:
            from _testcapi import remove_mem_hooks, set_nomemory
        except ImportError:
            return Counter()
        found: Counter[str] = Counter()
        for name, arrays, named in self.usual:
            call = getattr(self.dyn, name)
            for n in range(12):
                result: Any = None
                set_nomemory(n, n + 1)
                try:
                    result = call(*arrays, **named)
                except MemoryError:
                    remove_mem_hooks()
                    found["MemoryError"] += 1
                else:
                    remove_mem_hooks()
                    found["a result"] += 1
                    if outcome(lambda result=result: result) != outcome(general(self.dyn, name), *arrays):
                        self.wrong.append(f"{name} where memory fails")
        return found

    def held(self) -> dict[str, int]:
        """Counts that must not grow: references, blocks, kilobytes of the process."""
        gc.collect()
        arrays = [a for _, case, _ in self.usual for a in case]
        references = sum(sys.getrefcount(a) for a in arrays)
        shared = {"ndarray": np.ndarray, "dtype": np.dtype(float), "arm": self.dyn}
        counts = {f"references of {name}": sys.getrefcount(value) for name, value in shared.items()}
        status = Path("/proc/self/status")
        resident = 0
        if status.exists():
            resident = next(int(line.split()[1]) for line in status.read_text().splitlines() if "VmRSS" in line)
        return {"references of arrays": references, **counts, "blocks": sys.getallocatedblocks(), "kB": resident}


class _Last:
    """Makes a call when it is freed."""

    def __init__(self, calls: Calls, k: int):
        self.calls, self.k = calls, k

    def __del__(self) -> None:
        self.calls._try(self.k)


def main() -> int:
    """Makes the calls that the command line asks for; 1 if one went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=1_000_000)
    parser.add_argument("--threads", type=int, default=4)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    calls, start = Calls(), time.monotonic()
    print(
        f"{sys.version.split()[0]}, NumPy {np.__version__}: {len(calls.usual)} usual and {len(calls.odd)} other cases"
    )
    calls.run(arguments.calls // 10, arguments.threads, 0)
    before = calls.held()
    calls.run(arguments.calls - arguments.calls // 10, arguments.threads, 1)
    after = calls.held()
    print(f"{calls.count.total()} calls in {time.monotonic() - start:.0f} s: {dict(calls.count)}")
    for name, value in after.items():
        print(f"{name}: {before[name]} after a tenth, {value} at the end")
    print(f"memory that fails: {dict(calls.without_memory())}")
    print(f"{len(calls.wrong)} calls gave something else than the general path", *calls.wrong[:10], sep="\n")
    return 1 if calls.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
