"""Derivatives of motions with contacts, sticking and brakes: closed forms, and differences of motions that are exact to 1e-9."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.model.vary import Varied
from raises_at import raises_at
from simulation.exact import ExactPlant
from simulation.plants import ELASTIC, MOTOR, chain, pendulum

DRY = {"viscous_n_m_s_per_rad": 0.4, "coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.4}
STRIBECK = {**DRY, "stribeck_torque_n_m": 3.0, "stribeck_speed_rad_per_s": 0.2}
STOPS = {"stiffness_n_m_per_rad": 5e3, "damping_n_m_s_per_rad": 20.0}
LOSSY = {**MOTOR, "gear_ratio": 50.0, "gear_efficiency": 0.7}
TIMES = np.arange(101) * 0.01


def differences(scenario, steps, changes, brakes):
    """(rows, 2n, names): central differences of (q, q̇) of the exact motion, steps by name; and its events."""
    found = []

    def motion(arm, start):
        exact = ExactPlant(arm, brakes=brakes)
        rows = exact.run(TIMES, start.q, start.qd, changes)
        found.append(exact.events)
        return rows[:, : 2 * arm.n]

    slopes = []
    for name, step in steps.items():
        if name.startswith("start."):
            field, entry = name[6:-1].split("[")
            value = getattr(scenario.start, field)[int(entry)]

            def at(value, field=field, entry=int(entry)):
                values = np.array(getattr(scenario.start, field), dtype=float)
                values[entry] = value
                return motion(scenario.arm, replace(scenario.start, **{field: values}))

        else:
            varied = Varied(scenario.arm, [name])
            value = varied.parameters[0].value

            def at(value, varied=varied):
                return motion(varied.model([value]), scenario.start)

        slopes.append((at(value + step) - at(value - step)) / (2.0 * step))
    return np.stack(slopes, axis=-1), min(found)


def check(scenario, steps, changes, events, brakes=False, within=1e-4):
    """Holds derivatives against differences, `within` a part of the largest of each signal.

    Steps of differences are such that rounding of the exact motion (1e-10) and what bends both stay below that.
    """
    expected, found = differences(scenario, steps, changes, brakes)
    assert found >= events
    run = aw.simulation.sensitivities(scenario, list(steps))
    own = np.concatenate([run.d_q.values, run.d_qd.values], axis=1)
    n = scenario.arm.n
    for k, name in enumerate(steps):
        for part in (slice(0, n), slice(n, 2 * n)):
            largest = np.abs(expected[:, part, k]).max()
            np.testing.assert_allclose(
                own[:, part, k], expected[:, part, k], atol=within * largest, rtol=0, err_msg=name
            )
            assert largest > 1e-6


@pytest.mark.study
@pytest.mark.sample(1)
@pytest.mark.parametrize("friction", [DRY, STRIBECK], ids=["coulomb", "stribeck"])
def test_two_links_with_dry_friction_stops_and_a_brake(friction):
    """Both joints slide, stick, turn round and hit their stops; a brake without a spring falls in on one and is released."""
    joint = {"command": "torque", "friction": friction, "stops": STOPS}
    first = {**joint, "limits": {"position_rad": [-0.5, 0.6]}, "brake": {"holding_torque_n_m": 30.0}}
    arm = chain([first, {**joint, "limits": {"position_rad": [-0.8, 0.7]}}])
    commands = {0.0: [-30.0, 6.0], 0.25: [-20.0, -9.0], 0.6: [-26.0, -2.0]}
    brake = {0.0: [0.0], 0.4: [1.0], 0.55: [0.0]}
    scenario = aw.Scenario(
        arm, TIMES[-1], command=aw.Schedule(list(commands), list(commands.values()), arm.names),
        start=aw.Start([0.1, -0.2], [0.5, -0.3]), recording=aw.Recording(period=0.01), solver=aw.Solver(accuracy=1e-5),
        inputs=aw.Inputs(brake=aw.Schedule(list(brake), list(brake.values()), ["joint0"])),
    )  # fmt: skip
    steps = {
        "rod1.mass_kg": 3e-5,
        "joint0.friction.coulomb_positive_n_m": 1e-4,
        "start.q[0]": 1e-5,
        "start.qd[1]": 3e-5,
    }
    steps |= {"joint1.friction.coulomb_negative_n_m": 1e-4, "joint1.stops.stiffness_n_m_per_rad": 0.1}
    changes = [
        (t, {name: rows[t] for name, rows in (("command", commands), ("brake", brake)) if t in rows})
        for t in sorted({*commands, *brake})
    ]
    check(scenario, steps, changes, 15, brakes=True)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("joint", "name", "step", "events", "within"),
    [
        ({"motor": LOSSY, "friction": DRY}, "motor.gear_efficiency", 1e-5, 2, 1e-5),
        ({"motor": MOTOR, "elasticity": {**ELASTIC, "backlash_rad": 0.02}}, "elasticity.backlash_rad", 1e-5, 20, 1e-4),
        # Where a lossy gear's load turns round its slope jumps, which steps do not end at: an error of order 1.
        ({"motor": LOSSY, "elasticity": ELASTIC, "friction": DRY}, "friction.coulomb_positive_n_m", 2e-5, 5, 1e-3),
    ],
    ids=["gear loss", "play", "elastic gear with loss"],
)
def test_drives_whose_flanks_touch_and_whose_gears_hold(joint, name, step, events, within):
    arm = pendulum("torque", gravity=3.0, **joint)
    commands = {0.0: [12.0], 0.3: [-12.0], 0.7: [1.0]}
    scenario = aw.Scenario(
        arm, TIMES[-1], command=aw.Schedule(list(commands), list(commands.values()), arm.names),
        start=aw.Start([0.1], [0.5]), recording=aw.Recording(period=0.01), solver=aw.Solver(accuracy=1e-6),
    )  # fmt: skip
    steps = {f"joint0.{name}": step, "rod0.mass_kg": 3e-4, "start.q[0]": 1e-5}
    check(scenario, steps, [(t, {"command": u}) for t, u in commands.items()], events, within=within)


@pytest.mark.study
def test_a_reversal_and_a_stop_under_coulomb_friction():
    """J q̈ = u - F₊ from speed v: it comes to 0 at t₁ = J v / (F₊ - u), then goes back by J q̈ = u + F₋, or stays.

    Going back,  q̇ = (u + F₋) (T - t₁) / J  and  q = v t₁ / 2 + (u + F₋) (T - t₁)² / 2 J.
    """
    inertia, level, speed, end = 0.1 + 3.0 * 0.09, 2.0, 1.0, 0.3
    friction = {"viscous_n_m_s_per_rad": 0.0, "coulomb_positive_n_m": level, "coulomb_negative_n_m": level}
    arm = pendulum("torque", gravity=0.0, friction=friction)
    names = [f"joint0.friction.coulomb_{side}_n_m" for side in ("positive", "negative")] + ["start.qd[0]"]
    for torque in (-6.0, -1.0):
        scenario = aw.Scenario(
            arm, end, command=[torque], start=aw.Start(qd=[speed]), recording=aw.Recording(every=0),
            solver=aw.Solver("rk4", end / 8),
        )  # fmt: skip
        run = aw.simulation.sensitivities(scenario, names)
        stop = inertia * speed / (level - torque)
        by_speed, by_level = stop / speed, -stop / (level - torque)  # of t₁
        back, left = min(torque + level, 0.0) / inertia, end - stop
        slopes = -back * np.array([by_level, 0.0, by_speed]) + np.array([0.0, left / inertia * (back < 0.0), 0.0])
        np.testing.assert_allclose(run.d_qd.values[-1, 0], slopes, rtol=1e-6, atol=1e-9)
        moved = np.array([0.5 * speed * by_level, 0.0, 0.5 * (speed * by_speed + stop)])
        moved += -back * left * np.array([by_level, 0.0, by_speed])
        moved += np.array([0.0, 0.5 * left**2 / inertia * (back < 0.0), 0.0])
        np.testing.assert_allclose(run.d_q.values[-1, 0], moved, rtol=1e-6, atol=1e-9)


def test_sticking_in_a_sampled_loop():
    """A loop that creeps to its aim and sticks there: differences of runs that are held to 1e-8 of their range."""
    law = aw.JointPID(kp=[60.0], ki=[20.0], kd=[6.0])
    arm = pendulum("torque", gravity=2.0, friction=DRY)
    scenario = aw.Scenario(
        arm, 0.8, loop=aw.Loop(controller=law, reference=[0.4], period=1e-2), start=aw.Start([0.0]),
        solver=aw.Solver(accuracy=1e-5), recording=aw.Recording(period=0.01),
    )  # fmt: skip
    run = aw.simulation.sensitivities(scenario, ["rod0.mass_kg", "joint0.friction.coulomb_positive_n_m"])
    assert (run.qd.values[20:, 0] == 0.0).sum() > 10  # it sticks
    for k, (name, value) in enumerate((("rod0.mass_kg", 3.0), ("joint0.friction.coulomb_positive_n_m", 2.0))):
        finer, step = replace(scenario, solver=aw.Solver(accuracy=1e-8)), 1e-4 * value
        ends = [aw.simulate(replace(finer, vary={name: value + sign * step})).q.values for sign in (1.0, -1.0)]
        expected = (ends[0] - ends[1]) / (2.0 * step)
        np.testing.assert_allclose(run.d_q.values[..., k], expected, atol=1e-3 * np.abs(expected).max(), rtol=0)


def at_peak(above, damping=20.0):
    """A joint that a constant torque turns back where its stop is; `above` [rad]: by how much it would pass it."""
    inertia, torque, speed = 0.1 + 3.0 * 0.09, 2.0, 1.0
    peak = 0.5 * inertia * speed**2 / torque
    stops, limits = {**STOPS, "damping_n_m_s_per_rad": damping}, {"position_rad": [-9.0, peak - above]}
    arm = pendulum("torque", gravity=0.0, stops=stops, limits=limits)
    return aw.Scenario(arm, 0.5, command=[-torque], start=aw.Start(qd=[speed]))


@pytest.mark.sample(1)
@pytest.mark.parametrize("above", [0.0, 1e-9, -1e-9, 1e-7, -1e-7])
@pytest.mark.parametrize("solver", [aw.Solver(), aw.Solver("rk4", 1e-3)], ids=["auto", "by hand"])
def test_a_contact_that_is_only_touched_is_refused_by_its_name(above, solver):
    grazing = replace(at_peak(above), solver=solver)
    with raises_at(ScenarioError, "joint 'joint0'", r"upper stop at t = 0\.18"):
        aw.simulation.sensitivities(grazing, ["start.qd[0]"])
    for clear in (1e-4, -1e-4):
        assert np.isfinite(aw.simulation.sensitivities(at_peak(clear), ["start.qd[0]"]).d_qd.values).all()


@pytest.mark.study
def test_a_load_that_only_just_does_not_break_a_joint_loose_is_refused_by_its_joint():
    """The first joint holds still by friction of just the largest load that the swing of the second puts on it."""

    def arm(level):
        friction = {"coulomb_positive_n_m": level, "coulomb_negative_n_m": level}
        return chain([{"command": "torque", "friction": friction}, {"command": "torque"}], gravity=0.0)

    def scenario(level):
        start, solver = aw.Start([0.0, 0.4], [0.0, 4.0]), aw.Solver("rk4", 1e-3)
        return aw.Scenario(arm(level), 0.5, command=[0.0, 0.0], start=start, solver=solver)

    run = aw.simulate(scenario(1e3))
    load = aw.compile(arm(0.0)).inverse_dynamics(run.q.values, run.qd.values, run.qdd.values)[:, 0]
    k = int(np.argmax(np.abs(load)))
    assert 0 < k < len(load) - 1
    before, at, after = np.abs(load[k - 1 : k + 2])
    peak = at - (after - before) ** 2 / (8.0 * (after - 2.0 * at + before))
    with raises_at(ScenarioError, "joint 'joint0'", r"t = 0\.\d+ s so slowly"):
        aw.simulation.sensitivities(scenario(peak), ["rod1.mass_kg"])
    assert np.isfinite(aw.simulation.sensitivities(scenario(0.99 * peak), ["rod1.mass_kg"]).d_q.values).all()
    assert not aw.simulation.sensitivities(scenario(1.01 * peak), ["rod1.mass_kg"]).d_q.values[:, 0].any()


def test_lanes_that_graze_have_no_derivatives_from_there_on():
    speeds = np.array([[0.9], [1.0], [1.2]])
    scenario = replace(at_peak(0.0), start=aw.Start(qd=aw.Batch(speeds)), recording=aw.Recording(period=0.05))
    run = aw.simulation.sensitivities(scenario, ["start.qd[0]"])
    missing = np.isnan(run.d_qd.values[..., 0, 0])
    assert not missing[[0, 2]].any()
    assert (missing[1] == (run.time.values > 0.185)).all()
    assert "1 of 3 lanes have no derivatives behind some time; lane 1: joint 'joint0' meets or leaves" in run.notes
    alone = aw.simulation.sensitivities(replace(scenario, start=aw.Start(qd=speeds[2])), ["start.qd[0]"])
    np.testing.assert_array_equal(run.d_qd.values[2], alone.d_qd.values)
