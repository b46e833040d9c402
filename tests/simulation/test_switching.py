"""Steps that end where contacts begin and end: exact bounces, NumPy's meaning of the stages, and bits that know no neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.kernels.loop import NativeLoop
from armwright.kernels.stages import SECANTS, SWITCHES, Adapt, Integrate
from armwright.kernels.target import select_target
from armwright.program import interpret, trace
from armwright.simulation.integrate.integrators import INTEGRATORS, rk4_step
from armwright.simulation.loop.compiled import compile_loop
from armwright.simulation.plant.switching import Watched, switching_programs
from simulation.fields import scenario_of
from simulation.plants import COULOMB, ELASTIC, LUGRE, MOTOR, chain, pendulum

STOPS = {"stiffness_n_m_per_rad": 400.0, "damping_n_m_s_per_rad": 6.0}
PLAY = {**ELASTIC, "backlash_rad": 0.01}


def bounced(inertia, half, v, duration):
    """(q, q̇) of a free joint between two stops at ±half, from the middle: flights, and springs with dampers in closed form."""
    k, d = STOPS["stiffness_n_m_per_rad"], STOPS["damping_n_m_s_per_rad"]
    sigma = 0.5 * d / inertia
    omega = np.sqrt(k / inertia - sigma * sigma)
    leaves = (np.arctan2(2.0 * sigma * omega, sigma * sigma - omega * omega)) / omega  # where k p + d ṗ = 0
    p = lambda t: v / omega * np.exp(-sigma * t) * np.sin(omega * t)  # noqa: E731
    pd = lambda t: v * np.exp(-sigma * t) * (np.cos(omega * t) - sigma / omega * np.sin(omega * t))  # noqa: E731
    q, side = 0.0, 1.0
    while True:
        flight = (half - q) / v
        if duration <= flight:
            return side * (q + v * duration), side * v
        duration -= flight
        if duration <= leaves:
            return side * (half + p(duration)), side * pd(duration)
        duration -= leaves
        q, v, side = -(half + p(leaves)), -pd(leaves), -side


@pytest.mark.parametrize("name", INTEGRATORS)
def test_a_joint_between_stops_bounces_as_in_closed_form(name):
    """Six bounces: the error shrinks with the order of the rule, as if nothing had switched."""
    arm = pendulum("torque", gravity=0.0, stops=STOPS, limits={"position_rad": [-0.1, 0.1]})
    inertia, duration = float(aw.mass_matrix(arm, np.zeros(1))[0, 0]), 2.0
    exact = np.array(bounced(inertia, 0.1, 1.0, duration))
    loop, errors = compile_loop(arm, name), []
    for k in range(4):
        common = {"command": [0.0], "qd0": [1.0], "duration": duration, "every": 0}
        run = aw.simulate(scenario_of(arm, step=4e-3 / 2**k, integrator=name, **common), loop=loop)
        errors.append(np.abs([run.q.values[-1, 0], run.qd.values[-1, 0]] - exact).max())
    assert np.log2(errors[0] / errors[-1]) / 3 == pytest.approx(INTEGRATORS[name].order, abs=0.3), errors


def test_rk45_and_cvodes_come_to_the_closed_form():
    arm = pendulum("torque", gravity=0.0, stops=STOPS, limits={"position_rad": [-0.1, 0.1]})
    exact = np.array(bounced(float(aw.mass_matrix(arm, np.zeros(1))[0, 0]), 0.1, 1.0, 2.0))
    common = {"command": [0.0], "qd0": [1.0], "duration": 2.0, "every": 0, "step": 2e-2}
    for more, allowed in (({"integrator": "rk45", "rtol": 1e-9}, 1e-7), ({"integrator": "cvodes"}, 1e-9)):
        run = aw.simulate(scenario_of(arm, **common, **more))
        assert np.abs([run.q.values[-1, 0], run.qd.values[-1, 0]] - exact).max() < allowed
        assert "steps_tried" not in run or run.steps_tried < 2500


def test_events_and_contacts_are_landed_on_in_the_same_steps():
    arm = pendulum("torque", gravity=0.0, stops=STOPS, limits={"position_rad": [-0.1, 0.1]})
    inertia = float(aw.mass_matrix(arm, np.zeros(1))[0, 0])
    run = aw.simulate(
        aw.Scenario(
            arm, command=[0.0], duration=2.0, start=aw.Start(qd=[1.0]),
            solver=aw.Solver(step=0.25, integrator="rk45", rtol=1e-9, events=aw.simulation.joint_stops(arm)),
        )
    )  # fmt: skip
    assert dict(zip(run.event.values, run.event_count.values, strict=True)) == {"joint0 low": 2, "joint0 high": 4}
    assert float(run.event_time.sel(event="joint0 high")) == pytest.approx(0.1, rel=1e-9)
    exact = bounced(inertia, 0.1, 1.0, 2.0)
    np.testing.assert_allclose([run.q.values[-1, 0], run.qd.values[-1, 0]], exact, atol=1e-8)
    assert run.steps_tried < 400


def ball(x, u, touching):
    """Height and speed of a ball on a soft floor, which u pushes."""
    push = scalar.where(touching, scalar.maximum(-300.0 * x[0] - 2.0 * x[1], 0.0), 0.0)
    return scalar.array([x[1], u[0] - 9.81 + push])


def pushing(x, u, touching):
    """Force of the floor while the ball is on it."""
    return scalar.array([scalar.where(touching[0], -300.0 * x[0] - 2.0 * x[1], 1.0)]), np.zeros(1)


def fallen(x, u, touching, h):
    return rk4_step(lambda x, u: ball(x, u, touching[0]), x, u, h)


SHAPES = {"x": (2,), "u": (1,)}
FLOOR = Watched(lambda x, u: -x[:1], pushing, 1)
PROGRAMS = switching_programs(FLOOR, SHAPES)
STEP = trace("step", fallen, {**SHAPES, **FLOOR.block, "h": ()}, ("x_next",))


def in_pieces(x, u, s):
    """Substep as `kernels.stages` describes it."""
    for piece in range(SWITCHES + 1):
        c = interpret(PROGRAMS["touching"], x, u)
        new = interpret(STEP, x, u, c, s)
        if piece == SWITCHES or not interpret(PROGRAMS["switched"], x, new, u, c)[0]:
            break
        weights, bracket, part = interpret(PROGRAMS["bracket"], x, new, u, c)
        for _ in range(SECANTS):
            tried = interpret(STEP, x, u, c, part[0] * s)
            bracket, part = interpret(PROGRAMS["narrow"], tried, u, c, weights, bracket, part)
        x, s = interpret(STEP, x, u, c, bracket[1] * s), s - bracket[1] * s
    return new


@pytest.mark.sample(3)
@pytest.mark.parametrize("width", [1, 4, 8])
@pytest.mark.parametrize("substeps", [1, 3])
def test_the_stage_does_what_it_says_in_numpy(width, substeps):
    loop = NativeLoop((Integrate(STEP, **PROGRAMS),), replace(select_target("x86-64-v3"), width=width))
    starts = np.random.default_rng(0).normal(size=(11, 2)) * [0.3, 1.0] + [0.3, 0.0]
    lanes, h, u = loop.lanes(11), 0.02, np.array([0.4])
    lanes.set("x", starts)
    lanes.set("u", u)
    loop.run(lanes, h, (0, 60), substeps=substeps)
    expected = starts
    for _ in range(60 * substeps):
        expected = np.array([in_pieces(x, u, h / substeps) for x in expected])
    np.testing.assert_allclose(lanes.get("x"), expected, atol=1e-8)
    assert expected[:, 0].max() < 1.0  # all have bounced


def test_what_switches_without_end_is_taken_as_a_whole():
    """A switch that turns round wherever a step ends: after so many landings the rest of the step is taken, and time goes on."""
    shapes = {"x": (1,), "u": (1,)}
    turning = Watched(lambda x, u: scalar.sin(1e6 * x), lambda x, u, c: (np.zeros(0), np.zeros(0)), 1)
    clock = trace("step", lambda x, u, c, h: x + h, {**shapes, **turning.block, "h": ()}, ("x_next",))
    loop = NativeLoop((Integrate(clock, **switching_programs(turning, shapes)),), select_target())
    lanes = loop.lanes(3)
    loop.run(lanes, 0.1, (0, 5))
    np.testing.assert_allclose(lanes.get("x"), 0.5, rtol=1e-14)


def arm_with_contacts():
    joint = {"command": "voltage", "motor": {**MOTOR, "inductance_h": 2e-3}, "friction": LUGRE, "stops": STOPS}
    own = [{"limits": {"position_rad": [-0.3, 0.35]}}, {"limits": {"position_rad": [-0.5, 0.32]}, "elasticity": PLAY}]
    return chain([{**joint, **each} for each in own])


@pytest.mark.study
@pytest.mark.sample(1)
@pytest.mark.parametrize("integrator", ["rk3", "rk45", "rodas3"])
def test_a_lane_does_not_depend_on_its_neighbours(integrator):
    arm, draw, count = arm_with_contacts(), np.random.default_rng(1), 29
    q0, qd0, u = draw.uniform(-0.28, 0.3, (count, 2)), draw.uniform(-1, 1, (count, 2)), draw.uniform(-9, 9, (count, 2))
    common = {"duration": 0.2, "step": 5e-4, "integrator": integrator, "every": 40, "what": "state"}
    many = aw.simulate(scenario_of(arm, command=aw.Batch(u), q0=aw.Batch(q0), qd0=aw.Batch(qd0), **common), threads=2)
    assert many.q.values.max() > 0.351  # some are in a stop
    for lane in (0, 7, 16, 28):
        for target in (None, "x86-64-v3"):
            one = aw.simulate(
                scenario_of(arm, command=u[lane], q0=q0[lane], qd0=qd0[lane], target=target, **common), threads=1
            )
            np.testing.assert_array_equal(one.q.values, many.q.values[lane])
            np.testing.assert_array_equal(one.qd.values, many.qd.values[lane])


def test_a_resistance_may_vary_where_steps_end_at_contacts():
    """Switches are counted before any lane is known; nothing is divided by what is not known yet."""
    names, common = ["joint1.motor.resistance_ohm"], {"duration": 0.05, "step": 5e-4, "command": [5.0, 5.0]}
    plain = {"command": "voltage", "motor": MOTOR, "stops": STOPS, "limits": {"position_rad": [-0.3, 0.35]}}
    arm = chain([plain, plain])
    run = aw.simulate(scenario_of(arm, vary={names[0]: aw.Batch([1.0, 2.0])}, **common))
    other = aw.simulate(scenario_of(arm.with_values({names[0]: 2.0}), **common))
    np.testing.assert_allclose(run.q.values[1], other.q.values, rtol=0, atol=1e-13)


def test_a_joint_that_leans_on_its_stop_comes_to_rest_there():
    """And one that begins exactly on it: p = load / stiffness, at no more than one landing or two."""
    arm = pendulum(motor=MOTOR, friction=COULOMB, stops=STOPS, limits={"position_rad": [-1.0, 0.0]})
    common = {"duration": 8.0, "step": 1e-3, "every": 0, "what": "state"}
    run = aw.simulate(scenario_of(arm, command=[0.0], q0=aw.Batch([[0.0], [-0.1]]), **common))
    deep = run.q.values[:, -1, 0]
    load = float(aw.gravity_torques(arm, deep[:1])[0])
    np.testing.assert_allclose(deep, abs(load) / STOPS["stiffness_n_m_per_rad"], rtol=1e-3)
    np.testing.assert_allclose(run.qd.values[:, -1], 0.0, atol=1e-6)


def test_stops_under_a_controller_with_delays():
    """Commands that arrive between ticks, measurements from between them and contacts are all landed on."""
    period = 4e-3
    common = {
        "controller": lambda t, r, y: 60.0 * (r.q - y.q) - 1.0 * y.qd, "reference": [0.9, 0.9],
        "period": period, "duration": 60 * period, "q0": [0.1, 0.0],
        "timing": aw.Timing("one-tick", measurement_delay=0.75 * period, command_delay=1.25 * period),
    }  # fmt: skip
    joint = {"command": "voltage", "motor": MOTOR, "friction": {"viscous_n_m_s_per_rad": 0.8}, "stops": STOPS}
    arm = chain([{**joint, "limits": {"position_rad": [-0.3, high]}} for high in (0.35, 0.25)])
    exact = aw.simulate(scenario_of(arm, integrator="cvodes", **common))
    assert (exact.q.values.max(axis=0) > [0.36, 0.26]).all()
    errors = []
    for substeps in (1, 2):
        run = aw.simulate(scenario_of(arm, integrator="rk4", substeps=substeps, **common))
        errors.append(np.abs(run.qd.values - exact.qd.values).max())
    assert errors[1] < 1e-5
    assert np.log2(errors[0] / errors[1]) > 3.5, errors


def test_an_arm_without_contacts_has_nothing_of_it():
    step = next(stage for stage in compile_loop(aw.load("two-link")).loops[-1].stages if isinstance(stage, Integrate))
    assert step.switching == ()
    assert "left" not in compile_loop(aw.load("two-link")).loops[-1].sizes
    adapt = aw.Scenario(
        aw.load("two-link"), command=[0.0, 0.0], duration=0.1, solver=aw.Solver(integrator="rk45")
    ).solver.adaptivity
    stages = compile_loop(aw.load("two-link"), "rk45", adaptivity=adapt).loops[-1].stages
    assert next(stage for stage in stages if isinstance(stage, Adapt)).switching == ()


def test_no_contact_is_lost_in_rounding():
    """Steps so short that a flank moves by a few units in the last place between a guess and the next, far from 0."""
    arm = pendulum(motor=MOTOR, friction={"viscous_n_m_s_per_rad": 0.8}, elasticity={**ELASTIC, "backlash_rad": 1e-3})
    draw, count = np.random.default_rng(2), 160
    common = {
        "command": aw.Batch(draw.uniform(3.0, 9.0, (count, 1))), "q0": aw.Batch(draw.uniform(1.0, 1.5, (count, 1))),
        "duration": 0.03, "every": 0, "what": "state",
    }  # fmt: skip
    coarse, fine = (aw.simulate(scenario_of(arm, step=step, integrator="rk4", **common)) for step in (1e-4, 4e-6))
    np.testing.assert_allclose(fine.qd.values, coarse.qd.values, atol=2e-6)
