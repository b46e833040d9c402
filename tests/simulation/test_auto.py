"""Steps that lanes choose by themselves, without being told anything: how right they are, what they cost, whose they are."""

from dataclasses import replace

import numpy as np
import pytest
import xarray

import armwright as aw
from armwright.errors import DivergenceError, ScenarioError
from armwright.simulation.integrate.step_control import share_of_range
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of
from simulation.plants import MOTOR, pendulum

SOFT = {"stiffness_n_m_per_rad": 20.0, "damping_n_m_s_per_rad": 0.05}
ARMS = ("cmu-dd", "lwa4p", "panda", "puma560", "two-link")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("entry", range(3))
def test_no_entry_that_is_not_finite_is_overlooked(entry, bad):
    """Comparisons with NaN are false, so that the largest of several errors is found without it."""
    errors, ranges = np.full(3, 1e-9), np.ones(3)
    assert share_of_range(errors, ranges, range(3), 3e-5)[0] < 1.0
    for values in (errors, ranges):
        wrong = values.copy()
        wrong[entry] = bad
        pair = (wrong, ranges) if values is errors else (errors, wrong)
        assert not share_of_range(*pair, range(3), 3e-5)[0] <= 1.0


def pushed(name: str, share: float = 0.3) -> aw.Scenario:
    """An arm under a share of its voltage, current or torque, another one at every joint."""
    model = arm(name)
    most = {"voltage": "voltage", "current": "current", "torque": "torque"}
    limits = np.array([getattr(body.limits, most[body.drive.command]) for body in model.coordinates], dtype=float)
    shares = share * np.cos(np.arange(model.n))
    return aw.Scenario(model, duration=0.5, command=np.where(np.isfinite(limits), limits, 10.0) * shares)


def wrong_by(run: xarray.Dataset, exact: xarray.Dataset) -> float:
    """The largest error of q and q̇ over time, in parts of the joint's range."""
    pairs = [(run[name].values, exact[name].values) for name in ("q", "qd")]
    return max(float((np.abs(ours - theirs).max(axis=0) / np.ptp(theirs, axis=0)).max()) for ours, theirs in pairs)


def solved(scenario: aw.Scenario) -> xarray.Dataset:
    return aw.simulate(replace(scenario, solver=aw.Solver("cvodes")))


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ARMS)
def test_a_run_is_right_without_settings(name):
    scenario = pushed(name, 0.05 if name == "panda" else 0.3)
    run = aw.simulate(scenario)
    assert wrong_by(run, solved(scenario)) < 1e-3
    assert run.attrs["integrator"] == "auto"
    assert run.attrs["accuracy"] == 1e-3
    assert len(run.time) == 501  # a row every millisecond
    assert run.steps_tried < 500  # whose number does not follow from the rows
    assert 0 <= run.steps_repeated < run.steps_tried
    assert 0.0 < run.global_error.max() < 1e-3


def test_an_accuracy_is_kept_and_paid_for():
    scenario, exact = pushed("puma560"), solved(pushed("puma560"))
    runs = [aw.simulate(replace(scenario, solver=aw.Solver(accuracy=accuracy))) for accuracy in (1e-3, 1e-5, 1e-7)]
    errors = [wrong_by(run, exact) for run in runs]
    assert all(error < accuracy for error, accuracy in zip(errors, (1e-3, 1e-5, 1e-7), strict=True))
    assert runs[0].steps_tried < runs[1].steps_tried < runs[2].steps_tried


@pytest.mark.study
@pytest.mark.parametrize("period", [1e-3, 4e-3])
def test_a_loop_is_right_without_settings_and_its_controller_runs_once_a_tick(period):
    model, calls = arm("puma560"), []

    def controller(t, r, y):
        return 40.0 * (r.q - y.q) - 4.0 * y.qd

    goal = np.full(6, 0.3)
    scenario = aw.Scenario(model, duration=0.2, loop=aw.Loop(controller, goal, period=period))
    run = aw.simulate(scenario)
    assert run.attrs["controller"] == "compiled"
    assert wrong_by(run, solved(scenario)) < 1e-3

    def in_python(t, r, y):  # what cannot be traced runs in Python: once a tick, however often the plant is taken back
        calls.append(float(t))
        return np.asarray(40.0 * (r.q - y.q) - 4.0 * y.qd, dtype=float)

    slow = aw.simulate(replace(scenario, loop=replace(scenario.loop, controller=in_python)))
    assert slow.attrs["controller"] != "compiled"
    np.testing.assert_array_equal(slow.q.values, run.q.values)
    assert len(set(calls)) == round(0.2 / period) + 1


def stiff(model: aw.Model) -> aw.Model:
    """The arm with friction that is smoothed over next to nothing."""
    return smoothed(model, 1e-5)


def sticking(model: aw.Model) -> aw.Model:
    """The arm with friction that sticks."""
    return smoothed(model, None)


