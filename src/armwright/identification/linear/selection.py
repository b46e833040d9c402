"""Order and delay of a model by information criteria and by cross-validation of the free simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from armwright.errors import Interrupted, LogError, check_known
from armwright.identification.linear.held import HeldFit, best_held, bic_of
from armwright.identification.linear.prediction_error import (
    Orders,
    PredictionFit,
    Structure,
    estimate,
    least_squares,
    minimise,
    prediction_errors,
    with_best_numerator,
)
from armwright.identification.linear.records import RecordedStretch
from armwright.progress import Progress

Criterion = Literal["cv", "aic", "bic", "fpe", "mdl"]
CRITERIA: tuple[Criterion, ...] = ("cv", "aic", "bic", "fpe", "mdl")
FOLDS = 5
LONGEST_PAST = 12  # poles and further zeros of the first, long ARX model
SIGNIFICANT = 4.0  # standard deviations: of 30 coefficients that are 0, one lies beyond in 2 of 1000 tries
WORSE = 5.0  # times what BIC pays for: a fit that loses more has lost a coefficient that it needs
BEFORE = 2  # delays that are tried below the first significant coefficient of the long model
EXACT = 1e-20  # of the output's variance: a smaller error is rounding, and no reason for a higher order
LARGEST_ORDER, LARGEST_DELAY = 100, 10_000


@dataclass(frozen=True)
class OrderSearch:
    """Search for the order and the delay of a model, where they are "auto".

    Args:
        select: criterion that chooses: "cv" (free simulation of blocks that were not fitted), "aic", "bic", "fpe" or "mdl".
        most_order: largest order that is tried; None: 5, or 10 states of `fit_n4sid`.   most_delay: largest delay [samples].
    Raises:
        LogError: names the field.
    Example:
        >>> u = np.random.default_rng(0).standard_normal(300)
        >>> y = np.concatenate([[0.0], 0.5 * u[:-1]])  # half of it, a row later
        >>> search = aw.identification.OrderSearch("bic")
        >>> aw.identification.fit_arx(u, y, 0.01, search=search).order
        1
    """

    select: Criterion = "cv"
    most_order: int | None = None
    most_delay: int = 25

    def __post_init__(self) -> None:
        check_known(LogError, self.select, CRITERIA, place="select")
        for place, value, least in (("most_order", self.most_order, 1), ("most_delay", self.most_delay, 0)):
            if value is not None and (not isinstance(value, (int, np.integer)) or not least <= value <= 1000):
                raise LogError(place=place, value=value, expected=f"a whole number from {least} on")


USUAL = OrderSearch()


@dataclass(frozen=True)
class OrderCandidate:
    """One structure with its criteria; lower is better.

    Attributes:
        orders: numbers of coefficients and delay.   aic, bic, fpe, mdl: of the errors that the structure minimises.
        cv: mean square of the free simulation's error on blocks that were not fitted, over the output's variance.
    """

    orders: Orders
    aic: float
    bic: float
    fpe: float
    mdl: float
    cv: float

    def __getitem__(self, name: Criterion) -> float:
        return float(getattr(self, name))


def criteria(cost: float, rows: int, count: int, variance: float = 1.0) -> dict[str, float]:
    """Information criteria of a model. [Ljung1999], section 16.4.

        V = cost / rows,  AIC = N ln V + 2d,  BIC = N ln V + d ln N,  FPE = V (N + d) / (N - d),  MDL = V (1 + d ln N / N)

    Args:
        cost: sum of squares.   rows: N.   count: d, number of parameters.   variance: of the output, the scale of rounding.
    """
    v = max(cost / rows, EXACT * variance)
    n, d = float(rows), float(count)
    return {
        "aic": n * np.log(v) + 2 * d,
        "bic": n * np.log(v) + d * np.log(n),
        "fpe": v * (n + d) / max(n - d, 1.0),
        "mdl": v * (1 + d * np.log(n) / n),
    }


def first_response(stretches: Sequence[RecordedStretch], most: int, least: int = 0) -> int:
    """Delay [samples] at which an ARX model of many coefficients first responds significantly to its input.

    Args:
        stretches: one input, one output.   most: largest delay that is looked for.   least: smallest.
    """
    rows = sum(len(each.y) for each in stretches)
    past = int(min(LONGEST_PAST, max((rows // 10 - most) // 2, 1)))
    orders = Orders("arx", past, most - least + past, 0, least, constant=True)
    fit = minimise(orders, stretches, orders.past, False, least_squares(orders, stretches, orders.past))
    b = fit.theta[past : past + most - least + 1]
    std = np.sqrt(np.maximum(np.diag(fit.test_covariance), 0.0))[past : past + most - least + 1]
    clear = np.flatnonzero(np.abs(b) > SIGNIFICANT * std)
    return least + int(clear[0] if len(clear) else np.argmax(np.abs(b) / np.maximum(std, 1e-300)))


def trimmed(
    orders: Orders, stretches: Sequence[RecordedStretch], skip: int, initial: bool, further: Sequence[np.ndarray]
) -> PredictionFit:
    """A fit without the end coefficients of B that no criterion justifies: t² < ln(rows)."""
    fit = estimate(orders, stretches, skip, initial, None, further)
    while fit.orders.nb > 1:
        now = fit.orders
        part = slice(now.na, now.na + now.nb)
        t = np.abs(fit.theta[part]) / np.sqrt(np.maximum(np.diag(fit.test_covariance)[part], 1e-300))
        end = 0 if t[0] <= t[-1] else -1
        if t[end] ** 2 >= np.log(len(fit.errors)):
            break
        fewer = replace(now, nb=now.nb - 1, delay=now.delay + (end == 0))
        place = now.na if end == 0 else now.na + now.nb - 1
        begin = fewer.polynomials(np.delete(fit.theta, place))
        shorter = estimate(fewer, stretches, skip, initial, with_best_numerator(fewer, stretches, skip, initial, begin))
        if shorter.cost > fit.cost * (1.0 + WORSE * np.log(len(fit.errors)) / fit.equations):
            break  # the linear statistic was wrong: poles and zeros nearly cancel
        fit = shorter
    return fit


def cross_validation(fit: PredictionFit, stretches: Sequence[RecordedStretch], skip: int, initial: bool) -> np.ndarray:
    """Mean squares (folds,) of the free simulation's error on held-out blocks of rows."""
    orders, errors = fit.orders, []
    parts_of_rows = folds(stretches, skip + 2 * orders.count)
    if not parts_of_rows:
        raise too_short()
    for fitted, held in parts_of_rows:
        model = orders.polynomials(estimate(orders, fitted, skip, initial, fit.theta).theta)
        free = replace(model, c=model.a)
        with np.errstate(over="ignore", invalid="ignore"):
            parts = np.concatenate([prediction_errors(free, each, skip, True) for each in held])
            # an initial state fits as many rows as it has numbers: not counted, it would speak for high orders
            mean = float(parts @ parts) / max(len(parts) - orders.na * len(held), 1)
        errors.append(mean if np.isfinite(mean) else np.inf)
    return np.array(errors)


