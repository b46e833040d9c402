"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.scenarios.reproduce import Reproduction as Reproduction
from armwright.simulation.inputs.schedule import read_schedule as read_schedule
from armwright.simulation.integrate.events import joint_stops as joint_stops
from armwright.simulation.loop.compiled import CompiledLoop as CompiledLoop
from armwright.simulation.loop.state import LoopState as LoopState
from armwright.simulation.sensitivity import sensitivities as sensitivities
from armwright.simulation.simulation import Simulation as Simulation
from armwright.simulation.step_study import StepStudy as StepStudy, Trial as Trial, step_study as step_study
