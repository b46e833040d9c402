"""Fits of ARX, OE and ARMAX models by prediction errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
from scipy.stats import chi2

from armwright.errors import LogError
from armwright.identification.linear.delays import delay_interval
from armwright.identification.linear.frequency import closed_loop
from armwright.identification.linear.measures import gain_unit, simulation_measures
from armwright.identification.linear.model import LinearModel, polynomial_core
from armwright.identification.linear.modes import Quantity, gain_of, magnitude_std, modes, root_gradient
from armwright.identification.linear.prediction_error import (
    Fit,
    Orders,
    Polynomials,
    Structure,
    estimate,
    prediction_errors,
)
from armwright.identification.linear.records import Records, check_rows, records_of
from armwright.identification.linear.residuals import CERTAIN, cross_correlation, feedback, whiteness
from armwright.identification.linear.scaling import Units, scale
from armwright.identification.linear.selection import (
    CRITERIA,
    MOST_DELAY,
    MOST_ORDER,
    Criterion,
    check_options,
    checked_order,
    first_response,
    selected,
)

SINGULAR = 1e8  # condition from which parameters are rounding


class Options(TypedDict, total=False):
    """Options of `fit_arx`, `fit_oe` and `fit_armax`; `fit_oe` explains them."""

    order: int | tuple[int, ...] | Literal["auto"]
    delay: int | Literal["auto"]
    select: Criterion
    offset: bool
    initial: bool
    most_order: int
    most_delay: int
    input: str | None
    output: str | None
    joint: str | None


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
    """
    return _fit("arx", data, y, period, **options)


def fit_oe(data: Any, y: Any = None, period: Any = None, **options: Unpack[Options]) -> LinearModel:
    """Output-error model by least squares of the free simulation:  y = B(q)/F(q) u + offset + e.  [Ljung1999], section 10.2.

    Levenberg-Marquardt with exact gradients from ARX, instrumental variables and Steiglitz-McBride. The noise may have any
    colour, and the intervals allow for it. Data from a closed loop bias it: a remark says so.

    Args:
        data: a `Log`, or u (rows,), or a list of runs.   y: (rows,) or a list.   period: [s], or times (rows,).
        options: all of these may be left out.
            order: n, or (nf, nb); "auto" (default): chosen up to `most_order`, 5.
            delay: [samples]; "auto" (default): chosen up to `most_delay`, 25.
            select: criterion that chooses: "cv" (default: free simulation of blocks that were not fitted), "aic", "bic",
            "fpe" or "mdl".
            offset: True (default): a constant is estimated; False: none.
            initial: True (default): the initial state of every run is estimated; False: its first rows are taken as measured.
            input: signal of a log; default: its voltage, current or torque.   output: default: its speed or position.
            joint: needed where several have both.
    Returns:
        model: with covariance, poles, gain, and the fit of its free simulation on runs to fit and to hold out.
    Raises:
        LogError: not a number, constant signals, two clocks, too few rows for the order; names what and where.
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
    """
    return _fit("armax", data, y, period, **options)


def _fit(
    structure: Structure, data: Any, y: Any, period: Any, *, order: Any = "auto", delay: int | Literal["auto"] = "auto",
    select: Criterion = "cv", offset: bool = True, initial: bool = True, most_order: int = MOST_ORDER,
    most_delay: int = MOST_DELAY, input: str | None = None, output: str | None = None, joint: str | None = None,
) -> LinearModel:  # fmt: skip
    records = records_of(data, y, period, input=input, output=output, joint=joint)
    if len(records.inputs) > 1 or len(records.outputs) > 1:
        what = f"{len(records.inputs)} inputs, {len(records.outputs)} outputs"
        raise LogError(what, place="data", expected="one of each; fit_n4sid takes several")
    numbers = {"arx": 2, "oe": 2, "armax": 3}[structure]
    n = checked_order(order, numbers)
    check_options(delay, select, most_order, most_delay)
    scaled, to_units = scale(records, offset)
    known = None if delay == "auto" else int(delay)
    if isinstance(n, tuple):
        na, nb, nc = (*n, 0)[:3]
        found = first_response(scaled.fit, most_delay) if known is None else known
        orders = Orders(structure, na, nb, nc if structure == "armax" else 0, found, offset)
        check_rows(records, orders.count, orders.past)
        tried: tuple[Any, ...] = ()
    elif n is not None and known is not None:
        orders, tried = Orders(structure, n, n, n if structure == "armax" else 0, known, offset), ()
        check_rows(records, orders.count, orders.past)
    else:
        largest = n or most_order
        check_rows(records, 3 * largest + offset, largest + (most_delay if known is None else known))
        orders, tried = selected(
            structure, scaled.fit, n, known,
            most_order=most_order, most_delay=most_delay, constant=offset, initial=initial, by=select,
        )  # fmt: skip
    fit = estimate(orders, scaled.fit, orders.past, initial)
    delays = (orders.delay, orders.delay) if known is not None else delay_interval(fit, scaled.fit, initial)
    model = _result(records, scaled, fit, to_units, initial, select if tried else "", tried)
    return replace(model, delays=delays, remarks=(*model.remarks, *_of_delays(delays)))


