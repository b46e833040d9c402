"""Stiff arms by `rodas3` in the compiled loop, against CVODES, SciPy's Radau and closed forms; lanes, limits, events, inputs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright import scalar
from armwright.errors import DivergenceError
from armwright.kernels.loop import NativeLoop
from armwright.kernels.stages import Integrate
from armwright.kernels.target import select_target
from armwright.program import trace
from armwright.signals import Layout
from armwright.simulation.integrate.rosenbrock import ORDER, rodas3_step
from armwright.simulation.integrate.step_control import Allowed
from armwright.simulation.integrate.stepping import Adaptivity, adaptive_stage
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.slopes import plant_slopes
from simulation.fields import scenario_of, slopes_of
from simulation.plants import COULOMB, ELASTIC, LUGRE, MANY, MOTOR, SUPPLY, chain, pendulum

SHARP = {
    "coulomb_positive_n_m": 5.0,
    "coulomb_negative_n_m": 5.0,
    "viscous_n_m_s_per_rad": 0.0,
    "smoothing_rad_per_s": 1e-3,
}
HARD = {"stiffness_n_m_per_rad": 1e6, "damping_n_m_s_per_rad": 2e3}
STIFF_GEAR = {"stiffness_n_m_per_rad": 4e5, "damping_n_m_s_per_rad": 400.0}
WEAK = {**SUPPLY, "source_resistance_ohm": 4.0, "capacitance_f": 1e-4}
STEEP = {**LUGRE, "bristle_stiffness_n_m_per_rad": 1e5, "bristle_damping_n_m_s_per_rad": 500.0}
STIFF = {  # arms whose fastest time constants are 1 µs to 0.5 ms, and commands that keep them moving
    "gear": (pendulum(motor=MOTOR, friction=COULOMB, elasticity=STIFF_GEAR), [12.0]),
    "stop": (pendulum(motor=MOTOR, friction=COULOMB, stops=HARD, limits={"position_rad": [-1.0, 0.3]}), [12.0]),
    "winding": (pendulum(motor={**MOTOR, "inductance_h": 2.4e-5}, friction=COULOMB), [12.0]),  # L/R = 20 µs
    "bus": (pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": WEAK}), [40.0]),
    "bristles": (pendulum(motor=MOTOR, friction=STEEP), [12.0]),
    "play": (pendulum(motor=MOTOR, elasticity={**STIFF_GEAR, "backlash_rad": 1e-3}), [12.0]),
    "two gears": (chain([{"command": "voltage", "motor": MOTOR, "elasticity": STIFF_GEAR}] * 2), [9.0, -4.0]),
}


def error_of_range(run, truth, rows: Any = slice(None)) -> float:
    """The largest error of positions and speeds over time, in parts of the range of each in the truth."""
    return max(
        float((np.abs(run[name].values - truth[name].values)[rows] / np.ptp(truth[name].values, axis=0)).max())
        for name in ("q", "qd")
    )


def spindle():
    """A joint of 0.1 kg m² with Coulomb friction of 5 N m that is smoothed over 1 mrad/s: its time constant is 20 µs."""
    tensor = {"xx": 0.1, "xy": 0, "xz": 0, "yy": 0.1, "yz": 0, "zz": 0.1}
    link = {"name": "wheel", "mass_kg": 1.0, "com_m": [0, 0, 0], "inertia_kg_m2": tensor}
    return pendulum("torque", gravity=0.0, friction=SHARP, robot={"links": [{**link, "name": "rod0"}]})


def swinging_torque(count):
    """Torque rows [N m] each millisecond: a sine that turns the joint to and fro, then 2 N m, below the friction."""
    times = 1e-3 * np.arange(count)
    torque = np.where(times < 0.6 * times[-1], 8.0 * np.sin(4.0 * np.pi * times), 2.0)
    return aw.Schedule(times, torque[:, None], ("joint0",))


def test_smoothed_friction_is_followed_and_settles():
    """The joint turns round twice, then creeps at the speed where the friction is 2 N m; nothing ripples."""
    common = {"duration": 1.0, "command": swinging_torque(1000), "qd0": [0.2], "step": 1e-3}
    truth = aw.simulate(scenario_of(spindle(), **common, integrator="cvodes"))
    run = aw.simulate(scenario_of(spindle(), **common, integrator="rodas3"))
    assert np.count_nonzero(np.diff(np.sign(truth.qd.values[:600, 0]))) >= 2
    assert error_of_range(run, truth) < 1e-3
    late = run.isel(time=slice(-300, None))
    creep = 1e-3 * 2.0 / np.sqrt(5.0**2 - 2.0**2)
    np.testing.assert_allclose(late.qd.values, creep, rtol=1e-9)
    assert np.ptp(0.1 * late.qdd.values) < 1e-9  # N m
    assert int(run.steps_tried) < 2500  # of 1000 ticks; an explicit rule needs 20,000


def test_the_same_rule_chatters_without_error_control():
    """Equal steps of 1 ms: from 0.1234 rad/s it jumps to and fro across the friction for ever. With rejection it stands."""
    plant = Plant.of(spindle())

    def equal(x, u, h):
        slopes = lambda x, u: plant_slopes(plant, x, PlantInputs(u))  # noqa: E731
        return rodas3_step(slopes, plant.derivative, x, u, h)[0]

    loop = NativeLoop((Integrate(trace("step", equal, {"x": (2,), "u": (1,), "h": ()}, ("x_next",))),), select_target())
    lanes = loop.lanes(1)
    lanes.set("x", np.array([[0.0, 0.1234]]))
    lanes.set("u", np.zeros((1, 1)))
    loop.run(lanes, 1e-3, (0, 1000))
    assert abs(lanes.get("x")[0, 1]) > 0.01
    common = {"duration": 0.1, "command": [0.0], "qd0": [0.1234], "step": 1e-3}
    run = aw.simulate(scenario_of(spindle(), **common, integrator="rodas3"))
    assert np.abs(run.qd.values[10:]).max() < 1e-7
    assert int(run.steps_tried) < 250


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", STIFF)
def test_stiff_arms_are_right_at_ticks_of_a_millisecond(name):
    """Default tolerances, against CVODES: 1e-4 of each range, in one or two steps a tick."""
    arm, u = STIFF[name]
    common = {"duration": 0.3, "command": u, "q0": [0.1] * arm.n, "qd0": [0.2] * arm.n, "step": 1e-3}
    truth = aw.simulate(scenario_of(arm, **common, integrator="cvodes"))
    run = aw.simulate(scenario_of(arm, **common, integrator="rodas3"))
    assert error_of_range(run, truth) < 1e-4
    assert int(run.steps_tried) < 700


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", MANY)
def test_every_effect_is_followed(name):
    arm = MANY[name]
    u = 2.0 if arm.coordinates[0].drive.command == "torque" else 12.0
    common = {"duration": 0.1, "command": [u] * arm.n, "q0": [0.1] * arm.n, "qd0": [0.2] * arm.n, "step": 5e-3}
    truth = aw.simulate(scenario_of(arm, **common, integrator="cvodes"))
    run = aw.simulate(scenario_of(arm, **common, integrator="rodas3", rtol=1e-7, atol=1e-9))
    assert error_of_range(run, truth) < 1e-5


def alone(f, x0, tick, ticks, rtol, atol):
    """State (ticks, nx) of a system x' = f(x) at every tick, and the steps tried, in the compiled loop."""
    size = len(x0)

    def step(x, u, h):
        return rodas3_step(slopes_of(f), f, x, u, h)

    shapes, adaptivity = {"x": (size,), "u": (1,)}, Adaptivity(Allowed(rtol, atol), 10**6)
    stage = adaptive_stage(step, shapes, adaptivity, Layout(), order=ORDER)
    loop = NativeLoop((stage,), select_target())
    lanes, states = loop.lanes(1), []
    lanes.set("x", np.array([x0], dtype=float))
    for k in range(ticks):
        loop.run(lanes, tick, (k, k + 1))
        states.append(lanes.get("x")[0].copy())
    assert lanes.get("frozen")[0, 0] < 0.0
    return np.array(states), int(lanes.get("trials")[0, 0])


