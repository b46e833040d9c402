"""Right uses that a type checker has nothing to say about. Never run."""

from dataclasses import replace

import numpy as np

import armwright as aw

arm = aw.load("puma560", on_impossible="warn")
dyn = aw.compile(arm, vary=["link6.mass_kg"])
single = aw.compile(arm, dtype="float32")
on_gpu = aw.compile(arm, dtype="float32", device="cuda")
on_gpu.inverse_dynamics(object(), object(), object())  # arrays of CuPy, PyTorch or JAX
q = np.zeros(6)
lanes = np.zeros((4, 6))
tau = single.inverse_dynamics(q, [0.0] * 6, lanes, wrench=np.zeros(6))
pose = single.forward_kinematics(q, frame="link3")

aw.JointPID(100.0)
aw.JointPID(kp=[400.0, 600, 300, 60, 60, 60], ki=np.full(6, 2.0), kd=np.float64(3.0), limit=30)
aw.JointPID(kp=aw.Batch([[1.0] * 6, [2.0] * 6]), anti_windup="back-calculation", tracking_time=0.1, delay_ticks=1)
aw.JointPID(kp=aw.Draw.uniform(1.0, 2.0), derivative="measurement", limit=None)
cascade = aw.Cascade(20.0, 1.0, speed_ki=10, current_kp=None, anti_windup="clamping")
law = aw.Filtered(aw.FrictionCompensation(cascade, dead_band=1e-3, rest_speed=[0.01] * 6), [aw.LowPass(200.0)])
gain = 2.0 * aw.JointPID(kp=3.0).kp + 1.0

loop = aw.Loop(
    law,
    reference=lambda t: q,
    period=1e-3,
    sensors=aw.Sensors(side="link", counts=[4096] * 6, velocity="observer", cutoff_hz=100.0, position_noise=1e-4),
    command_filter=aw.CommandFilter(limit=24.0, rate=np.inf, resolution=[0.01] * 6),
    timing=aw.Timing("one-tick", jitter=aw.Batch([0.0, 1e-4]), clock_drift=50e-6),
)
scenario = aw.Scenario(
    arm,
    duration=2.0,
    loop=loop,
    start=aw.Start(q=lanes[0], qd=[0.0] * 6),
    solver=aw.Solver("rodas3", rtol=1e-6),
    recording=aw.Recording(what="state", every=10),
)
run = aw.simulate(replace(scenario, loop=replace(loop, controller=aw.ComputedTorque(kp=100.0, kd=[20.0] * 6))))
aw.trajectories.Waypoints([q, q + 1.0, q], times=[0.0, 1.0, 2.0], curve="natural_cubic")
aw.trajectories.Sine(q, amplitude=[0.1] * 6, frequency_hz=1.0)
aw.trajectories.Ramp(0.0, 1.0, 1.0)
aw.export.export_controller(scenario, "c", gains=["kp"], real="float")
aw.export.export_fmu(arm, "arm.fmu", version="2.0", interface="model-exchange")
aw.export.export_ros2(arm, "pkg", command="effort")
torques = aw.interop.jax(dyn, "inverse_dynamics", "wrench")
