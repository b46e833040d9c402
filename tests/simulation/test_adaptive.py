"""Dormand and Prince's rule in lanes that choose their own steps: order, tolerance, independence, events, caps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import RK45, solve_ivp
from scipy.optimize import brentq

import armwright as aw
from armwright import scalar
from armwright.errors import DivergenceError, ScenarioError
from armwright.kernels.loop import NativeLoop
from armwright.kernels.target import select_target
from armwright.simulation.integrate import dormand_prince
from armwright.simulation.integrate.cvodes import Cvodes
from armwright.simulation.integrate.dormand_prince import ORDER, along, dormand_prince_step
from armwright.simulation.integrate.step_control import GROW, SHRINK, Allowed, growth
from armwright.simulation.integrate.stepping import (
    Adaptivity,
    adaptive_stage,
    begin_adaptive,
    dormand_prince_trial,
    speed_pairs,
)
from armwright.simulation.plant.plant import Plant, plant_derivative
from physics.arms import arm
from simulation.fields import scenario_of
from simulation.plants import ELASTIC, LUGRE, MOTOR, pendulum as pendulum_arm
from simulation.test_simulation import motor_alone

START = {"q0": [0.4, 0.4], "qd0": [0.5, 0.5]}


def pendulum(x, u):
    return np.array([x[1], u[0] - np.sin(x[0]) - 0.1 * x[1]])


def test_numbers_are_scipys():
    """The same pair, written down by others."""
    for row, theirs in zip(dormand_prince.STAGES[1:6], RK45.A[1:], strict=True):
        np.testing.assert_allclose(row, theirs[: len(row)], rtol=1e-15)
    np.testing.assert_allclose(dormand_prince.STAGES[6], RK45.B, rtol=1e-15)
    np.testing.assert_allclose(dormand_prince.ERROR, -RK45.E, atol=1e-16)


def test_a_step_has_order_five_and_its_path_order_four():
    u, x = np.array([0.3]), np.array([1.0, -0.5])
    ends, middles = [], []
    for h in (0.4, 0.2, 0.1):
        new, error, path = dormand_prince_step(pendulum, x, u, h)
        share = Allowed(1e-6, 1e-6).share(x, new, error)
        grow = growth(share, ORDER)
        exact = solve_ivp(
            lambda t, x: pendulum(x, u), (0, h), x, "DOP853", rtol=1e-13, atol=1e-15, t_eval=[0.37 * h, h]
        ).y
        ends.append(np.abs(np.asarray(new, float) - exact[:, 1]).max())
        middles.append(np.abs(np.asarray(along(x, path, 0.37), float) - exact[:, 0]).max())
        np.testing.assert_allclose(np.asarray(along(x, path, 1.0), float), np.asarray(new, float), atol=1e-15)
        assert SHRINK <= float(grow) <= GROW
        assert float(share) > 0
    assert np.all(np.log2(np.array(ends[:-1]) / ends[1:]) > 5.7), ends  # one step: an order more
    assert np.all(np.log2(np.array(middles[:-1]) / middles[1:]) > 4.6), middles


@pytest.mark.sample(1)
@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_a_run_is_as_good_as_its_tolerance(rtol):
    model, u = arm("two-link"), np.array([90.0, 20.0])
    run = aw.simulate(
        scenario_of(model, duration=0.4, command=u, step=0.1, integrator="rk45", rtol=rtol, atol=rtol / 10, **START)
    )
    exact = solve_ivp(
        lambda t, x: plant_derivative(model, x, u), (0, 0.4), np.ravel([START["q0"], START["qd0"]]), "DOP853",
        rtol=1e-13, atol=1e-14,
    ).y[:, -1]  # fmt: skip
    error = np.abs(np.concatenate([run.q.values[-1], run.qd.values[-1]]) - exact) / (1 + np.abs(exact))
    assert 1e-3 * rtol < error.max() < 50 * rtol


def test_tighter_tolerances_take_more_steps():
    tried = [
        int(aw.simulate(scenario_of(arm("two-link"), duration=0.4, command=[90.0, 20.0], step=0.1, integrator="rk45",
                                    rtol=rtol, **START)).steps_tried)
        for rtol in (1e-4, 1e-7, 1e-10)
    ]  # fmt: skip
    assert tried == sorted(set(tried))


def test_a_lane_does_not_depend_on_the_others():
    """Bit by bit: alone, among lanes that take many more steps, at another place, over threads and tiles."""
    model = arm("two-link")
    rng = np.random.default_rng(0)
    lanes = 37
    commands = rng.normal(size=(lanes, 2)) * 10.0 ** rng.integers(-2, 3, size=(lanes, 1))
    events = {"slow": lambda t, x: x.qd[0], "bent": lambda t, x: x.q[1] - 0.41}
    common = {"duration": 0.05, "step": 0.01, "integrator": "rk45", "events": events}

    def run(order, threads):
        return aw.simulate(
            scenario_of(model, command=aw.Batch(commands[order]), q0=START["q0"], qd0=START["qd0"], **common),
            threads=threads,
        )

    all_of_them = run(np.arange(lanes), 1)
    assert len(set(all_of_them.steps_tried.values)) > 3
    turned = np.arange(lanes)[::-1]
    backwards = run(turned, 2)
    names = ("q", "qd", "steps_tried", "event_time", "event_count")
    for name in names:
        np.testing.assert_array_equal(backwards[name].values, all_of_them[name].values[turned])
    for lane in (0, 17, 36):
        alone = run(np.array([lane]), 1)
        for name in names:
            np.testing.assert_array_equal(alone[name].values[0], all_of_them[name].values[lane])


def test_a_lane_has_the_same_bits_in_narrower_tiles():
    common = {"duration": 0.05, "step": 0.01, "integrator": "rk45", "command": aw.Batch(np.eye(3)[:, :2] * 50), **START}
    wide = aw.simulate(scenario_of(arm("two-link"), **common))
    narrow = aw.simulate(scenario_of(arm("two-link"), **common, target="x86-64-v3"))
    np.testing.assert_array_equal(wide.q.values, narrow.q.values)
    np.testing.assert_array_equal(wide.steps_tried.values, narrow.steps_tried.values)


def turning(volts, t):
    """Position and speed of the motor of `motor_alone` from rest at constant voltage."""
    drive = motor_alone().bodies[0].drive
    stall = drive.gear_ratio * drive.torque_constant / drive.resistance
    damping = stall * drive.gear_ratio * drive.back_emf_constant + 0.03
    rate, speed = damping / (0.02 + 25 * 1e-4), stall * volts / damping
    return speed * (t - (1 - np.exp(-rate * t)) / rate), speed * (1 - np.exp(-rate * t))


def test_events_happen_when_closed_forms_say():
    volts = np.array([[-6.0], [-3.0], [-0.01]])
    events = {
        "a turn": lambda t, x: x.q[0] - 2 * np.pi,
        "fast": lambda t, x: x.qd[0] - 10.0,
        "clock": lambda t, x: scalar.sin(10 * np.pi * (t - 0.05)),
    }
    run = aw.simulate(
        aw.Scenario(
            motor_alone(), duration=1.5, command=aw.Batch(volts),
            solver=aw.Solver(step=0.025, integrator="rk45", events=events, rtol=1e-11, atol=1e-12),
        )
    )  # fmt: skip
    assert run.event.values.tolist() == ["a turn", "fast", "clock"]
    for lane, v in enumerate(volts[:2, 0]):
        turned = brentq(lambda t, v=v: turning(v, t)[0] - 2 * np.pi, 0, 10)
        fast = brentq(lambda t, v=v: turning(v, t)[1] - 10.0, 0, 10) if abs(turning(v, 10)[1]) > 10 else np.nan
        np.testing.assert_allclose(run.event_time.values[lane, :2], [turned, fast], rtol=0, atol=1e-9)
        assert run.event_count.values[lane, :2].tolist() == [1, int(fast == fast)]
    assert np.isnan(run.event_time.values[2, :2]).all()
    np.testing.assert_allclose(run.event_time.values[:, 2], 0.05, rtol=0, atol=1e-12)
    assert set(run.event_count.values[:, 2]) == {15}  # 0.05, 0.15, …, 1.45 s


def test_two_events_in_one_step_are_both_noted_in_their_order():
    events = {"late": lambda t, x: t - 0.0171, "early": lambda t, x: t - 0.0111, "same": lambda t, x: 3 * (t - 0.0111)}
    run = aw.simulate(
        aw.Scenario(
            motor_alone(), duration=0.1, command=[-1.0], solver=aw.Solver(step=0.1, integrator="rk45", events=events)
        )
    )
    np.testing.assert_allclose(run.event_time.values, [0.0171, 0.0111, 0.0111], rtol=0, atol=1e-12)
    assert run.event_count.values.tolist() == [1, 1, 1]


def test_events_do_not_disturb_the_motion():
    common = {"duration": 0.3, "step": 0.05, "command": [90.0, 20.0], "integrator": "rk45", "rtol": 1e-11, **START}
    plain = aw.simulate(scenario_of(arm("two-link"), **common))
    watched = aw.simulate(scenario_of(arm("two-link"), **common, events={"at": lambda t, x: x.q[0] - 0.45}))
    np.testing.assert_allclose(watched.q.values, plain.q.values, atol=1e-11)
    assert watched.event_count.values.tolist() == [1]


def test_joint_stops_are_events_of_joints_with_limits():
    model = arm("cmu-dd")
    stops = aw.simulation.joint_stops(model)
    high = model.bodies[1].limits.position[1]
    assert {"joint2 low", "joint2 high"} <= set(stops)
    run = aw.simulate(
        aw.Scenario(
            model, duration=0.5, command=np.zeros(6),
            start=aw.Start([0, high - 0.1, 0, 0, 0, 0], [0, 8.0, 0, 0, 0, 0]),
            solver=aw.Solver(integrator="rk45", events=stops),
        )
    )  # fmt: skip
    at = float(run.event_time.sel(event="joint2 high"))
    passed = run.time.values[run.q.values[:, 1] > high][0]
    assert passed - 1e-3 <= at <= passed


def test_a_lane_without_enough_steps_is_frozen_and_marked_and_the_others_go_on():
    model = motor_alone()
    run = aw.simulate(
        aw.Scenario(
            model, duration=0.1, command=aw.Batch([[0.0], [6.0]]), start=aw.Start(qd=aw.Batch([[0.0], [30.0]])),
            solver=aw.Solver(step=0.02, integrator="rk45", rtol=1e-14, atol=1e-15, max_substeps=1),
        )
    )  # fmt: skip
    assert np.isnan(run.stalled_at.values[0])
    assert run.stalled_at.values[1] == 0.0
    assert np.isnan(run.diverged_at.values).all()
    assert run.steps_tried.values[1] == 20
    with pytest.raises(DivergenceError, match=r"substeps.* t = 0 s.*max_substeps"):
        aw.simulate(
            aw.Scenario(
                model,
                duration=0.1,
                command=[6.0],
                start=aw.Start(qd=[30.0]),
                solver=aw.Solver(step=0.02, integrator="rk45", rtol=1e-14, atol=1e-15, max_substeps=1),
            )
        )


def test_a_lane_that_diverges_is_told_apart():
    run = aw.simulate(
        aw.Scenario(
            motor_alone(), duration=0.01, command=[1.0],
            start=aw.Start(aw.Batch([[1e308], [0.0]]), aw.Batch([[1e308], [0.0]])),
            solver=aw.Solver(integrator="rk45", max_substeps=20),
        )
    )  # fmt: skip
    assert run.diverged_at.values[0] == 0.0
    assert np.isnan(run.stalled_at.values).all()
    assert np.isnan(run.diverged_at.values[1])


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (lambda t, x: x.q, r"'e': .*\(2,\); .*one number"),
        (lambda t, x: x.theta[0], "'e': cannot be compiled: AttributeError"),
        (lambda t, x: 1.0 if x.q[0] > 0 else -1.0, "'e': cannot be compiled"),
    ],
)
def test_events_that_cannot_be_watched_are_refused(event, said):
    with pytest.raises(ScenarioError, match=said):
        aw.simulate(
            aw.Scenario(
                arm("two-link"),
                duration=0.1,
                command=[0.0, 0.0],
                solver=aw.Solver(integrator="rk45", events={"e": event}),
            )
        )


def test_events_are_found_under_a_controller_too():
    model = arm("two-link")
    common = {"controller": lambda t, r, y: 200.0 * (r.q - y.q) - 20.0 * y.qd, "reference": [0.6, 0.1], "duration": 0.2}
    common |= {"period": 4e-3, "q0": [0.4, 0.4], "qd0": aw.Batch([[0.5, 0.5], [0.0, 0.0]])}
    events = {"there": lambda t, x: x.q[0] - 0.42}
    run = aw.simulate(scenario_of(model, integrator="rk45", events=events, **common))
    fine = aw.simulate(scenario_of(model, integrator="rk4", substeps=4, **common))
    for lane in range(2):
        q, at = fine.q.values[lane, :, 0], run.event_time.values[lane, 0]
        after = int(np.argmax(q > 0.42))
        assert fine.time.values[after - 1] < at <= fine.time.values[after]
        np.testing.assert_allclose(run.q.values[lane], fine.q.values[lane], atol=1e-7)


@pytest.mark.sample(1)
@pytest.mark.parametrize("command", [[90.0, 20.0], aw.Batch([[90.0, 20.0], [0.0, 0.0]])], ids=["single", "lanes"])
def test_runs_with_events_are_kept_drawn_and_written(command, tmp_path):
    run = aw.simulate(
        scenario_of(arm("two-link"), duration=0.02, command=command, integrator="rk45", rtol=1e-7,
                    events={"start": lambda t, x: t - 0.005}, **START)
    )  # fmt: skip
    aw.save(run, tmp_path / "run.nc")
    kept = aw.load_run(tmp_path / "run.nc")
    np.testing.assert_array_equal(kept.event_time.values, run.event_time.values)
    assert kept.event.values.tolist() == ["start"]
    assert kept.attrs["rtol"] == 1e-7
    aw.save(run, tmp_path / "run.csv")
    aw.plot(run, tmp_path / "run.png")
    assert (tmp_path / "run.csv").read_text().startswith("lane,t [s]" if isinstance(command, aw.Batch) else "t [s]")


def test_a_drive_with_windings_bristles_and_a_spring_is_followed():
    """Time constants from 0.1 ms up: steps as short as these ask for; CVODES comes to the same by either of its methods."""
    model = pendulum_arm(motor={**MOTOR, "inductance_h": 1e-3}, elasticity=ELASTIC, friction=LUGRE)
    plant = Plant.of(model)
    shapes = {"x": (plant.size,), "u": (1,)}
    chosen = Adaptivity(Allowed(1e-8, 1e-10), 1000, (("there", lambda t, x: x.motor_q[0] - 6.0),))
    loop = NativeLoop(
        (adaptive_stage(dormand_prince_trial(plant.derivative, shapes), shapes, chosen, plant.layout),), select_target()
    )
    lanes, x0, u = loop.lanes(1), plant.initial([0.1], [0.0])[None], np.array([12.0])
    lanes.set("x", x0)
    lanes.set("u", u)
    begin_adaptive(lanes, chosen, plant.layout, x0, 0.05)
    loop.run(lanes, 1e-2, (0, 5))
    for stiff in (True, False):
        solver = Cvodes(plant.derivative, shapes, Adaptivity(Allowed(1e-12, 1e-13), 0), stiff)
        expected = solver.after(x0[0], u, np.zeros(0), 1e-2, 5)
        np.testing.assert_allclose(lanes.get("x")[0], expected[-1], rtol=1e-6, atol=1e-9)
    at = float(lanes.get("event_first")[0, 0])
    expected = solver.after(x0[0], u, np.zeros(0), at)
    assert plant.part(expected[0], "motor_q")[0] == pytest.approx(6.0, abs=1e-6)
    assert speed_pairs(plant.layout) == [(0, 1), (2, 3)]
