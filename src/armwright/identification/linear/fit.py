"""Fits of ARX, OE and ARMAX models by prediction errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
from scipy.stats import chi2

from armwright.entry import expect
from armwright.errors import Interrupted, LogError
from armwright.identification.linear.delays import delay_interval
from armwright.identification.linear.frequency import closed_loop
from armwright.identification.linear.measures import gain_units, simulation_measures
from armwright.identification.linear.model import LinearModel, polynomial_core
from armwright.identification.linear.modes import ModelQuantity, gain_of, magnitude_std, modes, root_gradient
from armwright.identification.linear.prediction_error import (
    Orders,
    Polynomials,
    PredictionFit,
    Structure,
    estimate,
    prediction_errors,
)
from armwright.identification.linear.records import LIKELIEST, LogSignals, Records, check_rows, records_of
from armwright.identification.linear.residuals import CERTAIN, cross_correlation, feedback, whiteness
from armwright.identification.linear.scaling import SignalUnits, scale
from armwright.identification.linear.selection import (
    CRITERIA,
    USUAL,
    OrderCandidate,
    OrderSearch,
    checked_delay,
    checked_order,
    first_response,
    selected,
)
from armwright.progress import progress

MOST_ORDER = 5  # that is tried
SINGULAR = 1e8  # condition from which parameters are rounding


class Options(TypedDict, total=False):
    """Options of `fit_arx`, `fit_oe` and `fit_armax`; `fit_oe` explains them."""

    signals: LogSignals
    order: int | tuple[int, ...] | Literal["auto"]
    delay: int | Literal["auto"]
    search: OrderSearch
    offset: bool
    initial: bool


def fit_arx(data: Any, y: Any = None, period: Any = None, **options: Unpack[Options]) -> LinearModel:
    """ARX model by least squares:  A(q) y = B(q) u + c + e.  [Ljung1999], section 7.3.

    It minimises errors one step ahead. Noise of the measurement, which is not shaped by 1/A, biases it: compare its free
    simulation with that of `fit_oe`.

    Args:
        data: a `Log`, or u (rows,), or a list of runs.   y: (rows,) or a list.   period: [s], or times (rows,).
        options: those of `fit_oe`; `order` is n, or (na, nb).
    Returns:
        model: with covariance, poles, gain, and the fit of its free simulation.
    Raises:
        LogError: as `fit_oe`.
    Example:
        >>> u = np.repeat(np.random.default_rng(0).standard_normal(60), 10)
        >>> y = np.concatenate([[0.0], 0.5 * u[:-1]])  # half of it, a row later
        >>> model = aw.identification.fit_arx(u, y, 0.01, order=1, delay=1)
        >>> round(float(model.quantities[0].value), 3)  # its gain
        0.5
    """
    return _fit("arx", data, y, period, **options)


def fit_oe(data: Any, y: Any = None, period: Any = None, **options: Unpack[Options]) -> LinearModel:
    """Output-error model by least squares of the free simulation:  y = B(q)/F(q) u + offset + e.  [Ljung1999], section 10.2.

    Levenberg-Marquardt with exact gradients from ARX, instrumental variables and Steiglitz-McBride. The noise may have any
    colour, and the intervals allow for it. Data from a closed loop bias it: a remark warns of it.

    Args:
        data: a `Log`, or u (rows,), or a list of runs.   y: (rows,) or a list.   period: [s], or times (rows,).
        options: all of these may be left out.
            signals: of a log; default: its voltage, current or torque, and its speed or position.
            order: n, or (nf, nb); "auto" (default): chosen.   delay: [samples]; "auto" (default): chosen.
            search: how they are chosen.
            offset: True (default): a constant is estimated; False: none.
            initial: True (default): the initial state of every run is estimated; False: its first rows are taken as measured.
    Returns:
        model: with covariance, poles, gain, and the fit of its free simulation on runs to fit and to hold out.
    Raises:
        LogError: not a number, constant signals, two clocks, too few rows for the order; names what and where.
        Interrupted: Ctrl-C; `found` holds the model of the best order until then.
    Example:
        >>> from scipy.signal import lfilter
        >>> u = np.repeat(np.random.default_rng(0).standard_normal(60), 10)
        >>> y = lfilter([0.0, 0.2], [1.0, -0.9], u)
        >>> model = aw.identification.fit_oe(u, y, 0.01, order=1, delay=1)
        >>> {each.name: round(float(each.value), 3) for each in model.quantities}
        {'gain': 2.0, 'time_constant1': 0.095}
    """
    return _fit("oe", data, y, period, **options)


def fit_armax(data: Any, y: Any = None, period: Any = None, **options: Unpack[Options]) -> LinearModel:
    """ARMAX model by prediction errors:  A(q) y = B(q) u + c + C(q) e.  [Ljung1999], section 10.2.

    With its own model of the noise it may be fitted to data from a closed loop.

    Args:
        data: a `Log`, or u (rows,), or a list of runs.   y: (rows,) or a list.   period: [s], or times (rows,).
        options: those of `fit_oe`; `order` is n, or (na, nb, nc).
    Returns:
        model: with covariance, poles, gain, and the fit of its free simulation.
    Raises:
        LogError: as `fit_oe`.
    Example:
        >>> rng = np.random.default_rng(0)
        >>> u = np.repeat(rng.standard_normal(100), 10)
        >>> y = np.concatenate([[0.0], 0.5 * u[:-1]]) + 0.01 * rng.standard_normal(1000)
        >>> model = aw.identification.fit_armax(u, y, 0.01, order=1, delay=1)
        >>> round(float(model.quantities[0].value), 2)
        0.5
    """
    return _fit("armax", data, y, period, **options)


def _fit(
    structure: Structure, data: Any, y: Any, period: Any, signals: LogSignals = LIKELIEST, order: Any = "auto",
    delay: int | Literal["auto"] = "auto", search: OrderSearch = USUAL, offset: bool = True, initial: bool = True,
) -> LinearModel:  # fmt: skip
    expect(search, OrderSearch, "search", "an aw.identification.OrderSearch", LogError)
    records = records_of(data, y, period, signals)
    if len(records.inputs) > 1 or len(records.outputs) > 1:
        what = f"{len(records.inputs)} inputs, {len(records.outputs)} outputs"
        raise LogError(what, place="data", expected="one of each; fit_n4sid takes several")
    noise = structure == "armax"
    n, known = checked_order(order, 2 + noise), checked_delay(delay)
    scaled, to_units = scale(records, inputs_centred=offset, outputs_centred=offset)
    tried: tuple[OrderCandidate, ...] = ()
    stopped = ""
    if isinstance(n, tuple) or (n is not None and known is not None):
        na, nb, nc = (*n, 0)[:3] if isinstance(n, tuple) else (n, n, n * noise)
        found = first_response(scaled.fit, search.most_delay) if known is None else known
        orders = Orders(structure, na, nb, nc, found, offset)
        check_rows(records, orders.count, orders.past)
    else:
        largest = n or search.most_order or MOST_ORDER
        check_rows(records, 3 * largest + offset, largest + (search.most_delay if known is None else known))
        search = replace(search, most_order=largest)
        with progress("trying orders") as tell:
            try:
                orders, tried = selected(structure, scaled.fit, n, known, search, offset, initial, tell)
            except Interrupted as stop:
                (orders, tried), stopped = stop.found, str(stop)
    fit = estimate(orders, scaled.fit, orders.past, initial)
    settled = known is not None or stopped  # the interval of the delay takes long
    delays = (orders.delay, orders.delay) if settled else delay_interval(fit, scaled.fit, initial)
    model = _result(records, scaled, fit, to_units, initial)
    rows = tuple(_row(each) for each in tried)
    remarks = (*model.remarks, *_of_delays(delays, orders.delay if known is None else None))
    if stopped:
        remarks += (f"stopped by Ctrl-C {stopped}: another order or delay may be better",)
    model = replace(model, delays=delays, remarks=remarks, tried=rows, criterion=search.select if rows else "")
    if stopped:
        raise Interrupted(stopped, found=model)
    return model


def _result(records: Records, scaled: Records, fit: PredictionFit, units: SignalUnits, initial: bool) -> LinearModel:
    """The fit in units, with everything that follows from it."""
    orders, inner = fit.orders, fit.orders.polynomials(fit.theta)
    model, change = units.polynomials(inner), units.jacobian(orders)
    covariance = change @ fit.covariance @ change.T
    poles, pole_gradient = _poles(model, orders)
    zeros, zero_gradient = _zeros(model, orders)
    pole_std = magnitude_std(poles, pole_gradient, covariance)
    gain = _gain(model, orders, covariance, gain_units(records)[0][0])
    free = replace(inner, c=inner.a)
    measures = simulation_measures(
        records, scaled, lambda each: prediction_errors(free, each, orders.past, True)[:, None],
        lambda each: prediction_errors(inner, each, orders.past, initial)[:, None], orders.past, units.ys,
    )  # fmt: skip
    doubts = _doubts(records, fit, measures)
    unsettled = [] if fit.converged else ["the search for the minimum did not end: treat the numbers with care"]
    return LinearModel.of(
        records,
        kind=orders.structure,
        delay=orders.delay,
        wait=orders.delay,
        core=polynomial_core(model, records.period),
        polynomials=model,
        names=orders.names,
        values=orders.theta(model),
        covariance=covariance,
        poles=poles,
        pole_std=pole_std,
        zeros=zeros,
        zero_std=magnitude_std(zeros, zero_gradient, covariance),
        gain=np.array([[gain.value]]),
        gain_std=np.array([[gain.std]]),
        quantities=(gain, *modes(poles, pole_gradient, covariance, records.period)),
        fit=measures,
        method=_method(records, orders, initial),
        remarks=(*records.notes, *_remarks(scaled, fit, inner, poles, pole_std), *unsettled, *doubts),
        condition=fit.condition,
        verdict="not identified" if doubts else "identified",
    )


def _poles(model: Polynomials, orders: Orders) -> tuple[np.ndarray, np.ndarray]:
    """Poles (na,) and their derivatives (na, k) by all parameters."""
    poles, slope = root_gradient(model.a)
    gradient = np.zeros((len(poles), orders.count), dtype=complex)
    gradient[:, : orders.na] = slope
    return poles, gradient


def _zeros(model: Polynomials, orders: Orders) -> tuple[np.ndarray, np.ndarray]:
    """Zeros (nb - 1,), those of b / b_first, and their derivatives (nb - 1, k); none where b begins with 0."""
    lead, na = model.b[orders.delay :], orders.na
    zeros, slope = root_gradient(lead / lead[0]) if lead[0] != 0.0 else (np.zeros(0), np.zeros((0, 0)))
    gradient = np.zeros((len(zeros), orders.count), dtype=complex)
    if len(zeros):
        gradient[:, na + 1 : na + orders.nb] = slope / lead[0]
        gradient[:, na] = -(slope @ (lead[1:] / lead[0])) / lead[0]
    return zeros, gradient


def _gain(model: Polynomials, orders: Orders, covariance: np.ndarray, unit: str) -> ModelQuantity:
    """Gain at rest."""
    gain, by_a, by_b = gain_of(model.a, model.b)
    slope = np.concatenate([by_a, by_b[orders.delay :], np.zeros(orders.count - orders.na - orders.nb)])
    return ModelQuantity("gain", gain, float(np.sqrt(max(slope @ covariance @ slope, 0.0))), unit)


def _method(records: Records, orders: Orders, initial: bool) -> str:
    """One line: structure, order, delay, what was estimated beside them, rows."""
    first = "nf" if orders.structure == "oe" else "na"
    text = f"{first} {orders.na}, nb {orders.nb}" + (f", nc {orders.nc}" if orders.nc else "")
    samples = f"{orders.delay} sample{'s' * (orders.delay != 1)} ({orders.delay * records.period:.4g} s)"
    offset = "offset estimated" if orders.constant else "no offset"
    start = "initial states estimated" if initial else "initial states as measured"
    return f"{orders.structure.upper()} of {text}, delay {samples}, {offset}, {start}, {records.rows} rows"


def _doubts(records: Records, fit: PredictionFit, measures: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Sentences on why the model is not identified; none of one that is."""
    found = []
    if not _significant(fit):
        found.append(f"no coefficient of B differs from 0: {records.outputs[0]} does not answer to {records.inputs[0]}")
    if fit.condition > SINGULAR:
        found.append(
            f"the parameters cannot be distinguished (condition {fit.condition:.1g}): the order is too high for "
            "the input's frequencies, or for data without noise"
        )
    if not all(np.isfinite(each["rms"]) for each in measures.values()):
        found.append("the model is unstable: its free simulation diverges")
    return found


