"""A payload's mass, centre and inertia from logs of its arm. [AtkesonAnHollerbach1986] [KhalilGautierLemoine2007]

A body at the tip adds torques that are linear in its parameters π_L = [m, m c, I], the columns of the link that carries it taken
to the tip's frame:  P_link = H P_L Hᵀ  with H the frame's placement in the link and P the pseudo-inertia, so Y_L = Y_link T.

- One log and a known arm:    tau - inverse dynamics of the arm = Y_L π_L.
- Two logs, without and with the payload, of an arm of which only the kinematics need be known: all rows together,
  [Y_b 0; Y_b Y_L] [β; π_L] = [tau; tau_L].

Either way joints are weighted by their residuals, and standard deviations count the residuals' correlation in time.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import motor_shares
from armwright.actuators.gear import loses_power
from armwright.dynamics.gears import joint_torques
from armwright.entry import AnyArm, AnyLog, as_arm, as_log
from armwright.errors import IdentificationError, Interrupted, LogError
from armwright.identification.arm.base import BaseParameters, base_parameters, regrouped
from armwright.identification.arm.equations import Equations, Samples, SampleSource, equations_of
from armwright.identification.arm.fit import ArmFit, fit_arm, with_correlation
from armwright.identification.arm.gear_loss import GearProblem, LossyModel, fit_gears, lossy_model
from armwright.identification.arm.physical import (
    BASIS,
    PER_LINK,
    PhysicalBounds,
    inertial_parameters,
    physical_by_log_cholesky,
    pseudo_inertias,
)
from armwright.identification.arm.samples import Memory, Stream, checked, stream_of
from armwright.identification.arm.torque_model import (
    INERTIAL,
    INERTIAL_UNITS,
    MEASURED,
    TorqueColumn,
    TorqueModel,
    torque_model,
)
from armwright.identification.estimate import HALF_95, Estimate
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.identification.validation.comparison import NO_VERDICT, judged_on_torques
from armwright.model import BASE, Body, Model
from armwright.progress import Shown, automatic
from armwright.spatial import TENSOR

SUPPORT = replace(
    MEASURED,
    consumer="identify payload",
    approximated={**MEASURED.approximated, "load-dependent friction": "its level is that without the payload"},
)

NAMES = (
    "payload.mass_kg",
    *(f"payload.com_m[{k}]" for k in range(3)),
    *(f"payload.inertia_kg_m2.{entry}" for entry in ("xx", "xy", "xz", "yy", "yz", "zz")),
)
WELL_TOLD = 0.1  # half of the mass's 95 % interval, by the mass: a wider one is no answer
# The low-pass that suits the positions rounds off dry friction, which the model has sharp; a higher one lets in more noise.
CUTOFFS = (1.0, 2.0, 4.0, 8.0, 16.0)  # times the one that suits the positions
HIGHEST = 0.2  # cut-off as a share of the rate


@dataclass(frozen=True, eq=False)
class PayloadModel(TorqueModel):
    """Columns of an arm and of a payload, or of the payload alone.

    Attributes:
        carrier: number of the body that carries it.   moved: T (10, 10), π_link = T π_L.
        loaded: False for rows without the payload: its columns are 0.
    """

    carrier: int = 0
    moved: np.ndarray | None = None
    loaded: bool = True

    def rows(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Values (rows, n, p) of all columns, the payload's last."""
        own = replace_columns(self, self.columns[:-PER_LINK])
        values = np.zeros((len(q), self.arm.n, len(self.columns)))
        if len(own.columns):
            values[:, :, :-PER_LINK] = TorqueModel.rows(own, q, qd, qdd)
        if self.loaded:
            of_link = self.dyn.regressor(q, qd, qdd)[:, :, PER_LINK * self.carrier : PER_LINK * (self.carrier + 1)]
            values[:, :, -PER_LINK:] = of_link @ self.moved
        return values

    def known_torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Joint torques (rows, n) [N m | N] of the arm itself, if its own columns are not fitted and its gears have no loss."""
        if len(self.columns) > PER_LINK or is_lossy(self.arm):
            return super().known_torques(q, qd, qdd)
        return self.dyn.inverse_dynamics(q, qd, qdd) @ motor_shares(self.arm)


def is_lossy(arm: Model) -> bool:
    """True if gear loss or load-dependent friction couples torques nonlinearly."""
    return any(loses_power(body) for body in arm.coordinates)


def replace_columns(model: TorqueModel, columns: tuple[TorqueColumn, ...]) -> TorqueModel:
    """The plain model of some of the columns."""
    count = len(columns)
    return TorqueModel(model.arm, columns, model.prior[:count], model.of_joint[:, :count], model.dyn, model.sprung)


def payload_model(arm: Model, frame: str | None = None, own: TorqueModel | None = None) -> PayloadModel:
    """The torque model of a payload in a frame, by default the tip; with the columns of the arm if `own` contains them.

    Raises:
        ModelError: no such frame, or no tip.   IdentificationError: the frame is fixed to the base.
    """
    from armwright.kernels.compiled import compile_arm

    placed = arm.frame(frame)
    if placed.body == BASE:
        raise IdentificationError("fixed to the base", place="frame", value=frame or arm.tip, expected="one that moves")
    H = (arm.bodies[placed.body].link_frame.inverse() @ placed.placement).matrix().astype(float)
    moved = inertial_parameters(H @ BASIS @ H.T).T
    columns = tuple(
        TorqueColumn(f"{name}L", unit, "", "inertial", f"{name} of the payload", None)
        for name, unit in zip(INERTIAL, INERTIAL_UNITS, strict=True)
    )
    before = () if own is None else own.columns
    prior = np.concatenate([np.zeros(0) if own is None else own.prior, np.full(PER_LINK, np.nan)])
    of_joint = np.concatenate(
        [np.zeros((arm.n, 0), dtype=bool) if own is None else own.of_joint, np.ones((arm.n, PER_LINK), dtype=bool)],
        axis=1,
    )
    dyn, sprung = (compile_arm(arm), False) if own is None else (own.dyn, own.sprung)
    return PayloadModel(arm, (*before, *columns), prior, of_joint, dyn, sprung, placed.body, moved)


def identify_payload(
    log: AnyLog,
    arm: AnyArm,
    *,
    loaded_log: Log | None = None,
    frame: str | None = None,
    preparation: Preparation | None = None,
    progress: Shown = None,
) -> Estimate:
    """Mass, centre of mass and inertia of a payload at the tip, from a log of its arm.

    Args:
        log: of the arm with the payload; or, with `loaded_log`, without it.
        arm: the arm. With one log its record must be true: what it lacks is taken for payload. With two its kinematics count.
        loaded_log: of the arm with the payload, where `log` is without.
        frame: that the payload's numbers are given in; None: the tip.
        preparation: of the logs; None: the low-pass that leaves the mass least uncertain.
        progress: True or None: a bar where it is seen; False: none; a function is called with low-passes tried and of all.
    Returns:
        estimate: `payload.mass_kg`, `payload.com_m[k]` in the frame, `payload.inertia_kg_m2.xx`, … about the centre of mass, in
            the frame's axes. "not identified" where the mass cannot be told, or half of its 95 % interval is over 10 % of it.
            Without a mass, what the log determines follows: formulas of the mass `mL`, first moments `mcxL`, … and moments of
            inertia `IxxL`, … about the frame's origin. Either way runs held out judge the torques that it predicts.
    Raises:
        IdentificationError: a log without positions or torques, of another arm, with too few rows.
        Interrupted: Ctrl-C; `found` holds the best estimate of the low-passes until then.
    Example:
        >>> arm, rng = aw.load("two-link"), np.random.default_rng(0)
        >>> pushes = aw.Schedule(np.arange(16) / 2, rng.uniform(-20, 20, (16, 2)), arm.names)
        >>> loaded = arm.with_payload(1.5, [0.0, 0.0, 0.0], [0.01, 0.01, 0.01])
        >>> aw.save(run := aw.simulate(aw.Scenario(loaded, 8.0, command=pushes)), "swing.csv")
        >>> log = aw.identification.write_log(run, "swing.csv", "swing.log.toml", arm)
        >>> round(float(aw.identification.identify_payload(log, arm).values[0]), 2)  # kg
        1.5
    """
    log = as_log(log)
    arm = as_arm(arm)
    logs = [checked(each, arm) for each in ((log,) if loaded_log is None else (log, loaded_log))]
    warnings = tuple(str(warning) for each in logs for warning in each.warnings)
    if preparation is not None:
        found, body = _fitted(logs, arm, frame, [preparation] * len(logs))
        return _judged(replace(found, remarks=(*found.remarks, *warnings)), body, logs, arm, frame)
    log = logs[0]
    chosen = choose_preparation(log).cutoff
    tried: list[tuple[float, Estimate, Body | None]] = []
    too_short: LogError | None = None
    stopped = ""
    with automatic(progress, "fitting a payload") as tell:
        for number, cutoff in enumerate(chosen * np.array(CUTOFFS)):
            if cutoff < HIGHEST / log.run().period or not tried:
                try:
                    tell(number, len(CUTOFFS))
                    choices = [choose_preparation(each, cutoff=cutoff) for each in logs]
                    tried.append((cutoff, *_fitted(logs, arm, frame, choices)))
                except LogError as error:  # a higher cut-off leaves more rows
                    too_short = error
                    if cutoff >= HIGHEST / log.run().period:
                        break
                except KeyboardInterrupt:
                    if not tried:
                        raise
                    stopped = f"before the low-pass of {cutoff:.3g} Hz"
                    break
    if not tried:
        assert too_short is not None
        raise too_short
    cutoff, best, body = min(tried, key=lambda each: _uncertainty(each[1]))
    assert best.identifiable is not None
    determined = "the mass" if best.identifiable[0] else "the payload's numbers"
    ends = f"{tried[0][0]:.3g} to {tried[-1][0]:.3g} Hz"
    least = f": of {len(tried)} from {ends} it leaves {determined} least uncertain" if len(tried) > 1 else ""
    result = replace(best, remarks=(*best.remarks, *warnings, f"low-pass of {cutoff:.3g} Hz{least}"))
    if stopped:
        said = [f"stopped by Ctrl-C {stopped}: a higher one was not tried"]
        said += [f"{NO_VERDICT}: Ctrl-C came before"] if logs[-1].hold_out else []
        raise Interrupted(stopped, found=replace(result, remarks=(*result.remarks, *said)))
    return _judged(result, body, logs, arm, frame)


def _judged(estimate: Estimate, body: Body | None, logs: Sequence[Log], arm: Model, frame: str | None) -> Estimate:
    """The estimate judged on the runs held out, by torques of the arm with this payload beside those of the arm without it.

    Args:
        body: of the arm, with what the logs determine of a payload without a mass.
    """
    if not logs[-1].hold_out:
        return estimate
    if len(logs) > 1:
        what = f"{NO_VERDICT}: with two logs the arm's own masses do not count"
        return replace(estimate, remarks=(*estimate.remarks, what))

    def carrying() -> Model:
        if body is None:
            return with_identified_payload(arm, estimate, frame)
        return replace(arm, bodies=tuple(body if each.joint == body.joint else each for each in arm.bodies))

    return judged_on_torques(estimate, carrying, arm, logs[0], list(estimate.fit))


def _uncertainty(estimate: Estimate) -> float:
    """Standard deviation of the mass [kg]; geometric mean of those of the base parameters where no mass is found."""
    std = estimate.std
    return float(std[0] if np.isfinite(std[0]) else np.exp(np.log(std[PER_LINK:]).mean()))


def _fitted(
    logs: Sequence[Log], arm: Model, frame: str | None, preparations: Sequence[Preparation]
) -> tuple[Estimate, Body | None]:
    """The estimate from one log or two, with one low-pass for each, and the body that carries a payload without a mass."""
    streams = [stream_of(log, arm, None, each) for log, each in zip(logs, preparations, strict=True)]
    alone = payload_model(arm, frame)
    if len(logs) == 1:
        model: TorqueModel = alone
        prepared = partial(streams[0].samples, model)
        sources: list[SampleSource] = [(lambda: behind_gears(prepared(), alone)) if is_lossy(arm) else prepared]
        method = "payload from one log and the known arm: weighted least squares of the torques that the arm leaves unexplained"
        sha256 = logs[0].sha256
    else:
        model = payload_model(arm, frame, torque_model(arm))
        lossy, memories = lossy_model(model), ({}, {})
        if lossy is not None:
            problem = GearProblem(lambda each: _joined(each, _both(each, streams, memories))[0], _identifiable_base)
            model = fit_gears(problem, lossy).model
        sources = _both(model, streams, (None, None) if lossy is None else memories)
        method = f"payload from two logs, {both_logs(*logs)}: weighted least squares of both together"
        sha256 = checksum_of_both(*logs)
    whole, halves = _joined(model, sources)
    fit = fit_arm(whole, _identifiable_base(whole))
    # H⁻¹ Γ H⁻¹ is linear in Γ, so that of both logs is the sum of those of each.
    covariances = [
        with_correlation(each, replace(fit, equations=half)).covariance
        for each, half in zip(sources, halves, strict=True)
    ]
    found, parameters = _estimate(
        fit, base_parameters(alone), sum(covariances, np.zeros(())), method, sha256, logs[-1].path.name
    )
    if np.asarray(found.identifiable)[0]:
        return found, None
    assert alone.moved is not None
    carrier = arm.bodies[alone.carrier]
    return found, carrier.with_inertial_parameters(carrier.inertial_parameters + alone.moved @ parameters)


def _joined(model: TorqueModel, sources: Sequence[SampleSource]) -> tuple[Equations, list[Equations]]:
    """The least-squares problem of all logs together, and of each; of two the first is without the payload."""
    halves = [equations_of(each(), _empty(model) if each is not sources[-1] else model) for each in sources]
    return Equations(model, tuple(part for half in halves for part in half.parts)), halves


def _empty(model: TorqueModel) -> TorqueModel:
    """The model of rows without the payload."""
    if isinstance(model, LossyModel):
        return replace(model, linear=_empty(model.linear))
    assert isinstance(model, PayloadModel)
    return replace(model, loaded=False)


def _both(model: TorqueModel, streams: Sequence[Stream], memories: Sequence[Memory | None]) -> list[SampleSource]:
    """Samples of the log without the payload, and of that with it."""
    models = _empty(model), model
    return [partial(one.samples, *each) for one, *each in zip(streams, models, memories, strict=True)]


def both_logs(log: Log, loaded_log: Log) -> str:
    """Names and checksums of two logs, for a fit's method."""
    return f"without {log.path.name} (sha256 {log.sha256}) and with {loaded_log.path.name} (sha256 {loaded_log.sha256})"


