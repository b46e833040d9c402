"""Terms that a record does not have, compared by held-out error: an offset of the command, and the winding's inductance.

A log is cut into blocks. Without one of them the least squares moves to first order by

    δ_b = (H - H_b)⁻¹ (g_b - g),   H = JᵀJ,  g = Jᵀr,

and predicts the block with the residuals r_b + J_b δ_b. A term is taken where these fall by more than the standard error of the
difference over the blocks. A term that is left out might still be there: the numbers' covariance then has what it adds to that of
the larger model, and the square of the shift that it would bring.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from armwright.description.robot import RobotDescription
from armwright.errors import DescriptionError
from armwright.identification.motor.affine import is_affine
from armwright.identification.motor.drive_record import paths_of, value_at, with_numbers
from armwright.identification.motor.fitting import Fitted, covariance, settled, without
from armwright.identification.motor.measured import Measured
from armwright.identification.motor.output_error import ROWS_OF_STARTS, DriveProblem, many_starts
from armwright.identification.motor.unknowns import Unknown
from armwright.model.model import build_model
from armwright.progress import Progress
from armwright.simulation.plant.plant import Plant

BLOCKS = 20  # of a log
SHARES = (0.02, 0.1, 0.3, 1.0, 3.0)  # of a sample: time constants of the winding from which its search begins
STEPS = 6  # from each of these
NEGLIGIBLE = 1e-6  # of a sample: a time constant of a winding that is none
LARGEST = 100.0  # samples
MATTERS = 1.5  # factor of a standard deviation by which a term that was left out is worth a word
Problems = Callable[[RobotDescription, Mapping[str, tuple[str, ...]], tuple[str, ...]], DriveProblem]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model and its fit.

    Attributes:
        record: that is simulated.   names: paths of the fitted numbers by label.   of_log: "delay", "offset".   done: the fit.
    """

    record: RobotDescription
    names: Mapping[str, tuple[str, ...]]
    of_log: tuple[str, ...]
    done: Fitted


def chosen(
    model: Candidate, data: Measured, problems: Problems, known: set[str], progress: Progress
) -> tuple[RobotDescription, Fitted]:
    """Record and fit with those terms that predict rows held out better, and wider intervals for what might be there.

    Of one motor that is driven by a voltage and integrated exactly; all others stay as they are.

    Args:
        model: without them.   data: what is fitted.   problems: (record, names, of_log) → problem.   known: names that are fixed.
    """
    if data.command != "voltage" or not is_affine(Plant.of(build_model(model.record))):
        return model.record, model.done
    wider: list[tuple[str, Fitted]] = []
    for term, larger in (("L", _with_inductance), ("offset", _with_offset)):
        if term in known:
            continue
        other = larger(model, data, problems, progress)
        if other is None:
            continue
        added = [k for k, each in enumerate(other.done.problem.unknowns) if each.short == term]
        if not set(added) & set(other.done.held) and _is_better(other.done, model.done):
            model = other
            model.done.remarks.append(_taken(other.done, added))
        else:
            wider.append((term, other.done))
    done = model.done
    for term, left_out in wider:
        done = _widened(done, left_out, term)
    return model.record, done


def _with_offset(model: Candidate, data: Measured, problems: Problems, progress: Progress) -> Candidate:
    before = {_key(each): each for each in model.done.problem.unknowns}
    problem = problems(model.record, model.names, (*model.of_log, "offset"))
    problem = replace(problem, unknowns=tuple(before.get(_key(each), each) for each in problem.unknowns))
    start = _moved_to(problem, model.done)
    return replace(model, of_log=(*model.of_log, "offset"), done=_fitted(problem, start[None], model, data, progress))


def _with_inductance(model: Candidate, data: Measured, problems: Problems, progress: Progress) -> Candidate | None:
    """None where the record has an inductance, or may have none, as with a bridge that opens while it is off."""
    (joint,), old = data.joints, model.done
    label, (path,) = f"{joint}:L", paths_of(model.record, joint, "L")
    if value_at(model.record, path) is not None:
        return None
    size = _resistance(model, joint) * data.period
    try:
        record = with_numbers(model.record, {path: size})
    except DescriptionError:
        return None
    problem = problems(record, {**model.names, label: (path,)}, model.of_log)
    place = next(k for k, each in enumerate(problem.unknowns) if each.label == label)
    own = Unknown(path, size, NEGLIGIBLE * size, LARGEST * size, size, (path,), label=label)
    unknowns = (*problem.unknowns[:place], own, *problem.unknowns[place + 1 :])
    problem = replace(problem, unknowns=unknowns)
    lanes = np.tile(_moved_to(problem, old), (len(SHARES), 1))
    lanes[:, place] = SHARES
    for k, each in enumerate(unknowns):
        if each.name == "delay":  # which stood for the winding
            lanes[:, k] = np.maximum(lanes[:, k] - SHARES, 0.1 * lanes[:, k])
    done = _fitted(problem, lanes, model, data, progress)
    return Candidate(record, {**model.names, label: (path,)}, model.of_log, done)


def _resistance(model: Candidate, joint: str) -> float:
    """Of the fit, or of the record [Ω]."""
    (path,) = paths_of(model.record, joint, "R")
    for each, z in zip(model.done.problem.unknowns, model.done.z, strict=True):
        if path in each.paths:
            return float(np.exp(z)) if each.logarithmic else float(z * each.scale)
    return value_at(model.record, path) or 1.0


