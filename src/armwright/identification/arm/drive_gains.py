"""Drive gains of an arm by a payload that was weighed: true motor torques from currents, or from torques of unknown scale.

Masses and torques share one scale: of a log alone, an arm of twice the masses with drives of twice the torque is the same. A body
of known mass breaks the tie [GautierBriot2014]; its centre and inertia need not be known, they are found with the gains
(`gain_fit`). Gains are in proportion to the mass: one that is 1 % too large makes all of them 1 % too large.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real

import numpy as np

from armwright.description.drive import DC_EQUIVALENT, Motor
from armwright.description.paths import path_name
from armwright.entry import AnyArm, AnyLog, as_arm, as_log
from armwright.errors import IdentificationError
from armwright.fitting.covariance import correlated
from armwright.identification.arm.base import base_parameters
from armwright.identification.arm.equations import Equations, SampleSource, equations_of
from armwright.identification.arm.gain_fit import GainFit, GainProblem, fit_gains
from armwright.identification.arm.payload import (
    HIGHEST,
    PayloadModel,
    both_logs,
    checksum_of_both,
    payload_model,
)
from armwright.identification.arm.physical import PER_LINK
from armwright.identification.arm.remarks import joints_that_move
from armwright.identification.arm.samples import checked, needed_source, stream_of
from armwright.identification.arm.torque_model import TorqueColumn, TorqueModel, torque_model
from armwright.identification.estimate import HALF_95, Estimate
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.model import Model
from armwright.spatial import TENSOR

# of columns by rows that stay in memory: 128 MB; with more, the logs are prepared anew at each pass
KEPT_VALUES = 2**24
ROWS = 8.0  # of a log, by the unknown numbers
WIDER = (1.0, 2.0, 4.0, 8.0, 16.0)  # cut-offs by the one that suits the positions
WIDEST = 0.1  # half of a gain's 95 % interval, by the gain: a wider one is no answer
HEAVIEST = 1e3  # times the payload: no joint needs more than it carries
SURE = 4.0  # deviations of a gain from 0, for a word on its sign
# Squares that a joint gains by being fitted without the others: beyond NOISY times those that as many parameters take from
# white noise they are not noise. Links of a wrong length, or masses that changed between the logs, made gains wrong by 5 to 20
# times the share of the payload's torque that they left; so half a per cent is as much as gains within 10 % allow.
NOISY, UNLIKE = 3.0, 0.005


@dataclass(frozen=True, eq=False)
class GainModel(TorqueModel):
    """Columns of an arm, of a payload, and one of the torques that the record knows, its springs'; motors have 1 N m/A.

    Attributes:
        carrying: columns of the arm and the payload.
    """

    carrying: PayloadModel

    def rows(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Values (rows, n, p) of all columns."""
        springs = self.carrying.known_torques(q, qd, qdd)
        return np.concatenate([self.carrying.rows(q, qd, qdd), springs[:, :, None]], axis=2)

    def known_torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """0 (rows, n): springs of the record have a column, as the gains scale them too."""
        return np.zeros_like(q)

    @property
    def payload(self) -> np.ndarray:
        """Numbers of the payload's columns."""
        return np.arange(len(self) - 1 - PER_LINK, len(self) - 1)


