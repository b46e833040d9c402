"""Conclusion of a fit of drives: estimate, measures, predictions, and unidentifiable parameters in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from armwright.description.robot import RobotDescription
from armwright.fitting.directions import listed
from armwright.identification.estimate import Estimate
from armwright.identification.logs.log import Log
from armwright.identification.motor.fitting import Fitted, covariance, without
from armwright.identification.motor.guess import Guess
from armwright.identification.motor.held_out import held_out
from armwright.identification.motor.measured import Measured
from armwright.identification.motor.predictions import Measures, predictions_of
from armwright.identification.motor.problem import sizes
from armwright.identification.motor.report import MotorFit
from armwright.identification.motor.separating import separating
from armwright.identification.motor.unknowns import values_of

EXPLAINED = 0.5  # R² of a signal below which the model does not describe the log
CURRENT = 0.9  # R² of a current below which its rows may be others than is taken
FAR = 3.0  # deviations from its prior at which a number contradicts it
NOTHING_NEW = 0.9  # of the prior's deviation that is left: the log says next to nothing
WORSE = 15.0  # per cent of fit by which a run that was held out is described worse
UNKNOWN = 0.9  # deviation, as a share of a number, from which on nothing is known of it but its place in ratios
AT_BOUND = 1e-6  # of a range: nearer to its end is at the bound
WORDS = {
    "R": "resistance",
    "L": "inductance",
    "Kt": "torque constant",
    "Ke": "back-EMF constant",
    "J": "rotor inertia",
    "efficiency": "gear efficiency",
}


def concluded(
    log: Log, record: RobotDescription, data: Measured, done: Fitted, free: Sequence[str] | None, *, bench: bool = False,
    locked: bool = False, first: Guess,
) -> MotorFit:  # fmt: skip
    """The estimate with measures, predictions and remarks.

    Args:
        log, data: what was fitted.   record: with the first guesses.   done: the fit.   free: the names that were asked for.
        bench: no record has values for numbers that the log does not determine.   locked: the rotors were held.
        first: the coarse guess of the first motor.
    """
    problem, kept = done.problem, done.kept
    inner = without(problem, done.held, done.z)
    residuals, (jacobian,) = inner.evaluate(done.z[kept][None])
    values, rates = values_of(problem.unknowns, done.z)
    spread = covariance(inner, residuals[0], jacobian)
    if done.more is not None:
        spread = spread + done.more[np.ix_(kept, kept)]
    if bench:
        spread = spread + _of_held(done, record, data, jacobian)
    whole = np.full((len(values), len(values)), np.nan)
    whole[np.ix_(kept, kept)] = spread * np.outer(rates[kept], rates[kept])
    identifiable = np.array([k not in done.held or k in done.zero for k in range(len(values))])
    at_bound = _at_bound(done, identifiable)
    columns, names, units, scale = _shown(done, data)
    predictions, measures = predictions_of(inner, done.z[kept], data)
    fresh, fresh_measures, why_not = held_out(log, record, data, done, locked)
    judgements, doubts = _of_measures(measures, fresh_measures)
    clauses = separating(record, data, done, first)
    remarks = [*data.remarks, *done.remarks, *_in_words(done, values, data, clauses), *_of_priors(done, whole)]
    wrong = [*_unfitted(done, free, at_bound), *doubts, *_unknown(done, values, whole)]
    lengths = np.linalg.svd(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300), compute_uv=False)
    estimate = Estimate(
        names=tuple(names),
        values=values[columns] * scale,
        covariance=whole[np.ix_(columns, columns)] * np.outer(scale, scale),
        sha256=log.sha256,
        method=f"output error of {', '.join(data.signals)} driven by {data.command}",
        units=tuple(units),
        at_bound=at_bound[columns],
        identifiable=identifiable[columns],
        remarks=(*remarks, *judgements, *why_not, *wrong),
        condition=float(lengths[0] / max(lengths[-1], 1e-300)),
        fit={**measures, **fresh_measures},
        verdict="not identified" if wrong else "identified",
        log=log.path.name,
    )
    cost = 0.5 * float((residuals[0] ** 2).sum())
    return MotorFit(_with_drift(estimate, done, values), record, predictions | fresh, None, cost)


def _at_bound(done: Fitted, identifiable: np.ndarray) -> np.ndarray:
    """(k,) True for unknowns at a bound of their search."""
    low, high = done.problem.bounds
    near = AT_BOUND * np.maximum(high - low, 1e-300)
    found = identifiable & ((done.z - low < near) | (high - done.z < near))
    found[done.ends] = True
    return found


def _unfitted(done: Fitted, free: Sequence[str] | None, at_bound: np.ndarray) -> list[str]:
    """Sentences on numbers that were asked for and are not identified, and on those at a bound of their search."""
    unknowns = done.problem.unknowns
    asked = dict.fromkeys(unknowns[k].short for k in done.held if k not in done.zero)
    ends = [unknowns[k] for k in np.flatnonzero(at_bound) if k not in done.zero and unknowns[k].label != "start"]
    return [
        *(f"{name} was to be fitted, but cannot be identified from this log" for name in asked if name in (free or ())),
        *(
            f"{each.name} stands at a bound of its search: the log, or the model, does not determine it"
            for each in ends
        ),
    ]


def _unknown(done: Fitted, values: np.ndarray, covariance: np.ndarray) -> list[str]:
    """A sentence where no number of the motor is known better than to its size, as without a scale of torques."""
    motors = [k for k in done.kept if done.problem.unknowns[k].paths and values[k]]
    std = np.sqrt(np.diag(covariance)[motors])
    if not motors or (std < UNKNOWN * np.abs(values[motors])).any():
        return []
    return [
        "the log determines ratios of the motor's numbers alone: say one that is known, such as --fix Kt=… (fixed=…)"
    ]


def _of_measures(measures: Measures, fresh: Measures) -> tuple[list[str], list[str]]:
    """Sentences on signals that are described badly, and those for which nothing is identified; `fresh` are of runs held out."""
    remarks, wrong = [], []
    for name, each in measures.items():
        if each["r2"] < EXPLAINED:
            what = f"R² of {name} is {each['r2']:.2g}: the model does not describe this log"
            wrong.append(f"{what}; look for exchanged columns, signs and units with `armwright log`")
        elif name.endswith("current") and each["r2"] < CURRENT:
            remarks.append(
                f"R² of {name} is only {each['r2']:.2g}: a current is compared with the one just before its row's command acts"
            )
    for name, each in fresh.items():
        if each["r2"] < EXPLAINED:
            wrong.append(f"R² of {name} is {each['r2']:.2g}: the fit does not describe a run that it has not seen")
        elif each["fit_percent"] < min(own["fit_percent"] for own in measures.values()) - WORSE:
            what = f"{name} is described worse than what was fitted: something differs from run to run, such as the friction"
            remarks.append(f"{what}; fit both runs and give it to --per-run (per_run=…), which gives the drift")
    return remarks, wrong


def _of_held(done: Fitted, record: RobotDescription, data: Measured, jacobian: np.ndarray) -> np.ndarray:
    """Covariance of the fitted coordinates from numbers that were held and that nobody knows: each may be off by its size."""
    unknowns = done.problem.unknowns
    unknown = [  # a held resistance is a scale that no log of this kind tells: the others are ratios to it
        k for k in done.held if k not in done.zero and not (unknowns[k].nuisance or unknowns[k].logarithmic)
    ]
    total = np.zeros((len(done.kept), len(done.kept)))
    if unknown:
        every, size = done.problem.jacobian(done.z), sizes(record, data, done.problem, done.z)
        for k in unknown:
            shift = np.linalg.lstsq(jacobian, -every[:, k] * size[k], rcond=1e-10)[0]
            total += np.outer(shift, shift)
    return total


def _shown(done: Fitted, data: Measured) -> tuple[list[int], list[str], list[str], np.ndarray]:
    """Unknowns that the estimate has, one for each path: their numbers, names, units and factors to these."""
    columns: list[int] = []
    names: list[str] = []
    units: list[str] = []
    scale: list[float] = []
    for k, each in enumerate(done.problem.unknowns):
        is_delay = each.name == "delay"
        if each.label == "start" or (is_delay and k in done.held):
            continue
        for path in each.paths or ("delay_s" if is_delay else each.name,):
            columns.append(k)
            names.append(f"{each.run}: {path}" if each.run else path)
            units.append("s" if is_delay else each.shown_unit)
            scale.append(data.period if is_delay else 1.0)
    return columns, names, units, np.array(scale)


def _of_priors(done: Fitted, covariance: np.ndarray) -> list[str]:
    """Comparison of the record's prior values with the combined estimate."""
    if done.problem.prior is None:
        return []
    sentences = []
    for k in np.flatnonzero(np.isfinite(done.problem.prior[1])):
        each, (middle, spread) = done.problem.unknowns[k], done.problem.prior[:, k]
        before, rates = values_of([each], np.array([middle]))
        unit = "" if each.shown_unit == "1" else f" {each.shown_unit}"
        std, was = float(np.sqrt(covariance[k, k])), float(rates[0] * spread)
        what = f"{each.name}: {before[0]:.4g} ± {was:.2g}{unit} in the record is a prior"
        away = abs(done.z[k] - middle) / spread
        if k in done.held:
            sentences.append(f"{what}, and all that is known")
        elif away > FAR:
            sentences.append(
                f"{what}, {away:.1f} deviations from the fit: the log and the record contradict each other"
            )
        else:
            sentences.append(what + ("; the log adds next to nothing" if std > NOTHING_NEW * was else ""))
    return sentences


