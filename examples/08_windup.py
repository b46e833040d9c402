"""A step that asks for more volts than there are winds the integrator up; two rules keep it from that.

Run it:  python examples/08_windup.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)
arm = aw.load("cmu-dd")

gains = {"kp": [150, 900, 300, 150, 30, 20], "ki": [100, 0, 0, 0, 0, 0], "kd": [40, 90, 30, 12, 3, 2]}
plenty, few = [80, 80, 80, 60, 24, 24], [3, 80, 80, 60, 24, 24]  # [V] that the output stage has
cases = {
    "80 V, plain": (aw.JointPID(**gains), plenty),
    "3 V, plain": (aw.JointPID(**gains), few),
    "3 V, clamping": (aw.JointPID(**gains, anti_windup="clamping"), few),
    "3 V, back-calculation": (aw.JointPID(**gains, anti_windup="back-calculation", tracking_time=0.6), few),
}
runs = {}
for name, (law, volts) in cases.items():
    scenario = aw.Scenario(
        arm, duration=4.0,
        loop=aw.Loop(controller=law, reference=aw.trajectories.Step(start=np.zeros(6), goal=[0.5, 0, 0, 0, 0, 0]), period=1e-3,
            command_filter=aw.CommandFilter(limit=volts)),
        recording=aw.Recording(reduce=["overshoot", "settling_time:band=0.05"]),
    )  # fmt: skip
    runs[name] = aw.simulate(scenario)
    over, settled = (float(runs[name][what].values[0]) for what in scenario.recording.reduce)
    shown = f"within 5 % after {settled:.2f} s" if settled < 4.0 else "not within 5 % yet"
    print(f"{name:22} overshoot {over:3.0%}, {shown}")
aw.plot(runs, folder / "windup.png", joints=["joint1"], quantities=["q", "voltage"])
