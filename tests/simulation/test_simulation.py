"""Voltages in, motion out: against SciPy's integrator, closed forms and the laws of energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.description.database import parse
from armwright.errors import DivergenceError, ScenarioError
from armwright.kernels.target import select_target
from armwright.model import build_model
from armwright.model.changes import without_servos
from armwright.simulation.loop.compiled import compile_loop
from armwright.simulation.plant.plant import plant_derivative
from physics.arms import friction_at
from raises_at import raises_at
from simulation.fields import scenario_of

LEVEL = {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}
DISC = {"xx": 0.01, "xy": 0, "xz": 0, "yy": 0.01, "yz": 0, "zz": 0.02}

RK3 = aw.Solver("rk3")  # of the loops that are compiled here


def motor_alone(**more) -> aw.Model:
    """A disc on a vertical axis, driven by a voltage: one motor, no gravity torque."""
    joint = {
        "name": "axis",
        "type": "revolute",
        "parent": "base",
        "child": "disc",
        "frame": LEVEL,
        "axis": [0, 0, 1],
        "motor": {
            "gear_ratio": -5.0,
            "rotor_inertia_kg_m2": 1e-4,
            "torque_constant_n_m_per_a": 0.05,
            "resistance_ohm": 0.8,
            **more.pop("motor", {}),
        },
        "friction": {"viscous_n_m_s_per_rad": 0.03},
        **more,
    }
    link = {"name": "disc", "mass_kg": 1.0, "com_m": [0, 0, 0], "inertia_kg_m2": DISC}
    return build_model(
        parse(
            {"name": "motor", "source": "definition", "command": "voltage", "joints": [joint], "links": [link]}, "test"
        )
    )


def final(run) -> np.ndarray:
    """The last state (…, 2n) of a run."""
    return np.concatenate([run.q.values[..., -1, :], run.qd.values[..., -1, :]], axis=-1)


@pytest.fixture(scope="module")
def cmu():
    """The CMU arm and its compiled loop."""
    arm = aw.load("cmu-dd")
    return arm, compile_loop(arm)


def test_motor_reaches_the_speed_its_constants_say():
    """At constant voltage:  q̇(∞) = (n Kt/R) V / (n² Kt Ke/R + b), reached as 1 - exp(-t/T)."""
    arm = motor_alone()
    drive = arm.bodies[0].drive
    stall = drive.gear_ratio * drive.torque_constant / drive.resistance
    damping = stall * drive.gear_ratio * drive.back_emf_constant + 0.03
    inertia = 0.02 + 25 * 1e-4
    run = aw.simulate(aw.Scenario(arm, duration=6.0, command=[6.0], solver=aw.Solver(accuracy=1e-8)))
    speed = stall * 6.0 / damping
    assert speed < 0  # the gear turns the direction round
    assert run.qd.values[-1, 0] == pytest.approx(speed, rel=1e-9)
    expected = speed * (1 - np.exp(-run.time.values * damping / inertia))
    assert np.allclose(run.qd.values[:, 0], expected, rtol=0, atol=1e-6 * abs(speed))
    assert run.current.values[0, 0] == pytest.approx(6.0 / 0.8)
    assert run.voltage.values[-1, 0] == 6.0


def test_against_scipy(cmu):
    """The whole CMU arm with motors, DOP853 at 1e-11, tolerance of RK3 at 1 ms."""
    arm, loop = cmu
    u = np.array([20.0, -15.0, 8.0, 5.0, -2.0, 1.5])
    run = aw.simulate(aw.Scenario(arm, duration=0.6, command=u, solver=RK3), loop=loop)
    exact = solve_ivp(
        lambda t, x: plant_derivative(arm, x, u), (0, 0.6), np.zeros(12), "DOP853", rtol=1e-11, atol=1e-12
    )
    assert np.abs(final(run) - exact.y[:, -1]).max() < 1e-6


DRIVEN = {  # commands in each arm's own unit that keep it moving, and speeds to start with: friction stays smooth there
    "cmu-dd": ([10.0, -40.0, 20.0, 15.0, -4.0, 3.0], [0.5, -0.5, 0.5, 0.5, -0.5, 0.5]),
    "puma560": ([-20.0, 25.0, -20.0, 6.0, 6.0, 6.0], [0.8, 0.8, 0.8, 1.0, 1.0, 1.0]),
    "lwa4p": ([5.0, 8.0, 6.0, 5.0, 1.5, 1.5], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "panda": ([5.0, -20.0, 5.0, 20.0, 1.0, 2.0, 1.0], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "two-link": ([90.0, 20.0], [0.5, 0.5]),
    "ur5e": ([0.64, -2.9, -0.2, 0.47, 0.13, 0.23], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "ur10e": ([1.4, -5.7, -1.1, 0.65, 0.27, 0.33], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "ur3": ([4.0, -10.0, -1.2, 2.0, 0.8, 1.0], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "ur5": ([10.0, -34.0, 2.0, 4.0, 2.0, 2.2], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "ur10": ([1.5, -5.2, -0.7, 0.8, 0.4, 0.55], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "iiwa14": ([0.83, -22.0, -1.4, -0.24, 0.26, -0.16, 0.19], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "xarm7": ([3.7, -11.0, 3.8, 6.0, 1.9, 0.74, 1.3], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "gen3": ([3.3, -9.1, 3.5, -2.4, 0.81, -0.12, 0.63], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]),
    "so101": ([1.4, 0.28, 0.87, 1.4, 1.5, 1.5], [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
    "so100": ([1.5, 1.6, 0.59, 1.4, 1.5, 1.5], [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
    "koch": ([7.5, 8.4, 1.9, 3.0, 2.7, 2.7], [4.0, 4.0, 6.0, 6.0, 6.0, 6.0]),
    "widowx250": ([8.0, 3.0, 9.0, 8.0, 8.0, 8.0], [3.0, 3.0, 3.0, 3.0, 3.0, 4.0]),
    "open-manipulator-x": ([2.7, 1.3, 2.1, 2.7], [1.0, 1.0, 1.0, 1.0]),
}


@pytest.fixture(scope="module", params=sorted(DRIVEN))
def driven(request):
    """An arm without end stops, of servos what is behind their loops, its compiled loop, commands and a start."""
    arm = without_servos(aw.load(request.param))
    arm = replace(arm, bodies=tuple(replace(body, stops=None) for body in arm.bodies))
    command, qd0 = DRIVEN[request.param]
    q0 = np.array([np.clip(0.4, *body.limits.position) for body in arm.bodies])
    return arm, compile_loop(arm), {"command": command, "q0": q0, "qd0": qd0}


def test_every_arm_is_driven():
    """A new built-in arm wants a line in the table."""
    assert set(DRIVEN) == set(aw.builtin_names())


@pytest.mark.sample(1)
def test_order_three(driven):
    """Halving the step divides RK3's error by 8."""
    arm, loop, start = driven
    ends = {
        h: final(aw.simulate(scenario_of(arm, duration=0.064, step=h, **start, every=0), loop=loop))
        for h in (5e-4, 2.5e-4, 1.25e-4, 7.8125e-6)
    }
    errors = [np.abs(ends[h] - ends[7.8125e-6]).max() for h in (5e-4, 2.5e-4, 1.25e-4)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 3.0) < 0.25), (orders, errors)


