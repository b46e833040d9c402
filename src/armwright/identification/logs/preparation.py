"""Choice of zero-phase low-pass, differentiation and decimation for a run of a log, with reasons in words.

All signals of a run pass the same filter, a Butterworth low-pass run forward and backward: it shifts
nothing in time, and a linear relation between signals (torque = regressor · parameters) holds between the filtered ones too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import ceil, log
from typing import Any, Literal

import numpy as np
from scipy import signal as sp

from armwright.entry import AnyLog, as_log
from armwright.errors import LogError, check_known
from armwright.fitting.measures import periods_of_rest
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.merged_speeds import corners
from armwright.identification.logs.quantisation import quantisation_step
from armwright.identification.logs.row_checks import SHORTEST, limits_reached, runs_at_rest
from armwright.identification.logs.spectrum import ABOVE, HIGHEST, LOWEST, longest_finite, motion_band
from armwright.identification.logs.spikes import spike_limits

ROUNDING = 1e-9  # of a rate that times tell: at half of it a low-pass never settles
HIGHER = 1.25  # cut-off by one that is too low for a run
ROOM = 2.5  # rate after decimation by the cut-off: its half, Nyquist's frequency, is a quarter above the cut-off
EDGE = 1e-3  # what is left of a disturbance at a stretch's edge
WIDER = 4.0  # cut-off of a motion that a model is evaluated on, by that of the preparation
FINEST = 48.0  # rate of that motion by the cut-off, nearly: dry friction jumps somewhere between two rows
REST = 1e-2  # of a joint's range by the run's duration: slower is at rest
LITTLE = 0.01  # share of rows that a limit cuts off in the low-pass that a fit can do with
CLOSE = 0.02  # of the distance of both limits: so close to one a torque is cut off
CLOSEST = 0.3  # its cut-off as a share of the rate, where the preparation's own is not higher
# Weights of central differences: of row k after less row k before, and of both less twice the row's own.
FIRST_DIFFERENCE = {"central": (4 / 5, -1 / 5, 4 / 105, -1 / 280), "three rows": (1 / 2,)}
SECOND_DIFFERENCE = {"central": (8 / 5, -1 / 5, 8 / 315, -1 / 560), "three rows": (1.0,)}
BESIDE = {"central": 4, "savgol": 4, "three rows": 1}  # rows on either side of one that its derivative needs
SAVGOL = 9  # rows of the Savitzky-Golay window, of third order


Differentiation = Literal["central", "savgol", "three rows"]


@dataclass(frozen=True)
class Preparation:
    """Choices for `prepare_log`, made by `choose_preparation` or by hand.

    Attributes:
        cutoff: of the low-pass, where amplitudes are halved, in Hz.   order: of the Butterworth filter, which runs twice.
        decimate: every how many rows are kept.   differentiation: "central" differences of nine rows, or of "three rows";
            "savgol", a cubic through 9 rows.
        edge: rows that are dropped at either end of a stretch.   rate: of the log, in Hz.   reasons: the choices in words.
        corners: for each joint of the log, where logged speeds take over from positions, in Hz; empty: nowhere.
        spikes: by signal, from where on single rows of a column stand out and are replaced.
    """

    cutoff: float
    order: int
    decimate: int
    differentiation: Differentiation
    edge: int
    rate: float
    reasons: tuple[str, ...] = ()
    corners: tuple[float, ...] = ()
    spikes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def sections(self) -> np.ndarray:
        """The filter as second-order sections."""
        return low_pass(self.order, self.cutoff, self.rate)

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that repeat this preparation on another log, as `[fits]` of a record keeps them."""
        return {"cutoff_hz": self.cutoff, "order": self.order, "differentiation": self.differentiation}

    def at(self, cutoff: float, decimate: int | None = None, reason: str = "as asked for") -> Preparation:
        """The preparation with another cut-off in Hz, and as many rows as it needs, or every `decimate`-th."""
        why = [f"cut-off {cutoff:.4g} Hz: {reason}"]
        made = _preparation(cutoff, self.order, decimate, self.differentiation, self.rate, why)
        return replace(made, corners=self.corners, spikes=self.spikes)

    @property
    def of_motion(self) -> Preparation:
        """The wider low-pass for the motion at which a model is evaluated; its torques then pass this one.

        The rows that it keeps are those that this one keeps and some between; fewer are dropped at either end.
        """
        most = min(_fine(self.rate, self.cutoff), self.decimate)
        step = max(k for k in range(1, most + 1) if self.decimate % k == 0)
        spoilt = settling(self.sections, EDGE) // step * step
        return replace(self, cutoff=_wider(self.cutoff, self.rate), decimate=step, edge=self.edge - spoilt)


