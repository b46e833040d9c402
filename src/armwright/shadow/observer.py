"""Generalised-momentum observer: external torques on an arm that its model does not explain.  [DeLucaMattone2005]

With the momentum p = M(q) q̇ the equations of motion, in which q̈ does not appear, are

    ṗ = tau + C(q, q̇)ᵀ q̇ - g(q) - f(q̇) + tau_ext,    M, C, g and f of the model,

and the residual of [DeLucaMattone2005], [HaddadinEtAl2017] is tau_ext behind a low-pass of bandwidth K:

    ṙ = K (tau_ext - r):   r_k = a r_{k-1} + (1 - a) d_k,   a = e^{-K T},   d_k = (p_k - p_{k-1}) / T - mean over T of the rest.

The position residual is the error of a model that the measured torques drive and that is drawn to the measured motion:

    ë + 2 w ė + w² e = M⁻¹ tau_ext.

Of a joint at rest dry friction takes any torque within its level: that part of d is friction, and no residual. While a joint
turns back, the filtered speed changes its sign later than friction does: what friction may have changed then, leaves r as it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright.errors import ScenarioError, ShapeError
from armwright.identification.validation.torque import motor_shares
from armwright.kernels.compiled import CompiledArm, compile_arm
from armwright.model import BASE, Model
from armwright.shadow.filter import Filtered, SignalFilter, critically_damped

TURN = 3.0  # delays of the filter before and after a joint turns back in which its direction is not certain
KILOGRAM = "one_kilogram_more"  # link of the second model


@dataclass(frozen=True)
class ShadowBandwidths:
    """Settings of the observer.

    Args:
        filter_hz: of the filter that q, q̇ and tau pass.   residual_hz: of the torque residual, K = 2π residual_hz.
        position_hz: of the model that is drawn to the measured motion, w = 2π position_hz.
        rest: [rad/s | m/s] slower is at rest.
    Raises:
        ScenarioError: a value that is not above 0.
    """

    filter_hz: float = 20.0
    residual_hz: float = 5.0
    position_hz: float = 1.0
    rest: float = 0.02

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value < math.inf:
                raise ScenarioError(place=name, value=value, expected="a number above 0")


@dataclass(frozen=True, eq=False)
class Residuals:
    """Rows of the observer.

    Attributes:
        t: (rows,) [s].   torque: (rows, n) [N m | N] r, what acts on the arm beside its model; NaN until the filter has settled.
        position: (rows, n) [rad | m] e; NaN as `torque`.   speed: (rows, n) [rad/s | m/s] filtered.
        kilogram: (rows, n) [N m | N] what r is of 1 kg more at the tip; zeros where the arm has no tip.
        moving: (rows, n) [N m | N] Σ |M_ij q̈_j| + |C_ij q̇_j| behind the low-pass of r: torques that motion asks for, by size.
    """

    t: np.ndarray
    torque: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    kilogram: np.ndarray
    moving: np.ndarray


@dataclass(frozen=True, eq=False)
class _Last:
    """Values of the last row: p, what is known of ṗ, and r, of both models (2, n); torques of motion (n,); e and ė (n,)."""

    t: float
    momentum: np.ndarray
    known: np.ndarray
    residual: np.ndarray
    moving: np.ndarray
    error: tuple[np.ndarray, np.ndarray]


class MomentumObserver:
    """The observer of one arm, fed with blocks of rows of any length.

    Args:
        arm: a full record.   bandwidths: settings.   held: whether torques act until the next row, as commands do.
        heavier: the arm with 1 kg more, for `Residuals.kilogram`; None: it is left out.
    """

    def __init__(
        self, arm: Model, bandwidths: ShadowBandwidths | None = None, held: bool = False, heavier: Model | None = None
    ):
        self.arm, self.bandwidths, self._held = arm, bandwidths or ShadowBandwidths(), held
        self._models = [compile_arm(each) for each in (arm, heavier) if each is not None]
        self._shares = motor_shares(arm)
        self.restart()

    def restart(self) -> None:
        """Forgets all rows; to be called before another run."""
        self._filter = SignalFilter(self.bandwidths.filter_hz, self._held)
        self._last: _Last | None = None
        self._time = -math.inf

    @cached_property
    def dry(self) -> np.ndarray:
        """(n,) [N m | N] dry friction of each joint that has just begun to move, by the model's own friction."""
        still, slow = np.zeros(self.arm.n), np.full(self.arm.n, self.bandwidths.rest)
        forth, back = (self._models[0].inverse_dynamics(still, each, still) @ self._shares for each in (slow, -slow))
        return np.maximum(0.5 * (forth - back), 0.0)

    def update(self, t: np.ndarray, q: np.ndarray, tau: np.ndarray, qd: np.ndarray | None = None) -> Residuals:
        """Residuals at further rows.

        Args:
            t: (rows,) [s] increasing.   q: (rows, n) [rad | m].   tau: (rows, n) [N m | N] of the motors, on the joints.
            qd: (rows, n) [rad/s | m/s] if it is measured; None: from q.
        Returns:
            residuals: one row for each row.
        Raises:
            ShapeError: an array of another shape, or a time that does not increase.
        """
        t, q, tau = (np.asarray(each, dtype=float) for each in (t, q, tau))
        qd = None if qd is None else np.asarray(qd, dtype=float)
        for name, values in (("q", q), ("tau", tau), ("qd", q if qd is None else qd)):
            if t.ndim != 1 or values.shape != (len(t), self.arm.n):
                raise ShapeError(place=name, value=str(values.shape), expected=f"({t.size}, {self.arm.n})")
        late = np.flatnonzero(~(np.diff(t, prepend=self._time) > 0.0))
        if len(late):
            raise ShapeError("does not increase", place="t", value=float(t[late[0]]))
        self._time = float(t[-1]) if len(t) else self._time
        return self._observed(t, self._filter.rows(t, q, tau, qd))

    def _observed(self, t: np.ndarray, rows: Filtered) -> Residuals:
        """The recursion over filtered rows, from where the last block ended."""
        terms = [self._terms(model, rows) for model in self._models]
        momentum, known = (np.stack([each[k] for each in terms], axis=1) for k in (0, 1))  # (rows, models, n)
        known += rows.tau[:, None]
        inertia, coriolis = terms[0][2:]
        moving = _times(np.abs(inertia), np.abs(rows.qdd)) + _times(np.abs(coriolis), np.abs(rows.qd))
        slow = np.abs(rows.qd)
        turning = slow < TURN * self._filter.delay * np.abs(rows.qdd)
        dry = np.where(turning | (slow < self.bandwidths.rest), self.dry, 0.0)
        compliance, hz = np.linalg.inv(inertia), 2.0 * math.pi * self.bandwidths.residual_hz
        w = 2.0 * math.pi * self.bandwidths.position_hz
        found = np.full((4, *rows.q.shape), np.nan)
        found[2:] = 0.0
        last = self._last
        for k, settled in enumerate(rows.settled):
            if not settled:
                last = None
                continue
            if last is None:
                still = np.zeros_like(rows.q[k])
                last = _Last(t[k], momentum[k], known[k], np.zeros_like(momentum[k]), moving[k], (still, still))
            else:
                step = t[k] - last.t
                acting = (momentum[k] - last.momentum) / step - 0.5 * (known[k] + last.known)
                news = acting[0] - np.where(turning[k], last.residual[0], 0.0)
                acting -= np.minimum(
                    np.maximum(news, -dry[k]), dry[k]
                )  # of both models: their difference is that of 1 kg
                keep = math.exp(-hz * step)
                residual = keep * last.residual + (1.0 - keep) * acting
                sway = keep * last.moving + (1.0 - keep) * moving[k]
                (a, b), (c, d) = critically_damped(w, step)
                goal = compliance[k] @ acting[0] / w**2  # exact for an acceleration that holds over the step
                off, rate = last.error[0] - goal, last.error[1]
                last = _Last(
                    t[k], momentum[k], known[k], residual, sway, (goal + a * off + b * rate, c * off + d * rate)
                )
            found[0, k], found[1, k], found[3, k] = last.residual[0], last.error[0], last.moving
            if len(terms) > 1:
                found[2, k] = last.residual[0] - last.residual[1]
        self._last = last
        return Residuals(t, found[0], found[1], rows.qd, found[2], found[3])

    def _terms(self, model: CompiledArm, rows: Filtered) -> tuple[np.ndarray, ...]:
        """p, Cᵀ q̇ - g - f, M and C. f includes what gears lose, so that p alone holds the inertia: f = ID(q, q̇, q̈) - M q̈ - …"""
        inertia, coriolis = model.mass_matrix(rows.q), model.coriolis_matrix(rows.q, rows.qd)
        others = model.inverse_dynamics(rows.q, rows.qd, rows.qdd) @ self._shares - _times(
            inertia, rows.qdd
        )  # C q̇ + g + f
        both = coriolis + np.swapaxes(coriolis, -1, -2)
        return _times(inertia, rows.qd), _times(both, rows.qd) - others, inertia, coriolis


def with_kilogram(arm: Model) -> Model | None:
    """The arm with a point mass of 1 kg at its tip; None without a tip or if its numbers are not those of a record."""
    if arm.description is None or arm.tip is None or arm.frame().body == BASE:
        return None
    return arm.with_payload(1.0, np.zeros(3), np.zeros((3, 3)), name=KILOGRAM)


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products (rows, n) of matrices (rows, n, n) and vectors (rows, n)."""
    return np.einsum("kij,kj->ki", matrices, vectors)
