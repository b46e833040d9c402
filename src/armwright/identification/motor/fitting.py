"""The fit: starts, least squares, and unidentifiable parameters, which are fixed one after the other at the record's value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armwright.description.robot import RobotDescription
from armwright.errors import Interrupted, ModelError
from armwright.fitting.covariance import covariance_of
from armwright.fitting.directions import directions, without as less
from armwright.identification.motor.drive_record import HOLD_FIRST
from armwright.identification.motor.measured import Measured
from armwright.identification.motor.output_error import (
    FEWEST_STARTS,
    ROWS_OF_STARTS,
    DriveProblem,
    many_starts,
    refined,
    starts,
)
from armwright.identification.motor.problem import MotorSearch, sizes
from armwright.identification.motor.unknowns import values_of
from armwright.progress import Progress

BESIDE = (-2.0, -1.0, 1.0, 2.0)  # samples between a guessed delay and those that are tried too
ROUNDS = 3  # of fit and new standard deviations of the signals
SAME = 0.02  # of a standard deviation: a smaller change is none
AT_BOUND = 1e-3  # of the range of a logarithm: nearer to its end is at the bound
NONE = 1e-6  # of a size, or of a delay's range: less is 0
WEAK = 0.5  # standard deviation of the logarithm of a product of numbers beyond which the log does not tell it
NOTHING = 1e-6  # standard deviations of all residuals together that a nuisance of its size makes: less is none
PART = 0.25  # of the largest entry of a direction: numbers with more take part in it


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit of drives.

    Attributes:
        problem: with the standard deviations of the signals that it found.   z: (k,) coordinates.
        held: numbers of the unknowns that were held.   reasons: exponents of a product that the log does not tell,
        by the numbers of its factors, and which of these was held for that.   zero: numbers of those that are 0.
        ends: of those that ran into a bound of their search.   remarks: sentences about these.
        more: (k, k) covariance of the coordinates by terms that were left out, but that the log does not rule out.
    """

    problem: DriveProblem
    z: np.ndarray
    held: list[int]
    reasons: list[tuple[dict[int, float], int]] = field(default_factory=list)
    zero: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    more: np.ndarray | None = None

    @property
    def kept(self) -> list[int]:
        """Numbers of the unknowns that were fitted."""
        return [k for k in range(len(self.z)) if k not in self.held]


def fitted(
    record: RobotDescription,
    data: Measured,
    problem: DriveProblem,
    search: MotorSearch,
    free: Sequence[str] | None,
    progress: Progress,
) -> Fitted:
    """Least squares from the best of several starts, with unidentifiable parameters fixed; no worse than the record itself.

    What the log does not determine at the first guess is fixed there before the search, as it would lead the search astray. A
    poor guess may say so of a number that the log does determine, as of dry friction where the guess hardly sticks: such a number
    is freed at the end, and all are searched for again.

    Raises:
        ModelError: nothing could be simulated from any start.
    """
    first = np.array([each.to_coordinate(each.guess) for each in problem.unknowns])
    done = Fitted(problem, first.copy(), [])
    jacobian = problem.jacobian(first)
    if np.isfinite(jacobian).all():
        _hold(done, jacobian * sizes(record, data, problem, first), first)
    begin = starts(problem, first, max(search.starts, FEWEST_STARTS), search.seed)
    wanted = [k for k, each in enumerate(problem.unknowns) if not each.nuisance] or range(len(problem.unknowns))
    if all(k in done.held for k in wanted):
        names = [problem.unknowns[k].short for k in done.held]
        expected = "another log, or more that is known, by fixed=…"
        raise ModelError(
            "the log determines none of the numbers to be fitted", place="free", value=names, expected=expected
        )
    own = _of_record(problem, first)
    begin, early = np.concatenate([begin, own, _of_delays(problem, first)]), list(done.held)
    while True:
        held, reasons = list(done.held), list(done.reasons)
        z, cost = many_starts(without(problem.part(ROWS_OF_STARTS), held, first), begin[:, done.kept])
        if not np.isfinite(cost).any():
            expected = "another first guess, by fixed=… or a robot's record"
            what = "nothing could be simulated from any start"
            raise ModelError(what, place="starts", value=search.starts, expected=expected)
        done.z[done.kept] = z[int(np.argmin(cost))]
        done.z[:] = min([done.z.copy(), *own], key=lambda each: _cost(problem, each))  # on all rows
        done = settled(record, data, done, first, free, progress)
        determined = _determined(record, data, done, early)
        if not determined:
            return done
        early = [k for k in held if k not in determined]
        begin = np.concatenate([begin, done.z[None]])
        done = Fitted(problem, first.copy(), list(early), [each for each in reasons if each[1] not in determined])


