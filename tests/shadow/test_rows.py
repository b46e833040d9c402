"""Values that cannot be do not blind a shadow: they are reported, bridged or a gap, and it judges again."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import armwright as aw
from armwright.shadow.observer import MomentumObserver
from identification.arm.simulated_log import motion

RATE = 500.0
JUNK = (np.nan, np.inf, -np.inf, 1e30, -1e30, 1e12, 1e308)


def rows_of(arm, seconds=3.0):
    """t, q, tau of the right arm; 30 N m act on its second joint from 2.2 s on."""
    t, q, qd, qdd = motion(arm.n, seconds, RATE, seed=2)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    tau[t > 2.2, 1] -= 30.0
    return t, q.copy(), tau


def shadowed(arm, t, q, tau, qd=None, parts=None):
    shadow = aw.shadow.ArmShadow(arm, deviation=0.5)
    for part in [slice(None)] if parts is None else parts:
        shadow.update(t[part], q[part], tau[part], None if qd is None else qd[part])
    return shadow


@pytest.fixture(scope="module")
def arm():
    return aw.load("puma560")


@pytest.mark.sample(1)
@pytest.mark.parametrize("signal", ["q", "tau", "qd", "t"])
def test_a_value_that_cannot_be_is_reported_and_bridged(arm, signal):
    """Its row is without a residual; all others have the ones of the run without the fault; the contact is noticed."""
    t, q, tau = rows_of(arm)
    qd = np.gradient(q, t, axis=0) if signal == "qd" else None
    right = shadowed(arm, t, q, tau, qd)
    values = {"q": q, "tau": tau, "qd": qd, "t": t[:, None].copy()}
    at = 200 + 77 * np.arange(len(JUNK))
    values[signal][at, min(1, values[signal].shape[1] - 1)] = JUNK
    shadow = shadowed(arm, values["t"][:, 0], values["q"], values["tau"], values["qd"])
    assert sum(event.rows for event in shadow.events) == len(JUNK)
    assert {(event.signal, event.joint) for event in shadow.events} == {
        (signal, None if signal == "t" else arm.names[1])
    }
    assert shadow.events[0].t == pytest.approx(t[200], abs=3e-3)
    assert shadow.last is not None
    assert right.last is not None
    assert np.flatnonzero(np.isnan(shadow.last.torque).any(axis=1)).tolist() == [*range(60), *at]
    assert np.nanmax(np.abs(shadow.last.torque - right.last.torque)) < 0.5
    assert [alarm.t for alarm in shadow.alarms] == pytest.approx([alarm.t for alarm in right.alarms], abs=4e-3)
    assert len(shadow.alarms) == 1
    assert shadow.judged.unjudged == pytest.approx(len(JUNK) / 1440, rel=0.1)


def test_huge_values_that_can_be_are_alarms_and_are_over(arm):
    """20 times the greatest torque for one row is left out; 9 times is believed, and forgotten soon after it."""
    t, q, tau = rows_of(arm)
    most = np.array([body.limits.torque for body in arm.coordinates])
    for share, rows in ((20.0, 1), (9.0, 0)):
        spoilt = tau.copy()
        spoilt[600, 1] = share * (most[1] if np.isfinite(most[1]) else 1e5)
        shadow = shadowed(arm, t, q, spoilt)
        assert sum(event.rows for event in shadow.events) == rows
        assert shadow.last is not None
        assert np.isfinite(shadow.last.torque[900:]).all()
        assert 2.2 < shadow.alarms[-1].t < 2.4
        assert np.abs(shadow.last.torque[1050]).max() < 1.0


@pytest.mark.sample(1)
@pytest.mark.parametrize("count", [3, 40, 500])
def test_long_runs_of_nan_are_a_gap(arm, count):
    """In one joint only: nothing is known meanwhile, and a settling time after them all joints are judged again."""
    t, q, tau = rows_of(arm)
    tau[400 : 400 + count, 4] = np.nan
    shadow = shadowed(arm, t, q, tau)
    (event,) = shadow.events
    assert (event.signal, event.joint, event.rows) == ("tau", arm.names[4], count)
    assert shadow.last is not None
    lost = np.isnan(shadow.last.torque).any(axis=1)
    bridged = count < 5
    assert lost[400 : 400 + count].all()
    assert not lost[400 + count + (0 if bridged else 61) :].any()
    assert len(shadow.alarms) == 1
    assert shadow.judged.unjudged == pytest.approx((count + (0 if bridged else 60)) / 1440, rel=0.05)


def test_a_joint_that_is_never_heard_again_is_no_clean_verdict(arm):
    t, q, tau = rows_of(arm, 2.0)
    tau[700:, 4] = np.nan
    shadow = shadowed(arm, t, q, tau)
    assert not shadow.alarms
    assert not shadow.verdict.clean
    assert shadow.verdict.lines[0].startswith("no verdict")
    assert "not judged: all joints 31.9 % of the time" in shadow.verdict.lines


def test_clocks_that_leap_or_are_set_back(arm):
    """A stamp by itself is left out; a second one after it is the new time, from which the filter starts again."""
    t, q, tau = rows_of(arm)
    for change in (1e30, 3600.0, -3600.0, -0.7):
        times = t.copy()
        times[700:] += change
        shadow = shadowed(arm, times, q, tau)
        assert shadow.last is not None
        finite = np.isfinite(shadow.last.torque).all(axis=1)
        if change == 1e30:  # all stamps are one number: no row follows another
            assert not finite[700:].any()
            assert not shadow.verdict.clean
            continue
        assert finite[765:].all()
        assert sum(event.rows for event in shadow.events) == 1
        assert len(shadow.alarms) == 1
    times = t.copy()
    times[[300, 301, 800]] = times[[299, 300, 799]]  # rows that come twice
    shadow = shadowed(arm, times, q, tau)
    assert shadow.last is not None
    assert np.isfinite(shadow.last.torque[60:]).all(axis=1).sum() >= len(t) - 63 - 60
    assert len(shadow.alarms) == 1


def test_another_rate_and_rows_that_almost_coincide_are_no_lasting_gap(arm):
    """Two rows 1 µs apart, and rows that come ten times as slowly from 1 s on."""
    t, q, tau = rows_of(arm, 6.0)
    keep = np.r_[0:500, 500 : len(t) : 10]
    times = t[keep].copy()
    times[200] = times[199] + 1e-6
    shadow = shadowed(arm, times, q[keep], tau[keep])
    assert not shadow.events
    assert shadow.last is not None
    finite = np.isfinite(shadow.last.torque).all(axis=1)
    assert finite[60:500].all()
    assert finite[530:].all()


def test_a_residual_that_is_not_finite_starts_the_observer_again(arm):
    """A mass matrix that is NaN for a moment."""
    t, q, tau = rows_of(arm)
    shadow = aw.shadow.ArmShadow(arm, deviation=0.5)
    model = shadow.observer._models[0]

    class Broken:
        def __getattr__(self, name):
            return getattr(model, name)

        def mass_matrix(self, q):
            found = model.mass_matrix(q).copy()
            found[np.abs(q[:, 0] - at) < 1e-12] = np.nan
            return found

    at = shadow.observer.update(t[:601], q[:601], tau[:601]) and shadow.observer._filter._x[0, 0, 0]
    shadow.restart()
    shadow.observer._models[0] = Broken()  # pyright: ignore[reportArgumentType]
    shadow.update(t, q, tau)
    (event,) = [each for each in shadow.events if each.signal == "residual"]
    assert "the observer started again" in str(event)
    assert shadow.last is not None
    assert np.isnan(shadow.last.torque[600]).all()
    assert np.isfinite(shadow.last.torque[605:]).all()
    assert len(shadow.alarms) == 1


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", range(2))
def test_junk_anywhere_gives_the_same_row_by_row_and_never_silence(arm, seed):
    """Random faults in positions, torques and times: equal residuals, events and alarms for any blocks; judged after the last."""
    rng = np.random.default_rng(seed)
    t, q, tau = rows_of(arm)
    for values in (q, tau):
        for _ in range(12):
            row, joint, length = rng.integers(0, 900), rng.integers(arm.n), int(rng.choice([1, 1, 3, 30]))
            values[row : row + length, joint] = rng.choice(JUNK)
    t[rng.integers(0, 900, 5)] = rng.choice([*JUNK, 0.0, -5.0], 5)
    once = shadowed(arm, t, q, tau)
    cuts = [0, *sorted(rng.integers(0, len(t), 5)), len(t)]
    blocks = shadowed(arm, t, q, tau, parts=[slice(a, b) for a, b in pairwise(cuts)])
    singles = shadowed(arm, t, q, tau, parts=[slice(k, k + 1) for k in range(len(t))])
    for other in (blocks, singles):
        assert [str(each) for each in other.alarms] == [str(each) for each in once.alarms]
        assert [str(each) for each in other.events] == [str(each) for each in once.events]
        np.testing.assert_allclose(other.judged.unjudged, once.judged.unjudged, rtol=1e-9)
    assert once.last is not None
    assert np.isfinite(once.last.torque[1010:]).all()
    assert 2.2 < once.alarms[-1].t < 2.4


def test_events_of_one_fault_are_one(arm):
    """Every other row of 3 s: one event, of all its rows."""
    t, q, tau = rows_of(arm)
    tau[100::2, 0] = np.nan
    shadow = shadowed(arm, t, q, tau)
    (event,) = shadow.events
    assert event.rows == 700
    assert str(event) == f"0.200 s to 2.996 s: tau of {arm.names[0]} = nan: 700 rows left out"
    assert len(shadow.alarms) == 1
    assert "no alarm" not in shadow.verdict.lines


def test_what_cannot_be_by_the_record():
    """Ten times torque, speed and half range, the middle of which counts."""
    arm = aw.load("lwa4p")
    observer = MomentumObserver(arm)
    body = arm.coordinates[0]
    low, high = body.limits.position
    q, tau = np.zeros((40, 6)), np.zeros((40, 6))
    t = 4e-3 * np.arange(40)
    tau[10, 0] = 10.1 * body.limits.torque
    tau[15, 0] = 9.9 * body.limits.torque
    q[20, 0] = 0.5 * (low + high) + 10.1 * 0.5 * (high - low)
    q[30, 0] = 11.0 * body.limits.velocity * 4e-3
    observer.update(t, q, tau)
    assert [(each.signal, round(each.t / 4e-3), each.rows) for each in observer.events] == [
        ("tau", 10, 1),
        ("q", 20, 2),
    ]
    assert f"tau of {body.joint} = {tau[10, 0]:.4g}, not within" in str(observer.events[0])