def _key(each: Unknown) -> tuple[str, str, str]:
    return each.label, each.name, each.run


def _moved_to(problem: DriveProblem, old: Fitted) -> np.ndarray:
    """(k,) coordinates of a problem at the numbers of an earlier fit, and at first guesses of what that did not have."""
    values = {_key(each): z for each, z in zip(old.problem.unknowns, old.z, strict=True)}
    return np.array([values.get(_key(each), each.to_coordinate(each.guess)) for each in problem.unknowns])


def _fitted(problem: DriveProblem, lanes: np.ndarray, model: Candidate, data: Measured, progress: Progress) -> Fitted:
    """The fit from the best of some starts (lanes, k); what was held stays held."""
    old = model.done
    keys = [_key(each) for each in problem.unknowns]
    number = {k: keys.index(_key(each)) for k, each in enumerate(old.problem.unknowns)}
    held, first = [number[k] for k in old.held], lanes[0].copy()
    for k, each in enumerate(problem.unknowns):
        if k not in number.values():
            first[k] = each.to_coordinate(0.0)
    problem = replace(problem, sigma=old.problem.sigma)
    done = Fitted(
        problem,
        first.copy(),
        held,
        [({number[k]: power for k, power in powers.items()}, number[k0]) for powers, k0 in old.reasons],
        [number[k] for k in old.zero],
        [number[k] for k in old.ends],
        list(old.remarks),
    )
    z = lanes[:, done.kept]
    if len(lanes) > 1:
        z, cost = many_starts(without(problem.part(ROWS_OF_STARTS), held, first), z, STEPS)
        z = z[np.argsort(cost)]
    done.z[done.kept] = z[0]
    return settled(model.record, data, done, first, None, progress)


def _is_better(larger: Fitted, smaller: Fitted) -> bool:
    """True if the larger model predicts blocks that are held out better, by more than the standard error of that."""
    sigma = larger.problem.sigma
    gains = _held_out(smaller, sigma) - _held_out(larger, sigma)
    return bool(gains.sum() > np.sqrt(len(gains)) * gains.std(ddof=1))


def _held_out(done: Fitted, sigma: np.ndarray) -> np.ndarray:
    """(blocks,) sums of squares of the residuals, in these standard deviations of the signals, of every block held out."""
    problem = replace(without(done.problem, done.held, done.z), sigma=sigma, prior=None)
    residuals, (jacobian,) = problem.evaluate(done.z[done.kept][None])
    jacobian = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    ends = np.linspace(0, problem.rows, BLOCKS + 1).astype(int)
    information, slope = jacobian.T @ jacobian, jacobian.T @ residuals[0]
    found = []
    for begin, end in pairwise(ends):
        J, r = jacobian[begin:end], residuals[0, begin:end]
        step = np.linalg.lstsq(information - J.T @ J, J.T @ r - slope, rcond=1e-12)[0]
        found.append(float(((r + J @ step) ** 2).sum()))
    return np.array(found)


def _widened(done: Fitted, other: Fitted, term: str) -> Fitted:
    """The fit with what a term that was left out adds to the covariance of its coordinates, and a sentence where that matters."""
    if any(k in other.held for k, each in enumerate(other.problem.unknowns) if each.short == term):
        return done
    own, theirs = _covariance(done), _covariance(other)
    place = {_key(each): k for k, each in enumerate(other.problem.unknowns)}
    here = [k for k, each in enumerate(done.problem.unknowns) if _key(each) in place]
    to = [place[_key(done.problem.unknowns[k])] for k in here]
    shift, more = np.zeros(len(own)), np.zeros_like(own)
    shift[here] = other.z[to] - done.z[here]
    shift[[*done.held, *(k for k, there in zip(here, to, strict=True) if there in other.held)]] = 0.0
    more[np.ix_(here, here)] = theirs[np.ix_(to, to)] - own[np.ix_(here, here)]
    values, vectors = np.linalg.eigh(0.5 * (more + more.T))
    more = (vectors * np.maximum(values, 0.0)) @ vectors.T + np.outer(shift, shift)
    more = more if done.more is None else done.more + more
    before, after = np.sqrt(np.diag(own)), np.sqrt(np.diag(own + more))
    names = dict.fromkeys(
        each.short
        for k, each in enumerate(done.problem.unknowns)
        if each.label != "start" and after[k] > MATTERS * before[k] > 0.0
    )
    remarks = [*done.remarks]
    if names:
        what = {"L": "an inductance", "offset": "an offset of the command"}[term]
        remarks.append(f"{what} is not found, nor ruled out: the intervals of {', '.join(names)} allow for it")
    return replace(done, more=more, remarks=remarks)


def _covariance(done: Fitted) -> np.ndarray:
    """(k, k) of all coordinates; 0 of what is held."""
    inner = without(done.problem, done.held, done.z)
    residuals, (jacobian,) = inner.evaluate(done.z[done.kept][None])
    whole = np.zeros((len(done.z),) * 2)
    whole[np.ix_(done.kept, done.kept)] = covariance(inner, residuals[0], jacobian)
    return whole


def _taken(done: Fitted, added: list[int]) -> str:
    """Sentence about a term that was taken."""
    names = ", ".join(done.problem.unknowns[k].name for k in added)
    return f"{names} is fitted too: rows held out are predicted better with it"
