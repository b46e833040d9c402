"""Base parameters of an arm under feedback: instrumental variables, and output error of the torque.

The controller brings noise of the measured positions into the torques, and differentiated noise is in the regressor: plain
least squares of such rows is biased. Three answers simulate the loop with the parameters at hand, without noise:

- IDIM-IV [JanotVandanjonGautier2014]: the simulated motion's regressor Z is the instrument,  β ← (Zᵀ W Y)⁻¹ Zᵀ W τ.
- DIDIM [GautierJanotVandanjon2013]: needs torques only,  β ← (Zᵀ W Z)⁻¹ Zᵀ W τ,  the Gauss-Newton step of |τ − τ_s(β)|²: a loop
  that follows its reference moves almost the same whatever the parameters are, so ∂τ_s/∂β ≈ Z.
- CLOE [JanotEtAl2014]: needs positions only,  β ← β + (Jᵀ W J)⁻¹ Jᵀ W (q − q_s(β)),  J = ∂q_s/∂β by differences: what the loop
  does not follow shows the parameters, so soft loops tell more than stiff ones, and the gains must be the log's own.

The simulated loop is base parameters alone: M and h of  M q̈ + h = Y β  follow from the regressor, which is affine in q̈. A record
of the whole arm, as `aw.simulate` takes it, would need numbers that no torque tells.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import sosfiltfilt

from armwright.errors import IdentificationError, check_known
from armwright.fitting.covariance import correlated
from armwright.fitting.measures import rms
from armwright.identification.arm.base import BaseParameters
from armwright.identification.arm.equations import Samples, SampleSource
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.preparation import Preparation, low_pass

MOST = 30  # iterations
SETTLED = 1e-3  # of a standard deviation: less is no change
FASTEST = 1e6  # rad/s or m/s
LEAST_INERTIA = 1e-6  # of the largest eigenvalue of M: smaller ones are taken for it, so that bad parameters still move
SETTLING = 2.0  # periods of the low-pass's cut-off
RUNAWAY = 1e4  # rad or m: a simulation that has diverged
STEP = 1e-3  # of a parameter, and of the largest one's step, that positions are differenced over

ClosedLoopMethod = Literal["idim-iv", "didim", "cloe"]
CLOSED_LOOP = ("idim-iv", "didim", "cloe")

# t (k,) → q, q̇, q̈ of the reference, each (k, n)
Signals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


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


def following(samples: Sequence[Samples], kp: np.ndarray, kd: np.ndarray, period: float) -> Feedback:
    """The loop of a controller with an unlogged reference: the logged positions, as a cubic spline, replace it.

    Args:
        samples: prepared rows of one run.   kp: (n,) [N m/rad | N/m].   kd: (n,) [N m s/rad | N s/m].   period: [s].
    """
    t, q = (np.concatenate([getattr(each, name) for each in samples]) for name in ("t", "q"))
    path = CubicSpline(t, q)

    def reference(at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        inside = np.clip(at, t[0], t[-1])
        moves = (inside == at)[:, None]
        return path(inside), path(inside, 1) * moves, path(inside, 2) * moves

    return Feedback(reference, np.asarray(kp, dtype=float), np.asarray(kd, dtype=float), period)


def feedback_of(
    feedback: Feedback | tuple[Any, Any, float], source: SampleSource, prepared: Preparation, n: int
) -> Feedback:
    """The log's loop, with the low-pass that its rows went through.

    Args:
        feedback: the loop, or (kp, kd, period) of one.   source: rows of the log.   prepared: of them.   n: joints.
    Raises:
        IdentificationError: gains of another number of joints, or a period that is not above 0.
    """
    if isinstance(feedback, Feedback):
        return replace(feedback, cutoff=prepared.cutoff, order=prepared.order)
    kp, kd, period = feedback
    for place, gains in (("feedback kp", kp), ("feedback kd", kd)):
        if np.size(gains) not in (1, n) or not np.isfinite(np.asarray(gains, dtype=float)).all():
            raise IdentificationError(place=place, value=gains, expected=f"{n} numbers, one for each joint")
    if not period > 0:
        raise IdentificationError(place="feedback period", value=period, expected="a number above 0 [s]")
    loop = following(list(source()), np.broadcast_to(kp, n), np.broadcast_to(kd, n), period)
    return replace(loop, cutoff=prepared.cutoff, order=prepared.order)


def simulated_loop(
    model: TorqueModel, parameters: np.ndarray, feedback: Feedback, begin: float, end: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ticks t (k,), and q, q̇, q̈ and torque (k, …, n) of loops just after each tick; Runge and Kutta's rule of order 4.

    Args:
        model: of the arm.   parameters: (…, p) of its columns, a row for each loop.   feedback: that all of them have.
        begin, end: [s]; loops begin on their reference.
    Raises:
        IdentificationError: the simulated loop diverges: with these parameters the controller does not hold the arm.
    """
    lanes, n, h = np.atleast_2d(parameters), model.arm.n, feedback.period / feedback.steps
    times = begin + feedback.period * np.arange(ceil((end - begin) / feedback.period - 1e-9) + 1)
    q_r, qd_r, qdd_r = feedback.reference(times)
    ahead = np.zeros((len(times), len(lanes), n))
    if feedback.feedforward:
        ahead = np.einsum("tnp,lp->tln", model.rows(q_r, qd_r, qdd_r), lanes)
        ahead = ahead + model.known_torques(q_r, qd_r, qdd_r)[:, None]
    q, qd = (np.tile(each[0], (len(lanes), 1)) for each in (q_r, qd_r))
    kept = np.zeros((4, len(times), len(lanes), n))
    for k in range(len(times)):
        if not (np.abs(q) < RUNAWAY).all():
            expected = "parameters and gains with which the loop is stable"
            raise IdentificationError(f"the simulated loop diverges after {times[k] - begin:.3g} s", expected=expected)
        speed = qd if feedback.speed == "exact" or k == 0 else (q - kept[0, k - 1]) / feedback.period
        tau = feedback.kp * (q_r[k] - q) + feedback.kd * (qd_r[k] - speed) + ahead[k]
        kept[:, k] = q, qd, _accelerations(model, lanes, q, qd, tau), tau
        for _ in range(feedback.steps):
            a1 = _accelerations(model, lanes, q, qd, tau)
            a2 = _accelerations(model, lanes, q + 0.5 * h * qd, qd + 0.5 * h * a1, tau)
            a3 = _accelerations(model, lanes, q + 0.5 * h * qd + 0.25 * h * h * a1, qd + 0.5 * h * a2, tau)
            a4 = _accelerations(model, lanes, q + h * qd + 0.5 * h * h * a2, qd + h * a3, tau)
            q = q + h * qd + h * h / 6 * (a1 + a2 + a3)
            qd = qd + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    kept = kept.reshape(4, len(times), *np.shape(parameters)[:-1], n)
    return times, kept[0], kept[1], kept[2], kept[3]


