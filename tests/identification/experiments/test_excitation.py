"""Designed motions: limits on dense grids, rest at the ends, better than chance, and better estimates from what they measure."""

from __future__ import annotations

import os
import signal
import sys
import threading

import casadi
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import Interrupted, ScenarioError
from armwright.identification.experiments.columns import DRIVES, BaseRegressor
from armwright.identification.experiments.excitation import ExcitationProblem
from armwright.identification.experiments.information import condition_number, criterion_function
from armwright.identification.experiments.limits import excitation_limits
from armwright.trajectory.limits import QUANTITIES
from physics.arms import arm
from raises_at import raises_at

MOST = {"velocity": [2.0, 3.0], "torque": [60.0, 30.0], "position": 2.5}


def limits_of(model, **most):
    return aw.trajectories.MotionLimits.of(model, **most)


LIMITS = limits_of(arm("two-link"), **MOST)


@pytest.fixture(scope="module")
def designed():
    return aw.identification.design_excitation(arm("two-link"), cycle=5.0, harmonics=4, starts=3, limits=LIMITS)


def test_it_starts_and_ends_at_rest(designed):
    for t in (0.0, designed.trajectory.duration):
        _, qd, qdd = designed.trajectory(t)
        np.testing.assert_allclose([qd, qdd], 0.0, atol=1e-10)


def test_limits_hold_between_the_instants_of_the_design(designed):
    t = np.linspace(0.0, 5.0, 7001)
    q, qd, qdd = designed.trajectory.at(t)
    some = zip(q[::70], qd[::70], qdd[::70], strict=True)
    tau = np.array([aw.inverse_dynamics(arm("two-link"), *state) for state in some])
    for values, most in ((q, 2.5), (qd, MOST["velocity"]), (tau, MOST["torque"])):
        assert (np.abs(values) <= np.asarray(most) * (1.0 + 1e-3)).all()
    assert 0.98 < np.nanmax([part.max() for part in designed.used.values()]) <= 1.0 + 1e-9  # limits are made use of


@pytest.mark.study
@settings(max_examples=6, deadline=None)
@given(
    st.floats(0.3, 5.0), st.floats(0.3, 5.0), st.floats(0.5, 20.0), st.integers(2, 4), st.sampled_from(["condition", "logdet"]),
    st.integers(0, 1000),
)  # fmt: skip
def test_limits_of_motion_hold_whatever_they_are(first, second, acceleration, harmonics, criterion, seed):
    most = np.array([first, second])
    found = aw.identification.design_excitation(
        arm("two-link"), cycle=3.0, harmonics=harmonics, starts=1, criterion=criterion, seed=seed,
        limits=limits_of(
            arm("two-link"), velocity=most, acceleration=acceleration, position=[[-1.0, 0.5], [-0.2, 2.0]]
        ),
    )  # fmt: skip
    q, qd, qdd = found.trajectory.at(np.linspace(0.0, 3.0, 3000))
    assert (q >= [-1.001, -0.202]).all()
    assert (q <= [0.501, 2.002]).all()
    assert (np.abs(qd) <= most * 1.001).all()
    assert (np.abs(qdd) <= acceleration * 1.001).all()


def test_it_beats_a_random_search(designed):
    limits = excitation_limits(arm("two-link"), LIMITS)
    problem = ExcitationProblem.of(limits, BaseRegressor.of(arm("two-link"), DRIVES, np.full(2, 0.01)), 5.0, 4)
    draw = np.random.default_rng(1)
    # torques not even looked at
    best = min(condition_number(problem.information(problem.random(draw))) for _ in range(500))
    assert designed.condition < 0.7 * best


@pytest.mark.study
def test_logdet_asks_for_more_information_than_condition(designed):
    other = aw.identification.design_excitation(
        arm("two-link"), cycle=5.0, harmonics=4, starts=3, criterion="logdet", limits=LIMITS
    )
    assert other.logdet > designed.logdet
    assert other.condition > designed.condition


@pytest.mark.parametrize("scaling", ["columns", "none"])
def test_the_smooth_criterion_bounds_the_condition_number(scaling):
    draw = np.random.default_rng(0)
    for size in (3, 12):
        rows = draw.normal(size=(40, size)) * np.geomspace(0.1, 10.0, size)
        information = rows.T @ rows
        criterion = {"columns": "condition", "none": "condition_si"}[scaling]
        smooth = np.exp(float(criterion_function(size, criterion)(information)))
        exact = np.linalg.cond(rows / np.linalg.norm(rows, axis=0) if scaling == "columns" else rows)
        assert condition_number(information, scaling) == pytest.approx(exact, rel=1e-6)
        assert exact <= smooth <= exact * size**0.25 * (1 + 1e-9)
        value = float(criterion_function(size, "logdet")(information))
        assert value == pytest.approx(-0.5 / size * np.linalg.slogdet(information)[1], rel=1e-8)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["two-link", "cmu-dd", "panda"])
def test_the_traced_regressor_is_the_compiled_one(name):
    model = arm(name)
    regressor = BaseRegressor.of(model, DRIVES, np.full(model.n, 1e-9))
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 5, model.n))
    traced = [np.array(regressor.graph()(*state)).T for state in zip(q, qd, qdd, strict=True)]
    np.testing.assert_allclose(traced, regressor.rows(q, qd, qdd), atol=1e-6)
    assert isinstance(regressor.graph(), casadi.Function)