def smoothed(model: aw.Model, speed: float | None) -> aw.Model:
    """The arm with another smoothing speed of its friction [rad/s | m/s]; None: none."""
    bodies = (
        body if body.friction is None else replace(body, friction=replace(body.friction, smoothing=speed))
        for body in model.bodies
    )
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize(("of", "rule"), [(None, "rk45"), (stiff, "rodas3"), (sticking, "rk45")])
@pytest.mark.study
def test_a_lanes_bits_do_not_depend_on_its_neighbours(of, rule):
    """Lane 77, alone, among a hundred and among a hundred thousand, whose steps are others."""
    many = 100_000
    rng, model = np.random.default_rng(3), arm("puma560") if of is None else of(arm("puma560"))
    volts, speeds = rng.uniform(-40, 40, (many, 6)), rng.uniform(-1, 1, (many, 6)) * (np.arange(many) % 3 > 0)[:, None]

    def ends(lanes: slice) -> xarray.Dataset:
        recording = aw.Recording(every=0, what="state")
        start = aw.Start(qd=aw.Batch(speeds[lanes]))
        return aw.simulate(aw.Scenario(model, 5e-3, command=aw.Batch(volts[lanes]), start=start, recording=recording))

    alone, hundred, all_ = ends(slice(77, 78)), ends(slice(0, 100)), ends(slice(0, many))
    assert alone.attrs["rule"] == rule
    for name in ("q", "qd", "steps_tried", "steps_repeated"):
        np.testing.assert_array_equal(alone[name].values[0], hundred[name].values[77])
        np.testing.assert_array_equal(alone[name].values[0], all_[name].values[77])
    assert len(np.unique(all_.steps_tried)) > 1


def test_it_goes_on_to_the_bit():
    whole = aw.simulate(pushed("puma560"))
    simulation = aw.simulation.Simulation(pushed("puma560"))
    first = simulation.run(0.2)
    second = simulation.run(0.3)
    np.testing.assert_array_equal(np.concatenate([first.q.values[:-1], second.q.values]), whole.q.values)
    again = aw.simulate(replace(pushed("puma560"), duration=0.3, start=first))
    np.testing.assert_array_equal(again.q.values, second.q.values)


def test_a_lane_that_runs_out_of_substeps_is_marked_with_tick_and_joint():
    scenario = replace(pushed("puma560", 1.0), solver=aw.Solver(accuracy=1e-9, max_substeps=3))
    with pytest.raises(DivergenceError, match=r"(q|qd) of \w+ .* t = .* max_sub"):
        aw.simulate(scenario)
    lanes = aw.Batch(np.array([np.zeros(6), 40.0 * np.ones(6)]))
    run = aw.simulate(replace(scenario, command=lanes))
    assert np.isfinite(run.stalled_at.values[1])
    assert run.stalled_by.values[1].split(" of ")[1] in arm("puma560").names


def test_the_limit_of_substeps_does_not_depend_on_the_recording_period():
    """What is enough for rows every millisecond is enough for one row of half a second; and a limit ends that one too."""
    fine = replace(pushed("puma560", 1.0), solver=aw.Solver(accuracy=1e-10))
    rare = replace(fine, recording=aw.Recording(period=0.5))
    run = aw.simulate(rare)
    assert int(run.steps_tried) > 1000
    np.testing.assert_allclose(run.q.values[-1], aw.simulate(fine).q.values[-1], atol=1e-6)
    with pytest.raises(DivergenceError, match="of substeps"):
        aw.simulate(replace(rare, solver=aw.Solver(accuracy=1e-10, max_substeps=1)))


def test_rows_come_by_time():
    scenario = replace(pushed("puma560"), recording=aw.Recording(period=5e-3))
    assert len(aw.simulate(scenario).time) == 101
    fixed = replace(scenario, solver=aw.Solver(step=2.5e-4))
    run = aw.simulate(fixed)
    np.testing.assert_allclose(np.diff(run.time), 5e-3)
    loop = aw.Loop(aw.JointPID(kp=10.0), np.zeros(6), period=1e-3)
    sampled = aw.Scenario(arm("puma560"), duration=0.1, loop=loop, recording=aw.Recording(period=2e-3))
    np.testing.assert_allclose(np.diff(aw.simulate(sampled).time), 2e-3)


