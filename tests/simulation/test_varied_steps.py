"""A step too large for an arm that was varied is refused as for one whose record says the same numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest

import armwright as aw
from armwright.control import JointPID
from armwright.errors import ScenarioError
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.plant.varied_step_limits import VariedStepLimit
from raises_at import raises_at
from simulation.fields import scenario_of
from simulation.plants import COULOMB, MOTOR, SUPPLY, chain

NAME = "joint0.motor.resistance_ohm"
LOW = 1e-5


@pytest.fixture(scope="module")
def arm():
    return chain([{"command": "voltage", "motor": MOTOR}])


def refusal(arm, **more):
    more = {"command": [1.0], "duration": 0.02, "step": 1e-3} | more
    with raises_at(ScenarioError, "step", "time constant") as refused:
        aw.simulate(scenario_of(arm, **more))
    return refused.value


def test_a_varied_number_is_refused_as_the_records_own(arm):
    own = refusal(chain([{"command": "voltage", "motor": {**MOTOR, "resistance_ohm": LOW}}]))
    with_value = own.what.replace(": rk3", f" (with {NAME} = {LOW:g}): rk3")
    controlled = {"command": None, "step": None, "controller": JointPID(kp=1.0), "period": 1e-3}
    for loop in ({}, controlled):
        varied = refusal(arm, vary={NAME: LOW}, **loop)
        expected = re.sub(", by substeps = [0-9]+", "", varied.expected)
        assert (varied.place, varied.value, expected) == ("step", own.value, own.expected)
        assert ("substeps" in varied.expected) == (loop is controlled)
        assert varied.what == with_value


def test_the_lane_is_found_among_many_and_named(arm):
    values = np.full(100_000, float(MOTOR["resistance_ohm"]))
    values[54_321] = LOW
    assert f"(in lane 54321, with {NAME} = {LOW:g})" in refusal(arm, vary={NAME: aw.Batch(values)}, every=0).what


def test_the_lane_with_the_fastest_bus_is_found():
    """Though the modes of other lanes' arms are faster, and it loads the bus at full voltage only."""
    supply = {**SUPPLY, "source_resistance_ohm": 4.0}
    arm = chain([{"command": "voltage", "motor": MOTOR, "friction": COULOMB}], robot={"supply": supply})
    masses, capacitances = np.linspace(1.0, 4.0, 12), np.full(12, 5e-3)
    capacitances[7] = 1e-5
    error = refusal(
        arm, command=[48.0], vary={"rod0.mass_kg": aw.Batch(masses), "supply.capacitance_f": aw.Batch(capacitances)}
    )
    assert "that of the bus that drives load (supply.capacitance_f) (in lane 7, with" in error.what


def test_lanes_that_all_do_are_run(arm):
    resistance = float(MOTOR["resistance_ohm"])
    varied = {NAME: aw.Batch(resistance * np.linspace(1, 2, 40))}
    run = aw.simulate(aw.Scenario(arm, command=[1.0], duration=0.02, vary=varied))
    assert np.isfinite(run.q).all()


def test_the_lanes_decide_and_not_the_record(arm):
    """What no lane has is not refused."""
    stiff = chain([{"command": "voltage", "motor": {**MOTOR, "resistance_ohm": LOW}}])
    scenario = aw.Scenario(
        stiff, command=[1.0], duration=0.02, vary={NAME: float(MOTOR["resistance_ohm"])}, solver=aw.Solver("rk3")
    )
    VariedStepLimit(scenario.varied, scenario.parameters, False).check_step(
        "rk3", INTEGRATORS["rk3"], 1e-3, np.ones((1, 1))
    )
    same = aw.simulate(aw.Scenario(arm, command=[1.0], duration=0.02, solver=aw.Solver("rk3")))
    np.testing.assert_allclose(aw.simulate(scenario).q, same.q, rtol=1e-12, atol=1e-15)


def test_a_run_out_of_all_reason_carries_a_note():
    free = chain([{"command": "torque"}])
    run = aw.simulate(aw.Scenario(free, command=[1e18], duration=0.1, vary={}))
    assert "from there on these numbers mean nothing" in run.attrs["notes"]
    calm = aw.simulate(aw.Scenario(free, command=[1.0], duration=0.1))
    assert "mean nothing" not in calm.attrs["notes"]
