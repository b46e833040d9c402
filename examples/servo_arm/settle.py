"""Where SO-101's shoulder rests, come to from both sides, without and with 0.2 kg: Armwright, its MJCF, two files in circulation.

Run it:  python examples/servo_arm/settle.py [FOLDER]
"""

import sys
from pathlib import Path

import mujoco
import numpy as np
from matplotlib.figure import Figure

import armwright as aw

folder = Path((sys.argv[1:] or ["build/examples"])[0])
folder.mkdir(parents=True, exist_ok=True)
so101, goal = aw.load("so101"), np.array([0.0, 0.4, -0.6, 0.5, 0.0, 0.2])
motion = Path(__file__).with_name("swing.motion.toml")
GAINS, NAMES = ((None, 0.0), (17.8, 0.0), (998.22, 2.731)), ("Armwright", "its MJCF", "kp 17.8", "kp 998")  # kp, kv
t, rows = np.arange(0.0, 4.0, 0.002), []
for p in (16, 32):  # of the register; LeRobot writes 16
    arm = so101.with_values({f"{name}.firmware.p": p for name in so101.names})
    files, _ = aw.export.fit_actuators(arm, motion).write(folder / f"so101-p{p}.xml")
    for mass, side in ((0.0, -0.3), (0.0, 0.3), (0.2, -0.3), (0.2, 0.3)):
        start = goal + side * np.eye(6)[1]
        goals = aw.trajectories.Quintic(start, goal, 1.5).at(np.minimum(t, 1.5))[0]
        inputs = aw.Inputs(payload=aw.Payload(0.0, mass or 1e-6))
        run = aw.simulate(aw.Scenario(arm, t[-1], aw.Schedule(t, goals, arm.names), start=start, inputs=inputs))
        found = [run.q.values[-1]]
        for kp, kv in GAINS:
            spec = mujoco.MjSpec.from_file(str(files[0]))
            tip = spec.site("gripper_frame")
            tip.parent.add_body(pos=tip.pos, mass=mass or 1e-6, ipos=[0] * 3, inertia=[1e-6] * 3, explicitinertial=True)
            data = mujoco.MjData(model := spec.compile())
            if kp:  # the numbers of SO-101's other files in place of ours
                model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1:3] = kp, (-kp, -kv)
                model.dof_damping[:], model.actuator_forcerange[:] = 0.0 if kv else 0.6, (-3.35, 3.35)
            data.qpos[:] = start
            for data.ctrl[:] in goals:
                mujoco.mj_step(model, data)
            found.append(data.qpos)
        rows.append(np.degrees(np.array(found)[:, 1] - goal[1]))  # the arm is lower at a larger angle
        print(f"P {p}, {mass} kg, from {'above' if side < 0 else 'below'}: {', '.join(f'{x:.2f}°' for x in rows[-1])}")

figure = Figure(figsize=(7.5, 3.6), layout="constrained")
axes, off = figure.subplots(), np.reshape(rows, (4, 2, 4))
for j, name in enumerate(NAMES):
    axes.plot(np.arange(4) + 0.16 * j - 0.24, off[:, 0, j], "v", color=f"C{j}", label=name)
    axes.plot(np.arange(4) + 0.16 * j - 0.24, off[:, 1, j], "^", color=f"C{j}", fillstyle="none")
axes.set(
    xticks=range(4), xticklabels=("P 16", "P 16, 0.2 kg", "P 32", "P 32, 0.2 kg"), ylabel="shoulder below its goal [°]"
)
axes.legend(title="▼ from above, △ from below", frameon=False)
figure.savefig(folder / "servo_arm.png", dpi=150)
