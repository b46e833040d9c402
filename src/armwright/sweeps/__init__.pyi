"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.sweeps.store import load_sweep as load_sweep
from armwright.sweeps.sweep import Sweep as Sweep, sweep as sweep
