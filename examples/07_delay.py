"""Fine in simulation, shakes on the arm: the same gains without delay, and with commands that act 8 ms late.

Run it:  python examples/07_delay.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)
arm = aw.load("cmu-dd")

law = aw.JointPID(kp=[800, 1800, 600, 300, 60, 40], kd=[80, 180, 60, 24, 6, 4], gravity=True)  # [V/rad], [V s/rad]
motion = aw.trajectories.Quintic(start=np.zeros(6), goal=[0.8, 0.5, 0.3, 0.5, 0.2, 0.4], duration=0.8)
delays = {"at once": 0.0, "4 ms late": 4e-3, "8 ms late": 8e-3}
run = aw.simulate(
    aw.Scenario(
        arm, duration=1.5,
        loop=aw.Loop(law, motion, 1e-3,
            timing=aw.Timing(command_delay=aw.Batch(list(delays.values())))),
        recording=aw.Recording(reduce=["rms_error", "peak_voltage"]),
    )
)  # fmt: skip

for lane, name in enumerate(delays):
    error = 1e3 * run.rms_error.values[lane].max()
    shaking = np.ptp(run.voltage.values[lane, -300:], axis=0).max()  # the motion is over for 0.4 s
    print(f"{name:9}  tracking error {error:5.2f} mrad, voltages at rest swing by {shaking:5.1f} V")
aw.plot(
    {name: run.isel(lane=lane).sel(time=slice(0.0, 0.6)) for lane, name in enumerate(delays) if lane != 1},
    folder / "delay.png", joints=["joint3"], quantities=["q", "voltage"],
)  # fmt: skip
