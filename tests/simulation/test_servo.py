"""A servo's firmware as a drive: its loop against one of the tests' own, at any period around it, and what needs its memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.description.database import parse
from armwright.model import build_model
from raises_at import raises_at

GRAVITY, MASS, LENGTH, ARMATURE, VOLTS = 9.81, 0.3, 0.1, 0.028, 7.4
KT, R, VISCOUS = 1.0, 2.2, 0.1
TURN, COUNT = 1e-3, 2 * np.pi / 4096
PLAIN = {
    "period_s": TURN,
    "counts_per_turn": 4096,
    "p": 32,
    "p_scale_per_rad": 0.166,
    "output_limit": 0.97,
    "goal_speed_rad_per_s": 5.2,
    "dead_band_counts": 1,
}
ALL = PLAIN | {
    "i": 4,
    "i_scale_per_rad_s": 0.9,
    "d": 16,
    "d_scale_s_per_rad": 0.003,
    "goal_acceleration_rad_per_s2": 30.0,
    "goal_range_rad": [-0.5, 0.9],
    "latency_periods": 2,
}
GOALS = aw.Schedule([0.0, 0.5], [[1.0], [0.2]], ["q"])


def pendulum(firmware=PLAIN, joints=("q",), **joint):
    """Pendulums side by side, each of the bench's numbers."""
    motor = {
        "gear_ratio": 1.0,
        "rotor_inertia_kg_m2": ARMATURE,
        "torque_constant_n_m_per_a": KT,
        "resistance_ohm": R,
    }
    tensor = dict.fromkeys(("xx", "yy", "zz"), 0.0) | dict.fromkeys(("xy", "xz", "yz"), 0.0)
    each = {"type": "revolute", "parent": "base", "axis": [0.0, 1.0, 0.0], "motor": motor, "command": "position"}
    each |= {"frame": {"xyz_m": [0.0] * 3, "rpy_rad": [0.0] * 3}, "friction": {"viscous_n_m_s_per_rad": VISCOUS}}
    each |= {"limits": {"voltage_v": VOLTS}, **joint}
    loops = firmware if isinstance(firmware, list) else [firmware] * len(joints)
    rows = [
        {**each, "name": name, "child": f"rod {name}", **({} if loop is None else {"firmware": loop})}
        for name, loop in zip(joints, loops, strict=True)
    ]
    links = [
        {"name": f"rod {name}", "mass_kg": MASS, "com_m": [0.0, 0.0, -LENGTH], "inertia_kg_m2": tensor}
        for name in joints
    ]
    record = {"name": "bench", "source": "definition", "gravity_m_s2": [0.0, 0.0, -GRAVITY], "tip": links[0]["name"]}
    return build_model(parse({**record, "joints": rows, "links": links}, "bench"))


def rounded(value):
    return np.floor(value + 0.5)


