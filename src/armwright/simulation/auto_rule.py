"""The rule that "auto" steps are taken by: explicit, or linearly implicit where the arm is stiff."""

from __future__ import annotations

import numpy as np

from armwright.simulation.plant.step_limits import StepLimit, full_voltage

STIFF = 6e3  # [1/s] of a mode that dies away: from here on linearly implicit steps, at twice the price, are sooner done
LONG = 15  # joints: the linearly implicit step of a longer arm takes minutes to compile
WINDING = 1e3  # [1/s] of a current: one that settles within a millisecond leaves rk3 with exact currents order 1


def auto_rule(limit: StepLimit) -> str:
    """The rule for an arm: "rodas3" if a mode of it dies away fast at some pose, speed or stop; else "auto", which is rk3.

    Arms of more than `LONG` joints stay with rk3, and such whose coupled motors stick by themselves. The record's own numbers
    decide, for lanes that vary them too, so that all lanes are moved by one rule.
    """
    sticking = limit.plant.sticking
    if limit.model.n > LONG or (sticking is not None and not sticking.by_joints):
        return "auto"
    command = full_voltage(limit.model)
    rates = limit.rates(command)
    dying = np.abs(rates[-np.real(rates) > np.abs(np.imag(rates))])
    currents = np.abs(limit.exact_rates("current", command))
    return "rodas3" if dying.max(initial=0.0) > STIFF or currents.max(initial=0.0) > WINDING else "auto"