def _of_delays(delays: tuple[int, int] | None, chosen: int | None = None) -> list[str]:
    """Sentences about delays that the data do not distinguish, and about none that was chosen from them."""
    if chosen == 0:
        return [
            "the output answers in its input's own row (delay 0), as it seems to where a controller reads the output and "
            "acts in one row: if the input acts after the output is measured, fit with delay=1 or the delay that is known"
        ]
    if delays is None or delays[0] == delays[1]:
        return []
    return [
        f"the data do not distinguish delays of {delays[0]} to {delays[1]} samples (95 %): "
        "the first response is lost in the noise"
    ]


def _row(candidate: OrderCandidate) -> Mapping[str, float]:
    numbers = {name: getattr(candidate.orders, name) for name in ("na", "nb", "nc", "delay")}
    return numbers | {name: candidate[name] for name in CRITERIA}


def _significant(fit: PredictionFit) -> bool:
    """True if the coefficients of B differ from 0 together:  bᵀ cov⁻¹ b against χ²."""
    part = slice(fit.orders.na, fit.orders.na + fit.orders.nb)
    b = fit.theta[part]
    statistic = float(b @ np.linalg.pinv(fit.covariance[part, part], hermitian=True) @ b)
    return bool(chi2.sf(statistic, len(b)) < CERTAIN)