def by_hand(firmware, duration, goals, every=1, supply=lambda t: VOLTS, enabled=lambda t: 1.0):
    """Positions at whole milliseconds: the loop as its record says, and DOP853 between its turns."""
    kp, ki, kd = (
        firmware.get(k, 0.0) * firmware.get(f"{k}_scale_{u}", 0.0)
        for k, u in (("p", "per_rad"), ("i", "per_rad_s"), ("d", "s_per_rad"))
    )
    period, most = firmware["period_s"], firmware["output_limit"]
    q = v = goal = speed = integral = before = output = 0.0
    waiting, found = [0.0] * int(firmware.get("latency_periods", 0)), [0.0]
    inertia = ARMATURE + MASS * LENGTH**2
    for k in range(round(duration / TURN)):
        t = k * TURN
        if k % every == 0:
            on = enabled(t)
            wanted = np.clip(goals(t), *firmware.get("goal_range_rad", (-np.inf, np.inf)))
            goal, wanted = (goal, wanted) if on else (q, q)
            way = wanted - goal
            if "goal_acceleration_rad_per_s2" in firmware:
                a, half = firmware["goal_acceleration_rad_per_s2"], period / 2
                top = min(a * (np.sqrt(half**2 + 2 * abs(way) / a) - half), abs(way) / period)
                top = np.copysign(min(top, firmware["goal_speed_rad_per_s"]), way)
                speed = min(max(top, speed - a * period), speed + a * period)
                goal += speed * period
            else:
                step = firmware.get("goal_speed_rad_per_s", np.inf) * period
                goal += min(max(way, -step), step)
            if "counts_per_turn" in firmware:
                error = rounded(goal / COUNT) - rounded(q / COUNT)
                error = 0.0 if abs(error) <= firmware.get("dead_band_counts", -1) else COUNT * error
            else:
                error = goal - q
            new = kp * error
            if ki:
                integral = on * min(max(integral + error * period, -most / ki), most / ki)
                new += ki * integral
            new += kd * (error - (before if on else error)) / period
            before = error
            waiting.append(on * min(max(new, -most), most))
            output = waiting.pop(0)
        volts = output * supply(t)

        on = enabled(t)

        def rate(_, state, volts=volts, on=on):
            torque = on * KT * (volts - KT * state[1]) / R
            return [state[1], (torque - VISCOUS * state[1] - MASS * GRAVITY * LENGTH * np.sin(state[0])) / inertia]

        q, v = solve_ivp(rate, (0.0, TURN), [q, v], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        found.append(q)
    return np.array(found)


def reference(t):
    return 1.0 if t < 0.5 - 1e-9 else 0.2


@pytest.fixture(scope="module")
def truth():
    return {"plain": by_hand(PLAIN, 1.0, reference), "all": by_hand(ALL, 1.0, reference)}


SOLVERS = {
    "auto": (aw.Solver(), 2e-6),
    "fine": (aw.Solver(accuracy=1e-8), 1e-9),
    "rk4": (aw.Solver("rk4", step=5e-4), 1e-9),
    "rk45": (aw.Solver("rk45"), 1e-8),
    "rodas3": (aw.Solver("rodas3", rtol=1e-9, atol=1e-11), 1e-7),
    "cvodes": (aw.Solver("cvodes"), 1e-7),
}


@pytest.mark.sample(3)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("name", "firmware"), [("plain", PLAIN), ("all", ALL)])
def test_its_loop_is_the_records(truth, name, firmware, solver):
    solver, most = SOLVERS[solver]
    run = aw.simulate(aw.Scenario(pendulum(firmware), 1.0, command=GOALS, solver=solver))
    rows = run.q.values[:: round((len(run.time) - 1) / (len(truth[name]) - 1)), 0]
    assert np.abs(rows - truth[name]).max() < most


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("period", "solver"),
    [(0.02, "fine"), (1 / 30, "fine"), (0.0007, "fine"), (0.0125, "fine"), (0.0125, "cvodes")],
)
def test_it_turns_at_its_own_times_whatever_the_period_around_it(truth, period, solver):
    """A tick may hold several turns, or none; goals that change inside a tick are read by the next turn."""
    ticks = int(1.0 / period)
    loop = aw.Loop(lambda t, r, y: r.q, reference=[1.0], period=period, initial_command=[0.0])
    solver, most = SOLVERS[solver]
    run = aw.simulate(aw.Scenario(pendulum(ALL), ticks * period, loop=loop, solver=solver))
    own = by_hand(ALL, 1.0, lambda t: 1.0)
    at = np.arange(ticks + 1) * period / TURN
    whole = np.abs(at - np.rint(at)) < 1e-6
    assert whole.sum() > 10
    np.testing.assert_allclose(run.q.values[whole, 0], own[np.rint(at[whole]).astype(int)], rtol=0, atol=10 * most)


def test_slower_loops_turn_at_every_so_manyth_turn_of_the_fastest():
    slow = PLAIN | {"period_s": 3 * TURN}
    arm = pendulum([PLAIN, slow], ("q", "p"))
    goals = aw.Schedule([0.0, 0.5], [[1.0, 1.0], [0.2, 0.2]], ["q", "p"])
    run = aw.simulate(aw.Scenario(arm, 1.0, command=goals, solver=aw.Solver("rk4", step=5e-4)))
    for joint, firmware, every in ((0, PLAIN, 1), (1, slow, 3)):
        expected = by_hand(firmware, 1.0, reference, every)
        assert np.abs(run.q.values[::2, joint] - expected).max() < 1e-8


def test_a_supply_that_sags_and_a_servo_that_is_off():
    supply = aw.Schedule([0.0, 0.3], [[7.4], [5.7]], ["supply"])
    enabled = aw.Schedule([0.0, 0.6, 0.8], [[1], [0], [1]], ["q"])
    inputs = aw.Inputs(supply=supply, enabled=enabled)
    scenario = aw.Scenario(pendulum(ALL), 1.0, command=GOALS, inputs=inputs, solver=aw.Solver("rk4", step=5e-4))
    run = aw.simulate(scenario)
    volts, on = lambda t: 7.4 if t < 0.3 - 1e-9 else 5.7, lambda t: float(not 0.6 - 1e-9 <= t < 0.8 - 1e-9)
    expected = by_hand(ALL, 1.0, reference, supply=volts, enabled=on)
    assert np.abs(run.q.values[::2, 0] - expected).max() < 1e-8
    off = (run.time.values > 0.6) & (run.time.values < 0.8)
    assert (run.current.values[off] == 0.0).all()


