"""Kernels in single precision: how close they stay to double, and that their bits are as much a construction as those."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.kernels import batch
from armwright.kernels.batch import Kernel
from armwright.kernels.format import SINGLE
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.kernels.target import select_target
from kernels.test_kernels import ARMS, FULL, SOLVED, as_tuple, same_bits, states, targets
from physics.arms import arm

ROUNDING = 2.0**-24
#: Roundings of the largest entry of a result within which 2000 random states stay; docs/data has quantiles of a million.
BOUND = 64
SPRINGS = "spring_torques"  # of built-in arms, which have no springs, all 0
USUAL = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "gravity_torques", "forward_kinematics", "jacobian")


def singles(model: aw.Model, kernel: str, count: int, seed: int = 0) -> list[np.ndarray]:
    return [values.astype(np.float32) for values in states(model, kernel, count, seed=seed)]


def worst(name: str, kernel: str, count: int) -> float:
    """The largest error of `count` random states, in roundings of the largest entry of each result and of 1 at least.

    Of energies, of the largest of all states. Solving equations amplifies them by the condition of the mass matrix, and
    inverting by that of the result.
    """
    single, double = aw.compile(aw.load(name), dtype="float32"), aw.compile(aw.load(name))
    inputs = singles(double.arm, kernel, count)
    given = [values.astype(float) for values in inputs]
    largest = 0.0
    for found, expected in zip(
        as_tuple(getattr(single, kernel)(*inputs)), as_tuple(getattr(double, kernel)(*given)), strict=True
    ):
        assert found.dtype == np.float32
        axes = tuple(range(1, expected.ndim))
        scale = np.maximum(np.abs(expected).max(axis=axes), 1.0)
        if kernel == "energy":  # the terms of a potential cancel; the largest that is reached tells how large they are
            scale = np.full(count, scale.max())
        good = np.full(count, True)
        if kernel in SOLVED:
            scale = scale * np.linalg.cond(double.mass_matrix(given[0]))
        if kernel == "operational_inertia":  # where its condition eats all digits there is nothing to compare
            good = np.linalg.cond(expected) < 1e5
            scale = scale * np.linalg.cond(expected)
        error = np.abs(found - expected).max(axis=axes) / (ROUNDING * scale)
        largest = max(largest, float(error[good].max()))
    return largest


@pytest.mark.parametrize(
    ("name", "kernel"),
    [pair for pair in FULL if pair[1] != SPRINGS and (pair[0] == "puma560" or pair[1] in (*USUAL, "energy"))],
)
@pytest.mark.sample(3)
def test_single_precision_is_double_rounded(name, kernel):
    """Within the bound, and not by computing in double."""
    assert 0.0 < worst(name, kernel, 2000) <= BOUND


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_inverse_dynamics_against_the_float_reference(name):
    """The plain function on Python's floats is the outside judge."""
    model = aw.load(name)
    dyn = aw.compile(model, dtype="float32")
    q, qd, qdd = singles(model, "inverse_dynamics", 100, seed=5)
    found = dyn.inverse_dynamics(q, qd, qdd)
    for tau, *state in zip(found, q, qd, qdd, strict=True):
        expected = aw.inverse_dynamics(model, *(values.astype(float) for values in state))
        assert np.abs(tau - expected).max() <= BOUND * ROUNDING * max(np.abs(expected).max(), 1.0)


@pytest.mark.sample(1)
@pytest.mark.parametrize("kernel", [*USUAL, "inverse_dynamics_derivatives", "motor_voltage", "energy"])
def test_bits_do_not_depend_on_how_a_state_is_computed(kernel, monkeypatch):
    """Same bits whatever the batch size, lane position, tail, thread count and vector width."""
    monkeypatch.setattr(batch, "PART", 1)  # every tile is worth a thread
    model = aw.load("puma560")
    inputs = singles(model, kernel, 4611)
    reference = None
    for target in targets(kernel):
        dyn = aw.compile(model, target=target, dtype="float32")
        assert dyn.target.width == 2 * aw.compile(model, target=target).target.width
        dyn.threads = 1
        reference = as_tuple(getattr(dyn, kernel)(*inputs)) if reference is None else reference
        counts = (1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 31, 33)
        for rows in (slice(None), *(slice(11 * count, 12 * count) for count in counts), 4610):
            assert same_bits(dyn, kernel, inputs, reference, rows), (target, rows)
        dyn.threads = 2
        assert same_bits(dyn, kernel, inputs, reference, slice(None)), target


def test_other_numbers_are_converted():
    """Doubles, integers, lists and odd layouts, each number rounded once; leading axes broadcast."""
    dyn = aw.compile(aw.load("puma560"), dtype="float32")
    q = np.random.default_rng(0).normal(size=(40, 6))
    single = q.astype(np.float32)
    expected = dyn.gravity_torques(single)
    for same in (q, q.tolist(), np.asfortranarray(q), np.repeat(single, 2, axis=1)[:, ::2], single.astype(">f4")):
        assert np.array_equal(dyn.gravity_torques(same), expected)
    assert dyn.mass_matrix([0, 1, 0, 1, 0, 1]).dtype == np.float32
    tau = dyn.inverse_dynamics(single, np.zeros(6), qdd=single[:1])
    assert np.array_equal(tau, dyn.inverse_dynamics(single, np.zeros_like(single), np.tile(single[:1], (40, 1))))
    assert dyn.inverse_dynamics(np.zeros((0, 6)), q[:1], q[:1]).dtype == np.float32