@pytest.mark.sample(1)
def test_energy_balance(driven):
    """d(T + U)/dt = power of the motors - power lost in friction, integrated along a run by Simpson's rule."""
    from scipy.integrate import simpson

    arm, loop, start = driven
    run = aw.simulate(scenario_of(arm, duration=0.2, step=1e-4, **start), loop=loop)
    time, q, qd, tau = (values[::4] for values in (run.time.values, *(run[name].values for name in ("q", "qd", "tau"))))
    energy = [aw.kinetic_energy(arm, q[k], qd[k]) + aw.potential_energy(arm, q[k]) for k in (0, -1)]
    into = simpson(np.sum(tau * qd, axis=1), x=time)
    lost = simpson([friction_at(arm, *row) @ row[1] for row in zip(q, qd, tau, strict=True)], x=time)
    assert energy[1] - energy[0] == pytest.approx(into - lost, rel=0, abs=1e-6 * max(abs(into), abs(lost)))
    assert abs(into) > 0.01  # [J] and something did happen, small arms included


def test_electrical_power_is_heat_and_motion(cmu):
    """V i = R i² + tau q̇, row by row."""
    arm, loop = cmu
    run = aw.simulate(aw.Scenario(arm, duration=0.2, command=np.full(6, 5.0), solver=RK3), loop=loop)
    resistance = np.array([body.drive.resistance for body in arm.bodies])
    v, i, tau, qd = (run[name].values for name in ("voltage", "current", "tau", "qd"))
    assert np.allclose(v * i, resistance * i**2 + tau * qd, rtol=0, atol=1e-10 * np.abs(v * i).max())


