"""Physically possible parameters: two methods with one answer, and the constraints that plain least squares breaks."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.errors import IdentificationError
from armwright.identification.arm import physical
from armwright.identification.arm.physical import (
    PhysicalBounds,
    divergence,
    inertial_parameters,
    physical_by_log_cholesky,
    physical_by_sdp,
    pseudo_inertias,
)
from armwright.spatial import pseudo_inertia
from raises_at import raises_at

ENTRIES = ("m", "mx", "my", "mz", "xx", "xy", "xz", "yy", "yz", "zz")
NAMES = [*(f"link{k}.{entry}" for k in (1, 2) for entry in ENTRIES), "rotor", "viscous"]
LINKS, DRIVES = np.arange(20).reshape(2, 10), (20, 21)
BOUNDS = PhysicalBounds(NAMES, LINKS, DRIVES)


def bodies(rng, count: int) -> np.ndarray:
    """(count, 10) parameters of random possible bodies of some kilograms and decimetres."""
    points = rng.normal(size=(count, 6, 3)) * 0.1 + rng.normal(size=(count, 1, 3)) * 0.1
    masses = rng.uniform(0.1, 1.0, size=(count, 6))
    homogeneous = np.concatenate([points, np.ones((count, 6, 1))], axis=2)
    return inertial_parameters(np.einsum("bk,bki,bkj->bij", masses, homogeneous, homogeneous))


def problem(seed: int, noise: float, rank: int = 22) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R, z in standard deviations, and the truth; the rows tell `rank` of 22 directions."""
    rng = np.random.default_rng(seed)
    truth = np.concatenate([bodies(rng, 2).ravel(), [0.02, 1.5]])
    size = np.array([1.0] + [0.1] * 3 + [0.01] * 6)
    A = rng.normal(size=(200, rank)) @ rng.normal(size=(rank, 22)) / np.concatenate([size, size, [0.05, 1.0]])
    y = A @ truth + noise * rng.normal(size=200)
    R = np.linalg.qr(np.column_stack([A, y]) / noise, mode="r")
    return R[:-1, :-1], R[:-1, -1], truth


def total(estimate, prior, weight: float) -> float:
    return estimate.cost + 2 * weight * float(divergence(estimate.values[LINKS], prior[LINKS]).sum())


def test_pseudo_inertias_are_those_of_the_model():
    rng = np.random.default_rng(0)
    (body,) = bodies(rng, 1)
    m, com = body[0], body[1:4] / body[0]
    xx, xy, xz, yy, yz, zz = body[4:]
    about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    steiner = m * (com @ com * np.eye(3) - np.outer(com, com))
    np.testing.assert_allclose(pseudo_inertias(body), pseudo_inertia(m, com, about_origin - steiner), atol=1e-12)
    np.testing.assert_allclose(inertial_parameters(pseudo_inertias(body)), body, atol=1e-14)


def test_divergence_is_a_sum_of_squares():
    rng = np.random.default_rng(1)
    body, prior = bodies(rng, 2)
    assert divergence(prior, prior) == pytest.approx(0.0, abs=1e-10)
    V = np.linalg.solve(physical._upper_root(pseudo_inertias(prior)), physical._upper_root(pseudo_inertias(body)))
    theta = np.concatenate([np.log(np.diag(V)), V[np.triu_indices(4, 1)]])
    assert np.sum(physical._roots_of_divergence(theta) ** 2) == pytest.approx(float(divergence(body, prior)))
    for at in (theta, 1e-4 * theta):  # the slope, also where the root is a series
        h = 1e-6 * max(1.0, np.abs(at).max())
        slope = (physical._roots_of_divergence(at + h) - physical._roots_of_divergence(at - h)) / (2 * h)
        np.testing.assert_allclose(physical._slopes_of_divergence(at), slope, rtol=1e-5)


def test_exact_data_give_the_truth():
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    R, z, truth = problem(2, 1e-4)
    for fit in (physical_by_sdp, physical_by_log_cholesky):
        estimate = fit(R, z, BOUNDS)
        np.testing.assert_allclose(estimate.values, truth, rtol=1e-2, atol=1e-5)
        assert not estimate.at_bound.any()


