"""Reducers equal the same numbers worked out from a recorded run; a hundred thousand lanes stay small."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import RunError, ScenarioError
from armwright.results.reducers import REDUCERS
from physics.arms import arm
from simulation.fields import scenario_of

PERIOD = 2e-3
ALL = [name for name in REDUCERS if name != "peak_temperature"]


def scenario(**fields):
    goal = np.array([0.5, 0.0, -0.2, 0.1, 0.2, 0.3])
    q0 = np.random.default_rng(0).uniform(-0.2, 0.2, (19, 6))
    law = aw.JointPID(kp=[400.0, 900, 300, 150, 30, 20], kd=[40.0, 60, 30, 8, 2, 1], gravity=True)
    common = {"q0": aw.Batch(q0), "reference": goal, "period": PERIOD, "duration": 1.0, "controller": law}
    return scenario_of(arm("cmu-dd"), **(common | fields))


def recorded(run, band):
    """Expected values of the reducers, from the rows of a run (lane, row, joint)."""
    q, r = run.q.values, run.q_reference.values
    error, final, first = q - r, r[:, -1], q[:, 0]
    step = np.abs(final - first)
    applied, u = run.voltage.values, run.u.values
    clipped = np.abs(applied - u) > 1e-9 * np.maximum(np.abs(applied), np.abs(u))
    rows = np.arange(q.shape[1])[None, :, None]
    outside = np.abs(q - final[:, None]) > band * step[:, None]
    last = np.where(outside, rows, -1).max(axis=1)
    return {
        "rms_error": np.sqrt(np.mean(error**2, axis=1)),
        "peak_error": np.abs(error).max(axis=1),
        "peak_voltage": np.abs(run.voltage.values).max(axis=1),
        "peak_current": np.abs(run.current.values).max(axis=1),
        "peak_torque": np.abs(run.tau.values).max(axis=1),
        "energy": PERIOD * (run.voltage.values * run.current.values)[:, :-1].sum(axis=1),
        "saturation": clipped.mean(axis=1),
        "settling_time": np.where(last < q.shape[1] - 1, (last + 1.0) * PERIOD, np.nan),
        "overshoot": ((q - final[:, None]) * np.sign(final - first)[:, None]).max(axis=1).clip(0.0) / step,
    }


@pytest.mark.sample(1)
@pytest.mark.parametrize("band", [0.02, 0.1])
def test_they_are_what_the_recorded_run_says(band):
    settling = f"settling_time:band={band}" if band != 0.02 else "settling_time"
    names = [settling if name == "settling_time" else name for name in ALL]
    run = aw.simulate(scenario(reduce=names))
    expected = recorded(run, band)
    for name in names:
        found = run[name].values
        np.testing.assert_allclose(found, expected[name.partition(":")[0]], rtol=1e-12, atol=1e-12, err_msg=name)
        assert run[name].dims == ("lane", "joint")
    assert np.isfinite(run[settling].values).any()
    assert (run.saturation.values > 0).any()
    assert (run.overshoot.values > 0).any()


def test_without_a_record_they_are_the_same():
    whole = aw.simulate(scenario(reduce=ALL))
    alone = aw.simulate(scenario(reduce=ALL, what="none"))
    assert "time" not in alone.coords
    assert set(alone.data_vars) == {*ALL, "diverged_at"}
    for name in ALL:
        np.testing.assert_array_equal(alone[name].values, whole[name].values)
    single = aw.simulate(scenario(reduce=ALL, what="none", q0=scenario().start.q.values[3]))
    np.testing.assert_allclose(single.rms_error.values, whole.rms_error.values[3], rtol=1e-12)
    assert single.rms_error.dims == ("joint",)
    assert single.rms_error.attrs["units"] == "rad"


@pytest.mark.study
def test_commands_over_time_are_followed_too():
    """Lanes of a schedule, from their own beginnings, or from a reference: what the recorded rows say."""
    base = scenario()
    rows = aw.Schedule(
        np.array([0.0, 0.1, 0.3505]), np.random.default_rng(1).uniform(-4, 4, (3, 6)), tuple(base.arm.names)
    )
    common = {"controller": None, "command": rows, "period": None, "step": PERIOD, "reduce": ALL, "q0": base.start.q}
    for reference in (base.reference, None):
        run = aw.simulate(scenario(**common, reference=reference))
        goal = base.start.q.values if reference is None else np.broadcast_to(reference, base.start.q.values.shape)
        with_goal = run.assign(q_reference=run.q * 0 + goal[:, None, :])
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = recorded(with_goal, 0.02)
        moves = np.ones_like(goal, dtype=bool) if reference is not None else np.zeros_like(goal, dtype=bool)
        for name in ALL:
            wanted = (
                np.where(moves, expected[name], np.nan) if name in ("settling_time", "overshoot") else expected[name]
            )
            np.testing.assert_allclose(run[name].values, wanted, rtol=1e-12, atol=1e-12, err_msg=name)
        alone = aw.simulate(scenario(**common, reference=reference, what="none"))
        for name in ALL:
            np.testing.assert_array_equal(alone[name].values, run[name].values)
    plain = aw.simulate(scenario(**common | {"reduce": ()}, reference=None))
    np.testing.assert_array_equal(plain.q.values, run.q.values)


@pytest.mark.study
def test_a_lane_is_followed_from_where_it_began():
    """Without a reference every lane is to stay where it began, whoever stands beside it."""
    law = aw.JointPID(kp=100.0, kd=10.0)
    many = aw.simulate(scenario(controller=law, reference=None, reduce=["peak_error"]))
    np.testing.assert_array_equal(many.q_reference.values[:, -1], many.q.values[:, 0])
    for lane in (0, 3):
        one = aw.simulate(
            scenario(controller=law, reference=None, reduce=["peak_error"], q0=scenario().start.q.values[lane])
        )
        np.testing.assert_array_equal(one.q.values, many.q.values[lane])
        np.testing.assert_array_equal(one.peak_error.values, many.peak_error.values[lane])


def test_without_a_record_they_go_into_files(tmp_path):
    from armwright.results.plot import plot

    run = aw.simulate(scenario(reduce=["rms_error", "peak_voltage"], what="none", duration=0.1))
    aw.save(run, tmp_path / "run.nc")
    assert aw.load_run(tmp_path / "run.nc").rms_error.equals(run.rms_error)
    aw.save(run, tmp_path / "run.csv")
    header, *rows = (tmp_path / "run.csv").read_text().splitlines()
    assert header.startswith("lane,rms_error_joint1 [rad],")
    assert len(rows) == 19
    with pytest.raises(RunError, match="'time'"):
        plot(run, tmp_path / "run.png")


def test_the_highest_temperature_is_that_of_the_record():
    model = aw.load(Path(__file__).parents[2] / "examples" / "hot-lift.toml")
    law = aw.JointPID(kp=aw.Batch([80.0, 120.0]), kd=8.0, gravity=True)
    run = aw.simulate(
        aw.Scenario(
            model, duration=2.0, loop=aw.Loop(controller=law, reference=aw.trajectories.Sine([0.0], [0.6], 2.0), period=PERIOD),
            recording=aw.Recording(reduce=["peak_temperature", "energy"]),
        )
    )  # fmt: skip
    np.testing.assert_array_equal(run.peak_temperature.values, run.winding_temperature.values.max(axis=1))
    power = run.electrical_power.values
    np.testing.assert_allclose(run.energy.values, PERIOD * power[:, :-1].sum(axis=1), rtol=1e-12)
    assert (run.peak_temperature.values > 25.5).all()


@pytest.mark.study
def test_where_the_controller_runs_in_python_they_are_the_same():
    def law(t, r, y):
        return np.asarray(100.0 * (r.q - y.q) - 10.0 * y.qd, dtype=float)

    traced = aw.simulate(
        scenario(controller=lambda t, r, y: 100.0 * (r.q - y.q) - 10.0 * y.qd, reduce=ALL, duration=0.1)
    )
    called = aw.simulate(scenario(controller=law, reduce=ALL, what="none", duration=0.1))
    assert called.attrs["controller"].startswith("called in Python")
    for name in ALL:
        np.testing.assert_allclose(called[name].values, traced[name].values, rtol=1e-9, atol=1e-12, err_msg=name)


def test_a_lane_that_diverges_is_followed_until_then():
    gains = aw.Batch([20.0, 2e8])
    law = aw.ComputedTorque(kp=gains, kd=gains)
    run = aw.simulate(
        aw.Scenario(
            arm("two-link"), duration=2.0, loop=aw.Loop(controller=law, reference=[0.5, 0.5], period=1e-2),
            recording=aw.Recording(reduce=["rms_error", "peak_error", "settling_time"]), solver=aw.Solver("rk3"),
        )
    )  # fmt: skip
    assert np.isnan(run.diverged_at.values[0])
    assert np.isfinite(run.diverged_at.values[1])
    rows = round(float(run.diverged_at.values[1]) / 1e-2) + 1
    error = run.q.values[1, :rows] - 0.5
    np.testing.assert_allclose(run.rms_error.values[1], np.sqrt(np.mean(error**2, axis=0)), rtol=1e-12)
    assert np.isnan(run.settling_time.values[1]).all()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"reduce": ["rms_eror"]}, "reduce = 'rms_eror': unknown; .*rms_error?"),
        ({"reduce": "rms_error"}, "list of names"),
        ({"reduce": ["settling_time:band=2"]}, "a band between 0 and 1"),
        ({"reduce": ["overshoot:band=0.1"]}, "unknown"),
        ({"what": "none"}, r"recording\.what = 'none'"),
        ({"controller": None, "command": np.zeros(6)}, r"recording\.reference: goes with recording\.reduce"),
        ({"reduce": ["peak_temperature"]}, "no joint's"),
    ],
)  # fmt: skip
def test_reducers_that_do_not_fit_are_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        aw.simulate(scenario(**fields))


MANY = """
import resource, sys
import numpy as np
import armwright as aw
lanes = int(sys.argv[1])
arm = aw.load("two-link")
gains = aw.Batch(np.linspace(50.0, 150.0, lanes))
law = aw.JointPID(kp=gains, kd=20.0, gravity=True)
loop = aw.Loop(law, [0.3, 0.2], 2e-3, timing=aw.Timing("one-tick"))
recording = aw.Recording(what="none", reduce=["rms_error", "overshoot"])
run = aw.simulate(aw.Scenario(arm, 0.02, loop=loop, recording=recording))
assert run.rms_error.shape == (lanes, 2) and np.isfinite(run.rms_error.values).all()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.study
def test_a_hundred_thousand_lanes_need_little_memory():
    """Beside what a thousand need, no more than some arrays of a few numbers a lane."""
    pytest.importorskip("resource")
    few, many = (
        int(subprocess.run([sys.executable, "-c", MANY, str(n)], check=True, capture_output=True, text=True).stdout)
        for n in (1_000, 100_000)
    )
    unit = 1 if sys.platform == "darwin" else 1024
    assert (many - few) * unit < 500 * 100_000  # bytes; one row of two joints alone would be 112 a lane