def _remarks(
    scaled: Records, fit: PredictionFit, model: Polynomials, poles: np.ndarray, pole_std: np.ndarray
) -> list[str]:
    """Sentences about errors, feedback and poles."""
    kind, found = fit.orders.structure, []
    test = feedback(scaled.fit, fit.orders.delay)
    if test.p < CERTAIN:
        if kind == "oe":
            found.append(closed_loop("an output-error model"))
        else:
            found.append(
                "the input follows past disturbances of the output (closed loop): "
                "unbiased only where the model of the noise holds"
            )
    white = whiteness(fit.errors)
    exact = fit.cost <= 1e-16 * fit.equations
    if white.p < CERTAIN and not exact:
        if kind == "oe":
            found.append("the errors of the simulation are coloured; the intervals allow for it")
        else:
            found.append(
                "the errors one step ahead are not white: the intervals allow for it, but not for a bias; "
                f"try {'armax or ' * (kind == 'arx')}a higher order"
            )
    errors = [prediction_errors(model, each, fit.orders.past, True) for each in scaled.fit]
    rest = cross_correlation(errors, [each.u[fit.orders.past :, 0] for each in scaled.fit], -20)
    if rest.p < CERTAIN and not exact:
        found.append(
            "the errors follow past inputs: there are dynamics that this order does not have, or that are not linear"
        )
    for pole, std in zip(poles, pole_std, strict=True):
        if abs(pole) > 1.0 - 2.0 * std and std < 0.5:
            found.append(
                f"a pole at {abs(pole):.5f} ± {1.96 * std:.2g} may be an integrator: gain and time constant mean little"
            )
    return list(dict.fromkeys(found))  # a pair of poles is said once
