"""Calibration: an arm whose zeros and lengths are off, chosen poses, a tracker, and the record with what was found."""

import sys
from pathlib import Path

import numpy as np

import armwright as aw
from armwright.identification import Measured, Measurements, design_poses

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)
arm = aw.load("lwa4p")  # as its record has it
wrong = {"joint2.dh.offset_rad": -1.5628, "joint4.dh.offset_rad": 0.004, "joint2.dh.a_m": 0.3515}
real = arm.with_values(wrong)  # as it was built
markers = np.array([[0.10, 0.00, 0.05], [-0.05, 0.08, 0.06], [-0.05, -0.08, 0.10]])  # on the tool [m]
tracker = np.linalg.inv(aw.forward_kinematics(arm, [0.3, 0.2, 0.1, 0.4, 0.5, 0.6]))  # stands anywhere

poses = design_poses(arm, 30, markers)
print(f"O1 {poses.o1:.3f}, of random poses {poses.random_o1:.3f}; deviations {poses.deviations.mean():.2f} of theirs")
rng = np.random.default_rng(0)
seen = np.array([markers @ T[:3, :3].T + T[:3, 3] for T in (tracker @ aw.forward_kinematics(real, q) for q in poses.q)])
seen += rng.normal(0, 1e-4, seen.shape)  # 0.1 mm
seen[7, 1] += [0.03, 0.0, -0.02]  # a reflection that was taken for a marker
measured = [Measured(f"marker{k + 1}", "point", seen[:, k]) for k in range(3)]

found = aw.calibrate(Measurements(arm.names, poses.q, measured), arm)
print(*found.sentences(), sep="\n")
found.plot(folder / "calibration.png")
calibrated = aw.load(found.write(folder / "calibrated.toml"))
for path in wrong:
    record, value, truth = (each.parameters[path].value for each in (arm, calibrated, real))
    print(f"{path:24} record {record:8.5f}  calibrated {value:8.5f}  real {truth:8.5f}")
goal = aw.forward_kinematics(real, [0.2, -0.4, 1.1, 0.3, 0.8, 0.0])
for name, model in (("the record", arm), ("the calibrated record", calibrated)):
    reached = aw.forward_kinematics(real, aw.inverse_kinematics(model, goal).q)
    print(f"inverse kinematics with {name} misses by {1e3 * np.linalg.norm((reached - goal)[:3, 3]):.2f} mm")
