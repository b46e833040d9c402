"""Controllers of arms: small frozen records of gains that are traced into the simulation's loop."""

from armwright.control.cascade import Cascade
from armwright.control.computed_torque import ComputedTorque
from armwright.control.disturbance_observer import DisturbanceObserver
from armwright.control.feed_forward import FeedForward
from armwright.control.filters import Filtered, LowPass, Notch
from armwright.control.friction_compensation import FrictionCompensation
from armwright.control.joint_pid import JointPID

__all__ = [
    "Cascade",
    "ComputedTorque",
    "DisturbanceObserver",
    "FeedForward",
    "Filtered",
    "FrictionCompensation",
    "JointPID",
    "LowPass",
    "Notch",
]
