"""Equations of motion: torques from motion, motion from torques."""

from armwright.dynamics.articulated_body import articulated_body
from armwright.dynamics.centre_of_mass import centre_of_mass
from armwright.dynamics.composite_body import composite_body
from armwright.dynamics.coriolis import coriolis_matrix
from armwright.dynamics.derivatives import forward_dynamics_derivatives, inverse_dynamics_derivatives
from armwright.dynamics.energy import energy, kinetic_energy, potential_energy
from armwright.dynamics.forward import forward_arm, forward_dynamics
from armwright.dynamics.inverse import bias_torques, gravity_torques, holding_torques, inverse_dynamics
from armwright.dynamics.linearise import forward_arm_linearised
from armwright.dynamics.mass_matrix import mass_matrix
from armwright.dynamics.operational import operational_inertia
from armwright.dynamics.regressor import regressor, regressor_drive
from armwright.dynamics.springs import spring_torques

__all__ = [
    "articulated_body",
    "bias_torques",
    "centre_of_mass",
    "composite_body",
    "coriolis_matrix",
    "energy",
    "forward_arm",
    "forward_arm_linearised",
    "forward_dynamics",
    "forward_dynamics_derivatives",
    "gravity_torques",
    "holding_torques",
    "inverse_dynamics",
    "inverse_dynamics_derivatives",
    "kinetic_energy",
    "mass_matrix",
    "operational_inertia",
    "potential_energy",
    "regressor",
    "regressor_drive",
    "spring_torques",
]
