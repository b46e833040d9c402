"""The report's use of the Inverse Arm: the voltages along a planned motion, and whether they really give that motion.

    python examples/02_inverse_and_forward.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)

arm = aw.load("cmu-dd")
dyn = aw.compile(arm)

# A smooth way from q0 to q1 in one second: a quintic, at rest at both ends.
q0, q1, step = np.zeros(6), np.array([0.6, 0.4, -0.5, 0.8, 0.3, -0.4]), 1e-3
t = np.arange(0.0, 1.0 + step / 2, step)
s, sd, sdd = 10 * t**3 - 15 * t**4 + 6 * t**5, 30 * t**2 - 60 * t**3 + 30 * t**4, 60 * t - 180 * t**2 + 120 * t**3
q, qd, qdd = q0 + np.outer(s, q1 - q0), np.outer(sd, q1 - q0), np.outer(sdd, q1 - q0)

tau = dyn.inverse_dynamics(q, qd, qdd)  # (1001, 6): all instants in one call
voltage = dyn.motor_voltage(qd, tau)
back = dyn.forward_arm(q, qd, voltage)
print(f"largest voltage                    {np.abs(voltage).max():.2f} V")
print(f"forward(inverse) off by at most    {np.abs(back - qdd).max():.1e} rad/s²")

# Played to the motors row by row: a held voltage is half a step late, and nothing corrects it.
run = aw.simulate(aw.Scenario(arm, schedule=aw.Schedule(t, voltage, arm.names), duration=1.0, q0=q0))
error = run.q.values - q
print(f"open loop, off after one second    {np.degrees(np.abs(error[-1]).max()):.2f}°")
aw.plot(run, folder / "inverse_and_forward.png")
