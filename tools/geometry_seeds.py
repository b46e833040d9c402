"""Coverage of the intervals of `aw.calibrate` over many seeds, for known mistakes of an arm's geometry.

    OPENBLAS_NUM_THREADS=1 python tools/geometry_seeds.py [SEEDS [SECONDS]]

TX40 (frames) and PUMA 560 (rows) with mistakes of 1 mm and 1 mrad at every place, measured by a tracker. Prints, for every case,
the coverage of 95 % intervals of all corrections, rms z, rms errors of poses held out with the record and calibrated [mm], poses
that were called outliers, and further terms that were found, both by calibration.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from identification.geometry.measured_arm import measured, nominal, true_values, truth

CASES: dict[str, dict[str, Any]] = {
    "40 poses, 0.1 mm": {},
    "40 poses, 1 mm": {"noise": 1e-3},
    "15 poses, 0.1 mm": {"poses": 15},
    "40 poses, markers move together": {"noise": 3e-5, "common": 1e-4},
    "40 poses, one marker": {"markers": 1},
    "40 poses, 4 wrong": {"wrong": 4},
    "40 poses, a zero wrong by 0.3 rad": {"zero": 0.3},
    "40 poses, an eccentric gear, 1 mrad": {"eccentricity": {1: 1e-3}},
}
ZEROS = {"frame": "joint3 zero", "row": "elbow zero"}


def main(seeds: int, most_seconds: float) -> None:
    """Calibrates as many arms as there is time for, and prints the table."""
    print(f"{'':42}{'seeds':>6}{'covered':>9}{'rms z':>7}{'record':>8}{'held out':>10}{'outliers':>10}{'terms':>7}")
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("frame", "row"):
            arm = nominal(kind, Path(folder))
            for words, options in CASES.items():
                _case(f"{kind}, {words}", kind, arm, seeds, most_seconds / (2 * len(CASES)), dict(options))


def _case(words: str, kind: str, arm: aw.Model, seeds: int, seconds: float, options: dict[str, Any]) -> None:
    """A row of the table."""
    scaled: list[float] = []
    errors, outliers, terms, done, begin = [], 0, 0, 0, time.monotonic()
    zero, gears = (options.pop(name, default) for name, default in (("zero", 0.0), ("eccentricity", {})))
    for seed in range(seeds):
        if time.monotonic() - begin > seconds:
            break
        real, done = truth(kind, seed, eccentricity=gears), done + 1
        if zero:
            real.mistakes[ZEROS[kind]] = zero
        found = aw.calibrate(measured(real, seed, **options), arm)
        scaled += [(value - true) / std for value, true, std in true_values(found, real).values()]
        errors.append((found.errors[0].record, found.errors[0].calibrated))
        outliers += len(found.fit.outliers)
        terms += sum(each.found for each in found.tried_terms)
    z, (record, held) = np.array(scaled), 1e3 * np.mean(errors, axis=0)
    print(
        f"{words:42}{done:>6}{np.mean(np.abs(z) < 1.959964):>9.3f}{np.sqrt(np.mean(z**2)):>7.2f}"
        f"{record:>8.3g}{held:>10.3g}{outliers / done:>10.2g}{terms / done:>7.2g}",
        flush=True,
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40, float(sys.argv[2]) if len(sys.argv) > 2 else np.inf)