def test_bits_do_not_depend_on_lanes_threads_or_width(cmu):
    """The lane's own bits, whatever the number of lanes, its place, the threads, the vector width."""
    arm, loop = cmu
    rng = np.random.default_rng(5)
    command, q0 = rng.uniform(-5, 5, (37, 6)), rng.uniform(-1, 1, (37, 6))
    whole = aw.simulate(
        aw.Scenario(arm, duration=0.1, command=aw.Batch(command), start=aw.Batch(q0), solver=RK3), loop=loop
    )
    for lane in (0, 7, 8, 36):
        alone = aw.simulate(
            aw.Scenario(arm, duration=0.1, command=command[lane], start=q0[lane], solver=RK3), loop=loop
        )
        assert np.array_equal(final(alone), final(whole)[lane])
        assert np.array_equal(alone.qdd.values, whole.qdd.values[lane])
    tiled = {"command": aw.Batch(np.tile(command, (8, 1))), "q0": aw.Batch(np.tile(q0, (8, 1)))}
    many = scenario_of(arm, duration=0.1, every=0, **tiled)
    for threads in (1, 2, 3):
        assert np.array_equal(final(aw.simulate(many, loop=loop, threads=threads)), np.tile(final(whole), (8, 1)))
    if select_target().width == 8:
        lanes = {"command": aw.Batch(command), "q0": aw.Batch(q0)}
        narrow = aw.simulate(scenario_of(arm, duration=0.1, target="x86-64-v3", **lanes))
        assert np.array_equal(narrow.q.values, whole.q.values)


@pytest.mark.study
def test_schedule_rows_are_landed_on(cmu):
    """Rows on and between ticks act at their own times: against SciPy restarted at every row."""
    arm, loop = cmu
    times = np.array([0.0, 0.01234321, 0.01236789, 0.05, 0.0876543, 0.1])
    commands = np.random.default_rng(6).uniform(-8, 8, (6, 6))
    schedule = aw.Schedule(times, commands, tuple(arm.names))
    run = aw.simulate(aw.Scenario(arm, duration=0.12, command=schedule, solver=aw.Solver(step=1e-4)), loop=loop)
    x = np.zeros(12)
    for first, last, u in zip(times, [*times[1:], 0.12], commands, strict=True):
        x = solve_ivp(
            lambda t, x, u=u: plant_derivative(arm, x, u), (first, last), x, "DOP853", rtol=1e-12, atol=1e-13
        ).y[:, -1]
    assert np.abs(final(run) - x).max() < 1e-8  # a row put on the next tick would cost 1e-4
    for row, command in ((500, 3), (123, 0), (124, 2)):
        assert np.array_equal(run.u.values[row], commands[command])