@pytest.mark.parametrize(("noise", "rank"), [(0.01, 22), (1.0, 22), (0.3, 12)])
@pytest.mark.parametrize("weight", [0.5, 50.0])
def test_both_methods_agree(noise, rank, weight):
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    R, z, truth = problem(3, noise, rank)
    prior = truth.copy()
    prior[LINKS] = bodies(np.random.default_rng(9), 2)
    first = physical_by_sdp(R, z, BOUNDS, prior=prior, weight=weight)
    second = physical_by_log_cholesky(R, z, BOUNDS, prior=prior, weight=weight)
    assert total(first, prior, weight) == pytest.approx(total(second, prior, weight), rel=1e-5, abs=1e-4)
    np.testing.assert_allclose(first.values[:20], second.values[:20], rtol=1e-2, atol=3e-4)
    for estimate in (first, second):  # and no other possible arm is better: not the truth, nor the prior
        assert (np.linalg.eigvalsh(pseudo_inertias(estimate.values[LINKS])) > 0).all()
        for other in (truth, prior):
            cost = np.sum((R @ other - z) ** 2) + 2 * weight * float(divergence(other[LINKS], prior[LINKS]).sum())
            assert total(estimate, prior, weight) <= cost + 1e-6


def test_without_a_prior_both_agree():
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    R, z, _ = problem(4, 1.0)
    first, second = physical_by_sdp(R, z, BOUNDS), physical_by_log_cholesky(R, z, BOUNDS)
    assert first.cost == pytest.approx(second.cost, abs=0.02)
    assert first.cost_free <= first.cost


@pytest.mark.study
def test_a_negative_rotor_inertia_is_never_silent():
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    R, _, truth = problem(5, 0.01)
    wrong = truth.copy()
    wrong[20] = -0.02
    for fit in (physical_by_sdp, physical_by_log_cholesky):
        estimate = fit(R, R @ wrong, BOUNDS)
        assert 0 <= estimate.values[20] < 1e-6
        assert estimate.at_bound[20]
        assert any("rotor is at its bound, 0: the log alone wants -0.02" in remark for remark in estimate.remarks)


def test_impossible_links_are_told():
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    R, _, truth = problem(6, 0.001)
    wrong = truth.copy()
    wrong[4] = -0.1  # a negative moment of inertia
    estimate = physical_by_sdp(R, R @ wrong, BOUNDS)
    assert estimate.at_bound[:10].all()
    assert estimate.cost > estimate.cost_free + 10
    assert "link 1" in estimate.remarks[0]


def test_bounds_of_masses_are_kept():
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    R, z, truth = problem(7, 0.1)
    low, high = 1.1 * truth[0], 1.2 * truth[0]
    estimate = physical_by_sdp(R, z, PhysicalBounds(NAMES, LINKS, DRIVES, mass={0: (low, high)}))
    assert estimate.values[0] == pytest.approx(low, rel=1e-6)
    assert estimate.at_bound[0]
    whole = truth[0] + truth[10] + 0.5
    estimate = physical_by_sdp(R, z, PhysicalBounds(NAMES, LINKS, DRIVES, total_mass=(whole, np.inf)))
    assert estimate.values[[0, 10]].sum() == pytest.approx(whole, rel=1e-6)
    with raises_at(IdentificationError, "PhysicalBounds.total_mass", "5 and inf kg"):
        PhysicalBounds(NAMES, LINKS, DRIVES, mass={0: (5.0, 6.0)}, total_mass=(0.0, 1.0))


def test_units_of_the_computation_change_nothing():
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    R, z, truth = problem(8, 0.3, rank=15)
    prior = truth.copy()
    prior[LINKS] = bodies(np.random.default_rng(8), 2)
    first = physical_by_sdp(R, z, BOUNDS, prior=prior)
    other = physical_by_sdp(R, z, PhysicalBounds(NAMES, LINKS, DRIVES, length=0.3, typical_mass=20.0), prior=prior)
    np.testing.assert_allclose(first.values[:20], other.values[:20], rtol=1e-3, atol=1e-4)


def test_what_is_missing_is_named(monkeypatch):
    R, z, truth = problem(8, 0.3)
    monkeypatch.setitem(__import__("sys").modules, "cvxpy", None)
    with pytest.raises(IdentificationError, match=r"pip install armwright\[identify\]"):
        physical_by_sdp(R, z, BOUNDS)
    with pytest.raises(IdentificationError, match="positive definite"):
        physical_by_log_cholesky(R, z, BOUNDS, prior=0 * truth)
    with pytest.raises(IdentificationError, match="weight"):
        physical_by_log_cholesky(R, z, BOUNDS, prior=truth, weight=0.0)
    with pytest.raises(IdentificationError, match="shapes"):
        physical_by_log_cholesky(R[:, :3], z, BOUNDS)
