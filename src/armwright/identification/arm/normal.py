"""Normal equations of very many states: a kernel of the base columns alone, and one symmetric product for each joint.

Y = Y_b A, so that  YᵀWY = Aᵀ (Y_bᵀ W Y_b) A  with products of the base columns only. They lose half of the digits of the
triangular factors, which fits use; this is for what needs speed, such as the design of motions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg.blas import dsyrk  # pyright: ignore[reportAttributeAccessIssue]

from armwright.dynamics import regressor
from armwright.identification.arm.base import BaseParameters, base_parameters
from armwright.identification.arm.torque_model import TorqueModel
from armwright.model import Model

ROWS = 1024  # states at once: their columns stay in the cache


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Accumulates YᵀWY, YᵀWτ and τᵀWτ of an arm's inertial regressor over states.

    Attributes:
        model: of the arm, without drive columns.   threads: that share a block.
    """

    model: TorqueModel
    threads: int = 1

    @cached_property
    def base(self) -> BaseParameters:
        """Base parameters of the structure."""
        return base_parameters(self.model)

    @cached_property
    def columns(self) -> list[np.ndarray]:
        """For each joint, indices of the base columns on which its torque depends."""
        return [np.array([k for k in self.base.independent if used[k]], dtype=int) for used in self.model.of_joint]

    @cached_property
    def _kernel(self) -> Any:
        """(q, q̇, q̈) → for each joint the values (rows, k_j) of its columns."""
        from armwright.kernels.batch import Kernel
        from armwright.program import trace

        arm, columns = self.model.arm, [each for each in self.columns if len(each)]
        joints = [j for j, each in enumerate(self.columns) if len(each)]

        def of_joints(q: Any, qd: Any, qdd: Any) -> tuple[Any, ...]:
            values = regressor(arm, q, qd, qdd)
            return tuple(values[j, each] for j, each in zip(joints, columns, strict=True))

        n, outputs = (arm.n,), tuple(f"Y{j}" for j in joints)
        program = trace("base_regressor", of_joints, {"q": n, "qd": n, "qdd": n}, outputs)
        dyn = self.model.dyn
        return Kernel(program, dyn.target, None, dyn.format)

    def __call__(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, tau: np.ndarray, weights: np.ndarray | None = None
    ) -> np.ndarray:
        """G (p + 1, p + 1) = [Y τ]ᵀ W [Y τ].

        Args:
            q: (rows, n) [rad | m].   qd: (rows, n) [rad/s | m/s].   qdd: (rows, n) [rad/s² | m/s²].
            tau: (rows, n) [N m | N].   weights: (n,) of the joints' squares; None: 1.
        """
        kernel, chosen = self._kernel, [j for j, each in enumerate(self.columns) if len(each)]
        blocks = [np.empty((ROWS, len(self.columns[j]))) for j in chosen]
        grams = [np.zeros((block.shape[1],) * 2, order="F") for block in blocks]
        right = [np.zeros(block.shape[1]) for block in blocks]
        for begin in range(0, len(q), ROWS):
            end = min(begin + ROWS, len(q))
            values = [block[: end - begin] for block in blocks]
            kernel(q[begin:end], qd[begin:end], qdd[begin:end], out=tuple(values), threads=self.threads)
            for i, each in enumerate(values):
                grams[i] = dsyrk(1.0, each.T, beta=1.0, c=grams[i], overwrite_c=1)
                right[i] += tau[begin:end, chosen[i]] @ each
        b, place = len(self.base), {int(k): i for i, k in enumerate(self.base.independent)}
        total = np.zeros((b + 1, b + 1))
        for i, j in enumerate(chosen):
            weight = 1.0 if weights is None else float(weights[j])
            at = [place[int(k)] for k in self.columns[j]]
            upper = np.triu(grams[i])
            total[np.ix_(at, at)] += weight * (upper + np.triu(upper, 1).T)
            total[at, b] += weight * right[i]
        total[b, :b] = total[:b, b]
        total[b, b] = (np.ones(len(tau.T)) if weights is None else weights) @ (tau**2).sum(axis=0)
        back = np.zeros((b + 1, len(self.model) + 1))
        back[:b, :-1], back[b, -1] = self.base.matrix, 1.0
        return back.T @ total @ back


def normal_equations(arm: Model) -> NormalEquations:
    """Normal equations of an arm's inertial parameters, a function of states.

    Args:
        arm: a full record, or kinematics alone.
    """
    from armwright.identification.arm.torque_model import torque_model

    return NormalEquations(torque_model(arm, friction=(), lacks=("rotors",)))
