"""Generalised-momentum observer: external torques on an arm that its model does not explain.  [DeLucaMattone2005]

With the momentum p = M(q) q̇ the equations of motion, in which q̈ does not appear, are

    ṗ = tau + C(q, q̇)ᵀ q̇ - g(q) - f(q̇) + tau_ext,    M, C, g and f of the model,

and the residual of [DeLucaMattone2005], [HaddadinEtAl2017] is tau_ext behind a low-pass of bandwidth K:

    ṙ = K (tau_ext - r):   r_k = a r_{k-1} + (1 - a) d_k,   a = e^{-K T},   d_k = (p_k - p_{k-1}) / T - mean over T of the rest.

The position residual is the error of a model that the measured torques drive and that is drawn to the measured motion:

    ë + 2 w ė + w² e = M⁻¹ tau_ext.

Of a joint at rest friction takes any torque between its bounds (`rest`): that part of d is friction, and no residual. While a
joint turns back, the filtered speed changes its sign later than friction does: what friction may have changed then, leaves r as
it was.

Rows with values that cannot be are left out (`rows`): a few are bridged, more are a gap, after which the observer starts again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armwright.entry import expect
from armwright.errors import ScenarioError, ShapeError
from armwright.identification.validation.torque import motor_shares
from armwright.kernels.compiled import CompiledArm, compile_arm
from armwright.model import BASE, Model
from armwright.shadow.filter import FilteredRows, SignalFilter, critically_damped
from armwright.shadow.rest import RestingFriction
from armwright.shadow.rows import AT_ONCE, RowCheck, ShadowEvent

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
    Example:
        >>> bandwidths = aw.shadow.ShadowBandwidths(residual_hz=2.0)  # slower, less noise
        >>> shadow = aw.shadow.ArmShadow("two-link", deviation=0.5, bandwidths=bandwidths)
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
        t: (rows,) [s]; of a time stamp that cannot be the one before.
        torque: (rows, n) [N m | N] r, what acts on the arm beside its model; NaN until the filter has settled, and of rows that
            were left out.
        position: (rows, n) [rad | m] e; NaN as `torque`.   speed: (rows, n) [rad/s | m/s] filtered; NaN of rows left out.
        kilogram: (rows, n) [N m | N] what r is of 1 kg more at the tip; zeros where the arm has no tip.
        moving: (rows, n) [N m | N] Σ |M_ij q̈_j| + |C_ij q̇_j| behind the low-pass of r: torques that motion asks for, by size.
        resting: (rows, n) [N m | N] width of the torques that friction hides where its direction is not certain, either way.
        step: (rows,) [s] that the row stands for; 0 while the filter settles for the first time.
    """

    t: np.ndarray
    torque: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    kilogram: np.ndarray
    moving: np.ndarray
    resting: np.ndarray
    step: np.ndarray


@dataclass(frozen=True, eq=False)
class _Last:
    """Values of the last row: r of both models (2, n); torques of motion (n,); e and ė (n,)."""

    t: float
    known: _Known
    residual: np.ndarray
    moving: np.ndarray
    error: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class _Known:
    """Of a row: p, and what is known of ṗ, of both models (2, n); centre and width of the torques of friction at rest (n,)."""

    momentum: np.ndarray
    rate: np.ndarray
    centre: np.ndarray
    width: np.ndarray


