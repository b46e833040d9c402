"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.identification.arm.arm_estimate import ArmEstimate as ArmEstimate
from armwright.identification.arm.drive_gains import identify_drive_gains as identify_drive_gains
from armwright.identification.arm.friction import identify_friction as identify_friction
from armwright.identification.arm.identify import identify_arm as identify_arm
from armwright.identification.arm.options import ArmTerms as ArmTerms, FitRows as FitRows
from armwright.identification.arm.payload import identify_payload as identify_payload
from armwright.identification.estimate import Estimate as Estimate, write_into as write_into
from armwright.identification.experiments.excitation import (
    Excitation as Excitation,
    design_excitation as design_excitation,
)
from armwright.identification.experiments.expected import (
    ExperimentComparison as ExperimentComparison,
    compare_experiments as compare_experiments,
)
from armwright.identification.experiments.motor import (
    MotorExperiment as MotorExperiment,
    MotorGuess as MotorGuess,
    motor_experiment as motor_experiment,
)
from armwright.identification.experiments.plot import plot_experiment as plot_experiment
from armwright.identification.geometry.calibrate import calibrate as calibrate
from armwright.identification.geometry.calibration import Calibration as Calibration
from armwright.identification.geometry.measurement_file import read_measurements as read_measurements
from armwright.identification.geometry.measurements import Measured as Measured, Measurements as Measurements
from armwright.identification.geometry.poses import CalibrationPoses as CalibrationPoses, design_poses as design_poses
from armwright.identification.linear.actuator import IdentifiedActuator as IdentifiedActuator
from armwright.identification.linear.fit import fit_armax as fit_armax, fit_arx as fit_arx, fit_oe as fit_oe
from armwright.identification.linear.frequency import (
    FrequencyResponse as FrequencyResponse,
    frequency_response as frequency_response,
)
from armwright.identification.linear.model import LinearModel as LinearModel
from armwright.identification.linear.n4sid import SubspaceMethod as SubspaceMethod, fit_n4sid as fit_n4sid
from armwright.identification.linear.records import LogSignals as LogSignals
from armwright.identification.linear.selection import OrderSearch as OrderSearch
from armwright.identification.linear.state_space import FilteredSensor as FilteredSensor, StateSpace as StateSpace
from armwright.identification.logs.blocks import Block as Block
from armwright.identification.logs.log import Log as Log, LogRun as LogRun
from armwright.identification.logs.plot import plot_log as plot_log
from armwright.identification.logs.preparation import (
    Preparation as Preparation,
    choose_preparation as choose_preparation,
)
from armwright.identification.logs.prepared import prepare_log as prepare_log
from armwright.identification.logs.read import read_log as read_log
from armwright.identification.logs.write import write_log as write_log
from armwright.identification.motor.identify import identify_motor as identify_motor
from armwright.identification.motor.measured import MotorReading as MotorReading
from armwright.identification.motor.problem import MotorSearch as MotorSearch
from armwright.identification.motor.report import MotorFit as MotorFit
from armwright.identification.servo.bench import ServoLoop as ServoLoop
from armwright.identification.servo.bench_log import BenchLog as BenchLog, read_bench_log as read_bench_log
from armwright.identification.servo.identify import ServoSearch as ServoSearch, identify_servo as identify_servo
from armwright.identification.servo.servo_fit import OrderErrors as OrderErrors, ServoFit as ServoFit
from armwright.identification.validation.joint_measures import JointMeasures as JointMeasures
from armwright.identification.validation.limits import Limits as Limits
from armwright.identification.validation.validate import Validation as Validation, validate as validate
from armwright.identification.validation.verdict import (
    StoredVerdict as StoredVerdict,
    passing_verdict as passing_verdict,
    stored_verdict as stored_verdict,
    write_verdict as write_verdict,
)
from armwright.identification.weighing.measured_number import MeasuredNumber as MeasuredNumber
from armwright.identification.weighing.record import write_measured as write_measured
from armwright.identification.weighing.rules import (
    measured_centre as measured_centre,
    measured_inertia_bifilar as measured_inertia_bifilar,
    measured_inertia_pendulum as measured_inertia_pendulum,
    measured_mass as measured_mass,
    measured_tensor as measured_tensor,
)
