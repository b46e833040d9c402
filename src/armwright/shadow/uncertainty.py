"""Standard deviations of an arm's torque residual, from the uncertainties in its record.

The first of these that there is:

| source   | deviation of a joint                                                                                          |
|----------|---------------------------------------------------------------------------------------------------------------|
| given    | as the caller says                                                                                            |
| verdict  | RMS of the residual torque when `validate` compared the record with a log; noise and friction are in it       |
| fit      | RMS of the fit that the record's numbers came from                                                            |
| record   | of torques at rest and in slow motion, from the standard deviations of the record's numbers: J Σ Jᵀ           |
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.identification.validation.verdict import StoredVerdict, stored_verdict
from armwright.kernels.compiled import compile_arm
from armwright.model import Model

POSES = 64  # at which torques of other parameters are compared
SLOW = 0.1  # [rad/s | m/s] of the joints there
STEP = 1e-3  # of a deviation: over so little torques are straight
WIDEST = np.pi  # [rad | m] of a joint without position limits, either way


@dataclass(frozen=True, eq=False)
class Deviations:
    """Standard deviations of the torque residual.

    Attributes:
        values: (n,) [N m | N]; NaN where nothing is known.   source: in words.
    """

    values: np.ndarray
    source: str


def torque_deviations(arm: Model, record: str | os.PathLike[str] | None = None, given: Any = None) -> Deviations:
    """Standard deviations of the torque residual of every joint.

    Args:
        arm: the model.   record: path of its file, beside which a verdict may stand; None: it has none.
        given: (n,) or one number [N m | N] of the caller.
    Returns:
        deviations: with their source.
    Raises:
        ScenarioError: a given one that is not above 0.   LogError: a verdict that cannot be read.
    """
    if given is not None:
        return Deviations(_given(arm, given), "given")
    verdict = verdict_of(record)
    if verdict is not None and verdict.belongs:
        measures = verdict.table.measures
        values = [measures.get(name, {}).get("torque", {}).get("rms", np.nan) for name in arm.names]
        if np.isfinite(values).all():
            return Deviations(np.array(values, dtype=float), f"residuals of the validation with {verdict.table.log}")
    fits = {} if arm.description is None else arm.description.fits
    for key, fit in fits.items():
        values = [fit.measures.get(name, {}).get("rms", np.nan) for name in arm.names]
        if np.isfinite(values).all():
            return Deviations(np.array(values, dtype=float), f"residuals of the fit {key!r} in the record")
    known = _propagated(arm)
    if known is not None:
        return Deviations(known, "standard deviations of the record's numbers")
    return Deviations(np.full(arm.n, np.nan), "not known: the record states none, and there is no verdict on it")


def verdict_of(record: str | os.PathLike[str] | None) -> StoredVerdict | None:
    """The verdict beside a record's file; None for a built-in arm or without a verdict.

    Raises:
        LogError: one that cannot be read.
    """
    return stored_verdict(record) if record is not None and Path(record).is_file() else None


def _given(arm: Model, given: Any) -> np.ndarray:
    """Raises:
    ScenarioError: not one number, or one for each joint, above 0.
    """  # fmt: skip
    try:
        values = np.broadcast_to(scalar.real_numbers(given), arm.n).astype(float)
    except ValueError:
        values = np.full(arm.n, np.nan)
    if not (np.isfinite(values).all() and (values > 0.0).all()):
        expected = f"a torque above 0, or {arm.n} of them"
        raise ScenarioError(place="deviation", value=given, expected=expected)
    return values


def _propagated(arm: Model) -> np.ndarray | None:
    """(n,) the largest deviation of each joint's torque over random poses, by differences; None: no number has a deviation."""
    if arm.description is None or arm.changes:
        return None
    stated = [each for each in arm.parameters if each.std]
    if not stated:
        return None
    names, std = [each.name for each in stated], np.array([each.std for each in stated])
    covariance = np.diag(std**2)
    for fit in arm.description.fits.values():
        if fit.correlation:
            pairs = [(names.index(name), k) for k, name in enumerate(fit.names) if name in names]
            rows, of_fit = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
            correlation = fit.correlation_matrix()[of_fit[:, None], of_fit]
            covariance[rows[:, None], rows] = np.outer(std[rows], std[rows]) * correlation
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    rng = np.random.default_rng(0)
    q = rng.uniform(np.where(np.isfinite(low), low, -WIDEST), np.where(np.isfinite(high), high, WIDEST), (POSES, arm.n))
    qd = SLOW * rng.choice([-1.0, 1.0], q.shape)
    dyn = compile_arm(arm, vary=names)
    nominal = np.array([each.value for each in stated])
    # upwards: friction may be 0, and not below
    moved = np.concatenate([nominal[None], nominal + STEP * np.diag(std)])[:, None]
    torques = dyn.inverse_dynamics(q, qd, np.zeros_like(q), moved)
    slope = (torques[1:] - torques[0]) / (STEP * std[:, None, None])  # (k, poses, n)
    return np.sqrt(np.einsum("kpn,kl,lpn->pn", slope, covariance, slope).max(axis=0))
