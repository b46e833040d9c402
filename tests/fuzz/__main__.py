"""`make fuzz MINUTES=10`: does cases in worker processes, adds their outcomes to counts.json, and keeps failures as files."""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from pathlib import Path

from fuzz.attempt import OTHER
from fuzz.campaign import COUNTS, FAILURES, KINDS, Counts, campaign, replayed


def main() -> int:
    """Exit code 1 if anything failed."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument(
        "--cases", type=int, default=10**9, help="of each process, if they are done before the time is over"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=int(time.time()), help="by default another one each time")
    parser.add_argument("--kinds", default=",".join(KINDS), help="which kinds of inputs")
    parser.add_argument("--counts", type=Path, default=COUNTS, help="file that the counts are added to")
    parser.add_argument("--failures", type=Path, default=FAILURES, help="folder for the cases that failed")
    parser.add_argument("--anew", action="store_true", help="count from zero: after a failure was mended")
    parser.add_argument(
        "--replay", action="store_true", help="only do the cases again that are in the folder of failures"
    )
    options = parser.parse_args()
    if options.replay:
        return replay(options.failures)
    if options.anew:
        options.counts.unlink(missing_ok=True)
    counts, found = Counts(options.counts), 0
    for case, signature, detail in campaign(
        options.minutes, options.cases, options.processes, options.seed, tuple(options.kinds.split(",")), counts
    ):
        found += 1
        text = case.to_json()
        name = f"{case.kind}-{hashlib.sha256(text.encode()).hexdigest()[:8]}.json"
        options.failures.mkdir(exist_ok=True)
        (options.failures / name).write_text(text)
        print(f"--- {name}: {signature}\n{detail}", flush=True)
        counts.write()
    counts.write()
    print(f"{counts}; {found} failures in this run, seed {options.seed}")
    return 1 if found else 0


def replay(folder: Path) -> int:
    """Exit code 1 if a case fails that failed before."""
    failed = 0
    for name, outcome in replayed(folder):
        if outcome.what == OTHER:
            failed += 1
            print(f"--- {name}: {outcome.signature}\n{outcome.detail}")
    print(f"{failed} failures")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
