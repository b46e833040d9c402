"""Bodies taken up and put down: chained runs of the arm without and with them, closed forms, energy, lanes, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import simpson, solve_ivp

import armwright as aw
from armwright import scalar
from armwright.errors import ArmwrightError
from armwright.simulation.plant.plant import Plant
from physics.arms import arm
from simulation.energies import energy_rates, stored_energy
from simulation.fields import scenario_of
from simulation.plants import MOTOR, pendulum

G, L = 9.81, 0.6  # of `pendulum`: its rod of 3 kg ends at L
TENSOR = np.array([[0.012, 0.001, -0.002], [0.001, 0.01, 0.0005], [-0.002, 0.0005, 0.009]])
COM = [0.05, -0.02, 0.1]
HELD = (2.0, COM, TENSOR)
START = {"q0": [0.3, -0.5], "qd0": [0.4, 0.2]}


def state(run):
    return np.concatenate([run.q.values[..., -1, :], run.qd.values[..., -1, :]], axis=-1)


@pytest.mark.sample(2)
@pytest.mark.parametrize("integrator", ["rk3", "rk4", "semi_implicit_euler", "rk45", "rodas3", "cvodes"])
def test_a_switch_is_two_runs_one_behind_the_other(integrator):
    """Without, with and without the body again, each run beginning where the one before ended."""
    bare = arm("two-link")
    common = {"command": [20.0, 5.0], "integrator": integrator}
    switched = [aw.Payload(0.05, *HELD), aw.Payload(0.12, 0.0)]
    run = aw.simulate(scenario_of(bare, payload=switched, duration=0.2, **common, **START))
    a = aw.simulate(scenario_of(bare, duration=0.05, **common, **START))
    b = aw.simulate(scenario_of(bare.with_payload(*HELD), duration=0.07, start=a, **common))
    c = aw.simulate(scenario_of(bare, duration=0.08, start=b, **common))
    tight = 1e-10 if integrator == "cvodes" else 1e-14
    for part, rows in ((a, slice(0, 50)), (b, slice(50, 120)), (c, slice(120, 200))):
        np.testing.assert_allclose(run.q.values[rows], part.q.values[:-1], atol=tight)
        np.testing.assert_allclose(run.qdd.values[rows], part.qdd.values[:-1], rtol=100 * tight, atol=100 * tight)
    np.testing.assert_allclose(state(run), state(c), atol=tight)
    assert np.abs(a.qdd.values[-1] - b.qdd.values[0]).min() > 0.1  # accelerations jump where nothing else does


def law(t, r, y):
    return 40.0 * (r.q - y.q) + 8.0 * (r.qd - y.qd)


def test_rows_between_ticks_are_landed_on():
    model = arm("two-link")
    common = {"controller": law, "reference": [0.5, -0.4], "duration": 0.2, **START}
    switched = [aw.Payload(0.0503, *HELD), aw.Payload(0.1207, 0.5, [0, 0, 0], [0, 0, 0])]
    coarse = aw.simulate(scenario_of(model, payload=switched, period=2e-3, substeps=8, **common))
    exact = aw.simulate(scenario_of(model, payload=switched, period=2e-3, integrator="cvodes", **common))
    np.testing.assert_allclose(coarse.q.values, exact.q.values, atol=1e-9)
    late = [aw.Payload(0.052, *HELD), aw.Payload(0.122, 0.5, [0, 0, 0], [0, 0, 0])]
    moved = aw.simulate(scenario_of(model, payload=late, period=2e-3, substeps=8, **common))
    assert np.abs(moved.q.values - exact.q.values).max() > 1e-6  # a row put on the next tick is another run


def test_commands_over_time_and_bodies_land_where_scipy_switches():
    """Both between ticks; what a row tells is what holds at its tick, not what comes inside."""
    model, times = arm("two-link"), [0.0, 0.0503, 0.1, 0.1207, 0.2]
    commands = aw.Schedule([0.0, 0.1], [[20.0, 5.0], [-10.0, 2.0]], model.names)
    payload = [aw.Payload(0.0503, *HELD), aw.Payload(0.1207, 0.0)]
    run = aw.simulate(
        scenario_of(model, command=commands, payload=payload, duration=0.2, step=1e-3, integrator="rk4", **START)
    )
    x = np.concatenate([START["q0"], START["qd0"]])
    for begin, end, own in zip(times, times[1:], [model, *[model.with_payload(*HELD)] * 2, model], strict=False):

        def moving(t, x, own=own, begin=begin):
            return np.concatenate([x[2:], aw.forward_dynamics(own, x[:2], x[2:], commands.at(begin))])

        x = solve_ivp(moving, (begin, end), x, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(state(run), x, atol=1e-9)
    for row, own in ((50, model), (51, model.with_payload(*HELD)), (120, model.with_payload(*HELD)), (121, model)):
        at = run.q.values[row], run.qd.values[row]
        expected = aw.forward_dynamics(own, *at, commands.at(run.time.values[row] + 1e-9))
        np.testing.assert_allclose(run.qdd.values[row], expected, rtol=1e-9)


def test_holding_it_takes_m_g_r_more():
    """tau = (3 · 0.3 + m r) g cos q at rest, r of the body's centre of mass from the axis."""
    model = pendulum("torque", motor=MOTOR).replace(tip="rod0")
    mass, r, q0 = 2.0, 0.7, 0.4
    control = aw.JointPID(kp=4000.0, ki=20000.0, kd=400.0, gravity=True)
    run = aw.simulate(
        aw.Scenario(
            model, duration=6.0, start=[q0], loop=aw.Loop(controller=control, period=1e-3),
            inputs=aw.Inputs(payload=[aw.Payload(2.0, mass, [r, 0, 0], [0.0, 0.02, 0.02]), aw.Payload(4.0, 0.0)]),
        )
    )  # fmt: skip
    tau, q = run.tau.values[:, 0], run.q.values[:, 0]
    for k, moment in ((1999, 0.9), (3999, 0.9 + mass * r), (6000, 0.9)):
        assert abs(q[k] - q0) < 2e-6
        assert -tau[k] == pytest.approx(moment * G * np.cos(q[k]), rel=1e-5)  # about y, and the rod points along x