def test_a_run_in_two_parts_has_the_bits_of_one():
    whole = aw.simulate(aw.Scenario(pendulum(ALL), 1.0, command=GOALS))
    half = aw.simulate(aw.Scenario(pendulum(ALL), 0.4, command=GOALS))
    rest = aw.simulate(aw.Scenario(pendulum(ALL), 0.6, command=GOALS, start=half))
    np.testing.assert_array_equal(rest.q.values, whole.q.values[400:])


def test_lanes_vary_its_numbers():
    vary = {"q.firmware.p": aw.Batch([8.0, 16.0, 32.0]), "q.firmware.p_scale_per_rad": 0.166}
    run = aw.simulate(aw.Scenario(pendulum(PLAIN), 1.0, command=[1.0], vary=vary))
    for lane, p in enumerate((8.0, 16.0, 32.0)):
        alone = aw.simulate(aw.Scenario(pendulum(PLAIN | {"p": p}), 1.0, command=[1.0]))
        np.testing.assert_allclose(run.q.values[lane], alone.q.values, rtol=0, atol=1e-9)


def test_a_current_is_what_a_loop_may_give():
    """Of P alone and without play the joint settles where the current bears the load: K_p e = m g l sin q / Kt."""
    firmware = {
        "period_s": TURN,
        "output": "current",
        "output_limit": 3.0,
        "p": 40.0,
        "p_scale_per_rad": 0.2,
    }
    run = aw.simulate(aw.Scenario(pendulum(firmware), 30.0, command=[1.0]))
    q = run.q.values[-1, 0]
    assert 8.0 * (1.0 - q) == pytest.approx(MASS * GRAVITY * LENGTH * np.sin(q) / KT, rel=1e-6)
    assert run.current.values[-1, 0] == pytest.approx(8.0 * (1.0 - q), rel=1e-9)


@pytest.mark.parametrize(
    ("law", "most"),
    [
        (aw.JointPID(kp=1.0), 0.05),
        (aw.JointPID(kp=1.0, ki=4.0, gravity=True, anti_windup="clamping"), 2e-3),
        (aw.Cascade(position_kp=4.0, speed_kp=0.1, speed_ki=1.0), 2e-3),
        (aw.ComputedTorque(kp=100.0, kd=20.0, ki=300.0), 4e-3),
        (lambda t, r, y: r.q, 0.05),
    ],
)
def test_every_controller_may_command_it(law, most):
    """With kp = 1 a PID's goal is its reference; others count in radians from the measured position."""
    loop = aw.Loop(law, reference=[0.5], period=0.01)
    run = aw.simulate(aw.Scenario(pendulum(), 4.0, loop=loop, start=[0.2]))
    assert abs(run.q.values[-1, 0] - 0.5) < most
    if isinstance(law, aw.JointPID) and not law.gravity:
        np.testing.assert_allclose(run.u.values, 0.5, rtol=0, atol=1e-15)


def test_the_first_goal_holds_the_arm():
    loop = aw.Loop(lambda t, r, y: y.applied, period=0.01, timing=aw.Timing("one-tick"))
    run = aw.simulate(aw.Scenario(pendulum({**PLAIN, "dead_band_counts": 0}), 1.0, loop=loop, start=[0.8]))
    weight = MASS * GRAVITY * LENGTH * np.sin(0.8)
    assert run.u.values[0, 0] == pytest.approx(0.8 + weight * R / KT / VOLTS / (32 * 0.166), rel=1e-9)


@pytest.mark.study
def test_sensitivities_of_an_exact_loop_are_differences():
    firmware = {key: value for key, value in ALL.items() if key not in ("counts_per_turn", "dead_band_counts")}
    names = ["q.firmware.p", "q.firmware.i", "q.firmware.d_scale_s_per_rad", "q.motor.resistance_ohm"]
    scenario = aw.Scenario(pendulum(firmware), 0.8, command=[0.6], solver=aw.Solver("rk4", step=5e-4))
    found = aw.simulation.sensitivities(scenario, names)
    for k, name in enumerate(names):
        value = scenario.arm.parameters[name].value
        step = 1e-5 * value
        ends = [aw.simulate(replace(scenario, vary={name: value + sign * step})).q.values for sign in (1, -1)]
        expected, mine = (ends[0] - ends[1]) / (2 * step), found["d_q"].values[..., k]
        assert np.abs(mine - expected).max() < 2e-5 * np.abs(expected).max()
    with raises_at(aw.ArmwrightError, "joints.firmware.counts_per_turn", value="q"):
        aw.simulation.sensitivities(replace(scenario, arm=pendulum(ALL)), names)


