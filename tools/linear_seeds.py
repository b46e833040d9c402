"""Black-box fits over random systems: share of right delays and orders, and coverage of intervals.

    python tools/linear_seeds.py --family sampled --seeds 200

Systems are those of tests/identification/linear/random_systems.py, 2000 rows with white noise, by default 10 % of the output's
size. "discrete": coefficients of B between 0.3 and 1. "sampled": continuous systems behind a dead time, whose first
coefficient can be lost in the noise. Columns:

    right       the chosen delay is the true one
    in interval the true delay is one of `model.delays`; width: how many delays these are on average
    as good     RMS of the free simulation on a fresh log at most 1 % above that of a model with the true orders and delay
    both        in interval and as good
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import armwright as aw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from identification.linear.random_systems import Truth, random_truth, sampled_truth

FITS = {
    "arx": aw.identification.fit_arx,
    "oe": aw.identification.fit_oe,
    "armax": aw.identification.fit_armax,
    "n4sid": aw.identification.fit_n4sid,
}
FAMILIES = {"discrete": random_truth, "sampled": sampled_truth}
AS_GOOD = 1.01  # times the error of the model with the true orders
HEADS = ("right", "in interval", "width", "as good", "both", "order right", "gain in 95 %", "s a fit")


def main() -> None:
    """Prints one line for each kind of model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--family", choices=FAMILIES, default="discrete")
    parser.add_argument("--noise", type=float, default=0.1, help="share of the output's standard deviation")
    parser.add_argument("--models", nargs="+", choices=FITS, default=["oe"])
    parser.add_argument("--select", default="cv", choices=["cv", "aic", "bic", "fpe", "mdl"])
    options = parser.parse_args()
    print(f"{'model':8}{'select':8}" + "".join(f"{head:>14}" for head in HEADS))
    for name in options.models:
        rows = []
        for seed in range(options.first, options.first + options.seeds):
            truth = FAMILIES[options.family](seed, noise=options.noise)
            rows.append(measures(name, options.select, truth, options.noise))
        means = dict(zip(HEADS, np.mean(rows, axis=0), strict=True))
        texts = [f"{x:.2f}" if head in ("width", "s a fit") else f"{x:.1%}" for head, x in means.items()]
        print(f"{name:8}{options.select:8}" + "".join(f"{text:>14}" for text in texts), flush=True)


def measures(name: str, select: str, truth: Truth, noise: float) -> list[float]:
    """Numbers of the columns for one system."""
    begin = time.perf_counter()
    model = FITS[name](truth.u, truth.y, 1.0, search=aw.identification.OrderSearch(select))
    seconds = time.perf_counter() - begin
    oracle = aw.identification.fit_oe(
        truth.u, truth.y, 1.0, order=(truth.order, len(truth.b) - truth.delay), delay=truth.delay
    )
    low, high = model.delays or (model.delay, model.delay)
    inside, gain = low <= truth.delay <= high, truth.b.sum() / truth.a.sum()
    good = fresh_error(model, truth, noise) <= AS_GOOD * fresh_error(oracle, truth, noise)
    covered = abs(model.gain[0, 0] - gain) < 1.96 * model.gain_std[0, 0]
    right = (model.delay == truth.delay, model.order == truth.order)
    return [right[0], inside, high - low + 1, good, inside and good, right[1], covered, seconds]


def fresh_error(model: aw.identification.LinearModel, truth: Truth, noise: float) -> float:
    """Expected RMS of the free simulation on a fresh log: the input backwards, noise of the same size."""
    u = truth.u[::-1]
    y = lfilter(truth.b, truth.a, u) + 5.0
    return float(np.sqrt(np.mean((model.simulate(u, y) - y) ** 2) + (noise * y.std()) ** 2))


if __name__ == "__main__":
    main()
