"""Errors of default runs are below their accuracy, or the runs say so: random scenarios against event-exact motion."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from simulation.exact import ExactPlant
from simulation.plants import COULOMB, MOTOR, STOPS, chain, pendulum
from simulation.random_scenarios import ROWS, NoSuchArm, case, judged, truth, wrong_by
from simulation.sticking import block, dry
from simulation.test_switching import bounced

SEEDS = 40  # of the 200 that tools/accuracy_law.py walks
LIMITS = {"position_rad": [-0.1, 0.1]}


def times(duration):
    return np.arange(round(duration / ROWS) + 1) * ROWS


def exact(arm, duration, q, qd, *changes, **options):
    """States (rows, size); changes are (time, command)."""
    changes = [(t, {"command": u}) for t, u in changes or [(0.0, np.zeros(arm.n))]]
    return ExactPlant(arm, **options).run(times(duration), q, qd, changes)


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", range(SEEDS))
def test_errors_are_within_the_accuracy_or_stated(seed):
    try:
        scenario = case(seed)
    except NoSuchArm as absent:
        pytest.skip(str(absent))
    verdict = judged(scenario)
    assert verdict.kept, (scenario.kind, scenario.name, sorted(scenario.features), verdict)


def test_truth_keeps_the_energy_of_a_swing():
    arm = pendulum("torque")
    inertia, weight = float(aw.mass_matrix(arm, np.zeros(1))[0, 0]), 3.0 * 9.81 * 0.3
    q, qd = exact(arm, 60.0, [np.pi / 2 + 1.5], [0.0]).T
    assert np.ptp(0.5 * inertia * qd**2 - weight * np.sin(q)) < 1e-9 * weight


def test_truth_of_bounces_is_the_closed_form():
    arm = pendulum("torque", 0.0, stops={"stiffness_n_m_per_rad": 400.0, "damping_n_m_s_per_rad": 6.0}, limits=LIMITS)
    inertia = float(aw.mass_matrix(arm, np.zeros(1))[0, 0])
    found = exact(arm, 2.0, [0.0], [1.0])
    right = np.array([bounced(inertia, 0.1, 1.0, t) for t in times(2.0)[1:]])
    np.testing.assert_allclose(found[1:], right, rtol=0, atol=1e-9)


def test_truth_of_a_stiff_undamped_stop_keeps_the_speed():
    arm = pendulum("torque", 0.0, stops={"stiffness_n_m_per_rad": 1e5, "damping_n_m_s_per_rad": 0.0}, limits=LIMITS)
    q, qd = exact(arm, 20.0, [0.0], [1.0]).T
    free = np.abs(q) < 0.1
    assert free.sum() > 900
    np.testing.assert_allclose(np.abs(qd[free]), 1.0, rtol=0, atol=1e-8)


def test_truth_of_a_block_stops_holds_and_comes_loose_in_closed_form():
    t = times(2.0)
    found = exact(block(2.0, friction=dry(3.0)), 2.0, [0.0], [1.0], (0.0, [0.0]), (1.0, [2.9]), (1.5, [4.0]))
    stops = 1.0 / 1.5
    right = np.where(t < stops, t - 0.75 * t**2, 0.5 * stops) + np.where(t > 1.5, 0.25 * (t - 1.5) ** 2, 0.0)
    np.testing.assert_allclose(found[:, 0], right, rtol=0, atol=1e-12)
    assert (found[(t > stops) & (t <= 1.5), 1] == 0.0).all()


@pytest.mark.sample(1)
@pytest.mark.parametrize("contacts", [False, True])
def test_truth_is_that_of_cvodes(contacts):
    stops = {"stops": STOPS, "limits": {"position_rad": [-0.3, 0.35]}} if contacts else {}
    arm = chain([{"command": "torque", "motor": MOTOR, "friction": COULOMB, **stops}] * 2)
    command = aw.Schedule([0.0, 0.4, 1.1], [[5.0, -2.0], [-20.0, 8.0], [12.0, 3.0]], list(arm.names))
    solver, recording = aw.Solver("cvodes"), aw.Recording(period=ROWS)
    run = aw.simulate(aw.Scenario(arm, 2.0, command=command, solver=solver, recording=recording))
    rows = zip(command.times, command.commands, strict=True)
    found = exact(arm, 2.0, [0.0, 0.0], [0.0, 0.0], *rows)
    assert wrong_by(run, (found[:, :2], found[:, 2:4]), arm) < 1e-8


@pytest.mark.study
@pytest.mark.parametrize("sampled", [False, True])
def test_truths_are_those_of_cvodes_where_nothing_sticks(sampled):
    """Over the first six such of the random scenarios, shortened."""
    some = (each for each in map(case, itertools.count()) if ("sampled" in each.features) == sampled)
    smooth = itertools.islice((each for each in some if each.kind.endswith("smooth") and each.scenario.arm.n < 4), 6)
    for each in smooth:
        shorter = replace(each, scenario=replace(each.scenario, duration=2.0 if not sampled else 4.0))
        exact, by_cvodes = truth(shorter), aw.simulate(replace(shorter.scenario, solver=aw.Solver("cvodes")))
        assert wrong_by(by_cvodes, exact, shorter.scenario.arm) < 1e-6


@pytest.mark.study
def test_steps_of_a_high_accuracy_come_to_the_truth_where_contacts_begin_and_friction_sticks():
    """Where the truth does not depend on its own tolerance: a motion that amplifies errors has none."""
    some = (each for each in map(case, range(SEEDS)) if "sampled" not in each.features and each.scenario.arm.n < 3)
    rough, sure = [each for each in some if not each.kind.endswith("smooth")][:12], 0
    for each in rough:
        exact, other, arm = truth(each), truth(each, 1e-9), each.scenario.arm
        if wrong_by(dict(zip(("q", "qd"), other, strict=True)), exact, arm) < 1e-6:
            run = aw.simulate(replace(each.scenario, solver=aw.Solver(accuracy=1e-7, max_substeps=10**6)))
            assert wrong_by(run, exact, arm) < 1e-5, each
            sure += 1
    assert sure >= 6
