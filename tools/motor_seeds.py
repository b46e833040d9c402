"""Coverage of `identify_motor`'s intervals on logs of a simulator that is not ours (`tests/identification/motor_simulator.py`).

    python tools/motor_seeds.py [SEEDS [CASE …]]

For every case and parameter: share of seeds whose 95 % interval holds the truth, and RMS of the errors in stated deviations.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import armwright as aw

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from identification.motor_simulator import CASES, PATHS, deviations, write_log

INSIDE = 1.959964


def main(seeds: int, cases: list[str]) -> None:
    """Fits the logs of all seeds with all defaults, and prints a row of the table for every case."""
    print(
        f"{seeds} seeds: coverage, rms z\n| {'':14} | " + " | ".join(f"{name:>9}" for name in PATHS) + " |", flush=True
    )
    for case in cases or CASES:
        motor, bench = CASES[case]
        rows = []
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(seeds):
                log = write_log(Path(folder), motor, bench, seed)
                estimate = aw.identification.identify_motor(log, progress=False).estimate
                rows.append([deviations(estimate, motor, bench)[name] for name in PATHS])
        cells = []
        for column in np.array(rows).T:
            z = column[np.isfinite(column)]
            share, size = np.mean(np.abs(z) < INSIDE), np.sqrt(np.mean(z**2))
            cells.append(f"{share:4.2f} {size:4.2f}" if len(z) else "     none")
        print(f"| {case:14} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, sys.argv[2:])
