"""Long arms in one frame: against Pinocchio, and against what short arms are computed by."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

import armwright as aw
from armwright.dynamics import forward_dynamics_derivatives, inverse_dynamics_derivatives, mass_matrix
from armwright.dynamics.one_frame import mass_matrix_pays, slopes_pay
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model, build_model
from armwright.model.simplify import simplified
from dynamics.test_gears import coupled
from physics.arms import NAMES, arm, random_state
from reference.chains import chain
from reference.random_trees import random_description, random_position

ANALYTIC = 1e-13  # of a result's largest entry
DEEP_TREES = (57, 84)  # 20 and 29 joints, revolute and prismatic, which branch


@contextmanager
def chosen(monkeypatch: pytest.MonkeyPatch, choice: str, pays: bool) -> Iterator[None]:
    """Takes the way in one frame, or the other."""
    with monkeypatch.context() as patch:
        for module in ("derivatives", "mass_matrix"):
            patch.setattr(sys.modules[f"armwright.dynamics.{module}"], choice, lambda arm: pays, raising=False)
        yield


def assert_close(ours: np.ndarray, expected: np.ndarray, tolerance: float = ANALYTIC) -> None:
    """Within the tolerance of the largest entry."""
    assert ours.shape == expected.shape
    assert np.abs(ours - expected).max() <= tolerance * np.abs(expected).max()


def state_of(model: Model, seed: int) -> np.ndarray:
    """q, qd, qdd (3, n): slides within 0.5 m."""
    rng = np.random.default_rng(seed)
    q = random_position(model, rng) if model.mimics is None else rng.normal(size=model.n)
    return np.array([q, *rng.normal(size=(2, model.n))])


@pytest.mark.sample(4)
@pytest.mark.parametrize("which", [*NAMES, *range(1, 37, 4), 57])
@pytest.mark.parametrize("pushed", [False, True])
def test_slopes_are_those_of_automatic_differentiation(which, pushed, monkeypatch):
    """Of arms with friction, rotors, lossy gears, springs, screws, joints that follow others, and a wrench at the tip."""
    model = arm(which) if isinstance(which, str) else build_model(random_description(which))
    model = model if model.tip is not None else model.replace(tip=list(model.frames)[-1])
    state = state_of(model, 1)
    wrench = 20.0 * np.random.default_rng(2).normal(size=6) if pushed else None
    for function in (inverse_dynamics_derivatives, forward_dynamics_derivatives):
        with chosen(monkeypatch, "slopes_pay", False):
            expected = function(model, state[0], state[1], state[2], wrench)
        with chosen(monkeypatch, "slopes_pay", True):
            ours = function(model, state[0], state[1], state[2], wrench)
        inverted = function is forward_dynamics_derivatives
        lost = float(np.linalg.cond(mass_matrix(model, state[0]))) if inverted else 1.0
        for mine, theirs in zip(ours, expected, strict=True):
            assert_close(mine, theirs, ANALYTIC * lost)


def test_slopes_of_coupled_motors(monkeypatch):
    model = coupled(arm("workshop"), 0.3)
    state = random_state(model, 3)
    with chosen(monkeypatch, "slopes_pay", False):
        expected = inverse_dynamics_derivatives(model, *state)
    with chosen(monkeypatch, "slopes_pay", True):
        ours = inverse_dynamics_derivatives(model, *state)
    for mine, theirs in zip(ours, expected, strict=True):
        assert_close(mine, theirs)


@pytest.mark.parametrize("which", [12, 30, *DEEP_TREES])
def test_long_arms_are_pinocchios(which):
    """computeRNEADerivatives and crba, of chains and of trees; the compiled kernel has the plain function's numbers."""
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from reference.peers import Pinocchio

    model = chain(which) if which not in DEEP_TREES else build_model(random_description(which))
    model = model.replace(friction=None, efficiency=None)
    assert slopes_pay(model)
    peer = Pinocchio(model.record, model.names)
    state = state_of(model, which)
    ours = inverse_dynamics_derivatives(model, *state)
    by_q, by_qd = peer.inverse_dynamics_derivatives(*state)
    inertia = peer.mass_matrix(state[0])
    for mine, theirs in zip(ours, (by_q, by_qd, inertia), strict=True):
        assert_close(mine, theirs, 1e-12)
    assert_close(mass_matrix(model, state[0]), inertia, 1e-12)
    if which == 12:
        for compiled, plain in zip(aw.compile(model).inverse_dynamics_derivatives(*state), ours, strict=True):
            assert_close(compiled, plain)


@pytest.mark.parametrize("n", [24, 60, 100])
def test_mass_matrices_of_long_chains(n, monkeypatch):
    """To 1e-13 of the largest entry, and to 1e-11 of √(M_ii M_jj), of those in the frames of the links, which lose no digits."""
    model = chain(n)
    for seed in range(2):
        q = np.random.default_rng(seed).uniform(-np.pi, np.pi, n)
        with chosen(monkeypatch, "mass_matrix_pays", False):
            expected = mass_matrix(model, q)
        assert mass_matrix_pays(model)
        error = np.abs(mass_matrix(model, q) - expected)
        diagonal = np.sqrt(np.diag(expected))
        assert error.max() <= 1e-13 * np.abs(expected).max()
        assert (error / np.outer(diagonal, diagonal)).max() <= 1e-11


@pytest.mark.parametrize("n", [40, 50])
def test_mass_matrices_of_trees_and_followers(n, monkeypatch):
    """Also where joints slide, branch and follow others."""
    for model in (arm("gripper"), build_model(random_description(57))):
        q = state_of(model, n)[0]
        with chosen(monkeypatch, "mass_matrix_pays", True):
            ours = mass_matrix(model, q)
        with chosen(monkeypatch, "mass_matrix_pays", False):
            assert_close(ours, mass_matrix(model, q))


def test_short_arms_stay_as_they_are():
    """Built-in arms keep their programs, and their bits."""
    for name in NAMES:
        assert not slopes_pay(arm(name))
        assert not mass_matrix_pays(arm(name))
        assert not mass_matrix_pays(simplified(arm(name)))
    assert not slopes_pay(chain(9))
    assert slopes_pay(chain(10))


@pytest.mark.sample(4)
@pytest.mark.parametrize("straight", [False, True])
@pytest.mark.parametrize(
    ("kernel", "n"),
    [*(("slopes_pay", n) for n in (8, 10, 14)), *(("mass_matrix_pays", n) for n in (12, 20, 28, 44))],
)
def test_the_way_taken_is_the_cheaper(kernel, n, straight, monkeypatch):
    """By the operations of the traced programs, within a fifth near where they cross."""
    model = chain(n, straight=straight)
    signature = SIGNATURES["mass_matrix" if kernel == "mass_matrix_pays" else "inverse_dynamics_derivatives"]

    def operations() -> int:
        return trace_kernel(model, signature).operation_counts().total()

    taken, ways = operations(), []
    for pays in (False, True):
        with chosen(monkeypatch, kernel, pays):
            ways.append(operations())
    assert taken <= 1.2 * min(ways)
