"""Armwright: from the parts of a robot arm to the C that runs it, with one parameter record all the way.

import armwright as aw

arm = aw.load("cmu-dd")
dyn = aw.compile(arm)
tau = dyn.inverse_dynamics(q, qd, qdd)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armwright.actuators import motor_current, motor_torque, motor_voltage
    from armwright.description import RobotDescription, builtin_names
    from armwright.dynamics import (
        articulated_body,
        bias_torques,
        centre_of_mass,
        coriolis_matrix,
        energy,
        forward_arm,
        forward_arm_linearised,
        forward_dynamics,
        forward_dynamics_derivatives,
        gravity_torques,
        inverse_dynamics,
        inverse_dynamics_derivatives,
        kinetic_energy,
        mass_matrix,
        operational_inertia,
        potential_energy,
        regressor,
        regressor_drive,
    )
    from armwright.errors import ArmwrightError
    from armwright.kernels.compiled import CompiledArm
    from armwright.kernels.compiled import compile_arm as compile
    from armwright.kinematics import forward_kinematics, jacobian, jacobian_dot_qd
    from armwright.model import Model
    from armwright.model.load import load
    from armwright.simulation.plot import plot
    from armwright.simulation.recording import load_run, save
    from armwright.simulation.scenario import Scenario
    from armwright.simulation.schedule import Schedule, read_schedule
    from armwright.simulation.simulator import simulate

__version__ = "0.1.0"

_HOMES = {  # where each public name lives; imported when first used, so that `import armwright` costs nothing
    "armwright.actuators": ("motor_current", "motor_torque", "motor_voltage"),
    "armwright.description": ("RobotDescription", "builtin_names"),
    "armwright.dynamics": (
        *("articulated_body", "bias_torques", "centre_of_mass", "coriolis_matrix"),
        *("energy", "forward_arm", "forward_arm_linearised", "forward_dynamics"),
        *("forward_dynamics_derivatives", "gravity_torques", "inverse_dynamics", "inverse_dynamics_derivatives"),
        *("kinetic_energy", "mass_matrix", "operational_inertia", "potential_energy"),
        *("regressor", "regressor_drive"),
    ),
    "armwright.errors": ("ArmwrightError",),
    "armwright.kernels.compiled": ("CompiledArm", "compile"),
    "armwright.kinematics": ("forward_kinematics", "jacobian", "jacobian_dot_qd"),
    "armwright.model": ("Model",),
    "armwright.model.load": ("load",),
    "armwright.simulation.plot": ("plot",),
    "armwright.simulation.recording": ("load_run", "save"),
    "armwright.simulation.scenario": ("Scenario",),
    "armwright.simulation.schedule": ("Schedule", "read_schedule"),
    "armwright.simulation.simulator": ("simulate",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}
_CALLED = {"compile": "compile_arm"}  # inside, nothing is called like Python's own

__all__ = [
    "ArmwrightError",
    "CompiledArm",
    "Model",
    "RobotDescription",
    "Scenario",
    "Schedule",
    "articulated_body",
    "bias_torques",
    "builtin_names",
    "centre_of_mass",
    "compile",
    "coriolis_matrix",
    "energy",
    "forward_arm",
    "forward_arm_linearised",
    "forward_dynamics",
    "forward_dynamics_derivatives",
    "forward_kinematics",
    "gravity_torques",
    "inverse_dynamics",
    "inverse_dynamics_derivatives",
    "jacobian",
    "jacobian_dot_qd",
    "kinetic_energy",
    "load",
    "load_run",
    "mass_matrix",
    "motor_current",
    "motor_torque",
    "motor_voltage",
    "operational_inertia",
    "plot",
    "potential_energy",
    "read_schedule",
    "regressor",
    "regressor_drive",
    "save",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'armwright' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), _CALLED.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
