"""Largest excess over any limit of thousands of random motions, between the grid points that they were planned on.

    python tools/motion_seeds.py time-optimal --seeds 2000
    python tools/motion_seeds.py tool --seeds 2000

`time-optimal`: eight arms with friction, lossy gears and springs, paths through two to six random poses, random limits of torque
and, of some, of velocity, acceleration and voltage. `tool`: three arms, two lines with random poses and a rounded corner, random
limits of velocity, acceleration and jerk; every other path slowed where needed alone. Each motion is looked at ten times between
any two of its breaks and at as many random times, through `motion.at` and the compiled kernels. Refused motions are counted
by the reason. Exit code 1 where a limit is exceeded by more than 1e-6 of it.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections import Counter
from pathlib import Path

import armwright as aw
from armwright.errors import ScenarioError

ROOT = Path(__file__).parents[1]
ALLOWED = 1e-6  # of a limit
SHOWN = 60  # characters of a reason


def time_optimal(seed: int, grid: int) -> tuple[float, float]:
    """Largest use of a limit and duration [s] of a random time-optimal motion."""
    from trajectory.path_problems import largest_use, random_problem

    arm, path, limits = random_problem(seed)
    motion = aw.trajectories.time_optimal(arm, path, limits, grid=grid)
    return largest_use(arm, motion, limits), motion.duration


def tool(seed: int, _grid: int) -> tuple[float, float]:
    """Largest use of a limit and duration [s] of a random motion of the tool."""
    from trajectory.path_problems import largest_use, random_tool_motion

    arm, motion, limits = random_tool_motion(seed)
    return largest_use(arm, motion, limits, 40), motion.duration


def main() -> int:
    """Plans, judges and prints."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kind", choices=("time-optimal", "tool"))
    parser.add_argument("--seeds", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--grid", type=int, default=100)
    arguments = parser.parse_args()
    sys.path.insert(0, str(ROOT / "tests"))
    problem = {"time-optimal": time_optimal, "tool": tool}[arguments.kind]
    refused: Counter[str] = Counter()
    worst, planned, seconds = (-1.0, -1), 0, 0.0
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        begin = time.process_time()
        try:
            use, _ = problem(seed, arguments.grid)
        except ScenarioError as error:
            refused[re.sub(r"-?\d[\d.e+-]*|'\w+'", "…", error.what)[:SHOWN]] += 1
            continue
        finally:
            seconds += time.process_time() - begin
        planned += 1
        worst = max(worst, (use - 1.0, seed))
        if use > 1.0 + ALLOWED:
            print(f"seed {seed}: {use - 1.0:.3g} of a limit", flush=True)
    print(f"{planned} motions, {seconds / max(arguments.seeds, 1):.2f} s of a processor each")
    print(f"largest use of a limit: 1 {worst[0]:+.2g}, seed {worst[1]}")
    print("\n".join(f"refused {count}: {reason}" for reason, count in refused.most_common()))
    return int(worst[0] > ALLOWED)


if __name__ == "__main__":
    sys.exit(main())
