"""Base parameters of an arm under feedback: instrumental variables, and output error of the torque.

The controller brings noise of the measured positions into the torques, and differentiated noise is in the regressor: plain
least squares of such rows is biased. Two answers simulate the loop with the parameters at hand, without noise:

- IDIM-IV [JanotVandanjonGautier2014]: the simulated motion's regressor Z is the instrument,  β ← (Zᵀ W Y)⁻¹ Zᵀ W τ.
- DIDIM [GautierJanotVandanjon2013]: needs torques only,  β ← (Zᵀ W Z)⁻¹ Zᵀ W τ,  the Gauss-Newton step of |τ − τ_s(β)|²: a loop
  that follows its reference moves almost the same whatever the parameters are, so ∂τ_s/∂β ≈ Z.

The simulated loop is base parameters alone: M and h of  M q̈ + h = Y β  follow from the regressor, which is affine in q̈. A record
of the whole arm, as `aw.simulate` takes it, would need numbers that no torque tells.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Literal

import numpy as np
from scipy.signal import sosfiltfilt

from armwright.errors import IdentificationError
from armwright.identification.arm.base import BaseParameters
from armwright.identification.arm.correlation import correlated
from armwright.identification.arm.equations import Samples
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.preparation import low_pass

MOST = 30  # iterations
SETTLED = 1e-3  # of a standard deviation: less is no change
FASTEST = 1e6  # rad/s or m/s
LEAST_INERTIA = 1e-6  # of the largest eigenvalue of M: smaller ones are taken for it, so that bad parameters still move
SETTLING = 2.0  # periods of the low-pass's cut-off
RUNAWAY = 1e4  # rad or m: a simulation that has diverged

Signals = Callable[
    [np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]
]  # t (k,) → q, q̇, q̈ of the reference, each (k, n)


@dataclass(frozen=True, eq=False)
class Feedback:
    """A sampled controller:  u = kp (q_r − q) + kd (q̇_r − q̇) + Y(q_r, q̇_r, q̈_r) β where `feedforward`.

    Where the log's own controller is not known, the reference may be the logged positions, low-passed, with gains of any loop
    that follows them closely: then the instruments keep some of the log's own noise, below the cut-off.

    Attributes:
        reference: function of time.   kp: (n,) [N m/rad | N/m].   kd: (n,) [N m s/rad | N s/m].   period: [s] of the loop.
        feedforward: whether the torque of the reference by the parameters at hand is added.
        steps: of the integrator in one period.   begin: [s] when the log's loop stood on its reference; None: at its first row.
        speed: "exact", or "difference" of two positions, half a period old, as most drives have it.
        cutoff: of the low-pass, in Hz, that the rows went through, which the simulated ones pass too; None: none.   order: of it.
    """

    reference: Signals
    kp: np.ndarray
    kd: np.ndarray
    period: float
    feedforward: bool = False
    steps: int = 1
    begin: float | None = None
    speed: Literal["exact", "difference"] = "exact"
    cutoff: float | None = None
    order: int = 4


def simulated_loop(
    model: TorqueModel, parameters: np.ndarray, feedback: Feedback, begin: float, end: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ticks t (k,) and q, q̇, q̈ and torque (k, n) of the loop, just after each; by Runge and Kutta's rule of order 4.

    Args:
        model: of the arm.   parameters: (p,) of its columns.   feedback: the loop.   begin, end: [s]; it begins on its reference.
    Raises:
        IdentificationError: the simulated loop diverges: with these parameters the controller does not hold the arm.
    """
    n, h = model.arm.n, feedback.period / feedback.steps
    times = begin + feedback.period * np.arange(ceil((end - begin) / feedback.period - 1e-9) + 1)
    q_r, qd_r, qdd_r = feedback.reference(times)
    ahead = np.zeros((len(times), n))
    if feedback.feedforward:
        ahead = model.rows(q_r, qd_r, qdd_r) @ parameters + model.known_torques(q_r)
    q, qd = q_r[0].copy(), qd_r[0].copy()
    kept = np.zeros((4, len(times), n))
    for k in range(len(times)):
        if not (np.abs(q) < RUNAWAY).all():
            expected = "parameters and gains with which the loop is stable"
            raise IdentificationError(f"the simulated loop diverges after {times[k] - begin:.3g} s", expected=expected)
        speed = qd if feedback.speed == "exact" or k == 0 else (q - kept[0, k - 1]) / feedback.period
        tau = feedback.kp * (q_r[k] - q) + feedback.kd * (qd_r[k] - speed) + ahead[k]
        kept[:, k] = q, qd, _acceleration(model, parameters, q, qd, tau), tau
        for _ in range(feedback.steps):
            a1 = _acceleration(model, parameters, q, qd, tau)
            a2 = _acceleration(model, parameters, q + 0.5 * h * qd, qd + 0.5 * h * a1, tau)
            a3 = _acceleration(model, parameters, q + 0.5 * h * qd + 0.25 * h * h * a1, qd + 0.5 * h * a2, tau)
            a4 = _acceleration(model, parameters, q + h * qd + 0.5 * h * h * a2, qd + h * a3, tau)
            q = q + h * qd + h * h / 6 * (a1 + a2 + a3)
            qd = qd + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return times, kept[0], kept[1], kept[2], kept[3]