@pytest.mark.study
def test_it_is_there_before_the_first_tick():
    """What is in the hand at t = 0 belongs to what holds the arm still."""
    model = arm("cmu-dd")
    q0 = [0.1, 0.4, -0.3, 0.2, 0.3, 0.1]
    held = aw.simulate(
        aw.Scenario(
            model, duration=0.2, start=q0, loop=aw.Loop(controller=lambda t, r, y: y.applied, period=1e-3),
            inputs=aw.Inputs(payload=aw.Payload(0.0, *HELD)),
        )
    )  # fmt: skip
    np.testing.assert_allclose(held.q.values, np.broadcast_to(q0, held.q.shape), atol=1e-9)


@pytest.mark.study
def test_the_hand_keeps_its_speed_and_energy_jumps_by_the_bodys_own():
    """½ m v² + ½ ω I ω + m g z come and go with the body; in between, power balances."""
    model = arm("cmu-dd").replace(efficiency=None)
    start = {"q0": [0.1, 0.4, -0.3, 0.2, 0.3, 0.1], "qd0": [1.0, -0.8, 0.9, 1.2, -1.0, 0.7]}
    volts = [8.0, -20.0, 12.0, 3.0, -1.0, 0.5]
    switched = [aw.Payload(0.1, *HELD), aw.Payload(0.25, 0.0)]
    run = aw.simulate(scenario_of(model, command=volts, step=1e-4, duration=0.4, payload=switched, **start))
    states = np.concatenate([run.q.values, run.qd.values], axis=1)
    plants = {False: Plant.of(model), True: Plant.of(model.with_payload(*HELD))}

    def stored(holding, k):
        return float(stored_energy(plants[holding], states[k]))

    power, jumps = 0.0, 0.0
    for first, last, holding in ((0, 1000, False), (1000, 2500, True), (2500, 4000, False)):
        flow = [balance(plants[holding], x, volts) for x in states[first : last + 1]]
        gained = stored(holding, last) - stored(holding, first)
        assert gained == pytest.approx(simpson(flow, dx=1e-4), abs=1e-7 * np.abs(flow).max())
        power += gained
        if last < 4000:
            own = carried_energy(model, states[last])
            jump = stored(not holding, last) - stored(holding, last)
            assert jump == pytest.approx(-own if holding else own, rel=1e-9)
            assert abs(jump) > 1.0
            jumps += jump
    assert stored(False, -1) - stored(False, 0) == pytest.approx(power + jumps, rel=1e-12)


