"""The stages of a simulation loop do in native code what they say in NumPy; a lane's bits do not depend on its neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from armwright import scalar
from armwright.kernels.llvm import LlvmModule
from armwright.kernels.loop import LoopArrays, NativeLoop, Schedules
from armwright.kernels.philox import philox, uniform
from armwright.kernels.stages import (
    NEVER,
    Adapt,
    Call,
    DelayStage,
    DrawStage,
    Integrate,
    RecordStage,
    RowsStage,
    TableStage,
)
from armwright.kernels.target import select_target
from armwright.program import trace

H = 0.01
LANES = 21  # no whole number of tiles on any processor


def heun(x, u, h):
    """A pendulum that u pushes."""

    def slope(x):
        return scalar.array([x[1], u[0] - scalar.sin(x[0])])

    k1 = slope(x)
    return x + 0.5 * h * (k1 + slope(x + h * k1))


STEP = trace("step", heun, {"x": (2,), "u": (1,), "h": ()}, ("x_next",))


def starts(lanes=LANES):
    return np.random.default_rng(0).normal(size=(lanes, 2))


def recorded(loop, lanes, ticks, entries, tables=None, schedules=None, **more):
    record = np.full((ticks + 1, lanes.tiles * lanes.width, entries), np.nan)
    arrays = LoopArrays(tables or {}, schedules or {}, {"run": record})
    loop.run(lanes, H, (0, ticks + 1), arrays, last=ticks, every=1, **more)
    return record[:, : lanes.count]


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [  # the authors' own test vectors [SalmonEtAl2011]
        ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_philox_gives_its_authors_numbers(counter, key, expected):
    assert philox(np.array(counter), np.array(key)).tolist() == expected


def test_uniform_numbers_are_uniform():
    from scipy.stats import kstest

    values = uniform(11, np.arange(20_000), tick=3, channel=2, entries=3)
    assert all(kstest(column, "uniform").pvalue > 1e-3 for column in values.T)
    assert np.abs(np.corrcoef(values.T) - np.eye(3)).max() < 0.02


@pytest.mark.parametrize("width", [1, 2, 8, 16])
def test_delay_and_draws_are_what_numpy_makes_of_them(width):
    from dataclasses import replace

    ticks, seed = 40, (3 << 32) + 5
    control = trace("control", lambda y_old, w: 0.1 * w[:1] - 0.5 * y_old, {"y_old": (1,), "w": (3,)}, ("u",))
    sense = trace("sense", lambda x: x[1:], {"x": (2,)}, ("y",))
    plan = (
        Call(sense),
        DelayStage("y", "y_old", "lag", entries=1, length=4),
        DrawStage("w", 3, channel=7),
        Call(control),
        RecordStage("run", ("x", "y", "y_old", "w", "u"), (2, 1, 1, 3, 1)),
        Integrate(STEP),
    )
    loop = NativeLoop(plan, replace(select_target("x86-64-v3"), width=width))
    lanes, lag = loop.lanes(LANES, first=1000), np.arange(LANES) % 4
    lanes.set("x", starts())
    lanes.set("lag", lag.reshape(-1, 1))
    lanes.fill_ring("y_old", starts()[:, 1:])
    found = recorded(loop, lanes, ticks, 8, seed=seed)
    x, history = starts(), []
    for k in range(ticks + 1):
        history.append(x[:, 1:])
        old = np.array([history[max(k - m, 0)][lane] for lane, m in enumerate(lag)])
        w = uniform(seed, 1000 + np.arange(LANES), k, 7, 3)
        u = 0.1 * w[:, :1] - 0.5 * old
        np.testing.assert_allclose(found[k], np.hstack([x, x[:, 1:], old, w, u]), atol=1e-12)
        np.testing.assert_array_equal(found[k][:, 4:7], w)
        x = np.array([heun(x[lane], u[lane], H) for lane in range(LANES)])


def test_a_table_is_read_row_by_row_and_memory_is_kept():
    count = trace("count", lambda r, m: m + r, {"r": (1,), "m": (1,)}, ("m_next",))
    loop = NativeLoop((TableStage("r", 1), Call(count), RecordStage("run", ("r", "m"), (1, 1))), select_target())
    table = np.arange(7.0).reshape(-1, 1) ** 2
    found = recorded(loop, loop.lanes(3), 6, 2, tables={"r": table})
    np.testing.assert_array_equal(found[:, 1, 0], table[:, 0])
    np.testing.assert_array_equal(found[:, 2, 1], np.cumsum(table[:, 0]))


def test_a_row_that_programs_read_in_place_is_no_block():
    count = trace("count", lambda r, m: m + r[0] * r[1], {"r": (2,), "m": (1,)}, ("m_next",))
    table = np.random.default_rng(0).normal(size=(7, 2))
    sums = []
    for spread in (True, False):
        loop = NativeLoop((TableStage("r", 2, spread=spread), Call(count)), select_target())
        lanes = loop.lanes(11)
        assert ("r" in lanes.blocks) == spread
        loop.run(lanes, 0.0, (1, 7), LoopArrays({"r": table}))
        sums.append(lanes.get("m"))
    np.testing.assert_array_equal(*sums)
    np.testing.assert_allclose(sums[0], table[1:].prod(axis=1).sum())


def segments(x, changes, substeps=1):
    """One tick of several held commands: (from, command) pairs in order of time."""
    edges = [*(t for t, _ in changes), H]
    for (begin, u), end in zip(changes, edges[1:], strict=True):
        for _ in range(substeps):
            x = heun(x, np.array([u]), (end - begin) / substeps)
    return x


@pytest.mark.parametrize("substeps", [1, 3])
def test_planned_commands_act_from_their_time_and_the_newest_wins(substeps):
    loop = NativeLoop((RecordStage("run", ("x",), (2,)), Integrate(STEP, planned=3)), select_target())
    lanes = loop.lanes(4)
    lanes.set("x", starts(4))
    lanes.set("u_plan", np.array([1.0, -2.0, 3.0]))
    begins = np.array([[0.004, 0.007], [0.006, 0.002], [NEVER, 0.005], [NEVER, 0.0]])  # the second: overtaken
    lanes.set("u_from", begins)
    found = recorded(loop, lanes, 1, 2, substeps=substeps)[1]
    changes = [
        [(0.0, 1.0), (0.004, -2.0), (0.007, 3.0)],
        [(0.0, 1.0), (0.002, 3.0), (0.006, 3.0)],
        [(0.0, 1.0), (0.005, 3.0)],
        [(0.0, 3.0)],
    ]
    expected = [segments(x, change, substeps) for x, change in zip(starts(4), changes, strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-15)


def test_the_state_at_a_time_within_the_tick_is_seen():
    loop = NativeLoop((RecordStage("run", ("x", "x_seen"), (2, 2)), Integrate(STEP, seen=("x",))), select_target())
    lanes = loop.lanes(3)
    lanes.set("x", starts(3))
    lanes.set("x_seen", starts(3))
    lanes.set("see_at", np.array([[0.25 * H], [H], [0.5 * H]]))
    lanes.set("u", np.ones(1))
    found = recorded(loop, lanes, 1, 4)[1]
    expected = [heun(x, np.ones(1), part * H) for x, part in zip(starts(3), (0.25, 1.0, 0.5), strict=True)]
    np.testing.assert_allclose(found[:, 2:], expected, atol=1e-15)
    np.testing.assert_array_equal(found[1, 2:], found[1, :2])


def test_the_command_at_a_time_within_the_tick_is_seen():
    """That of the segment which ends there: what acts from then on is not yet seen."""
    loop = NativeLoop(
        (RecordStage("run", ("u", "u_seen"), (1, 1)), Integrate(STEP, planned=3, seen=("x", "u"))), select_target()
    )
    lanes = loop.lanes(4)
    lanes.set("see_at", np.array([[0.002], [0.004], [0.005], [H]]))
    lanes.set("u_plan", np.array([1.0, -2.0, 3.0]))
    lanes.set("u_from", np.array([0.004, 0.007]))
    found = recorded(loop, lanes, 1, 2)[1]
    np.testing.assert_array_equal(found, [[3.0, 1.0], [3.0, 1.0], [3.0, -2.0], [3.0, 3.0]])


def test_schedules_land_between_ticks():
    loop = NativeLoop((RowsStage("u", 1), RecordStage("run", ("x", "u"), (2, 1)), Integrate(STEP)), select_target())
    lanes = loop.lanes(2)
    lanes.set("x", starts(2))
    times = (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.003, 0.0]))
    rows = Schedules(*times, np.array([[1.0], [2.0], [5.0]]), first=np.array([0, 2]), end=np.array([3, 3]))
    loop.begin_rows(lanes, "u", rows)
    found = recorded(loop, lanes, 2, 3, schedules={"u": rows})
    np.testing.assert_array_equal(found[:, :, 2], [[1.0, 0.0], [5.0, 5.0], [5.0, 5.0]])
    np.testing.assert_allclose(found[1, 0, :2], segments(starts(2)[0], [(0.0, 1.0), (0.003, 2.0)]), atol=1e-15)
    np.testing.assert_allclose(found[1, 1, :2], segments(starts(2)[1], [(0.0, 0.0)]), atol=1e-15)


def test_two_loops_take_turns_over_the_same_lanes():
    """As where something outside has its say in every tick."""
    first = NativeLoop((Call(trace("sense", lambda x: x[1:], {"x": (2,)}, ("y",))),), select_target())
    second = NativeLoop((Integrate(STEP),), select_target())
    lanes = first.lanes(3)
    second.extend(lanes)
    lanes.set("x", starts(3))
    x = starts(3)
    for k in range(5):
        first.run(lanes, H, (k, k + 1))
        u = -0.3 * lanes.get("y")
        np.testing.assert_allclose(u, -0.3 * x[:, 1:], atol=1e-14)
        lanes.set("u", u)
        second.run(lanes, H, (k, k + 1))
        x = np.array([heun(row, push, H) for row, push in zip(x, u, strict=True)])
    np.testing.assert_allclose(lanes.get("x"), x, atol=1e-14)


def test_a_lane_that_leaves_the_finite_numbers_is_frozen_and_the_others_go_on():
    step = trace("grow", lambda x, u, h: x * x + u * h, {"x": (1,), "u": (1,), "h": ()}, ("x_next",))
    loop = NativeLoop((RecordStage("run", ("x",), (1,)), Integrate(step)), select_target())
    lanes = loop.lanes(3)
    lanes.set("x", np.array([[0.5], [1e100], [3.0]]))
    found = recorded(loop, lanes, 12, 1)
    assert lanes.get("frozen")[:, 0].tolist() == [-1.0, 1.0, 9.0]
    assert found[-1, 1, 0] == 1e200
    assert found[-1, 0, 0] == 0.5**4096


def trial(x, u, h):
    """Two halves by Heun's rule, and how far they are from the whole."""
    whole, halves = heun(x, u, h), heun(heun(x, u, 0.5 * h), u, 0.5 * h)
    gap = (halves - whole) / 1e-6
    error = scalar.sqrt(gap[0] * gap[0] + gap[1] * gap[1])
    return halves, error, scalar.clip(0.9 / (error + 1e-3), 0.25, 3.0)


