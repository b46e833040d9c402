"""The report's use of the inverse arm: voltages along a planned motion, fed forward and held by the DAC.

Writes the schedule that `make demo` plays, and shows how far the arm ends from the plan.
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)
arm = aw.load("cmu-dd")
dyn = aw.compile(arm)

start = np.array([0.0, 0.35, 0.0, 0.6, 0.0, 0.4])  # [rad]
goal = np.array([1.2, -0.5, 0.6, 1.2, -0.8, -0.6])
length, hold = 1.6, 0.02  # [s] of the motion, and of one voltage of the DAC

rows = np.arange(0.0, 2.0, hold)
t = rows + hold / 2  # each voltage is that of the middle of its period
s = np.minimum(t / length, 1.0)  # a quintic: speed and acceleration 0 at both ends
path = 10 * s**3 - 15 * s**4 + 6 * s**5
speed = (30 * s**2 - 60 * s**3 + 30 * s**4) / length
acceleration = (60 * s - 180 * s**2 + 120 * s**3) / length**2
q = start + np.outer(path, goal - start)
qd, qdd = np.outer(speed, goal - start), np.outer(acceleration, goal - start)

voltage = np.round(dyn.motor_voltage(qd, dyn.inverse_dynamics(q, qd, qdd)), 2)  # equation (11)
schedule = aw.Schedule(np.round(rows, 3), voltage, tuple(arm.names))
run = aw.simulate(aw.Scenario(arm, duration=2.0, command=schedule, start=start))
aw.plot(run, folder / "feed_forward.png")

header = ",".join(["t", *arm.names])
table = np.column_stack([schedule.times, voltage])
np.savetxt(folder / "cmu-dd-feedforward.csv", table, fmt="%g", delimiter=",", header=header, comments="")
print("goal    ", np.array2string(goal, precision=3))
print("reached ", np.array2string(run.q.values[-1], precision=3))