def test_schedules_a_lane(cmu):
    """Lanes with schedules of their own, rows at different times: each lane's bits are those of its own run."""
    arm, loop = cmu
    rng = np.random.default_rng(7)
    schedules = [
        aw.Schedule(
            np.concatenate([[0.0], np.sort(rng.uniform(0.001, 0.09, k))]),
            rng.uniform(-5, 5, (k + 1, 6)),
            tuple(arm.names),
        )
        for k in range(11)
    ]
    together = aw.simulate(aw.Scenario(arm, duration=0.1, command=aw.Batch(schedules), solver=RK3), loop=loop)
    for lane in (0, 1, 5, 10):
        alone = aw.simulate(aw.Scenario(arm, duration=0.1, command=schedules[lane], solver=RK3), loop=loop)
        assert np.array_equal(alone.q.values, together.q.values[lane])
        assert np.array_equal(alone.u.values, together.u.values[lane])


def test_row_beside_a_tick_is_put_on_it():
    """0.3 s written in decimals is tick 300, though 300 · 0.001 is another double."""
    arm = aw.load("two-link")
    rows = aw.Schedule(np.array([0.0, 0.3, 0.7]), np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]]), ("shoulder", "elbow"))
    run = aw.simulate(aw.Scenario(arm, duration=0.9, command=rows))
    assert [int(k) for k in np.flatnonzero(np.any(np.diff(run.u.values, axis=0), axis=1)) + 1] == [300, 700]


def test_diverged_lane_is_frozen_and_the_rest_go_on():
    """A lane with an absurd speed diverges; its neighbours keep their bits."""
    arm = aw.load("two-link")
    qd0 = np.random.default_rng(8).normal(size=(10, 2))
    clean = aw.simulate(aw.Scenario(arm, duration=0.05, command=np.zeros(2), start=aw.Start(qd=aw.Batch(qd0))))
    qd0[3] = 1e200
    run = aw.simulate(aw.Scenario(arm, duration=0.05, command=np.zeros(2), start=aw.Start(qd=aw.Batch(qd0))))
    assert np.isfinite(run.q.values).all()
    assert run.diverged_at.values[3] == 0.0
    assert np.isnan(np.delete(run.diverged_at.values, 3)).all()
    assert np.array_equal(np.delete(run.q.values, 3, axis=0), np.delete(clean.q.values, 3, axis=0))
    with pytest.raises(DivergenceError, match=r"two-link: .*diverged .* t = 0 s"):
        aw.simulate(aw.Scenario(arm, duration=0.05, command=np.zeros(2), start=aw.Start(qd=[1e200, 0])))


def test_a_simulation_that_diverged_stays_where_it_was():
    simulation = aw.simulation.Simulation(
        aw.Scenario(aw.load("two-link"), duration=0.05, command=np.zeros(2), start=aw.Start(qd=[1e200, 0]))
    )
    for _ in range(2):
        with pytest.raises(DivergenceError, match="t = 0 s"):
            simulation.run()
        assert simulation.tick == simulation.state.tick == 0


def test_step_too_large_is_refused_before_it_runs():
    """Names the time constant and a step that does; that step is then taken, and the run stays bounded."""
    arm = motor_alone(motor={"resistance_ohm": 0.01})
    drive = arm.bodies[0].drive
    constant = (0.02 + 25e-4) / (25 * drive.torque_constant**2 / drive.resistance + 0.03)
    with raises_at(ScenarioError, "step", r"expected 0\.00[0-9]+ s", value=0.01) as caught:
        aw.simulate(aw.Scenario(arm, duration=0.1, command=[1.0], solver=aw.Solver(step=0.01)))
    assert f"{constant:.3g} s" in str(caught.value)
    would_do = float(caught.value.expected.split()[0])
    assert 0.25 * constant < would_do < 0.75 * constant
    run = aw.simulate(aw.Scenario(arm, duration=100 * would_do, command=[1.0], solver=aw.Solver(step=would_do)))
    assert abs(run.qd.values[-1, 0]) == pytest.approx(0.25 / 0.01 / (25 * 0.05**2 / 0.01 + 0.03), rel=1e-6)


