"""A line of `puma560` past a singular wrist: slower everywhere, and slower only where a joint asks for it.

Run it:  python examples/17_slow_where_needed.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import armwright as aw

arm = aw.load("puma560")
middle = aw.forward_kinematics(arm, np.array([0.2, -0.8, 0.4, 0.3, 0.0, 0.2]))  # two axes of the wrist on one line
begin, end = middle.copy(), middle.copy()
begin[:3, 3] += [0.0, -0.15, 0.01]  # the line passes it at 1 cm
end[:3, 3] += [0.0, 0.15, 0.01]
path = aw.trajectories.CartesianPath([aw.trajectories.Line(end)], begin)
limits = aw.trajectories.MotionLimits.of(arm, velocity=2.0, acceleration=40.0)
ways = ("everywhere", "where needed")
motions = {way: aw.trajectories.follow_path(arm, path, 0.1, 2.0, limits=limits, slow=way) for way in ways}
for slow, motion in motions.items():
    print(f"slower {slow}: {motion.duration:.2f} s")
print(motion.stretches[0])

axes = (figure := Figure(figsize=(10.0, 3.4), layout="constrained")).subplots(1, 3)
for slow, motion in motions.items():
    t = np.linspace(0.0, motion.duration, 2000)
    s, speed = (each[:, 0] for each in motion.profile.at(t)[:2])
    axes[0].plot(t, speed, label=f"slower {slow}")
    axes[1].plot(s, speed)
    axes[2].plot(s, np.abs(motion.at(t)[1] / limits.velocity).max(axis=1))
axes[0].set(xlabel="time [s]", ylabel="tool [m/s]")
axes[1].set(xlabel="way [m]", ylabel="tool [m/s]")
axes[2].set(xlabel="way [m]", ylabel="fastest joint, part of its limit")
figure.legend(loc="outside upper center", ncols=2)
(folder := Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")).mkdir(parents=True, exist_ok=True)
figure.savefig(folder / "slowed_path.png", dpi=110)
