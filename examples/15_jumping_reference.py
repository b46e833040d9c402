"""A reference with arbitrary jumps, filtered to keep limits of speed, acceleration and jerk.

Run it:  python examples/15_jumping_reference.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import armwright as aw

(folder := Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")).mkdir(parents=True, exist_ok=True)
arm = aw.load("two-link")
rows = np.zeros((1500, 2))  # one for each tick of 1 ms
rows[50:, 0], rows[450:, 0], rows[600:, 0] = 0.4, -0.3, 0.2  # before the last move is over, and back
rows[900:, 0] += 0.3 * np.arange(600) * 1e-3  # it creeps away

law = aw.ComputedTorque(kp=900.0, kd=60.0)
held = aw.trajectories.ReferenceFilter(law, velocity=2.0, acceleration=15.0, jerk=300.0)
runs = {
    name: aw.simulate(aw.Scenario(arm, duration=1.499, loop=aw.Loop(controller, rows, 1e-3)))
    for name, controller in (("plain", law), ("filtered", held))
}  # fmt: skip
for name, run in runs.items():
    torque, speed = (np.abs(run[each].values[:, 0]).max() for each in ("tau", "qd"))
    print(f"{name:9} torque up to {torque:6.1f} N m, speed up to {speed:.2f} rad/s")

axes = (figure := Figure(figsize=(9.0, 5.0), layout="constrained")).subplots(3, 1, sharex=True)
axes[0].plot(runs["plain"].time, rows[:, 0], "k", lw=0.8, label="reference")
for name, run in runs.items():
    axes[0].plot(run.time, run.q.values[:, 0], label=name)
    axes[1].plot(run.time, run.qd.values[:, 0])
    axes[2].plot(run.time, run.tau.values[:, 0])
axes[0].legend()
axes[0].set(ylabel="q [rad]")
axes[1].set(ylabel="qd [rad/s]")
axes[2].set(ylabel="torque [N m]", xlabel="time [s]")
figure.savefig(folder / "jumping_reference.png", dpi=110)