def test_coulomb_friction_bounds_the_step():
    """An explicit rule needs h < 2.5 J qd_smooth / Fc, here far less than 1 ms."""
    friction = {"coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.0, "smoothing_rad_per_s": 1e-4}
    arm = motor_alone(friction=friction)
    with raises_at(ScenarioError, "step", r"dry friction .*'axis' \(friction\.smoothing_rad_per_s\)"):
        aw.simulate(aw.Scenario(arm, duration=0.1, command=[1.0], solver=aw.Solver(step=1e-3)))
    limit = 2.5127 * (0.02 + 25e-4) * 1e-4 / 2.0
    assert compile_loop(arm).step_limit.largest_step(_rk3(), np.zeros(1)) == pytest.approx(limit, rel=0.01)


def _rk3():
    from armwright.simulation.integrate.integrators import INTEGRATORS

    return INTEGRATORS["rk3"]


def test_limits_clip_and_are_reported():
    """Voltage clipped to its limit, current realised through the voltage; the notes say so."""
    arm = motor_alone(limits={"voltage_v": 4.0, "current_a": 2.0})
    run = aw.simulate(aw.Scenario(arm, duration=0.5, command=[9.0]))
    assert np.abs(run.voltage.values).max() <= 4.0 + 1e-12
    assert np.abs(run.current.values).max() <= 2.0 + 1e-12
    assert run.voltage.values[0, 0] == pytest.approx(2.0 * 0.8)  # at rest the current limit is what holds
    assert "axis: the drive's limits clipped its voltage in 100% of the rows" in run.attrs["notes"]
    v, i, tau, qd = (run[name].values[:, 0] for name in ("voltage", "current", "tau", "qd"))
    assert np.allclose(v * i, 0.8 * i**2 + tau * qd, atol=1e-12)


@pytest.mark.parametrize(("volts", "said"), [(3.5, False), (0.3, False), (4.5, True)])
def test_a_dead_zone_is_no_limit(volts, said):
    """It takes its width from every command; only beyond 4 V does the limit take more."""
    arm = motor_alone(limits={"voltage_v": 4.0}, motor={"dead_zone_v": 0.5})
    run = aw.simulate(aw.Scenario(arm, duration=0.01, command=[volts]))
    assert run.voltage.values[0, 0] == pytest.approx(max(min(volts, 4.0) - 0.5, 0.0))
    assert ("limits clipped" in run.attrs["notes"]) is said


def test_a_limit_does_not_hide_a_diverged_lane():
    """Clipping keeps NaN: a lane that is lost is found by its state, not kept alive by its voltage limit."""
    arm = motor_alone(limits={"voltage_v": 4.0})
    far = aw.Batch([[1e308], [0.0]])
    run = aw.simulate(aw.Scenario(arm, duration=0.01, command=[1.0], start=aw.Start(far, far)))
    assert run.diverged_at.values[0] >= 0.0
    assert np.isnan(run.diverged_at.values[1])


def test_position_limit_is_reported():
    """Nothing stops the arm at its limit yet, but the run says that it was passed and when."""
    arm = aw.load("cmu-dd")
    run = aw.simulate(
        aw.Scenario(arm, duration=1.0, command=np.zeros(6), start=aw.Start([0, 1.5, 0, 0, 0, 0], [0, 8.0, 0, 0, 0, 0]))
    )
    assert any(
        note.startswith("joint2: passed its position limits [-1.92, 1.92] at t = 0.")
        for note in run.attrs["notes"].splitlines()
    )


def test_record_every_and_state_only(cmu):
    """Fewer rows are the same rows."""
    arm, loop = cmu
    full = aw.simulate(aw.Scenario(arm, duration=0.06, command=np.ones(6), solver=RK3), loop=loop)
    tenth = aw.simulate(
        aw.Scenario(arm, duration=0.06, command=np.ones(6), recording=aw.Recording(every=10), solver=RK3), loop=loop
    )
    ends = aw.simulate(
        aw.Scenario(arm, duration=0.06, command=np.ones(6), recording=aw.Recording(every=0, what="state"), solver=RK3),
        loop=loop,
    )
    assert np.array_equal(tenth.q.values, full.q.values[::10])
    assert np.array_equal(tenth.time.values, full.time.values[::10])
    assert np.array_equal(ends.q.values, full.q.values[[0, -1]])
    assert "tau" not in ends
    assert set(full.data_vars) == {"q", "qd", "qdd", "tau", "u", "voltage", "current", "loop_state"}


def test_progress_counts_all_steps(cmu):
    """The last call says that all is done, with one thread or more."""
    arm, loop = cmu
    for threads in (1, 2):
        seen = []
        scenario = aw.Scenario(
            arm, duration=0.1, command=aw.Batch(np.zeros((600, 6))), recording=aw.Recording(every=0), solver=RK3
        )
        aw.simulate(scenario, loop=loop, threads=threads, progress=lambda *steps, seen=seen: seen.append(steps))
        assert seen[-1][0] == seen[-1][1] > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"command": [0, 0]}, "duration = None"),
        ({"command": [0, 0], "duration": -1.0}, r"duration = -1\.0"),
        ({"command": [0, 0], "duration": float("nan")}, "duration = nan"),
        ({"command": [0, 0], "duration": 1.0, "step": 0}, "step = 0: expected"),
        ({"command": [0, 0], "duration": 1.0, "step": "fast"}, "step = 'fast': expected"),
        ({"command": [0, 0], "duration": 0.0105}, r"duration = 0\.0105"),
        ({"command": [0, 0], "duration": 1.0, "every": 3}, r"recording\.every = 3"),
        ({"command": [0, 0], "duration": 1.0, "every": -1}, r"recording\.every = -1"),
        ({"command": [0, 0], "duration": 1.0, "what": "some"}, r"recording\.what = 'some'"),
        ({"command": [0, 0, 0], "duration": 1.0}, r"command: shape \(3,\); expected \(2,\)"),
        ({"command": np.zeros((3, 2)), "duration": 1.0}, r"command: shape \(3, 2\); expected \(2,\): .* Batch"),
        ({"command": [0, float("nan")], "duration": 1.0}, "command = nan"),
        ({"command": ["a", "b"], "duration": 1.0}, "expected 2 numbers"),
        (
            {"command": [0, 0], "duration": 1.0, "q0": aw.Batch(np.zeros((3, 2))), "qd0": aw.Batch(np.zeros((4, 2)))},
            r"start\.qd: 4 lanes; .*3, as start\.q has",
        ),
        ({"command": [0, 0], "duration": 1.0, "integrator": "rk33"}, "integrator = 'rk33': unknown; .*mean rk3"),
        (
            {"command": aw.Schedule.constant(["a"], [1.0]), "duration": 1.0},
            r"command = \['a'\]: columns",
        ),
    ],
)
def test_scenarios_that_cannot_run(changes, message):
    """Refused before anything runs, naming the field, its value and what was expected."""
    with pytest.raises(ScenarioError, match=message):
        scenario_of(aw.load("two-link"), **changes)


