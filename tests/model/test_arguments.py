"""The plain functions refuse what is no state of the arm, and say what would be one."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.model.arguments import JOINTS
from physics.arms import arm
from public_names import PUBLIC
from raises_at import raises_at

PLAIN = [
    name
    for name in PUBLIC
    if inspect.isfunction(PUBLIC[name])
    and PUBLIC[name].__module__.split(".")[1] in ("dynamics", "kinematics", "actuators")
]


def _arguments(name, n):
    parameters = list(inspect.signature(PUBLIC[name]).parameters.values())[1:]
    return {p.name: np.zeros(n) for p in parameters if p.default is p.empty}


def test_they_are_found():
    assert len(PLAIN) >= 14
    assert all(set(_arguments(name, 6)) <= set(JOINTS) for name in PLAIN)


@pytest.mark.parametrize("name", PLAIN)
@pytest.mark.parametrize("shape", [(7,), (5,), (4, 6), (6, 1), ()])
def test_another_shape_is_refused(name, shape):
    """Too many numbers, too few, a batch, a column, a single number: for every argument in turn."""
    given = _arguments(name, 6)
    for argument in given:
        with pytest.raises(ShapeError) as error:
            PUBLIC[name](arm("puma560"), **given | {argument: np.zeros(shape)})
        batch = "; for many states at once see aw.compile" if len(shape) == 2 else ""
        assert (error.value.place, error.value.what) == (f"{name}: {argument}", f"shape {shape}")
        assert error.value.expected == f"(6,), one number for each joint of puma560{batch}"


def test_a_transposed_batch_is_recognised():
    with pytest.raises(ShapeError, match=r"which takes \(…, 6\): \.T\?$"):
        aw.mass_matrix(arm("puma560"), np.zeros((6, 100)))


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", PLAIN)
def test_an_arm_may_be_named(name):
    arguments = {key: 0.3 + value for key, value in _arguments(name, 6).items()}
    own, named = (PUBLIC[name](each, **arguments) for each in (arm("puma560"), "puma560"))
    for ours, theirs in zip(*((each if isinstance(each, tuple) else (each,)) for each in (own, named)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    with raises_at(ModelError, "arm", value=3):
        PUBLIC[name](3, **_arguments(name, 6))


def test_the_wrench_has_six_numbers():
    model, q = arm("two-link"), np.zeros(2)
    with raises_at(ShapeError, "bias_torques: wrench", r"\(2,\).*\(6,\)"):
        aw.bias_torques(model, q, q, q)
    np.testing.assert_array_equal(aw.bias_torques(model, q, q, None), aw.bias_torques(model, q, q, np.zeros(6)))


def test_rows_of_unequal_length_are_refused_and_lists_taken():
    model = arm("two-link")
    with raises_at(ShapeError, "gravity_torques: q", "unequal length"):
        aw.gravity_torques(model, [[0.0], [0.0, 0.0]])  # type: ignore[arg-type]
    np.testing.assert_array_equal(
        aw.gravity_torques(model, [0.1, 0.2]), aw.gravity_torques(model, np.array([0.1, 0.2]))
    )


NO_NUMBERS = {
    "text": ["a", "b"],
    "complex": np.array([1j, 2.0]),
    "nothing": [None, 0.0],
    "dates": np.array(["2020-01-01", "2020-01-02"], dtype="datetime64[D]"),
    "masked": np.ma.masked_array([1.0, 2.0], mask=[False, True]),
    "too large": [10**400, 0],
    "symbols of another kind": np.array([object(), 1.0], dtype=object),
}


@pytest.mark.parametrize("value", NO_NUMBERS.values(), ids=NO_NUMBERS)
@pytest.mark.parametrize("name", PLAIN)
def test_something_else_than_numbers_is_refused(name, value):
    given = _arguments(name, 2)
    for argument in given:
        with pytest.raises(ShapeError) as error:
            PUBLIC[name](arm("two-link"), **given | {argument: value})
        assert (error.value.place, error.value.expected) == (f"{name}: {argument}", "numbers")


def test_arrays_of_objects_that_are_numbers_are_taken():
    """As `scalar.zeros` gives them, to be filled with numbers or symbols."""
    q = np.array([np.float64(0.1), 1], dtype=object)
    np.testing.assert_array_equal(aw.mass_matrix(arm("two-link"), q), aw.mass_matrix(arm("two-link"), [0.1, 1.0]))


@pytest.mark.sample(44)
@pytest.mark.parametrize("dtype", ["int8", "float16", "bool", "uint64", ">f8", "longdouble"])
@pytest.mark.parametrize("name", PLAIN)
def test_numbers_of_any_type_are_computed_with_as_floats(name, dtype):
    """Whole numbers of one byte would overflow if they were multiplied as such."""
    given = {argument: np.ones(6) for argument in _arguments(name, 6)}
    wanted = PUBLIC[name](arm("cmu-dd"), **given)
    typed = PUBLIC[name](arm("cmu-dd"), **{key: value.astype(dtype) for key, value in given.items()})
    listed = PUBLIC[name](arm("cmu-dd"), **{key: value.tolist() for key, value in given.items()})
    for found in (typed, listed):
        for a, b in zip(*(each if isinstance(each, tuple) else (each,) for each in (wanted, found)), strict=True):
            np.testing.assert_array_equal(a, b)
