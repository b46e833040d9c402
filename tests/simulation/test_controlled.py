"""The loop of a controlled arm against a plain account of design section 4, event by event, with floats."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.actuators import holding_command, in_command_units, limited_drive
from armwright.errors import ScenarioError
from armwright.interfaces import Measurement
from armwright.model.joint_signals import motion_layout
from armwright.simulation.integrate.integrators import rk3_step
from armwright.simulation.loop.command_filter import CommandFilter
from armwright.simulation.loop.controller import reference_of
from armwright.simulation.loop.references import reference_rows
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.timing import Timing
from armwright.simulation.plant.plant import plant_derivative
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop, Solver
from physics.arms import arm
from simulation.fields import scenario_of, with_fields

PERIOD = 2e-3
KP, KD = np.array([400.0, 900, 300, 150, 30, 20]), np.array([40.0, 90, 30, 12, 3, 2])


def pd(t, r, y):
    """Volts from errors of position and speed."""
    return KP[: len(r.q)] * (r.q - y.q) + KD[: len(r.q)] * (r.qd - y.qd)


@dataclass(frozen=True)
class Integral:
    """PI with back-calculation: its integrator follows what the drive really did."""

    ki: float = 5.0

    def init(self, arm, y):
        return scalar.zeros(arm.n)

    def step(self, t, r, y, s):
        u = pd(t, r, y) + s
        return u, s + self.ki * (r.q - y.q) * PERIOD + 0.1 * (y.applied - u)


def swing(t):
    return scalar.array(
        [0.3 * scalar.sin(3.0 * t), 0.2 * scalar.sin(2.0 * t), 0.1, 0.2 * scalar.cos(4.0 * t), 0.0, 0.1]
    )


def accounted(model, law, reference, ticks, timing=None, command_filter=None, substeps=1, x0=None):
    """Rows (ticks + 1, …) of x, y, u_issued and u: commands with their arrivals in a list, the plant stepped between changes."""
    timing, command_filter, n = timing or Timing(), command_filter or CommandFilter(), model.n
    behind = timing.command_delay / PERIOD + (timing.preset == "one-tick")
    earlier = timing.measurement_delay / PERIOD
    x = np.zeros(2 * n) if x0 is None else x0
    hold = holding_command(model, aw.gravity_torques(model, x[:n]))
    applied = lambda x, u: in_command_units(model, limited_drive(model, x[n:], u))  # noqa: E731
    tell = lambda x: np.concatenate([x, limited_drive(model, x[n:], hold).current])  # noqa: E731
    y = aw_measurement(tell(x), applied(x, hold), n)
    s = law.init(model, y) if hasattr(law, "init") else None
    history, arrivals, kept, rows, u = {0.0: (x, hold)}, [(-1.0, hold)], hold, [], hold
    for k in range(ticks + 1):
        seen, acting = history[max(round(k - earlier, 9), 0.0)]  # and the command that acted until then
        y = aw_measurement(np.concatenate([seen, limited_drive(model, seen[n:], acting).current]), applied(x, u), n)
        r = reference[k]
        asked, s = law.step(k * PERIOD, r, y, s) if hasattr(law, "step") else (law(k * PERIOD, r, y), None)
        last, kept = command_filter.filtered(PERIOD, asked, kept)
        arrivals.append((k + behind, last))

        def now(at):
            return [u for a, u in arrivals if a <= at + 1e-9][-1]

        u = now(k)
        rows.append(np.concatenate([x, y.q, y.qd, last, u]))
        inside = {a for a, _ in arrivals if k < a < k + 1} | {k + 1 - earlier % 1.0} | {k + 1.0}
        edges = sorted({round(e, 9) for e in inside if e > k})
        begin = float(k)
        for end in edges:
            u = now(begin)
            for _ in range(substeps):
                f = lambda x, u: plant_derivative(model, x, u)  # noqa: E731
                x = rk3_step(f, x, u, (end - begin) * PERIOD / substeps)
            history[end], begin = (x, u), end
    return np.array(rows)


def aw_measurement(y, applied, n):
    return Measurement(y[:n], y[n : 2 * n], y[2 * n :], applied)


def references(model, ticks):
    rows = reference_rows(model, swing, np.arange(ticks + 1) * PERIOD)
    return [reference_of(motion_layout(model), row) for row in rows]


CASES = {
    "ideal": {},
    "one-tick": {"timing": Timing("one-tick")},
    "half a tick": {"timing": Timing(command_delay=0.5 * PERIOD)},
    "one and a half ticks": {"timing": Timing(command_delay=1.5 * PERIOD)},
    "an old measurement": {"timing": Timing(measurement_delay=2 * PERIOD)},
    "sampled between ticks": {"timing": Timing(measurement_delay=1.25 * PERIOD)},
    "both": {"timing": Timing("one-tick", measurement_delay=0.75 * PERIOD, command_delay=1.25 * PERIOD)},
    "shaped": {"command_filter": CommandFilter(limit=30.0, rate=5e3, resolution=0.25)},
    "coarse": {"command_filter": CommandFilter(limit=30.0, rate=100.0, resolution=7.0), "timing": Timing("one-tick")},
    "substeps": {"substeps": 3, "timing": Timing(command_delay=0.25 * PERIOD)},
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("law", [pd, Integral()], ids=["pd", "integral"])
@pytest.mark.sample(1)
def test_the_loop_is_what_its_account_says(case, law):
    model, ticks = arm("cmu-dd"), 25
    expected = accounted(model, law, references(model, ticks), ticks, **CASES[case])
    scenario = scenario_of(
        model, controller=law, reference=swing, period=PERIOD, duration=ticks * PERIOD, **CASES[case]
    )
    run = aw.simulate(scenario)
    assert run.attrs["controller"] == "compiled"
    names = ("q", "qd", "q_measured", "qd_measured", "u_issued", "u")
    found = np.concatenate([run[name].values for name in names], axis=1)
    scale = np.abs(expected).max(axis=0).clip(1.0)
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-9)


def test_a_delay_of_one_and_a_half_periods_switches_in_the_middle_of_one():
    """A motor alone, whose speed bends where the voltage changes."""
    model, ticks = arm("cmu-dd"), 6
    late = Scenario(
        model,
        duration=ticks * PERIOD,
        loop=Loop(
            controller=lambda t, r, y: scalar.array(
                [30.0 * scalar.where(scalar.less(t, PERIOD), 0.0, 1.0)] + [0.0] * 5
            ),
            period=PERIOD,
            timing=Timing(command_delay=1.5 * PERIOD),
            initial_command=np.zeros(6),
        ),
        solver=Solver(substeps=4),
    )
    run = aw.simulate(late)
    plain = aw.Schedule(np.array([0.0, 2.5 * PERIOD]), np.array([[0.0] * 6, [30.0] + [0.0] * 5]), tuple(model.names))
    exact = aw.simulate(
        aw.Scenario(
            model,
            command=plain,
            duration=ticks * PERIOD,
            solver=aw.Solver(step=PERIOD / 40),
            recording=aw.Recording(every=40),
        )
    )
    np.testing.assert_allclose(run.q.values, exact.q.values, atol=1e-8)
    assert run.qd.values[2, 0] == pytest.approx(exact.qd.values[2, 0], abs=1e-7)
    assert abs(run.qd.values[3, 0]) > 1e-3


@pytest.mark.study
def test_what_cannot_be_traced_runs_in_python_and_says_so():
    def stubborn(t, r, y):
        return np.asarray(pd(t, r, y), dtype=float)

    model = arm("cmu-dd")
    common = {"reference": swing, "period": PERIOD, "duration": 20 * PERIOD}
    timing = Timing("one-tick", measurement_delay=0.5 * PERIOD)
    compiled = aw.simulate(scenario_of(model, controller=pd, timing=timing, **common))
    called = aw.simulate(scenario_of(model, controller=stubborn, timing=timing, **common))
    assert called.attrs["controller"].startswith("called in Python once a tick")
    np.testing.assert_allclose(called.q.values, compiled.q.values, atol=1e-12)
    q0 = aw.Batch(np.random.default_rng(0).uniform(-0.2, 0.2, (21, 6)))
    many = [aw.simulate(scenario_of(model, controller=c, q0=q0, **common)) for c in (pd, stubborn)]
    np.testing.assert_allclose(many[0].q.values, many[1].q.values, atol=1e-12)


@pytest.mark.study
def test_a_lane_has_the_same_bits_wherever_it_stands():
    model = arm("cmu-dd")
    q0 = np.random.default_rng(0).uniform(-0.2, 0.2, (40, 6))
    sensors = Sensors(counts=4096, velocity="filtered", cutoff_hz=40.0, position_noise=1e-5)
    delays = np.linspace(0.0, 3 * PERIOD, 40)
    timing = Timing(command_delay=aw.Batch(delays), jitter=0.4 * PERIOD, command_loss=0.1)
    common = {"controller": Integral(), "sensors": sensors, "period": PERIOD, "duration": 30 * PERIOD, "seed": 3}
    whole = scenario_of(model, q0=aw.Batch(q0), timing=timing, **common)
    run = aw.simulate(whole, threads=1)
    again = aw.simulate(whole, threads=2)
    np.testing.assert_array_equal(run.q.values, again.q.values)
    few = replace(timing, command_delay=aw.Batch(delays[:7]))
    first = scenario_of(model, q0=aw.Batch(q0[:7]), timing=few, **common)
    narrow = with_fields(first, target="x86-64-v3")
    wide = with_fields(whole, target="x86-64-v3")
    np.testing.assert_array_equal(aw.simulate(wide).q.values, run.q.values)
    np.testing.assert_array_equal(aw.simulate(narrow).q.values, run.q.values[:7])


@dataclass(frozen=True, eq=False)
class Gains:
    kp: np.ndarray | aw.Batch = field(default_factory=lambda: KP)

    def init(self, arm, y):
        return scalar.zeros(0)

    def step(self, t, r, y, s):
        return self.kp * (r.q - y.q) - KD * y.qd, s


@pytest.mark.study
def test_gains_and_parameters_may_be_batches():
    model = arm("cmu-dd")
    gains = KP * np.array([[0.5], [1.0], [2.0]])
    masses = np.array([1.0, 1.5, 2.0])
    common = {"reference": np.full(6, 0.1), "period": PERIOD, "duration": 20 * PERIOD}
    varied = {"link6.mass_kg": aw.Batch(masses)}
    many = aw.simulate(scenario_of(model, controller=Gains(aw.Batch(gains)), vary=varied, **common))
    for lane in range(3):
        one = aw.simulate(
            scenario_of(model, controller=Gains(gains[lane]), vary={"link6.mass_kg": masses[lane]}, **common)
        )
        np.testing.assert_allclose(many.q.values[lane], one.q.values, atol=1e-10)


def test_hidden_state_is_found():
    memory = {"last": 0.0}

    def forgets(t, r, y):
        memory["last"] = memory["last"] + 1.0
        return memory["last"] * (r.q - y.q)

    with pytest.raises(ScenarioError, match="hidden state"):
        aw.simulate(Scenario(arm("cmu-dd"), duration=4 * PERIOD, loop=Loop(controller=forgets, period=PERIOD)))


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (lambda t, r, y: r.q[:3], r"returned u of shape \(3,\); .*\(6,\)"),
        (lambda t, r, y: 1.0, r"returned u of shape \(\); .*\(6,\)"),
    ],
)
def test_wrong_shapes_are_refused(law, said):
    with pytest.raises(ScenarioError, match=said):
        aw.simulate(Scenario(arm("cmu-dd"), duration=4 * PERIOD, loop=Loop(controller=law, period=PERIOD)))


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"substeps": 0}, "substeps = 0"),
        ({"duration": 2.5 * PERIOD}, r"duration = 0\.005"),
        ({"duration": None}, "when to stop"),
        ({"step": 1e-3, "period": 3e-3}, r"solver\.step = 0\.001"),
        ({"command": np.zeros(6)}, "loop: beside a command"),
        ({"vary": {"link6.mas_kg": 1.0}}, "vary = 'link6.mas_kg': no such"),
        (
            {"timing": Timing(command_delay=aw.Batch([0.0, 1e-3])), "q0": aw.Batch(np.zeros((3, 6)))},
            r"start\.q: 3 lanes; .*2, as loop\.timing\.command_delay has",
        ),
        ({"initial_command": np.zeros(5)}, "initial_command"),
        ({"reference": np.zeros(5)}, r"loop\.reference: shape \(5,\)"),
    ],
)
def test_scenarios_that_do_not_fit_are_refused(fields, said):
    common = {"controller": pd, "period": PERIOD, "duration": 10 * PERIOD}
    with pytest.raises(aw.ArmwrightError, match=said):
        aw.simulate(scenario_of(arm("cmu-dd"), **(common | fields)))


def test_a_reference_that_jumps_or_leaves_the_limits_is_told():
    model = arm("puma560")
    jumps = aw.Schedule(np.array([0.0, 10 * PERIOD]), np.array([[0.0] * 6, [9.0] + [0.0] * 5]), tuple(model.names))
    law = lambda t, r, y: 0.0 * y.q  # noqa: E731
    notes = aw.simulate(
        Scenario(
            model, duration=20 * PERIOD, start=np.zeros(6), loop=Loop(controller=law, reference=jumps, period=PERIOD)
        )
    ).attrs["notes"]
    assert "waist: the reference leaves its position limits" in str(notes)
    assert "waist: the reference jumps by 9" in str(notes)


@pytest.mark.parametrize(
    ("start", "goal", "q", "noted"),
    [
        ([0.0, 0.4], [1.0, 0.5], None, True),
        ([0.0, 0.4], [1.0, 0.5], [0.0, 0.4], False),
        ([0.0, 0.4], [1.0, 0.5], [0.0, 0.0], False),  # stated, so it is meant
        ([0.0, 0.0], [1.0, 0.5], None, False),
        ([0.0, 0.4], [0.0, 0.4], None, False),  # a pose: a step that was asked for
    ],
)
def test_an_arm_that_starts_beside_its_reference_is_told_where_nobody_said_so(start, goal, q, noted):
    law = aw.JointPID(kp=10.0, kd=2.0)
    loop = Loop(controller=law, reference=aw.trajectories.Quintic(start=start, goal=goal, duration=0.05), period=PERIOD)
    notes = aw.simulate(Scenario(arm("two-link"), duration=20 * PERIOD, start=q, loop=loop)).attrs["notes"]
    says = "elbow: the reference begins at 0.4 and the arm at 0, since no start is stated; start q = [0, 0.4] begins on"
    assert (says in str(notes)) is noted


class Table:
    """A controller whose state is no array, as one that calls a library may have."""

    def init(self, arm, y):
        return {"called": 0, "first": float(np.asarray(y.q).flat[0])}

    def step(self, t, r, y, s):
        return pd(t, r, y), s | {"called": s["called"] + 1}


def test_a_state_of_any_kind_is_kept_where_the_controller_runs_in_python():
    common = {"reference": swing, "period": PERIOD, "duration": 10 * PERIOD}
    run = aw.simulate(scenario_of(arm("cmu-dd"), controller=Table(), **common))
    assert run.attrs["controller"].startswith("called in Python")
    plain = aw.simulate(scenario_of(arm("cmu-dd"), controller=pd, **common))
    np.testing.assert_allclose(run.q.values, plain.q.values, atol=1e-12)