@pytest.mark.study
def test_van_der_pols_equation_with_mu_1000():
    """Two jumps in 2000 s, whose times the tolerance decides; beside SciPy's Radau."""

    def f(x, u):
        return scalar.array([x[1], 1000.0 * (1.0 - x[0] * x[0]) * x[1] - x[0]])

    truth = solve_ivp(lambda t, x: f(x, 0).astype(float), (0, 2000), [2.0, 0.0], "Radau", rtol=1e-8, atol=1e-10)
    states, trials = alone(f, [2.0, 0.0], 2000.0, 1, 1e-6, 1e-8)
    np.testing.assert_allclose(states[-1], truth.y[:, -1], rtol=1e-3)
    assert trials < 5000  # an explicit rule takes millions


@pytest.mark.study
def test_robertsons_reaction():
    """Rates from 0.04 to 3e7 over 10⁵ s; the amounts stay 1 together."""

    def f(x, u):
        forward, back, pair = 0.04 * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] * x[1]
        return scalar.array([-forward + back, forward - back - pair, pair])

    times = 1e4 * np.arange(1, 11)
    truth = solve_ivp(
        lambda t, x: f(x, 0).astype(float), (0, 1e5), [1.0, 0.0, 0.0], "Radau", t_eval=times, rtol=1e-11, atol=1e-15
    )
    states, trials = alone(f, [1.0, 0.0, 0.0], 1e4, 10, 1e-6, 1e-11)
    np.testing.assert_allclose(states, truth.y.T, rtol=1e-4)
    np.testing.assert_allclose(states.sum(axis=1), 1.0, rtol=1e-12)
    assert trials < 1500


