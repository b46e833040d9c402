"""Kinematic calibration of an arm from measured points, poses or distances. [RothMooringRavani1987] [MooringRothDriels1991]"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from armwright.entry import AnyArm, as_arm, expect
from armwright.errors import IdentificationError, LogError, check_known
from armwright.fitting.directions import MEANINGLESS, directions, in_words, scaled
from armwright.identification.estimate import Estimate, Verdict
from armwright.identification.geometry.arm_chain import STORED, TERMS, checked_terms, has_masses
from armwright.identification.geometry.calibration import Calibration, HeldOutError, TriedTerm
from armwright.identification.geometry.fitting import (
    STAGES,
    GeometryFit,
    Loss,
    chosen_fit,
    covariance_of,
    fitted,
    folds_of,
    held_out,
    lengths,
    nearly_held_out,
    noise_of,
    squares_of_poses,
)
from armwright.identification.geometry.measurement_file import read_measurements
from armwright.identification.geometry.measurements import Measurements
from armwright.identification.geometry.problem import DISTANCE, Rows
from armwright.identification.geometry.setting import Setting, setting_of, two_or_more
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import Model
from armwright.model.load import load

AnyMeasurements: TypeAlias = Measurements | str | os.PathLike[str]
FOLDS = 10
SURE = 2.0  # standard errors by which a term must lower the held-out squares
ABSURD = 0.05  # error of poses held out by the arm's reach, from which measurements are in doubt
WEAKEST = 3  # directions that are named
PARALLEL = 1e-3  # sine of the twist between axes
ENOUGH = 2.0  # measured numbers by parameter, below which no further term is tried
FEW = 3.0  # measured numbers by parameter, below which a user should know


def calibrate(
    measurements: AnyMeasurements,
    arm: AnyArm | None = None,
    *,
    terms: Sequence[str] = STORED,
    loss: Loss = "tukey",
    folds: int = FOLDS,
) -> Calibration:
    """Corrections of an arm's geometry from joint readings with measured points, poses or distances.

    Least squares over all corrections that the structure and the poses separate, whole poses weighted by their error
    (`loss`). Corrections of the record have a prior of a size that the held-out error chooses, so that what the poses hardly
    determine stays near the record. Deviations count what the errors of a pose's points have in common.

    Args:
        measurements: `Measurements`, or the path of a `*.calibration.toml`.   arm: the arm; absent: the file's.
        terms: some of "zeros", "frames" (rows and frames of joints), "eccentricity" (of gears, first harmonic),
            "joint compliance" and "link compliance" (under gravity). Of those that are not asked for it is said whether the
            poses show them; only "zeros" and "frames" can be written into a record.
        loss: "tukey" (wrong poses do not count), "huber" (they count less) or "squares".
        folds: parts of the poses that take turns in being held out.
    Returns:
        calibration: corrections with deviations, errors of poses held out, and the record.
    Raises:
        LogError: a file that cannot be read.   IdentificationError: too few poses, an unknown term or joint.
        ModelError: no arm, or no such frame.
    Example:
        >>> arm, q = aw.load("lwa4p"), np.random.default_rng(0).uniform(-1.5, 1.5, (30, 6))
        >>> real = aw.compile(arm.with_values({"joint2.dh.offset_rad": -1.56}))  # as built
        >>> tip = real.forward_kinematics(q)[:, :3, 3]  # as a tracker sees it [m]
        >>> measured = [aw.identification.Measured("tip", "point", tip)]
        >>> poses = aw.identification.Measurements(arm.names, q, measured)
        >>> print(aw.calibrate(poses, arm, terms=["zeros"]).sentences()[0])
        identified
    """
    given = arm if arm is None or isinstance(arm, (str, os.PathLike)) else as_arm(arm)
    if not isinstance(measurements, Measurements):
        expect(measurements, str | os.PathLike, "measurements", "Measurements, or their file", LogError)
        measurements = read_measurements(measurements)
    model = given if isinstance(given, Model) else _loaded(measurements, given)
    terms = checked_terms(terms, model)
    check_known(IdentificationError, loss, STAGES, place="loss")
    count = two_or_more("folds", folds)
    setting = setting_of(model, measurements, terms)
    fit, plain, tried = chosen_fit(setting, loss, count)
    parts = folds_of(plain, count)
    bare = fitted(setting_of(model, measurements, ()), loss)
    before, after = held_out(bare, parts), held_out(fit, parts)
    errors = tuple(_errors(group, before, fit, after) for group in lengths(fit.rows))
    others = [term for term in TERMS if term not in terms and ("compliance" not in term or has_masses(model))]
    squares = [squares_of_poses(fit, each) for each in (before, after)]
    found = Calibration(
        _estimate(fit, plain, loss, errors, _surely_lower(*squares) and not _absurd(setting, errors)),
        fit,
        errors,
        noise_of(plain),
        tried,
        tuple(_tried_terms(fit, others, loss, parts)),
        np.stack([_by_pose(each, len(setting.q)) for each in (before, after)]),
    )
    return replace(found, estimate=replace(found.estimate, remarks=tuple(_remarks(found))))


def _loaded(measurements: Measurements, name: str | os.PathLike[str] | None) -> Model:
    """The arm of a name or file, or that the measurements name; its masses may be impossible, the geometry is not."""
    name = measurements.robot if name is None else name
    if name is None:
        raise IdentificationError("no arm", place="arm", expected="an arm, or robot in the file of measurements")
    return load(name, on_impossible="warn", kinematics_only=measurements.kinematics_only)


def _errors(group: str, before: Rows, fit: GeometryFit, after: Rows) -> HeldOutError:
    """Errors of a group in the fit, and of poses held out under the record as it is and calibrated."""
    fitted_to, record, held = (lengths(rows)[group] for rows in (fit.rows, before, after))
    poses = fit.rows.pose[fit.rows.group == group][:: 1 if group == DISTANCE else 3]
    counted = fit.weights[poses] > 0.0
    rms = [float(np.sqrt((each**2).mean())) for each in (fitted_to, record[counted], held[counted], record, held)]
    return HeldOutError(group, *rms, most=float(held[counted].max()))  # type: ignore[misc]


def _by_pose(rows: Rows, poses: int) -> np.ndarray:
    """(poses,) rms length of the errors of the first group; NaN where nothing was measured."""
    first = rows.group == rows.group[0]
    points = np.bincount(rows.pose[first], minlength=poses) / (3 if rows.group[0] != DISTANCE else 1)
    squares = np.bincount(rows.pose[first], rows.errors[first] ** 2, minlength=poses)
    return np.sqrt(np.divide(squares, points, out=np.full(poses, np.nan), where=points > 0))


def _surely_lower(before: np.ndarray, after: np.ndarray) -> bool:
    """True if squares of poses held out (poses,) fall by more than two standard errors of their mean difference."""
    gain = before - after
    return bool(gain.mean() > SURE * gain.std(ddof=1) / np.sqrt(len(gain)))


def _tried_terms(
    fit: GeometryFit, terms: Sequence[str], loss: Loss, parts: Sequence[np.ndarray]
) -> Iterator[TriedTerm]:
    """Further terms, each beside those that were found before it: the one that gains most comes first."""
    now, left = fit, list(terms)
    while left:
        pairs = [pair for pair in (_tried(fit, now, term, loss, parts) for term in left) if pair is not None]
        found = [pair for pair in pairs if pair[0].found]
        if not found:
            yield from (term for term, _ in pairs)
            return
        best, now = min(found, key=lambda pair: pair[0].held_out)
        yield best
        left.remove(best.term)


def _tried(
    fit: GeometryFit, now: GeometryFit, term: str, loss: Loss, parts: Sequence[np.ndarray]
) -> tuple[TriedTerm, GeometryFit] | None:
    """A further term by what it does to the squares of poses held out; None where the poses are too few for it.

    Args:
        fit: of the calibration, whose poses count.   now: with the terms that were found.   term: to try beside them.
        loss: what large errors cost.   parts: of the poses.
    """
    setting = now.setting
    try:
        wider = setting_of(setting.arm, setting.measurements, (*setting.terms, term))
    except IdentificationError:
        return None
    if len(fit.rows.errors) < ENOUGH * len(wider.grouped):
        return None
    with_term = replace(fitted(wider, loss, fit.strength), scales=fit.scales)
    squares = [squares_of_poses(fit, nearly_held_out(each, parts)) for each in (now, with_term)]
    sure = _surely_lower(*squares)
    spread = np.sqrt(np.diag(covariance_of(with_term, noise_of(with_term))))
    values = tuple(
        (column.name, float(value), float(std), column.unit)
        for column, value, std in zip(wider.kept, with_term.values, spread, strict=True)
        if column.kind == term
    )
    without, held = (float(np.sqrt(each.mean())) for each in squares)
    return TriedTerm(term, sure and bool(values), without, held, values), with_term


def _estimate(
    fit: GeometryFit, plain: GeometryFit, loss: Loss, errors: Sequence[HeldOutError], better: bool
) -> Estimate:
    """Corrections with their covariance."""
    setting, measurements = fit.setting, fit.setting.measurements
    kept = setting.kept
    condition = directions(scaled(plain.rows.jacobian)[0])[0].condition if kept else 1.0
    verdict: Verdict = "identified" if better else "not identified"
    return Estimate(
        tuple(column.name for column in kept),
        fit.values,
        covariance_of(fit, noise_of(plain)),
        measurements.sha256,
        f"kinematic calibration: least squares, {loss}, prior of {fit.strength:g} σ/τ",
        units=tuple(column.unit for column in kept),
        condition=condition,
        fit={each.group: {"rms": each.fit, "held_out": each.calibrated} for each in errors},
        verdict=verdict,
        log=measurements.name or "measurements",
    )


def _remarks(found: Calibration) -> Iterator[str]:
    """Sentences for the user."""
    setting, fit = found.fit.setting, found.fit
    yield from setting.measurements.findings
    yield from setting.remarks
    if fit.outliers:
        poses = ", ".join(str(k + 1) for k in fit.outliers)
        yield f"pose {poses}: errors far beyond those of the others; they do not count"
    rows, count = len(fit.rows.errors), len(fit.values)
    if rows < FEW * count:
        yield f"{rows} measured numbers for {count} corrections: more poses would make them surer"
    unit, _ = scaled(fit.rows.jacobian)
    names = [column.name for column in setting.kept]
    for each in directions(unit)[:WEAKEST] if count else ():
        if each.condition > MEANINGLESS:
            yield in_words(each, names, "other poses would").replace("motion", "choice of poses")
    if "frames" in setting.terms:
        yield from _parallel(setting)
    for each in found.tried_terms:
        if each.found:
            yield f"{each.term} is seen in the poses; a record has no number for it, so IK and plans do not count it"
    absurd = _absurd(setting, found.errors)
    yield from absurd
    if not found.good and not absurd:
        yield "poses held out are predicted no better than by the record as it is, or not surely so"


def _absurd(setting: Setting, errors: Sequence[HeldOutError]) -> list[str]:
    """A sentence where poses held out are missed by so much that no arm is off so far: the measurements are misread."""
    placed = (each for q in setting.q for each in body_placements(setting.arm, q).values())
    reach = max(float(np.linalg.norm(each.matrix()[:3, 3].astype(float))) for each in placed)
    return [
        f"poses held out are missed by {each.calibrated:.3g} m, of a reach of {reach:.3g} m: are units, columns, joints and the "
        "order of the poses right?"
        for each in errors
        if each.group == "position" and each.calibrated > ABSURD * reach
    ]


def _parallel(setting: Setting) -> Iterator[str]:
    """Sentences on parallel axes of Denavit-Hartenberg rows. [Hayati1983]"""
    corrected = {column.joint for column in setting.kept}
    for joint in setting.arm.record.moving_joints:
        row = joint.dh or joint.modified_dh
        if (
            joint.name in corrected
            and row is not None
            and abs(np.sin(row.alpha_rad.number)) < PARALLEL
            and joint.kind.turns
        ):
            yield f"{joint.name} has a row of parallel axes, which cannot tilt about y: a joint with frame can"
