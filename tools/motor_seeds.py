"""How well `identify_motor` finds a known motor: many seeds with 1 % noise, converters of 12 bit and 2.3 samples of delay.

    python tools/motor_seeds.py [SEEDS [SECONDS]]

Prints, for every parameter, the share of seeds within 2 %, the coverage of the 95 % interval, bias and spread in standard
deviations, and the largest error of the delay.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import armwright as aw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from identification.motor_truth import DELAY, PATHS, PERIOD, TRUE, write_log


def main(seeds: int, most_seconds: float) -> None:
    """Fits the logs of as many seeds as there is time for, and prints the table."""
    errors: dict[str, list[float]] = {name: [] for name in (*TRUE, "delay")}
    scaled: dict[str, list[float]] = {name: [] for name in errors}
    done, begin = 0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(seeds):
            if time.monotonic() - begin > most_seconds:
                break
            done += 1
            estimate = aw.identification.identify_motor(
                write_log(Path(folder), seed), search=aw.identification.MotorSearch(starts=4)
            ).estimate
            for name in errors:
                path, truth = ("delay_s", DELAY * PERIOD) if name == "delay" else (PATHS[name], TRUE[name])
                std = estimate.std[estimate.number(path)]
                errors[name].append((estimate[path] - truth) / (PERIOD if name == "delay" else truth))
                scaled[name].append((estimate[path] - truth) / std)
    print(f"{done} seeds\n{'':12}{'within 2 %':>12}{'covered':>10}{'bias/std':>10}{'spread/std':>12}{'largest':>10}")
    for name, values in errors.items():
        own, z = np.array(values), np.array(scaled[name])
        within = "" if name == "delay" else f"{np.mean(np.abs(own) < 0.02):.1%}"
        unit = " samples" if name == "delay" else ""
        print(
            f"{name:12}{within:>12}{np.mean(np.abs(z) < 1.959964):>10.1%}{z.mean():>10.2f}{z.std():>12.2f}"
            f"{np.abs(own).max():>10.2g}{unit}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, float(sys.argv[2]) if len(sys.argv) > 2 else np.inf)