def _determined(record: RobotDescription, data: Measured, done: Fitted, held: Sequence[int]) -> list[int]:
    """Those of the held numbers that the log determines at the end of a fit beside all that were fitted."""
    jacobian, determined, unknowns = done.problem.jacobian(done.z), [], done.problem.unknowns
    if not np.isfinite(jacobian).all():
        return []
    scaled = jacobian * sizes(record, data, done.problem, done.z)
    for k in held:
        kept = sorted([*done.kept, *determined, k])
        if not undetermined(scaled[:, kept], [i for i, each in enumerate(kept) if not unknowns[each].nuisance]):
            determined.append(k)
    return determined


def _of_record(problem: DriveProblem, first: np.ndarray) -> np.ndarray:
    """(1, k) coordinates with the record's numbers, and the delay and initial states that fit them best; (0, k) without any.

    Of a motor in a closed loop the voltage answers its motion, and a late command with other numbers explains the log nearly as
    well: a search that moves all at once ends there, with the truth as its record.
    """
    numbers = [k for k, each in enumerate(problem.unknowns) if not each.nuisance]
    others = [k for k, each in enumerate(problem.unknowns) if each.nuisance]
    if not numbers or not others:
        return np.zeros((0, len(first)))
    prompt = np.where([each.name == "delay" for each in problem.unknowns], problem.bounds[0], first)
    z, cost = many_starts(without(problem.part(ROWS_OF_STARTS), numbers, first), np.stack([first, prompt])[:, others])
    found = first.copy()
    found[others] = z[int(np.argmin(cost))]
    return found[None]


def _of_delays(problem: DriveProblem, first: np.ndarray) -> np.ndarray:
    """(lanes, k) the first coordinates with delays of the samples beside the guessed one.

    With a command that is held each sample of delay may have a minimum of its own, in which a search from one delay ends.
    """
    delays = [k for k, each in enumerate(problem.unknowns) if each.name == "delay"]
    lanes = np.tile(first, (len(BESIDE) if delays else 0, 1))
    lanes[:, delays] += np.array(BESIDE)[: len(lanes), None]
    return np.clip(lanes, *problem.bounds)


def _cost(problem: DriveProblem, z: np.ndarray) -> float:
    """Sum of squared residuals at coordinates (k,); infinite where they diverge."""
    squares = float((problem.evaluate(z[None])[0] ** 2).sum())
    return squares if np.isfinite(squares) else np.inf


