"""Lanes: `Batch` alone marks them, controllers may have matrices in them, and a lane's bits are its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import armwright as aw
from armwright import scalar
from armwright.errors import ModelError, ScenarioError
from armwright.kernels.target import select_target
from armwright.simulation import batch_runner
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of

PERIOD = 5e-3
POSE = np.array([0.4, -0.7])
START = np.array([0.3, -0.5])
POSITION = np.hstack([np.eye(2), np.zeros((2, 2))])  # of the state (q, q̇) what is measured


def linearised() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Discrete (4, 4) and (4, 2) of the two-link arm about POSE, commands held over a period, and the command that holds it."""
    model = arm("two-link")
    hold = aw.gravity_torques(model, POSE)
    a, b = aw.compile(model).forward_arm_linearised(POSE, np.zeros(2), hold)
    whole = expm(np.block([[a, b], [np.zeros((2, 6))]]) * PERIOD)
    return whole[:4, :4], whole[:4, 4:], hold


def lqr_gain(weight: float = 1.0) -> np.ndarray:
    """(2, 4) of the regulator that minimises the sum of 100 δqᵀ δq + δq̇ᵀ δq̇ + weight · 1e-4 uᵀ u."""
    a, b, _ = linearised()
    r = weight * 1e-4 * np.eye(2)
    p = solve_discrete_are(a, b, np.diag([100.0, 100.0, 1.0, 1.0]), r)
    return np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)


@dataclass(frozen=True, eq=False)
class StateFeedback:
    """u = u₀ - K (x - x₀)."""

    gain: Any  # (2, 4), or a batch of such
    hold: np.ndarray = field(default_factory=lambda: linearised()[2])

    def init(self, arm, y):
        return scalar.zeros(0)

    def step(self, t, r, y, s):
        return self.hold - self.gain @ np.concatenate([y.q - POSE, y.qd]), s


@dataclass(frozen=True, eq=False)
class KalmanFeedback:
    """State feedback from a Kalman filter that sees positions alone; s holds its estimate and its covariance.

    Positions are independent measurements, so that the update takes them one after the other, without an inverse.
    """

    a: np.ndarray
    b: np.ndarray
    hold: np.ndarray
    gain: Any
    process: np.ndarray
    noise: float

    def init(self, arm, y):
        return np.concatenate([y.q - POSE, scalar.zeros(2), scalar.array(1e-2 * np.eye(4)).ravel()])

    def step(self, t, r, y, s):
        x, p = s[:4], s[4:].reshape(4, 4)
        for i in range(2):
            k = p[:, i] / (p[i, i] + self.noise**2)
            x, p = x + k * (y.q[i] - POSE[i] - x[i]), p - np.outer(k, p[i])
        du = -self.gain @ x
        following = self.a @ x + self.b @ du, self.a @ p @ self.a.T + self.process
        return self.hold + du, np.concatenate([following[0], following[1].ravel()])


def simulated(controller, **fields):
    """A run of the two-link arm from near POSE."""
    common = {"q0": POSE + np.array([0.1, -0.1]), "period": PERIOD, "duration": 400 * PERIOD}
    return aw.simulate(scenario_of(arm("two-link"), controller=controller, **(common | fields)))


def around(count: int, spread: float = 0.15) -> np.ndarray:
    """(count, 2) positions near POSE."""
    return POSE + np.random.default_rng(0).uniform(-spread, spread, (count, 2))


def test_a_gain_may_be_a_matrix():
    run = simulated(StateFeedback(lqr_gain()))
    assert run.attrs["controller"] == "compiled"
    np.testing.assert_allclose(run.q.values[-1], POSE, atol=1e-6)
    without = simulated(StateFeedback(np.zeros((2, 4))), duration=100 * PERIOD)
    assert np.abs(without.q.values[-1] - POSE).max() > 0.1


def test_a_thousand_lanes_share_a_matrix():
    q0 = around(1000)
    run = simulated(StateFeedback(lqr_gain()), q0=aw.Batch(q0), every=20)
    assert run.attrs["controller"] == "compiled"
    assert run.q.shape == (1000, 21, 2)
    np.testing.assert_allclose(run.q.values[:, -1], np.broadcast_to(POSE, (1000, 2)), atol=1e-5)
    for lane in (0, 1, 500, 999):
        one = simulated(StateFeedback(lqr_gain()), q0=q0[lane], every=20)
        np.testing.assert_array_equal(one.q.values, run.q.values[lane])


