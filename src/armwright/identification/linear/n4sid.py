"""Fit of a state-space model of one or several inputs and outputs by a subspace method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from armwright.entry import expect
from armwright.errors import Interrupted, LogError, check_known
from armwright.identification.linear import subspace
from armwright.identification.linear.frequency import closed_loop
from armwright.identification.linear.measures import gain_units, simulation_measures
from armwright.identification.linear.model import LinearModel
from armwright.identification.linear.modes import ModelQuantity, magnitude_std, matched, modes
from armwright.identification.linear.prediction_error import largest_radius
from armwright.identification.linear.records import (
    LIKELIEST,
    LogSignals,
    RecordedStretch,
    Records,
    check_rows,
    records_of,
)
from armwright.identification.linear.residuals import CERTAIN, feedback
from armwright.identification.linear.scaling import SignalUnits, scale
from armwright.identification.linear.selection import (
    USUAL,
    Criterion,
    OrderSearch,
    checked_delay,
    checked_order,
    criteria,
    first_response,
    folds,
    too_short,
)
from armwright.identification.linear.state_space import StateSpace
from armwright.progress import progress

MOST_ORDER = 10  # that is tried
SHORTEST = 15  # rows of past and future
BLOCKS = 10  # that the jackknife leaves out, one after the other


@dataclass(frozen=True)
class SubspaceMethod:
    """Options of a subspace method.

    Args:
        horizon: rows of past and future; None: 2 `order` + 2, at least 15.   weighting: "cva" or "moesp".
        direct: True: D is estimated; False: it is 0.
    Raises:
        LogError: names the field.
    Example:
        >>> u = np.random.default_rng(0).standard_normal(500)
        >>> y = np.concatenate([[0.0], 0.5 * u[:-1]])  # half of it, a row later
        >>> method = aw.identification.SubspaceMethod(horizon=20)
        >>> aw.identification.fit_n4sid(u, y, 0.01, order=1, method=method).order
        1
    """

    horizon: int | None = None
    weighting: Literal["cva", "moesp"] = "cva"
    direct: bool = False

    def __post_init__(self) -> None:
        check_known(LogError, self.weighting, ("cva", "moesp"), place="weighting")
        if not isinstance(self.direct, bool):
            raise LogError(place="direct", value=self.direct, expected="True or False")

    def rows(self, order: int | None, most_order: int) -> int:
        """Rows of the horizon for an order, or for one that is chosen up to the largest.

        Raises:
            LogError: a horizon that is too short for the order.
        """
        rows = self.horizon or max(2 * (order or most_order) + 2, SHORTEST)
        if not isinstance(rows, (int, np.integer)) or rows <= (order or 1):
            expected = f"a whole number above the order, {order or 1}"
            raise LogError(place="horizon", value=self.horizon, expected=expected)
        return rows


CVA = SubspaceMethod()


def fit_n4sid(
    data: Any, y: Any = None, period: Any = None, *, signals: LogSignals = LIKELIEST, order: int | Literal["auto"] = "auto",
    delay: int | Literal["auto"] = "auto", search: OrderSearch = USUAL, offset: bool = True, initial: bool = True,
    method: SubspaceMethod = CVA,
) -> LinearModel:  # fmt: skip
    """State-space model by a subspace method, of one or several inputs and outputs. [VanOverscheeDeMoor1996].

    A and C follow from the future outputs that the past explains; B, D, offset and initial states by least squares of the free
    simulation. Standard deviations are those of a jackknife, which leaves out a tenth of the rows ten times. There is no model of
    the noise, and data from a closed loop bias it.

    Args:
        data: a `Log`, or u: (rows,) or (rows, inputs), or a list of runs.   y: (rows, outputs), or a list.
        period: [s], or times.   signals: of a log, one or several of each.
        order: number of states; "auto": chosen.   delay: [samples] of all inputs; "auto": of one input and output chosen, of
            several 0.   search: how they are chosen.
        offset: as of `fit_oe`.   initial: True: initial states are estimated; False: they are 0.   method: horizon, weighting, D.
    Returns:
        model: with poles, gain and their standard deviations; `singular` values of the projection.
    Raises:
        LogError: as `fit_oe`; an input that excites too few frequencies.
        Interrupted: as `fit_oe`.
    Example:
        >>> u = np.random.default_rng(0).standard_normal(500)
        >>> y = np.concatenate([[0.0], 0.5 * u[:-1]])  # half of it, a row later
        >>> model = aw.identification.fit_n4sid(u, y, 0.01, order=1)
        >>> model.order
        1
    """
    expect(search, OrderSearch, "search", "an aw.identification.OrderSearch", LogError)
    expect(method, SubspaceMethod, "method", "an aw.identification.SubspaceMethod", LogError)
    records = records_of(data, y, period, signals)
    n, late, most_order = checked_order(order, 1), checked_delay(delay), search.most_order or MOST_ORDER
    assert not isinstance(n, tuple)
    rows, direct = method.rows(n, most_order), method.direct
    single = len(records.inputs) == len(records.outputs) == 1
    if late is None:
        least = 1 - direct  # a state answers one sample late
        late = first_response(records.fit, max(search.most_delay, least), least) if single else least
    if late == 0 and not direct:
        raise LogError(place="delay", value=0, expected="from 1 on, or direct=True: a state answers one sample late")
    scaled, units = scale(records, inputs_centred=False, outputs_centred=offset)
    fit = SubspaceFit(scaled.delayed(late - (not direct)), rows, method, offset, initial)
    check_rows(fit.data, rows * (len(records.inputs) + len(records.outputs)), 2 * rows)
    projection = fit.projection(fit.data.fit)
    most = projection.observability.shape[1]
    if n is not None and n > most:
        raise LogError("too many states for the data", place="order", value=n, expected=f"at most {most}")
    largest = min(most_order, most, rows - 1)
    tried = () if n is not None else fit.tried(projection, search.select, largest)
    stopped = f"after {len(tried)} of {largest} orders" if 0 < len(tried) < largest else ""
    chosen = n or int(min(tried, key=lambda row: row[search.select])["order"])
    model, _, moved = fit.states(projection, chosen)
    remarks = list(records.notes)
    if stopped:
        remarks.append(f"stopped by Ctrl-C {stopped}: another order may be better")
    if moved:
        remarks.append("a pole lay outside the unit circle and was drawn back: the plant may integrate or be unstable")
    # with a delay that is too long the errors of the test would contain the first response
    if single and feedback(scaled.fit, min(late, 1)).p < CERTAIN:
        remarks.append(closed_loop("a subspace method"))
    measures = simulation_measures(records, fit.data, partial(free_errors, model), None, 0, units.ys)
    fits = [row["fit_percent"] for row in measures.values()]
    text = (
        f"N4SID ({method.weighting.upper()}, horizon {rows}) of order {chosen}, delay {late} sample{'s' * (late != 1)}, "
        f"{'offset estimated' if offset else 'no offset'}, initial states {'estimated' if initial else '0'}, {records.rows} rows"
    )
    whole = units.state_space(model)
    result = LinearModel.of(
        records,
        kind="n4sid",
        delay=late,
        wait=late - (not direct),
        core=whole,
        **_poles_and_gain(records, whole, *fit.jackknife(whole, units)),
        fit=measures,
        method=text,
        remarks=tuple(remarks),
        tried=tuple(tried),
        criterion="" if n is not None else search.select,
        verdict="identified" if max(fits, default=0.0) > 0.0 and np.isfinite(fits).all() else "not identified",
        singular=projection.singular,
    )
    if stopped:
        raise Interrupted(stopped, found=result)
    return result


def _poles_and_gain(records: Records, whole: StateSpace, by_pole: np.ndarray, by_gain: np.ndarray) -> dict[str, Any]:
    """Fields of a model that follow from its states, with deviations from the blocks of the jackknife."""
    poles, gain, unit_matrix = whole.poles, whole.gain, np.eye(by_pole.shape[1])
    std = np.sqrt((by_gain**2).sum(axis=-1))
    names = [[f"gain {y} by {u}" for u in records.inputs] for y in records.outputs] if gain.size > 1 else [["gain"]]
    gains = [
        ModelQuantity(*each)
        for rows in zip(names, gain.tolist(), std.tolist(), gain_units(records), strict=True)
        for each in zip(*rows, strict=True)
    ]
    return {
        "poles": poles,
        "pole_std": magnitude_std(poles, by_pole, unit_matrix),
        "gain": gain,
        "gain_std": std,
        "quantities": (*gains, *modes(poles, by_pole, unit_matrix, records.period)),
    }


def free_errors(model: StateSpace, each: RecordedStretch) -> np.ndarray:
    """Errors (rows, outputs) of the free simulation of a stretch from the initial state that suits it best."""
    return each.y - model.simulate(each.u, subspace.initial_state(model, each))


@dataclass(frozen=True, eq=False)
class SubspaceFit:
    """Models of scaled records by a subspace method.

    Attributes:
        data: with inputs as late as they act.   rows: of the horizon.   method: weighting, and whether D is estimated.
        offset, initial: whether these are estimated.
    """

    data: Records
    rows: int
    method: SubspaceMethod
    offset: bool
    initial: bool

    def projection(self, stretches: Sequence[RecordedStretch]) -> subspace.Projection:
        """The projection of some stretches."""
        return subspace.project(stretches, self.rows, self.method.weighting, self.offset)

    def states(
        self, projection: subspace.Projection, order: int, stretches: Sequence[RecordedStretch] | None = None
    ) -> tuple[StateSpace, np.ndarray, bool]:
        """Model of an order, errors (rows, outputs) of its free simulation, and True where a pole was moved.

        Args:
            projection: of the stretches.   order: number of states.   stretches: to fit; None: all.
        """
        stretches = self.data.fit if stretches is None else stretches
        a, c, moved = subspace.dynamics(projection, order, largest_radius(stretches))
        model, errors = subspace.inputs_of(
            a, c, stretches, self.data.period, direct=self.method.direct, constant=self.offset, initial=self.initial
        )
        return model, errors, moved

    def tried(self, projection: subspace.Projection, by: Criterion, largest: int) -> list[Mapping[str, float]]:
        """Criteria of every order up to the largest, or of those until Ctrl-C."""
        m, p, stretches = len(self.data.inputs), len(self.data.outputs), self.data.fit
        parted = folds(stretches, 3 * self.rows) if by == "cv" else []
        if by == "cv" and not parted:
            raise too_short()
        parts = [(self.projection(fitted), fitted, held) for fitted, held in parted]
        tried: list[Mapping[str, float]] = []
        with progress("trying orders") as tell:
            try:
                for order in range(1, largest + 1):
                    tell(order - 1, largest)
                    _, errors, _ = self.states(projection, order)
                    equations = errors.size - order * len(stretches) * self.initial
                    count = order * (m + p) + m * p * self.method.direct + p * self.offset  # of a canonical form
                    found = criteria(float((errors**2).sum()), max(equations, 1), count)
                    tried.append({"order": order, **found, "cv": self._held_error(parts, order)})
            except KeyboardInterrupt:
                if not tried:
                    raise
        return tried

    def _held_error(self, parts: Sequence[Any], order: int) -> float:
        """Mean square of the free simulation's error on blocks that were not fitted."""
        total, rows = 0.0, 0
        for projection, fitted, held in parts:
            model, _, _ = self.states(projection, min(order, projection.observability.shape[1]), fitted)
            for each in held:
                e = free_errors(model, each)
                total, rows = total + float((e**2).sum()), rows + e.size - order
        return total / rows if rows > 0 else float("nan")

    def jackknife(self, whole: StateSpace, units: SignalUnits) -> tuple[np.ndarray, np.ndarray]:
        """Deviations of poles (n, blocks) and gain (outputs, inputs, blocks) whose sums of squares are variances.

        Each is sqrt((J - 1) / J) (estimate without block j - mean of these), J blocks. [EfronTibshirani1993], chapter 11.
        """
        order, poles, gains = len(whole.a), [], []
        for fitted, _ in folds(self.data.fit, 3 * self.rows, BLOCKS):
            try:
                projection = self.projection(fitted)
            except LogError:  # what is left does not excite every lag
                continue
            model = units.state_space(self.states(projection, order, fitted)[0])
            poles.append(matched(whole.poles, model.poles))
            gains.append(model.gain)
        if len(poles) < 3:
            return np.full((order, 1), np.nan), np.full((*whole.d.shape, 1), np.nan)
        factor = np.sqrt((len(poles) - 1) / len(poles))
        both = np.array(poles).T, np.moveaxis(np.array(gains), 0, -1)
        with np.errstate(invalid="ignore"):  # an integrator's gain is infinite, and has no deviation
            by_pole, by_gain = (factor * (each - each.mean(axis=-1, keepdims=True)) for each in both)
        return by_pole, by_gain
