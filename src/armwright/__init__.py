"""Robot arms with their motors: models, compiled dynamics, sampled simulation, identification, motion and control.

import armwright as aw

arm = aw.load("cmu-dd")
dyn = aw.compile(arm)
tau = dyn.inverse_dynamics(q, qd, qdd)
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armwright.actuators import motor_current, motor_torque, motor_voltage
    from armwright.collision import BoxObstacle, PlaneObstacle, SphereObstacle, clearance
    from armwright.control import (
        Cascade,
        ComputedTorque,
        DisturbanceObserver,
        FeedForward,
        Filtered,
        FrictionCompensation,
        JointPID,
        LowPass,
        Notch,
    )
    from armwright.control.analysis.analyse import LoopAnalysis, analyse_loops
    from armwright.control.analysis.hold import sampled_system, zero_order_hold
    from armwright.control.analysis.limit_cycles import LimitCycle, limit_cycle
    from armwright.control.analysis.linear_loop import LinearLoop, Margins
    from armwright.control.analysis.noise import NoiseGain, Quantisation, noise_gain, quantisation
    from armwright.control.analysis.regions import GainRegion, gain_region, longest_period
    from armwright.control.analysis.workspace import JointInertias, joint_inertias
    from armwright.control.comparison.compare import Comparison, compare_controllers
    from armwright.control.design import GainDesign, design_gains, state_space
    from armwright.description import RobotDescription, builtin_names
    from armwright.description.writer import to_toml, write_toml
    from armwright.dynamics import (
        articulated_body,
        bias_torques,
        centre_of_mass,
        composite_body,
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
        spring_torques,
    )
    from armwright.errors import ArmwrightError
    from armwright.examples import copy_examples
    from armwright.export.controller.write import ExportedController, export_controller
    from armwright.export.fmu.write import ExportedFmu, export_fmu
    from armwright.export.ros2 import Ros2Export, export_ros2
    from armwright.identification.arm.drive_gains import identify_drive_gains
    from armwright.identification.arm.friction import identify_friction
    from armwright.identification.arm.identify import ArmEstimate, identify_arm
    from armwright.identification.arm.payload import identify_payload
    from armwright.identification.estimate import Estimate, write_into
    from armwright.identification.experiments.excitation import Excitation, design_excitation
    from armwright.identification.experiments.expected import compare_experiments
    from armwright.identification.experiments.motor import MotorGuess, motor_experiment
    from armwright.identification.experiments.plot import plot_experiment
    from armwright.identification.linear.fit import fit_armax, fit_arx, fit_oe
    from armwright.identification.linear.frequency import FrequencyResponse, frequency_response
    from armwright.identification.linear.model import LinearModel
    from armwright.identification.linear.n4sid import fit_n4sid
    from armwright.identification.logs.log import Log
    from armwright.identification.logs.plot import plot_log
    from armwright.identification.logs.preparation import Preparation, choose_preparation
    from armwright.identification.logs.prepared import prepare_log
    from armwright.identification.logs.read import read_log
    from armwright.identification.logs.write import write_log
    from armwright.identification.motor.identify import MotorFit, identify_motor
    from armwright.identification.validation.limits import Limits
    from armwright.identification.validation.report import write_report
    from armwright.identification.validation.validate import Validation, validate
    from armwright.identification.validation.verdict import passing_verdict, stored_verdict, write_verdict
    from armwright.ik.measures import Manipulability, manipulability
    from armwright.ik.solutions import PoseBranches, PoseSolutions
    from armwright.ik.solve import inverse_kinematics
    from armwright.ik.targets import pose_towards
    from armwright.ik.workspace import workspace
    from armwright.interfaces import Controller, JointReference, Measurement, Sensor, Trajectory
    from armwright.kernels.compiled import CompiledArm
    from armwright.kernels.compiled import compile_arm as compile
    from armwright.kinematics import forward_kinematics, jacobian, jacobian_dot_qd
    from armwright.model import Model
    from armwright.model.load import load
    from armwright.modules.assemble import assemble
    from armwright.modules.assembly import read_modules
    from armwright.modules.enumerate import enumerate_assemblies
    from armwright.modules.rank import rank_assemblies
    from armwright.modules.task import read_task
    from armwright.motions.plan import Plan, plan
    from armwright.parameters import Batch, Draw
    from armwright.parts.write import write_parts
    from armwright.pictures.animate import animate
    from armwright.pictures.live import LiveArm
    from armwright.pictures.show import show
    from armwright.pictures.workspace_maps import draw_workspace
    from armwright.results.plot import plot
    from armwright.results.recording import save
    from armwright.results.run_file import load_run
    from armwright.results.statistics import statistics
    from armwright.robotfiles import check, convert, diff, new_robot
    from armwright.scenarios import read_scenario, reproduce, write_scenario
    from armwright.shadow.alarms import ShadowAlarm
    from armwright.shadow.observer import ShadowBandwidths
    from armwright.shadow.page import write_shadow
    from armwright.shadow.shadow import ArmShadow, Shadow, shadow_log
    from armwright.signals import Layout, Signal
    from armwright.simulation.inputs.payload import Payload
    from armwright.simulation.inputs.schedule import Schedule, read_schedule
    from armwright.simulation.integrate.events import joint_stops
    from armwright.simulation.loop.command_filter import CommandFilter
    from armwright.simulation.loop.sensors import Sensors
    from armwright.simulation.loop.state import LoopState
    from armwright.simulation.loop.timing import Timing
    from armwright.simulation.scenario import Scenario
    from armwright.simulation.scenario_parts import Inputs, Loop, Recording, Solver, Start
    from armwright.simulation.sensitivity import sensitivities
    from armwright.simulation.simulation import Simulation, simulate
    from armwright.simulation.step_study import step_study
    from armwright.sweeps.store import load_sweep
    from armwright.sweeps.sweep import Sweep, sweep
    from armwright.trajectory import (
        Cubic,
        Fourier,
        InputShaper,
        Joined,
        MinimumJerk,
        Motion,
        MotionLimits,
        PiecewisePolynomial,
        Quintic,
        Ramp,
        Ruckig,
        SCurve,
        Sine,
        Step,
        Trapezoid,
        Waypoints,
        limits_report,
    )
    from armwright.trajectory.cartesian.follow import follow_path
    from armwright.trajectory.cartesian.motion import CartesianMotion
    from armwright.trajectory.cartesian.path import CartesianPath
    from armwright.trajectory.cartesian.segments import Arc, Circle, Line, Poses
    from armwright.trajectory.cartesian.solve import ToolPathSolution, solve_path
    from armwright.trajectory.keep_clear import check_clearance
    from armwright.trajectory.motion_rows import load_motion
    from armwright.trajectory.online import ReferenceFilter
    from armwright.trajectory.path import JointPath
    from armwright.trajectory.time_optimal import PathMotion, time_optimal
    from armwright.tuning import TuningResult, tune
    from armwright.twin.listen import BusListener, bus_recording, shadow_bus
    from armwright.twin.on_bus import scenario_on_bus
    from armwright.twin.rehearsal import Rehearsal, rehearse
    from armwright.twin.run import BusRun, release_drives, run_controller
    from armwright.twin.twin import Twin

__version__ = "0.1.0"

_HOMES = {  # where each public name lives; imported when first used, so that `import armwright` costs nothing
    "armwright.actuators": ("motor_current", "motor_torque", "motor_voltage"),
    "armwright.collision": ("BoxObstacle", "PlaneObstacle", "SphereObstacle", "clearance"),
    "armwright.control.analysis.analyse": ("LoopAnalysis", "analyse_loops"),
    "armwright.control.analysis.hold": ("sampled_system", "zero_order_hold"),
    "armwright.control.analysis.limit_cycles": ("LimitCycle", "limit_cycle"),
    "armwright.control.analysis.linear_loop": ("LinearLoop", "Margins"),
    "armwright.control.analysis.noise": ("NoiseGain", "Quantisation", "noise_gain", "quantisation"),
    "armwright.control.analysis.regions": ("GainRegion", "gain_region", "longest_period"),
    "armwright.control.analysis.workspace": ("JointInertias", "joint_inertias"),
    "armwright.control": (
        "Cascade",
        "ComputedTorque",
        "DisturbanceObserver",
        "FeedForward",
        "Filtered",
        "FrictionCompensation",
        "JointPID",
        "LowPass",
        "Notch",
    ),
    "armwright.control.comparison.compare": ("Comparison", "compare_controllers"),
    "armwright.control.design": ("GainDesign", "design_gains", "state_space"),
    "armwright.description": ("RobotDescription", "builtin_names"),
    "armwright.modules.assemble": ("assemble",),
    "armwright.modules.assembly": ("read_modules",),
    "armwright.parts.write": ("write_parts",),
    "armwright.description.writer": ("to_toml", "write_toml"),
    "armwright.dynamics": (
        *("articulated_body", "bias_torques", "centre_of_mass", "composite_body", "coriolis_matrix"),
        *("energy", "forward_arm", "forward_arm_linearised", "forward_dynamics"),
        *("forward_dynamics_derivatives", "gravity_torques", "inverse_dynamics", "inverse_dynamics_derivatives"),
        *("kinetic_energy", "mass_matrix", "operational_inertia", "potential_energy"),
        *("regressor", "regressor_drive", "spring_torques"),
    ),
    "armwright.errors": ("ArmwrightError",),
    "armwright.export.controller.write": ("ExportedController", "export_controller"),
    "armwright.export.fmu.write": ("ExportedFmu", "export_fmu"),
    "armwright.export.ros2": ("Ros2Export", "export_ros2"),
    "armwright.examples": ("copy_examples",),
    "armwright.identification.arm.friction": ("identify_friction",),
    "armwright.identification.arm.drive_gains": ("identify_drive_gains",),
    "armwright.identification.arm.payload": ("identify_payload",),
    "armwright.identification.arm.identify": ("ArmEstimate", "identify_arm"),
    "armwright.identification.estimate": ("Estimate", "write_into"),
    "armwright.identification.linear.fit": ("fit_armax", "fit_arx", "fit_oe"),
    "armwright.identification.linear.frequency": ("FrequencyResponse", "frequency_response"),
    "armwright.identification.linear.model": ("LinearModel",),
    "armwright.identification.linear.n4sid": ("fit_n4sid",),
    "armwright.identification.experiments.excitation": ("Excitation", "design_excitation"),
    "armwright.identification.experiments.expected": ("compare_experiments",),
    "armwright.identification.experiments.motor": ("MotorGuess", "motor_experiment"),
    "armwright.identification.experiments.plot": ("plot_experiment",),
    "armwright.identification.logs.log": ("Log",),
    "armwright.identification.logs.read": ("read_log",),
    "armwright.identification.logs.plot": ("plot_log",),
    "armwright.identification.logs.write": ("write_log",),
    "armwright.identification.logs.preparation": ("Preparation", "choose_preparation"),
    "armwright.identification.logs.prepared": ("prepare_log",),
    "armwright.ik.measures": ("Manipulability", "manipulability"),
    "armwright.ik.solutions": ("PoseBranches", "PoseSolutions"),
    "armwright.ik.solve": ("inverse_kinematics",),
    "armwright.ik.targets": ("pose_towards",),
    "armwright.identification.validation.limits": ("Limits",),
    "armwright.identification.validation.report": ("write_report",),
    "armwright.identification.validation.validate": ("Validation", "validate"),
    "armwright.identification.validation.verdict": ("passing_verdict", "stored_verdict", "write_verdict"),
    "armwright.identification.motor.identify": ("MotorFit", "identify_motor"),
    "armwright.kernels.compiled": ("CompiledArm", "compile"),
    "armwright.kinematics": ("forward_kinematics", "jacobian", "jacobian_dot_qd"),
    "armwright.model": ("Model",),
    "armwright.model.load": ("load",),
    "armwright.modules.enumerate": ("enumerate_assemblies",),
    "armwright.modules.rank": ("rank_assemblies",),
    "armwright.modules.task": ("read_task",),
    "armwright.scenarios": ("read_scenario", "reproduce", "write_scenario"),
    "armwright.simulation.step_study": ("step_study",),
    "armwright.simulation.integrate.events": ("joint_stops",),
    "armwright.motions.plan": ("Plan", "plan"),
    "armwright.parameters": ("Batch", "Draw"),
    "armwright.pictures.animate": ("animate",),
    "armwright.pictures.live": ("LiveArm",),
    "armwright.pictures.show": ("show",),
    "armwright.robotfiles": ("check", "convert", "diff", "new_robot"),
    "armwright.shadow.alarms": ("ShadowAlarm",),
    "armwright.shadow.observer": ("ShadowBandwidths",),
    "armwright.shadow.page": ("write_shadow",),
    "armwright.shadow.shadow": ("ArmShadow", "Shadow", "shadow_log"),
    "armwright.simulation.inputs.payload": ("Payload",),
    "armwright.results.plot": ("plot",),
    "armwright.interfaces": ("Controller", "JointReference", "Measurement", "Sensor", "Trajectory"),
    "armwright.results.recording": ("save",),
    "armwright.results.run_file": ("load_run",),
    "armwright.simulation.scenario": ("Scenario",),
    "armwright.simulation.inputs.schedule": ("Schedule", "read_schedule"),
    "armwright.signals": ("Layout", "Signal"),
    "armwright.simulation.loop.state": ("LoopState",),
    "armwright.simulation.loop.sensors": ("Sensors",),
    "armwright.simulation.loop.command_filter": ("CommandFilter",),
    "armwright.simulation.scenario_parts": ("Inputs", "Loop", "Recording", "Solver", "Start"),
    "armwright.simulation.sensitivity": ("sensitivities",),
    "armwright.simulation.simulation": ("Simulation", "simulate"),
    "armwright.results.statistics": ("statistics",),
    "armwright.sweeps.store": ("load_sweep",),
    "armwright.sweeps.sweep": ("Sweep", "sweep"),
    "armwright.simulation.loop.timing": ("Timing",),
    "armwright.trajectory": (
        "Cubic",
        "Fourier",
        "InputShaper",
        "Joined",
        "MinimumJerk",
        "Motion",
        "MotionLimits",
        "PiecewisePolynomial",
        "Quintic",
        "Ramp",
        "Ruckig",
        "SCurve",
        "Sine",
        "Step",
        "Trapezoid",
        "Waypoints",
        "limits_report",
    ),
    "armwright.trajectory.keep_clear": ("check_clearance",),
    "armwright.trajectory.motion_rows": ("load_motion",),
    "armwright.trajectory.cartesian.follow": ("follow_path",),
    "armwright.trajectory.cartesian.motion": ("CartesianMotion",),
    "armwright.trajectory.cartesian.path": ("CartesianPath",),
    "armwright.trajectory.cartesian.segments": ("Arc", "Circle", "Line", "Poses"),
    "armwright.trajectory.cartesian.solve": ("ToolPathSolution", "solve_path"),
    "armwright.trajectory.online": ("ReferenceFilter",),
    "armwright.trajectory.path": ("JointPath",),
    "armwright.pictures.workspace_maps": ("draw_workspace",),
    "armwright.ik.workspace": ("workspace",),
    "armwright.trajectory.time_optimal": ("PathMotion", "time_optimal"),
    "armwright.tuning": ("TuningResult", "tune"),
    "armwright.twin.listen": ("BusListener", "bus_recording", "shadow_bus"),
    "armwright.twin.on_bus": ("scenario_on_bus",),
    "armwright.twin.rehearsal": ("Rehearsal", "rehearse"),
    "armwright.twin.run": ("BusRun", "release_drives", "run_controller"),
    "armwright.twin.twin": ("Twin",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}
_CALLED = {"compile": "compile_arm"}  # inside, nothing is called like Python's own

__all__ = [
    "Arc",
    "ArmEstimate",
    "ArmShadow",
    "ArmwrightError",
    "Batch",
    "BoxObstacle",
    "BusListener",
    "BusRun",
    "CartesianMotion",
    "CartesianPath",
    "Cascade",
    "Circle",
    "CommandFilter",
    "Comparison",
    "CompiledArm",
    "ComputedTorque",
    "Controller",
    "Cubic",
    "DisturbanceObserver",
    "Draw",
    "Estimate",
    "Excitation",
    "ExportedController",
    "ExportedFmu",
    "FeedForward",
    "Filtered",
    "Fourier",
    "FrequencyResponse",
    "FrictionCompensation",
    "GainDesign",
    "GainRegion",
    "InputShaper",
    "Inputs",
    "Joined",
    "JointInertias",
    "JointPID",
    "JointPath",
    "JointReference",
    "Layout",
    "LimitCycle",
    "Limits",
    "Line",
    "LinearLoop",
    "LinearModel",
    "LiveArm",
    "Log",
    "Loop",
    "LoopAnalysis",
    "LoopState",
    "LowPass",
    "Manipulability",
    "Margins",
    "Measurement",
    "MinimumJerk",
    "Model",
    "Motion",
    "MotionLimits",
    "MotorFit",
    "MotorGuess",
    "NoiseGain",
    "Notch",
    "PathMotion",
    "Payload",
    "PiecewisePolynomial",
    "Plan",
    "PlaneObstacle",
    "PoseBranches",
    "PoseSolutions",
    "Poses",
    "Preparation",
    "Quantisation",
    "Quintic",
    "Ramp",
    "Recording",
    "ReferenceFilter",
    "Rehearsal",
    "RobotDescription",
    "Ros2Export",
    "Ruckig",
    "SCurve",
    "Scenario",
    "Schedule",
    "Sensor",
    "Sensors",
    "Shadow",
    "ShadowAlarm",
    "ShadowBandwidths",
    "Signal",
    "Simulation",
    "Sine",
    "Solver",
    "SphereObstacle",
    "Start",
    "Step",
    "Sweep",
    "Timing",
    "ToolPathSolution",
    "Trajectory",
    "Trapezoid",
    "TuningResult",
    "Twin",
    "Validation",
    "Waypoints",
    "analyse_loops",
    "animate",
    "articulated_body",
    "assemble",
    "bias_torques",
    "builtin_names",
    "bus_recording",
    "centre_of_mass",
    "check",
    "check_clearance",
    "choose_preparation",
    "clearance",
    "compare_controllers",
    "compare_experiments",
    "compile",
    "composite_body",
    "convert",
    "copy_examples",
    "coriolis_matrix",
    "design_excitation",
    "design_gains",
    "diff",
    "draw_workspace",
    "energy",
    "enumerate_assemblies",
    "export_controller",
    "export_fmu",
    "export_ros2",
    "fit_armax",
    "fit_arx",
    "fit_n4sid",
    "fit_oe",
    "follow_path",
    "forward_arm",
    "forward_arm_linearised",
    "forward_dynamics",
    "forward_dynamics_derivatives",
    "forward_kinematics",
    "frequency_response",
    "gain_region",
    "gravity_torques",
    "identify_arm",
    "identify_drive_gains",
    "identify_friction",
    "identify_motor",
    "identify_payload",
    "inverse_dynamics",
    "inverse_dynamics_derivatives",
    "inverse_kinematics",
    "jacobian",
    "jacobian_dot_qd",
    "joint_inertias",
    "joint_stops",
    "kinetic_energy",
    "limit_cycle",
    "limits_report",
    "load",
    "load_motion",
    "load_run",
    "load_sweep",
    "longest_period",
    "manipulability",
    "mass_matrix",
    "motor_current",
    "motor_experiment",
    "motor_torque",
    "motor_voltage",
    "new_robot",
    "noise_gain",
    "operational_inertia",
    "passing_verdict",
    "plan",
    "plot",
    "plot_experiment",
    "plot_log",
    "pose_towards",
    "potential_energy",
    "prepare_log",
    "quantisation",
    "rank_assemblies",
    "read_log",
    "read_modules",
    "read_scenario",
    "read_schedule",
    "read_task",
    "regressor",
    "regressor_drive",
    "rehearse",
    "release_drives",
    "reproduce",
    "run_controller",
    "sampled_system",
    "save",
    "scenario_on_bus",
    "sensitivities",
    "shadow_bus",
    "shadow_log",
    "show",
    "simulate",
    "solve_path",
    "spring_torques",
    "state_space",
    "statistics",
    "step_study",
    "stored_verdict",
    "sweep",
    "time_optimal",
    "to_toml",
    "tune",
    "validate",
    "workspace",
    "write_into",
    "write_log",
    "write_parts",
    "write_report",
    "write_scenario",
    "write_shadow",
    "write_toml",
    "write_verdict",
    "zero_order_hold",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        from armwright.other_names import advice

        text = f"module 'armwright' has no attribute {name!r}{advice(name, _HOME)}"
        raise AttributeError(text, name=name, obj=sys.modules[__name__])  # Python adds the nearest name
    value = getattr(importlib.import_module(_HOME[name]), _CALLED.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
