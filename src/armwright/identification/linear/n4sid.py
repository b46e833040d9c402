"""Fit of a state-space model of one or several inputs and outputs by a subspace method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from armwright.errors import LogError
from armwright.identification.linear import subspace
from armwright.identification.linear.frequency import closed_loop
from armwright.identification.linear.measures import simulation_measures
from armwright.identification.linear.model import LinearModel
from armwright.identification.linear.modes import Quantity, magnitude_std, matched, modes
from armwright.identification.linear.records import Recorded, Records, check_rows, records_of
from armwright.identification.linear.residuals import CERTAIN, feedback
from armwright.identification.linear.scaling import Units, scale
from armwright.identification.linear.selection import (
    MOST_DELAY,
    Criterion,
    check_options,
    checked_order,
    criteria,
    first_response,
    folds,
    too_short,
)
from armwright.identification.linear.state_space import StateSpace

SHORTEST = 15  # rows of past and future
BLOCKS = 10  # that the jackknife leaves out, one after the other


@dataclass(frozen=True)
class How:
    """Options of a subspace fit: rows of the horizon, weighting, and what is estimated beside A, B and C."""

    rows: int
    weighting: Literal["cva", "moesp"]
    direct: bool
    offset: bool
    initial: bool

    def projection(self, stretches: Sequence[Recorded]) -> subspace.Projection:
        """The projection for these options."""
        return subspace.project(stretches, self.rows, self.weighting, self.offset)


def fit_n4sid(
    data: Any, y: Any = None, period: Any = None, *, order: int | Literal["auto"] = "auto", delay: int | Literal["auto"] = "auto",
    select: Criterion = "cv", weighting: Literal["cva", "moesp"] = "cva", horizon: int | None = None, direct: bool = False,
    offset: bool = True, initial: bool = True, most_order: int = 10, most_delay: int = MOST_DELAY,
    input: str | Sequence[str] | None = None, output: str | Sequence[str] | None = None, joint: str | Sequence[str] | None = None,
) -> LinearModel:  # fmt: skip
    """State-space model by a subspace method, of one or several inputs and outputs. [VanOverscheeDeMoor1996].

    A and C follow from the future outputs that the past explains; B, D, offset and initial states by least squares of the free
    simulation. Standard deviations are those of a jackknife, which leaves out a tenth of the rows ten times. There is no model of
    the noise, and data from a closed loop bias it.

    Args:
        data: a `Log`, or u: (rows,) or (rows, inputs), or a list of runs.   y: (rows, outputs), or a list.
        period: [s], or times.
        order: number of states; "auto": chosen up to `most_order`.   delay: [samples] of all inputs; "auto": of one input and
            output chosen, of several 0.   select: criterion, as of `fit_oe`.   weighting: "cva" or "moesp".
        horizon: rows of past and future; default: 2 `order` + 2, at least 15.   direct: True: D is estimated; False: it is 0.
        offset: as of `fit_oe`.   initial: True: initial states are estimated; False: they are 0.   most_order: largest order
            that is tried.   most_delay: largest delay.   input: signals of a log, one or several.   output: the same.
            joint: names, one or several.
    Returns:
        model: with poles, gain and their standard deviations; `singular` values of the projection.
    Raises:
        LogError: as `fit_oe`; an input that excites too few frequencies.
    """
    records = records_of(data, y, period, input=input, output=output, joint=joint)
    n = checked_order(order, 1)
    check_options(delay, select, most_order, most_delay)
    if weighting not in ("cva", "moesp"):
        raise LogError(place="weighting", value=weighting, choices=("cva", "moesp"))
    assert not isinstance(n, tuple)
    rows = horizon or max(2 * (n or most_order) + 2, SHORTEST)
    if not isinstance(rows, (int, np.integer)) or rows <= (n or 1):
        raise LogError(place="horizon", value=horizon, expected=f"a whole number above the order, {n or 1}")
    single = len(records.inputs) == len(records.outputs) == 1
    if delay == "auto":
        delay = first_response(records.fit, most_delay) if single else 1 - direct
    if delay == 0 and not direct:
        raise LogError(place="delay", value=0, expected="from 1 on, or direct=True: a state answers one sample late")
    how = How(rows, weighting, direct, offset, initial)
    scaled, units = scale(records, offset)
    late = scaled.delayed(delay - (not direct))
    check_rows(late, rows * (len(records.inputs) + len(records.outputs)), 2 * rows)
    projection = how.projection(late.fit)
    most = projection.observability.shape[1]
    if n is not None and n > most:
        raise LogError("too many states for the data", place="order", value=n, expected=f"at most {most}")
    tried = () if n is not None else _tried(projection, late, how, select, min(most_order, most, rows - 1))
    chosen = n or int(min(tried, key=lambda row: row[select])["order"])
    model, _, moved = _states(projection, chosen, late, how)
    whole = units.state_space(model)
    pole_gradient, gain_spread = _jackknife(whole, late, units, chosen, how)
    gain_std = np.sqrt((gain_spread**2).sum(axis=-1))
    poles, unit_matrix = whole.poles, np.eye(pole_gradient.shape[1])
    quantities = [*_gains(records, whole.gain, gain_std), *modes(poles, pole_gradient, unit_matrix, records.period)]
    remarks = list(records.notes)
    if moved:
        remarks.append("a pole lay outside the unit circle and was drawn back: the plant may integrate or be unstable")
    if single and feedback(scaled.fit, delay).p < CERTAIN:
        remarks.append(closed_loop("a subspace method"))

    def free(each: Recorded) -> np.ndarray:
        return each.y - model.simulate(each.u, subspace.initial_state(model, each))

    measures = simulation_measures(records, late, free, None, 0, units.ys)
    fits = [row["fit_percent"] for row in measures.values()]
    method = (
        f"N4SID ({weighting.upper()}, horizon {rows}) of order {chosen}, delay {delay} sample{'s' * (delay != 1)}, "
        f"{'offset estimated' if offset else 'no offset'}, initial states {'estimated' if initial else '0'}, {records.rows} rows"
    )
    return LinearModel(
        kind="n4sid",
        period=records.period,
        delay=delay,
        wait=delay - (not direct),
        inputs=records.inputs,
        outputs=records.outputs,
        input_units=records.input_units,
        output_units=records.output_units,
        core=whole,
        polynomials=None,
        names=(),
        values=np.zeros(0),
        covariance=np.zeros((0, 0)),
        poles=poles,
        pole_std=magnitude_std(poles, pole_gradient, unit_matrix),
        zeros=np.zeros(0),
        zero_std=np.zeros(0),
        gain=whole.gain,
        gain_std=gain_std,
        quantities=tuple(quantities),
        fit=measures,
        method=method,
        remarks=tuple(remarks),
        tried=tuple(tried),
        criterion="" if n is not None else select,
        verdict="identified" if max(fits, default=0.0) > 0.0 and np.isfinite(fits).all() else "not identified",
        sha256=records.sha256,
        singular=projection.singular,
    )


def _gains(records: Records, gain: np.ndarray, std: np.ndarray) -> list[Quantity]:
    """Gains at rest of every output by every input."""
    found = []
    for o, (output, unit) in enumerate(zip(records.outputs, records.output_units, strict=True)):
        for i, (input, by) in enumerate(zip(records.inputs, records.input_units, strict=True)):
            name = "gain" if gain.size == 1 else f"gain {output} by {input}"
            found.append(Quantity(name, float(gain[o, i]), float(std[o, i]), f"{unit} / {by}" if by else unit))
    return found


def _states(
    projection: subspace.Projection, order: int, data: Records, how: How
) -> tuple[StateSpace, np.ndarray, bool]:
    """Model of an order, errors (rows, outputs) of its free simulation, and True where a pole was moved."""
    limit = 1.0 + 1.0 / max(len(each.y) for each in data.fit)
    a, c, moved = subspace.dynamics(projection, order, limit)
    model, errors = subspace.inputs_of(
        a, c, data.fit, data.period, direct=how.direct, constant=how.offset, initial=how.initial
    )
    return model, errors, moved


def _tried(
    projection: subspace.Projection, data: Records, how: How, by: Criterion, largest: int
) -> list[Mapping[str, float]]:
    """Criteria of every order up to the largest."""
    m, p = len(data.inputs), len(data.outputs)
    parted = []
    for fitted, held in folds(data.fit, 3 * how.rows) if by == "cv" else []:
        parted.append((how.projection(fitted), replace(data, fit=tuple(fitted)), held))
    if by == "cv" and not parted:
        raise too_short()
    tried: list[Mapping[str, float]] = []
    for order in range(1, largest + 1):
        _, errors, _ = _states(projection, order, data, how)
        equations = errors.size - order * len(data.fit) * how.initial
        count = order * (m + p) + m * p * how.direct + p * how.offset  # of a canonical form
        found = criteria(float((errors**2).sum()), max(equations, 1), count)
        tried.append({"order": order, **found, "cv": _held_error(parted, order, how)})
    return tried


def _held_error(parted: Sequence[Any], order: int, how: How) -> float:
    """Mean square of the free simulation's error on blocks that were not fitted."""
    total, rows = 0.0, 0
    for projection, data, held in parted:
        model, _, _ = _states(projection, min(order, projection.observability.shape[1]), data, how)
        for each in held:
            e = each.y - model.simulate(each.u, subspace.initial_state(model, each))
            total, rows = total + float((e**2).sum()), rows + e.size - order
    return total / rows if rows > 0 else float("nan")


def _jackknife(whole: StateSpace, data: Records, units: Units, order: int, how: How) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of poles (n, blocks) and gain (outputs, inputs, blocks) whose sums of squares are variances.

    Each is sqrt((J - 1) / J) (estimate without block j - mean of these), J blocks. [EfronTibshirani1993], chapter 11.
    """
    poles, gains = [], []
    for fitted, _ in folds(data.fit, 3 * how.rows, BLOCKS):
        try:
            projection = how.projection(fitted)
        except LogError:  # what is left does not excite every lag
            continue
        model, _, _ = _states(projection, order, replace(data, fit=tuple(fitted)), how)
        model = units.state_space(model)
        poles.append(matched(whole.poles, model.poles))
        gains.append(model.gain)
    if len(poles) < 3:
        return np.full((order, 1), np.nan), np.full((*whole.d.shape, 1), np.nan)
    factor = np.sqrt((len(poles) - 1) / len(poles))
    spread, gain = np.array(poles).T, np.moveaxis(np.array(gains), 0, -1)
    return factor * (spread - spread.mean(axis=1, keepdims=True)), factor * (gain - gain.mean(axis=-1, keepdims=True))