@pytest.mark.parametrize(
    ("solver", "recording", "said"),
    [
        ({"accuracy": 0.0}, {}, "solver.accuracy = 0.0: .*1e-12 and below 1"),
        ({"accuracy": -1e-3}, {}, "solver.accuracy = -0.001: expected"),
        ({"accuracy": 1e-17}, {}, "solver.accuracy = 1e-17: expected"),
        (
            {"accuracy": 1e-3, "step": 1e-3},
            {},
            "solver.accuracy = 0.001: beside solver.step",
        ),
        ({"max_substeps": 0}, {}, "solver.max_substeps = 0"),
        ({"rtol": 1e-3}, {}, "solver.rtol = 0.001: goes with"),
        ({"step": 1e-3}, {"period": 2.5e-3}, "recording.period = 0.0025: expected a multiple of solver.step = 0.001 s"),
        (
            {},
            {"period": 3e-3},
            "recording.period = 0.003|duration = 0.5: .*recording.period",
        ),
        ({}, {"period": 1e-3, "every": 2}, "recording.period = 0.001: beside recording.every"),
    ],
)
def test_settings_that_make_no_sense_are_refused(solver, recording, said):
    with pytest.raises(ScenarioError, match=said):
        replace(pushed("puma560"), solver=aw.Solver(**solver), recording=aw.Recording(**recording))


def test_another_recording_period_cannot_go_on_from_a_run():
    first = aw.simulate(replace(pushed("puma560"), duration=0.01))
    other = replace(pushed("puma560"), duration=0.01, recording=aw.Recording(period=2e-3))
    said = "recording.period = 0.002: the state to go on from has another, 0.001 s; expected recording.period = 0.001 s"
    with pytest.raises(ScenarioError, match=said):
        replace(other, start=first)


def test_defaults_are_not_named_as_if_they_had_been_given():
    with raises_at(ScenarioError, "duration", r"0\.001 s, .* row to row", value=0.0105):
        replace(pushed("puma560"), duration=0.0105)
    with raises_at(ScenarioError, "duration", r"0\.001 s, .*solver\.step", value=0.0105):
        replace(pushed("puma560"), duration=0.0105, solver=aw.Solver("rk4"))


def test_a_tiny_recording_period_is_refused_for_its_rows():
    scenario = replace(pushed("puma560"), duration=1000.0, recording=aw.Recording(period=1e-9))
    with raises_at(ScenarioError, "recording", "recording.period .* 1e-09 s"):
        aw.simulate(scenario)


def test_a_coarse_step_given_by_hand_is_noted_with_one_that_would_do():
    coarse = replace(pushed("puma560", 1.0), solver=aw.Solver(step=5e-3))
    note = aw.simulate(coarse).attrs["notes"]
    assert "a step of 0.005 s is coarse: qd of " in note
    enough = float(note.split("one lane; ")[1].split(" s would do")[0])
    fine = aw.simulate(replace(coarse, solver=aw.Solver(step=enough)))
    assert "is coarse" not in fine.attrs["notes"]
    exact = aw.simulate(replace(coarse, solver=aw.Solver("cvodes", enough)))
    assert wrong_by(fine, exact) < 2e-3


def test_a_coarse_number_of_substeps_is_noted_too():
    scenario = scenario_of(
        arm("puma560"),
        duration=0.2,
        controller=aw.JointPID(kp=200.0, kd=20.0),
        reference=np.full(6, 0.5),
        period=5e-3,
        substeps=1,
    )
    assert "substeps = " in aw.simulate(scenario).attrs["notes"]


def test_lanes_that_run_out_of_substeps_are_noted():
    lanes = aw.Batch(np.array([np.zeros(6), 40.0 * np.ones(6)]))
    solver = aw.Solver(accuracy=1e-9, max_substeps=3)
    run = aw.simulate(replace(pushed("puma560"), command=lanes, solver=solver))
    assert "lanes ran out of substeps and stay where they are, first at t = " in run.attrs["notes"]


def test_a_geared_motor_with_inductance_alone_takes_a_step_by_hand():
    """All that moves but the position is integrated exactly or has no stiffness: nothing limits the step."""
    model = pendulum(motor={**MOTOR, "inductance_h": 1e-4}, gravity=0.0)
    run = aw.simulate(aw.Scenario(model, 0.05, command=[12.0], solver=aw.Solver(step=1e-3)))
    assert np.isfinite(run.qd.values).all()


def test_behind_a_spring_a_joint_that_sticks_gets_the_springs_torque():
    """Until its friction gives way, what leaves the gear is k (θ/n - q), and not what the friction holds."""
    stuck = {"coulomb_positive_n_m": 50.0, "coulomb_negative_n_m": 50.0, "viscous_n_m_s_per_rad": 0.0}
    model = pendulum(motor=MOTOR, gravity=0.0, friction=stuck, elasticity=SOFT)
    run = aw.simulate(aw.Scenario(model, 0.2, command=[2.0]))
    assert (run.qd.values == 0.0).all()
    ratio = model.coordinates[0].drive.gear_ratio
    spring = SOFT["stiffness_n_m_per_rad"] * (run.motor_q.values / ratio - run.q.values)
    damper = SOFT["damping_n_m_s_per_rad"] * (run.motor_qd.values / ratio - run.qd.values)
    np.testing.assert_allclose(run.tau_link, spring + damper, rtol=1e-9, atol=1e-12)