@pytest.mark.study
def test_every_lane_may_have_its_own_matrix():
    """To the bit what the single run with this matrix gives."""
    gains = np.array([lqr_gain(weight) for weight in np.geomspace(0.1, 100.0, 9)])
    run = simulated(StateFeedback(aw.Batch(gains)))
    assert run.attrs["controller"] == "compiled"
    assert run.sizes["lane"] == 9
    for lane, gain in enumerate(gains):
        one = simulated(StateFeedback(gain))
        for name in ("q", "qd", "u"):
            np.testing.assert_array_equal(one[name].values, run[name].values[lane])
    assert len({row.tobytes() for row in run.q.values}) == 9


def test_a_matrix_for_each_lane_is_no_guess():
    """A bare array is one value, whatever its shape; three matrices are no gain."""
    with pytest.raises(ScenarioError, match="StateFeedback"):
        simulated(StateFeedback(np.array([lqr_gain()] * 3)))


NOISE = 2e-4  # [rad]


def kalman() -> KalmanFeedback:
    a, b, hold = linearised()
    process = b @ b.T + 1e-12 * np.eye(4)
    return KalmanFeedback(a, b, hold, lqr_gain(), process, NOISE)


def test_a_kalman_filter_settles_where_riccati_says():
    """Its covariance comes to the solution of the filter's algebraic Riccati equation."""
    control = kalman()
    run = simulated(control, sensors=aw.Sensors(position_noise=NOISE), seed=3)
    assert run.attrs["controller"] == "compiled"
    found = aw.simulation.LoopState.of_run(run).blocks["s"][0, 4:].reshape(4, 4)
    exact = solve_discrete_are(control.a.T, POSITION.T, control.process, NOISE**2 * np.eye(2))
    np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-9 * np.abs(exact).max())


def test_a_thousand_lanes_with_a_kalman_filter_and_noise():
    fields = {"sensors": aw.Sensors(position_noise=NOISE), "seed": 3, "every": 4}
    q0 = around(1000, 0.03)
    run = simulated(kalman(), q0=aw.Batch(q0), **fields)
    assert run.attrs["controller"] == "compiled"
    late = run.q.values[:, -20:] - POSE
    assert np.sqrt(np.mean(late**2)) < NOISE  # the arm stands stiller than its sensors say
    assert len({row.tobytes() for row in run.q.values}) == 1000
    few = simulated(kalman(), q0=aw.Batch(q0[:10]), **fields)  # noise depends on the lane, not on how many there are
    for name in ("q", "q_measured", "u"):
        np.testing.assert_array_equal(few[name].values, run[name].values[:10])


TICKS = 20
PROBE = {"q0": np.array([0.25, -0.75]), "qd0": np.array([1.0, -2.0]), "kp": np.array([60.0, 24.0])}  # exact in float32
FORMS: dict[str, Any] = {
    "float64": np.float64,
    "float32": np.float32,
    "list": lambda rows: np.asarray(rows).tolist(),
    "int": lambda rows: np.asarray(rows).astype(np.int64) if (np.rint(rows) == rows).all() else np.asarray(rows),
}
REDUCED = ("rms_error", "peak_torque")


def targets() -> list[str | None]:
    """Processor levels that this machine has."""
    found: list[str | None] = [None]
    for name in ("x86-64-v3", "x86-64-v2"):
        try:
            select_target(name)
        except ModelError:
            continue
        found.append(name)
    return found


def others(count: int, random: np.random.Generator) -> dict[str, np.ndarray]:
    """Values of lanes beside the probe."""
    return {
        "q0": random.uniform(-1.0, 1.0, (count, 2)),
        "qd0": np.rint(random.uniform(-3.0, 3.0, (count, 2))),
        "kp": np.rint(random.uniform(10.0, 80.0, (count, 2))),
    }


def probed(lanes: dict[str, Any], **fields: Any) -> aw.Scenario:
    """A controlled arm, whose lanes begin elsewhere and have other gains."""
    batch = {name: aw.Batch(rows) for name, rows in lanes.items()}
    controller = aw.JointPID(kp=batch["kp"], ki=20.0, kd=9.0, gravity=True)
    common = {"reference": START, "period": 2e-3, "duration": TICKS * 2e-3, "reduce": REDUCED}
    return scenario_of(arm("two-link"), controller=controller, q0=batch["q0"], qd0=batch["qd0"], **(common | fields))


