"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.motions.plan import Plan as Plan, plan as plan
from armwright.trajectory.cartesian.follow import ToolLimits as ToolLimits, follow_path as follow_path
from armwright.trajectory.cartesian.motion import CartesianMotion as CartesianMotion
from armwright.trajectory.cartesian.path import CartesianPath as CartesianPath
from armwright.trajectory.cartesian.pieces import PathPoints as PathPoints
from armwright.trajectory.cartesian.segments import Arc as Arc, Circle as Circle, Line as Line, Poses as Poses
from armwright.trajectory.cartesian.solve import ToolPathSolution as ToolPathSolution, solve_path as solve_path
from armwright.trajectory.fourier import Fourier as Fourier
from armwright.trajectory.input_shaper import InputShaper as InputShaper
from armwright.trajectory.joined import Joined as Joined
from armwright.trajectory.keep_clear import check_clearance as check_clearance
from armwright.trajectory.limits import MotionLimits as MotionLimits
from armwright.trajectory.limits_report import LimitsReport as LimitsReport, limits_report as limits_report
from armwright.trajectory.minimum_jerk import MinimumJerk as MinimumJerk
from armwright.trajectory.motion import Motion as Motion
from armwright.trajectory.motion_files import load_motion as load_motion
from armwright.trajectory.online import ReferenceFilter as ReferenceFilter
from armwright.trajectory.path import JointPath as JointPath
from armwright.trajectory.piecewise import PiecewisePolynomial as PiecewisePolynomial
from armwright.trajectory.ramp import Ramp as Ramp
from armwright.trajectory.rest_to_rest import Cubic as Cubic, Quintic as Quintic
from armwright.trajectory.s_curve import SCurve as SCurve
from armwright.trajectory.sine import Sine as Sine
from armwright.trajectory.state_to_state import Ruckig as Ruckig
from armwright.trajectory.step import Step as Step
from armwright.trajectory.time_optimal import PathMotion as PathMotion, time_optimal as time_optimal
from armwright.trajectory.trapezoid import Trapezoid as Trapezoid
from armwright.trajectory.waypoints import Waypoints as Waypoints