def too_short() -> LogError:
    """The error for too few rows for a cross-validation."""
    expected = 'select="bic", which needs fewer, longer runs, or an order'
    return LogError("too few rows to hold blocks of them out", place="select", value="cv", expected=expected)


def folds(
    stretches: Sequence[RecordedStretch], shortest: int, count: int = FOLDS
) -> list[tuple[list[RecordedStretch], list[RecordedStretch]]]:
    """Stretches for fit and validation: every fold holds out one block of successive rows.

    Args:
        shortest: rows below which a part is of no use and is left out.   count: of folds.
    """
    total = sum(len(each.y) for each in stretches)
    found = []
    bounds = np.linspace(0, total, count + 1).astype(int)
    for low, high in pairwise(bounds):
        fitted, held, begin = [], [], 0
        for each in stretches:
            rows = len(each.y)
            a, b = np.clip([low - begin, high - begin], 0, rows)
            parts = ((fitted, 0, a), (held, a, b), (fitted, b, rows))
            for goes, first, last in parts:
                if last - first > shortest:
                    goes.append(each.part(slice(first, last)))
            begin += rows
        if fitted and held:
            found.append((fitted, held))
    return found


def selected(
    structure: Structure, stretches: Sequence[RecordedStretch], order: int | None, delay: int | None, search: OrderSearch,
    constant: bool, initial: bool, tell: Progress,
) -> tuple[Orders, tuple[OrderCandidate, ...]]:  # fmt: skip
    """Order and delay of a structure, and all candidates.

    Args:
        structure: "arx", "oe" or "armax".   order, delay: None: to be found.   search: how; its largest order is known.
        constant, initial: as of the fit.   tell: called with orders done and of all.
    Raises:
        Interrupted: Ctrl-C; `found` holds the best of the orders until then, and these.
    """
    by, numbers = search.select, [order] if order is not None else range(1, (search.most_order or 0) + 1)
    variance = float(np.var(np.concatenate([each.y[:, 0] for each in stretches])))
    low = first_response(stretches, search.most_delay) if delay is None else delay
    begin = max(low - BEFORE, 0) if delay is None else delay
    tried: list[OrderCandidate] = []
    scores: dict[Orders, np.ndarray] = {}
    settled: set[Orders] = set()  # of held systems, whose delay a free B would blur
    skip, last = max(numbers) + low + 2, None
    try:
        for k, n in enumerate(numbers):
            tell(k, len(numbers) + 1)
            nc = n if structure == "armax" else 0
            orders = Orders(structure, n, n + 1 + low - begin, nc, begin, constant)
            if delay is None:
                fit = trimmed(orders, stretches, skip, initial, _start_from_lower_order(orders, last))
                count, best = fit.orders.count, min(tried, key=lambda each: each.bic).orders.na if tried else n
                # the search for held systems costs most: not two orders above the best
                held = best_held(fit, stretches, skip, initial) if n <= best + 1 else None
                if held is not None and (order is not None or _is_held(held, fit)):
                    fit, count = held.fit, held.count
                    settled.add(fit.orders)
                orders = fit.orders
            else:
                orders = replace(orders, nb=n)
                fit = estimate(orders, stretches, skip, initial, None, _start_from_lower_order(orders, last))
                count = orders.count
            last = fit
            found = criteria(fit.cost, fit.equations, count, variance)
            scores[orders] = cross_validation(fit, stretches, skip, initial) if by == "cv" else np.array([np.nan])
            tried.append(OrderCandidate(orders, **found, cv=float(np.mean(scores[orders])) / variance))
    except KeyboardInterrupt:
        if not tried:
            raise
    chosen = _simplest(tried, scores, variance) if by == "cv" else min(tried, key=lambda each: each[by]).orders
    stopped = "" if len(tried) == len(numbers) else f"after {len(tried)} of {len(numbers)} orders"
    if delay is None and chosen not in settled and not stopped:
        try:
            tell(len(numbers), len(numbers) + 1)
            chosen = _polished(chosen, stretches, skip, initial, fixed=order is not None)
        except KeyboardInterrupt:
            stopped = "before delays next to the chosen one were tried"
    if stopped:
        raise Interrupted(stopped, found=(chosen, tuple(tried)))
    return chosen, tuple(tried)


