"""Cascades against a loop by hand: rates, phases, limits of every stage."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.control import Cascade
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.simulation.loop.controller import counters_of, traced_controller
from armwright.simulation.loop.state import LoopState
from armwright.simulation.loop_runner import LoopRunner
from physics.arms import arm
from simulation.fields import scenario_of

PERIOD = 5e-4
N = 6


@dataclass(frozen=True)
class ByHand:
    """The same loops, written out: position every 4th tick from the 2nd, speed every 2nd, current in each."""

    def init(self, arm, y):
        return scalar.array(np.concatenate([np.zeros(2 * N), y.current, np.zeros(N)]))

    def step(self, t, r, y, s):
        w, iw, i, ii = (s[k * N : (k + 1) * N] for k in range(4))
        k = scalar.round(t / PERIOD)
        outer = scalar.equal(scalar.fmod(k, 4.0), 1.0)
        middle = scalar.equal(scalar.fmod(k, 2.0), 0.0)
        wanted = scalar.clip(8.0 * (r.q - y.q) + 0.5 * r.qd, -0.4, 0.4)
        w = scalar.array([scalar.where(outer, a, b) for a, b in zip(wanted, w, strict=True)])
        asked = 6.0 * (w - y.qd) + iw
        cut = scalar.clip(asked, -3.0, 3.0)
        push = scalar.less(0.0, (asked - cut) * (w - y.qd))
        iw_next = iw + scalar.where(push, 0.0 * iw, 20.0 * (w - y.qd) * 2 * PERIOD)
        i = scalar.array([scalar.where(middle, a, b) for a, b in zip(cut, i, strict=True)])
        iw = scalar.array([scalar.where(middle, a, b) for a, b in zip(iw_next, iw, strict=True)])
        e = i - y.current
        u = 2.0 * e + ii
        return u, scalar.array(np.concatenate([w, iw, i, ii + 30.0 * e * PERIOD]))


@pytest.mark.study
def test_it_is_the_loop_by_hand():
    law = Cascade(
        position_kp=8.0, speed_feedforward=0.5, speed_limit=0.4, position_every=4, position_phase=1,
        speed_kp=6.0, speed_ki=20.0, effort_limit=3.0, speed_every=2, current_kp=2.0, current_ki=30.0,
    )  # fmt: skip
    common = {
        "reference": aw.trajectories.Quintic(np.zeros(6), np.full(6, 0.5), 0.15), "period": PERIOD, "duration": 0.3,
        "vary": {}, "initial_command": np.zeros(6),
    }  # fmt: skip
    model = arm("cmu-dd")
    ours = aw.simulate(scenario_of(model, controller=law, **common))
    by_hand = aw.simulate(scenario_of(model, controller=ByHand(), **common))
    assert ours.attrs["controller"] == "compiled"
    np.testing.assert_allclose(ours.q.values, by_hand.q.values, atol=1e-9)
    np.testing.assert_allclose(ours.u_issued.values, by_hand.u_issued.values, atol=1e-7)
    assert np.abs(ours.q.values[-1]).max() > 0.02


def test_loops_have_their_turn_at_their_ticks():
    """With constant measurements the speed that is asked for changes only in ticks of the position loop."""
    model = arm("two-link")
    law = Cascade(position_kp=1.0, speed_kp=1.0, position_every=3, position_phase=2).configure(model, PERIOD)
    y = Measurement(*np.zeros((4, 2)))
    s, found = law.init(model, y), []
    for k in range(9):
        u, s = law.step(k * PERIOD, JointReference(np.full(2, k + 1.0), np.zeros(2), np.zeros(2)), y, s)
        found.append(u[0])
    assert found == [0.0, 0.0, 3.0, 3.0, 3.0, 6.0, 6.0, 6.0, 9.0]


def test_turns_do_not_depend_on_the_time():
    """Each slower loop counts ticks by itself, in numbers that single precision holds; a loop of every tick counts nothing."""
    model = arm("two-link")
    law = Cascade(position_kp=1.0, speed_kp=1.0, position_every=4, position_phase=3, speed_every=2)
    sizes = (law.configure(model, PERIOD), Cascade(position_kp=1.0, speed_kp=1.0).configure(model, PERIOD))
    y, r = Measurement(*np.zeros((4, 2))), JointReference(*np.ones((3, 2)))
    s, plain = (each.init(model, y) for each in sizes)
    assert len(s) == len(plain) + 2
    counted = []
    for _ in range(8):
        counted.append(s[:2].tolist())
        _, s = sizes[0].step(np.nan, r, y, s)
    assert counted == [[3, 0], [2, 1], [1, 0], [0, 1]] * 2
    assert np.isfinite(s).all()


@pytest.mark.parametrize("tick", [2**32 - 40, 2**45, 3_600_000_000])
def test_a_run_goes_on_alike_however_late_it_is(tick):
    """Bits of the commands where only the number of the tick is another; 1,000 h at 1 kHz are the last one."""
    law = Cascade(position_kp=2.0, speed_kp=10.0, speed_ki=20.0, position_every=5, position_phase=3, speed_every=2)
    common = {"controller": law, "reference": [0.3, -0.2], "period": 1e-3, "duration": 0.107, "integrator": "rk3"}
    first = aw.simulate(scenario_of(arm("two-link"), **common))
    state = LoopState.of_run(first)
    assert state is not None
    common["duration"] = 0.1
    soon, late = (
        aw.simulate(scenario_of(arm("two-link"), **common, start=each)) for each in (state, replace(state, tick=tick))
    )
    np.testing.assert_array_equal(soon.u_issued.values, late.u_issued.values)
    assert np.ptp(soon.u_issued.values[:, 0]) > 0.1


def test_counters_are_found_in_the_program():
    model = arm("two-link")
    law = aw.Filtered(
        Cascade(position_kp=1.0, speed_kp=1.0, speed_ki=1.0, position_every=4, speed_every=2), [aw.LowPass(50.0)]
    )
    loop = LoopRunner(aw.Scenario(model, 0.1, loop=aw.Loop(law, reference=[0.1, 0.2], period=PERIOD)))
    sampling = loop.config.sampling
    assert sampling is not None
    program = traced_controller(sampling.controller, model, PERIOD, sampling.states)
    first = 2 + 2 * 2  # behind what the wrapper added last, and two numbers a joint of its filter
    assert counters_of(program) == [first, first + 1]


def test_every_stage_cuts_off_its_own_output():
    law = Cascade(
        position_kp=50.0, speed_limit=0.3, speed_kp=[40.0, 60, 20, 10, 1, 0.6], speed_ki=3.0, effort_limit=2.0,
        current_kp=0.2, current_ki=400.0, voltage_limit=6.0,
    )  # fmt: skip
    model = arm("cmu-dd")
    run = aw.simulate(
        aw.Scenario(
            model, duration=0.5,
            loop=aw.Loop(controller=law, reference=[1.0, 0.1, 0, 0, 0, 0], period=PERIOD, initial_command=np.zeros(6)),
        )
    )  # fmt: skip
    assert np.abs(run.u_issued.values).max() == 6.0
    assert np.abs(run.current.values).max() < 2.4
    assert np.abs(run.qd.values[:, 0]).max() < 0.33


def test_an_integrator_waits_while_the_stage_behind_it_is_cut_off():
    model, law = arm("cmu-dd"), Cascade(position_kp=1.0, speed_kp=1.0, speed_ki=5.0, current_kp=1.0, voltage_limit=0.5)
    law = law.configure(model, PERIOD)
    y = Measurement(*np.zeros((4, 6)))
    r = JointReference(np.full(6, 2.0), np.zeros(6), np.zeros(6))
    _, first = law.step(0.0, r, y, law.init(model, y))
    _, second = law.step(PERIOD, r, y, first)
    np.testing.assert_allclose(first[N : 2 * N], 5.0 * 2.0 * PERIOD)
    np.testing.assert_allclose(second[N : 2 * N], first[N : 2 * N])


@pytest.mark.study
def test_it_tracks_with_each_kind_of_drive():
    for name, speed_kp in (("two-link", [400.0, 100.0]), ("lwa4p", 20.0), ("cmu-dd", [400.0, 900, 300, 150, 40, 20])):
        model = arm(name)
        law = Cascade(position_kp=10.0, speed_kp=speed_kp, speed_ki=np.asarray(speed_kp) * 15.0, speed_feedforward=1.0)
        motion = aw.trajectories.Quintic(np.zeros(model.n), np.full(model.n, 0.2), 0.5)
        run = aw.simulate(
            aw.Scenario(
                model,
                duration=1.5,
                start=np.zeros(model.n),
                loop=aw.Loop(controller=law, reference=motion, period=PERIOD),
            )
        )
        np.testing.assert_allclose(run.q.values[-1], 0.2, atol=0.03, err_msg=name)


@pytest.mark.parametrize(
    ("name", "fields", "said"),
    [
        ("cmu-dd", {"position_every": 0}, "position_every = 0"),
        ("cmu-dd", {"position_every": 2**24}, "position_every = 16777216: expected a whole number"),
        ("cmu-dd", {"speed_every": 2, "speed_phase": 2}, "speed_phase = 2: .* speed_every - 1 = 1"),
        ("cmu-dd", {"voltage_limit": 3.0}, "voltage_limit = 3.0: .*current loop"),
        ("lwa4p", {"current_kp": 1.0}, "by current; .*voltage"),
        ("cmu-dd", {"effort_limit": [1.0, 2.0]}, r"Cascade.effort_limit: shape \(2,\)"),
    ],
)  # fmt: skip
def test_cascades_that_do_not_fit_are_refused(name, fields, said):
    with pytest.raises(ScenarioError, match=said):
        Cascade(position_kp=1.0, speed_kp=1.0, **fields).configure(arm(name), PERIOD)
