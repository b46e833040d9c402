"""A welding seam of `puma560` on a wall: lines and an arc at an even speed, corners rounded, the torch tilted on the way.

Run it:  python examples/14_weld_seam.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import armwright as aw

(folder := Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")).mkdir(parents=True, exist_ok=True)
arm = aw.load("puma560")
wall = np.array([[0.0, 0.0, 1.0, 0.5], [0.0, 1.0, 0.0, -0.25], [-1.0, 0.0, 0.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
c, s = np.cos(0.3), np.sin(0.3)  # the torch's tilt at the lower end of the first line
tilted = np.array([[0.0, -s, c, 0.5], [0.0, c, s, -0.25], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
line, arc = aw.trajectories.Line, aw.trajectories.Arc([0.5, 0.1, 0.1], [0.5, 0.2, 0.0])
segments = [line(tilted), line([0.5, 0.0, 0.0]), arc, line([0.5, 0.2, 0.3])]
seam = aw.trajectories.CartesianPath(segments, wall, blend=0.02, blend_angle=0.1)
limits = aw.trajectories.MotionLimits.of(arm, velocity=2.0)
motion = aw.trajectories.follow_path(arm, seam, speed=0.2, acceleration=2.0, limits=limits)

t = np.linspace(0.0, motion.duration, 3000)
q, qd, _ = motion.at(t)
speed = np.linalg.norm(np.einsum("kij,kj->ki", aw.compile(arm).jacobian(q), qd)[:, :3], axis=1)
(x, y, z), (off, angle) = aw.compile(arm).forward_kinematics(q)[:, :3, 3].T, motion.solution.deviation
print(f"{seam.length:.3f} m in {motion.duration:.2f} s, {motion.slowed:.2f} times slower than requested")
print(f"off the path by less than {np.ceil(1e6 * off):.0f} µm and {np.ceil(1e6 * angle):.0f} µrad")

axes = (figure := Figure(figsize=(11.0, 3.2), layout="constrained")).subplots(1, 3)
dots = axes[0].scatter(y, z, c=speed, s=4, vmin=0.0)
figure.colorbar(dots, ax=axes[0], label="torch [m/s]", location="bottom", shrink=0.8)
axes[0].set(xlabel="y [m]", ylabel="z [m]", aspect="equal")
for each, values, label in zip(axes[1:], (speed, qd), ("torch [m/s]", "joints [rad/s]"), strict=True):
    each.plot(t, values, label=arm.names if values is qd else None)
    each.set(xlabel="time [s]", ylabel=label)
axes[2].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
figure.savefig(folder / "weld_seam.png", dpi=110)
