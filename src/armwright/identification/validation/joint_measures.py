"""Measures of one quantity of one joint over all judged runs, with remarks in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armwright.fitting.measures import Agreement, agreement, at_rest, rms
from armwright.fitting.residuals import (
    ChiSquared,
    Correlation,
    autocorrelation,
    cross_correlation,
    ljung_box,
    parts_of,
    residual_spectrum,
)
from armwright.identification.logs.delay import SignalDelay, delay_of
from armwright.identification.validation.friction_signature import FrictionSignature, SignatureTerm, friction_signature
from armwright.identification.validation.prediction import Prediction, Quantity

OPPOSED, ALIKE = -0.7, 0.85  # correlations from which on a wrong sign, or a wrong scale, is named
SCALES = (0.75, 1.33)  # of measured over predicted: what lies between needs no wrong gear ratio
WORSE = 2.0  # times the median RMS: a run that stands out
CAUSES = {  # of a wrong scale
    "torque": "a wrong gear ratio or torque constant",
    "motion": "a wrong gear ratio, motor constant or friction",
}
AS_HELD = ", as a command does that is held from row to row: `held = true` in the log's file says so"
HALF = 0.15  # samples: as far from half a sample a delay is that of a hold
LATE = 0.3  # samples: shorter delays are as the differences of counts have them


@dataclass(frozen=True)
class AtRest:
    """Rows of a joint at rest, which R² does not count.

    Attributes:
        rows: how many.   measured, predicted: means.   rms: of the residual.
    """

    rows: int
    measured: float
    predicted: float
    rms: float


@dataclass(frozen=True, eq=False)
class JointMeasures:
    """Measures of one quantity of one joint.

    Attributes:
        joint, quantity, unit.   how: it was predicted, in words.
        overall: over all runs in which the joint moves.   runs: each of these.   at_rest: rows at rest, by run.
        autocorrelation, whiteness: of the residual.   cross: with the input.   input_name: which.
        delay: of the measured behind the predicted signal, in samples of the log.   period: of these [s].
        spectrum: f in Hz, power densities of the residual and of the measured signal.   friction: of torques.
        diverged: windows whose simulation diverged.   remarks: what a user should know, one sentence each.
    """

    joint: str
    quantity: Quantity
    unit: str
    how: str
    overall: Agreement
    runs: Mapping[str, Agreement]
    at_rest: Mapping[str, AtRest]
    autocorrelation: Correlation | None
    whiteness: ChiSquared | None
    cross: Correlation | None
    input_name: str
    delay: SignalDelay | None
    period: float
    spectrum: tuple[np.ndarray, np.ndarray, np.ndarray] | None
    friction: FrictionSignature | None
    diverged: int
    remarks: tuple[str, ...] = ()

    @property
    def spread(self) -> tuple[float, float]:
        """Lowest and highest RMS of the residual of a run, in the signal's unit."""
        values = [each.rms for each in self.runs.values()]
        return (min(values), max(values)) if values else (np.nan, np.nan)

    @property
    def worst(self) -> str | None:
        """The run with the largest RMS of the residual; None where the joint moves in none."""
        return max(self.runs, key=lambda name: self.runs[name].rms, default=None)


