"""Derivatives of programs and kernels against closed forms and against differences."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.errors import ShapeError
from armwright.program import interpret, trace
from armwright.program.derivative import derivative, with_tangents
from physics.arms import random_state


def two(a, b):
    return scalar.array([a[0] * b[0], scalar.sin(a[1]) + b[0] * b[1]]), scalar.array([a[0] ** 2])


PROGRAM = trace("two", two, {"a": (2,), "b": (2,)}, ("y", "z"))
A, B = np.array([0.3, -0.7]), np.array([1.2, 0.4])
BY_A = np.array([[B[0], 0.0], [0.0, np.cos(A[1])]]), np.array([[2 * A[0], 0.0]])
BY_B = np.array([[A[0], 0.0], [B[1], B[0]]])


def test_slopes_stand_behind_the_outputs():
    program = derivative(PROGRAM, "a")
    assert [(port.name, port.shape) for port in program.outputs] == [
        ("y", (2,)), ("z", (1,)), ("dy_da", (2, 2)), ("dz_da", (1, 2)),
    ]  # fmt: skip
    y, z, dy, dz = interpret(program, A, B)
    np.testing.assert_allclose(np.concatenate([y, z]), np.concatenate(two(A, B)), rtol=1e-15)
    np.testing.assert_allclose(dy, BY_A[0], rtol=1e-15)
    np.testing.assert_allclose(dz, BY_A[1], rtol=1e-15)


def test_tangents_are_carried_along():
    """ẏ = ∂y/∂a ȧ + ∂y/∂b ḃ, with ȧ an input and ḃ a constant."""
    tangent, seed = np.array([[1.0, 2.0, 0.5], [0.0, -1.0, 3.0]]), np.array([[0.0, 1.0, 0.0], [2.0, 0.0, 1.0]])
    program = with_tangents(PROGRAM, ["a"], {"b": seed}, 3)
    y, _ = interpret(program, np.concatenate([A, tangent.ravel()]), B)
    np.testing.assert_allclose(y[2:].reshape(2, 3), BY_A[0] @ tangent + BY_B @ seed, rtol=1e-14)


def test_through_a_program_that_is_called():
    inner = trace("inner", lambda a: scalar.array([a[0] * a[1], scalar.exp(a[0])]), {"a": (2,)}, ("v",), noinline=True)
    from armwright.program import call

    outer = trace("outer", lambda a: scalar.array([call(inner, a)[0] + call(inner, 2.0 * a)[1]]), {"a": (2,)}, ("w",))
    _, slope = interpret(derivative(outer, "a"), A)
    np.testing.assert_allclose(slope, [[A[1] + 2.0 * np.exp(2.0 * A[0]), A[0]]], rtol=1e-14)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["inverse_dynamics", "gravity_torques", "mass_matrix"])
def test_kernels_by_parameters(name):
    arm = aw.load("puma560")
    dyn = aw.compile(arm, vary=["link2.mass_kg", "link3.com_m", "elbow.motor.rotor_inertia_kg_m2"])
    kernel, parameters = dyn.derivative(name, "parameters"), dyn.varied.nominal
    states = [random_state(arm, k, 4) for k in range(3)][: {"inverse_dynamics": 3}.get(name, 1)]
    value, slope = kernel(*states, parameters)
    plain = getattr(dyn, name)
    np.testing.assert_allclose(value, plain(*states, parameters), rtol=1e-12, atol=1e-12)
    assert slope.shape == (*value.shape, 5)
    for k in range(5):
        step = np.zeros(5)
        step[k] = 1e-4 * max(abs(parameters[k]), 1e-3)
        change = (plain(*states, parameters + step) - plain(*states, parameters - step)) / (2.0 * step[k])
        np.testing.assert_allclose(slope[..., k], change, rtol=1e-6, atol=1e-6)


def test_kernels_by_their_own_inputs():
    arm = aw.load("two-link")
    dyn = aw.compile(arm)
    q, qd, qdd = (random_state(arm, k, 3) for k in range(3))
    _, slope = dyn.derivative("inverse_dynamics", "q")(q, qd, qdd)
    np.testing.assert_allclose(slope, dyn.inverse_dynamics_derivatives(q, qd, qdd)[0], rtol=1e-12, atol=1e-12)
    with pytest.raises(ShapeError) as error:
        dyn.derivative("inverse_dynamics", "tau")
    assert (error.value.value, error.value.choices) == ("tau", ("q", "qd", "qdd"))