def _accelerations(model: TorqueModel, lanes: np.ndarray, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """q̈ (lanes, n) = M⁻¹ (tau − h), M and h from n + 1 rows of the regressor for each row of parameters (lanes, p)."""
    count, n = q.shape
    qd = np.clip(qd, -FASTEST, FASTEST)  # of a loop that diverges, whose squares would overflow
    directions = np.tile(np.concatenate([np.zeros((1, n)), np.eye(n)]), (count, 1))
    rows = model.rows(np.repeat(q, n + 1, axis=0), np.repeat(qd, n + 1, axis=0), directions)
    torques = np.einsum("ldnp,lp->ldn", rows.reshape(count, n + 1, n, -1), lanes)
    bias = torques[:, 0] + model.known_torques(q, qd, np.zeros_like(q))
    M = np.swapaxes(torques[:, 1:] - torques[:, :1], 1, 2)
    w, V = np.linalg.eigh(0.5 * (M + np.swapaxes(M, 1, 2)))
    w = np.maximum(w, LEAST_INERTIA * np.maximum(w[:, -1:], np.finfo(float).tiny))
    return np.einsum("lij,lj->li", V, np.einsum("lij,li->lj", V, tau - bias) / w)


@dataclass(frozen=True, eq=False)
class ClosedLoopFit:
    """Base parameters from a log under feedback.

    Attributes:
        values: β (b,).   covariance: (b, b), robust against residuals that are correlated in time and between joints.
        weights: (n,) of the joints.   rms: (n,) of the residuals [N m | N].   iterations: that were needed.   settled: whether
            the last one changed nothing that counts.   method: as asked for.   start: β (b,) where it began.
    """

    values: np.ndarray
    covariance: np.ndarray
    weights: np.ndarray
    rms: np.ndarray
    iterations: int
    settled: bool
    method: ClosedLoopMethod
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
    method: ClosedLoopMethod = "idim-iv",
) -> ClosedLoopFit:
    """Base parameters by IDIM-IV, DIDIM or CLOE, with joints weighted by their residuals.

    Args:
        samples: prepared rows; "didim" reads their times and torques only, those that act from a row on, "cloe" their positions.
        model: of the arm.   base: regrouping.
        feedback: the log's loop, or one that follows the logged positions.   start: β (b,), as of least squares or of CAD.
        method: "idim-iv", "didim" or "cloe".
    Raises:
        IdentificationError: a simulated loop that diverges, too few rows, parameters that the motion does not determine.
    """
    check_known(IdentificationError, method, CLOSED_LOOP, place="method")
    of_positions = method == "cloe"
    tau = np.concatenate([s.q if of_positions else s.tau - _known(model, s, feedback, method) for s in samples])
    if len(tau) * model.arm.n <= len(base):
        expected = f"more than {len(base)}, the number of base parameters"
        raise IdentificationError("too few rows", place="log", value=len(tau), expected=expected)
    measured = None
    if method == "idim-iv":
        measured = np.concatenate([s.regressor(model)[:, :, base.independent] for s in samples])
    values, weights = np.asarray(start, dtype=float), np.ones(model.arm.n)
    covariance, rest, settled, count = np.zeros((len(base),) * 2), tau, False, 0
    while not settled and count < MOST:
        count += 1
        if of_positions:
            parts = [_sensitivities(model, base, values, feedback, each.t) for each in samples]
            moved, Z = (np.concatenate(each) for each in zip(*parts, strict=True))
            target = tau - moved + Z @ values
        else:
            Z, target = np.concatenate([_instruments(model, base, values, feedback, each.t) for each in samples]), tau
        Y = Z if measured is None else measured
        new = _solved(Z, Y, target, weights)
        rest = target - Y @ new
        weights = 1.0 / np.maximum(np.mean(rest**2, axis=0), np.finfo(float).tiny)
        bread = np.linalg.inv(np.einsum("tjb,j,tjc->bc", Z, weights, Y))
        covariance = correlated(lambda Z=Z, rest=rest: [(Z, rest)], weights, bread).covariance
        change = np.abs(new - values) / np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        values = new
        settled = bool(change.max() < SETTLED)
    return ClosedLoopFit(values, covariance, weights, rms(rest, axis=0), count, settled, method, start)