def _with_drift(estimate: Estimate, done: Fitted, values: np.ndarray) -> Estimate:
    """The estimate with the mean of what every run has its own of, its deviation that between runs, and a sentence about it."""
    unknowns = done.problem.unknowns
    rows: list[tuple[str, float, float, str]] = []
    remarks: list[str] = []
    for label in dict.fromkeys(each.label for each in unknowns):
        own = [k for k, each in enumerate(unknowns) if each.label == label and each.run and each.paths]
        if len(own) < 2 or any(k in done.held for k in own):
            continue
        each = values[own]
        middle, between = float(each.mean()), float(each.std(ddof=1))
        drift = (each.max() - each.min()) / abs(middle) if middle else 0.0
        listed = ", ".join(f"{value:.4g} in {unknowns[k].run!r}" for k, value in zip(own, each, strict=True))
        name = unknowns[own[0]].name
        remarks.append(f"{name} drifts by {drift:.1%} between runs: {listed}; the record gets their mean")
        rows += [(path, middle, between, unknowns[own[0]].shown_unit) for path in unknowns[own[0]].paths]
    if not rows:
        return estimate
    names, middles, betweens, units = zip(*rows, strict=True)
    return replace(
        estimate,
        names=(*estimate.names, *names),
        values=np.concatenate([estimate.values, middles]),
        units=(*estimate.units, *units),
        covariance=block_diag(estimate.covariance, np.diag(np.square(betweens))),
        at_bound=np.append(np.asarray(estimate.at_bound), np.zeros(len(rows), dtype=bool)),
        identifiable=np.append(np.asarray(estimate.identifiable), np.ones(len(rows), dtype=bool)),
        remarks=(*estimate.remarks, *remarks),
    )


