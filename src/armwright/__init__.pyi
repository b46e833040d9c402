"""The public names and where each lives: for type checkers, and for `armwright.lazy`, which imports one when it is first used."""

from armwright.actuators import (
    motor_current as motor_current,
    motor_torque as motor_torque,
    motor_voltage as motor_voltage,
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
from armwright.description import RobotDescription as RobotDescription, builtin_names as builtin_names
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
from armwright.identification.geometry.calibrate import calibrate as calibrate
from armwright.ik.solve import inverse_kinematics as inverse_kinematics
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
from armwright.model.payload import Payload as Payload
from armwright.parameters import Batch as Batch, Draw as Draw
from armwright.pictures.animate import animate as animate
from armwright.pictures.show import show as show
from armwright.results.plot import plot as plot
from armwright.results.recording import save as save
from armwright.results.run_file import load_run as load_run
from armwright.results.statistics import statistics as statistics
from armwright.scenarios import read_scenario as read_scenario, reproduce as reproduce, write_scenario as write_scenario
from armwright.signals import Layout as Layout, Signal as Signal
from armwright.simulation.inputs.schedule import Schedule as Schedule
from armwright.simulation.loop.command_filter import CommandFilter as CommandFilter
from armwright.simulation.loop.sensors import Sensors as Sensors
from armwright.simulation.loop.timing import Timing as Timing
from armwright.simulation.scenario import Scenario as Scenario
from armwright.simulation.scenario_parts import (
    Inputs as Inputs,
    Loop as Loop,
    Recording as Recording,
    Solver as Solver,
    Start as Start,
)
from armwright.simulation.simulation import simulate as simulate

from . import (
    collision as collision,
    export as export,
    identification as identification,
    interop as interop,
    kinematics as kinematics,
    modules as modules,
    pictures as pictures,
    robotfiles as robotfiles,
    shadow as shadow,
    simulation as simulation,
    sweeps as sweeps,
    trajectory,
    tuning as tuning,
    twin,
)
from .control import analysis

__version__: str

compile = compile_arm
bus = twin
loops = analysis
trajectories = trajectory