def carried_energy(model, x):
    """Of the body alone, moving with the hand: ½ m v² + ½ ω I ω - m g z [J]."""
    q, qd = x[: model.n], x[model.n :]
    hand, twist = aw.forward_kinematics(model, q), aw.jacobian(model, q) @ qd
    lever = hand[:3, :3] @ COM
    v, w = twist[:3] + np.cross(twist[3:], lever), hand[:3, :3].T @ twist[3:]
    return float(0.5 * 2.0 * v @ v + 0.5 * w @ TENSOR @ w - 2.0 * model.gravity @ (hand[:3, 3] + lever))


def balance(plant, x, u):
    """Electrical power in, less what becomes heat and friction [W]."""
    rates = energy_rates(plant, x, np.asarray(u))
    return float(rates["electrical"] - rates["heat"] - rates["friction"])


@pytest.mark.study
@settings(deadline=None, max_examples=8)
@given(data=st.data())
def test_from_the_beginning_it_is_the_arm_with_a_payload(data):
    """Any body on any frame that moves: the same accelerations as of the record with one more link."""
    model = arm("cmu-dd")
    frames = [name for name, frame in model.frames.items() if frame.body >= 0]
    frame = data.draw(st.sampled_from(frames))
    number = st.floats(-0.3, 0.3)
    points = np.array(data.draw(st.lists(st.tuples(number, number, number), min_size=4, max_size=4)))
    com, mass = points.mean(axis=0), data.draw(st.floats(0.1, 5.0))
    spread = (points - com).T @ (points - com) * mass / 4
    tensor = np.trace(spread) * np.eye(3) - spread
    common = {"command": [8.0, -20.0, 12.0, 3.0, -1.0, 0.5], "q0": [0.1, 0.4, -0.3, 0.2, 0.3, 0.1], "duration": 0.02}
    carried = aw.simulate(scenario_of(model, payload=aw.Payload(0.0, mass, com, tensor, frame), **common))
    held = aw.simulate(scenario_of(model.with_payload(mass, com, tensor, frame), **common))
    np.testing.assert_allclose(carried.qdd.values, held.qdd.values, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(carried.q.values, held.q.values, rtol=1e-11, atol=1e-12)


def test_two_hands_hold_their_own():
    model = arm("two-link")
    common = {"command": [20.0, 5.0], "duration": 0.1, **START}
    first, second = aw.Payload(0.0, 1.0, [0.1, 0, 0], [0, 0, 0], "upper_arm"), aw.Payload(0.0, *HELD, "forearm")
    both = aw.simulate(scenario_of(model, payload=[first, second], **common))
    held = model.with_payload(1.0, [0.1, 0, 0], [0, 0, 0], "upper_arm", name="one").with_payload(*HELD, "forearm")
    np.testing.assert_allclose(both.q.values, aw.simulate(scenario_of(held, **common)).q.values, atol=1e-13)
    emptied = [first, second, aw.Payload(0.05, 0.0, frame="upper_arm")]
    left = aw.simulate(scenario_of(model, payload=emptied, **common))
    half = aw.simulate(scenario_of(held, **common | {"duration": 0.05}))
    rest = aw.simulate(
        scenario_of(model.with_payload(*HELD, "forearm"), start=half, command=[20.0, 5.0], duration=0.05)
    )
    np.testing.assert_allclose(left.q.values[50:], rest.q.values, atol=1e-13)


@pytest.mark.parametrize("driven", ["controller", "command"])
def test_a_lane_has_the_same_bits_wherever_it_stands(driven):
    """Bodies, their times and what holds them may differ by lane."""
    count = 21
    draw = np.random.default_rng(3)
    mass, time = draw.uniform(0.0, 3.0, count), draw.uniform(0.01, 0.04, count)
    com, tensor = draw.uniform(-0.1, 0.1, (count, 3)), np.abs(draw.uniform(0.5, 1.0, (count, 1, 1))) * TENSOR
    q0 = draw.uniform(-0.5, 0.5, (count, 2))
    drive = {"controller": law, "period": 1e-3} if driven == "controller" else {"command": [5.0, 1.0], "step": 1e-3}

    def run(lanes, threads=None):
        numbers = [each[lanes] for each in (time, mass, com, tensor, q0)]
        if isinstance(lanes, slice):
            numbers = [aw.Batch(each) for each in numbers]
        *body, start = numbers
        payload = [aw.Payload(*body), aw.Payload(0.06, 0.0)]
        scenario = scenario_of(
            arm("two-link"), payload=payload, q0=start, duration=0.08, reduce=["peak_torque"], **drive
        )
        return aw.simulate(scenario, threads=threads)

    whole = run(slice(None))
    np.testing.assert_array_equal(run(slice(None), threads=1).q.values, whole.q.values)
    for lane in (0, 7, 20):
        alone = run(lane)
        np.testing.assert_array_equal(alone.q.values, whole.q.values[lane])
        np.testing.assert_array_equal(alone.peak_torque.values, whole.peak_torque.values[lane])
    np.testing.assert_array_equal(run(slice(3, 12)).q.values, whole.q.values[3:12])
    assert len({row.tobytes() for row in whole.q.values}) == count


def test_with_numbers_that_vary_and_a_controller_in_python():
    """The arm's own parameters vary beside what it carries; a controller that cannot be traced changes nothing."""
    masses = np.array([2.0, 4.0])
    common = {"reference": [0.4, -0.4], "period": 1e-3, "duration": 0.1, **START}
    payload = [aw.Payload(0.03, aw.Batch([1.0, 2.0]), COM, TENSOR)]
    varied = {"vary": {"forearm.mass_kg": aw.Batch(masses)}, "payload": payload, **common}
    traced = aw.simulate(scenario_of(arm("two-link"), controller=law, **varied))

    def untraced(t, r, y):
        return np.asarray(law(t, r, y), dtype=float)

    called = aw.simulate(scenario_of(arm("two-link"), controller=untraced, **varied))
    np.testing.assert_allclose(called.q.values, traced.q.values, atol=1e-12)
    for lane in range(2):
        own = arm("two-link").with_values({"forearm.mass_kg": masses[lane]})
        one = aw.simulate(
            scenario_of(own, controller=law, payload=aw.Payload(0.03, [1.0, 2.0][lane], COM, TENSOR), **common)
        )
        np.testing.assert_allclose(traced.q.values[lane], one.q.values, atol=1e-12)


def test_what_is_not_carried_costs_nothing():
    plain = aw.simulate(scenario_of(arm("two-link"), command=[5.0, 1.0], duration=0.05, **START))
    empty = aw.simulate(
        scenario_of(arm("two-link"), command=[5.0, 1.0], duration=0.05, payload=aw.Payload(0, 0), **START)
    )
    np.testing.assert_allclose(empty.q.values, plain.q.values, atol=1e-14)
    simulation = aw.simulation.Simulation(scenario_of(arm("two-link"), command=[5.0, 1.0], duration=0.05, **START))
    assert [port.name for port in simulation.loop.step.inputs] == ["x", "u", "h"]


BODY = (1.0, [0, 0, 0.1], [0.01, 0.01, 0.01])


@pytest.mark.parametrize(
    ("payload", "place", "said"),
    [
        (2.0, "", r" = 2.0: .*aw.Payload\(time, "),
        ([], "", r" = \[\]: expected an aw.Payload"),
        ([aw.Payload(0.1, *BODY), 3.0], "", "expected an aw.Payload"),
        (aw.Payload(0.1, -1.0, *BODY[1:]), "[0].mass", "= -1.0: .*0 kg or more"),
        (aw.Payload(0.1, [1.0, 2.0], *BODY[1:]), "[0].mass", "0 kg or more"),
        (aw.Payload(0.1, aw.Batch([1.0, -2.0]), *BODY[1:]), "[0].mass of lane 1", "= -2.0: .*0 kg or more"),
        (aw.Payload(-0.1, *BODY), "[0].time", "= -0.1: expected 0 s or more"),
        (aw.Payload(0.1, 1.0, inertia=[0.1, 0.1, 0.1]), "[0].com", r"\.com: missing"),
        (aw.Payload(0.1, "heavy", *BODY[1:]), "[0].mass", "= 'heavy': .*0 kg or"),
        (aw.Payload(0.1, 1.0, [0, 0], [0, 0, 0]), "[0].com", r"= \[0, 0\]: expected three numbers"),
        (aw.Payload(0.1, 1.0, [0, 0, np.nan], [0, 0, 0]), "[0].com", "nan.*: expected three numbers"),
        (aw.Payload(0.1, 1.0, [0, 0, 0], [0.1, 0.1, 0.3]), "[0].inertia", "moments 0.1, 0.1 and 0.3 kg m²"),
        (aw.Payload(0.1, 1.0, [0, 0, 0], np.diag([-0.1, 0.1, 0.1])), "[0].inertia", "moments -0.1, 0.1 and 0.1 kg m²"),
        (aw.Payload(0.1, 1.0, [0, 0, 0], [[0, 1, 0], [0, 0, 0], [0, 0, 0]]), "[0].inertia", "expected a symmetric"),
        (aw.Payload(0.1, 0.0, [0, 0, 0], [0.1, 0.1, 0.1]), "[0].mass", "= 0.0: with an inertia"),
        ([aw.Payload(0.2, *BODY), aw.Payload(0.1, 0.0)], "[1].time", r"= 0.1: expected one after payload\[0\]'s 0.2 s"),
        ([aw.Payload(aw.Batch([0.1, 0.2]), *BODY), aw.Payload(aw.Batch([0.2, 0.2]), 0.0)], "[1].time of lane 1", "= 0.2: expec"),
        (aw.Payload(0.1, *BODY, "hand9"), "[0].frame", "= 'hand9': two-link"),
        (aw.Payload(0.1, *BODY, "base"), "[0].frame", "= 'base': stands still"),
        (
            [aw.Payload(aw.Batch([0.1, 0.2]), *BODY), aw.Payload(0.3, aw.Batch([0.0, 0.0, 0.0]))],
            "[1].mass",
            r"3 lanes; .*2, as payload\[0\].time has",
        ),
    ],
)  # fmt: skip
def test_bodies_that_cannot_be_are_refused(payload, place, said):
    with pytest.raises(ArmwrightError, match=said) as refused:
        aw.Scenario(arm("two-link"), command=[0.0, 0.0], duration=0.5, inputs=aw.Inputs(payload=payload))
    assert refused.value.place == f"inputs.payload{place}"
    assert "\n" not in str(refused.value)


def test_a_mass_alone_is_a_point_mass():
    """At the frame's origin, or at its centre of mass: the same bits as with zeros, and a weight that the closed form has."""
    common = {"command": [0.0, 0.0], "duration": 0.05}
    for short, whole in (
        (aw.Payload(0.01, 2.0), aw.Payload(0.01, 2.0, [0, 0, 0], [0, 0, 0])),
        (aw.Payload(0.01, 2.0, COM), aw.Payload(0.01, 2.0, COM, np.zeros((3, 3)))),
    ):
        one, two = (aw.simulate(scenario_of(arm("two-link"), payload=each, **common)) for each in (short, whole))
        np.testing.assert_array_equal(one.qdd.values, two.qdd.values)
    model = pendulum("torque")
    held = aw.simulate(
        scenario_of(model, payload=aw.Payload(0.0, 2.0, [0, 0, 0]), command=[0.0], q0=[0.7], duration=1e-3)
    )
    loaded = model.with_payload(2.0, [0, 0, 0], [0, 0, 0])
    expected = aw.forward_dynamics(loaded, held.q.values[0], held.qd.values[0], np.zeros(1))
    np.testing.assert_allclose(held.qdd.values[0], expected, rtol=1e-12)


def test_an_arm_that_is_not_told_carries_what_it_does_not_know():
    """Computed torque with the arm's own model: the body is what the model does not know, and the error is its weight's."""
    control = aw.ComputedTorque(kp=100.0, kd=20.0)
    common = {"controller": control, "reference": [0.3, 0.2], "q0": [0.3, 0.2], "period": 1e-3, "duration": 4.0}
    loaded = arm("two-link").with_payload(1.0, [0, 0, 0], [0, 0, 0])
    run = aw.simulate(scenario_of(arm("two-link"), payload=aw.Payload(0.0, 1.0, [0, 0, 0], [0, 0, 0]), **common))
    knows = aw.simulate(
        scenario_of(
            arm("two-link"), payload=aw.Payload(0.0, 1.0, [0, 0, 0], [0, 0, 0]),
            **common | {"controller": aw.ComputedTorque(kp=100.0, kd=20.0, model=loaded)},
        )
    )  # fmt: skip
    assert np.abs(knows.q.values - [0.3, 0.2]).max() < 1e-9
    model, q = arm("two-link"), run.q.values[-1]
    weight = aw.gravity_torques(loaded, q) - aw.gravity_torques(model, q)
    given = aw.mass_matrix(model, q) @ (100.0 * (np.array([0.3, 0.2]) - q))
    np.testing.assert_allclose(scalar.array(given), weight, rtol=1e-6)
