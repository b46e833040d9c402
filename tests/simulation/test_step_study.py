"""Steps tried against CVODES: the order that is seen, what is recommended, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import DivergenceError, ScenarioError
from armwright.simulation.integrate.integrators import INTEGRATORS
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of, with_fields
from simulation.overflow import overflowing_panda
from simulation.plants import MOTOR, STOPS, pendulum

START = {"q0": [0.4, 0.4], "qd0": [0.5, 0.5]}


@pytest.mark.parametrize("name", INTEGRATORS)
def test_the_order_of_the_rule_is_seen(name):
    scenario = scenario_of(arm("two-link"), duration=0.064, step=4e-3, command=[90.0, 20.0], integrator=name, **START)
    found = aw.simulation.step_study(scenario, steps=4, accuracies=[1e-1, 1e-20])
    assert [trial.step for trial in found.trials] == pytest.approx([16e-3, 8e-3, 4e-3, 2e-3])
    assert abs(found.trials[-1].order - INTEGRATORS[name].order) < 0.3
    assert [trial.evaluations for trial in found.trials] == pytest.approx(
        [INTEGRATORS[name].stages / trial.step for trial in found.trials]
    )
    best = found.recommended[1e-1]
    assert best is not None
    assert best.error <= 1e-1
    assert found.recommended[1e-20] is None


def test_errors_are_those_of_the_runs():
    scenario = scenario_of(arm("two-link"), duration=0.04, step=2e-3, command=[90.0, 20.0], **START)
    trial = aw.simulation.step_study(scenario, steps=3).trials[2]
    assert trial.step == pytest.approx(2e-3)
    run = aw.simulate(scenario)
    exact = aw.simulate(scenario_of(arm("two-link"), duration=0.04, step=2e-3, command=[90.0, 20.0],
                                    integrator="cvodes", **START))  # fmt: skip
    rows = slice(None, None, 4)  # the times that the largest step has too
    assert trial.error_qd == pytest.approx(np.abs(run.qd - exact.qd).values[rows].max(), rel=1e-4)


def test_a_controller_keeps_its_period_and_substeps_are_tried():
    scenario = scenario_of(
        arm("two-link"), controller=lambda t, r, y: 100.0 * (r.q - y.q) - 10.0 * y.qd, reference=[0.5, 0.1],
        period=8e-3, duration=0.16, **START,
    )  # fmt: skip
    found = aw.simulation.step_study(scenario, steps=4, accuracies=[1e-7])
    assert [trial.substeps for trial in found.trials] == [1, 2, 4, 8]
    assert abs(found.trials[-1].order - 3) < 0.3
    best = found.recommended[1e-7]
    assert best is not None
    assert best.error <= 1e-7
    larger = [trial for trial in found.trials if trial.step > best.step]
    assert not larger or larger[-1].error > 1e-7


def test_a_step_that_cannot_run_is_told():
    scenario = aw.Scenario(
        arm("cmu-dd"), duration=0.32, command=np.zeros(6), solver=aw.Solver(step=0.02, integrator="semi_implicit_euler")
    )
    first = aw.simulation.step_study(scenario, steps=1).trials[0]
    assert first.refused is not None
    assert "too large for the fastest time constant" in first.refused
    assert first.error == np.inf


@pytest.mark.parametrize(
    ("fields", "more", "said"),
    [
        ({"integrator": "rk45"}, {}, "chooses its own .*.auto. .*rk3, rk4"),
        ({}, {"steps": 0}, "steps = 0"),
        ({}, {"accuracies": [-1.0]}, r"accuracies = -1\.0"),
    ],
)
def test_what_cannot_be_tried_is_refused(fields, more, said):
    scenario = scenario_of(arm("two-link"), duration=0.1, command=[0.0, 0.0], **fields)
    with pytest.raises(ScenarioError, match=said):
        aw.simulation.step_study(scenario, **more)


def test_where_a_quantiser_decides_otherwise_rows_behind_are_not_compared():
    """A count more or less is no error of the integration: the run is another one from there, however small the step."""
    scenario = scenario_of(
        arm("two-link"), controller=lambda t, r, y: 100.0 * (r.q - y.q) - 10.0 * y.qd, reference=[0.5, 0.1],
        period=8e-3, duration=0.4, sensors=aw.Sensors(counts=20_000, velocity="difference"), every=5, **START,
    )  # fmt: skip
    found = aw.simulation.step_study(scenario, steps=4, accuracies=[1e-4])
    coarse, fine = found.trials[0], found.trials[-1]
    rk3, exact = (aw.simulate(with_fields(scenario, integrator=name, every=1)) for name in ("rk3", "cvodes"))
    first = np.flatnonzero((rk3.q_measured.values != exact.q_measured.values).any(axis=1))[0]
    assert coarse.counts_differ_at == pytest.approx(first * 8e-3)
    errors = np.abs(rk3.qd - exact.qd).values.max(axis=1)
    assert coarse.error_qd == pytest.approx(errors[: first + 1].max(), rel=1e-6)
    assert errors.max() > 100.0 * coarse.error_qd
    assert np.isnan(fine.counts_differ_at)
    assert np.isnan(found.trials[1].order)
    assert fine.order == pytest.approx(3.0, abs=0.3)
    assert found.recommended[1e-4] == coarse


def test_no_order_is_told_from_errors_that_are_those_of_cvodes():
    scenario = scenario_of(arm("two-link"), duration=0.064, step=1e-3, command=[90.0, 20.0], integrator="rk4", **START)
    found = aw.simulation.step_study(scenario, steps=7)
    assert 0.0 < found.floor < 1e-10
    assert found.trials[-1].error == pytest.approx(found.floor, rel=0.2)
    assert np.isnan(found.trials[-1].order)
    assert found.trials[1].order == pytest.approx(4.0, abs=0.3)


def test_where_friction_turns_round_the_floor_is_that_of_the_reference():
    """Steps that end as far behind the turn are as wrong, and are no measure of what the reference is wrong by."""
    rough = {"coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.0}
    swing = pendulum(motor=MOTOR, friction=rough)
    start = aw.Start([0.3], [-0.5])
    found = aw.simulation.step_study(
        aw.Scenario(swing, 0.2, command=[6.0], start=start), steps=5, accuracies=[1e-2, 1e-7]
    )
    assert found.reference == "rk45 at 1e-11"
    assert found.floor < 1e-6 < 1e-4 < found.trials[-1].error
    assert found.auto.rule == "rk45"
    assert found.by_auto[1e-7].error < 0.1 * found.auto.error


def test_stops_do_not_cost_the_order():
    joint = {"motor": MOTOR, "friction": {"viscous_n_m_s_per_rad": 0.8}, "stops": STOPS}
    swing = pendulum(**joint, limits={"position_rad": [-1.0, 0.35]})
    scenario = aw.Scenario(
        swing, duration=0.2, command=[2.0], start=aw.Start([0.3], [0.8]), solver=aw.Solver(step=1e-3, integrator="rk4")
    )
    found = aw.simulation.step_study(scenario, steps=5)
    assert found.trials[-1].order == pytest.approx(4.0, abs=0.3)


def test_a_reference_that_cvodes_cannot_compute_is_named_as_such(monkeypatch):
    scenario = aw.Scenario(
        overflowing_panda(monkeypatch), duration=0.62, command=np.zeros(7), solver=aw.Solver("rk3", 1e-3)
    )
    with raises_at(DivergenceError, "", r"reference .*CVODES .* t = 0\.6\d+ s: .* shorter"):
        aw.simulation.step_study(scenario, steps=1)