def checksum_of_both(log: Log, loaded_log: Log) -> str:
    """SHA-256 of two logs' checksums concatenated: a record has one checksum for a fit."""
    return hashlib.sha256(f"{log.sha256}{loaded_log.sha256}".encode()).hexdigest()


def behind_gears(samples: Iterable[Samples], model: PayloadModel) -> Iterator[Samples]:
    """Samples with the torques that the arm does not explain, on the link side of lossy gears."""
    of_motors = np.linalg.inv(motor_shares(model.arm))  # rows of joint torques times this: the motors' own
    for block in samples:
        predicted, logged = model.dyn.inverse_dynamics(block.q, block.qd, block.qdd), block.tau @ of_motors
        measured, own = (joint_torques(model.arm, block.qd.T, block.qdd.T, each.T) for each in (logged, predicted))
        yield replace(block, tau=np.asarray(measured - own, dtype=float).T)


def _identifiable_base(equations: Equations, dropped: Sequence[int] = ()) -> BaseParameters:
    """Base parameters of the columns that the rows distinguish, without some."""
    factor = equations.factor
    factor[:, list(dropped)] = 0.0
    base = regrouped(equations.model.columns, factor)
    if not len(base):
        raise IdentificationError("no column of the payload moves anything", place="log", expected="motion, or gravity")
    return base