def test_an_arm_that_nothing_drives_is_refused():
    """Commands from outside come step by step: a run of its own has none."""
    with raises_at(ScenarioError, "command", "nothing drives"):
        aw.simulate(aw.Scenario(aw.load("two-link"), duration=0.1))


def test_a_loop_serves_its_own_arm_only(cmu):
    """Another arm, or a variant of the same, is another loop: refused, not run with the wrong numbers."""
    arm, loop = cmu
    for other in (aw.load("two-link"), arm.replace(gravity=[0, 0, 0])):
        with raises_at(ScenarioError, "loop", "for arm"):
            aw.simulate(aw.Scenario(other, duration=0.1, command=np.zeros(other.n)), loop=loop)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"what": "state"}, "recorded states alone"),
        ({"what": "none", "reduce": ["peak_torque"]}, "reduction"),
        ({"wrench": np.ones(6)}, "wrench"),
        ({"command": None, "controller": aw.JointPID(kp=1.0)}, "sampling"),
    ],
)
def test_a_loop_of_another_kind_is_refused(fields, said):
    """A loop without what a run needs is refused in one line, not found out on the way."""
    common = {"command": np.zeros(2), "duration": 0.01}
    other = aw.simulation.Simulation(scenario_of(aw.load("two-link"), **(common | fields))).loop
    with raises_at(ScenarioError, "loop", said):
        aw.simulate(scenario_of(other.arm, **common), loop=other)