def called_in_words(done: Fitted, k: int) -> str:
    """An unknown in words: "viscous friction"."""
    name = done.problem.unknowns[k].short
    return WORDS.get(name, name.replace("_", " ") + (" friction" if name in ("viscous", "coulomb") else ""))


def _in_words(done: Fitted, values: np.ndarray, data: Measured, clauses: Sequence[str]) -> list[str]:
    """Indistinguishable parameters in words, the ones fixed for that reason, and remedies: `clauses`, one for each reason."""
    sentences = []
    for (exponents, chosen), clause in zip(done.reasons, clauses, strict=True):
        signs = {called_in_words(done, k): power for k, power in exponents.items()}
        names, each = list(signs), done.problem.unknowns[chosen]
        unit = "" if each.shown_unit == "1" else f" {each.shown_unit}"
        kept = f"the {called_in_words(done, chosen)} is held at {values[chosen]:.4g}{unit}" + (clause and f"; {clause}")
        if len(names) == 1:
            sentences.append(f"this log does not determine the {names[0]}: {kept}")
            continue
        same = [n for n, x in signs.items() if x > 0]
        other = [n for n, x in signs.items() if x < 0]
        change = f"larger {' and '.join(same)}" + (f" with smaller {' and '.join(other)}" if other else "")
        sentences.append(f"{listed(names)} cannot be distinguished with this log: {change} predicts the same; {kept}")
    held = {done.problem.unknowns[k].short for exponents, _ in done.reasons for k in exponents}
    by_voltage = data.command == "voltage"
    if done.reasons and by_voltage and "current" not in data.signals and held & {"R", "Kt", "J", "L"}:
        what = "a log of the current beside the voltage would separate resistance, torque constant and inertia"
        sentences.append(what)
    elif done.reasons and not by_voltage and held & {"Kt", "J"}:
        what = "a known inertia, or a log of voltage and current, would separate torque constant and inertia"
        sentences.append(what)
    elif done.reasons and not any(clauses):
        sentences.append("a motion with more steps, turns and speeds would identify more")
    return sentences
