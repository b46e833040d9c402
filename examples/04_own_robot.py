"""Your own robot: a SCARA from its TOML file, with a sliding joint, lossy gears and motors. See scara.toml beside this.

Run it:  python examples/04_own_robot.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)

arm = aw.load(Path(__file__).with_name("scara.toml"))
print(arm)
for path in ("rod.mass_kg", "shoulder.motor.resistance_ohm"):
    source = arm.provenance(path)
    print(f"  {path}: {source.kind}, {source.text}")

# Voltages that hold the arm still. Joint torques in N m, the quill's force in N.
q, still = np.array([0.3, -0.8, 0.05, 0.0]), np.zeros(4)
holding = aw.motor_voltage(arm, still, aw.gravity_torques(arm, q))
print("holding voltages:", np.round(holding, 3), "V")
print("tip at", np.round(aw.forward_kinematics(arm, q)[:3, 3], 4), "m")

# Reach out while the quill goes down, then stop: two rows of voltages.
schedule = aw.Schedule(
    times=np.array([0.0, 0.4]),
    commands=holding + np.array([[3.0, 4.0, 1.2, 6.0], [0.0, 0.0, 0.0, 0.0]]),
    names=tuple(arm.names),
)
run = aw.simulate(aw.Scenario(arm, command=schedule, duration=0.8, start=q))
print("ends at q =", np.round(run.q.values[-1], 3), "rad, rad, m, rad")
aw.plot(run, folder / "own_robot.png")

# An arm is never changed; `replace` returns another one: here without friction and with lossless gears.
ideal = aw.simulate(aw.Scenario(arm.replace(friction=None, efficiency=None), command=schedule, duration=0.8, start=q))
print("without friction and gear loss q =", np.round(ideal.q.values[-1], 3))
