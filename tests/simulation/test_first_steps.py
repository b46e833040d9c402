"""Coarse steps given by hand, where people begin: they are refused, or taken with a note; steps by default are right."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.errors import ScenarioError
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.plant.plant import plant_derivative
from armwright.simulation.plant.step_limits import StepLimit
from raises_at import raises_at
from simulation.first_steps import geared_motor, plain_arm, ur5, ur5_under_pid


def driven(arm: aw.Model, volts: float, solver: aw.Solver, duration: float = 0.02) -> aw.Scenario:
    """The arm under constant voltages."""
    return aw.Scenario(arm, duration, command=np.full(arm.n, volts), solver=solver)


def test_a_geared_motor_at_a_coarse_step():
    """rk3 at 2.5 time constants: v = 2 (1 - (-0.979)^k) rad/s, where the truth is 2 (1 - exp(-t / 2 ms)). A note says so."""
    run = aw.simulate(driven(geared_motor(), 24.0, aw.Solver(step=5e-3)))
    np.testing.assert_allclose(run.qd.values[1:4, 0], [3.96, 0.08, 3.88], atol=0.005)
    assert "a step of 0.005 s is coarse: qd of axis is off by" in run.attrs["notes"]
    with raises_at(ScenarioError, "step", r"0\.002 s, .*'axis' \(motor\.resistance_ohm\)", value=0.01):
        aw.simulate(driven(geared_motor(), 24.0, aw.Solver(step=1e-2)))


def test_a_geared_motor_by_default():
    run = aw.simulate(driven(geared_motor(), 24.0, aw.Solver()))
    exact = 2.0 * (1.0 - np.exp(-run.time.values / 2e-3))
    assert np.abs(run.qd.values[:, 0] - exact).max() < 1e-3 * 2.0
    assert "coarse" not in run.attrs["notes"]


def test_a_plain_arm_is_refused_at_its_rated_voltage_for_the_smoothing_of_its_gears():
    """At 12 V what the gears lose is steep about rest; without load the step would do, and without the key it does under load."""
    coarse, arm = aw.Solver(step=1e-3), plain_arm(smoothing=0.01)
    with pytest.raises(ScenarioError) as refused:
        aw.simulate(driven(arm, 12.0, coarse))
    assert "of the gear loss of joint 'shoulder' (friction.smoothing_rad_per_s)" in refused.value.what
    assert "no friction.smoothing_rad_per_s in the record: friction then sticks" in refused.value.expected
    rule, u = INTEGRATORS["rk3"], np.full(2, 12.0)
    assert StepLimit(arm).largest_step(rule, 0.0 * u) > 1e-3
    assert StepLimit(plain_arm()).largest_step(rule, u) > 1e-3


@pytest.mark.study
def test_a_plain_arm_by_default():
    """Friction and gears without a smoothing speed: it moves as SciPy says, and without weight stays put at 0.2 V."""
    arm = plain_arm()
    run = aw.simulate(driven(arm, 12.0, aw.Solver(), duration=0.2))
    u = np.full(2, 12.0)
    begins = np.array([0.0, 0.0, 1e-12, 1e-12])  # on its way: no joint turns back
    exact = solve_ivp(
        lambda t, x: plant_derivative(arm, x, u), (0.0, 0.2), begins, "DOP853", run.time.values, rtol=1e-10, atol=1e-12
    )
    assert (exact.y[2:] > 0.0).all()
    for ours, theirs in ((run.q.values, exact.y[:2].T), (run.qd.values, exact.y[2:].T)):
        assert (np.abs(ours - theirs).max(axis=0) < 1e-3 * np.ptp(theirs, axis=0)).all()
    still = aw.simulate(driven(arm.replace(gravity=[0.0, 0.0, 0.0]), 0.2, aw.Solver()))
    assert not still.q.values.any()


@pytest.mark.study
def test_ripple_of_a_ur5_under_pid(tmp_path):
    """Wrist 3 changes its torque by 19.7 N m from tick to tick, as rk3 at 2.4 time constants does; two substeps end it."""
    arm = ur5(tmp_path)
    if arm is None:
        pytest.skip("the UR5 comes from the example-robot-data wheel: pip install example-robot-data")
    solvers = {"coarse": aw.Solver(substeps=1), "two": aw.Solver(substeps=2), "default": aw.Solver()}
    runs = {name: aw.simulate(ur5_under_pid(arm, solver)) for name, solver in solvers.items()}
    ripple = {name: np.abs(np.diff(run.tau.values[-50:, 5])).max() for name, run in runs.items()}
    assert ripple["coarse"] == pytest.approx(19.7, rel=0.05)
    assert max(ripple["two"], ripple["default"]) < 0.05
    assert "a step of 0.002 s is coarse: qd of wrist_3_joint is off by" in runs["coarse"].attrs["notes"]
    slower = ur5_under_pid(arm, aw.Solver(substeps=1))
    slower = replace(slower, loop=replace(slower.loop, period=4e-3))
    with raises_at(ScenarioError, "step", r"'wrist_3_joint' .* 0\.0005 s, by substeps = 8") as error:
        aw.simulate(slower)
    aw.simulate(replace(slower, solver=aw.Solver(substeps=int(re.search("substeps = (.)", error.value.expected)[1]))))


@pytest.mark.study
def test_a_ur5_under_pid_by_default(tmp_path):
    """Motors of 0.8 ms in a loop of 2 ms, beside CVODES: within 1e-3 of every range."""
    arm = ur5(tmp_path)
    if arm is None:
        pytest.skip("the UR5 comes from the example-robot-data wheel: pip install example-robot-data")
    run, exact = (aw.simulate(ur5_under_pid(arm, aw.Solver(rule))) for rule in ("auto", "cvodes"))
    for name in ("q", "qd", "tau"):
        error = np.abs(run[name].values - exact[name].values).max(axis=0)
        assert (error < 1e-3 * np.ptp(exact[name].values, axis=0)).all()
    assert "coarse" not in run.attrs["notes"]