def settled(
    record: RobotDescription,
    data: Measured,
    done: Fitted,
    first: np.ndarray,
    free: Sequence[str] | None,
    progress: Progress,
) -> Fitted:
    """Least squares from one start, in turn with the signals' standard deviations and with what the log does not determine.

    Args:
        done: where it begins.   first: (k,) coordinates at which numbers are held.
    Raises:
        Interrupted: Ctrl-C; `found` holds the fitted numbers at the beginning of the round.
    """
    for number in range(ROUNDS):
        progress(number, ROUNDS)
        try:
            done.z[done.kept] = refined(without(done.problem, done.held, done.z), done.z[done.kept])
        except KeyboardInterrupt:
            raise Interrupted(f"in round {number + 1} of {ROUNDS}", found=_numbers(done)) from None
        _note_ends(done)
        residuals, (jacobian,) = done.problem.evaluate(done.z[None])
        scaled = _scaled(done.problem, residuals[0])
        done = replace(done, problem=replace(done.problem, sigma=done.problem.sigma * scaled))
        jacobian[: done.problem.rows] /= np.tile(scaled, done.problem.rows // len(scaled))[:, None]
        before = len(done.held)
        _hold(done, jacobian * sizes(record, data, done.problem, done.z), first)
        _hold_at_zero(done, free)
        if len(done.held) == before and (len(scaled) == 1 or bool(np.all(np.abs(scaled - 1.0) < SAME))):
            break
    return done


def _numbers(done: Fitted) -> dict[str, float]:
    """Values of the numbers that an unfinished fit is about, by their names."""
    values, _ = values_of(done.problem.unknowns, done.z)
    named = [(each.name, float(value)) for each, value in zip(done.problem.unknowns, values, strict=True)]
    return dict(named[k] for k in done.kept if not done.problem.unknowns[k].nuisance)


def _hold(done: Fitted, jacobian: np.ndarray, first: np.ndarray) -> None:
    """Fixes as many unknowns as the log does not determine, in the order of `HOLD_FIRST`, at their first values.

    Args:
        jacobian: (m, k) by coordinates in the unknowns' sizes.   first: (k,) first coordinates.
    """
    while True:
        kept, unknowns = done.kept, done.problem.unknowns
        candidates = [i for i, k in enumerate(kept) if not unknowns[k].nuisance]
        exponents = {kept[i]: power for i, power in undetermined(jacobian[:, kept], candidates).items()}
        if not exponents:
            return
        ranks = {name: rank for rank, name in enumerate(HOLD_FIRST)}
        chosen = min(exponents, key=lambda k: ranks.get(unknowns[k].short, len(ranks)))
        done.reasons.append((exponents, chosen))
        done.held.append(chosen)
        done.z[chosen] = first[chosen]


def undetermined(jacobian: np.ndarray, candidates: Sequence[int]) -> dict[int, float]:
    """Exponents of the product of candidates that a log determines worst, by their numbers; none if it is determined well.

    Args:
        jacobian: (m, k) of residuals in standard deviations, by coordinates in their sizes.   candidates: numbers of unknowns;
            the others are nuisances, which are free.
    """
    others = [k for k in range(jacobian.shape[1]) if k not in candidates]
    own = less(jacobian[:, list(candidates)], jacobian[:, others], NOTHING)  # rounding made longer looks like any other
    if not candidates or (worst := directions(own)[0]).shown > 1.0 / WEAK:
        return {}
    members = worst.members(PART)
    return {candidates[j]: float(worst.vector[j] / worst.vector[members[0]]) for j in sorted(members)}


def _note_ends(done: Fitted) -> None:
    """Notes numbers above 0 that ran into a bound of their search, before they are held for telling nothing there."""
    low, high = done.problem.bounds
    for k in done.kept:
        each = done.problem.unknowns[k]
        is_end = min(done.z[k] - low[k], high[k] - done.z[k]) < AT_BOUND * (high[k] - low[k])
        if is_end and each.logarithmic and not each.nuisance and k not in done.ends:
            done.ends.append(k)


def _hold_at_zero(done: Fitted, free: Sequence[str] | None) -> None:
    """Drops delays and unrequested friction terms that the fit drives to 0, their bound."""
    low, high = done.problem.bounds
    for k in done.kept:
        each = done.problem.unknowns[k]
        none = NONE * (high[k] - low[k]) if each.name == "delay" else NONE  # of a delay all that counts as at its bound
        is_friction = not each.nuisance and not each.logarithmic and each.low == 0.0 and each.short not in (free or ())
        if done.z[k] > none or not (is_friction or each.name == "delay"):
            continue
        done.z[k] = 0.0
        done.held.append(k)
        done.zero.append(k)
        done.remarks.append(
            "no delay is found" if each.name == "delay" else f"{each.name} comes out as 0, and is left there"
        )


def _scaled(problem: DriveProblem, residuals: np.ndarray) -> np.ndarray:
    """RMS of the scaled residuals (signals · n,): by how much the signals' standard deviations change.

    One for all runs: a run's own would let the worst described run count the less, and the better ones the more, without end.
    """
    columns = problem.targets[0].shape[1]
    squares = (residuals[: problem.rows] ** 2).reshape(-1, columns).sum(axis=0)
    counts = sum((stretch.weights**2).sum(axis=0) for stretch in problem.stretches)
    return np.where(squares > 0, np.sqrt(np.maximum(squares, 1e-12) / np.maximum(counts, 1.0)), 1.0)


def without(problem: DriveProblem, held: Sequence[int], z: np.ndarray) -> DriveProblem:
    """The problem with some unknowns fixed at coordinates z."""
    if not held:
        return problem
    values, _ = values_of(problem.unknowns, z)
    kept = [k for k in range(len(problem.unknowns)) if k not in held]
    number = {k: i for i, k in enumerate(kept)}
    nominal = problem.nominal.copy()
    places = []
    for at in problem.places:
        for column, k in enumerate(at.parameters):
            if k in held:
                nominal[column] = values[k]
        renumbered = {
            name: np.array([number.get(int(k), -1) for k in getattr(at, name)], dtype=int)
            for name in ("parameters", "offsets", "start")
        }
        places.append(replace(at, **renumbered, delay=number.get(at.delay, -1)))
    prior = None if problem.prior is None else problem.prior[:, kept]
    unknowns = tuple(problem.unknowns[k] for k in kept)
    return replace(problem, unknowns=unknowns, places=tuple(places), nominal=nominal, prior=prior)


def covariance(problem: DriveProblem, residuals: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """(k, k) of coordinates, for residuals that are correlated in time, each signal by itself, and a prior.

    Args:
        residuals: (m,).   jacobian: (m, k), as `Problem.evaluate` gives them.
    """
    blocks, begin, k = [], 0, jacobian.shape[1]
    for stretch in problem.stretches:
        shape = stretch.weights.shape
        rows = slice(begin, begin + stretch.weights.size)
        errors = np.where(stretch.weights > 0.0, residuals[rows].reshape(shape), np.nan)
        blocks.append((jacobian[rows].reshape(*shape, k), errors))
        begin = rows.stop
    return covariance_of(blocks, None if problem.prior is None else np.diag(problem.prior[1] ** -2.0))
