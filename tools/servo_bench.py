"""Fits of all servos of the benches to simulated logs: held-out errors by those of the true numbers, coverage, CPU.

PYTHONPATH=src:tests python tools/servo_bench.py [--seed 0] [NAME …]
"""

from __future__ import annotations

import argparse

from identification.servo.bench_truth import BENCHES, bench_logs
from identification.servo.test_bench_study import fitted


def main() -> None:
    """Prints a row for each servo."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of the logs")
    parser.add_argument("names", nargs="*", default=tuple(BENCHES), help=", ".join(BENCHES))
    given = parser.parse_args()
    names, inside = tuple(given.names), []
    for name, logs in bench_logs(seed=given.seed, names=names).items():
        fit, ours, theirs, covered, spent = fitted(name, *logs)
        inside += covered
        print(
            f"{name:12} {fit.order}  {ours:.3g} rad, {ours / theirs:.3f} of the true numbers'  "
            f"{sum(covered)}/{len(covered)} within  {spent:.0f} s of CPU",
            flush=True,
        )
    print(f"{sum(inside)} of {len(inside)} true numbers within their 95 % intervals")


if __name__ == "__main__":
    main()
