"""Loops about a pose: margins beside python-control's, and stability beside the simulation of the same loop."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import armwright as aw
from armwright.control.analysis import LinearLoop, zero_order_hold
from armwright.control.analysis.small_signal import small_signal_arm
from armwright.errors import ScenarioError

PERIOD = 2e-3
POSE = np.array([0.2, 0.9])
CONTROLLERS = {
    "pd": aw.JointPID(kp=400.0, kd=60.0, gravity=True),
    "pid": aw.JointPID(kp=400.0, kd=60.0, ki=50.0, cutoff_hz=60.0),
    "cascade": aw.Cascade(position_kp=12.0, speed_kp=40.0, speed_ki=100.0),
    "three rates": aw.Cascade(position_kp=12.0, speed_kp=40.0, speed_ki=100.0, position_every=4, speed_every=2),
    "computed torque": aw.ComputedTorque(kp=900.0, kd=60.0),
}
TIMINGS = {
    "ideal": aw.Timing(),
    "late": aw.Timing(preset="one-tick", measurement_delay=0.7e-3, command_delay=0.5e-3),
}


def scenario(controller, timing="late", sensors=None, arm=None, period=PERIOD, **more):
    arm = aw.load("two-link") if arm is None else arm
    loop = aw.Loop(controller, period=period, timing=TIMINGS[timing], sensors=sensors or aw.Sensors())
    return aw.Scenario(arm, loop=loop, **{"duration": 1.0, **more})


class Scaled:
    """A controller about what holds the arm, with factors in the joints' commands."""

    def __init__(self, inner, factor):
        self.inner, self.factor = inner, factor
        compensates = isinstance(inner, aw.ComputedTorque) or getattr(inner, "gravity", False)
        self.hold = aw.gravity_torques(aw.load("two-link"), POSE)
        self.inside = self.hold if compensates else 0.0 * self.hold

    def configure(self, arm, period):
        made = type(self)(self.inner, self.factor)
        made.inner = self.inner.configure(arm, period)
        return made

    def init(self, arm, y):
        return self.inner.init(arm, y)

    def step(self, t, r, y, s):
        u, s = self.inner.step(t, r, y, s)
        return self.hold + self.factor * (u - self.inside), s


def settles(controller, timing, sensors):
    """True if the simulation comes to rest again after a nudge of 1 nrad."""
    arm = small_signal_arm(aw.load("two-link"))
    start, solver = np.array([1e-9, -2e-9]) + POSE, aw.Solver("rk4", substeps=4)
    made = scenario(controller, timing, sensors, arm, duration=1.6, start=start, solver=solver)
    speed = np.abs(aw.simulate(replace(made, loop=replace(made.loop, reference=POSE))).qd.values).max(axis=1)
    part = len(speed) // 4
    return speed.max() < 1e-5 and speed[-part:].max() < speed[part : 2 * part].max()


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.sample(1)
def test_margins_are_where_the_simulation_becomes_unstable(name, timing):
    """A factor in one joint's command, 2 % inside and 2 % outside its margin."""
    sensors = aw.Sensors(velocity="filtered", cutoff_hz=80.0) if name == "pd" else aw.Sensors()
    margins = LinearLoop(scenario(CONTROLLERS[name], timing, sensors)).margins(POSE)
    assert margins.radius < 1.0
    assert np.isfinite(margins.gain_up).all()
    for share, stable in ((0.98, True), (1.02, False)):
        factor = np.array([1.0, share * margins.gain_up[1]])
        assert settles(Scaled(CONTROLLERS[name], factor), timing, sensors) == stable


