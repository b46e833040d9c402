"""Regressor of an arm's motor torques by its base parameters, as numbers and as a function of CasADi."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi
import numpy as np

from armwright.errors import ScenarioError, check_known
from armwright.identification.arm.base import BaseParameters, base_parameters
from armwright.identification.arm.torque_model import USUAL_FRICTION, TorqueModel, torque_model
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model

DRIVES = ("rotor", *USUAL_FRICTION)  # columns beside those of the links


@dataclass(frozen=True, eq=False)
class BaseRegressor:
    """The independent columns of an arm's regressor.

    Attributes:
        model: of all columns.   base: which of them are independent.
        smoothing: (n,) speed that smooths Coulomb's sign where derivatives are taken [rad/s | m/s].
    """

    model: TorqueModel
    base: BaseParameters
    smoothing: np.ndarray

    @classmethod
    def of(cls, arm: Model, drives: Sequence[str], smoothing: np.ndarray) -> BaseRegressor:
        """The base regressor of an arm.

        Args:
            arm: a full record, or kinematics alone.   drives: of "rotor", "viscous", "coulomb", "offset".   smoothing: as above.
        Raises:
            ScenarioError: an unknown drive term.
        """
        for k, each in enumerate(drives):
            check_known(ScenarioError, each, DRIVES, "unknown", place=f"drives[{k}]")
        lacks = () if "rotor" in drives else ("rotors",)
        model = torque_model(arm, friction=[each for each in USUAL_FRICTION if each in drives], lacks=lacks)
        return cls(model, base_parameters(model), smoothing)

    def __len__(self) -> int:
        return len(self.base)

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) short names of the base parameters."""
        return tuple(self.base.names)

    def rows(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Y (rows, n, p) at states q, q̇, q̈, each (rows, n), by the compiled regressor."""
        return self.model.rows(q, qd, qdd)[:, :, self.base.independent]

    def information(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Σ YᵀY (p, p) over states q, q̇, q̈, each (rows, n)."""
        rows = self.rows(q, qd, qdd).reshape(-1, len(self))
        return rows.T @ rows

    def graph(self) -> casadi.Function:
        """(q, q̇, q̈) → Yᵀ (p, n), each state (n,), traced from the same dynamics, with Coulomb's sign smoothed."""
        n = self.model.arm.n
        q, qd, qdd = (casadi.SX.sym(name, n) for name in ("q", "qd", "qdd"))
        inertial = trace_kernel(self.model.arm, SIGNATURES["regressor"]).graph(q, qd, qdd)
        rows = [casadi.reshape(inertial, 10 * len(self.model.arm.bodies), n)]  # row-major Y is column-major Yᵀ
        for column in self.model.columns[rows[0].shape[0] :]:
            shares = np.zeros(n)
            for j, share in column.turned:
                shares[j] = share
            shared = casadi.DM(shares)
            x = casadi.dot(shared, qdd if column.kind == "rotor" else qd)
            if column.kind == "coulomb":
                width = max(self.smoothing[j] * abs(share) for j, share in column.turned)
                x = x / casadi.sqrt(x * x + width**2)
            rows.append((casadi.SX(1.0) if column.kind == "offset" else x) * shared.T)
        chosen = [int(k) for k in self.base.independent]
        return casadi.Function("columns", [q, qd, qdd], [casadi.densify(casadi.vertcat(*rows)[chosen, :])])
