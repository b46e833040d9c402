"""Power balance: what comes in is heat, friction and work, or is stored; energies integrated by the same stages."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.simulation.plant import Plant
from simulation.plants import COULOMB, ELASTIC, MANY, MOTOR, STOPS, SUPPLY, pendulum, with_energies


def missing(arm, u, h, duration=0.1, q=0.3, qd=0.5):
    """The energy that the balance lacks, as a share of the largest that went any way."""
    plant = Plant.of(arm)
    x = plant.initial(np.full(arm.n, q), np.full(arm.n, qd))
    last, went = with_energies(plant, x, u, h, round(duration / h))
    stored = float(plant.stored_energy(last)) - float(plant.stored_energy(x))
    lack = went["electrical"] - went["heat"] - went["friction"] - went["mechanical"] - stored
    return abs(lack) / max(abs(value) for value in went.values())


@pytest.mark.parametrize("name", [name for name in MANY if name != "supply"])
def test_power_balances(name):
    assert missing(MANY[name], [12.0, 8.0][: MANY[name].n], 1e-4) < 1e-6


def test_power_balances_when_a_motor_feeds_the_bus():
    """Driven backwards, the bus rises until the chopper burns what comes."""
    arm = pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": SUPPLY})
    assert missing(arm, [-8.0], 1e-4, qd=9.0) < 1e-6


@pytest.mark.parametrize("what", ["stops", "backlash"])
def test_where_contacts_switch_it_shrinks_with_the_step(what):
    arm = {
        "stops": pendulum(motor=MOTOR, friction=COULOMB, stops=STOPS, limits={"position_rad": [-1.0, 0.35]}),
        "backlash": pendulum(motor=MOTOR, friction=COULOMB, elasticity={**ELASTIC, "backlash_rad": 0.002}),
    }[what]
    lacks = [missing(arm, [2.0], 1e-3 / 2**k, duration=0.2, qd=0.8) for k in range(5)]
    assert lacks[-1] < 1e-5
    assert lacks[-1] < 0.2 * lacks[0]


def test_powers_of_a_wrench():
    """The arm that is pushed does negative work on its environment."""
    plant = Plant.of(MANY["plain"])
    x, wrench = plant.initial([0.0], [2.0]), np.array([0.0, 0.0, -5.0, 0.0, 0.0, 0.0])
    assert plant.energy_rates(x, [0.0], wrench)["mechanical"] == pytest.approx(0.0)  # the tip is the joint's own frame
    turned = np.array([0.0, 0.0, 0.0, 0.0, 3.0, 0.0])
    assert plant.energy_rates(x, [0.0], turned)["mechanical"] == pytest.approx(-6.0)