TRIAL = trace("trial", trial, {"x": (2,), "u": (1,), "h": ()}, ("x_next", "error", "grow"))


def adapted(x, changes, wanted, edges, most=1000):
    """The algorithm of `Adapt` for one lane and tick: state, next step, and number of trials."""
    t, rejected, tried = 0.0, False, 0
    for edge in edges:
        u = np.array([[u for begin, u in changes if begin <= t][-1]])
        while t < edge:
            if tried == most:
                return x, wanted, tried
            s = edge - t if edge - t <= 1.01 * wanted else wanted
            new, error, grow = trial(x, u, s)
            tried += 1
            good = error <= 1.0
            following = s * (min(grow, 1.0) if rejected else grow)
            if good:
                x, t = np.asarray(new, float), edge if edge - t <= s else t + s
                wanted = max(wanted, following) if s < wanted else following
            else:
                wanted = following
            rejected = not good
    return x, wanted, tried


@pytest.mark.parametrize("most", [1000, 5])
def test_lanes_that_choose_their_steps_do_what_numpy_does(most):
    ticks = 3
    plan = (RecordStage("run", ("x", "trials"), (2, 1)), Adapt(TRIAL, most=most, planned=2))
    loop = NativeLoop(plan, select_target())
    lanes = loop.lanes(LANES)
    pushes = np.geomspace(0.01, 1000.0, LANES).reshape(-1, 1)
    lanes.set("x", starts())
    lanes.set("u_plan", np.hstack([0.0 * pushes, pushes]))
    lanes.set("u_from", np.full(1, 0.3 * H))
    found = recorded(loop, lanes, ticks, 3)
    for lane, push in enumerate(pushes[:, 0]):
        x, wanted, total = starts()[lane], H, 0
        for k in range(ticks):
            x, wanted, tried = adapted(x, [(0.0, 0.0), (0.3 * H, push)], wanted, [0.3 * H, H], most)
            total += tried
            np.testing.assert_allclose(found[k + 1, lane, :2], x, rtol=1e-12, atol=1e-13)
            assert found[k + 1, lane, 2] == total
            if lanes.get("frozen")[lane, 0] == k:
                assert tried == most
                break
    stopped = lanes.get("frozen")[:, 0] >= 0
    np.testing.assert_array_equal(lanes.get("stalled")[:, 0], stopped)
    assert stopped.any() == (most == 5)
    assert not stopped.all()


def test_two_programs_of_one_name_do_not_share_a_module():
    module, shapes = LlvmModule(4), {"x": (2,)}
    module.add_block_function(trace("p", lambda x: 2.0 * x, shapes, ("y",)))
    module.add_block_function(trace("p", lambda x: 2.0 * x, shapes, ("y",)))  # the same, traced again
    with pytest.raises(AssertionError, match="two programs"):
        module.add_block_function(trace("p", lambda x: 3.0 * x, shapes, ("y",)))