class MomentumObserver:
    """The observer of one arm, fed with blocks of rows of any length.

    Args:
        arm: a full record.   bandwidths: settings.   held: whether torques act until the next row, as commands do.
        heavier: the arm with 1 kg more, for `Residuals.kilogram`; None: it is left out.
        whole: the arm with the friction that its joints have at rest, where measured torques, and so `arm`, lack it; None: `arm`.
    """

    def __init__(
        self,
        arm: Model,
        bandwidths: ShadowBandwidths | None = None,
        held: bool = False,
        heavier: Model | None = None,
        whole: Model | None = None,
    ):
        expect(bandwidths, ShadowBandwidths | None, "bandwidths", "an aw.shadow.ShadowBandwidths(…)", ScenarioError)
        self.arm, self.bandwidths, self._held = arm, bandwidths or ShadowBandwidths(), held
        self._models = [compile_arm(each) for each in (arm, heavier) if each is not None]
        self._shares, self._check = motor_shares(arm), RowCheck(whole or arm)
        self.restart()
        self._friction = RestingFriction(arm, whole or arm, self.bandwidths.rest, TURN * self._filter.delay)

    @property
    def events(self) -> tuple[ShadowEvent, ...]:
        """All rows that were left out so far, and residuals that were not finite."""
        return tuple(sorted(self._check.events, key=lambda each: each.t))

    def restart(self) -> None:
        """Forgets all rows; to be called before another run."""
        self._filter = SignalFilter(self.bandwidths.filter_hz, self._held)
        self._check.restart()
        self._last: _Last | None = None
        self._age = 0.0  # [s] of the run

    def update(self, t: np.ndarray, q: np.ndarray, tau: np.ndarray, qd: np.ndarray | None = None) -> Residuals:
        """Residuals at further rows.

        Args:
            t: (rows,) [s] increasing.   q: (rows, n) [rad | m].   tau: (rows, n) [N m | N] of the motors, on the joints.
            qd: (rows, n) [rad/s | m/s] if it is measured; None: from q.
        Returns:
            residuals: one row for each row.
        Raises:
            ShapeError: an array of another shape.
        """
        t, q, tau = (np.asarray(each, dtype=float) for each in (t, q, tau))
        qd = None if qd is None else np.asarray(qd, dtype=float)
        for name, values in (("q", q), ("tau", tau), ("qd", q if qd is None else qd)):
            if t.ndim != 1 or values.shape != (len(t), self.arm.n):
                raise ShapeError(f"shape {values.shape}", place=name, expected=f"({t.size}, {self.arm.n})")
        checked = self._check.check(t, q, tau, qd)
        rows = np.flatnonzero(checked.taken)
        found = np.full((6, *q.shape), np.nan)
        found[3:] = 0.0  # kilogram, moving, resting
        if len(rows):
            filtered = self._filter.rows(
                checked.t[rows], q[rows], tau[rows], None if qd is None else qd[rows], checked.begins[rows]
            )
            found[:, rows] = self._observed(checked.t[rows], filtered)
        age = np.cumsum([self._age, *checked.step])
        self._age = float(age[-1])
        step = np.where(age[1:] < self._filter.settling + AT_ONCE, 0.0, checked.step)
        torque, position, speed, kilogram, moving, resting = found
        return Residuals(checked.t, torque, position, speed, kilogram, moving, resting, step)

    def _observed(self, t: np.ndarray, rows: FilteredRows) -> np.ndarray:
        """The recursion over filtered rows, from where the last block ended: (6, rows, n) in the order of `Residuals`."""
        terms = [self._terms(model, rows) for model in self._models]
        momentum, known = (np.stack([each[k] for each in terms], axis=1) for k in (0, 1))  # (rows, models, n)
        known += rows.tau[:, None]
        inertia, coriolis, motors = terms[0][2:]
        moving = _times(np.abs(inertia), np.abs(rows.qdd)) + _times(np.abs(coriolis), np.abs(rows.qd))
        resting = self._friction.of(rows.q, rows.qd, rows.qdd, motors)
        compliance, hz = np.linalg.inv(inertia), 2.0 * math.pi * self.bandwidths.residual_hz
        w = 2.0 * math.pi * self.bandwidths.position_hz
        found = np.full((6, *rows.q.shape), np.nan)
        found[2], found[3:] = rows.qd, 0.0
        found[5] = resting.width
        last = self._last
        for k, settled in enumerate(rows.settled):
            if not settled:
                last = None
                continue
            here = _Known(momentum[k], known[k], resting.centre[k], resting.width[k])
            if last is None:
                still = np.zeros_like(rows.q[k])
                last = _Last(t[k], here, np.zeros_like(momentum[k]), moving[k], (still, still))
            else:
                step, before = t[k] - last.t, last.known
                acting = (momentum[k] - before.momentum) / step - 0.5 * (known[k] + before.rate)
                centre, width = 0.5 * (here.centre + before.centre), np.maximum(here.width, before.width)
                news = acting[0] - centre - np.where(resting.turning[k], last.residual[0], 0.0)
                # of both models: their difference is that of 1 kg
                acting -= centre + np.minimum(np.maximum(news, -width), width)
                keep = math.exp(-hz * step)
                residual = keep * last.residual + (1.0 - keep) * acting
                sway = keep * last.moving + (1.0 - keep) * moving[k]
                (a, b), (c, d) = critically_damped(w, step)
                goal = compliance[k] @ acting[0] / w**2  # exact for an acceleration that holds over the step
                off, rate = last.error[0] - goal, last.error[1]
                last = _Last(t[k], here, residual, sway, (goal + a * off + b * rate, c * off + d * rate))
            finite = np.isfinite(last.residual).all(axis=0) & np.isfinite(last.error).all(axis=0)
            if not finite.all():  # starts again with the next row, as after a gap
                joint = int(np.flatnonzero(~finite)[0])
                self._check.report("residual", self.arm.names[joint], float(last.residual[0, joint]), float(t[k]))
                last = None
                continue
            found[0, k], found[1, k], found[4, k] = last.residual[0], last.error[0], last.moving
            if len(terms) > 1:
                found[3, k] = last.residual[0] - last.residual[1]
        self._last = last
        return found

    def _terms(self, model: CompiledArm, rows: FilteredRows) -> tuple[np.ndarray, ...]:
        """p, Cᵀ q̇ - g - f, M, C and the motors' torques.

        f includes what gears lose, so that p alone holds the inertia: f = ID(q, q̇, q̈) - M q̈ - …
        """
        inertia, coriolis = model.mass_matrix(rows.q), model.coriolis_matrix(rows.q, rows.qd)
        motors = model.inverse_dynamics(rows.q, rows.qd, rows.qdd)
        others = motors @ self._shares - _times(inertia, rows.qdd)  # C q̇ + g + f
        both = coriolis + np.swapaxes(coriolis, -1, -2)
        return _times(inertia, rows.qd), _times(both, rows.qd) - others, inertia, coriolis, motors


def with_kilogram(arm: Model) -> Model | None:
    """The arm with a point mass of 1 kg at its tip; None without a tip or if its numbers are not those of a record."""
    if arm.description is None or arm.tip is None or arm.frame().body == BASE:
        return None
    return arm.with_payload(1.0, np.zeros(3), np.zeros((3, 3)), name=KILOGRAM)


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products (rows, n) of matrices (rows, n, n) and vectors (rows, n)."""
    return np.einsum("kij,kj->ki", matrices, vectors)
