"""Identification of a servo on a bench by output error, its friction model chosen by logs that are held out."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.description.paths import unit_at
from armwright.entry import expect
from armwright.errors import Interrupted, ModelError, check_known
from armwright.fitting.covariance import covariance_of
from armwright.fitting.measures import agreement
from armwright.identification.estimate import Estimate
from armwright.identification.motor.unknowns import values_of
from armwright.identification.servo.bench import FRICTION, PATHS, ServoLoop, bench_record, loop_of, with_arm_mass
from armwright.identification.servo.bench_log import BenchLog, as_bench_logs
from armwright.identification.servo.orders import DELAY, OFFSET, ORDERS
from armwright.identification.servo.search import (
    SETTLED,
    OrderFit,
    Validated,
    fitted_to_all,
    next_larger,
    validated_orders,
)
from armwright.identification.servo.servo_fit import OrderErrors, ServoFit
from armwright.progress import Shown, automatic

EXTRA = ("offset", "delay", "gain", "goal_speed")
UNITS = {OFFSET: "rad", DELAY: "s"}
AT_BOUND = 1e-6  # of the range of a coordinate
UNKNOWN = 1.0  # standard deviation of a logarithm, or in parts of its value beside its scale: more is not determined
VAGUE = 0.5  # of a torque constant or resistance: a standard deviation from which its 95 % interval holds 0
FEWEST = 3  # logs whose errors tell by how much a difference of their mean is chance
MOST_SHARE = 10.0  # of a value that a standard deviation is shown as: beyond it nothing is known
NOTHING = 0.02  # of a mean error: models that differ less predict the same
EXPLAINED = 0.5  # R² of all logs below which the model does not describe them


@dataclass(frozen=True)
class ServoSearch:
    """Search for the numbers of a servo.

    Args:
        orders: friction models that are compared, of "M1" … "M6".   free: what else is fitted beside motor and friction:
            "offset" (where gravity's 0 is), "delay" (of the goals), "gain" (of the loop), "goal_speed".
        seed: of the first guesses.
    Raises:
        ModelError: names the field.
    Example:
        >>> search = aw.identification.ServoSearch(["M1", "M4"], free=["offset", "delay"])
        >>> search.orders
        ['M1', 'M4']
    """

    orders: Sequence[str] = tuple(ORDERS)
    free: Sequence[str] = ("offset",)
    seed: int = 0

    def __post_init__(self) -> None:
        for place, values, choices in (("orders", self.orders, tuple(ORDERS)), ("free", self.free, EXTRA)):
            if not isinstance(values, (list, tuple)) or (place == "orders" and not values):
                raise ModelError(place=place, value=values, expected="a list of names", choices=choices)
            for value in values:
                check_known(ModelError, value, choices, place=place)


USUAL = ServoSearch()


def identify_servo(
    logs: Sequence[BenchLog | str | os.PathLike[str]] | BenchLog | str | os.PathLike[str],
    loop: ServoLoop | None = None,
    *,
    arm_mass: float | None = None,
    search: ServoSearch = USUAL,
    progress: Shown = None,
) -> ServoFit:
    """Motor and friction of a servo by output error: its bench simulated from the logged goals, fitted to the positions.

    K_t, R and J at the output shaft, friction by one of BAM's models M1 to M6, and q_offset, the angle that gravity's downward
    has beside the servo's 0; the bench is (m l² + m_a l² / 3 + J) q̈ = τ_m + τ_e - friction. [DuclusaudEtAl2025] The supply is
    as logged. Every log is held out once: alone up to 6 logs, with others of several, half of them from 16 logs on. The friction
    model is the smallest one that predicts held-out logs no worse than the best, by the standard error of the difference or 2 %.
    Each is fitted to whole logs and to parts of 0.5 s that start from the measured state; what predicts held-out logs better is
    taken, and fitted to all logs, in which rows in the same count have its error in common; of two logs, whole logs. Intervals
    count the correlation of the residuals, and by how much the numbers are moved by the next larger models, where they predict as
    well, of two logs by all others, and by whole logs in place of parts.

    Args:
        logs: files of BAM's JSON, or `BenchLog`s, of one servo, with any gains, masses, lengths and motions.
        loop: of the servo's firmware; None: that of `motor` in the logs, if it is known.
        arm_mass: of the rod [kg], where a log does not say; None: 0, with a remark.   search: for the numbers.
        progress: True or None: a bar where it is seen; False: none; a function is called with rounds done and of all.
    Returns:
        fit: the estimate, the record, the models that were compared.
    Raises:
        LogError: names file, place, value and what was expected.   ModelError: a wrong option.
        Interrupted: Ctrl-C; `found` holds the fit by the friction models that were compared until then.
    Example:
        >>> log = "examples/logs/sts3250/sin_sin.json"
        >>> search = aw.identification.ServoSearch(orders=["M1"])  # Coulomb and viscous
        >>> fit = aw.identification.identify_servo(log, search=search)
        >>> print(f"{fit.error:.3f} rad")  # mean error of the simulated positions
        0.003 rad
    """
    expect(search, ServoSearch, "search", "an aw.identification.ServoSearch", ModelError)
    if loop is not None:
        expect(loop, ServoLoop, "loop", "an aw.identification.ServoLoop", ModelError)
    known, remarks = with_arm_mass(as_bench_logs(logs), arm_mass)
    loop = loop_of(known, loop)
    extra = [each for each in EXTRA if each in search.free]
    if "goal_speed" in extra and loop.goal_speed_rad_per_s is None:
        raise ModelError(
            "the goal of this servo jumps", place="free", value="goal_speed", expected="a loop with a goal speed"
        )
    with automatic(progress, "fitting") as tell:
        stopped = ""
        try:
            models = validated_orders(known, loop, extra, search.orders, search.seed, tell)
        except Interrupted as stop:
            models, stopped = stop.found, str(stop)
            remarks.append(f"stopped by Ctrl-C {stopped}")
        name, asked = _chosen({each: model for each, model in models.items() if each in search.orders})
        if len(known) == 1 and len(asked) > 1:
            remarks.append(f"too few logs to hold one out: {name} is taken, the smallest friction model")
        fit = fitted_to_all(asked[name], SETTLED)
        larger = next_larger(name, asked)
        if len(known) >= FEWEST:
            larger = [each for each in larger if _no_worse(asked[each].held_out, asked[name].held_out)]
        else:  # nothing rules out any of the others
            larger = [each for each in asked if each != name and len(known) > 1]
        others = [asked[each] for each in larger] + [models[name][0]] * (asked[name] is not models[name][0])
        shifts = [_shift(fit, fitted_to_all(each)) for each in others]
    compared = [
        OrderErrors(each, model.z.shape[1], float(model.fitted.mean()), _mean(model.held_out), each == name)
        for each, model in asked.items()
    ]
    result = _concluded(fit, known, loop, compared, remarks, shifts)
    if stopped:
        raise Interrupted(stopped, found=result)
    return result


def _mean(errors: np.ndarray) -> float:
    return float(errors.mean()) if len(errors) else float("nan")


def _chosen(models: dict[str, tuple[Validated, Validated]]) -> tuple[str, dict[str, Validated]]:
    """The smallest model that predicts held-out logs no worse than the best; all models, of whole logs or of parts as the best.

    Of a single log, which cannot be held out, the smallest; of less than `FEWEST` logs all models are of whole logs.

    Args:
        models: by name, of whole logs and of parts.
    """
    logs = len(next(iter(models.values()))[0].held_out)
    way = (
        min((0, 1), key=lambda way: min(each[way].held_out.mean() for each in models.values())) if logs >= FEWEST else 0
    )
    asked = {name: each[way] for name, each in models.items()}
    if not logs:
        return next(iter(asked)), asked
    best = min((each.held_out for each in asked.values()), key=np.mean)
    return next(name for name in ORDERS if name in asked and _no_worse(asked[name].held_out, best)), asked


def _no_worse(errors: np.ndarray, best: np.ndarray) -> bool:
    """True if errors of logs (logs,) are above others by no more than the standard error of that, or by next to nothing."""
    loss = errors - best
    if not np.isfinite(loss).all():
        return False
    chance = loss.std(ddof=1) / np.sqrt(len(loss)) if len(loss) >= FEWEST else 0.0
    return bool(loss.mean() <= max(chance, NOTHING * best.mean()))


def _concluded(
    fit: OrderFit, logs: tuple[BenchLog, ...], loop: ServoLoop, compared: list[OrderErrors], remarks: list[str],
    shifts: Sequence[np.ndarray],
) -> ServoFit:  # fmt: skip
    """The result: estimate, record, and words."""
    problem, order = fit.problem, fit.problem.order
    values, rates = values_of(order.unknowns, fit.z)
    low, high = order.low, order.high
    at_bound = np.minimum(fit.z - low, high - fit.z) < AT_BOUND * (high - low)
    covariance = np.zeros((len(values),) * 2)
    free = np.flatnonzero(~at_bound)
    covariance[free[:, None], free] = _covariance(fit, free)
    determined = _determined(fit, np.sqrt(np.diag(covariance))) | at_bound
    spread = order.matrix * rates  # of the record's numbers by the coordinates
    numbers = order.matrix @ values + order.fixed
    by_name = dict(zip(order.columns, numbers.tolist(), strict=True))
    shown = [k for k, row in enumerate(order.matrix) if row.any()]
    parts = order.matrix > 0.0
    names = [PATHS.get(order.columns[k], order.columns[k]) for k in shown]
    whole = replace(problem, restart=np.inf).predictions(numbers[None])[0]
    measures = agreement(problem.measured, whole)
    simulated = tuple(whole[part] for part in problem.parts)
    wrong = _in_words(order.unknowns, at_bound & (order.matrix.sum(axis=0) > 0), ~determined)
    describes = measures.r2 >= EXPLAINED
    if not describes:
        wrong.append(f"R² is {measures.r2:.2g}: the model does not describe these logs")
    every = spread @ covariance @ spread.T + _of_larger(shifts, len(numbers))
    deviations = dict(zip(order.columns, np.sqrt(np.diag(every)).tolist(), strict=True))
    shares = {name: deviations[name] / by_name[name] for name in ("kt", "R") if name in by_name}
    vague = [
        f"{name} ± {min(share, MOST_SHARE):.0%}" + " or more" * (share > MOST_SHARE)
        for name, share in shares.items()
        if share > VAGUE
    ]
    if vague:
        wrong.append(f"{', '.join(vague)} (std): other gains, loads and motions are needed to determine them")
    record = bench_record(logs[0], loop, by_name, by_name[OFFSET])
    in_parts = f" in parts of {problem.restart:g} s" if problem.restart < np.inf else ""
    estimate = Estimate(
        names=tuple(names),
        values=numbers[shown],
        covariance=every[np.ix_(shown, shown)],
        sha256=_sha256(logs),
        method=f"output error of positions from goals{in_parts}, friction {order.name}",
        units=tuple(UNITS.get(name) or unit_at(name) for name in names),
        at_bound=np.array([bool(at_bound[parts[k]].all()) for k in shown]),
        identifiable=np.array([bool(determined[parts[k]].all()) for k in shown]),
        remarks=(*remarks, *wrong),
        fit={f"{log.name}: q": agreement(log.position, own).by_name for log, own in zip(logs, simulated, strict=True)},
        verdict="identified" if describes and determined[:2].all() and not vague else "not identified",
        log=logs[0].name if len(logs) == 1 else f"{len(logs)} logs",
    )
    return ServoFit(order.name, estimate, record, tuple(compared), logs, simulated)


def _sha256(logs: Sequence[BenchLog]) -> str:
    """Of the file of one log; of several, or of such as no file holds, of all of them together."""
    hashes = [
        log.sha256 or hashlib.sha256(np.concatenate((log.t, log.position, log.goal)).tobytes()).hexdigest()
        for log in logs
    ]
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()


def _shift(fit: OrderFit, larger: OrderFit) -> np.ndarray:
    """(columns,) by how much a larger model, or another cost, of the same logs moves the record's numbers."""
    return larger.problem.values(larger.z) - fit.problem.values(fit.z)


def _of_larger(shifts: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """(columns, columns) covariance by terms that are left out, but that the held-out logs do not rule out: the largest shift."""
    if not shifts:
        return np.zeros((columns, columns))
    most = np.abs(shifts).max(axis=0)
    return np.diag(most**2)


def _covariance(fit: OrderFit, free: np.ndarray) -> np.ndarray:
    """(k, k) of the coordinates that are free, for residuals that are correlated within each log.

    Rows that follow each other in the same count have one and the same error of the count. While a servo rests that lasts longer
    than any autoregression sees, so L such rows become one, Σ x / √L and Σ e / √L, which leaves Σ x xᵀ and Σ x e as they are.
    """
    sigma = max(float(np.sqrt(np.mean(fit.errors**2))), 1e-12)
    blocks = []
    for log, part in zip(fit.problem.logs, fit.problem.parts, strict=True):
        first = np.flatnonzero(np.diff(log.position, prepend=np.nan))
        weight = fit.weights[part][first] / (sigma * np.sqrt(np.diff(first, append=len(log.t))))
        columns = np.add.reduceat(fit.jacobian[part][:, free], first) * weight[:, None]
        blocks.append((columns[:, None, :], (np.add.reduceat(fit.errors[part], first) * weight)[:, None]))
    return covariance_of(blocks)


def _determined(fit: OrderFit, std: np.ndarray) -> np.ndarray:
    """(k,) True for unknowns that the logs determine."""
    size = np.where([each.logarithmic for each in fit.problem.order.unknowns], 1.0, 1.0 + np.abs(fit.z))
    moves = np.sqrt(np.mean(fit.jacobian**2, axis=0)) > 0.0
    return moves & (std < UNKNOWN * size)


def _in_words(unknowns: Sequence[Any], at_bound: np.ndarray, undetermined: np.ndarray) -> list[str]:
    """Sentences on numbers at a bound, and on those that the logs do not determine."""
    names = [str(FRICTION.get(each.name, each.name)) for each in unknowns]
    zero = [n for n, each, bound in zip(names, unknowns, at_bound, strict=True) if bound and not each.logarithmic]
    ends = [n for n, each, bound in zip(names, unknowns, at_bound, strict=True) if bound and each.logarithmic]
    lost = [n for n, no in zip(names, undetermined, strict=True) if no]
    found = (
        (zero, "at a bound of what is possible"),
        (ends, "at a bound of the search; the logs, or the model, do not determine it"),
        (lost, "not determined by these logs"),
    )
    return [f"{', '.join(names)}: {what}" for names, what in found if names]
