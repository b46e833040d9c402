"""Your own controller in a Python loop, as with MuJoCo: measure, compute, step; in real time if you wish.

Run it:  python examples/18_closed_loop.py [FOLDER] [--real-time]
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

real_time = "--real-time" in sys.argv
folder = Path(next((word for word in sys.argv[1:] if not word.startswith("-")), "build/examples"))
folder.mkdir(parents=True, exist_ok=True)

arm = aw.load("two-link")
goal, kp, kd = np.array([-0.9, 0.6]), np.array([900.0, 250.0]), np.array([180.0, 50.0])
sim = aw.simulation.Simulation(aw.Scenario(arm, start=[-1.57, 0.0], solver=aw.Solver(step=1e-3)))
rows = []
while sim.time < 1.5:
    y = sim.measurement
    u = kp * (goal - y.q) - kd * y.qd + aw.gravity_torques(arm, y.q)  # PD with gravity, N m
    sim.step(u, real_time=real_time)
    rows.append([sim.time, *y.q])

np.savetxt(folder / "closed_loop.csv", rows, delimiter=",", header="t,q_shoulder,q_elbow", comments="")
off = np.abs(goal - sim.plant_state["q"]).max()
print(f"after {sim.time:.3g} s the arm is {off:.1e} rad off its goal")
print(f"every tick's measurement is in {folder / 'closed_loop.csv'}")
