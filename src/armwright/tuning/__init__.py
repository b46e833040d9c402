"""Tuning: search for the gains of a scenario's controller over many simulations, under a margin constraint."""

from armwright.tuning.result import TuningResult
from armwright.tuning.tune import tune

__all__ = ["TuningResult", "tune"]