def identify_drive_gains(
    log: AnyLog,
    loaded_log: AnyLog,
    arm: AnyArm,
    mass: float,
    com: Iterable[float] | None = None,
    inertia: np.ndarray | None = None,
    *,
    mass_std: float = 0.0,
    frame: str | None = None,
    preparation: Preparation | Sequence[Preparation] | None = None,
) -> Estimate:
    """Gain of every joint's drive from two logs, without and with a payload of known mass.

    Args:
        log: of the arm without the payload.   loaded_log: with it; both with currents, or with torques of a doubtful scale.
        arm: the arm; kinematics, gear ratios and springs count, masses and torque constants do not.
        mass: of the payload [kg].   com: (3,) [m] its centre, in the frame; None: unknown.
        inertia: (3, 3) [kg m²] about the centre, in the frame's axes; None: unknown. Unknown numbers are fitted with the gains.
        mass_std: deviation of the mass [kg]: gains are as uncertain, in per cent, all together.
        frame: that carries it; None: the tip.   preparation: of both logs, or of each; None: chosen.
    Returns:
        estimate: of currents the torque constants, `joint1.motor.torque_constant_n_m_per_a`; of torques the factors by which the
            true ones are larger, "joint1: drive gain". "not identified", and a remark says why, where a gain's 95 % interval is
            wider than ±10 %, a joint does not move, or the joints' torques are not those of one arm with one payload.
    Raises:
        IdentificationError: a mass that is not above 0, voltages, coupled motors, gear loss, one log twice, logs that are
            exchanged, logs that do not fit the arm.
    Example:
        >>> arm, rng = aw.load("two-link"), np.random.default_rng(0)
        >>> pushes = aw.Schedule(np.arange(8) / 2, rng.uniform(-20, 20, (8, 2)), arm.names)
        >>> for name, each in ("0", arm), ("1", arm.with_payload(1.5, [0, 0, 0], [0.01] * 3)):
        ...     aw.save(run := aw.simulate(aw.Scenario(each, 4.0, pushes)), f"{name}.csv")
        ...     log = aw.identification.write_log(run, f"{name}.csv", f"{name}.log.toml", arm)
        >>> aw.identification.identify_drive_gains("0.log.toml", log, arm, 1.5).values.round(2)
        array([1., 1.])
    """
    log = as_log(log)
    loaded_log = as_log(loaded_log, "loaded_log")
    arm = as_arm(arm)
    known = _known_parameters(mass, mass_std, com, inertia)
    log, loaded_log = (checked(each, arm) for each in (log, loaded_log))
    source = needed_source(log)
    if source == "voltage" or needed_source(loaded_log) != source:
        what = "voltages" if source == "voltage" else "logs of different signals"
        raise IdentificationError(what, place="signals", expected="currents in both logs, or torques in both")
    if log.sha256 == loaded_log.sha256:
        raise IdentificationError(
            "one log twice", place="loaded_log", value=loaded_log.path.name, expected="a log with the payload"
        )
    own = torque_model(_serving(arm, source))
    models = _gain_model(own, frame, loaded=False), _gain_model(own, frame, loaded=True)
    unknown = len(base_parameters(own)) + int(np.isnan(known).sum()) + arm.n
    chosen: Sequence[Preparation | dict[str, Preparation]]
    if preparation is None:
        chosen = [_with_enough_rows(each, unknown) for each in (log, loaded_log)]
    else:
        chosen = (preparation, preparation) if isinstance(preparation, Preparation) else preparation
    sources: list[SampleSource] = [
        partial(stream_of(each, arm, None, prepared).samples, model)
        for each, model, prepared in zip((log, loaded_log), models, chosen, strict=True)
    ]
    halves = [equations_of(each(), model) for each, model in zip(sources, models, strict=True)]
    whole, fit = fit_gains(_problem(halves, own, known))
    spread = _covariance(fit, sources)
    _check_order(fit, spread, loaded_log, arm.names)
    return _estimate(arm, source, _Found(halves, whole, fit, spread, mass), mass_std, (log, loaded_log))


def _known_parameters(
    mass: float, mass_std: float, com: Iterable[float] | None, inertia: np.ndarray | None
) -> np.ndarray:
    """[m, m c, I about the frame's origin]  (10,) of a payload, NaN where it is unknown."""
    if not (isinstance(mass, Real) and np.isfinite(mass) and mass > 0):
        raise IdentificationError(place="mass", value=mass, expected="the payload's mass, above 0 [kg]")
    if not 0 <= mass_std < mass:
        raise IdentificationError(place="mass_std", value=mass_std, expected="0 or more [kg], less than the mass")
    known = np.full(PER_LINK, np.nan)
    known[0] = mass
    if com is None:
        if inertia is not None:
            raise IdentificationError("without a centre", place="inertia", expected="com too, which it is about")
        return known
    c = np.asarray(tuple(com), dtype=float)
    if c.shape != (3,) or not np.isfinite(c).all():
        raise IdentificationError(place="com", value=c.tolist(), expected="three numbers [m]")
    known[1:4] = mass * c
    if inertia is not None:
        tensor = np.asarray(inertia, dtype=float)
        if tensor.shape != (3, 3) or not np.isfinite(tensor).all() or not np.allclose(tensor, tensor.T):
            raise IdentificationError(place="inertia", value=tensor.tolist(), expected="(3, 3), symmetric [kg m²]")
        tensor = tensor + mass * (c @ c * np.eye(3) - np.outer(c, c))
        known[4:] = [tensor[place] for place in TENSOR.values()]
    return known