def test_a_lane_does_not_depend_on_the_others():
    """Lane 77 alone, among 100 and among 10,000, of an arm with friction, stops and a stiff gear: the same bits."""
    joint = {"command": "voltage", "motor": MOTOR, "friction": {**SHARP, "viscous_n_m_s_per_rad": 0.8}, "stops": HARD}
    limits = {"limits": {"position_rad": [-0.12, 0.12]}}
    arm = chain([{**joint, **limits}, {"command": "voltage", "motor": MOTOR, "elasticity": STIFF_GEAR}])
    draw = np.random.default_rng(5)
    q0, u = draw.uniform(-0.115, 0.115, (10_000, 2)), draw.uniform(-40.0, 40.0, (10_000, 2))
    common = {"duration": 0.01, "qd0": [3.0, 0.0], "step": 1e-3, "integrator": "rodas3", "every": 0, "what": "state"}
    some = [
        aw.simulate(scenario_of(arm, command=aw.Batch(u[:count]), q0=aw.Batch(q0[:count]), **common), threads=threads)
        for count, threads in ((100, 1), (10_000, 2))
    ]
    assert len(np.unique(some[0].steps_tried.values)) > 5
    assert (np.abs(some[0].q.values[:, -1, 0]) > 0.12).any()
    for target in (None, "x86-64-v3"):
        one = aw.simulate(scenario_of(arm, command=u[77], q0=q0[77], target=target, **common))
        for many in some:
            for name in ("q", "qd"):
                np.testing.assert_array_equal(many[name].values[77], one[name].values)
            assert int(many.steps_tried[77]) == int(one.steps_tried)


def test_a_lane_that_runs_out_of_steps_is_frozen_and_marked():
    common = {"duration": 0.05, "step": 1e-3, "integrator": "rodas3", "max_substeps": 4, "command": [0.0]}
    run = aw.simulate(scenario_of(spindle(), qd0=aw.Batch([[0.0], [0.1234], [5.0]]), **common))
    assert np.isnan(run.stalled_at.values).tolist() == [True, False, True]
    stopped = float(run.stalled_at[1])
    assert stopped == pytest.approx(0.1234 * 0.1 / 5.0, abs=2e-3)  # where it comes to rest
    later = run.time.values > stopped
    assert (run.qd.values[1, later] == run.qd.values[1, later][0]).all()
    with pytest.raises(DivergenceError, match="of substeps"):
        aw.simulate(scenario_of(spindle(), qd0=[0.1234], **common))


