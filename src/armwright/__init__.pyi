"""The public names and where each lives: for type checkers, and for `armwright.lazy`, which imports one when it is first used."""

from armwright.actuators import (
    motor_current as motor_current,
    motor_torque as motor_torque,
    motor_voltage as motor_voltage,
)
from armwright.collision import (
    BoxObstacle as BoxObstacle,
    PlaneObstacle as PlaneObstacle,
    SphereObstacle as SphereObstacle,
    clearance as clearance,
)
from armwright.control import (
    Cascade as Cascade,
    ComputedTorque as ComputedTorque,
    DisturbanceObserver as DisturbanceObserver,
    FeedForward as FeedForward,
    Filtered as Filtered,
    FrictionCompensation as FrictionCompensation,
    JointPID as JointPID,
    LowPass as LowPass,
    Notch as Notch,
)
from armwright.control.analysis.analyse import LoopAnalysis as LoopAnalysis, analyse_loops as analyse_loops
from armwright.control.analysis.hold import sampled_system as sampled_system, zero_order_hold as zero_order_hold
from armwright.control.analysis.limit_cycles import LimitCycle as LimitCycle, limit_cycle as limit_cycle
from armwright.control.analysis.linear_loop import LinearLoop as LinearLoop, Margins as Margins
from armwright.control.analysis.noise import (
    NoiseGain as NoiseGain,
    Quantisation as Quantisation,
    noise_gain as noise_gain,
    quantisation as quantisation,
)
from armwright.control.analysis.regions import (
    GainRegion as GainRegion,
    gain_region as gain_region,
    longest_period as longest_period,
)
from armwright.control.analysis.workspace import JointInertias as JointInertias, joint_inertias as joint_inertias
from armwright.control.comparison.compare import Comparison as Comparison, compare_controllers as compare_controllers
from armwright.control.design import GainDesign as GainDesign, design_gains as design_gains, state_space as state_space
from armwright.description import RobotDescription as RobotDescription, builtin_names as builtin_names
from armwright.description.writer import to_toml as to_toml, write_toml as write_toml
from armwright.dynamics import (
    articulated_body as articulated_body,
    bias_torques as bias_torques,
    centre_of_mass as centre_of_mass,
    composite_body as composite_body,
    coriolis_matrix as coriolis_matrix,
    energy as energy,
    forward_arm as forward_arm,
    forward_arm_linearised as forward_arm_linearised,
    forward_dynamics as forward_dynamics,
    forward_dynamics_derivatives as forward_dynamics_derivatives,
    gravity_torques as gravity_torques,
    inverse_dynamics as inverse_dynamics,
    inverse_dynamics_derivatives as inverse_dynamics_derivatives,
    kinetic_energy as kinetic_energy,
    mass_matrix as mass_matrix,
    operational_inertia as operational_inertia,
    potential_energy as potential_energy,
    regressor as regressor,
    regressor_drive as regressor_drive,
    spring_torques as spring_torques,
)
from armwright.errors import ArmwrightError as ArmwrightError
from armwright.examples import copy_examples as copy_examples
from armwright.export.controller.write import (
    ExportedController as ExportedController,
    export_controller as export_controller,
)
from armwright.export.fmu.write import ExportedFmu as ExportedFmu, export_fmu as export_fmu
from armwright.export.ros2 import Ros2Export as Ros2Export, export_ros2 as export_ros2
from armwright.identification.arm.drive_gains import identify_drive_gains as identify_drive_gains
from armwright.identification.arm.friction import identify_friction as identify_friction
from armwright.identification.arm.identify import ArmEstimate as ArmEstimate, identify_arm as identify_arm
from armwright.identification.arm.payload import identify_payload as identify_payload
from armwright.identification.estimate import Estimate as Estimate, write_into as write_into
from armwright.identification.experiments.excitation import (
    Excitation as Excitation,
    design_excitation as design_excitation,
)
from armwright.identification.experiments.expected import compare_experiments as compare_experiments
from armwright.identification.experiments.motor import MotorGuess as MotorGuess, motor_experiment as motor_experiment
from armwright.identification.experiments.plot import plot_experiment as plot_experiment
from armwright.identification.linear.fit import fit_armax as fit_armax, fit_arx as fit_arx, fit_oe as fit_oe
from armwright.identification.linear.frequency import (
    FrequencyResponse as FrequencyResponse,
    frequency_response as frequency_response,
)
from armwright.identification.linear.model import LinearModel as LinearModel
from armwright.identification.linear.n4sid import fit_n4sid as fit_n4sid
from armwright.identification.logs.log import Log as Log
from armwright.identification.logs.plot import plot_log as plot_log
from armwright.identification.logs.preparation import (
    Preparation as Preparation,
    choose_preparation as choose_preparation,
)
from armwright.identification.logs.prepared import prepare_log as prepare_log
from armwright.identification.logs.read import read_log as read_log
from armwright.identification.logs.write import write_log as write_log
from armwright.identification.motor.identify import MotorFit as MotorFit, identify_motor as identify_motor
from armwright.identification.validation.limits import Limits as Limits
from armwright.identification.validation.report import write_report as write_report
from armwright.identification.validation.validate import Validation as Validation, validate as validate
from armwright.identification.validation.verdict import (
    passing_verdict as passing_verdict,
    stored_verdict as stored_verdict,
    write_verdict as write_verdict,
)
from armwright.ik.measures import Manipulability as Manipulability, manipulability as manipulability
from armwright.ik.solutions import PoseBranches as PoseBranches, PoseSolutions as PoseSolutions
from armwright.ik.solve import inverse_kinematics as inverse_kinematics
from armwright.ik.targets import pose_towards as pose_towards
from armwright.ik.workspace import workspace as workspace
from armwright.interfaces import (
    Controller as Controller,
    JointReference as JointReference,
    Measurement as Measurement,
    Sensor as Sensor,
    Trajectory as Trajectory,
)
from armwright.kernels.compiled import CompiledArm as CompiledArm, compile_arm
from armwright.kinematics import (
    forward_kinematics as forward_kinematics,
    jacobian as jacobian,
    jacobian_dot_qd as jacobian_dot_qd,
)
from armwright.model import Model as Model
from armwright.model.load import load as load
from armwright.modules.assemble import assemble as assemble
from armwright.modules.assembly import read_modules as read_modules
from armwright.modules.enumerate import enumerate_assemblies as enumerate_assemblies
from armwright.modules.rank import rank_assemblies as rank_assemblies
from armwright.modules.task import read_task as read_task
from armwright.motions.plan import Plan as Plan, plan as plan
from armwright.parameters import Batch as Batch, Draw as Draw
from armwright.parts.write import write_parts as write_parts
from armwright.pictures.animate import animate as animate
from armwright.pictures.live import LiveArm as LiveArm
from armwright.pictures.show import show as show
from armwright.pictures.workspace_maps import draw_workspace as draw_workspace
from armwright.results.plot import plot as plot
from armwright.results.recording import save as save
from armwright.results.run_file import load_run as load_run
from armwright.results.statistics import statistics as statistics
from armwright.robotfiles import check as check, convert as convert, diff as diff, new_robot as new_robot
from armwright.scenarios import read_scenario as read_scenario, reproduce as reproduce, write_scenario as write_scenario
from armwright.shadow.alarms import ShadowAlarm as ShadowAlarm
from armwright.shadow.observer import ShadowBandwidths as ShadowBandwidths
from armwright.shadow.page import write_shadow as write_shadow
from armwright.shadow.shadow import ArmShadow as ArmShadow, Shadow as Shadow, shadow_log as shadow_log
from armwright.signals import Layout as Layout, Signal as Signal
from armwright.simulation.inputs.payload import Payload as Payload
from armwright.simulation.inputs.schedule import Schedule as Schedule, read_schedule as read_schedule
from armwright.simulation.integrate.events import joint_stops as joint_stops
from armwright.simulation.loop.command_filter import CommandFilter as CommandFilter
from armwright.simulation.loop.sensors import Sensors as Sensors
from armwright.simulation.loop.state import LoopState as LoopState
from armwright.simulation.loop.timing import Timing as Timing
from armwright.simulation.scenario import Scenario as Scenario
from armwright.simulation.scenario_parts import (
    Inputs as Inputs,
    Loop as Loop,
    Recording as Recording,
    Solver as Solver,
    Start as Start,
)
from armwright.simulation.sensitivity import sensitivities as sensitivities
from armwright.simulation.simulation import Simulation as Simulation, simulate as simulate
from armwright.simulation.step_study import step_study as step_study
from armwright.sweeps.store import load_sweep as load_sweep
from armwright.sweeps.sweep import Sweep as Sweep, sweep as sweep
from armwright.trajectory import (
    Cubic as Cubic,
    Fourier as Fourier,
    InputShaper as InputShaper,
    Joined as Joined,
    MinimumJerk as MinimumJerk,
    Motion as Motion,
    MotionLimits as MotionLimits,
    PiecewisePolynomial as PiecewisePolynomial,
    Quintic as Quintic,
    Ramp as Ramp,
    Ruckig as Ruckig,
    SCurve as SCurve,
    Sine as Sine,
    Step as Step,
    Trapezoid as Trapezoid,
    Waypoints as Waypoints,
    limits_report as limits_report,
)
from armwright.trajectory.cartesian.follow import follow_path as follow_path
from armwright.trajectory.cartesian.motion import CartesianMotion as CartesianMotion
from armwright.trajectory.cartesian.path import CartesianPath as CartesianPath
from armwright.trajectory.cartesian.segments import Arc as Arc, Circle as Circle, Line as Line, Poses as Poses
from armwright.trajectory.cartesian.solve import ToolPathSolution as ToolPathSolution, solve_path as solve_path
from armwright.trajectory.keep_clear import check_clearance as check_clearance
from armwright.trajectory.motion_rows import load_motion as load_motion
from armwright.trajectory.online import ReferenceFilter as ReferenceFilter
from armwright.trajectory.path import JointPath as JointPath
from armwright.trajectory.time_optimal import PathMotion as PathMotion, time_optimal as time_optimal
from armwright.tuning import TuningResult as TuningResult, tune as tune
from armwright.twin.listen import BusListener as BusListener, bus_recording as bus_recording, shadow_bus as shadow_bus
from armwright.twin.on_bus import scenario_on_bus as scenario_on_bus
from armwright.twin.rehearsal import Rehearsal as Rehearsal, rehearse as rehearse
from armwright.twin.run import BusRun as BusRun, release_drives as release_drives, run_controller as run_controller
from armwright.twin.twin import Twin as Twin

__version__: str

compile = compile_arm