def _serving(arm: Model, source: str) -> Model:
    """The arm with motors of 1 N m/A.

    Raises:
        IdentificationError: motors that several joints turn, gear loss, or currents without a gear.
    """
    for body in arm.coordinates:
        drive, friction = body.drive, body.friction
        if drive.coupling:
            what, expected = "motors that several joints turn", "an arm whose motors each turn one joint"
            raise IdentificationError(what, place=arm.name, expected=expected)
        loads = friction is not None and friction.load_coefficient is not None
        if drive.efficiency is not None or loads:
            place = f"{path_name(body.joint)}.{'friction.load_coefficient' if loads else 'motor.gear_efficiency'}"
            what = "torque that a gear takes in proportion to its load looks like another gain"
            raise IdentificationError(what, place=place, expected="gears without loss, or the torque constants known")
        if source == "current" and _motor(arm, body.joint) is None:
            place, expected = f"{path_name(body.joint)}.motor", "gear_ratio and rotor_inertia_kg_m2 in the robot's file"
            raise IdentificationError("currents of a joint without a motor", place=place, expected=expected)
    bodies = tuple(replace(body, drive=replace(body.drive, torque_constant=1.0)) for body in arm.bodies)
    return replace(arm, bodies=bodies)


def _with_enough_rows(log: Log, unknown: int) -> dict[str, Preparation]:
    """Preparations of the runs by name: low-passes that suit the positions, or wider ones that leave enough rows.

    Residuals tell the noise where the parameters do not follow it. A narrow low-pass leaves both the same band.
    """
    chosen: dict[str, Preparation] = {}
    for wider in WIDER:
        for name in log.fit:
            suits, rate = choose_preparation(log, name), 1.0 / log.run(name).period
            cutoff = max(suits.cutoff, min(wider * suits.cutoff, HIGHEST * rate))
            chosen[name] = suits if cutoff == suits.cutoff else choose_preparation(log, name, cutoff=cutoff)
        if sum(log.run(name).rows / each.decimate for name, each in chosen.items()) >= ROWS * unknown:
            break
    return chosen


def _motor(arm: Model, joint: str) -> Motor | None:
    return next(each.motor for each in arm.record.moving_joints if each.name == joint)


def _gain_model(own: TorqueModel, frame: str | None, loaded: bool) -> GainModel:
    n = own.arm.n
    carrying = replace(payload_model(own.arm, frame, own), loaded=loaded)
    springs = TorqueColumn("known", "1", "", "known", "torques of the record's springs", None)
    prior, of_joint = np.append(carrying.prior, 1.0), np.column_stack([carrying.of_joint, np.full(n, own.sprung)])
    return GainModel(own.arm, (*carrying.columns, springs), prior, of_joint, own.dyn, own.sprung, carrying)


def _problem(halves: Sequence[Equations], own: TorqueModel, known: np.ndarray) -> GainProblem:
    """The problem of both logs, of the joints that move in both."""
    model = halves[1].model
    assert isinstance(model, GainModel)
    parameters = np.zeros(len(model))
    parameters[-1], parameters[model.payload] = 1.0, np.nan_to_num(known)
    candidates = np.concatenate([base_parameters(own).independent, model.payload[np.isnan(known)]])
    both = Equations(model, (*halves[0].parts, *halves[1].parts))
    moving = np.flatnonzero(np.all([joints_that_move(each) & (each.rows > 0) for each in halves], axis=0))
    return GainProblem(model.columns, both.factors, candidates, parameters, moving)


def _covariance(fit: GainFit, sources: Sequence[SampleSource]) -> np.ndarray:
    """Covariance (k, k) of h, robust against residuals that are correlated in time and between joints."""
    k = len(fit.inverse)
    if not k:
        return np.zeros((0, 0))
    size = np.linalg.norm(fit.jacobian, axis=0)
    R = np.linalg.qr(fit.jacobian / size, mode="r")
    inverse = np.linalg.inv(R) / size[:, None]
    both = partial(_scores, fit, sources)
    if sum(fit.problem.factors[j].rows for j in fit.problem.joints) * fit.jacobian.shape[1] < KEPT_VALUES:
        both = partial(iter, list(both()))
    return correlated(both, 1.0 / fit.problem.variances, inverse @ inverse.T).covariance[-k:, -k:]


