"""The law of accuracy over random scenarios: errors of default runs, a histogram, and those that break the law.

    python tools/accuracy_law.py                       # seeds 0 to 199
    python tools/accuracy_law.py --seeds 17,40-45      # these
    python tools/accuracy_law.py --kind sticking       # kinds with this word in them

Scenarios and truth are those of tests/simulation/random_scenarios.py. Errors are in parts of the accuracy that is asked. A row of
the CSV text is a bin of them, a column a kind of scenarios. Exit code 1 where an error is above the accuracy and the run does not
say so.
"""

from __future__ import annotations

import argparse
import collections
import itertools
import sys
import time
from pathlib import Path

import numpy as np

import armwright as aw
from armwright.errors import ArmwrightError

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from simulation.random_scenarios import Case, NoSuchArm, Verdict, case, judged

BINS = (-np.inf, -3.0, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, np.inf)  # log10 of error by accuracy
KINDS = [f"{loop}, {rough}" for loop in ("open loop", "sampled") for rough in ("smooth", "contacts", "sticking")]


def line(case: Case, verdict: Verdict, seconds: float) -> str:
    """One scenario in a row."""
    estimate = "-" if verdict.estimate is None else f"{verdict.estimate:.3g}"
    word = "kept" if verdict.error <= 1.0 else "says so" if verdict.kept else "BROKEN"
    doubt = f" truth unsure by {verdict.doubt:.1g}" if verdict.doubt > 0.1 * verdict.error else ""
    stalled = " stalled" if verdict.stalled else ""
    return (
        f"{case.seed:4d} {word:7s} error {verdict.error:9.3g} estimate {estimate:>7s} {verdict.rule:7s} {seconds:5.1f} s  "
        f"{case.kind:19s} {case.name} n={case.scenario.arm.n} T={case.scenario.duration:g} "
        f"[{', '.join(sorted(case.features))}]{stalled}{doubt}"
    )


def histogram(found: list[tuple[Case, Verdict]]) -> str:
    """Numbers of scenarios by error and kind, as CSV."""
    rows = [["log10(error / accuracy)", *KINDS]]
    errors = collections.defaultdict(list)
    for each, verdict in found:
        errors[each.kind].append(np.log10(verdict.error) if verdict.error > 0.0 else -np.inf)
    for low, high in itertools.pairwise(BINS):
        counts = [sum(low <= error < high for error in errors[kind]) for kind in KINDS]
        ends = [f"{end:g}" if np.isfinite(end) else "" for end in (low, high)]
        rows.append([f"{ends[0]} to {ends[1]}".strip(), *map(str, counts)])
    rows[-1][-1] = str(int(rows[-1][-1]) + sum(error == np.inf for error in errors[KINDS[-1]]))
    return "\n".join(",".join(f'"{cell}"' if "," in cell else cell for cell in row) for row in rows)


def main() -> int:
    """Walks the seeds and prints what they show."""
    parser = argparse.ArgumentParser(description="Errors of default runs beside event-exact motion.")
    parser.add_argument("--seeds", default="0-199", help="a seed, seeds with commas, or ranges as 0-199")
    parser.add_argument("--accuracy", type=float, help="instead of the default")
    parser.add_argument("--integrator", default="auto")
    parser.add_argument("--kind", default="", help="only kinds with this word in them")
    options = parser.parse_args()
    solver = aw.Solver(options.integrator, accuracy=options.accuracy)
    found, begin = [], time.perf_counter()
    for seed in seeds(options.seeds):
        try:
            each = case(seed)
            if options.kind not in each.kind:
                continue
            start = time.perf_counter()
            verdict = judged(each, solver)
        except (NoSuchArm, ArmwrightError) as error:
            print(f"{seed:4d} skipped: {error}")
            continue
        except AssertionError as error:
            print(f"{seed:4d} no truth: {error}", each.kind, each.name, sorted(each.features), flush=True)
            continue
        found.append((each, verdict))
        print(line(each, verdict, time.perf_counter() - start), flush=True)
    broken = sorted((pair for pair in found if not pair[1].kept), key=lambda pair: -pair[1].error)
    print(f"\n{histogram(found)}\n\n{len(broken)} of {len(found)} break the law")
    for kind in KINDS:
        for each, verdict in (pair for pair in broken if pair[0].kind == kind):
            print(line(each, verdict, 0.0))
    print(f"{time.perf_counter() - begin:.0f} s")
    return 1 if broken else 0


def seeds(text: str) -> list[int]:
    """Numbers of "17", "1,2" and "0-9"."""
    ends = [part.split("-") for part in text.split(",")]
    return [k for part in ends for k in range(int(part[0]), int(part[-1]) + 1)]


if __name__ == "__main__":
    sys.exit(main())
