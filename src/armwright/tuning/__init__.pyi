"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.tuning.options import MarginConstraint as MarginConstraint, Search as Search
from armwright.tuning.result import TuningResult as TuningResult
from armwright.tuning.search import Tried as Tried
from armwright.tuning.tune import tune as tune
