"""Motions: where the arm should be, as functions of time, and the limits that they keep."""

from armwright.trajectory.fourier import Fourier
from armwright.trajectory.limits import MotionLimits, limits_report
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial
from armwright.trajectory.quintic import Quintic
from armwright.trajectory.ramp import Ramp
from armwright.trajectory.sine import Sine
from armwright.trajectory.step import Step

__all__ = [
    "Fourier",
    "Motion",
    "MotionLimits",
    "PiecewisePolynomial",
    "Quintic",
    "Ramp",
    "Sine",
    "Step",
    "limits_report",
]
