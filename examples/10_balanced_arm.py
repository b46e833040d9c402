"""A cylinder bears most of the load of a heavy arm's axis 2: force and stiffness by least squares, and the motor's share.

Run it:  python examples/10_balanced_arm.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)
arm = aw.load(Path(__file__).with_name("heavy.toml"))

names = ["balancer.force_n", "balancer.stiffness_n_per_m"]
dyn, varied = aw.compile(arm), aw.compile(arm, vary=names)
q2, q3 = (each.ravel() for each in np.meshgrid(np.linspace(-0.9, 1.2, 25), np.linspace(-1.0, 1.0, 9)))
q = np.stack([0.0 * q2, q2, q3], axis=1)
g, s = dyn.gravity_torques(q)[:, 1], dyn.spring_torques(q)[:, 1]

unit = [varied.spring_torques(q, parameters=each)[:, 1] for each in np.eye(2)]  # s is linear in force and stiffness
force, stiffness = np.linalg.lstsq(np.stack(unit, axis=1), -g, rcond=None)[0]
print(f"the best cylinder pulls {-force:.0f} N at {arm.cylinders[0].length} m and {stiffness:.0f} N/m more by a metre")

for what, torque in (("without", g), ("with it", g + s)):
    rms = np.sqrt(np.mean(torque**2))
    print(f"axis 2 {what}: {np.abs(torque).max():5.0f} N m at most, {rms:5.0f} N m rms, over {len(q)} poses at rest")
aw.show(arm, folder / "balanced_arm.png", [0.3, 0.8, -0.4])
