"""Every kernel of the table against the same function run on plain floats, and the bits of its results."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.kernels import batch
from armwright.kernels.signatures import SIGNATURES
from armwright.kernels.target import WIDTHS, select_target
from armwright.model import build_model
from physics.arms import FORMS
from reference.random_trees import random_description

ARMS = FORMS
LACKING = {("lwa4p", "motor_voltage"), ("lwa4p", "motor_torque")}  # no winding resistance is published
LACKING |= {(arm, kernel) for arm in ("panda", "two-link") for kernel in ("motor_voltage", "motor_torque")}
LACKING |= {("two-link", "operational_inertia")}  # six joints it takes
FULL = [(arm, kernel) for arm in ARMS for kernel in SIGNATURES if (arm, kernel) not in LACKING]


SOLVED = {"forward_dynamics", "forward_arm", "forward_dynamics_derivatives", "forward_arm_linearised"}
DIFFERENTIATED = {"inverse_dynamics_derivatives", "forward_dynamics_derivatives", "forward_arm_linearised"}
LONG = set(DIFFERENTIATED)  # programs that take seconds to compile
DIFFERENTIATED |= {"regressor", "coriolis_matrix"}  # a float run differentiates anew: 10 ms and more


def as_tuple(results) -> tuple:
    """The results of a kernel or function as a tuple of arrays."""
    return results if isinstance(results, tuple) else (results,)


def targets(kernel: str) -> list[str | None]:
    """The processor itself and every level below it; for programs that take seconds to compile, one of another width."""
    reached: list[str | None] = [None]
    for name in WIDTHS if kernel not in LONG else ("x86-64-v3",):
        try:
            select_target(name)
        except ModelError:
            continue
        reached.append(name)
    return reached


@pytest.fixture(scope="module")
def compiled() -> dict[str, aw.CompiledArm]:
    """Arms of all forms, compiled for this processor."""
    return {name: aw.compile(aw.load(name)) for name in ARMS}


def states(arm: aw.Model, kernel: str, count: int, *, optional: bool = False, seed: int = 0) -> list[np.ndarray]:
    """Random inputs (count, *shape) of a kernel."""
    rng = np.random.default_rng(seed)
    signature = SIGNATURES[kernel]
    arguments = [*signature.inputs, *(signature.optional if optional else ())]
    return [rng.normal(scale=1.5, size=(count, *argument.sized(arm))) for argument in arguments]


@pytest.mark.parametrize(
    ("name", "kernel", "optional"),
    [(*pair, False) for pair in FULL]
    + [
        (*pair, True) for pair in FULL if SIGNATURES[pair[1]].optional and (pair[1] not in LONG or pair[0] == "puma560")
    ],
)
@pytest.mark.sample(1)
def test_kernel_equals_float_run(compiled, name, kernel, optional):
    """1e-12 of the magnitude of the terms: the float run defines the meaning."""
    signature = SIGNATURES[kernel]
    dyn = compiled[name]
    count = 10 if kernel in DIFFERENTIATED else 21  # more than one block of lanes, and a tail
    inputs = states(dyn.arm, kernel, count, optional=optional)
    results = as_tuple(getattr(dyn, kernel)(*inputs))
    rows = [as_tuple(signature.function(dyn.arm, *row)) for row in zip(*inputs, strict=True)]
    for result, argument, *expected in zip(results, signature.outputs, *rows, strict=True):
        expected = np.array(expected)
        assert result.shape == (count, *argument.sized(dyn.arm))
        scale = np.abs(expected).max(axis=tuple(range(1, expected.ndim)), keepdims=True)
        if kernel in SOLVED:  # the terms are those of  tau - h,  amplified by M⁻¹
            scale = scale * np.linalg.cond(dyn.mass_matrix(inputs[0])).reshape(scale.shape)
        if kernel == "operational_inertia":  # the inverse of  J M⁻¹ Jᵀ
            scale = scale * np.linalg.cond(expected).reshape(scale.shape)
        assert np.all(np.abs(result - expected) <= 1e-12 * np.maximum(scale, 1.0))


@pytest.mark.parametrize(("name", "kernel"), sorted(LACKING))
def test_kernel_without_constants_is_refused(compiled, name, kernel):
    """A kernel whose constants are absent names joint and key."""
    arm = compiled[name].arm
    with pytest.raises(ModelError, match=f"{kernel} needs") as error:
        getattr(compiled[name], kernel)(*(np.zeros(arm.n) for _ in SIGNATURES[kernel].inputs))
    assert kernel == "operational_inertia" or error.value.place.startswith(f"{arm.names[0]}.motor.")


@pytest.mark.sample(1)
@pytest.mark.parametrize("kernel", sorted(SIGNATURES))
def test_bits_do_not_depend_on_how_a_state_is_computed(kernel, monkeypatch):
    """Same bits whatever the batch size, lane position, tail, thread count and vector width."""
    monkeypatch.setattr(batch, "PART", 1)  # every tile is worth a thread
    arm = aw.load("puma560")
    inputs = states(arm, kernel, 4099)
    reference = None
    for target in targets(kernel):
        dyn = aw.compile(arm, target=target)
        dyn.threads = 1
        reference = as_tuple(getattr(dyn, kernel)(*inputs)) if reference is None else reference
        counts = (1, 2, 3, 5, 7, 8, 9, 15, 17)
        for rows in (slice(None), *(slice(11 * count, 12 * count) for count in counts), 4098):
            assert same_bits(dyn, kernel, inputs, reference, rows), (target, rows)
        dyn.threads = 3
        assert same_bits(dyn, kernel, inputs, reference, slice(None)), target


def same_bits(dyn, kernel, inputs, reference, rows) -> bool:
    """True if the states at those rows, computed alone, give the bits that they gave among all."""
    parts = as_tuple(getattr(dyn, kernel)(*(values[rows] for values in inputs)))
    return all(np.array_equal(part, whole[rows]) for part, whole in zip(parts, reference, strict=True))


def test_broadcasting():
    """Leading axes follow NumPy; a state that serves all is given once."""
    arm = aw.load("two-link")
    dyn = aw.compile(arm)
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(size=(5, 1, 2)), rng.normal(size=(3, 2)), rng.normal(size=2)
    tau = dyn.inverse_dynamics(q, qd, qdd)
    full = np.broadcast_arrays(q, qd, qdd)
    assert tau.shape == (5, 3, 2)
    assert np.array_equal(tau, dyn.inverse_dynamics(*(np.ascontiguousarray(a) for a in full)))
    assert dyn.inverse_dynamics(np.zeros((0, 2)), qd[:1], qdd).shape == (0, 2)
    assert dyn.mass_matrix([[0, 1], [1, 0]]).shape == (2, 2, 2)


def test_out_and_odd_layouts():
    """`out=` is written and returned; strided, Fortran-ordered, float32, integer and read-only inputs are taken."""
    arm = aw.load("puma560")
    dyn = aw.compile(arm)
    q = np.random.default_rng(2).normal(size=(20, 6))
    expected = dyn.gravity_torques(q)
    out = np.empty((20, 6))
    assert dyn.gravity_torques(q, out=out) is out
    assert np.array_equal(out, expected)
    wide = np.zeros((20, 12))
    dyn.gravity_torques(q, out=wide[:, ::2])
    assert np.array_equal(wide[:, ::2], expected)
    assert not wide[:, 1::2].any()
    frozen = q.copy()
    frozen.flags.writeable = False
    for same in (np.asfortranarray(q), np.repeat(q, 2, axis=1)[:, ::2], frozen):
        assert np.array_equal(dyn.gravity_torques(same), expected)
    short = q.astype(np.float32)
    assert np.array_equal(dyn.gravity_torques(short), dyn.gravity_torques(short.astype(float)))


def test_out_may_be_an_input():
    """Results written over an input are those of the input as it was."""
    dyn = aw.compile(aw.load("puma560"))
    q, qd, qdd = np.random.default_rng(9).normal(size=(3, 50, 6))
    expected = dyn.inverse_dynamics(q, qd, qdd)
    assert dyn.inverse_dynamics(q, qd, qdd, out=qdd) is qdd
    assert np.array_equal(qdd, expected)
    both = np.concatenate([q, np.zeros((1, 6))])
    dyn.gravity_torques(both[:50], out=both[1:])
    assert np.array_equal(both[1:], dyn.gravity_torques(q))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda dyn: dyn.mass_matrix(np.zeros(5)), "^mass_matrix: q: shape (5,); expected (…, 6)$"),
        (lambda dyn: dyn.mass_matrix(0.0), "q: shape (); expected (…, 6)"),
        (lambda dyn: dyn.inverse_dynamics(*[np.zeros((k, 6)) for k in (2, 3, 1)]), "do not fit together: q (2, 6)"),
        (lambda dyn: dyn.inverse_dynamics(np.zeros(6), np.zeros(6)), "qdd: missing; expected q, qd, qdd"),
        (lambda dyn: dyn.inverse_dynamics(*[np.zeros(6)] * 5), "5 arrays; expected q, qd, qdd, wrench"),
        (
            lambda dyn: dyn.inverse_dynamics(*[np.zeros(6)] * 3, wrensh=np.zeros(6)),
            "argument = 'wrensh': did you mean wrench",
        ),
        (lambda dyn: dyn.inverse_dynamics(*[np.zeros(6)] * 3, np.zeros(5)), "wrench: shape (5,)"),
        (lambda dyn: dyn.mass_matrix(["a"] * 6), "q: of type <U1; expected an array of real numbers"),
        (lambda dyn: dyn.mass_matrix(np.zeros(6) + 1j), "q: of type complex128; expected an array of real numbers"),
        (lambda dyn: dyn.mass_matrix(np.zeros(6), out=np.zeros(6)), "out for M: float64 (6,); expected writeable"),
        (lambda dyn: dyn.mass_matrix(np.zeros(6), out=np.zeros((6, 6), np.float32)), "out for M: float32"),
    ],
)
def test_wrong_arrays(compiled, call, message):
    """A clear error that names the array, its shape and the one expected."""
    with pytest.raises(ShapeError) as error:
        call(compiled["puma560"])
    assert message.strip("^$") in str(error.value)
    assert error.value.place.startswith(("mass_matrix", "inverse_dynamics"))


def test_unknown_kernel_and_target(compiled):
    """The nearest names are offered."""
    with pytest.raises(AttributeError, match="is mass_matrix"):
        compiled["puma560"].massmatrix  # noqa: B018
    with pytest.raises(ModelError) as error:
        aw.compile(aw.load("two-link"), target="x86-64-v9")
    assert (error.value.place, error.value.value, error.value.choices) == ("target", "x86-64-v9", tuple(WIDTHS))


def test_values_that_are_not_finite(compiled):
    """NaN and infinity in, NaN out, in their own lane only."""
    dyn = compiled["puma560"]
    q = np.random.default_rng(3).normal(size=(9, 6))
    clean = dyn.mass_matrix(q)
    for bad in (np.nan, np.inf, -np.inf):
        spoilt = q.copy()
        spoilt[4, 2] = bad
        result = dyn.mass_matrix(spoilt)
        assert np.isnan(result[4, 1, 1])
        assert np.array_equal(np.delete(result, 4, axis=0), np.delete(clean, 4, axis=0))


def test_angles_far_beyond_the_fast_range(compiled):
    """Beyond 2²⁰ rad sine and cosine come from libm, in that lane only."""
    dyn = compiled["puma560"]
    q = np.random.default_rng(4).normal(size=(9, 6))
    far = q.copy()
    far[4] += 2 * np.pi * 2**40
    result, near = dyn.forward_kinematics(far), dyn.forward_kinematics(q)
    assert np.array_equal(np.delete(result, 4, axis=0), np.delete(near, 4, axis=0))
    expected = aw.forward_kinematics(dyn.arm, far[4])
    assert np.allclose(result[4], expected, rtol=0, atol=1e-14)


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", range(12))
def test_random_trees_through_llvm(seed):
    """A dozen of the random trees as native code, against floats."""
    arm = build_model(random_description(3 * seed + 1))
    dyn = aw.compile(arm)
    for kernel in ("inverse_dynamics", "mass_matrix", "forward_dynamics"):
        inputs = states(arm, kernel, 9, seed=seed)
        expected = np.array([SIGNATURES[kernel].function(arm, *row) for row in zip(*inputs, strict=True)])
        result = getattr(dyn, kernel)(*inputs)
        tolerance = 1e-10 if kernel == "forward_dynamics" else 1e-12
        assert np.abs(result - expected).max() <= tolerance * np.abs(expected).max()


def test_every_method_comes_from_the_table():
    """Each row is a method with the function's equation, shapes and units in its docstring."""
    for name, signature in SIGNATURES.items():
        text = getattr(aw.CompiledArm, name).__doc__
        assert text.splitlines()[0] == signature.function.__doc__.splitlines()[0]
        for argument in (*signature.inputs, *signature.optional, *signature.outputs):
            assert f"{argument.name}: (…" in text
            assert f"[{argument.unit}]" in text


def test_a_transposed_batch_is_recognised(compiled):
    with pytest.raises(ShapeError) as refused:
        compiled["puma560"].mass_matrix(np.zeros((6, 100)))
    assert refused.value.expected == "(…, 6); .T?"
