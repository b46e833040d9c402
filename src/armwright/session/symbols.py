"""`help symbols`: the letters of the equations that help and the tour write."""

from __future__ import annotations

SYMBOLS = (
    ("θ, θ̇, θ̈", "rad, rad/s, rad/s²", "theta, omega, alpha: position, speed and acceleration of a joint; m for one that slides"),
    ("τ", "N m", "torque of the motors, referred to the joints; N for one that slides"),
    ("V, i", "V, A", "voltage and current of a motor"),
    ("M(θ)", "kg m²", "mass matrix: torques for a unit of each joint's acceleration; the report's H"),
    ("C(θ, θ̇) θ̇", "N m", "torques of centrifugal and Coriolis forces, which grow with speed squared"),
    ("g(θ)", "N m", "torques that gravity asks for at rest; the report's G"),
    ("friction", "N m", "of joints and gears, by the robot's record"),
    ("n", "–", "gear ratio: turns of the motor for one of the joint; 1 is a direct drive"),
    ("Kt", "N m/A", "torque constant of a motor: torque for a unit of current"),
    ("Ke", "V s/rad", "back-EMF constant: voltage that a unit of speed eats up; the same number as Kt, in these units"),
    ("R", "Ω", "resistance of a motor's winding"),
    ("F(θ, θ̇, V)", "rad/s²", "the Forward Arm: the accelerations that these give"),
    ("T, U", "J", "in energy: kinetic and potential energy"),
    ("m, c, g", "kg, m, m/s²", "in energy: mass of a link, its centre of mass, gravitational acceleration"),
    ("A₁ … A_N, T", "–", "in pose: where each joint's frame is in the one before it, and the hand in the base; N joints"),
    ("J(θ)", "m or –", "Jacobian: speed of the hand for a unit of each joint's speed"),
    ("v, ω", "m/s, rad/s", "speed of the hand, and how fast it turns"),
    ("v̇₀", "m/s²", "acceleration of the base, by which gravity enters"),
    ("t, T", "s", "in DACOut: time, and DACSampTimePeriod, by which k counts"),
    ("u, θ_ref", "V, A, N m or N; rad", "of a controller: its command to the drives, and the positions that it is asked for"),
    ("q, q_r, e", "rad", "in control laws: theta, the positions asked for, and q_r − q"),
)  # fmt: skip
"""Symbol, unit, meaning."""