@pytest.mark.study
def test_a_lane_has_its_bits_in_two_hundred_surroundings(monkeypatch):
    """Whatever the number of lanes, its place, threads, groups, vector width, what is recorded, and the type of its numbers."""
    random = np.random.default_rng(1982)
    expected = aw.simulate(probed({name: value[None] for name, value in PROBE.items()}))
    sizes = [1, 2, 3, 100_000, 30_000, 10_000, 4097, 4096, *np.exp(random.uniform(0.0, np.log(700.0), 192)).astype(int)]
    assert len(sizes) == 200
    levels = targets()
    for count in sizes:
        place, form = int(random.integers(count)), str(random.choice([*FORMS]))
        lanes = others(count, random)
        for name, value in PROBE.items():
            lanes[name][place] = value
        if form == "float32":
            lanes = {name: rows.astype(np.float32) for name, rows in lanes.items()}
        threads, tiles = int(random.integers(1, 4)), int(random.choice([1, 2, 5, 32]))
        target = levels[random.integers(len(levels))]
        record = str(random.choice(["all", "state", "none"]))
        every = 0 if count > 1000 else int(random.choice([0, 1, 4, 5, 20]))
        case = f"{count} lanes, {place=}, {form=}, {threads=}, {tiles=}, {target=}, {record=}, {every=}"
        monkeypatch.setattr(batch_runner, "TILES_A_GROUP", tiles)
        scenario = probed(
            {name: FORMS[form](rows) for name, rows in lanes.items()}, target=target, what=record, every=every
        )
        run = aw.simulate(scenario, threads=threads)
        assert run.sizes["lane"] == count
        for name in REDUCED:
            np.testing.assert_array_equal(run[name].values[place], expected[name].values[0], err_msg=case)
        if record != "none":
            for name in ("q", "qd", "tau", "u", "q_measured") if record == "all" else ("q", "qd"):
                rows = expected[name].values[0, :: every or TICKS]
                np.testing.assert_array_equal(run[name].values[place], rows, err_msg=f"{name}: {case}")


def test_noise_of_a_lane_does_not_depend_on_how_many_there_are():
    lanes = others(300, np.random.default_rng(0))
    fields = {"sensors": aw.Sensors(position_noise=1e-4, velocity_noise=1e-3), "seed": 5}
    many = aw.simulate(probed(lanes, **fields))
    for count in (1, 7, 8, 9, 64, 257):
        few = aw.simulate(probed({name: rows[:count] for name, rows in lanes.items()}, **fields))
        for name in ("q", "q_measured", "qd_measured", "u"):
            np.testing.assert_array_equal(few[name].values, many[name].values[:count])


def test_lanes_without_noise_are_part_of_those_that_have_some():
    """A deviation that differs by lane may be 0, in one lane and in all that run together."""
    lanes = others(3, np.random.default_rng(0))
    loud, draw = np.array([0.0, 1e-4, 2e-4]), {"seed": 5, "duration": 0.05}

    def noisy(part: slice) -> dict[str, Any]:
        return draw | {"sensors": aw.Sensors(position_noise=aw.Batch(loud[part]), velocity_noise=1e-3)}

    many = aw.simulate(probed(lanes, **noisy(slice(None))))
    few = aw.simulate(probed({name: rows[:1] for name, rows in lanes.items()}, **noisy(slice(1))))
    for name in ("q", "q_measured", "qd_measured", "u"):
        np.testing.assert_array_equal(few[name].values, many[name].values[:1])
    assert not np.array_equal(many.q_measured.values[1], many.q.values[1])
    np.testing.assert_array_equal(few.q_measured.values, few.q.values)


def test_every_lane_may_follow_its_own_reference():
    """Poses or schedules of poses; lane k is the single run with reference k."""
    poses = START + np.array([[0.0, 0.1], [0.2, 0.0], [-0.1, -0.3]])
    plans = [aw.Schedule([0.0, 0.01 * (k + 1)], [pose, START], ["shoulder", "elbow"]) for k, pose in enumerate(poses)]
    common = {"q0": START, "period": 2e-3, "duration": 0.1, "controller": aw.JointPID(kp=60.0, kd=9.0)}
    for each in (poses, plans):
        run = aw.simulate(scenario_of(arm("two-link"), reference=aw.Batch(each), **common))
        for lane, reference in enumerate(each):
            one = aw.simulate(scenario_of(arm("two-link"), reference=reference, **common))
            np.testing.assert_allclose(run.q_reference.values[lane], one.q_reference.values, rtol=0, atol=0)
            np.testing.assert_allclose(run.q.values[lane], one.q.values, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([], "at least one"),
        (np.zeros((0, 2)), "at least one"),
        (3.0, "for each lane"),
        ("three", "for each lane"),
        ([[1.0, 2.0], [3.0]], "unequal shape"),
        (aw.Batch([1.0]), "for each lane"),
        ([aw.Batch([1.0]), aw.Batch([2.0])], "holds a Batch"),
        ([1.0, aw.Batch([2.0])], "holds a Batch"),
    ],
)
def test_what_is_no_batch_is_refused(values, said):
    with pytest.raises(ScenarioError, match=said) as refused:
        aw.Batch(values)
    assert "\n" not in str(refused.value)


