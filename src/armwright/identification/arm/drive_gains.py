"""Drive gains of an arm by a known payload: true motor torques from currents or torques of unknown scale.

Masses and torques share one scale: of a log alone, an arm of twice the masses with drives of twice the torque is the same. A body
that was weighed breaks the tie [GautierBriot2014]. With y_L the known payload's torques in the second log, measured u_j of
joint j is   h_j (Y_j β + y_L,j),   linear in b_j = h_j β and h_j = 1/g_j: least squares of each joint by itself, over both logs,
with the noise where it is, in u.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.linalg

from armwright.actuators.gear import loses_power
from armwright.description.paths import path_name
from armwright.errors import IdentificationError
from armwright.identification.arm.base import regrouped
from armwright.identification.arm.correlation import correlated
from armwright.identification.arm.equations import Equations, Factor, equations_of
from armwright.identification.arm.fit import ArmFit, fit_arm, residuals_of
from armwright.identification.arm.payload import TENSOR, PayloadModel, both_logs, checksum_of_both, payload_model
from armwright.identification.arm.samples import Samples, samples_of, torque_source
from armwright.identification.arm.torque_model import Column, TorqueModel, torque_model
from armwright.identification.estimate import HALF_95, Estimate
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.model import Model

WELL_TOLD = 0.1  # half of a gain's 95 % interval, by the gain: a wider one is no answer


@dataclass(frozen=True, eq=False)
class GainModel(TorqueModel):
    """Columns of an arm, and for each joint one with its known torque, whose parameter is the gain h_j.

    Attributes:
        payload: columns of the known payload; None for rows without it.   parameters: (10,) of it.
    """

    payload: PayloadModel | None = None
    parameters: np.ndarray | None = None

    def rows(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Values (rows, n, p) of all columns, those of the gains last."""
        n = self.arm.n
        own = TorqueModel(self.arm, self.columns[:-n], self.prior[:-n], self.of_joint[:, :-n], self.dyn, self.sprung)
        values = np.zeros((len(q), n, len(self)))
        values[:, :, :-n] = own.rows(q, qd, qdd)
        known = own.known_torques(q, qd, qdd)
        if self.payload is not None:
            known = known + self.payload.rows(q, qd, qdd) @ self.parameters
        values[:, np.arange(n), np.arange(len(self) - n, len(self))] = known
        return values

    def known_torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """0 (rows, n): springs of the record are in the gains' columns."""
        return np.zeros_like(q)


def identify_drive_gains(
    log: Log,
    loaded_log: Log,
    robot: Model,
    mass: float,
    com: Iterable[float],
    inertia: np.ndarray | None = None,
    *,
    frame: str | None = None,
    preparation: Preparation | None = None,
) -> Estimate:
    """Gain of every joint's drive from two logs, without and with a known payload.

    Args:
        log: of the arm without the payload.   loaded_log: with it; both with currents, or with torques of a doubtful scale.
        robot: the arm; its masses do not count.   mass: of the payload [kg].   com: (3,) [m] its centre, in the frame.
        inertia: (3, 3) [kg m²] about the centre, in the frame's axes; None: a point.   frame: that carries it; None: the tip.
        preparation: of both logs; None: chosen.
    Returns:
        estimate: of currents the torque constants, `joint1.motor.torque_constant_n_m_per_a`; of torques the factors by which the
            true ones are larger, "joint1: drive gain". "not identified" where a gain's 95 % interval is more than ±10 %.
    Raises:
        IdentificationError: a mass that is not above 0, voltages, coupled motors, logs that do not fit.
    """
    if not mass > 0:
        raise IdentificationError(place="mass", value=mass, expected="the payload's mass, above 0 [kg]")
    source = torque_source(log)
    if source == "voltage" or torque_source(loaded_log) != source:
        what = "voltages" if source == "voltage" else "logs of different signals"
        raise IdentificationError(what, place="signals", expected="currents in both logs, or torques in both")
    empty = _gain_model(robot)
    payload = payload_model(robot, frame)
    loaded = replace(empty, payload=payload, parameters=_about_origin(mass, np.asarray(tuple(com), float), inertia))
    sources: list[Callable[[], Iterable[Samples]]] = [
        partial(samples_of, each, model, None, preparation or choose_preparation(each))
        for each, model in ((log, empty), (loaded_log, loaded))
    ]
    halves = [equations_of(each(), model) for each, model in zip(sources, (empty, loaded), strict=True)]
    both = Equations(loaded, (*halves[0].parts, *halves[1].parts))
    found = [_inverse_gain(j, both, halves, sources) for j in range(robot.n)]
    return _estimate(robot, source, found, log, loaded_log)


