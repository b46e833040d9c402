"""Equations of motion: torques from motion, motion from torques."""

from armwright.dynamics.articulated_body import articulated_body
from armwright.dynamics.energy import kinetic_energy, potential_energy
from armwright.dynamics.forward import forward_arm, forward_dynamics
from armwright.dynamics.inverse import bias_torques, gravity_torques, inverse_dynamics
from armwright.dynamics.mass_matrix import mass_matrix

__all__ = [
    "articulated_body",
    "bias_torques",
    "forward_arm",
    "forward_dynamics",
    "gravity_torques",
    "inverse_dynamics",
    "kinetic_energy",
    "mass_matrix",
    "potential_energy",
]
