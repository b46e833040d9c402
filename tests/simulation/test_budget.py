"""Steps of "auto" where nothing is sampled and nothing switches: errors of the whole run stay below its accuracy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.errors import ScenarioError
from raises_at import raises_at
from simulation.plants import MOTOR, chain, pendulum

PULL = 3.0 * 9.81 * 0.3 / 0.37  # m g l / J of the rod in `plants` [1/s²]
DOWN = np.pi / 2  # where it hangs [rad]
STAGES = 7  # evaluations of a step
COGGING = {"amplitude_n_m": 0.5, "periods": 84, "phase_rad": 0.0}


@pytest.fixture(scope="module")
def rod():
    """A rod without friction."""
    return pendulum("torque")


def swing(arm, angle, duration, period=1e-2, **solver):
    """It is let go at an angle from where it hangs."""
    return aw.Scenario(
        arm,
        duration,
        command=[0.0],
        start=aw.Start(q=[DOWN + angle]),
        solver=aw.Solver(**solver),
        recording=aw.Recording(period=period),
    )


def wrong_by(run):
    """Largest errors of q and q̇ in parts of their ranges; SciPy's rule of order 8 is the truth."""
    start, times = [run.q.values[0, 0], 0.0], run.time.values
    exact = solve_ivp(
        lambda _, x: [x[1], PULL * np.cos(x[0])], (0.0, times[-1]), start, "DOP853", times, rtol=1e-13, atol=1e-13
    ).y
    found = (run.q.values[:, 0], run.qd.values[:, 0])
    return max(np.abs(mine - true).max() / np.ptp(true) for mine, true in zip(found, exact, strict=True))


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("angle", "duration", "accuracy", "dear"),  # evaluations a simulated second, at most
    [
        *((1.5, 10.0, 1e-3, 250), (1.5, 60.0, 1e-3, 300), (1.5, 300.0, 1e-3, 400)),
        *((3.0, 10.0, 1e-3, 250), (3.0, 60.0, 1e-3, 300), (3.0, 300.0, 1e-5, 1200)),
        (1.5, 300.0, 1e-6, 2000),
    ],
)
def test_a_swing_is_right_to_its_end(rod, angle, duration, accuracy, dear):
    run = aw.simulate(swing(rod, angle, duration, accuracy=accuracy))
    assert run.attrs["rule"] == "rk45"
    assert wrong_by(run) < accuracy
    assert STAGES * float(run.steps_tried) < dear * duration


def test_rows_change_nothing(rod):
    """But the length of the first trial, which is a row's."""
    ends = [aw.simulate(swing(rod, 1.5, 20.0, period)).q.values[-1, 0] for period in (1e-3, 1e-2, 0.1, 0.5)]
    assert np.ptp(ends) < 2 * 1e-3 * 3.0
    assert np.ptp(ends) < 1e-4
    rare, often = (aw.simulate(swing(rod, 1.5, 20.0, period)) for period in (0.5, 1e-2))
    assert abs(int(rare.steps_tried) - int(often.steps_tried)) < 30


@pytest.mark.study
def test_ten_times_the_accuracy_is_five_times_as_right(rod):
    errors = [wrong_by(aw.simulate(swing(rod, 1.5, 20.0, accuracy=10.0**-k))) for k in range(3, 9)]
    assert (np.divide(errors[:-1], errors[1:]) > 5.0).all()
    assert errors[-1] < 1e-8


@pytest.mark.study
def test_cogging_is_not_jumped_over():
    arm = pendulum("torque", 0.0, motor={**MOTOR, "gear_ratio": 100.0, "cogging": COGGING})
    scenario = aw.Scenario(arm, 3.0, command=[0.0], start=aw.Start(qd=[0.3]))
    run = aw.simulate(scenario)
    exact = aw.simulate(replace(scenario, solver=aw.Solver("cvodes")))
    assert np.ptp(exact.qd.values) > 0.015  # it is felt
    for name in ("q", "qd"):
        assert np.abs(run[name].values - exact[name].values).max() < 1e-3 * np.ptp(exact[name].values)


def test_a_command_that_changes_within_a_step_is_met():
    """Rows of a schedule between recorded rows, and on them; steps that reached beyond are taken anew."""
    arm = chain([{"command": "torque"}, {"command": "torque"}])
    times = [0.0, 0.1037, 0.2, 0.25, 0.2501, 0.7]
    torques = [[20.0, 3.0], [-5.0, 1.0], [10.0, -4.0], [0.0, 8.0], [3.0, 0.0], [-20.0, -2.0]]
    command = aw.Schedule(times, torques, ["joint0", "joint1"])
    scenario = aw.Scenario(arm, 1.0, command=command, recording=aw.Recording(period=1e-2))
    exact = aw.simulate(replace(scenario, solver=aw.Solver("cvodes")))
    for accuracy in (1e-3, 1e-6, 1e-8):
        run = aw.simulate(replace(scenario, solver=aw.Solver(accuracy=accuracy)))
        for name in ("q", "qd"):
            error = np.abs(run[name].values - exact[name].values).max(axis=0) / np.ptp(exact[name].values, axis=0)
            assert (error < accuracy).all()


def test_halves_and_single_ticks_are_the_whole_run(rod):
    """The length of the whole run is part of the state."""
    scenario = swing(rod, 1.5, 1.0)
    whole = aw.simulate(scenario)
    simulation = aw.simulation.Simulation(scenario)
    first = simulation.run(0.37)
    rest = aw.simulate(replace(scenario, duration=0.63, start=first))
    np.testing.assert_array_equal(np.concatenate([first.q.values[:-1], rest.q.values]), whole.q.values)
    stepped = aw.simulation.Simulation(scenario)
    for _ in range(37):
        stepped.step()
    np.testing.assert_array_equal(stepped.plant_state.q, whole.q.values[37])