def test_a_loop_serves_scenarios_with_the_same_inputs_to_the_bit():
    """Other values, lanes and schedules, shared by lanes or not; states alone are enough for states alone."""
    arm, times = aw.load("two-link"), np.array([0.0, 0.0137, 0.05])
    pushes = [aw.Schedule(times, np.full((3, 6), level), ("fx", "fy", "fz", "mx", "my", "mz")) for level in (0.1, 0.2)]

    def scenario(masses, wrench):
        vary = {"forearm.mass_kg": aw.Batch(masses)}
        return scenario_of(arm, command=np.zeros(2), duration=0.1, wrench=wrench, vary=vary, what="state")

    loop = aw.simulation.Simulation(scenario([1.0], pushes[0])).loop
    masses, shared = [0.5, 0.7, 0.9], [pushes[1], pushes[0], pushes[1]]
    again = aw.simulate(scenario(masses, aw.Batch(shared)), loop=loop)
    copies = [replace(each) for each in shared]
    anew = aw.simulate(scenario(masses, aw.Batch(copies)))
    for name in ("q", "qd", "u"):
        np.testing.assert_array_equal(again[name].values, anew[name].values)
    assert len(np.unique(again["q"].values[:, -1, 0])) == 3


def test_gear_loss_under_load_bounds_the_step():
    """A gear's loss has the slope (1/η - 1) tau / (smoothing J): with tau, the step that does shrinks."""
    arm = motor_alone(
        command="torque",
        motor={"gear_efficiency": 0.6},
        friction={"smoothing_rad_per_s": 1e-3, "viscous_n_m_s_per_rad": 0.03},
    )
    with raises_at(ScenarioError, "step", "gear loss .*'axis'"):
        aw.simulate(aw.Scenario(arm, duration=0.1, command=[1.5], solver=aw.Solver(step=1e-3)))
    aw.simulate(aw.Scenario(arm, duration=0.1, command=[1e-3], solver=aw.Solver(step=1e-3)))


def test_a_swing_bounds_the_step():
    """An undamped pendulum wants a dozen steps a period; what is named then stays bounded for a minute."""
    arm = aw.load("two-link")
    with pytest.raises(ScenarioError, match="lose track") as caught:
        aw.simulate(aw.Scenario(arm, duration=60.0, command=[0, 0], start=[-1.5, 0], solver=aw.Solver(step=0.3)))
    step = float(caught.value.expected.split()[0])
    run = aw.simulate(
        aw.Scenario(arm, duration=600 * step, command=[0, 0], start=[-1.5, 0], solver=aw.Solver(step=step))
    )
    assert np.abs(run.qd.values).max() < 30


def test_steep_sigmoid_bounds_the_step():
    """A sigmoid is steepest at -shift, wherever that is: slope a b / 4."""
    law = {
        "law": "sigmoid",
        "sigmoid_amplitude_n_m": 5.0,
        "sigmoid_slope_s_per_rad": 1000.0,
        "sigmoid_shift_rad_per_s": 0.1,
    }
    arm = motor_alone(friction=law)
    limit = 2.5127 * (0.02 + 25e-4) / (5.0 * 1000.0 / 4)
    assert compile_loop(arm).step_limit.largest_step(_rk3(), np.zeros(1)) == pytest.approx(limit, rel=0.01)


def test_uneven_coulomb_friction_bounds_the_step_by_its_steeper_side():
    """Fc is the larger of the two."""
    arm = motor_alone(friction={"coulomb_positive_n_m": 1.0, "coulomb_negative_n_m": 5.0, "smoothing_rad_per_s": 1e-2})
    limit = 2.5127 * (0.02 + 25e-4) / (5.0 / 1e-2 + 25 * 0.05**2 / 0.8)
    assert compile_loop(arm).step_limit.largest_step(_rk3(), np.zeros(1)) == pytest.approx(limit, rel=0.01)