@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_ctrl_c_within_the_solver_ends_it():
    """CasADi takes the signal and goes on: it came to nothing there, half of the times."""
    limits = aw.trajectories.MotionLimits.of("two-link", position=1.0, velocity=2.0)
    for delay in np.linspace(0.0, 0.2, 6):
        timer = threading.Timer(float(delay), os.kill, [os.getpid(), signal.SIGINT])

        def stop(done, _, timer=timer):
            if done == 2:
                timer.start()

        with pytest.raises(Interrupted) as caught:
            aw.identification.design_excitation("two-link", limits=limits, harmonics=3, starts=30, progress=stop)
        assert len(caught.value.found.reasons) > 0


def test_kinematics_alone_are_enough_and_said_so(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text(
        '<robot name="bare"><link name="base"/><link name="a"/><link name="b"/>'
        '<joint name="j1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>'
        '<joint name="j2" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/></joint>'
        "</robot>"
    )
    model = aw.load(path)
    found = aw.identification.design_excitation(
        model, harmonics=3, starts=1, limits=limits_of(model, velocity=1.0, jerk=5.0)
    )
    assert np.isfinite(found.condition)
    assert any(
        "torque limits are not honoured: the record has links without masses" in reason for reason in found.reasons
    )
    assert "jerk limits are not honoured" in found.reasons
    with raises_at(ScenarioError, "limits.torque", "without masses"):
        aw.identification.design_excitation(model, limits=limits_of(model, velocity=1.0, torque=5.0))


def test_the_tip_stays_in_its_box():
    box = [[-np.inf, -np.inf, -0.2], [np.inf, np.inf, np.inf]]
    model = arm("cmu-dd").with_locked(dict.fromkeys(arm("cmu-dd").names[3:], 0.3))
    found = aw.identification.design_excitation(
        model, cycle=4.0, harmonics=3, starts=1, limits=limits_of(model, velocity=2.0, voltage=np.inf), box=box
    )
    tip = aw.compile(model).forward_kinematics(found.trajectory.at(np.linspace(0, 4.0, 2000))[0])[:, 2, 3]
    assert tip.min() >= -0.2 - 1e-4


def test_estimates_are_better_than_from_a_random_motion(designed):
    model = arm("two-link")
    regressor = BaseRegressor.of(model, DRIVES, np.full(2, 0.01))
    problem = ExcitationProblem.of(excitation_limits(model, LIMITS), regressor, 5.0, 4)
    draw = np.random.default_rng(3)
    t = np.linspace(0.0, 5.0, 500, endpoint=False)
    truth = draw.normal(size=len(regressor))

    def error(trajectory):
        rows = regressor.rows(*trajectory.at(t)).reshape(-1, len(regressor))
        scale = np.linalg.norm(regressor.rows(*designed.trajectory.at(t)).reshape(-1, len(regressor)), axis=0)
        tau = (rows @ truth)[:, None] + draw.normal(size=(len(rows), 50))
        return np.sqrt((((np.linalg.lstsq(rows, tau, rcond=None)[0] - truth[:, None]) * scale[:, None]) ** 2).mean())

    others = [error(problem.trajectory(problem.random(draw))) for _ in range(10)]
    assert error(designed.trajectory) < 0.7 * min(others)


def test_a_motion_is_saved_with_units(designed, tmp_path):
    path = tmp_path / "motion.csv"
    designed.save(path, rate=100.0)
    lines = path.read_text().splitlines()
    assert lines[0].startswith("t [s],q_shoulder [rad],q_elbow [rad],qd_shoulder [rad/s]")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 1:3], designed.trajectory.at(rows[:, 0])[0], rtol=1e-15)
    assert rows[-1, 0] == 5.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "speed of 'shoulder', 'elbow'"),
        ({"velocity": -1.0}, "limits.velocity = -1.0: expected a number above 0"),
        ({"velocity": [1.0]}, r"velocity = \[1.0\]"),
        ({"velocity": 1e308}, r"velocity = 1e\+308"),
        ({"velocity": 1.0, "position": 1e308}, r"upper bound .*, 1e\+30"),
        ({"velocity": 1.0, "harmonics": 1}, "harmonics = 1: .* 2"),
        ({"velocity": 1.0, "criterion": "det"}, "criterion = 'det'"),
        ({"velocity": 1.0, "drives": ["rotr"]}, r"\brotor\b"),
        ({"velocity": 1.0, "position": [[1.0, 0.0], [0.0, 1.0]]}, "upper bound"),
        ({"velocity": 1.0, "box": [[0, 0, 0]]}, "lowest and highest x, y, z"),
        ({"velocity": 1.0, "voltage": 5.0}, "constants .*shoulder, elbow"),
        (
            {"velocity": 1.0, "torque": 0.1, "starts": 1, "harmonics": 2, "position": [[0.5, 1.0], [0.5, 1.0]]},
            "from 1 starts",
        ),
        ({"velocity": 1.0, "cycle": 0.0}, "cycle = 0.0"),
    ],
)
def test_what_cannot_be_designed_is_refused(options, said):
    model = arm("two-link")
    most = {name: options[name] for name in QUANTITIES if name in options}
    others = {name: value for name, value in options.items() if name not in QUANTITIES}
    with pytest.raises(ScenarioError, match=said):
        aw.identification.design_excitation(model, limits=limits_of(model, **most), **others)


def test_what_are_no_limits_is_refused():
    with pytest.raises(ScenarioError, match=r"limits = .*MotionLimits\.of"):
        aw.identification.design_excitation(arm("two-link"), limits={"velocity": 1.0})