@dataclass(frozen=True, eq=False)
class Outer:
    """A controller with a part that is a dataclass."""

    inner: StateFeedback

    def init(self, arm, y):
        return self.inner.init(arm, y)

    def step(self, t, r, y, s):
        return self.inner.step(t, r, y, s)


def test_gains_of_an_inner_controller_may_differ_by_lane():
    gains = aw.Batch([lqr_gain(weight) for weight in (0.1, 1.0, 10.0)])
    inner, plain = simulated(Outer(StateFeedback(gains))), simulated(StateFeedback(gains))
    assert inner.attrs["controller"] == "compiled"
    np.testing.assert_array_equal(inner.u.values, plain.u.values)
    kp = np.array([[40.0, 10.0], [80.0, 20.0]])

    def law(gain):
        return aw.FeedForward(aw.JointPID(kp=gain, kd=5.0), gravity=True)

    every = simulated(law(aw.Batch(kp)), duration=50 * PERIOD)
    for lane in range(2):
        one = simulated(law(kp[lane]), duration=50 * PERIOD)
        np.testing.assert_array_equal(one.q.values, every.q.values[lane])


TWO, THREE = aw.Batch(np.zeros((2, 2))), aw.Batch(np.zeros((3, 2)))
DRIVEN: dict[str, Any] = {"controller": None, "period": None, "command": [0.0, 0.0]}
BODY = ([0, 0, 0.1], [0.01, 0.01, 0.01])


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"q0": TWO, "qd0": THREE}, r"start\.qd: 3 lanes; .*2, as start\.q has"),
        (
            {"controller": aw.JointPID(kp=THREE), "payload": [aw.Payload(0.0, aw.Batch([1.0, 2.0]), *BODY)]},
            r"inputs\.payload\[0\]\.mass: 2 lanes; .*3, as loop\.controller\.kp has",
        ),
        ({"controller": aw.JointPID(kp=THREE, kd=TWO)}, r"\.kd: 2 lanes; .*3, as loop\.controller\.kp has"),
        ({"controller": StateFeedback(aw.Batch([lqr_gain()] * 3)), "q0": TWO}, r"start\.q: 2 lanes; expected 3, as loop\.con"),
        (
            {"vary": {"forearm.mass_kg": aw.Batch([1.0, 2.0, 3.0])}, "timing": aw.Timing(jitter=aw.Batch([0.0, 1e-3]))},
            r"vary\['forearm\.mass_kg'\]: 3 lanes; .*2, as loop\.timing\.jitter has",
        ),
        ({"reference": TWO, "wrench": aw.Batch(np.zeros((3, 6)))}, r"inputs\.wrench: 3 lanes; expected 2, as loop\.reference"),
        ({"q0": np.zeros((3, 2))}, r"start\.q: shape \(3, 2\); .* Batch"),
        ({"initial_command": np.zeros((3, 2))}, r"loop\.initial_command: shape \(3, 2\).* Batch"),
        ({"vary": {"forearm.mass_kg": [1.0, 2.0]}}, r"vary\['forearm\.mass_kg'\] = \[1\.0, 2\.0\]"),
        ({"vary": {"forearm.com_m": np.zeros((2, 3))}}, r"vary\['forearm\.com_m'\] = .* Batch"),
        ({"timing": aw.Batch([aw.Timing(), aw.Timing()])}, "timing = .*: expected an aw.Timing"),
        (DRIVEN | {"command": np.zeros((3, 2))}, r"command: shape \(3, 2\).* Batch"),
        (DRIVEN | {"command": [aw.Schedule.constant(["shoulder", "elbow"], [0, 0])]}, r"command = \[<schedule"),
        ({"controller": Outer([aw.Batch([1.0])])}, r"controller\.inner\[0\]: a Batch; .*it as a field"),
    ],
)  # fmt: skip
def test_lanes_that_do_not_fit_are_refused(fields, said):
    common = {"controller": aw.JointPID(kp=1.0), "period": PERIOD, "duration": 10 * PERIOD}
    with pytest.raises(ScenarioError, match=said) as refused:
        aw.simulate(scenario_of(arm("two-link"), **(common | fields)))
    assert "\n" not in str(refused.value)


def test_a_setting_that_all_lanes_share_takes_no_batch():
    with raises_at(ScenarioError, "command_filter.rate", "batch of 2 lanes"):
        aw.CommandFilter(rate=aw.Batch([1e2, 1e3]))
