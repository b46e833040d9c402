"""The rule that "auto" steps are taken by: explicit, or linearly implicit where the arm is stiff."""

from __future__ import annotations

import numpy as np

from armwright.simulation.plant.step_limits import StepLimit, full_voltage

STIFF = 2e4  # [1/s] from which on a linearly implicit step, at the price of some five explicit ones, takes a millisecond sooner
WINDING = 1e3  # [1/s] of a current: one that settles within a millisecond leaves rk3 with exact currents order 1


def auto_rule(limit: StepLimit) -> str:
    """The rule for an arm: "rodas3" if a mode of it dies away fast at some pose, speed or stop; else "auto", which is rk3.

    The record's own numbers decide, for lanes that vary them too, so that all lanes are moved by one rule.
    """
    command = full_voltage(limit.model)
    rates = limit.rates(command)
    dying = np.abs(rates[-np.real(rates) > np.abs(np.imag(rates))])
    currents = np.abs(limit.exact_rates("current", command))
    return "rodas3" if dying.max(initial=0.0) > STIFF or currents.max(initial=0.0) > WINDING else "auto"
