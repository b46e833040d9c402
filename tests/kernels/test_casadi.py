"""The traced functions as CasADi's: names, shapes, values, derivatives."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

import armwright as aw
from armwright.errors import ShapeError
from raises_at import raises_at


@pytest.mark.parametrize(
    "kernel", ["forward_dynamics", "mass_matrix", "forward_kinematics", "jacobian", "motor_torque"]
)
def test_values_and_names(kernel):
    """A casadi.Function with the table's names and matrices in their own shape gives the kernel's values."""
    from armwright.kernels.signatures import SIGNATURES

    dyn = aw.compile(aw.load("puma560"))
    function = dyn.casadi(kernel)
    signature = SIGNATURES[kernel]
    assert function.name_in() == [argument.name for argument in signature.inputs]
    inputs = np.random.default_rng(0).normal(size=(len(signature.inputs), 6))
    expected = getattr(dyn, kernel)(*inputs)
    result = np.array(function(*inputs))
    assert np.allclose(result.reshape(expected.shape) if expected.ndim == 1 else result, expected, rtol=0, atol=1e-10)


def test_derivatives_for_optimal_control():
    """∂q̈/∂tau of the function that a control problem is made of is M⁻¹."""
    arm = aw.load("puma560").replace(friction=None)
    dyn = aw.compile(arm)
    function = dyn.casadi("forward_dynamics")
    q, qd, tau = (casadi.SX.sym(name, 6) for name in ("q", "qd", "tau"))  # type: ignore[arg-type]
    slope = casadi.Function("slope", [q, qd, tau], [casadi.jacobian(function(q, qd, tau), tau)])
    at = np.random.default_rng(1).normal(size=(3, 6))
    assert np.allclose(np.array(slope(*at)) @ dyn.mass_matrix(at[0]), np.eye(6), atol=1e-9)


def test_unknown_name():
    """The nearest names are offered."""
    with raises_at(ShapeError, "kernel", r"\bjacobian\b", value="jacobean"):
        aw.compile(aw.load("two-link")).casadi("jacobean")
