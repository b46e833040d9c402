"""Kernels that are compiled together: the same code as one by one, wherever it is made."""

import sys

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.kernels import engine, object_code

NAMES = ["inverse_dynamics", "mass_matrix", "forward_dynamics_derivatives"]
STATE = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 5, 6))


@pytest.fixture
def uncached(monkeypatch):
    """Nothing comes from a cache."""
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")


@pytest.fixture
def made(monkeypatch):
    """Pairs (long, code) of every module that was handed to another process."""
    jobs, original = [], object_code.from_another_process

    def recorded(text, *processor):
        code = original(text, *processor)
        jobs.append((len(text) >= object_code.WORTH, code))
        return code

    monkeypatch.setattr(engine, "from_another_process", recorded)
    return jobs


def results(dyn):
    return [dyn.inverse_dynamics(*STATE), dyn.mass_matrix(STATE[0]), *dyn.forward_dynamics_derivatives(*STATE)]


def test_kernels_compiled_together_have_the_bits_of_those_compiled_one_by_one(uncached, made):
    arm = aw.load("puma560")
    dyn = aw.compile(arm, warm=NAMES)
    assert {key[0] for key in dyn._kernels} == set(NAMES)
    assert sorted(long for long, _ in made) == [
        False,
        False,
        True,
    ]  # a long one has a process of its own, and only that
    assert all((code is not None) == long for long, code in made)
    before = dict(dyn._kernels)
    in_batches, in_one = results(dyn), results(aw.compile(arm))
    assert dyn._kernels == before  # calls compile nothing more
    assert [each.tobytes() for each in in_batches] == [each.tobytes() for each in in_one]


@pytest.mark.parametrize("python", ["", "no-such-python", "/bin/false"])
def test_without_another_process_kernels_are_compiled_here(uncached, made, monkeypatch, python):
    monkeypatch.setattr(sys, "executable", python)
    dyn = aw.compile("puma560", warm=["mass_matrix", "inverse_dynamics_derivatives"])
    assert all(code is None for _, code in made)
    qdd = dyn.inverse_dynamics_derivatives(*STATE)[2]
    np.testing.assert_allclose(qdd, dyn.mass_matrix(STATE[0]), rtol=1e-12, atol=1e-12)


def test_warm_kernels_of_singles_and_of_varied_parameters(uncached):
    dyn = aw.compile("puma560", dtype="float32", vary=["link6.mass_kg"], warm=NAMES[:2])
    assert len(dyn._kernels) == 2
    tau = dyn.inverse_dynamics(*STATE.astype(np.float32), parameters=np.ones(1, np.float32))
    assert tau.dtype == np.float32
    assert len(dyn._kernels) == 2


def test_a_kernel_of_its_own_needs_no_other_process(uncached, made):
    dyn = aw.compile("puma560")
    dyn.warm(["forward_dynamics_derivatives"])
    dyn.warm(["forward_dynamics_derivatives"])
    assert not made


@pytest.mark.parametrize(
    ("warm", "error", "words"),
    [
        (["inverse_dynamic"], ShapeError, "warm.*inverse_dynamic.*inverse_dynamics"),
        ([3], ShapeError, "warm"),
        ("inverse_dynamics", ModelError, "list of names"),
        (7, ModelError, "list of names"),
    ],
)
def test_what_is_no_list_of_kernels_is_refused(warm, error, words):
    with pytest.raises(error, match=words):
        aw.compile("puma560", warm=warm)


def test_an_arm_that_lacks_what_a_kernel_needs_says_so():
    arm = aw.load("panda")
    with pytest.raises(ModelError, match="motor"):
        aw.compile(arm, warm=["mass_matrix", "motor_voltage"])