def _acceleration(
    model: TorqueModel, parameters: np.ndarray, q: np.ndarray, qd: np.ndarray, tau: np.ndarray
) -> np.ndarray:
    """q̈ (n,) = M⁻¹ (tau − h), M and h from n + 1 rows of the regressor."""
    n = len(q)
    qd = np.clip(qd, -FASTEST, FASTEST)  # of a loop that diverges, whose squares would overflow
    directions = np.concatenate([np.zeros((1, n)), np.eye(n)])
    torques = model.rows(np.tile(q, (n + 1, 1)), np.tile(qd, (n + 1, 1)), directions) @ parameters
    bias = torques[0] + model.known_torques(q[None])[0]
    M = (torques[1:] - torques[0]).T
    w, V = np.linalg.eigh(0.5 * (M + M.T))
    w = np.maximum(w, LEAST_INERTIA * max(float(w[-1]), np.finfo(float).tiny))
    return V @ ((V.T @ (tau - bias)) / w)


@dataclass(frozen=True, eq=False)
class ClosedLoopFit:
    """Base parameters from a log under feedback.

    Attributes:
        values: β (b,).   covariance: (b, b), robust against residuals that are correlated in time and between joints.
        weights: (n,) of the joints.   rms: (n,) of the residuals [N m | N].   iterations: that were needed.   settled: whether
            the last one changed nothing that counts.   method: "idim-iv" or "didim".   start: β (b,) where it began.
    """

    values: np.ndarray
    covariance: np.ndarray
    weights: np.ndarray
    rms: np.ndarray
    iterations: int
    settled: bool
    method: Literal["idim-iv", "didim"]
    start: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """(b,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def fit_closed_loop(
    samples: Sequence[Samples],
    model: TorqueModel,
    base: BaseParameters,
    feedback: Feedback,
    start: np.ndarray,
    method: Literal["idim-iv", "didim"] = "idim-iv",
) -> ClosedLoopFit:
    """Base parameters by IDIM-IV or DIDIM, with joints weighted by their residuals.

    Args:
        samples: prepared rows; "didim" reads their times and torques only, those that act from a row on.
        model: of the arm.   base: regrouping.
        feedback: the log's loop, or one that follows the logged positions.   start: β (b,), as of least squares or of CAD.
        method: "idim-iv" or "didim".
    Raises:
        IdentificationError: a simulated loop that diverges, too few rows, parameters that the motion cannot tell.
    """
    if method not in ("idim-iv", "didim"):
        raise IdentificationError(place="method", value=method, choices=("idim-iv", "didim"))
    tau = np.concatenate([each.tau - _known(model, each, feedback, method) for each in samples])
    if len(tau) * model.arm.n <= len(base):
        expected = f"more than {len(base)}, the number of base parameters"
        raise IdentificationError("too few rows", place="log", value=len(tau), expected=expected)
    measured = None
    if method == "idim-iv":
        measured = np.concatenate([model.rows(s.q, s.qd, s.qdd)[:, :, base.independent] for s in samples])
    values, weights = np.asarray(start, dtype=float), np.ones(model.arm.n)
    covariance, rest, settled, count = np.zeros((len(base),) * 2), tau, False, 0
    while not settled and count < MOST:
        count += 1
        Z = np.concatenate([_instruments(model, base, values, feedback, each.t) for each in samples])
        Y = Z if measured is None else measured
        new = _solved(Z, Y, tau, weights)
        rest = tau - Y @ new
        weights = 1.0 / np.maximum(np.mean(rest**2, axis=0), np.finfo(float).tiny)
        bread = np.linalg.inv(np.einsum("tjb,j,tjc->bc", Z, weights, Y))
        covariance = correlated(lambda Z=Z, rest=rest: [(Z, rest)], weights, bread).covariance
        change = np.abs(new - values) / np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        values = new
        settled = bool(change.max() < SETTLED)
    return ClosedLoopFit(values, covariance, weights, np.sqrt(np.mean(rest**2, axis=0)), count, settled, method, start)


def _instruments(
    model: TorqueModel, base: BaseParameters, values: np.ndarray, feedback: Feedback, t: np.ndarray
) -> np.ndarray:
    """Z (k, n, b): the base columns of the simulated motion at times t (k,), low-passed as the log was."""
    begin = t[0] if feedback.begin is None else feedback.begin
    beyond = 0.0 if feedback.cutoff is None else SETTLING / feedback.cutoff  # where the filter's own end would be felt
    times, q, qd, qdd, _ = simulated_loop(model, base.expanded(values), feedback, begin, t[-1] + beyond)
    Z = model.rows(q, qd, qdd)[:, :, base.independent]
    if feedback.cutoff is not None:
        Z = sosfiltfilt(low_pass(feedback.order, feedback.cutoff, 1.0 / feedback.period), Z, axis=0)
    after = np.clip(np.searchsorted(times, t), 1, len(times) - 1)
    share = ((t - times[after - 1]) / feedback.period)[:, None, None]
    return (1 - share) * Z[after - 1] + share * Z[after]


def _known(model: TorqueModel, samples: Samples, feedback: Feedback, method: str) -> np.ndarray:
    """Torques of the record's springs at the measured positions, or at the reference where these are not used."""
    return model.known_torques(samples.q if method == "idim-iv" else feedback.reference(samples.t)[0])


def _solved(Z: np.ndarray, Y: np.ndarray, tau: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """β of  Zᵀ W (τ − Y β) = 0,  through the QR decomposition of Z: its columns are scaled and made orthogonal."""
    root = np.sqrt(weights)[:, None]
    stacked = [(root * each).reshape(-1, each.shape[2]) for each in (Z, Y)]
    size = np.linalg.norm(stacked[0], axis=0)
    if not (size > 0).all():
        raise IdentificationError("columns that the simulated motion does not excite", place="reference")
    Q, _ = np.linalg.qr(stacked[0] / size)
    matrix = Q.T @ (stacked[1] / size)
    if np.linalg.cond(matrix) > 1e12:
        raise IdentificationError("parameters that this motion cannot tell apart", place="reference")
    return np.linalg.solve(matrix, Q.T @ (root[:, 0] * tau).ravel()) / size
