"""Analysis of sampled loops: linear maps at a pose, margins, and their range over the workspace."""

from armwright.control.analysis.hold import Held, sampled_system, zero_order_hold
from armwright.control.analysis.linear_loop import LinearLoop, Margins
from armwright.control.analysis.small_signal import small_signal_arm

__all__ = ["Held", "LinearLoop", "Margins", "sampled_system", "small_signal_arm", "zero_order_hold"]
