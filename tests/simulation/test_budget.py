"""Steps of "rk45" with an accuracy: errors of the whole run stay below it, and rows change nothing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.errors import ScenarioError
from simulation.plants import MOTOR, STOPS, chain, pendulum

PULL = 3.0 * 9.81 * 0.3 / 0.37  # m g l / J of the rod in `plants` [1/s²]
DOWN = np.pi / 2  # where it hangs [rad]
LIMITS = {"position_rad": [-1.0, 1.0]}
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
        solver=aw.Solver("rk45", **{"accuracy": 1e-3, **solver}),
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
    assert run.attrs["integrator"] == "rk45"
    assert run.attrs["accuracy"] == accuracy
    assert wrong_by(run) < accuracy
    assert STAGES * float(run.steps_tried) < dear * duration


def test_rows_change_nothing(rod):
    """But the length of the first trial, which is a row's."""
    ends = [aw.simulate(swing(rod, 1.5, 20.0, period)).q.values[-1, 0] for period in (1e-3, 1e-2, 0.1, 0.5)]
    assert np.ptp(ends) < 2 * 1e-3 * 3.0
    assert np.ptp(ends) < 1e-4
    rare, often = (aw.simulate(swing(rod, 1.5, 20.0, period)) for period in (0.5, 1e-2))
    assert abs(int(rare.steps_tried) - int(often.steps_tried)) < 30


def test_ten_times_the_accuracy_is_five_times_as_right(rod):
    errors = [wrong_by(aw.simulate(swing(rod, 1.5, 20.0, accuracy=10.0**-k))) for k in range(3, 9)]
    assert (np.divide(errors[:-1], errors[1:]) > 5.0).all()
    assert errors[-1] < 1e-8


def test_cogging_is_not_jumped_over():
    arm = pendulum("torque", 0.0, motor={**MOTOR, "gear_ratio": 100.0, "cogging": COGGING})
    whole_run = aw.Solver("rk45", accuracy=1e-3)
    scenario = aw.Scenario(arm, 3.0, command=[0.0], start=aw.Start(qd=[0.3]), solver=whole_run)
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
        run = aw.simulate(replace(scenario, solver=aw.Solver("rk45", accuracy=accuracy)))
        for name in ("q", "qd"):
            error = np.abs(run[name].values - exact[name].values).max(axis=0) / np.ptp(exact[name].values, axis=0)
            assert (error < accuracy).all()


def test_halves_and_single_ticks_are_the_whole_run(rod):
    """The length of the whole run is part of the state."""
    scenario = swing(rod, 1.5, 1.0)
    whole = aw.simulate(scenario)
    simulation = aw.Simulation(scenario)
    first = simulation.run(0.37)
    rest = aw.simulate(replace(scenario, duration=0.63, start=first))
    np.testing.assert_array_equal(np.concatenate([first.q.values[:-1], rest.q.values]), whole.q.values)
    stepped = aw.Simulation(scenario)
    for _ in range(370):
        stepped.step()
    np.testing.assert_array_equal(stepped.plant_state.q, whole.q.values[37])


def test_a_state_that_was_changed_is_where_it_goes_on(rod):
    """What the last step found beyond its tick counts no longer."""
    scenario = swing(rod, 1.5, 1.0)
    simulation = aw.Simulation(scenario)
    simulation.run(0.5)
    state = simulation.state
    moved = replace(state, blocks={**state.blocks, "x": state.blocks["x"] + [0.3, 0.0]})
    run = aw.simulate(replace(scenario, duration=0.5, start=moved))
    anew = aw.simulate(replace(scenario, duration=0.5, start=aw.Start(*moved.blocks["x"].T)))
    np.testing.assert_allclose(run.q.values, anew.q.values, atol=1e-4)


def test_a_run_without_an_end_states_how_long_it_is_to_be_right(rod):
    scenario = replace(swing(rod, 1.5, 60.0), solver=aw.Solver("rk45", accuracy=1e-3, horizon=600.0))
    assert scenario.horizon == 600.0
    longer, own = aw.simulate(scenario), aw.simulate(swing(rod, 1.5, 60.0))
    assert longer.steps_tried > own.steps_tried
    with pytest.raises(ScenarioError) as error:
        aw.Solver(horizon=10.0)
    assert "solver.horizon = 10.0" in str(error.value)
    with pytest.raises(ScenarioError) as error:
        aw.Solver("rk45", accuracy=1e-3, horizon=-1.0)
    assert "a time above 0" in str(error.value)


def test_a_lanes_bits_do_not_depend_on_its_neighbours():
    arm, many = aw.load("puma560"), 1000
    rng = np.random.default_rng(3)
    volts, speeds = rng.uniform(-40, 40, (many, 6)), rng.uniform(-1, 1, (many, 6))

    def ends(lanes):
        solver, recording = aw.Solver("rk45", accuracy=1e-3), aw.Recording(every=0, what="state")
        start = aw.Start(qd=aw.Batch(speeds[lanes]))
        return aw.simulate(
            aw.Scenario(arm, 0.05, command=aw.Batch(volts[lanes]), start=start, solver=solver, recording=recording)
        )

    alone, all_ = ends(slice(77, 78)), ends(slice(0, many))
    for name in ("q", "qd", "steps_tried", "steps_repeated", "largest_error"):
        np.testing.assert_array_equal(alone[name].values[0], all_[name].values[77])
    assert len(np.unique(all_.steps_tried)) > 1


def test_what_it_cannot_keep_is_refused(rod):
    """By the name of what stands in the way, before anything moves."""
    solver = aw.Solver("rk45", accuracy=1e-3)
    held = pendulum(
        "torque", friction={"viscous_n_m_s_per_rad": 0.1, "coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.0}
    )
    stopped = pendulum("torque", stops=STOPS, limits=LIMITS)
    loop = aw.Loop(aw.JointPID(kp=1.0, kd=1.0), [0.0], 1e-3)
    event = aw.Solver("rk45", accuracy=1e-3, events={"down": lambda t, x: x.q[0] - DOWN})
    cases = {
        "a sampled loop": aw.Scenario(rod, 0.1, loop=loop, solver=solver),
        "solver.events": aw.Scenario(rod, 0.1, command=[0.0], solver=event),
        "which sticks": aw.Scenario(held, 0.1, command=[0.0], solver=solver),
        "stops or play": aw.Scenario(stopped, 0.1, command=[0.0], solver=solver),
    }
    for said, scenario in cases.items():
        with pytest.raises(ScenarioError) as error:
            aw.simulate(scenario)
        assert said in str(error.value)
    with pytest.raises(ScenarioError) as error:
        aw.Solver("rk45", accuracy=1e-3, rtol=1e-6)
    assert "'rk45' without accuracy" in str(error.value)


def test_a_scenario_file_says_the_same(tmp_path):
    file = tmp_path / "move.scenario.toml"
    solver = '[solver]\nintegrator = "rk45"\naccuracy = 1e-4\nhorizon_s = 5.0\n'
    file.write_text(f'robot = "two-link"\nduration_s = 0.1\n[commands]\nconstant = [1.0, 0.0]\n{solver}')
    scenario = aw.read_scenario(file)
    assert (scenario.solver.accuracy, scenario.horizon) == (1e-4, 5.0)