def test_python_control_finds_the_same_margins():
    """One joint with the other held, PD from exact measurements, no delay: a transfer function."""
    control = pytest.importorskip("control", reason="python-control is the oracle")
    loop = LinearLoop(scenario(CONTROLLERS["pd"], "ideal"))
    slopes = loop._small.slopes(POSE)
    margins = loop.margins(POSE, held=True)
    for joint in range(2):
        rows = np.array([joint, 2 + joint])
        e, a = slopes.e[np.ix_(rows, rows)], slopes.a[np.ix_(rows, rows)]
        b = slopes.b[rows][:, [joint]]
        held = zero_order_hold(np.linalg.solve(e, a), np.linalg.solve(e, b), PERIOD)
        gains = -slopes.ticks[0][joint][rows][None]
        system = control.ss(held.a, held.new, gains, [[0.0]], PERIOD)

        def response(w, system=system):
            return complex(system(np.exp(1j * w * PERIOD)))

        w = np.linspace(1.0, np.pi / PERIOD * (1 - 1e-9), 20001)
        size, angle = np.abs(system(np.exp(1j * w * PERIOD))), np.unwrap(np.angle(system(np.exp(1j * w * PERIOD))))
        crossing = np.flatnonzero((size[:-1] > 1) & (size[1:] <= 1))[-1]
        cross = brentq(lambda v: abs(response(v)) - 1, w[crossing], w[crossing + 1])
        assert margins.phase[joint] == pytest.approx(np.pi + np.angle(response(cross)), rel=1e-6)
        assert angle[-1] == pytest.approx(-np.pi, abs=1e-3)  # reached at the Nyquist frequency
        assert margins.gain_up[joint] == pytest.approx(1.0 / abs(response(np.pi / PERIOD)), rel=1e-6)
    gains = -slopes.ticks[0][:, :4]
    held = zero_order_hold(np.linalg.solve(slopes.e, slopes.a), np.linalg.solve(slopes.e, slopes.b), PERIOD)
    w = np.geomspace(1e-4, 1.0, 2001) * np.pi / PERIOD
    peaks, _ = loop.sensitivity(POSE, points=2001)
    for joint in range(2):
        other = 1 - joint
        closed = held.a - held.new[:, [other]] @ gains[[other]]  # the other loop closed
        ratio = [
            gains[joint] @ np.linalg.solve(np.exp(1j * v * PERIOD) * np.eye(4) - closed, held.new[:, joint]) for v in w
        ]
        assert peaks[joint] == pytest.approx(np.abs(1.0 / (1.0 + np.array(ratio))).max(), rel=1e-9)


@pytest.mark.parametrize("timing", TIMINGS)
def test_python_control_closes_the_opened_loop(timing):
    """Its margins of L are ours; 1 + L = 0 has the eigenvalues of the closed loop; its sensitivity peak is ours."""
    control = pytest.importorskip("control", reason="python-control is the oracle")
    loop = LinearLoop(scenario(CONTROLLERS["pid"], timing, aw.Sensors(velocity="difference")))
    ours, radius = loop.margins(POSE), loop.radius(POSE)
    peaks, _ = loop.sensitivity(POSE, points=4001)
    for joint in range(2):
        system = loop.open_loop(POSE, joint)
        w = np.geomspace(1e-4, 1.0, 4001) * np.pi / PERIOD

        def response(v, system=system):
            return complex(system(np.exp(1j * v * PERIOD)))

        answer = system(np.exp(1j * w * PERIOD))
        crosses = np.flatnonzero((answer.imag[:-1] * answer.imag[1:] < 0) & (answer.real[:-1] < 0))
        gains = [1 / abs(response(brentq(lambda v: response(v).imag, w[k], w[k + 1]))) for k in crosses]
        gains.append(1 / abs(response(w[-1])) if response(w[-1]).real < 0 else np.inf)
        ones = np.flatnonzero((np.abs(answer[:-1]) - 1) * (np.abs(answer[1:]) - 1) < 0)
        lags = [np.angle(-response(brentq(lambda v: abs(response(v)) - 1, w[k], w[k + 1]))) for k in ones]
        assert ours.gain_up[joint] == pytest.approx(min(gain for gain in gains if gain > 1.0), rel=1e-6)
        assert ours.phase[joint] == pytest.approx(min(lag for lag in lags if lag > 0.0), rel=1e-6)
        assert peaks[joint] == pytest.approx(np.abs(1.0 / (1.0 + answer)).max(), rel=1e-9)
    closed = control.feedback(loop.open_loop(POSE), np.eye(2))
    assert np.abs(closed.poles()).max() == pytest.approx(radius, abs=1e-9)
    alone = control.feedback(loop.open_loop(POSE, 1, held=True))
    assert np.abs(alone.poles()).max() == pytest.approx(loop.radius(POSE, joint=1), abs=1e-9)


