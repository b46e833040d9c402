"""Forward dynamics takes the way with fewer operations, and derivatives end where they are no longer offered."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.dynamics import articulated_body, composite_body, forward_dynamics, inverse_dynamics
from armwright.errors import ModelError
from armwright.kernels.signatures import SIGNATURES
from armwright.model.simplify import simplified
from armwright.program import trace
from raises_at import raises_at
from reference.chains import chain


@pytest.mark.parametrize(("n", "way"), [(6, composite_body), (9, composite_body), (10, articulated_body)])
def test_the_way_taken(n, way):
    """Bodies of a chain of 10 stand 5.5 joints from the base on average."""
    arm = chain(n)
    q, qd, tau = np.random.default_rng(n).normal(size=(3, n))
    np.testing.assert_array_equal(forward_dynamics(arm, q, qd, tau), way(arm, q, qd, tau))


@pytest.mark.parametrize("straight", [False, True])
@pytest.mark.parametrize("n", [6, 8, 11, 14])
def test_the_way_taken_is_the_cheaper(n, straight):
    """By the operations of the traced programs, within a twentieth."""
    arm = simplified(chain(n, straight=straight))
    inputs: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "qd", "tau"), (n,))

    def operations(way) -> int:
        return trace("f", lambda *x: way(arm, *x), inputs, ("qdd",)).operation_counts().total()

    assert operations(forward_dynamics) <= 1.05 * min(operations(composite_body), operations(articulated_body))


@pytest.mark.parametrize("n", [12, 30, 60])
def test_long_chains_are_inverted(n):
    """q̈ → tau → q̈, and torques met to rounding of their size, in M that is ever worse conditioned."""
    arm = chain(n)
    q, qd, qdd = np.random.default_rng(n).normal(size=(3, n))
    tau = inverse_dynamics(arm, q, qd, qdd)
    back = inverse_dynamics(arm, q, qd, forward_dynamics(arm, q, qd, tau))
    assert np.abs(back - tau).max() <= 1e-9 * np.abs(tau).max()


def test_derivatives_end_at_thirty_joints():
    """One line that names arm, kernel and limit, before anything is traced; the rest of the arm's kernels go on."""
    long = chain(31)
    dyn = aw.compile(long)
    limited = [name for name, signature in SIGNATURES.items() if signature.most_joints is not None]
    assert {"inverse_dynamics_derivatives", "forward_dynamics_derivatives", "forward_arm_linearised"} <= set(limited)
    q = np.zeros(31)
    for name in limited:
        inputs = [q] * len(SIGNATURES[name].inputs)
        for call in (lambda name=name, inputs=inputs: getattr(dyn, name)(*inputs), lambda name=name: dyn.casadi(name)):
            with raises_at(ModelError, f"chain31: joints of {name}", "30 or fewer", value=31):
                call()
        assert "more than 30 joints" in getattr(aw.CompiledArm, name).__doc__
    assert dyn.gravity_torques(q).shape == (31,)