def _scores(fit: GainFit, sources: Sequence[SampleSource]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """∂(prediction)/∂(θ, h) (rows, k, b + k) and residuals (rows, k), block by block."""
    problem, k = fit.problem, len(fit.inverse)
    for block in (block for source in sources for block in source()):
        assert block.columns is not None
        Y = block.columns[:, problem.joints]
        unit = Y[:, :, problem.unknown] @ fit.parameters + Y @ problem.known  # torque at the joint
        values = np.zeros((len(Y), k, len(fit.parameters) + k))
        values[:, :, :-k] = fit.inverse[:, None] * Y[:, :, problem.unknown]
        values[:, np.arange(k), np.arange(len(fit.parameters), values.shape[2])] = unit
        yield values, block.tau[:, problem.joints] - fit.inverse * unit


def _check_order(fit: GainFit, spread: np.ndarray, loaded_log: Log, names: list[str]) -> None:
    """Refuses logs whose payload takes weight away in the torques of all joints that show it."""
    sure = np.abs(fit.inverse) > SURE * np.sqrt(np.diag(spread))
    if sure.any() and (fit.inverse[sure] < 0).all():
        joints = ", ".join(names[int(j)] for j in fit.problem.joints[sure])
        raise IdentificationError(
            f"the payload makes the arm lighter, by the torques of {joints}: the logs are exchanged, or all signs reversed",
            place="loaded_log",
            value=loaded_log.path.name,
            expected="the log with the payload, and motors whose torques have the signs of their joints",
        )


@dataclass(frozen=True, eq=False)
class _Found:
    """Both fits and what follows for each joint of the arm: h, its deviation, and a reason where its gain is not identified."""

    halves: Sequence[Equations]
    whole: GainFit
    fit: GainFit
    spread: np.ndarray
    mass: float

    def of_joint(self, j: int) -> tuple[float, float, str]:
        """h, its deviation and why the gain is not identified; "" if it is."""
        k = np.flatnonzero(self.fit.problem.joints == j)
        joint = self.halves[0].model.arm.names[j]
        if not len(k):
            return np.nan, np.inf, f"{joint}: {self._reason_unseen(j)}"
        h, std = float(self.fit.inverse[k[0]]), float(np.sqrt(self.spread[k[0], k[0]]))
        if HALF_95 * std > WIDEST * abs(h):
            weight = self._weight(self.fit, k[0], std / abs(h) / float(self.fit.deviations[k[0]]))
            vague = f"its gain is ± {HALF_95 * std / abs(h):.0%} in 95 % of cases, too uncertain: "
            return h, std, f"{joint}: {vague}{self._remedy(weight, 'about')}"
        if h < 0:
            return h, std, f"{joint}: the payload's torques have the other sign; is the motor's sign right?"
        return h, std, ""

    def _reason_unseen(self, j: int) -> str:
        moving = [joints_that_move(half)[j] for half in self.halves]
        if not all(half.rows[j] for half in self.halves):
            return "no torque or current of its motor is in both logs"
        if not all(moving):
            which = "either log" if not any(moving) else f"the log {'with' if moving[0] else 'without'} the payload"
            return f"it does not move in {which}, and a motor at rest may hold with any torque within its friction"
        k = int(np.flatnonzero(self.whole.problem.joints == j)[0])
        return (
            f"the payload hardly shows in its motor's torque: {self._remedy(self._weight(self.whole, k, 1.0), 'over')}"
        )

    def _weight(self, fit: GainFit, k: int, times: float) -> float:
        """The payload [kg] of the same shape with which the gain would be identified; infinite if none would do."""

        def enough(weight: float) -> bool:
            wide = fit.with_heavier(weight, self.payload)[k] * times
            return bool(HALF_95 * wide <= WIDEST)

        if not enough(HEAVIEST):
            return np.inf
        low, high = 1.0, HEAVIEST
        while high / low > 1.02:
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if enough(middle) else (middle, high)
        return self.mass * high

    @property
    def payload(self) -> np.ndarray:
        """Numbers of the payload's columns."""
        model = self.halves[0].model
        assert isinstance(model, GainModel)
        return model.payload

    def _remedy(self, weight: float, word: str) -> str:
        if np.isfinite(weight):
            return f"it takes {word} {weight:.2g} kg on these motions"
        centre = "" if self.payload[1] not in self.fit.problem.candidates else "state its centre, or "
        return f"no heavier one would do; {centre}fix it off the joint's axis, and move this joint and those before it together"

    def unlike_one_arm(self) -> list[str]:
        """A sentence on joints whose torques do not fit the arm and payload that those of the others ask for, beyond noise."""
        problem, joints, largest = self.fit.problem, [], 0.0
        if not len(problem.joints):
            return []
        parameters = problem.known.copy()
        parameters[problem.unknown] = self.fit.parameters
        for k, (j, block) in enumerate(zip(problem.joints, problem.full, strict=True)):
            alone, rank = problem.alone[k]
            excess = max(float(self.fit.squares[k]) - alone, 0.0)
            torque = float(np.linalg.norm(block[:, self.payload] @ parameters[self.payload] * self.fit.inverse[k]))
            if excess > NOISY * rank * problem.variances[k] and np.sqrt(excess) > UNLIKE * torque:
                joints.append(self.halves[0].model.arm.names[j])
                largest = max(largest, np.sqrt(excess) / torque) if torque**2 > excess else 1.0
        if not joints:
            return []
        return [
            f"{', '.join(joints)}: these torques are not those of one arm with one payload: up to {largest:.1%} of what the "
            "payload does is left; are kinematics, gears and the joints' order right, and was the same payload on the same "
            "link throughout?"
        ]

    @property
    def is_without_payload(self) -> bool:
        """True if no joint's torque shows the payload, but would show a heavier one."""
        nothing = not len(self.fit.inverse) and bool(len(self.whole.inverse))
        return nothing and bool(np.isfinite(self._weight(self.whole, 0, 1.0)))


def _estimate(arm: Model, source: str, found: _Found, mass_std: float, logs: tuple[Log, Log]) -> Estimate:
    """The gains with their covariance, and what the logs do not determine."""
    n, fit = arm.n, found.fit
    names, values, known, remarks = [], np.full(n, np.nan), np.zeros(n, dtype=bool), []
    slopes, measures = np.zeros((n, len(fit.inverse))), {}  # of the gains by h
    for j, body in enumerate(arm.coordinates):
        names.append(
            f"{path_name(body.joint)}.motor.torque_constant_n_m_per_a"
            if source == "current"
            else f"{body.joint}: drive gain"
        )
        h, _, reason = found.of_joint(j)
        factor = _dc_equivalent(arm, body.joint) if source == "current" else 1.0
        known[j] = not reason
        if reason:
            remarks.append(reason)
            constant = body.drive.torque_constant if source == "current" else 1.0
            values[j] = np.nan if constant is None else float(constant) / factor
            continue
        k = int(np.flatnonzero(fit.problem.joints == j)[0])
        values[j], slopes[j, k] = 1.0 / (h * factor), -1.0 / (h * h * factor)
        measures[body.joint] = _measures(fit, k)
    covariance = slopes @ found.spread @ slopes.T
    covariance += np.outer(values, values) * (mass_std / found.mass) ** 2
    covariance[~known] = covariance[:, ~known] = np.nan
    if known.any() and not mass_std:
        remarks.append(
            f"gains are in proportion to the {found.mass:g} kg: an error of the mass is theirs, in per cent, and not counted here"
        )
    log, loaded_log = logs
    unlike = found.unlike_one_arm()
    if found.is_without_payload:
        remarks.insert(
            0, f"the logs do not differ as by a body of {found.mass:g} kg: was it on the arm in {loaded_log.path.name}?"
        )
    return Estimate(
        tuple(names), values, covariance, checksum_of_both(log, loaded_log),
        f"drive gains from two logs, {both_logs(log, loaded_log)} the payload of {found.mass:g} kg: weighted least squares",
        units=("N m/A" if source == "current" else "1",) * n, identifiable=known,
        remarks=(*unlike, *remarks, *(str(warning) for each in logs for warning in each.warnings)), fit=measures,
        verdict="identified" if known.all() and not unlike else "not identified", log=loaded_log.path.name,
    )  # fmt: skip


def _dc_equivalent(arm: Model, joint: str) -> float:
    """The DC motor's torque constant by the record's, which may be that of a brushless motor's phase."""
    motor = _motor(arm, joint)
    return 1.0 if motor is None else DC_EQUIVALENT[motor.basis].torque_constant


def _measures(fit: GainFit, k: int) -> dict[str, float]:
    """R² and root mean square of the residual [N m | N]."""
    factor = fit.problem.factors[fit.problem.joints[k]]
    spread = (factor.sum_of_squares - factor.total**2 / factor.rows) / factor.rows
    square = float(fit.squares[k]) / factor.rows
    return {"r2": 1.0 - square / spread, "rms": float(np.sqrt(square)) / abs(float(fit.inverse[k]))}
