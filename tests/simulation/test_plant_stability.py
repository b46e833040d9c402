"""The step check of plants with more states: what is integrated exactly is no limit, what is not is found and named."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.errors import ScenarioError
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.step_limits import StepLimit
from simulation.plants import COULOMB, ELASTIC, LUGRE, MANY, MOTOR, RK3, STOPS, pendulum, steps

NOTHING = np.zeros(1)
STEEP = {**LUGRE, "bristle_stiffness_n_m_per_rad": 1e5, "bristle_damping_n_m_s_per_rad": 5e3}


def largest(arm, rule=RK3):
    return StepLimit(arm).largest_step(rule, np.zeros(arm.n))


@pytest.mark.parametrize("inductance", [1e-7, 1e-5])
@pytest.mark.parametrize("rule", INTEGRATORS.values(), ids=INTEGRATORS)
def test_a_fast_winding_costs_no_step(rule, inductance):
    """L/R far below the step: the motor may step as the one without inductance."""
    arm = pendulum(motor={**MOTOR, "inductance_h": inductance}, friction=COULOMB)
    assert largest(arm, rule) > 0.5 * largest(MANY["plain"], rule)
    plant = Plant.of(arm)
    run = steps(plant, plant.initial([0.1], [0.3]), [3.0], 0.9 * largest(arm, rule), 500, rule=rule)
    assert np.abs(run).max() < 10.0


@pytest.mark.parametrize(
    "arm",
    [
        pendulum(motor=MOTOR, friction=STEEP),
        pendulum(motor=MOTOR, friction=COULOMB, elasticity={**ELASTIC, "damping_n_m_s_per_rad": 4e3}),
    ],
    ids=["bristle damping", "elasticity"],
)
def test_what_stays_explicit_is_refused_with_the_step_that_would_do(arm):
    step, plant = largest(arm), Plant.of(arm)
    x = plant.initial([0.1], [0.3])
    bounded, wild = (np.abs(steps(plant, x, [3.0], factor * step, 400)[:, 1]).max() for factor in (0.9, 4.0))
    assert bounded < 5.0
    assert plant.stiff or not wild < 20.0  # a bristle's damper is soft again when it slides: that arm rattles
    with pytest.raises(ScenarioError, match=r"too large for the fastest time constant of .* expected .* s or less"):
        StepLimit(arm).check_step("rk3", RK3, 4.0 * step, NOTHING[None])
    StepLimit(arm).check_step("rk3", RK3, 0.9 * step, NOTHING[None])


@pytest.mark.parametrize("what", ["stops", "backlash"])
def test_contacts_count_before_they_are_touched(what):
    """The swing of a stop's spring, and of flanks in touch, is followed though the arm stands elsewhere."""
    arm, stiffness, inertia = {
        "stops": (pendulum(motor=MOTOR, stops=STOPS, limits={"position_rad": [-1.0, 1.0]}), 5e3, 0.87),
        "backlash": (pendulum(motor=MOTOR, elasticity={**ELASTIC, "backlash_rad": 0.01}), 4e3, 0.5 * 0.37 / 0.87),
    }[what]
    assert largest(arm) == pytest.approx(0.5 / np.sqrt(stiffness / inertia), rel=0.1)
