"""Black-box fits over random systems: share of right delays and orders, and coverage of intervals.

    python tools/linear_seeds.py --seeds 200

Systems are those of tests/identification/linear/random_systems.py: noise 10 % of the output's size, 2000 rows.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import armwright as aw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from identification.linear.random_systems import random_truth

FITS = {"arx": aw.fit_arx, "oe": aw.fit_oe, "armax": aw.fit_armax, "n4sid": aw.fit_n4sid}


def main() -> None:
    """Prints one line for each kind of model."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--models", nargs="+", choices=FITS, default=["oe"])
    parser.add_argument("--select", default="cv", choices=["cv", "aic", "bic", "fpe", "mdl"])
    options = parser.parse_args()
    print(f"{'model':8}{'select':8}{'delay right':>12}{'order right':>12}{'gain in 95 %':>14}{'s a fit':>9}")
    for name in options.models:
        delays, orders, covered, begin = [], [], [], time.perf_counter()
        for seed in range(options.seeds):
            truth = random_truth(seed)
            model = FITS[name](truth.u, truth.y, 1.0, select=options.select)
            delays.append(model.delay == truth.delay)
            orders.append(model.order == truth.order)
            gain = truth.b.sum() / truth.a.sum()
            covered.append(abs(model.gain[0, 0] - gain) < 1.96 * model.gain_std[0, 0])
        seconds = (time.perf_counter() - begin) / options.seeds
        shares = [f"{np.mean(each):.1%}" for each in (delays, orders, covered)]
        print(f"{name:8}{options.select:8}{shares[0]:>12}{shares[1]:>12}{shares[2]:>14}{seconds:9.2f}", flush=True)


if __name__ == "__main__":
    main()