def test_a_batch_of_poses_is_each_by_itself():
    loop = LinearLoop(scenario(CONTROLLERS["three rates"]))
    poses = np.random.default_rng(0).uniform(-2, 2, (20, 2))
    assert loop.cycle == 4
    assert np.abs(loop.radius(poses) - [loop.radius(q) for q in poses]).max() < 1e-12


def test_held_joints_see_the_diagonal_of_the_mass_matrix():
    arm = aw.load("two-link")
    slopes = LinearLoop(scenario(CONTROLLERS["pd"])).slopes(POSE)
    assert np.abs(slopes.e[2:, 2:] - aw.mass_matrix(small_signal_arm(arm), POSE)).max() < 1e-12


@pytest.mark.parametrize(
    ("make", "place"),
    [
        (lambda: aw.Scenario(aw.load("two-link"), duration=1.0, command=[0, 0]), "loop"),
        (lambda: scenario(lambda t, r, y: np.array([float(each) for each in y.q])), "loop.controller"),
    ],
)
def test_refused(make, place):
    with pytest.raises(ScenarioError) as error:
        LinearLoop(make()).radius(POSE)
    assert error.value.problems[0].place.startswith(place)


def lanes(**parts):
    """A scenario of two lanes that differ in parts of its loop."""
    loop = aw.Loop(CONTROLLERS["pd"], period=PERIOD, **parts)
    return aw.Scenario(aw.load("two-link"), 1.0, loop=loop, lanes=2)


@pytest.mark.parametrize(
    ("call", "place"),
    [
        (lambda: LinearLoop(CONTROLLERS.get("none")), "scenario"),  # type: ignore[arg-type]
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"]), 0.0), "period"),
        (lambda: LinearLoop(lanes(timing=aw.Timing(command_delay=aw.Batch([0.0, 1e-3])))), "loop.timing.command_delay"),
        (lambda: LinearLoop(lanes(sensors=aw.Sensors(counts=aw.Batch([400, 500])))), "loop.sensors.counts"),
        (lambda: LinearLoop(lanes(timing=aw.Timing(jitter=aw.Draw.uniform(0.0, 1e-3)))), "loop"),
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"]), np.nan), "period"),
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"])).radius([0.2]), "q"),
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"])).radius([np.nan, 0.2]), "q"),
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"])).radius(["a", "b"]), "q"),
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"])).radius([[0.2, 0.9], [0.1]]), "q"),
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"])).open_loop([POSE, POSE]), "q"),
        (lambda: LinearLoop(scenario(CONTROLLERS["pd"])).open_loop(POSE, 2), "joint"),
        (lambda: LinearLoop(scenario(CONTROLLERS["three rates"])).open_loop(POSE), "loop"),
    ],
)
def test_bad_poses_and_periods(call, place):
    with pytest.raises(ScenarioError) as error:
        call()
    assert error.value.problems[0].place == place


def test_a_large_gain_margin_is_found():
    """PD with tiny gains: the upper margin of one joint alone is 2 H_jj / (kd T) of a first-order sampled speed loop."""
    loop = LinearLoop(scenario(aw.JointPID(kp=1e-6, kd=1.0, gravity=True), "ideal"))
    held = loop.margins(np.array([0.1, np.pi / 2 - 0.1]), held=True).gain_up
    inertia = np.diag(aw.mass_matrix(small_signal_arm(aw.load("two-link")), np.array([0.1, np.pi / 2 - 0.1])))
    assert held == pytest.approx(2 * inertia / PERIOD, rel=2e-2)


def test_several_rates_have_no_single_sensitivity():
    with pytest.raises(ScenarioError):
        LinearLoop(scenario(CONTROLLERS["three rates"])).sensitivity(POSE)


def test_a_body_in_the_hand_is_said_to_be_left_out():
    """With 8 kg at the tip the arm's inertias are others, so margins of the empty hand are no verdict on it."""
    empty, carried = scenario(CONTROLLERS["cascade"]), aw.Inputs(payload=[aw.Payload(0.5, 8.0)])
    assert len(LinearLoop(replace(empty, inputs=carried)).notes) == len(LinearLoop(empty).notes) + 1
    loaded = replace(empty, arm=empty.arm.with_payload(8.0, [0.0] * 3, np.zeros((3, 3))))
    assert LinearLoop(loaded).radius(POSE) != LinearLoop(empty).radius(POSE)
