"""Triangular factors against dense matrices, and base parameters against closed forms."""

import numpy as np

import armwright as aw
from armwright.fitting.triangular import triangle
from armwright.identification.arm.base import base_parameters, regrouped
from armwright.identification.arm.equations import equations_of, stacked
from armwright.identification.arm.samples import Samples
from armwright.identification.arm.torque_model import random_states, torque_model


def test_triangle_is_that_of_a_dense_matrix():
    rows = np.random.default_rng(0).normal(size=(1000, 9))
    r = triangle(rows[700:], triangle(rows[:700]))
    np.testing.assert_allclose(r.T @ r, rows.T @ rows, rtol=1e-12, atol=1e-10)
    assert np.abs(np.tril(r, -1)).max() == 0


def samples(arm, count=400, seed=3, noise=0.0):
    """Random states and the record's torques with noise [N m]."""
    q, qd, qdd = random_states(arm, count, seed)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    tau = tau + noise * np.random.default_rng(seed).normal(size=tau.shape)
    return Samples("run", 0, 0.01 * np.arange(count), q, qd, qdd, tau)


def test_factors_are_those_of_all_rows():
    arm = aw.load("lwa4p")
    model, data = torque_model(arm), samples(aw.load("lwa4p"), noise=1.0)
    equations = equations_of([data.part(slice(0, 150)), data.part(slice(150, None))], model, part_seconds=1.0, rows=37)
    assert [(round(p.begin, 6), round(p.end, 6)) for p in equations.parts] == [
        (0, 0.99),
        (1, 1.99),
        (2, 2.99),
        (3, 3.99),
    ]
    weights = np.arange(1.0, 7.0)
    values = model.rows(data.q, data.qd, data.qdd)
    dense = np.concatenate(
        [np.sqrt(w) * np.column_stack([values[:, j], data.tau[:, j]]) for j, w in enumerate(weights)]
    )
    r, size = stacked(equations.factors, len(model), weights)
    np.testing.assert_allclose(r.T @ r, dense.T @ dense, rtol=1e-9, atol=1e-9 * np.abs(dense.T @ dense).max())
    assert np.isclose(size, (dense[:, -1] ** 2).sum())
    some = np.random.default_rng(1).normal(size=len(model))
    for j, factor in enumerate(equations.factors):
        assert np.isclose(factor.residual(some), ((data.tau[:, j] - values[:, j] @ some) ** 2).sum())


def test_joints_without_torque_and_rows_with_gaps_are_left_out():
    arm = aw.load("lwa4p")
    data = samples(arm)
    data.tau[:, 2] = np.nan
    data.tau[:50, 0] = np.nan
    assert list(equations_of([data], torque_model(arm)).rows) == [350, 400, 0, 400, 400, 400]


def test_lwa4p_has_36_base_inertial_parameters():
    model = torque_model(aw.load("lwa4p"), friction=(), lacks=("rotors",))
    base = base_parameters(model)
    assert len(base) == 36
    q, qd, qdd = random_states(model.arm, 20, seed=9)
    values = model.rows(q, qd, qdd)
    some = np.random.default_rng(2).normal(size=60)
    np.testing.assert_allclose(values[:, :, base.independent] @ base.of(some), values @ some, atol=1e-9)


def test_planar_arm_has_the_textbook_regrouping():
    base = base_parameters(torque_model(aw.load("two-link"), friction=(), lacks=("rotors",)))
    length = 1.0
    assert base.formulas == ["mcx1 + m2", "mcy1", "Izz1 + m2", "mcx2", "mcy2", "Izz2"], length


def test_columns_below_1e_10_of_the_largest_are_zero_before_scaling():
    model = torque_model(aw.load("two-link"), friction=(), lacks=("rotors",))
    factor = np.diag([1.0, *[1e-11] * 18, 1e-9])
    base = regrouped(model.columns, factor)
    assert list(base.independent) == [0, 19]
    assert len(base.absent) == 18


def test_parameters_nearest_to_a_prior_have_the_base_parameters():
    model = torque_model(aw.load("lwa4p"))
    base, generator = base_parameters(model), np.random.default_rng(4)
    values, prior = generator.normal(size=len(base)), generator.normal(size=len(model))
    found = base.nearest(values, prior, np.ones(len(model)))
    np.testing.assert_allclose(base.of(found), values, atol=1e-9)
    np.testing.assert_allclose(base.nearest(base.of(prior), prior, np.ones(len(model))), prior, atol=1e-12)