def test_out_is_of_the_dtype():
    """float32 is written in place, contiguous or not; float64 is refused."""
    dyn = aw.compile(aw.load("puma560"), dtype="float32")
    q = np.random.default_rng(0).normal(size=(40, 6)).astype(np.float32)
    expected = dyn.gravity_torques(q)
    out, wide = np.empty((40, 6), dyn.dtype), np.zeros((40, 12), dyn.dtype)
    for _ in range(2):  # the second call knows the shapes
        assert dyn.gravity_torques(q, out=out) is out
        assert np.array_equal(out, expected)
        dyn.gravity_torques(q, out=wide[:, ::2])
        assert np.array_equal(wide[:, ::2], expected)
        with pytest.raises(ShapeError) as error:
            dyn.gravity_torques(q, out=np.empty((40, 6)))
        assert (error.value.what, error.value.expected) == ("float64 (40, 6)", "writeable float32 (40, 6)")
    assert dyn.gravity_torques(q, out=q) is q
    assert np.array_equal(q, expected)


def test_bound_calls():
    """Arrays of float32, given or made; others are refused."""
    dyn = aw.compile(aw.load("puma560"), dtype="float32")
    q = np.linspace(0, 1, 18, dtype=np.float32).reshape(3, 6)
    bound = dyn.bind("mass_matrix", lead=(3,), q=q)
    assert bound().dtype == np.float32
    assert np.array_equal(bound.result, dyn.mass_matrix(q))
    with pytest.raises(ShapeError) as error:
        dyn.bind("mass_matrix", q=np.zeros(6))
    assert (error.value.what, error.value.expected) == ("float64 (6,)", "writeable contiguous float32 (6,)")


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda dyn: pickle.loads(pickle.dumps(dyn))])
def test_a_copy_has_the_dtype(again):
    dyn = aw.compile(arm("two-link"), dtype="float32")
    other = again(dyn)
    assert (other.dtype, other.target) == (np.dtype(np.float32), dyn.target)
    assert other.gravity_torques([0.1, 0.2]).dtype == np.float32
    assert "in float32" in repr(other)


def test_names_of_the_dtype():
    """A name, or NumPy's own type; float64 is what there is without it."""
    assert aw.compile(arm("two-link")).dtype == np.float64
    for dtype in ("float32", np.float32, np.dtype(np.float32)):
        assert aw.compile(arm("two-link"), dtype=dtype).dtype == np.float32


@pytest.mark.parametrize("dtype", ["float16", "single", "f4", int, None, np.complex64, 32])
def test_other_dtypes_are_refused(dtype):
    with pytest.raises(ModelError) as error:
        aw.compile(arm("two-link"), dtype=dtype)
    assert (error.value.value, error.value.expected) == (dtype, "float64 or float32")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_values_that_are_not_finite(bad):
    """NaN and infinity in, NaN out, in their own lane only; 1e300 is infinite as a float."""
    dyn = aw.compile(aw.load("puma560"), dtype="float32")
    q = np.random.default_rng(3).normal(size=(33, 6))
    clean = dyn.mass_matrix(q)
    spoilt = q.copy()
    spoilt[4, 2] = bad
    result = dyn.mass_matrix(spoilt)
    assert np.isnan(result[4, 1, 1])
    assert np.array_equal(np.delete(result, 4, axis=0), np.delete(clean, 4, axis=0))


def test_angles_far_beyond_the_fast_range():
    """Beyond 2²⁰ rad sine and cosine come from libm, in that lane only."""
    dyn = aw.compile(aw.load("puma560"), dtype="float32")
    q = np.random.default_rng(4).normal(size=(33, 6)).astype(np.float32)
    far = q.copy()
    far[4] *= 3e6
    result, near = dyn.forward_kinematics(far), dyn.forward_kinematics(q)
    assert np.array_equal(np.delete(result, 4, axis=0), np.delete(near, 4, axis=0))
    expected = aw.forward_kinematics(dyn.arm, far[4].astype(float))
    assert np.allclose(result[4], expected, rtol=0, atol=16 * ROUNDING)


def test_formats_do_not_share_code():
    """One program, one processor, one width: two kernels, whichever was compiled and kept first."""
    program = trace_kernel(arm("two-link"), SIGNATURES["gravity_torques"])
    target = select_target()
    double, single = Kernel(program, target), Kernel(program, target, format=SINGLE)
    for kernel in (double, single, Kernel(program, target, format=SINGLE), Kernel(program, target)):
        found = kernel(np.full((40, 2), 0.5))
        assert found.dtype == kernel.dtype
        assert np.array_equal(found, (double if kernel.dtype == np.float64 else single)(np.full((40, 2), 0.5)))
    assert not np.array_equal(double([0.5, 0.5]), single([0.5, 0.5]))


def test_long_programs_are_cut():
    """One whose pieces pass values through memory."""
    model = aw.load("panda")
    dyn = aw.compile(model, dtype="float32")
    inputs = singles(model, "forward_dynamics_derivatives", 50)
    results = dyn.forward_dynamics_derivatives(*inputs)
    alone = [dyn.forward_dynamics_derivatives(*(values[k] for values in inputs)) for k in (0, 17, 49)]
    for k, parts in zip((0, 17, 49), alone, strict=True):
        assert all(np.array_equal(part, whole[k]) for part, whole in zip(parts, results, strict=True))
