"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.control.analysis.analyse import LoopAnalysis as LoopAnalysis, analyse_loops as analyse_loops
from armwright.control.analysis.hold import (
    Held as Held,
    sampled_system as sampled_system,
    zero_order_hold as zero_order_hold,
)
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
from armwright.control.analysis.remedies import LoopRemedies as LoopRemedies
from armwright.control.analysis.workspace import JointInertias as JointInertias, joint_inertias as joint_inertias
from armwright.control.comparison.compare import Comparison as Comparison, compare_controllers as compare_controllers
from armwright.control.design import GainDesign as GainDesign, design_gains as design_gains, state_space as state_space
from armwright.control.design.limiting import JointLimit as JointLimit
from armwright.simulation.plant.linearised import Slopes as Slopes