def _about_origin(mass: float, c: np.ndarray, inertia: np.ndarray | None) -> np.ndarray:
    """[m, m c, I about the frame's origin]  (10,)."""
    tensor = (np.zeros((3, 3)) if inertia is None else np.asarray(inertia, float)) + mass * (
        c @ c * np.eye(3) - np.outer(c, c)
    )
    return np.array([mass, *(mass * c), *(tensor[place] for place in TENSOR)])


def _gain_model(robot: Model) -> GainModel:
    """Columns of the arm without a payload."""
    if any(body.drive.coupling for body in robot.coordinates):
        what = "motors that several joints turn"
        raise IdentificationError(what, place=robot.name, expected="an arm whose motors each turn one joint")
    own = torque_model(robot)
    gains = tuple(
        Column(f"h{j}", "1", joint, "gain", f"inverse drive gain of {joint}", None)
        for j, joint in enumerate(robot.names, 1)
    )
    prior = np.concatenate([own.prior, np.full(robot.n, np.nan)])
    of_joint = np.concatenate([own.of_joint, np.eye(robot.n, dtype=bool)], axis=1)
    return GainModel(robot, (*own.columns, *gains), prior, of_joint, own.dyn, own.sprung)


def _inverse_gain(
    j: int, both: Equations, halves: list[Equations], sources: list[Callable[[], Iterable[Samples]]]
) -> tuple[float, float, ArmFit] | None:
    """h_j, its standard deviation and the fit of joint j; None if not identifiable from the logs."""
    model, gain = both.model, len(both.model) - both.model.arm.n + j
    factor: Factor = both.factors[j]
    matrix = np.zeros((len(factor.matrix), len(model)))
    matrix[:, factor.columns] = factor.matrix[:, :-1]
    base = regrouped(model.columns, matrix)
    place = np.flatnonzero(base.independent == gain)
    if not len(place) or factor.rows <= len(base):
        return None
    fit = fit_arm(both, base, "ols", np.eye(model.arm.n)[j])
    inverse = scipy.linalg.solve_triangular(fit.information, np.eye(len(base)))
    variance = 0.0
    for half, source in zip(halves, sources, strict=True):  # H⁻¹ Γ H⁻¹ is linear in Γ, the sum of the logs'
        rows = replace(fit, equations=half)
        spread = correlated(
            lambda source=source, rows=rows: (
                (values[:, [j]], rest[:, [j]]) for _, values, rest in residuals_of(source(), rows)
            ),
            np.ones(1),
            inverse @ inverse.T,
        )
        variance += float(spread.covariance[place[0], place[0]])
    return float(fit.values[place[0]]), float(np.sqrt(variance)), fit


def _estimate(
    robot: Model, source: str, found: list[tuple[float, float, ArmFit] | None], log: Log, loaded_log: Log
) -> Estimate:
    """The gains with their deviations, and what the logs do not tell."""
    names, values, stds, known, measures = [], [], [], [], {}
    lossy = [body.joint for body in robot.coordinates if loses_power(body)]
    remarks = [f"{', '.join(lossy)}: gear loss is not part of this model: gains contain it"] if lossy else []
    for body, each, j in zip(robot.coordinates, found, range(robot.n), strict=True):
        kt = float(body.drive.torque_constant or 1.0) if source == "current" else 1.0
        names.append(
            f"{path_name(body.joint)}.motor.torque_constant_n_m_per_a"
            if source == "current"
            else f"{body.joint}: drive gain"
        )
        h, std, fit = each if each is not None else (np.nan, np.inf, None)
        identified = bool(h > 0 and HALF_95 * std <= WELL_TOLD * h)
        if not identified:
            vague = each is None or HALF_95 * std > WELL_TOLD * abs(h)
            why = (
                "the payload hardly loads its motor, so its gain cannot be identified; use a heavier or longer one"
                if vague
                else "the payload's torques have the other sign; is the motor's sign right?"
            )
            remarks.append(f"{body.joint}: {why}")
        if fit is not None:
            measures[body.joint] = {"r2": float(fit.r2[j]), "rms": float(fit.rms[j])}
        values.append(kt / h if identified else kt)
        stds.append(kt * std / h**2 if identified else np.nan)
        known.append(identified)
    return Estimate(
        tuple(names), np.array(values), np.diag(np.square(stds)), checksum_of_both(log, loaded_log),
        f"drive gains from two logs, {both_logs(log, loaded_log)} the known payload: least squares by joint",
        units=("N m/A" if source == "current" else "1",) * robot.n, identifiable=np.array(known), remarks=tuple(remarks),
        fit=measures, verdict="identified" if all(known) else "not identified", log=loaded_log.path.name,
    )  # fmt: skip
