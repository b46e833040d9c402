"""The step check of plants with more states: what is integrated exactly is no limit, what is not is found and named."""

from __future__ import annotations

import re

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.step_limits import StepLimit
from raises_at import raises_at
from simulation.plants import COULOMB, ELASTIC, LUGRE, MANY, MOTOR, RK3, STOPS, SUPPLY, pendulum, steps

NOTHING = np.zeros(1)
STEEP = {**LUGRE, "bristle_stiffness_n_m_per_rad": 1e5, "bristle_damping_n_m_s_per_rad": 5e3}


def largest(arm, rule=RK3):
    return StepLimit(arm).largest_step(rule, np.zeros(arm.n))


@pytest.mark.sample(2)
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
    with raises_at(ScenarioError, "step", r"[0-9.e-]+ s; or", value=4.0 * step):
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


def refused(arm, step, command):
    """The time constant [s] that the refusal of a step names."""
    with pytest.raises(ScenarioError) as raised:
        StepLimit(arm).check_step("rk3", RK3, step, np.array([command]))
    return float(re.search(r"time constant of \w+, (\S+) s", raised.value.what)[1])


WEAK = {**SUPPLY, "source_resistance_ohm": 4.0, "capacitance_f": 1e-4}


def test_a_motor_that_loads_its_bus_is_the_fastest_constant():
    """At full voltage C (1/R_s + 1/R)⁻¹ = 92 µs, of which the motor's part is explicit; the arm's own constants are 15 ms."""
    arm, u = pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": WEAK}), [60.0]
    assert refused(arm, 1e-3, u) == pytest.approx(1e-4 / (1.0 / 4.0 + 1.0 / 1.2), rel=0.02)
    plant = Plant.of(arm)
    x, largest = plant.initial([0.1], [0.3]), StepLimit(arm).largest_step(RK3, np.array(u))
    true, calm, wild = (steps(plant, x, u, h, round(6e-3 / h))[-1, -1] for h in (1e-5, 0.9 * largest, 2.0 * largest))
    assert calm == pytest.approx(true, rel=0.05)
    assert abs(wild - true) > 0.2 * true  # steps that pass 0 V leave the bus empty


def test_the_source_of_a_bus_costs_no_step():
    """Its R_s C is integrated exactly, also where the bus begins: at the source's voltage, where the rectifier opens."""
    for capacitance in (5e-3, 1e-5):
        arm = pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": {**SUPPLY, "capacitance_f": capacitance}})
        assert largest(arm) > 0.9 * largest(MANY["plain"])
        assert refused(arm, 0.1, [0.0]) == pytest.approx(refused(MANY["plain"], 0.1, [0.0]), rel=0.05)


def test_a_loop_is_refused_for_full_voltage_on_its_bus():
    """Its commands are not known before; those of a schedule are, and 1 V from 48 V does not load the bus."""
    arm = pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": WEAK})
    with raises_at(ScenarioError, "step", r"chain, 9.* s, by substeps = "):
        aw.simulate(
            aw.Scenario(arm, 0.1, loop=aw.Loop(controller=aw.JointPID(kp=1.0), period=1e-3), solver=aw.Solver("rk3"))
        )
    assert aw.simulate(aw.Scenario(arm, 0.1, command=[1.0])).bus_voltage.values.min() > 40.0


@pytest.mark.parametrize("robot", [{}, {"supply": SUPPLY}], ids=["no supply", "supply"])
def test_the_swing_of_an_elastic_gear_is_named(robot):
    """Not the current's constant, which is shorter and exact, nor another of the arm."""
    arm = pendulum(motor={**MOTOR, "inductance_h": 1e-4}, friction=COULOMB, elasticity=ELASTIC, robot=robot)
    assert refused(arm, 0.01, [0.0]) == pytest.approx(np.sqrt(0.5 * 0.37 / 0.87 / 4e3), rel=0.1)


def test_a_steep_piece_of_a_table_counts():
    """A thousandth of a radian wide, it allows the step of a linear spring of its stiffness."""
    piece = {
        "positions_rad": [-2.0, 0.5, 0.501, 2.0],
        "torques_n_m": [250.0, 250.0, -250.0, -250.0],
        "outside": "constant",
    }
    line = {"stiffness_n_m_per_rad": 5e5, "rest_rad": 0.5005}
    by_table, by_line = (largest(pendulum("torque", spring=spring)) for spring in (piece, line))
    assert by_table == pytest.approx(by_line, rel=0.05)
    assert by_table < 5e-3