def _alone(matrix: np.ndarray) -> np.ndarray:
    """(10,) True for parameters that stand alone in a row of  β = A π_L."""
    return (matrix[np.count_nonzero(matrix, axis=1) == 1] != 0).any(axis=0)


def _estimate(
    fit: ArmFit, structural: BaseParameters, covariance: np.ndarray, method: str, sha256: str, name: str
) -> tuple[Estimate, np.ndarray]:
    """The payload's numbers from base parameters, possible ones where the free ones are not; the base parameters themselves
    where no mass is found, without which the others are none. Beside it the shortest π_L (10,) with these base parameters.

    Args:
        fit: of the logs.   structural: of the payload alone, for all motions of its arm.   covariance: of the fit.
    """
    arm, first = fit.equations.model.arm, len(fit.base.columns) - PER_LINK
    rows = np.flatnonzero(fit.base.independent >= first)
    A = fit.base.matrix[rows, first : first + PER_LINK]
    mixed = np.any(np.delete(fit.base.matrix[rows], np.s_[first:], axis=1) != 0) if first else False
    assert not mixed  # the payload's columns are those of one log alone
    beta, C = fit.values[rows], covariance[rows][:, rows]
    identifiable, by_any_motion = _alone(A), _alone(structural.matrix)
    free = np.linalg.pinv(A) @ beta
    remarks: list[str] = []
    values, at_bound = free, np.zeros(PER_LINK, dtype=bool)
    if identifiable[0] and free[0] > 0 and identifiable.all() and np.linalg.eigvalsh(_of_order_one(free))[0] < 0:
        R = np.linalg.cholesky(np.linalg.inv(0.5 * (C + C.T))).T @ A
        bounds = PhysicalBounds(
            [f"{each} of the payload" for each in INERTIAL], np.arange(PER_LINK), typical_mass=free[0]
        )
        values = physical_by_log_cholesky(R, R @ free, bounds).values
        at_bound[4:] = True
        remarks.append("the log alone gives an inertia that no body has: these are the nearest possible numbers")
    numbers, jacobian = _numbers(values), np.zeros((PER_LINK, PER_LINK))
    known = identifiable.copy()
    if identifiable[0] and values[0] > 0:
        jacobian = np.asarray(scalar.jacobian(_numbers, values), dtype=float)
        known[4:] &= identifiable.all()
    else:
        known[:] = False
    spread = jacobian @ np.linalg.pinv(A) @ C @ np.linalg.pinv(A).T @ jacobian.T
    half = HALF_95 * np.sqrt(max(spread[0, 0], 0.0)) / max(abs(numbers[0]), np.finfo(float).tiny)
    verdict = "identified"
    if not known[0]:
        verdict = "not identified"
        what = "not above 0"
        if not by_any_motion[0]:
            what = f"not identifiable by any motion of {arm.name}, whose torques depend on {', '.join(structural.formulas)} alone"
        elif not identifiable[0]:
            what = "not identifiable from this motion: one that accelerates or turns the payload against gravity would"
        remarks.append(f"the payload's mass is {what}")
    elif half > WELL_TOLD:
        verdict = "not identified"
        remarks.append(
            f"the payload's mass is {numbers[0]:.3g} kg, give or take {half:.0%} in 95 % of cases: too uncertain"
        )
    never = ~by_any_motion
    never[4:] |= never.any()
    if known[0] and never.any():
        unknown = ", ".join(name for name, lost in zip(NAMES, never, strict=True) if lost)
        remarks.append(f"no motion of {arm.name} tells {unknown}")
    vague = [name for k, name in enumerate(NAMES[4:], start=4) if known[k] and spread[k, k] > numbers[k] ** 2]
    if vague and known[0]:
        remarks.append(f"{', '.join(vague)}: as uncertain as large; use a motion that turns the payload faster")
    measures = {joint: {"r2": float(fit.r2[j]), "rms": float(fit.rms[j])} for j, joint in enumerate(arm.names)}
    found = Estimate(  # without a condition number: that of the fit is of the arm's parameters too, which need not be told
        NAMES, np.where(known, numbers, 0.0), spread, sha256, method, at_bound=at_bound, identifiable=known,
        remarks=(*remarks, *SUPPORT.notes(arm)), fit=measures, verdict=verdict, log=name,
    )  # fmt: skip
    if known[0]:
        return found, free
    count = len(rows)
    combined = replace(
        found,
        names=(*NAMES, *(fit.base.formulas[row] for row in rows)),
        units=(*found.units, *(fit.base.units[row] for row in rows)),
        values=np.concatenate([found.values, beta]),
        covariance=np.block([[spread, np.zeros((PER_LINK, count))], [np.zeros((count, PER_LINK)), C]]),
        at_bound=np.concatenate([at_bound, np.zeros(count, dtype=bool)]),
        identifiable=np.concatenate([known, np.ones(count, dtype=bool)]),
    )
    return combined, free


