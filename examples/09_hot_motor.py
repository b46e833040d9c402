"""A motor that grows warm loses torque: its resistance rises, its magnets weaken, and its supply no longer suffices.

Run it:  python examples/09_hot_motor.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)
arm = aw.load(Path(__file__).with_name("hot-lift.toml"))

law = aw.JointPID(kp=80.0, kd=8.0, speed_feedforward=2.4, gravity=True)  # feed-forward: n Ke, the back EMF
lift = aw.trajectories.Sine(centre=[0.0], amplitude=[0.6], frequency_hz=0.5)
run = aw.simulate(
    aw.Scenario(
        arm, duration=240.0, loop=aw.Loop(law, lift, 2e-3),
        recording=aw.Recording(every=10, reduce=["peak_temperature", "energy"]),
    )
)  # fmt: skip

error = np.abs(run.q - run.q_reference).values[:, 0]
for start in (2.0, 60.0, 120.0, 238.0):  # [s] of one cycle each
    cycle = (run.time.values >= start) & (run.time.values < start + 2.0)
    warm, most = run.winding_temperature.values[cycle].mean(), np.abs(run.voltage.values[cycle]).max()
    print(f"t = {start:3.0f} s: {warm:3.0f} °C, up to {most:4.1f} V, off by at most {error[cycle].max():6.4f} rad")
print(f"{float(run.energy[0]):.0f} J went into the motor, the winding reached {float(run.peak_temperature[0]):.0f} °C")
cold, hot = run.sel(time=slice(2.0, 6.0)), run.sel(time=slice(234.0, 238.0))
beside = {"at first": cold, "four minutes later": hot.assign_coords(time=hot.time - 232.0)}
aw.plot(beside, folder / "hot_motor.png", quantities=["q", "voltage", "current", "winding_temperature"])