def _instruments(
    model: TorqueModel, base: BaseParameters, values: np.ndarray, feedback: Feedback, t: np.ndarray
) -> np.ndarray:
    """Z (k, n, b): the base columns of the simulated motion at times t (k,), low-passed as the log was."""
    times, q, qd, qdd, _ = simulated_loop(model, base.expanded(values), feedback, *_span(feedback, t))
    return _at_rows(feedback, times, model.rows(q, qd, qdd)[:, :, base.independent], t)


def _sensitivities(
    model: TorqueModel, base: BaseParameters, values: np.ndarray, feedback: Feedback, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """q_s (k, n) and ∂q_s/∂β (k, n, b) of the simulated motion at times t (k,), low-passed as the log was."""
    change = STEP * np.maximum(np.abs(values), STEP * np.abs(values).max())
    lanes = np.array([base.expanded(each) for each in (values, *(values + np.diag(change)))])
    times, q, *_ = simulated_loop(model, lanes, feedback, *_span(feedback, t))
    q = np.moveaxis(_at_rows(feedback, times, q, t), 1, 2)
    return q[:, :, 0], (q[:, :, 1:] - q[:, :, :1]) / change


def _span(feedback: Feedback, t: np.ndarray) -> tuple[float, float]:
    """Begin and end [s] of a simulation: the low-pass's own end must not be felt."""
    beyond = 0.0 if feedback.cutoff is None else SETTLING / feedback.cutoff
    return float(t[0] if feedback.begin is None else feedback.begin), float(t[-1] + beyond)


def _at_rows(feedback: Feedback, times: np.ndarray, values: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Values (ticks, …) of a simulation, low-passed, at times t (k,)."""
    if feedback.cutoff is not None:
        sections = low_pass(feedback.order, feedback.cutoff, 1.0 / feedback.period)
        values = np.asarray(sosfiltfilt(sections, values, axis=0))
    after = np.clip(np.searchsorted(times, t), 1, len(times) - 1)
    share = ((t - times[after - 1]) / feedback.period).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[after - 1] + share * values[after]


def _known(model: TorqueModel, samples: Samples, feedback: Feedback, method: str) -> np.ndarray:
    """Torques of the record's springs at the measured positions, or at the reference where these are not used."""
    if method == "idim-iv":
        return samples.tau - samples.unknown_torque(model)
    return model.known_torques(*feedback.reference(samples.t))


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
        raise IdentificationError("parameters that this motion cannot distinguish", place="reference")
    return np.linalg.solve(matrix, Q.T @ (root[:, 0] * tau).ravel()) / size
