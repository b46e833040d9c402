"""The two arms of the report: torques and voltages from a motion, and the motion back from the voltages.

Run it:  python examples/02_inverse_and_forward.py
"""

import numpy as np

import armwright as aw

arm = aw.load("puma560")
dyn = aw.compile(arm)

q = np.radians([0.0, 45.0, 180.0, 0.0, 45.0, 0.0])
qd = np.array([0.5, -0.3, 0.4, 0.0, 0.2, 0.0])  # [rad/s]
qdd = np.array([1.0, 2.0, -1.0, 0.5, 0.0, 0.0])  # [rad/s²]

# Inverse Arm, and the parts of its torques.
tau = dyn.inverse_dynamics(q, qd, qdd)
parts = {
    "gravity": dyn.gravity_torques(q),
    "speed and friction": dyn.bias_torques(q, qd) - dyn.gravity_torques(q),
    "acceleration": dyn.mass_matrix(q) @ qdd,  # rotors included
}
for name, part in parts.items():
    print(f"{name:<20}", np.array2string(part, precision=3, suppress_small=True), "N m")
print(f"{'torque':<20}", np.array2string(tau, precision=3, suppress_small=True), "N m")

# Equation (11), and the Forward Arm: from voltages back to the accelerations above.
voltage = dyn.motor_voltage(qd, tau)
print(f"{'voltage':<20}", np.array2string(voltage, precision=3, suppress_small=True), "V")
print(f"forward(inverse) off by at most {np.abs(dyn.forward_arm(q, qd, voltage) - qdd).max():.0e} rad/s²")

# A force on the gripper is a wrench at the tip: 20 N downward change the torques by -Jᵀ wrench.
wrench = np.array([0.0, 0.0, -20.0, 0.0, 0.0, 0.0])
change = dyn.inverse_dynamics(q, qd, qdd, wrench=wrench) - tau
print("with 20 N pulling down", np.array2string(change, precision=3, suppress_small=True), "N m more")
