"""An experiment before it is run: a motion for two joints, the parameters that it determines, and a command for one motor."""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

arm = aw.load("two-link")
limits = aw.trajectories.MotionLimits.of(arm, velocity=[2.0, 3.0], torque=[60.0, 30.0])
designed = aw.identification.design_excitation(arm, limits=limits, cycle=5.0, harmonics=4, starts=2)
print(f"condition number {designed.condition:.3g}, torques up to {designed.used['torque'].max():.1%} of their limits")
draw = np.random.default_rng(0)
sine, cosine = 0.1 * draw.normal(size=(2, 2, 4))
random = aw.trajectories.Fourier.at_rest([0.5, 0.5], sine, cosine, cycle=5.0, cycles=1)
elbow_rests = aw.trajectories.Fourier.at_rest(
    [0.5, 0.5], sine * [[1.0], [0.0]], cosine * [[1.0], [0.0]], cycle=5.0, cycles=1
)
candidates = {"designed": designed, "random": random, "elbow rests": elbow_rests}
compared = aw.identification.compare_experiments(candidates, arm=arm, noise=0.5)  # print(compared) shows the table
for name, expected in compared.experiments.items():
    print(
        f"{name}: viscous friction of the elbow within {expected.std[8]:.2g}, condition number {expected.condition:.3g}"
    )
print("\n".join(compared.remarks[2:]))

loop = aw.Loop(controller=aw.ComputedTorque(kp=400.0, kd=40.0), reference=designed.trajectory, period=1e-3)
run = aw.simulate(aw.Scenario(arm, 5.0, start=designed.trajectory(0.0)[0], loop=loop))
print(f"simulated: torques up to {np.abs(run.tau.values).max(axis=0).round(1)} N m")

guess = aw.identification.MotorGuess(gain=12.0, time_constant=0.05, most=12.0, dead_zone=0.8, travel=30.0)
prbs = aw.identification.motor_experiment("prbs", guess)
print(f"prbs: {prbs.duration:.3g} s, {prbs.reasons[-1]}")

if len(sys.argv) > 1:
    (folder := Path(sys.argv[1])).mkdir(exist_ok=True)
    aw.identification.plot_experiment(designed, folder / "excite.png")
    aw.identification.plot_experiment(prbs, folder / "prbs.png")