def _of_order_one(parameters: np.ndarray) -> np.ndarray:
    D = np.array([10.0, 10.0, 10.0, 1.0]) / np.sqrt(parameters[0])
    return pseudo_inertias(parameters) * np.outer(D, D)


def _numbers(parameters: np.ndarray) -> np.ndarray:
    """[m, c, I about the centre of mass] of [m, m c, I about the origin]:  I_c = I - m (|c|² 1 - c cᵀ)."""
    m, h = parameters[0], parameters[1:4]
    if not scalar.is_symbolic(m) and not m > 0:
        return np.asarray(parameters)
    c = [h[k] / m for k in range(3)]
    square = sum(h[k] * c[k] for k in range(3))
    tensor = [parameters[4 + k] - (square if i == j else 0.0) + h[i] * c[j] for k, (i, j) in enumerate(TENSOR.values())]
    return scalar.array([m, *c, *tensor])


def with_identified_payload(arm: Model, estimate: Estimate, frame: str | None = None) -> Model:
    """The arm with the payload of an estimate at its tip, or at a frame.

    An unknown coordinate of the centre is 0: on a planar arm the one across its plane has no effect. An inertia that is not
    known is 0: a point mass.

    Raises:
        IdentificationError: the mass is not identified.
    """
    known = np.asarray(estimate.identifiable)
    if not known[0]:
        raise IdentificationError("not identified", place=NAMES[0], expected="a mass")
    tensor = np.zeros((3, 3))
    if known.all():
        for k, (i, j) in enumerate(TENSOR.values(), start=4):
            tensor[i, j] = tensor[j, i] = estimate.values[k]
    centre = np.where(known[1:4], estimate.values[1:4], 0.0)
    return arm.with_payload(estimate.values[0], centre, tensor, frame, source="fit")
