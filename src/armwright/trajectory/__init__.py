"""Motions: positions of the arm as functions of time, and their limits."""

from armwright.trajectory.fourier import Fourier
from armwright.trajectory.input_shaper import InputShaper
from armwright.trajectory.joined import Joined
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.limits_report import limits_report
from armwright.trajectory.minimum_jerk import MinimumJerk
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial
from armwright.trajectory.ramp import Ramp
from armwright.trajectory.rest_to_rest import Cubic, Quintic
from armwright.trajectory.s_curve import SCurve
from armwright.trajectory.sine import Sine
from armwright.trajectory.state_to_state import Ruckig
from armwright.trajectory.step import Step
from armwright.trajectory.trapezoid import Trapezoid
from armwright.trajectory.waypoints import Waypoints

__all__ = [
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
]