@dataclass(frozen=True, eq=False)
class RunFilters:
    """Preparation of a run's rows for an arm.

    Attributes:
        narrow: low-pass of torques and columns.   wide: of the motion, `narrow.of_motion`.
        resting: (n,) [rad/s | m/s] speeds below which a joint counts as at rest.
        limits: (2, n) of torques or currents as measured, where a full converter cuts them off; infinite where none does.
    """

    narrow: Preparation
    wide: Preparation
    resting: np.ndarray
    limits: np.ndarray

    def with_low_pass(self, narrow: Preparation) -> RunFilters:
        """The filters with another low-pass; what the rows say of rest and limits stays."""
        return replace(self, narrow=narrow, wide=narrow.of_motion)


def choose_preparation(
    log: AnyLog,
    run: str | None = None,
    *,
    cutoff: float | None = None,
    order: int = 4,
    decimate: int | None = None,
    differentiation: Differentiation | None = None,
) -> Preparation:
    """A low-pass, a way of differentiation and a decimation that fit a run, each with its reason.

    The cut-off is the end of the motion's band as `motion_band` has it, of the joint with the widest: accelerations above it
    would be noise for the most part.

    Args:
        log: a checked log.   run: its name; None: the first.   cutoff: in Hz, instead of the choice.   order: of the filter.
        decimate: every how many rows to keep, instead of the choice.   differentiation: instead of the choice, "three rows"
            where torques are held from row to row, else "central".
    Returns:
        preparation: for `prepare_log`; its `reasons` are the choices in words.
    Raises:
        LogError: no such run, or a choice that the log's rate does not allow.
    Example:
        >>> log = aw.identification.read_log("examples/logs/dc_motor/dc_motor.log.toml")
        >>> found = aw.identification.choose_preparation(log)
        >>> round(found.cutoff, 2)  # Hz
        5.07
    """
    log = as_log(log)
    chosen = log.run(run)
    rate = 1.0 / chosen.period
    reasons: list[str] = []
    if cutoff is None:
        cutoff, reason = _cutoff(log, chosen, rate)
        reasons.append(reason)
    elif not 0 < cutoff < (1.0 - ROUNDING) * 0.5 * rate:
        raise LogError(
            place="cutoff", value=cutoff, expected=f"a frequency above 0, below half the rate, {0.5 * rate:.4g} Hz"
        )
    else:
        reasons.append(f"cut-off {cutoff:.4g} Hz: as asked for")
    if not isinstance(order, int) or not 1 <= order <= 10:
        raise LogError(place="order", value=order, expected="a whole number from 1 to 10")
    differentiation = differentiation or ("three rows" if log.held else "central")
    check_known(LogError, differentiation, BESIDE, place="differentiation")
    if decimate is not None and (not isinstance(decimate, int) or not 1 <= decimate <= fewest_rows(rate, cutoff)):
        expected = f"1 to {fewest_rows(rate, cutoff)}: a rate of twice the cut-off at least"
        raise LogError(place="decimate", value=decimate, expected=expected)
    made = _preparation(float(cutoff), order, decimate, differentiation, rate, reasons)
    return replace(made, corners=corners(log, chosen), spikes=spike_limits(chosen.census, log.held))


def fewest_rows(rate: float, cutoff: float) -> int:
    """Largest decimation of rows of a rate in Hz behind a low-pass: Nyquist's."""
    return max(int(rate / (2 * cutoff)), 1)