def test_a_state_that_was_changed_is_where_it_goes_on(rod):
    """What the last step found beyond its tick counts no longer."""
    scenario = swing(rod, 1.5, 1.0)
    simulation = aw.simulation.Simulation(scenario)
    simulation.run(0.5)
    state = simulation.state
    moved = replace(state, blocks={**state.blocks, "x": state.blocks["x"] + [0.3, 0.0]})
    run = aw.simulate(replace(scenario, duration=0.5, start=moved))
    anew = aw.simulate(replace(scenario, duration=0.5, start=aw.Start(*moved.blocks["x"].T)))
    np.testing.assert_allclose(run.q.values, anew.q.values, atol=1e-4)


def test_a_run_without_an_end_states_how_long_it_is_to_be_right(rod):
    scenario = replace(swing(rod, 1.5, 60.0), solver=aw.Solver(horizon=600.0))
    assert scenario.horizon == 600.0
    longer, own = aw.simulate(scenario), aw.simulate(swing(rod, 1.5, 60.0))
    assert longer.steps_tried > own.steps_tried
    with pytest.raises(ScenarioError) as error:
        aw.Solver("rk3", horizon=10.0)
    assert "solver.horizon = 10.0" in str(error.value)
    with pytest.raises(ScenarioError) as error:
        aw.Solver(horizon=-1.0)
    assert "a time above 0" in str(error.value)


BOUNCING = {"stiffness_n_m_per_rad": 1e5, "damping_n_m_s_per_rad": 0.0}


def lost(accuracy, period):
    """Part of its speed that a free joint loses over five bounces between undamped stops."""
    arm = pendulum("torque", gravity=0.0, friction=None, stops=BOUNCING, limits={"position_rad": [-0.1, 0.1]})
    run = aw.simulate(
        aw.Scenario(
            arm,
            1.2,
            command=[0.0],
            start=aw.Start(qd=[1.0]),
            solver=aw.Solver(accuracy=accuracy),
            recording=aw.Recording(period=period),
        )
    )
    return abs(abs(float(run.qd.values[-1, 0])) - 1.0)


def test_undamped_stops_keep_the_speed():
    assert max(lost(1e-3, period) for period in (1e-3, 1e-2, 0.1)) < 1e-6
    errors = [lost(10.0**-k, 1e-2) for k in range(3, 9)]
    assert (np.divide(errors[:-1], np.maximum(errors[1:], 1e-14)) > 5.0).all()


def test_friction_stops_a_joint_where_and_when_it_does():
    """Coulomb friction alone: J v² / 2 = F q, and it then rests for ever."""
    rough = {"viscous_n_m_s_per_rad": 0.0, "coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.0}
    arm = pendulum("torque", gravity=0.0, friction=rough)
    inertia = float(aw.mass_matrix(arm, np.zeros(1))[0, 0])
    run = aw.simulate(aw.Scenario(arm, 2.0, command=[0.0], start=aw.Start(qd=[1.0])))
    assert run.q.values[-1, 0] == pytest.approx(0.5 * inertia / 2.0, rel=1e-12)
    assert run.qd.values[-1, 0] == 0.0


@pytest.mark.sample(1)
@pytest.mark.parametrize(("angle", "duration"), [(1.5, 60.0), (3.0, 300.0)])
def test_a_run_says_how_wrong_it_is(rod, angle, duration):
    """Within a factor of 3; and where the accuracy is not kept, what would keep it."""
    run = aw.simulate(swing(rod, angle, duration))
    wrong, said = wrong_by(run), float(run.global_error.max())
    assert wrong / 3.0 < said < 3.0 * wrong
    assert list(run.quantity.values) == ["q", "qd"]
    assert ("errors of integration reach" in run.attrs["notes"]) == (said > 1e-3)
    assert ("accuracy = 1e-04 would do" in run.attrs["notes"]) == (said > 1e-3)
    alone = aw.simulate(swing(rod, angle, duration, global_error=False))
    assert "global_error" not in alone
    np.testing.assert_array_equal(alone.q, run.q)


def test_a_sensitive_motion_is_called_so():
    """Two links that turn over, without friction."""
    arm = chain([{"command": "torque"}] * 2)
    start = aw.Start(q=[3.0, 0.5])
    run = aw.simulate(aw.Scenario(arm, 60.0, command=[0.0, 0.0], start=start, recording=aw.Recording(period=0.02)))
    assert float(run.global_error.max()) > 1e-3
    assert "the motion is sensitive, errors grow tenfold every" in run.attrs["notes"]


@pytest.mark.study
def test_counts_leave_errors_unsaid():
    arm = aw.load("cmu-dd")
    controller = aw.JointPID(kp=[100.0] * 6, kd=[10.0] * 6)
    loop = aw.Loop(controller, np.full(6, 0.1), period=1e-3)
    assert "global_error" in aw.simulate(aw.Scenario(arm, 0.05, loop=loop))
    assert "global_error" not in aw.simulate(
        aw.Scenario(arm, 0.05, loop=replace(loop, sensors=aw.Sensors(counts=4096)))
    )


def test_a_scenario_file_says_true_or_false(tmp_path):
    path = tmp_path / "one.scenario.toml"
    path.write_text('robot = "two-link"\nduration_s = 0.1\ncommands.constant = 0\nsolver.global_error = "yes"\n')
    with raises_at(ScenarioError, "solver.global_error", value="yes"):
        aw.read_scenario(path)