def test_kernels_without_its_memory_refuse_it_and_forward_dynamics_does_not():
    dyn = aw.compile(pendulum())
    for call in (lambda: dyn.forward_arm([0.1], [0.2], [0.3]), lambda: dyn.motor_voltage([0.1], [0.2])):
        with pytest.raises(aw.ArmwrightError, match=r"q\.command = 'position'"):
            call()
    behind = aw.compile(pendulum().replace(firmware=None))
    assert dyn.forward_dynamics([0.1], [0.2], [0.3]) == behind.forward_dynamics([0.1], [0.2], [0.3])
    assert behind.arm.coordinates[0].drive.command == "voltage"


WRONG = {
    "a goal without a loop": (None, {}, r"firmware: missing"),
    "a loop beside volts": (PLAIN, {"command": "voltage"}, r"firmware: beside command = 'voltage'"),
    "no voltage": (PLAIN, {"limits": {}}, r"needs limits\.voltage_v or \[supply\]"),
    "a period of nothing": (PLAIN | {"period_s": 1e-9}, {}, r"period_s = 1e-09: expected from 1e-05 to 1 s"),
    "a duty above 1": (PLAIN | {"output_limit": 1.2}, {}, r"output_limit = 1\.2: expected a duty of at most 1"),
    "an integral without its unit": (PLAIN | {"i": 1.0}, {}, r"i: needs i_scale_per_rad_s beside it"),
    "half a period": (PLAIN | {"latency_periods": 0.5}, {}, r"latency_periods = 0\.5: expected a whole number"),
    "a band of no counts": ({**PLAIN, "counts_per_turn": None}, {}, r"dead_band_counts: needs counts_per_turn"),
    "a way back": (PLAIN | {"goal_range_rad": [1.0, -1.0]}, {}, r"goal_range_rad"),
    "an acceleration without a speed": (
        {"goal_acceleration_rad_per_s2": 3.0} | {k: v for k, v in PLAIN.items() if "speed" not in k},
        {},
        r"needs goal_speed_rad_per_s",
    ),
}


@pytest.mark.parametrize(("firmware", "joint", "words"), WRONG.values(), ids=WRONG)
def test_what_does_not_go_together_is_refused(firmware, joint, words):
    firmware = None if firmware is None else {key: value for key, value in firmware.items() if value is not None}
    with pytest.raises(aw.ArmwrightError, match=words):
        pendulum(firmware, **joint)


def test_periods_are_multiples_of_the_shortest():
    with raises_at(aw.ArmwrightError, "joint 'p' firmware.period_s", r"0\.001 s", value=1.5e-3):
        pendulum([PLAIN, PLAIN | {"period_s": 1.5e-3}], ("q", "p"))


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ({"supply": -1.0}, r"supply = -1\.0: .*voltages above 0"),
        ({"enabled": [0.5]}, r"enabled of q = 0\.5"),
        ({"enabled": [1, 1]}, r"enabled: shape \(2,\)"),
    ],
)
def test_inputs_that_no_servo_has_are_refused(inputs, words):
    with pytest.raises(aw.ArmwrightError, match=words):
        aw.Scenario(pendulum(), 1.0, command=[0.0], inputs=aw.Inputs(**inputs))


def test_an_arm_without_servos_has_none_to_switch():
    with raises_at(aw.ArmwrightError, "inputs.enabled", "two-link .*firmware"):
        aw.Scenario(aw.load("two-link"), 1.0, command=[0.0, 0.0], inputs=aw.Inputs(enabled=1))


def test_a_scenario_file_holds_its_inputs(tmp_path):
    supply = aw.Schedule([0.0, 0.3], [[7.4], [5.7]], ["supply"])
    enabled = aw.Schedule([0.0, 0.3], [[1], [0]], ["q"])
    inputs = aw.Inputs(supply=supply, enabled=enabled)
    scenario = aw.Scenario(pendulum(), 0.5, command=[0.5], inputs=inputs)
    path = tmp_path / "bench.scenario.toml"
    aw.write_scenario(scenario, path)
    again, run = aw.simulate(path), aw.simulate(scenario)
    np.testing.assert_array_equal(again.q.values, run.q.values)
