"""Calls that would give wrong numbers in silence are refused, and processes that fork can compute."""

from __future__ import annotations

import multiprocessing
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.kernels import batch
from physics.arms import arm
from raises_at import raises_at

Q = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 6))


@pytest.fixture(scope="module")
def dyn():
    return aw.compile(arm("puma560"))


def test_outputs_that_share_memory_are_refused(dyn):
    a, b, c = np.empty((3, 50, 6, 6))
    expected = dyn.inverse_dynamics_derivatives(Q, Q, Q)
    room = np.empty(50 * 36 * 2)
    overlapping = room[: 50 * 36].reshape(50, 6, 6), room[36 : 36 + 50 * 36].reshape(50, 6, 6)
    for out in ((a, a, b), (a, b, a), (*overlapping, b)):
        for _ in range(2):  # with a plan and without
            with pytest.raises(ShapeError, match="share memory"):
                dyn.inverse_dynamics_derivatives(Q, Q, Q, out=out)
            dyn.inverse_dynamics_derivatives(Q, Q, Q)
    dyn.inverse_dynamics_derivatives(Q, Q, Q, out=(a, b, c))
    np.testing.assert_array_equal([a, b, c], expected)
    woven = np.empty((50, 6, 6, 3))
    dyn.inverse_dynamics_derivatives(Q, Q, Q, out=tuple(woven[..., k] for k in range(3)))  # side by side, not shared
    np.testing.assert_array_equal(np.moveaxis(woven, -1, 0), expected)


ROOM = np.zeros(50 * 36 * 8)
SHARING = {  # writeable arrays (50, 6, 6) of which entries lie over each other
    "zero strides": np.lib.stride_tricks.as_strided(ROOM, (50, 6, 6), (0, 48, 8)),
    "rows over rows": np.lib.stride_tricks.as_strided(ROOM, (50, 6, 6), (8, 48, 8)),
    "half entries": np.lib.stride_tricks.as_strided(ROOM, (50, 6, 6), (288, 48, 4)),
}


@pytest.mark.parametrize("out", SHARING.values(), ids=SHARING)
def test_an_output_that_overlaps_itself_is_refused(dyn, out):
    for _ in range(2):  # with a plan and without
        with raises_at(ShapeError, "mass_matrix: out for M", "share memory"):
            dyn.mass_matrix(Q, out=out)
        dyn.mass_matrix(Q)
    with raises_at(ShapeError, "mass_matrix: M", "share memory"):
        dyn.bind("mass_matrix", lead=(50,), M=out)


@pytest.mark.parametrize("mask", [False, True, np.arange(6) == 3], ids=["none", "all", "one"])
def test_masked_outputs_are_refused(dyn, mask):
    out = np.ma.masked_array(np.zeros((50, 6, 6)), mask=np.broadcast_to(mask, (50, 6, 6)))
    for _ in range(2):
        with pytest.raises(ShapeError, match="masked"):
            dyn.mass_matrix(Q, out=out)
        dyn.mass_matrix(Q)
    with pytest.raises(ShapeError, match="masked"):
        dyn.bind("mass_matrix", lead=(50,), M=out)


def test_masked_inputs_are_refused_where_an_entry_is_masked(dyn):
    """NumPy would compute with what lies under the mask."""
    whole = np.ma.masked_array(Q)
    np.testing.assert_array_equal(dyn.mass_matrix(whole), dyn.mass_matrix(Q))
    whole[3, 4] = np.ma.masked
    with raises_at(ShapeError, "mass_matrix: q", "masked"):
        dyn.mass_matrix(whole)


def test_outputs_of_any_layout_without_overlap_are_written(dyn):
    expected, room = dyn.mass_matrix(Q), np.zeros((6, 2, 50, 3, 6))
    views = room[:, 1, ::-1, 2].transpose(1, 0, 2), np.zeros((6, 6, 50)).T, np.zeros((50, 12, 6))[:, ::2]
    for out in views:
        np.testing.assert_array_equal(dyn.mass_matrix(Q, out=out), expected)


def test_as_many_outputs_as_there_are(dyn):
    with pytest.raises(ShapeError) as error:
        dyn.inverse_dynamics_derivatives(Q, Q, Q, out=(np.empty((50, 6, 6)), np.empty((50, 6, 6))))
    assert (error.value.what, error.value.expected) == ("2 arrays", "3: dtau_dq, dtau_dqd, dtau_dqdd")


