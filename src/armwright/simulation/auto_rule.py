"""The rule that "auto" steps are taken by: explicit, or linearly implicit where the arm is stiff."""

from __future__ import annotations

import numpy as np

from armwright.simulation.plant.drives import STIFF as EXACT
from armwright.simulation.plant.step_limits import StepLimit, full_voltage

STIFF = 6e3  # [1/s] of a mode that dies away: from here on linearly implicit steps, at twice the price, are sooner done
LONG = 15  # joints: the linearly implicit step of a longer arm takes minutes to compile
WINDING = 1e3  # [1/s] of a current: one that settles within a millisecond leaves rk3 with exact currents order 1


def auto_rule(limit: StepLimit, *, sampled: bool = True) -> str:
    """The rule for an arm: "rodas3" if a mode of it dies away fast at some pose, speed or stop; else "auto", which is rk3.

    Where nothing is sampled, the latter is "rk45", whose steps are as long as the motion lets them be; fast currents, bristles
    and the bus, which rk3 integrates exactly, are then modes like others. Arms of more than `LONG` joints are never moved by
    "rodas3". Such whose coupled motors stick by themselves are moved by rk3. The record's own numbers decide, for lanes that
    vary them too, so that all lanes are moved by one rule.
    """
    sticking = limit.plant.sticking
    if sticking is not None and not sticking.by_joints:
        return "auto"
    explicit = "auto" if sampled else "rk45"
    if limit.model.n > LONG:
        return explicit
    command = full_voltage(limit.model)
    rates = limit.rates(command)
    dying = np.abs(rates[-np.real(rates) > np.abs(np.imag(rates))]).max(initial=0.0)
    exact = {name: np.abs(limit.exact_rates(name, command)).max(initial=0.0) for name in EXACT}
    fast = exact["current"] > WINDING if sampled else max(exact.values()) > STIFF
    return "rodas3" if dying > STIFF or fast else explicit