def _is_held(held: HeldFit, fit: PredictionFit) -> bool:
    """True if BIC prefers the held system. With no more parameters than the free one, it may be worse by one parameter's penalty.

    Inputs of plants are held: of two fits of nearly equal quality the held one is more likely.
    """
    credit = np.log(fit.equations) if held.count <= fit.orders.count else 0.0
    return bool(bic_of(held) <= _bic(fit) + credit)


def _start_from_lower_order(orders: Orders, last: PredictionFit | None) -> list[np.ndarray]:
    """The fit of a lower order as a start of a higher one, with poles and coefficients at 0 that it did not have."""
    if last is None or last.orders.delay < orders.delay:
        return []
    model, end = last.orders.polynomials(last.theta), orders.delay + orders.nb
    if len(model.b) > end:
        return []
    a, b = (np.pad(each, (0, size - len(each))) for each, size in ((model.a, orders.na + 1), (model.b, end)))
    c = a if orders.structure == "oe" else np.pad(model.c, (0, orders.nc + 1 - len(model.c)))
    return [orders.theta(replace(model, a=a, b=b, c=c))]


def _bic(fit: PredictionFit) -> float:
    return criteria(fit.cost, fit.equations, fit.orders.count)["bic"]


def _polished(orders: Orders, stretches: Sequence[RecordedStretch], skip: int, initial: bool, fixed: bool) -> Orders:
    """The neighbour in delay and number of B's coefficients with the lowest BIC, as long as there is a lower one."""

    def bic(each: Orders) -> float:
        return _bic(estimate(each, stretches, skip, initial))

    seen = {orders: bic(orders)}
    while True:
        here = min(seen, key=lambda each: seen[each])
        moves = [(d, n) for d in (-1, 0, 1) for n in (-1, 0, 1) if not fixed or n == 0]
        near = [replace(here, delay=here.delay + d, nb=here.nb + n) for d, n in moves]
        fresh = [each for each in near if each not in seen and each.delay >= 0 and each.nb >= 1 and each.past <= skip]
        seen |= {each: bic(each) for each in fresh}
        if min(seen, key=lambda each: seen[each]) == here:
            return here


def _simplest(tried: Sequence[OrderCandidate], scores: dict[Orders, np.ndarray], variance: float) -> Orders:
    """The first structure whose held-out error is no more than a standard error of the difference above the best."""
    best = min(tried, key=lambda each: each.cv).orders
    for each in tried:
        if scores[each.orders].shape != scores[best].shape:  # a part too short for one of the two
            continue
        difference = scores[each.orders] - scores[best]
        if not np.isfinite(difference).all():
            continue
        if difference.mean() <= difference.std(ddof=1) / np.sqrt(len(difference)) + EXACT * variance:
            return each.orders
    return best


def checked_order(order: Any, numbers: int) -> int | tuple[int, ...] | None:
    """The order as a number; None for "auto".

    Raises:
        LogError: no whole number from 1 on, nor a tuple of them.
    """
    if order == "auto":
        return None
    parts = order if isinstance(order, (tuple, list)) else (order,)
    if not all(_is_whole(each, 1, LARGEST_ORDER) for each in parts) or len(parts) not in (1, numbers):
        expected = f'"auto", a whole number from 1 to {LARGEST_ORDER}, or {numbers} of them'
        raise LogError(place="order", value=order, expected=expected)
    return int(parts[0]) if len(parts) == 1 else tuple(int(each) for each in parts)


def _is_whole(value: Any, least: int, most: int) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and bool(least <= value <= most)


def checked_delay(delay: Any) -> int | None:
    """The delay [samples] as a number; None for "auto".

    Raises:
        LogError: no whole number from 0 on.
    """
    if delay == "auto":
        return None
    if not _is_whole(delay, 0, LARGEST_DELAY):
        raise LogError(place="delay", value=delay, expected='"auto" or a whole number of samples from 0 on')
    return int(delay)