def joint_measures(predictions: Sequence[Prediction], column: int, still: set[str]) -> JointMeasures:
    """Measures of one joint over predictions of the same quantity, a run each.

    Args:
        predictions: of several runs.   column: the joint's.   still: runs in which it does not move.
    """
    first = predictions[0]
    moving = [each for each in predictions if each.run not in still]
    masks = _rests(moving, column)
    at_rest = {each.run: _at_rest(each, column) for each in predictions if each.run in still}
    at_rest |= {each.run: _at_rest(each, column, mask) for each, mask in zip(moving, masks, strict=True) if mask.any()}
    moves = [(each, ~mask) for each, mask in zip(moving, masks, strict=True)]
    runs = {each.run: agreement(each.measured[m, column], each.predicted[m, column]) for each, m in moves}
    rows, numbers = _joined(moves, column)
    measured, predicted, parts = rows["measured"], rows["predicted"], parts_of(numbers)
    residual = measured - predicted
    auto = autocorrelation(residual, parts)
    delay = delay_of(measured, predicted, parts)
    if delay is not None:
        delay = replace(delay, samples=delay.samples * first.every, std=delay.std * first.every)
    unit, friction = first.units[column], None
    if first.quantity == "torque" and {"speed", "acceleration"} <= set(rows):
        length, size = "m" if unit == "N" else "rad", rms(measured) if len(residual) else 0.0
        motion = rows["speed"], rows["acceleration"]
        friction = friction_signature(residual, *motion, unit, length, rows.get("direction"), size)
    found = JointMeasures(
        first.joints[column],
        first.quantity,
        unit,
        first.how,
        agreement(measured, predicted),
        runs,
        at_rest,
        auto,
        None if auto is None else ljung_box(auto, len(residual)),
        cross_correlation(residual, rows["inputs"], parts) if "inputs" in rows else None,
        first.input_name,
        delay,
        1.0 / (first.rate * first.every),
        residual_spectrum(residual, measured, parts, first.rate),
        friction,
        sum(each.diverged for each in moving),
    )
    return replace(found, remarks=tuple(remarks(found)))


def moving_rows(predictions: Sequence[Prediction], column: int, still: set[str]) -> tuple[np.ndarray, np.ndarray]:
    """Measured and predicted values (rows,) that the measures of a joint count, of all runs one after the other.

    Args:
        predictions: of one quantity, a run each.   column: the joint's.   still: runs in which it does not move.
    """
    moving = [each for each in predictions if each.run not in still]
    rows, _ = _joined([(each, ~mask) for each, mask in zip(moving, _rests(moving, column), strict=True)], column)
    return rows["measured"], rows["predicted"]


def _rests(moving: Sequence[Prediction], column: int) -> list[np.ndarray]:
    """(rows,) of every run, True for rows in a period of rest.

    Dry friction at rest is whatever holds the joint; its law, which goes by the sign of a speed of mere noise, predicts nothing.
    """
    speeds = [each.speed[:, column] for each in moving if each.speed is not None]
    top = max((float(np.abs(speed).max(initial=0.0)) for speed in speeds), default=0.0)
    masks = []
    for each in moving:
        if each.quantity == "torque" and each.speed is not None:
            masks.append(at_rest(each.speed[:, column], top, each.rate))
        else:
            masks.append(np.zeros(len(each.t), dtype=bool))
    return masks


def _at_rest(prediction: Prediction, column: int, rows: np.ndarray | None = None) -> AtRest:
    """Means over the rows of a mask (rows,); None: over all."""
    y, p = prediction.measured[:, column], prediction.predicted[:, column]
    both = np.isfinite(y) & np.isfinite(p) & (True if rows is None else rows)
    if not both.any():
        return AtRest(0, np.nan, np.nan, np.nan)
    return AtRest(int(both.sum()), float(y[both].mean()), float(p[both].mean()), rms((y - p)[both]))


