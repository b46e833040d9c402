"""A path at full speed, planned with motors in mind and by acceleration limits alone, each played without feedback."""

import dataclasses
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import armwright as aw

arm, period = aw.load("cmu-dd"), 1e-3
points = [0.0, 0.35, 0.0, 0.6, 0.0, 0.4], [0.7, 0.3, 0.5, 0.2, -0.6, 0.1], [1.6, -0.5, 0.6, 1.2, -0.8, -0.6]
path, limits = aw.trajectories.JointPath(points), aw.trajectories.MotionLimits.of(arm)
fast = aw.trajectories.time_optimal(arm, path)
most = np.abs(fast.at(np.linspace(0.0, fast.duration, 3000))[2]).max(axis=0)  # accelerations that it reaches
free = limits.replace(torque=np.inf, voltage=np.inf, acceleration=most)
scale = (aw.trajectories.time_optimal(arm, path, free).duration / fast.duration) ** 2  # time goes as 1/√acceleration
alone = slow = aw.trajectories.time_optimal(arm, path, free.replace(acceleration=scale * most))
while not aw.trajectories.limits_report(arm, slow).kept:
    slow = aw.trajectories.time_optimal(arm, path, free.replace(acceleration=(scale := 0.95 * scale) * most), grid=100)
print(f"with motors: {fast.duration:.3f} s, at a limit for {fast.saturated:.1%} of it")
print(f"by acceleration, as long: {aw.trajectories.limits_report(arm, alone).excesses()[-1]}")
print(f"by acceleration, such that the motors can do it: {slow.duration:.3f} s")
figure, axes = plt.subplots(2, 2, sharex=True, sharey="row", figsize=(10, 5.5), layout="constrained")
for column, (name, plan) in zip(axes.T, {"with motors": fast, "by acceleration": alone}.items(), strict=True):
    reference = dataclasses.replace(plan, time=-0.5 * period)  # each voltage is that of the middle of its tick
    voltages = lambda t, r, y: aw.motor_voltage(arm, r.qd, aw.inverse_dynamics(arm, r.q, r.qd, r.qdd))  # noqa: E731
    loop, duration = aw.Loop(voltages, reference, period), np.ceil(plan.duration / period) * period
    run = aw.simulate(aw.Scenario(arm, duration, start=path.waypoints[0], loop=loop))
    share, error = run.u.values / limits.voltage, 1e3 * (run.q.values - plan.at(run.time.values)[0])
    above = (np.abs(share) > 1.0 + 1e-6).any(axis=1).mean()
    print(f"{name}: {above:.1%} of ticks above a voltage limit, error {np.abs(error).max():.1f} mrad at most")
    for axis, rows, label in zip(column, (share, error), ("voltage, part of its limit", "error [mrad]"), strict=True):
        axis.plot(run.time, rows, label=arm.names)
        axis.set_title(f"{name}: {label}")
    column[1].set_xlabel("time [s]")
figure.legend(arm.names, loc="outside lower center", ncols=6)
(folder := Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")).mkdir(parents=True, exist_ok=True)
figure.savefig(folder / "time_optimal.png", dpi=110)
