"""CompiledArm as an object: copies, pickles, threads, and what it refuses."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from physics.arms import arm
from raises_at import raises_at


@pytest.mark.parametrize("target", [None, "x86-64-v3"])
@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda dyn: pickle.loads(pickle.dumps(dyn))])
def test_a_copy_gives_the_same(again, target):
    """Also after the first call, when there is native code; arm, target and threads are kept."""
    dyn = aw.compile(arm("two-link"), target)
    dyn.threads = 3
    q = np.array([0.3, -0.4])
    expected = dyn.gravity_torques(q)
    other = again(dyn)
    assert (other.threads, other.target) == (3, dyn.target)
    np.testing.assert_array_equal(other.gravity_torques(q), expected)


@pytest.mark.parametrize("count", [None, "2", 2.5, 0, -1, True])
def test_threads_are_a_whole_number(count):
    dyn = aw.compile(arm("two-link"))
    before = dyn.threads
    with pytest.raises(ModelError) as error:
        dyn.threads = count
    assert (error.value.place, error.value.value) == ("threads", count)
    assert dyn.threads == before
    dyn.threads = np.int64(2)
    assert dyn.threads == 2


@pytest.mark.parametrize("thing", [[], None, 3])
def test_only_an_arm_is_compiled(thing):
    with raises_at(ModelError, "arm", value=thing):
        aw.compile(thing)


def test_an_unknown_kernel():
    dyn = aw.compile(arm("two-link"))
    for call in (dyn.kernel, dyn.bind):
        with raises_at(ShapeError, "kernel", r"mass_matrix\b", value="mas_matrix"):
            call("mas_matrix")