def test_a_run_is_continued_to_the_bit():
    """The length of the next step is part of the state: in the middle of a hard stop."""
    arm, u = STIFF["stop"]
    common = {"command": u, "step": 1e-3, "integrator": "rodas3"}
    whole = aw.simulate(scenario_of(arm, duration=0.1, q0=[0.25], **common))
    half = aw.simulate(scenario_of(arm, duration=0.043, q0=[0.25], **common))
    rest = aw.simulate(scenario_of(arm, duration=0.057, start=half, **common))
    assert whole.q.values.max() > 0.3
    for name in ("q", "qd"):
        np.testing.assert_array_equal(rest[name].values[-1], whole[name].values[-1])


def test_ticks_that_are_long_beside_the_motion():
    """A pendulum let go near its upper rest, ticks of 2 s: there pivots of the elimination change their signs."""
    arm = pendulum("torque", friction={"viscous_n_m_s_per_rad": 0.2})
    common = {"duration": 6.0, "command": [0.0], "q0": [-np.pi / 2 + 1e-3], "step": 2.0}
    truth = aw.simulate(scenario_of(arm, **common, integrator="cvodes"))
    run = aw.simulate(scenario_of(arm, **common, integrator="rodas3"))
    assert error_of_range(run, truth) < 1e-3


def test_events_and_contacts_are_landed_on():
    """A joint that flies freely between hard stops of the closed form: it reaches the upper one after 0.1 s at 1 rad/s."""
    stops = {"stiffness_n_m_per_rad": 5e3, "damping_n_m_s_per_rad": 20.0}
    arm = pendulum("torque", gravity=0.0, stops=stops, limits={"position_rad": [-0.1, 0.1]})
    common = {"duration": 2.0, "command": [0.0], "qd0": [1.0], "step": 0.25}
    run = aw.simulate(
        scenario_of(arm, integrator="rodas3", rtol=1e-7, atol=1e-9, events=aw.simulation.joint_stops(arm), **common)
    )
    assert dict(zip(run.event.values, run.event_count.values, strict=True)) == {"joint0 low": 2, "joint0 high": 4}
    assert float(run.event_time.sel(event="joint0 high")) == pytest.approx(0.1, rel=1e-9)
    truth = aw.simulate(scenario_of(arm, integrator="cvodes", **common))
    np.testing.assert_allclose(run.q.values[-1], truth.q.values[-1], atol=2e-6)


def test_a_sampled_loop_with_delays_is_followed():
    """Commands and measurements between ticks, hard stops and a stiff gear: steps end at all of them."""
    period = 4e-3
    common = {
        "controller": lambda t, r, y: 60.0 * (r.q - y.q) - 1.0 * y.qd, "reference": [0.9, 0.2],
        "period": period, "duration": 40 * period, "q0": [0.1, 0.0],
        "timing": aw.Timing("one-tick", measurement_delay=0.75 * period, command_delay=1.25 * period),
    }  # fmt: skip
    joint = {"command": "voltage", "motor": MOTOR, "friction": {"viscous_n_m_s_per_rad": 0.8}}
    hard = {"stops": HARD, "limits": {"position_rad": [-0.3, 0.35]}}
    arm = chain([{**joint, **hard}, {**joint, "elasticity": STIFF_GEAR}])
    truth = aw.simulate(scenario_of(arm, integrator="cvodes", **common))
    assert truth.q.values[:, 0].max() > 0.35
    run = aw.simulate(scenario_of(arm, integrator="rodas3", **common))
    assert error_of_range(run, truth) < 1e-4


def test_parameters_of_lanes_are_in_the_slopes():
    """A gear's stiffness over two decades and a link's mass, each lane as the arm with these numbers."""
    arm = chain([{"command": "voltage", "motor": MOTOR, "elasticity": ELASTIC, "friction": COULOMB}] * 2)
    names = ("joint0.elasticity.stiffness_n_m_per_rad", "rod1.mass_kg")
    values = np.array([[4e3, 3.0], [4e5, 1.0]])
    common = {"duration": 0.1, "command": [9.0, 4.0], "step": 1e-3}
    many = aw.simulate(
        scenario_of(arm, vary=dict(zip(names, map(aw.Batch, values.T), strict=True)), integrator="rodas3", **common)
    )
    for lane, row in enumerate(values):
        truth = aw.simulate(scenario_of(arm, vary=dict(zip(names, row, strict=True)), integrator="cvodes", **common))
        assert error_of_range(many.isel(lane=lane), truth) < 1e-3
