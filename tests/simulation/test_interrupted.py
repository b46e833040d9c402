"""Ctrl-C ends a run and keeps what was finished: lanes of a run of many groups, time of a run of one."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import Interrupted
from physics.arms import arm

PERIOD = 1e-3


def stopping_at(share):
    def progress(done, total):
        if done >= share * total:
            raise KeyboardInterrupt

    return progress


def scenarios(lanes, duration):
    model = arm("two-link")
    q0 = np.random.default_rng(1).uniform(-0.2, 0.2, (lanes or 1, 2))
    q0 = aw.Batch(q0) if lanes else q0[0]
    controlled = aw.Scenario(
        model, duration=duration, start=q0,
        loop=aw.Loop(controller=lambda t, r, y: 20.0 * (r.q - y.q) - 5.0 * y.qd, reference=np.zeros(2), period=PERIOD),
        recording=aw.Recording(every=100, reduce=["rms_error"]),
    )  # fmt: skip
    driven = aw.Scenario(
        model,
        command=np.zeros(2),
        duration=duration,
        start=q0,
        solver=aw.Solver(step=PERIOD),
        recording=aw.Recording(every=100),
    )
    return [controlled, driven]


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", [0, 1], ids=["controlled", "driven"])
@pytest.mark.parametrize("threads", [1, 2])
def test_finished_lanes_are_kept(which, threads):
    scenario = scenarios(4000, 4.0)[which]
    whole = aw.simulate(scenario)
    with pytest.raises(Interrupted, match=r"\d+ of 4000 lanes") as stop:
        aw.simulate(scenario, threads=threads, progress=stopping_at(0.3))
    run = stop.value.run
    lanes = run.lane.values
    assert 0 < len(lanes) < 4000
    np.testing.assert_array_equal(run.q.values, whole.q.values[lanes])
    assert "stopped by Ctrl-C" in run.attrs["notes"]
    assert "made_with" in run.attrs
    if which == 0:
        np.testing.assert_array_equal(run.rms_error.values, whole.rms_error.values[lanes])
        np.testing.assert_array_equal(run.u.values, whole.u.values[lanes])


@pytest.mark.parametrize("which", [0, 1], ids=["controlled", "driven"])
@pytest.mark.parametrize("lanes", [None, 5])
def test_a_run_of_one_group_keeps_its_time(which, lanes):
    scenario = scenarios(lanes, 20.0)[which]
    whole = aw.simulate(scenario)
    with pytest.raises(Interrupted, match=r"\d+ of 20000 ticks") as stop:
        aw.simulate(scenario, progress=stopping_at(0.004))
    run = stop.value.run
    count = run.sizes["time"]
    assert 0 < count < whole.sizes["time"]
    np.testing.assert_array_equal(run.q.values, whole.q.isel(time=slice(count)).values)
    assert "rms_error" not in run


def test_before_anything_is_finished_it_is_a_plain_interrupt():
    with pytest.raises(KeyboardInterrupt) as stop:
        aw.simulate(scenarios(4000, 0.2)[0], progress=stopping_at(0.0), threads=1)
    assert stop.type in (KeyboardInterrupt, Interrupted)


class Integrates:
    """PI whose integrator is in a dictionary: called in Python, which remembers for it."""

    def init(self, arm, y):
        return {"i": np.zeros(arm.n)}

    def step(self, t, r, y, s):
        i = s["i"] + 0.1 * (np.asarray(r.q, float) - y.q)
        return 20.0 * (r.q - y.q) + i, {"i": i}


@pytest.mark.sample(1)
@pytest.mark.parametrize("stepped", [0, 7])
@pytest.mark.parametrize("lanes", [None, 600])
def test_a_simulation_stays_where_it_was(lanes, stepped):
    """After Ctrl-C, and where the state at the end is not kept, it runs again to the last bit; a measurement is taken once."""
    model = arm("two-link")
    q0 = np.random.default_rng(2).uniform(-0.2, 0.2, (lanes or 1, 2))
    scenario = aw.Scenario(
        model, duration=20 * PERIOD, start=aw.Batch(q0) if lanes else q0[0],
        loop=aw.Loop(controller=Integrates(), reference=np.zeros(2), period=PERIOD,
            sensors=aw.Sensors(velocity="difference", position_noise=1e-3)),
    )  # fmt: skip
    whole = aw.simulate(scenario)
    simulation = aw.simulation.Simulation(scenario)
    for _ in range(stepped):
        simulation.step()
    _ = simulation.measurement
    left = (20 - stepped) * PERIOD
    with pytest.raises(KeyboardInterrupt):
        simulation.run(left, progress=stopping_at(0.0))
    assert simulation.tick == stepped
    for keep_state in (False, True):
        run = simulation.run(left, keep_state=keep_state)
        for name in ("q", "qd_measured", "u"):
            np.testing.assert_array_equal(run[name].values, whole[name].values[..., stepped:, :])
    assert simulation.tick == 20
