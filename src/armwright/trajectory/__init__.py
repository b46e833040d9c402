"""Named references: where the arm should be, as functions of time."""

from armwright.trajectory.fourier import Fourier
from armwright.trajectory.quintic import Quintic
from armwright.trajectory.ramp import Ramp
from armwright.trajectory.sine import Sine
from armwright.trajectory.step import Step

__all__ = ["Fourier", "Quintic", "Ramp", "Sine", "Step"]