def test_bound_arrays_that_lie_partly_over_each_other_are_refused(dyn):
    room = np.zeros(40 * 36)
    with raises_at(ShapeError, "mass_matrix: M and q"):
        dyn.bind("mass_matrix", lead=(40,), q=room[:240].reshape(40, 6), M=room.reshape(40, 6, 6))
    rows = Q.copy()
    bound = dyn.bind("gravity_torques", lead=(50,), q=rows, g=rows)
    np.testing.assert_array_equal(bound(), dyn.gravity_torques(Q))
    both = np.empty((50, 6, 6))
    with pytest.raises(ShapeError, match="share memory"):
        dyn.bind("inverse_dynamics_derivatives", lead=(50,), dtau_dq=both, dtau_dqdd=both)


def test_bound_parameters_begin_at_the_records_values():
    varied = aw.compile(arm("puma560"), vary=["link2.mass_kg"])
    bound = varied.bind("gravity_torques", lead=(3,))
    bound.inputs["q"][...] = 0.3
    np.testing.assert_allclose(bound(), aw.compile(arm("puma560")).gravity_torques(np.full((3, 6), 0.3)), atol=1e-12)


@pytest.mark.parametrize(
    ("call", "place", "value"),
    [
        (lambda dyn: dyn.bind("inverse_dynamics", "wrnch"), "inverse_dynamics: optional input", "wrnch"),
        (lambda dyn: dyn.kernel("inverse_dynamics", "foo"), "inverse_dynamics: optional input", "foo"),
        (lambda dyn: dyn.casadi("inverse_dynamics", "foo"), "inverse_dynamics: optional input", "foo"),
        (lambda dyn: dyn.bind("mass_matrix", "wrench"), "mass_matrix: optional input", "wrench"),
        (lambda dyn: dyn.bind("jacobian", options={"fram": "link3"}), "jacobian: option", "fram"),
        (lambda dyn: dyn.casadi("jacobian", fram="link3"), "jacobian: option", "fram"),
        (lambda dyn: dyn.jacobian(Q, frame=["a"]), "jacobian: frame", ["a"]),
        (lambda dyn: dyn.bind("inverse_dynamics", lead=5), "inverse_dynamics: lead", 5),
        (lambda dyn: dyn.bind("inverse_dynamics", lead=(-1,)), "inverse_dynamics: lead", (-1,)),
        (lambda dyn: dyn.bind("inverse_dynamics", lead="a"), "inverse_dynamics: lead", "a"),
        (lambda dyn: dyn.kernel(["a"]), "kernel", ["a"]),
        (lambda dyn: dyn.bind("mas_matrix"), "kernel", "mas_matrix"),
    ],
)
def test_words_that_the_table_does_not_have_are_refused(dyn, call, place, value):
    with pytest.raises(ShapeError) as error:
        call(dyn)
    assert (error.value.place, error.value.value) == (place, value)


def test_a_target_that_is_no_name():
    with pytest.raises(ModelError, match="target = 3"):
        aw.compile(arm("puma560"), target=3)


def _child(queue):
    dyn = aw.compile(arm("puma560"))
    dyn.threads = 2
    big = np.tile(Q, (1000, 1))
    queue.put(float(dyn.gravity_torques(big)[0, 1]))


@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux")
def test_a_forked_child_has_threads_of_its_own(dyn, monkeypatch):
    monkeypatch.setattr(batch, "PART", 1)
    dyn.threads = 2
    big = np.tile(Q, (1000, 1))
    expected = float(dyn.gravity_torques(big)[0, 1])
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_child, args=(queue,))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # newer Pythons warn of forking with threads
        child.start()
    assert queue.get(timeout=60) == expected
    child.join(60)
    assert child.exitcode == 0


def test_a_thread_gets_what_is_worth_waking_it(monkeypatch):
    """By operations, not by states: a long program is shared from fewer states on, into whole tiles."""
    dyn = aw.compile(arm("puma560"))
    short, long = (dyn.kernel(name) for name in ("gravity_torques", "forward_dynamics_derivatives"))
    assert short.least * short.operations > 3e5 * short.target.width
    assert 3 * long.least < short.least
    for kernel in (short, long):
        submitted = []
        monkeypatch.setattr(
            batch, "_pool", lambda _, to=submitted: SimpleNamespace(submit=lambda run, *part: done(run, part, to))
        )
        least, n = kernel.least, dyn.arm.n
        assert least % kernel.target.width == 0
        count = 2 * least + 3
        arrays = [np.zeros((count, n))] * len(kernel.program.inputs)
        kernel(*(each[: 2 * least - 1] for each in arrays), threads=4)
        assert submitted == []
        kernel(*arrays, threads=4)
        assert [last - first for first, last in submitted] == [least]


def done(run, part, to):
    """Runs a part at once and keeps its bounds."""
    to.append(part)
    run(*part)
    return SimpleNamespace(result=lambda: None)