def _joined(moves: Sequence[tuple[Prediction, np.ndarray]], column: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Signals (rows,) of one joint over all runs in which it moves, rows that are not finite left out; numbers of stretches.

    A signal that one of the runs does not have is left out.
    """
    kept = [m & np.isfinite(each.measured[:, column]) & np.isfinite(each.predicted[:, column]) for each, m in moves]
    rows, number, parts = {}, 0, [np.zeros(0, dtype=int)]
    for name in ("measured", "predicted", "speed", "acceleration", "inputs", "direction"):
        values = [getattr(each, name) for each, _ in moves]
        if not any(each is None for each in values):
            chosen = (each[mask, column] for each, mask in zip(values, kept, strict=True))
            rows[name] = np.concatenate([np.zeros(0), *chosen])
    for (each, _), mask in zip(moves, kept, strict=True):
        changes = (np.diff(each.part, prepend=each.part[:1]) != 0) | (np.diff(mask, prepend=mask[:1]) != 0)
        parts.append(number + np.cumsum(changes)[mask])
        number += int(changes.sum()) + 1
    return rows, np.concatenate(parts)


def remarks(found: JointMeasures) -> list[str]:
    """Remarks on the measures, one sentence each, the gravest first."""
    all_runs, said = found.overall, []
    if found.diverged:
        said.append(
            f"{_plural(found.diverged, 'simulated window')} diverged: with these commands the model is unstable"
        )
    if not found.runs:
        said.append(f"{found.joint} stands still in every judged run: nothing is said about it")
    elif np.isnan(all_runs.r2):
        said.append(f"the measured {found.quantity} is constant although the joint moves: is the column the right one?")
    elif all_runs.correlation <= OPPOSED:
        said.append(
            f"the sign of the {found.quantity} looks wrong: measured and predicted move against each other "
            f"(correlation {all_runs.correlation:.2f}); look at `signs` in the log, and at the joint's axis"
        )
    elif all_runs.correlation >= ALIKE and not SCALES[0] <= all_runs.gain <= SCALES[1]:
        causes = CAUSES["torque" if found.quantity == "torque" else "motion"]
        said.append(
            f"the measured {found.quantity} is {all_runs.gain:.3g} times the predicted one: this looks like {causes}"
        )
    if found.delay is not None and abs(found.delay.samples) > max(LATE, 3 * found.delay.std):
        d = found.delay
        said.append(
            f"the measured {found.quantity} comes {abs(d.samples):.2f} ± {d.std:.2g} samples "
            f"({1e3 * abs(d.samples) * found.period:.3g} ms) {'after' if d.samples > 0 else 'before'} the predicted one"
            f"{AS_HELD if found.quantity == 'torque' and abs(d.samples + 0.5) < max(HALF, 3 * d.std) else ''}"
        )
    if found.friction is not None:
        said += _friction(found.friction)
    if len(found.runs) > 2:
        middle = float(np.median([each.rms for each in found.runs.values()]))
        worst = found.worst
        if worst is not None and found.runs[worst].rms > WORSE * middle > 0:
            times = found.runs[worst].rms / middle
            said.append(f"run {worst!r} stands out: its residual is {times:.1f} times that of the usual run")
    return said


def _friction(signature: FrictionSignature) -> list[str]:
    """Missing terms of the record, a sentence each; several terms of friction, which can replace each other, in one."""
    friction = [term for term in signature.missing if term.name in ("Coulomb", "viscous", "Stribeck")]
    if len(friction) < 2:
        return [_missing(term) for term in signature.missing]
    differs = ", ".join(f"{term.name} {term.value:+.3g} {term.unit}" for term in friction).replace("-", "−")
    together = f"with offset and inertia {100 * signature.explained:.0f} % of the residual's power"
    others = [_missing(term) for term in signature.missing if term not in friction]
    return [f"friction differs from the record's: {differs}; {together}", *others]


def _missing(term: SignatureTerm) -> str:
    """A term of friction that a record lacks, or has too much of, as a sentence."""
    words = {
        "offset": "a constant torque (an offset of the current sensor, or a weight)",
        "Coulomb": "Coulomb friction", "viscous": "viscous friction", "Stribeck": "a Stribeck peak at low speed",
        "inertia": "inertia (of the rotor, say)",
    }  # fmt: skip
    share = f"{100 * term.share:.0f} % of the residual's power"
    if term.value < 0 and term.name != "offset":
        return f"the record has {-term.value:.3g} {term.unit} too much of {words[term.name]}: {share}"
    return f"{words[term.name]} of {term.value:.3g} ± {term.std:.1g} {term.unit} is missing: {share}"


def _plural(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"
