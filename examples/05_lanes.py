"""A thousand simulations at once: the spread of the motion if motor voltages are 5 % wrong and the switch is late.

Run it:  python examples/05_lanes.py [FOLDER]
"""

import sys
import time
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)

arm = aw.load("cmu-dd")
meant = aw.simulation.read_schedule(Path(__file__).with_name("cmu-dd-steps.csv"), arm.names)
random = np.random.default_rng(1982)


def disturbed():
    """The schedule with other voltages, and with every switch but the first up to 20 ms late."""
    late = np.concatenate([[0.0], random.uniform(0.0, 0.02, len(meant.times) - 1)])
    return aw.Schedule(meant.times + late, meant.commands * random.normal(1.0, 0.05, arm.n), arm.names)


scenario = aw.Scenario(
    arm, command=aw.Batch([disturbed() for _ in range(1000)]), duration=1.5, recording=aw.Recording(every=10)
)
start = time.perf_counter()
run = aw.simulate(scenario)
spent = time.perf_counter() - start
print(f"{run.sizes['lane']} lanes of {scenario.ticks} steps, compiled and run in {spent:.1f} s")

low, middle, high = run.q.isel(time=-1).quantile([0.05, 0.5, 0.95], dim="lane").values
for joint, a, b, c in zip(arm.names, low, middle, high, strict=True):
    print(f"  {joint}  q(1.5 s) = {b:7.3f} rad, nine of ten within [{a:7.3f}, {c:7.3f}]")
aw.plot(run, folder / "lanes.png")  # of many lanes: the median, and the bands of half and nine out of ten
