"""Thirty mistakes that a type checker finds; each line that has one is marked. Never run."""

import numpy as np

import armwright as aw

arm = aw.load("puma560")
dyn = aw.compile(arm)
q = np.zeros(6)
pid = aw.JointPID(kp=100.0)

aw.simulates(aw.Scenario(arm, duration=1.0))  # mistake: a misspelt function
aw.JointPid(kp=1.0)  # mistake: a misspelt class
aw.identification.fit_moter()  # mistake: a misspelt name of a group
aw.identify_arm("run.csv")  # mistake: a name of a group asked at the top
dyn.inverse_dynamic(q, q, q)  # mistake: a misspelt kernel
dyn.inverse_dynamics(q, q)  # mistake: a missing input
dyn.mass_matrix(q, q, q)  # mistake: an input too many
dyn.jacobian(q, frames="tool")  # mistake: a misspelt option
aw.compile(arm, dtype="float16")  # mistake: a format that there is not
aw.compile(arm, vary="link6.mass_kg").threads.run()  # mistake: threads is a number
aw.load("puma560", on_impossible="ignore")  # mistake: no such choice
aw.load(6)  # mistake: no name
aw.JointPID()  # mistake: kp is missing
aw.JointPID(kp="a")  # mistake: a gain that is no number
aw.JointPID(kp=["a", "b"])  # mistake: gains that are no numbers
aw.JointPID(kp=1.0, kD=2.0)  # mistake: a misspelt gain
aw.JointPID(kp=1.0, anti_windup="clamp")  # mistake: no such rule
aw.JointPID(kp=1.0, derivative="errors")  # mistake: no such choice
aw.JointPID(kp=1.0, delay_ticks=0.5)  # mistake: half a tick
aw.Cascade(20.0, speed_kd=1.0)  # mistake: speed_kp is missing, and there is no speed_kd
aw.Solver(integrator="rk5")  # mistake: no such rule
aw.Solver(step="1 ms")  # mistake: a time with a unit
aw.Solver(substeps=2.5)  # mistake: no whole number
aw.Recording(what="states")  # mistake: no such choice
aw.Timing("one_tick")  # mistake: no such preset
aw.Timing(jitter="1 ms")  # mistake: a time with a unit
aw.Sensors(side="joint")  # mistake: no such side
aw.Sensors(velocity="filter")  # mistake: no such way
aw.Loop(pid, timing="ideal")  # mistake: a name in place of a Timing
aw.Scenario(arm, duration="2 s")  # mistake: a time with a unit
aw.Scenario(arm, solver=aw.Timing("sync"))  # mistake: a Timing in place of a Solver
aw.Start(q="home")  # mistake: a name in place of positions
aw.CommandFilter(limit="24 V")  # mistake: a number with a unit
aw.trajectories.Quintic("home", q)  # mistake: a name in place of positions
aw.trajectories.Waypoints([q, q], curve="spline")  # mistake: no such curve
aw.export.export_fmu(arm, "arm.fmu", version="1.0")  # mistake: no such version
aw.export.export_controller("swing.scenario.toml", "c", real="half")  # mistake: no such format
aw.export.export_ros2(arm, "pkg", command="torque")  # mistake: no such command