def _result(
    records: Records, scaled: Records, fit: Fit, units: Units, initial: bool, criterion: str, tried: Sequence[Any]
) -> LinearModel:
    """The fit in units, with everything that follows from it."""
    orders = fit.orders
    inner = orders.polynomials(fit.theta)
    model = units.polynomials(inner)
    change = units.jacobian(orders)
    covariance = change @ fit.covariance @ change.T
    na, nb = orders.na, orders.nb
    poles, pole_slope = root_gradient(model.a)
    lead = model.b[orders.delay :]
    zeros, zero_slope = root_gradient(lead / lead[0]) if lead[0] != 0.0 else (np.zeros(0), np.zeros((0, 0)))
    pole_gradient = np.zeros((len(poles), orders.count), dtype=complex)
    pole_gradient[:, :na] = pole_slope
    gain, by_a, by_b = gain_of(model.a, model.b)
    slope = np.concatenate([by_a, by_b[orders.delay :], np.zeros(orders.count - na - nb)])
    gain_std = float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
    unit = gain_unit(records)
    pole_std = magnitude_std(poles, pole_gradient, covariance)
    zero_gradient = np.zeros((len(zeros), orders.count), dtype=complex)
    if len(zeros):  # of b / b_first
        zero_gradient[:, na + 1 : na + nb] = zero_slope / lead[0]
        zero_gradient[:, na] = -(zero_slope @ (lead[1:] / lead[0])) / lead[0]
    remarks = [*records.notes, *_remarks(scaled, fit, inner, poles, pole_std)]
    known = _significant(fit)
    if not known:
        remarks.append(
            f"no coefficient of B differs from 0: {records.outputs[0]} does not answer to {records.inputs[0]}"
        )
    condition = fit.condition
    if condition > SINGULAR:
        remarks.append(
            f"the parameters cannot be distinguished (condition {condition:.1g}): the order is too high for "
            "the input's frequencies, or for data without noise"
        )
        known = False
    if not fit.converged:
        remarks.append("the search for the minimum did not end: treat the numbers with care")
    quantities = [Quantity("gain", gain, gain_std, unit), *modes(poles, pole_gradient, covariance, records.period)]
    free = replace(inner, c=inner.a)
    measures = simulation_measures(
        records, scaled, lambda each: prediction_errors(free, each, orders.past, True)[:, None],
        lambda each: prediction_errors(inner, each, orders.past, initial)[:, None], orders.past, units.ys,
    )  # fmt: skip
    if not all(np.isfinite(each["rms"]) for each in measures.values()):
        remarks.append("the model is unstable: its free simulation diverges")
        known = False
    start = "initial states estimated" if initial else "initial states as measured"
    text = f"na {na}, nb {nb}" + (f", nc {orders.nc}" if orders.structure == "armax" else "")
    text = text.replace("na", "nf") if orders.structure == "oe" else text
    samples = f"{orders.delay} sample{'s' * (orders.delay != 1)} ({orders.delay * records.period:.4g} s)"
    method = (
        f"{orders.structure.upper()} of {text}, delay {samples}, "
        f"{'offset estimated' if orders.constant else 'no offset'}, {start}, {records.rows} rows"
    )
    return LinearModel(
        kind=orders.structure,
        period=records.period,
        delay=orders.delay,
        wait=orders.delay,
        inputs=records.inputs,
        outputs=records.outputs,
        input_units=records.input_units,
        output_units=records.output_units,
        core=polynomial_core(model, records.period),
        polynomials=model,
        names=orders.names,
        values=orders.theta(model),
        covariance=covariance,
        poles=poles,
        pole_std=pole_std,
        zeros=zeros,
        zero_std=magnitude_std(zeros, zero_gradient, covariance),
        gain=np.array([[gain]]),
        gain_std=np.array([[gain_std]]),
        quantities=tuple(quantities),
        fit=measures,
        method=method,
        remarks=tuple(remarks),
        tried=tuple(_row(each) for each in tried),
        criterion=criterion,
        condition=condition,
        verdict="identified" if known else "not identified",
        sha256=records.sha256,
    )


def _of_delays(delays: tuple[int, int] | None) -> list[str]:
    """Sentence about delays that the data do not distinguish."""
    if delays is None or delays[0] == delays[1]:
        return []
    return [
        f"the data do not distinguish delays of {delays[0]} to {delays[1]} samples (95 %): "
        "the first response is lost in the noise"
    ]


def _row(candidate: Any) -> Mapping[str, float]:
    orders = candidate.orders
    return {"na": orders.na, "nb": orders.nb, "nc": orders.nc, "delay": orders.delay} | {
        name: candidate[name] for name in CRITERIA
    }


def _significant(fit: Fit) -> bool:
    """True if the coefficients of B differ from 0 together:  bᵀ cov⁻¹ b against χ²."""
    part = slice(fit.orders.na, fit.orders.na + fit.orders.nb)
    b = fit.theta[part]
    statistic = float(b @ np.linalg.pinv(fit.covariance[part, part], hermitian=True) @ b)
    return bool(chi2.sf(statistic, len(b)) < CERTAIN)


def _remarks(scaled: Records, fit: Fit, model: Polynomials, poles: np.ndarray, pole_std: np.ndarray) -> list[str]:
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