def _preparation(
    cutoff: float,
    order: int,
    decimate: int | None,
    differentiation: Differentiation,
    rate: float,
    reasons: Sequence[str],
) -> Preparation:
    """A preparation with its choices in words; `decimate` None: chosen."""
    if (factor := decimate) is None:
        fine = _fine(rate, cutoff)
        factor = max(int(rate / (ROOM * cutoff)) // fine, 1) * fine
    sections = low_pass(order, cutoff, rate)
    wide = low_pass(order, _wider(cutoff, rate), rate)
    edge = settling(sections, EDGE) + settling(wide, EDGE) + BESIDE[differentiation]
    words = (
        *reasons,
        f"Butterworth of order {order}, forward and backward: no delay; amplitudes halved at the cut-off, "
        f"{_gain(sections, 0.5 * cutoff, rate):.1%} of them left at half of it",
        f"Savitzky-Golay: the derivative of a cubic through {SAVGOL} rows"
        if differentiation == "savgol"
        else f"central differences of {'nine' if differentiation == 'central' else 'three'} rows: "
        f"{1 - _gain_of_difference(differentiation, 2 * np.pi * cutoff / rate):.1%} too small at the cut-off",
        f"every {factor}{_ordinal(factor)} row is kept, {rate / factor:.4g} Hz: "
        f"after the filter, the rows between add no information"
        if factor > 1
        else "all rows are kept: fewer would not carry the signal",
        f"{edge} rows ({1e3 * edge / rate:.3g} ms) at either end of a stretch are dropped: the filter has not settled there",
    )
    return Preparation(cutoff, order, factor, differentiation, edge, rate, words)


def stored_preparations(log: Log, runs: Sequence[str], settings: Mapping[str, Any]) -> dict[str, Preparation]:
    """Preparations of runs by name, as of a fit; of a slower log with the highest cut-off that it allows.

    Args:
        log: a checked log.   runs: names.   settings: `Preparation.settings`.
    """
    order, differentiation = settings["order"], settings["differentiation"]
    cutoffs = {name: min(settings["cutoff_hz"], HIGHEST / log.run(name).period) for name in runs}
    made = {
        name: choose_preparation(log, name, cutoff=cutoff, order=order, differentiation=differentiation)
        for name, cutoff in cutoffs.items()
    }
    return {name: leaving_rows(log, name, each) for name, each in made.items()}


def leaving_rows(log: Log, run: str, preparation: Preparation) -> Preparation:
    """The preparation, or the next one with a higher cut-off that leaves a third of the rows of a run's longest stretch."""
    longest = max((each.rows for each in log.run(run).even), default=0)
    while 3 * preparation.edge > longest and HIGHER * preparation.cutoff < HIGHEST * preparation.rate:
        reason = "the run is too short for a lower one"
        preparation = preparation.at(HIGHER * preparation.cutoff, reason=reason)
    return preparation


def shared_preparations(log: Log, runs: Sequence[str], decimate: int | None = None) -> dict[str, Preparation]:
    """Preparations of runs by name, with the highest cut-off that any run of the log needs: of a run at rest, too, rows are left.

    Args:
        log: a checked log.   runs: names.   decimate: every how many rows to keep, instead of the choice.
    """
    if not runs:
        return {}
    chosen = {each.name: choose_preparation(log, each.name) for each in log.runs}
    widest = max(each.cutoff for each in chosen.values())
    cutoffs = {name: min(widest, HIGHEST * chosen[name].rate) for name in runs}
    return {name: choose_preparation(log, name, cutoff=each, decimate=decimate) for name, each in cutoffs.items()}


def resting_speeds(log: Log, run: str) -> np.ndarray:
    """Speeds (joints,) [rad/s | m/s] below which a joint counts as at rest in a run: noise and rounding decide their signs.

    0 for joints without positions; infinite for those at rest in the whole run.
    """
    chosen, speeds = log.run(run), np.zeros(len(log.joints))
    if "q" in log.layout and chosen.duration > 0:
        counted, joints = chosen.census.signals["q"], list(log.layout["q"].joints or ())
        speeds[joints] = REST * np.subtract(counted.high, counted.low) / chosen.duration
        for joint in joints:
            if runs_at_rest(log, log.joints[joint], [run]):
                speeds[joint] = np.inf
    return speeds


def without_rest(qd: np.ndarray, resting: np.ndarray, rate: float) -> np.ndarray:
    """Speeds (rows, n) of consecutive rows, 0 in periods of rest, where noise would decide the sign of friction.

    Args:
        resting: (n,) [rad/s | m/s] speeds of `resting_speeds`.   rate: of the rows, in Hz.
    """
    slow = np.abs(qd) < resting
    rests = [periods_of_rest(each, rate) if each.any() else each for each in slow.T]
    return np.where(np.stack(rests, axis=1), 0.0, qd)


def filters_of(
    log: Log, prepared: Mapping[str, Preparation], order: Sequence[int], source: str
) -> dict[str, RunFilters]:
    """Filters of runs by their preparations.

    Args:
        log: a checked log.   prepared: by the run's name.   order: indices of the log's joints in the arm's order.
        source: the signal that torques are taken from.
    """
    joints = list(order)
    found = {}
    for name, each in prepared.items():
        rests, limits = resting_speeds(log, name)[joints], measured_limits(log, name, source)[:, joints]
        found[name] = RunFilters(each, each.of_motion, rests, limits)
    return found


def measured_limits(log: Log, run: str, source: str) -> np.ndarray:
    """Limits (2, joints) that measured torques or currents of a run reach; commands and voltages act as they are cut off."""
    census, found = log.run(run).census, np.array([[-np.inf], [np.inf]]).repeat(len(log.joints), axis=1)
    if source not in log.held and source in ("tau", "tau_link", "current"):
        for k, joint in enumerate(log.layout[source].joints or ()):
            column = longest_finite(census.excerpt.values[source][:, k])
            found[:, joint] = limits_reached(census.signals[source], k, column)
    return found


def beyond_limits(efforts: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(rows, n) True where efforts behind a low-pass are close to limits (2, n), or beyond them."""
    with np.errstate(invalid="ignore"):  # the distance of limits that are infinite
        close = CLOSE * np.where(np.isfinite(limits).all(axis=0), limits[1] - limits[0], np.abs(limits).min(axis=0))
        return (efforts <= limits[0] + close) | (efforts >= limits[1] - close)


def _cutoff(log: Log, run: LogRun, rate: float) -> tuple[float, str]:
    """The cut-off in Hz that the joint with the fastest motion needs, and the reason for it."""
    name = next((name for name in ("q", "qd") if name in log.layout), log.layout.names[0])
    signal, raw, rows = log.layout[name], run.census.excerpt.values[name], run.census.longest
    best = LOWEST * rate
    reason = f"cut-off {best:.4g} Hz: no motion stands above the noise; the lowest that the rate allows"
    for k, joint in enumerate(signal.joints or ()):
        if rows is None or len(rows.t) < SHORTEST or rows.values[name][:, k].std() == 0:
            continue
        step = quantisation_step(longest_finite(raw[:, k]))
        valley, is_valley = motion_band(rows.values[name][:, k], rate, 2 if name == "q" else 1, step)
        if valley > best:
            noise = f"noise (quantised in steps of {step:.3g} {signal.units[k]})" if step else "noise"
            why = (
                f"there the acceleration's spectrum has its valley: below it is motion, above it {noise}"
                if is_valley
                else f"above it the signal is less than {ABOVE:g} times its {noise}"
            )
            best, reason = valley, f"cut-off {valley:.4g} Hz, for {signal.name} of {log.joints[joint]!r}: {why}"
    return best, reason


def _fine(rate: float, cutoff: float) -> int:
    """Every how many rows to keep of the motion that a model is evaluated on."""
    return max(round(rate / (FINEST * cutoff)), 1)


def _wider(cutoff: float, rate: float) -> float:
    """Cut-off of a motion's low-pass: WIDER times the preparation's, but for one that the rate has no room for."""
    return max(cutoff, min(WIDER * cutoff, CLOSEST * rate))


def _gain_of_difference(differentiation: str, angle: float) -> float:
    """Gain of a central difference by that of the derivative, at an angle of so much from row to row."""
    weights = np.array(FIRST_DIFFERENCE[differentiation])
    return float(2 * np.sum(weights * np.sin(np.arange(1, len(weights) + 1) * angle)) / angle)


def _ordinal(number: int) -> str:
    return {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0, "th")


def _gain(sections: np.ndarray, frequency: float, rate: float) -> float:
    """Gain of the filter run forward and backward."""
    return float(np.abs(np.asarray(sp.sosfreqz(sections, [frequency], fs=rate)[1])[0]) ** 2)


def low_pass(order: int, cutoff: float, rate: float) -> np.ndarray:
    """A Butterworth filter as second-order sections (k, 6); frequencies in Hz."""
    return _butterworth(order, cutoff, rate).copy()


@lru_cache(maxsize=256)
def _butterworth(order: int, cutoff: float, rate: float) -> np.ndarray:
    return np.asarray(sp.butter(order, cutoff, fs=rate, output="sos"))


def settling(sections: np.ndarray, left: float) -> int:
    """Number of rows after which a share `left` of a disturbance remains: ln(left) / ln(largest pole's magnitude)."""
    poles = np.concatenate([np.roots(section[3:]) for section in sections])
    return ceil(log(left) / log(max(float(np.abs(poles).max()), 1e-3)))
