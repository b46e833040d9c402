"""Exports controllers at random and compares their commands with the simulation's, to the bit.

    .venv/bin/python tools/random_controllers.py [--seconds 600] [--seed 0]

Loops are those of tests/export/random_loops.py: every controller of the library, wrapped in its other blocks, on five arms. Each
is simulated, exported, compiled and run on what it saw. Prints how many were compared, and of what; the first one whose bits
differ is made smaller by hypothesis and ends the run.
"""

from __future__ import annotations

import argparse
import collections
import sys
import tempfile
import time
from pathlib import Path

from hypothesis import HealthCheck, given, seed as seeded, settings

import armwright as aw
from armwright.export.controller.sil import find_compiler

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from export.random_loops import compared, loops  # noqa: E402

AT_ONCE = 25  # examples of one seed


def main() -> None:
    """Compares until the time is up."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--seconds", type=float, default=600.0)
    words.add_argument("--seed", type=int, default=0)
    asked = words.parse_args()
    if find_compiler() is None:
        sys.exit("needs a C compiler")
    counts: collections.Counter[str] = collections.Counter()
    ends, seed = time.monotonic() + asked.seconds, asked.seed

    @settings(max_examples=AT_ONCE, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(loops())
    def check(scenario: aw.Scenario) -> None:
        if time.monotonic() > ends:
            return
        with tempfile.TemporaryDirectory() as folder:
            comparison = compared(scenario, folder)
        if comparison is None:
            counts["diverged, not compared"] += 1
            return
        counts["controllers"] += 1
        counts["steps"] += comparison.ticks
        law = scenario.controller
        while law is not None:
            counts[f"  {getattr(law, '__name__', type(law).__name__)}"] += 1
            law = getattr(law, "inner", getattr(law, "controller", None))

    while time.monotonic() < ends:
        seeded(seed)(check)()
        seed += 1
    print("\n".join(f"{name:<28} {count}" for name, count in sorted(counts.items())))
    print(f"all commands have the bits of the simulation; seeds {asked.seed} to {seed - 1}")


if __name__ == "__main__":
    main()