def test_columns_go_by_name():
    """A schedule written for the joints in another order drives the joints it names; another arm's is refused."""
    arm = aw.load("two-link")
    straight = aw.Schedule(np.zeros(1), np.array([[3.0, 1.0]]), ("shoulder", "elbow"))
    swapped = aw.Schedule(np.zeros(1), np.array([[1.0, 3.0]]), ("elbow", "shoulder"))
    ends = [final(aw.simulate(aw.Scenario(arm, duration=0.1, command=schedule))) for schedule in (straight, swapped)]
    assert np.array_equal(*ends)
    for wrong in ("run.csv", [], [straight, swapped]):
        with pytest.raises(ScenarioError):
            aw.Scenario(arm, duration=0.1, command=wrong)


def test_no_false_word_of_clipping():
    """Rounding of a current that goes through the voltage is no clipping."""
    arm = motor_alone(command="current", limits={"voltage_v": 100.0})
    times = np.arange(100) * 0.01
    schedule = aw.Schedule(times, 0.5 * np.sin(2 * np.pi * times)[:, None], ("axis",))
    assert aw.simulate(aw.Scenario(arm, duration=1.0, command=schedule)).attrs["notes"] == ""


def test_a_joint_without_inertia_is_named():
    """A massless last link is found before the run."""
    arm = motor_alone(motor={"rotor_inertia_kg_m2": 0.0})
    import dataclasses

    empty = dataclasses.replace(arm.bodies[0], mass=0.0, first_moment=np.zeros(3), inertia=np.zeros((3, 3)))
    with raises_at(ScenarioError, "joint axis", "no inertia"):
        aw.simulate(aw.Scenario(dataclasses.replace(arm, bodies=(empty,)), duration=0.1, command=[0.0]))


def test_too_much_to_record(cmu):
    """What memory cannot hold is said before it runs, with what to do."""
    arm, loop = cmu
    for duration in (1e12, 1e300):
        with pytest.raises(
            ScenarioError,
            match=r"recording.every above 1|2\^53 times",
        ):
            aw.simulate(aw.Scenario(arm, duration=duration, command=np.zeros(6), solver=RK3), loop=loop)


def test_too_many_ticks_of_a_reference():
    arm = aw.load("two-link")
    with raises_at(ScenarioError, "loop.reference", "memory"):
        aw.simulation.Simulation(aw.Scenario(arm, duration=1e9, loop=aw.Loop(aw.JointPID(kp=1.0), period=1e-3)))


def test_ctrl_c_comes_back_soon(cmu):
    """An interruption while threads share the lanes ends them after the piece each is in."""
    import time

    arm, loop = cmu
    scenario = aw.Scenario(
        arm, duration=400.0, command=aw.Batch(np.zeros((600, 6))), recording=aw.Recording(every=0), solver=RK3
    )
    start = time.perf_counter()

    def interrupt(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        aw.simulate(scenario, loop=loop, threads=2, progress=interrupt)
    assert time.perf_counter() - start < 5.0  # the whole run takes a quarter of a minute


@pytest.mark.study
def test_parameters_may_vary_by_lane_without_a_controller():
    arm = aw.load("cmu-dd")
    masses = np.array([1.0, 2.0, 3.0])
    common = {"command": [8, 6, 4, 2, 1, 0.5], "duration": 0.1}
    many = aw.simulate(scenario_of(arm, vary={"link6.mass_kg": aw.Batch(masses)}, **common))
    assert many.sizes["lane"] == 3
    for lane, mass in enumerate(masses):
        one = aw.simulate(scenario_of(arm, vary={"link6.mass_kg": mass}, **common))
        np.testing.assert_array_equal(many.q[lane], one.q)
        np.testing.assert_array_equal(many.tau[lane], one.tau)
    assert np.abs(many.q[0] - many.q[2]).max() > 1e-4
