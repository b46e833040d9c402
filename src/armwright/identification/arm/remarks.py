"""Remarks, measures and verdict of an arm's fit: identifiable, unidentifiable and doubtful parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from armwright.fitting.directions import MEANINGLESS
from armwright.fitting.measures import r_squared, rms
from armwright.identification.arm.arm_estimate import ArmEstimate
from armwright.identification.arm.arm_record import RecordParameters
from armwright.identification.arm.equations import Equations, Samples
from armwright.identification.arm.fit import AT_REST, ArmFit, HeldOut, residual_scale, residuals_of
from armwright.identification.arm.gear_loss import LossyModel, doubtful_losses, loss_remarks
from armwright.identification.arm.methods import FittedLog
from armwright.identification.arm.misread import late_torques, misread_columns
from armwright.identification.arm.mistakes import gives_way, made_up_for, suspicions
from armwright.identification.arm.regressor_errors import disturbed_samples
from armwright.identification.arm.samples import Stream
from armwright.identification.arm.score_tests import score_tests
from armwright.identification.arm.spring_record import SPRINGS
from armwright.identification.arm.torque_model import SUPPORT
from armwright.identification.estimate import HALF_95, Estimate
from armwright.identification.validation.comparison import poorly_predicted, unexplained

MOST_NAMED = 6  # parameters in one remark
POSES = 50  # of the log, for the mean of a joint's inertia
POOR = 0.8  # R² of a joint below which there is a remark
DISSIPATING = ("viscous", "coulomb", "coulomb+", "coulomb-")  # kinds of columns whose numbers above 0 take power
SURE = 5.0  # standard deviations below 0 at which the power of a joint's friction has the wrong sign
OF_TORQUE = 0.05  # of a joint's torque: a smaller friction below 0 may be a drive's own compensation of friction
POSSIBLE = 0.01  # of R², that physically possible values may cost a joint beyond what noise makes them cost
FAR = 6.0  # root mean square of residuals by the deviation that their median tells; reversals make it up to 5
AMISS = 0.03  # of the torque, in root mean square: less needs no other method
FACTOR = 5.0  # between the record's links and the identified ones, from which the torque's unit is in doubt


def joints_that_move(equations: Equations) -> np.ndarray:
    """(n,) True for joints faster than a hundredth of the fastest, in root mean square."""
    motion = np.sum([part.motion for part in equations.parts], axis=0)
    return motion > AT_REST**2 * motion.max()


def unpredicted(fit: ArmFit, held_out: Sequence[HeldOut]) -> list[str]:
    """Sentences about moving joints with poorly predicted torque on the parts of the log, each by a fit to the others."""
    parts = [each.relative**2 for each in held_out if not each.at_rest]
    if not parts:
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = fit.rms**2 / (1.0 - fit.r2)  # of the measured torque
    r2s = r_squared(np.mean(parts, axis=0) * fit.torque_rms**2, spread)
    return poorly_predicted(
        _moving(fit), dict(zip(fit.equations.model.arm.names, r2s, strict=True)), "on parts held out"
    )


def _moving(fit: ArmFit) -> list[str]:
    return [
        joint
        for joint, moves in zip(fit.equations.model.arm.names, joints_that_move(fit.equations), strict=True)
        if moves
    ]


def negative_inertias(fit: ArmFit, samples: Samples, is_free: bool = False) -> list[str]:
    """Sentences about joints whose inertia M_jj, averaged over the log's poses, is below 0 by its 95 % interval.

    M_jj(q) = tau_j(q, 0, e_j) - tau_j(q, 0, 0)  is above 0 for every arm, whatever its parameters.

    Args:
        fit: of the samples.   samples: some rows.   is_free: physically possible values explain the log as well.
    """
    model, said = fit.equations.model, []
    q = samples.q[:: max(len(samples.q) // POSES, 1)]
    rest = np.zeros_like(q)
    for j, body in enumerate(model.arm.coordinates):
        unit = rest + np.eye(model.arm.n)[j]
        row = (model.rows(q, rest, unit) - model.rows(q, rest, rest))[:, j].mean(axis=0)[fit.base.independent]
        inertia, std = float(row @ fit.values), float(np.sqrt(max(row @ fit.covariance @ row, 0.0)))
        if inertia < -HALF_95 * std:
            name = "mass" if body.kind.units.linear else "inertia"
            value = f"{inertia:.3g} ± {HALF_95 * std:.2g} {body.kind.units.inertia} (95 %)"
            asked = "is the sign of its torque, its position or its gear wrong, or is it another arm?"
            asked = "possible values explain the log as well" if is_free else asked
            said.append(f"{body.joint}: its {name} comes out as {value}, which no arm has: {asked}")
    return said


def far_off(fit: ArmFit, samples: Samples) -> list[str]:
    """A sentence about joints some of whose residuals are so large that outliers make most of the sum of squares."""
    if fit.outliers is not None:
        return []
    scale = residual_scale([samples], fit)
    residuals = np.concatenate([each for *_, each in residuals_of([samples], fit)])
    known = np.isfinite(residuals)
    squares = np.where(known, residuals, 0.0) ** 2
    times = np.sqrt(squares.sum(axis=0) / np.maximum(known.sum(axis=0), 1)) / scale
    far = (times > FAR) & (fit.rms > AMISS * fit.torque_rms)
    joints = [joint for joint, each in zip(fit.equations.model.arm.names, far, strict=True) if each]
    if not joints:
        return []
    return [
        f"{', '.join(joints)}: residuals are up to {times.max():.2g} times as large as their median tells, as outliers make "
        'them: method "tukey" counts those less'
    ]


def unlike_the_record(fit: ArmFit) -> list[str]:
    """A sentence if the identified links take at least 5 times the torque of the record's links, or at most a fifth.

    Both are compared by their base parameters, over the rows of the log and weighted as the fit; those that a rotor has part in
    of which the record does not speak are left out.
    """
    base, prior = fit.base, fit.equations.model.prior
    unknown = (base.matrix[:, np.isnan(prior)] != 0).any(axis=1)
    of_links = [b for b, k in enumerate(base.independent) if base.columns[k].kind == "inertial" and not unknown[b]]
    own = base.of(np.nan_to_num(prior))[of_links]
    size = np.linalg.norm(fit.information[:, of_links] @ own)
    if size == 0:
        return []
    times = float(np.linalg.norm(fit.information[:, of_links] @ fit.values[of_links]) / size)
    if 1 / FACTOR <= times <= FACTOR:
        return []
    return [
        f"the links' masses and inertias take {times:.2g} times the torque of the record's own: is the unit or the side of "
        "the torque right?"
    ]


def impossible_parameters(fit: ArmFit, values: RecordParameters | None) -> list[str]:
    """A sentence if physically possible parameters predict torques much worse than the unconstrained ones.

    Those of a real arm are possible, so that noise alone makes the difference, p parameters in N rows: p / N of what is left.
    """
    if values is None:
        return []
    by_noise = len(fit.base) / np.maximum(fit.equations.rows, 1) * (1.0 - fit.r2)
    cost = fit.r2 - values.r2
    worst = {
        joint: each for joint, each, noise in zip(fit.equations.model.arm.names, cost, by_noise, strict=True)
        if each > POSSIBLE + noise
    }  # fmt: skip
    if not worst:
        return []
    joints = ", ".join(f"{joint} by {each:.2f}" for joint, each in worst.items())
    return [
        f"no arm has the parameters that this log asks for: possible ones lower R² of {joints}. Are units, joints' order, "
        "zero positions, gears and couplings those of this robot, and is friction of this form?"
    ]


def driving_frictions(fit: ArmFit) -> list[str]:
    """Sentences about joints with negative friction: torque and motion have opposite sign conventions.

    Its power over the log, Σ q̇ (viscous q̇ + coulomb sgn q̇), is below 0 by 5 standard deviations, and its torque is not small.
    Joints of coupled motors, where frictions of motor and joint trade with each other, are left out.
    """
    base, sentences = fit.base, []
    coupled = {j for column in base.columns if len(column.turned) > 1 for j, _ in column.turned}
    for j, (joint, factor) in enumerate(zip(fit.equations.model.arm.names, fit.equations.factors, strict=True)):
        kinds = {
            b: base.columns[k].kind for b, k in enumerate(base.independent)
            if base.columns[k].joint == joint and base.columns[k].kind in DISSIPATING and not base.regroup[b].any()
        }  # fmt: skip
        if j in coupled or not kinds or np.isnan(fit.r2[j]):
            continue
        own, place = list(kinds), {int(k): at for at, k in enumerate(factor.columns)}
        columns = factor.matrix[:, [place[int(base.independent[b])] for b in own]]
        products = columns.T @ columns  # sums over the rows; the viscous column is the speed
        viscous = [at for at, b in enumerate(own) if kinds[b] == "viscous"]
        weight = products[viscous[0]] if viscous else np.ones(len(own))
        values, spread = fit.values[own], fit.covariance[np.ix_(own, own)]
        share = np.sqrt(values @ products @ values / factor.sum_of_squares)
        if weight @ values < -SURE * np.sqrt(weight @ spread @ weight) and share > OF_TORQUE:
            sentences.append(
                f"{joint}: its friction, {share:.0%} of its torque, would drive it: the sign of its torque, or that of its "
                "position or gear, is wrong in the log's file, or its axis in the robot's"
            )
    return sentences


def measures_by_joint(fit: ArmFit, held_out: Sequence[HeldOut]) -> dict[str, dict[str, float]]:
    """Measures of the fit by joint: R² and RMS of the residual over the fitted rows, error on held-out parts that move."""
    moving = [each.relative for each in held_out if not each.at_rest and np.isfinite(each.relative).any()]
    measures = {}
    for j, joint in enumerate(fit.equations.model.arm.names):
        if np.isnan(fit.rms[j]):
            continue
        measures[joint] = {"r2": float(fit.r2[j]), "rms": float(fit.rms[j])}
        if moving:
            measures[joint]["held_out"] = rms(np.array([each[j] for each in moving]))
    return measures


def _verdict(fit: ArmFit, identified: int, structural: int) -> Literal["identified", "not identified"]:
    """ "not identified" if the log identifies fewer parameters than the arm has, or with too large errors."""
    poor = identified < structural or fit.condition > MEANINGLESS or bool((fit.r2 <= 0).any())
    return "not identified" if poor else "identified"


def with_remarks(
    result: ArmEstimate, found: FittedLog, directions: Sequence[str], stream: Stream, said: Sequence[str]
) -> Estimate:
    """The estimate of a result with remarks, measures of the joints and a verdict.

    Args:
        result: whose `estimate` has neither.   found: the fit.   directions: that the log shows weakly, in words.
        stream: of the log.   said: sentences about the log and its runs held out.
    """
    fit, some, comparison = result.fit, next(iter(found.rows())), result.hold_out
    remarks = [*_identifiability(result, found), *directions, *_doubtful_numbers(fit)]
    remarks += [*_about_joints(result, stream.cutoff, found.stuck), *far_off(fit, some), *_about_record(result)]
    driving, impossible = driving_frictions(fit), impossible_parameters(fit, result.record)
    is_free = result.record is not None and not impossible and not driving
    negative = negative_inertias(fit, some, is_free)
    remarks += negative if is_free else []
    doubts = [*unlike_the_record(fit), *driving, *([] if is_free else negative)]
    measures = measures_by_joint(fit, result.held_out)
    if comparison is None:
        unseen = unpredicted(fit, result.held_out)
    else:
        unseen = [*unexplained(_moving(fit), comparison), *comparison.worse]
        measures |= comparison.measures
    verdict = "not identified" if unseen else _verdict(fit, len(found.base), len(found.structural))
    scores = score_tests(fit, found.rows(), partial(disturbed_samples, stream, fit.equations.model))
    late = [] if gives_way(scores) else late_torques(fit, some)
    remarks += [*late, *suspicions(scores, all_late=bool(late))]
    doubts += [*made_up_for(scores), *([] if driving else misread_columns(fit, some)), *impossible]
    remarks += [*loss_remarks(fit, found.unfitted), *SUPPORT.notes(fit.equations.model.arm)]
    doubts = [*doubtful_losses(fit), *doubts]
    return replace(
        result.estimate,
        remarks=(*remarks, *doubts, *said, *unseen),
        fit=measures,
        verdict="not identified" if doubts else verdict,
    )


def _identifiability(result: ArmEstimate, found: FittedLog) -> Iterator[str]:
    """Sentences about what the log identifies of the arm."""
    fit, base, structural = result.fit, found.base, found.structural
    yield f"{len(base)} of {len(structural)} base parameters, condition number {fit.condition:.3g}"
    if len(base) < len(structural):
        lost = [base.columns[k].about for k in structural.independent if k not in set(base.independent)]
        yield f"this motion does not distinguish: {_listed(lost)}"
    if fit.condition > MEANINGLESS:
        yield "at this condition number single parameters mean nothing; design a motion that excites more"
    if len(fit.base) < len(base):
        names = dict(zip(base.independent, base.names, strict=True))
        left = [name for k, name in names.items() if k not in set(fit.base.independent)]
        yield f"{len(fit.base)} of them are essential; left out, as the log hardly determines them: {_listed(left)}"


def _doubtful_numbers(fit: ArmFit) -> Iterator[str]:
    """Sentences about parameters that may be 0, and about those below 0 that no arm has."""
    base = fit.base
    known = zip(base.names, fit.values, fit.std, strict=True)
    uncertain = [name for name, value, std in known if abs(value) < HALF_95 * std]
    if uncertain:
        yield f"not distinguishable from 0: {_listed(uncertain)}"
    negative = [
        base.columns[k].about
        for k, value, row in zip(base.independent, fit.values, base.regroup, strict=True)
        if value < 0 and not np.any(row) and base.columns[k].kind in ("rotor", "viscous", "coulomb")
    ]
    if negative:
        yield f"negative without being possible, which a record cannot hold: {_listed(negative)}"


def _about_joints(result: ArmEstimate, cutoff: float, stuck: float) -> Iterator[str]:
    """Sentences about the cut-off, poorly explained torques, rest, springs and outliers."""
    fit, model = result.fit, result.fit.equations.model
    if result.sensitive:
        yield f"leave their 95 % interval at a cut-off 30 % off {cutoff:.4g} Hz: {_listed(result.sensitive)}"
    for joint, r2 in zip(model.arm.names, fit.r2, strict=True):
        if r2 < POOR:
            yield (
                f"{joint}: R² {r2:.2f}, {1 - r2:.0%} of the torque's variance is not of this model; look at its friction, "
                "its springs and at what the torque column lacks"
            )
        elif np.isnan(r2):
            yield f"{joint}: no torque was measured, or it never changes"
    if result.bootstrap is not None:
        yield result.bootstrap.words
    resting = sum(each.at_rest for each in result.held_out)
    if resting:
        yield f"{resting} of {len(result.held_out)} held-out parts are at rest, where friction has no known direction"
    kept = {fit.base.columns[k].joint for k in fit.base.independent if fit.base.columns[k].kind in SPRINGS}
    for joint in model.sprung_joints:
        what, share = ("stay", "1 % or more") if joint in kept else ("are left out", "less than 1 %")
        yield f"{joint}: its spring and counterbalance {what}: they lower the held-out error by {share}"
    if fit.part_effect > 1.0:
        yield (
            f"parts of the log differ by {fit.part_effect**0.5:.2g} times what noise explains: something changes that is not in "
            "the model, as friction does that warms up; deviations are larger for it"
        )
    if stuck > 0:
        yield (
            f"rows near standstill are not fitted: with them numbers are up to {stuck:.2g} deviations off those in motion, as "
            "where joints stick, or turn back too slowly for the direction of their friction to be sure"
        )
    rows = fit.equations.rows
    for joint, share in zip(model.arm.names, 1.0 - rows / max(rows.max(), 1), strict=True):
        if 0.0 < share < 1.0 and not isinstance(model, LossyModel):
            why = "near standstill, or cut off at a limit" if stuck > 0 else "cut off at a limit"
            yield f"{joint}: {share:.0%} of its torques are not fitted: {why}, or filtered together with such"
    if fit.outliers is not None and fit.outliers.dropped > 0:
        yield f"{fit.outliers.dropped:.1%} of the torques count less than half as outliers"


def _about_record(result: ArmEstimate) -> list[str]:
    """Sentences about the values for a record."""
    if result.record is None:
        return []
    worst = max(float(np.nanmax(result.fit.r2 - result.record.r2)), 0.0)
    return [f"physically possible values for the record: R² at most {worst:.3f} lower", *result.record.physical.remarks]


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:MOST_NAMED])
    return shown if len(names) <= MOST_NAMED else f"{shown} and {len(names) - MOST_NAMED} more"
