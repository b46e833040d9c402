"""Experiments that would identify what a motor's log does not: their information, simulated with the fit. [Ljung1999]

Compared are the same log with the current beside the voltage, a locked rotor with its current, a staircase and a PRBS sized for
the motor that was found, and the same test with a known inertia on the shaft.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armwright.description.paths import path_name
from armwright.description.robot import RobotDescription
from armwright.errors import ScenarioError
from armwright.fitting.directions import without
from armwright.identification.experiments.expected import BETTER, deviations, experiments_that_separate
from armwright.identification.experiments.motor import MotorGuess, motor_experiment
from armwright.identification.motor.drive_record import paths_of, value_at
from armwright.identification.motor.fitting import Fitted
from armwright.identification.motor.guess import Guess
from armwright.identification.motor.measured import Driven, Measured, largest_command
from armwright.identification.motor.output_error import DriveProblem
from armwright.identification.motor.problem import sizes
from armwright.identification.motor.response import DriveInputs
from armwright.identification.motor.unknowns import values_of

CURRENT_NOISE = 0.01  # of the largest current: what a current sensor is taken to have
MOST_ROWS = 4000  # of an experiment that is simulated


def separating(record: RobotDescription, data: Measured, done: Fitted, guess: Guess) -> list[str]:
    """The experiment that would identify each of `done.reasons`, as a clause; "" if none is much better.

    Args:
        record: that was simulated.   data: what was fitted.   done: the fit.   guess: of the motor.
    """
    own = [k for k, each in enumerate(done.problem.unknowns) if not each.nuisance and not each.run]
    if not done.reasons or len(data.joints) > 1 or not own:
        return [""] * len(done.reasons)
    size = sizes(record, data, done.problem, done.z)
    information = _information(done.problem.jacobian(done.z), own, size)
    labels = [each.short for each in done.problem.unknowns]
    candidates = _of_current(record, data, done, own, size, labels) if data.command == "voltage" else {}
    for kind, word in (("staircase", "staircase"), ("prbs", "PRBS")):
        problem = _of_experiment(kind, data, done.problem, guess)
        if problem is not None:
            candidates[f"a {word} of the {data.command}"] = _information(problem.jacobian(done.z), own, size)
    if "J" in labels:
        j, heavier = labels.index("J"), done.z.copy()
        heavier[j] += np.log(2.0)
        slopes = done.problem.jacobian(heavier)
        slopes[:, j] *= 0.5  # half of the inertia is known
        candidates["the same test with a known inertia of about the rotor's added"] = _information(slopes, own, size)
    kept = {name: each for name, each in candidates.items() if np.isfinite(each).all()}
    free = [k for k in own if k not in done.held]
    return [_clause([own.index(k) for k in (chosen, *free)], information, kept) for _, chosen in done.reasons]


def _clause(free: Sequence[int], information: np.ndarray, candidates: Mapping[str, np.ndarray]) -> str:
    """ "a locked-rotor test with current would do it": the best for the first of some numbers, all others known."""
    part = np.ix_(free, free)
    others = {name: each[part] for name, each in candidates.items()}
    sentences = experiments_that_separate([str(k) for k in free], information[part], others)
    if sentences:
        return sentences[0].partition("; ")[2]
    # told too weakly, though not by the measure of `experiments_that_separate`
    before = deviations(information[part])[0]
    after = {name: deviations(information[part] + each)[0] for name, each in others.items()}
    name = min(after, key=lambda each: after[each])
    if before > BETTER * after[name]:
        return f"{name} would determine it {before / after[name]:.3g} times as precisely"
    return ""


def _information(jacobian: np.ndarray, own: Sequence[int], size: np.ndarray) -> np.ndarray:
    """(own, own) Fisher information, by coordinates in their sizes, of what is free beside nuisances."""
    others = [k for k in range(jacobian.shape[1]) if k not in own]
    columns = without(jacobian[:, list(own)] * size[list(own)], jacobian[:, others])
    return columns.T @ columns


def _of_current(
    record: RobotDescription, data: Measured, done: Fitted, own: Sequence[int], size: np.ndarray, labels: Sequence[str]
) -> dict[str, np.ndarray]:
    """Information of a current that is logged too, moving and locked:  i = (u - n Ke w) / R  of the predicted speed."""
    if "R" not in labels:
        return {}
    values, rates = values_of(done.problem.unknowns, done.z)
    joint, problem = data.joints[0], done.problem
    numbers = {path: float(v) for each, v in zip(problem.unknowns, values, strict=True) for path in each.paths}

    def number(name: str) -> float | None:
        path = paths_of(record, joint, name)[0]
        return numbers.get(path, value_at(record, path))

    resistance, torque = number("R") or 1.0, number("Kt") or 1.0
    emf = (number("Ke") or torque) * (value_at(record, f"{path_name(joint)}.motor.gear_ratio") or 1.0)
    by_emf = labels.index("Ke") if "Ke" in labels else labels.index("Kt") if "Kt" in labels else -1
    moving = np.zeros((len(own), len(own)))
    for s, stretch in enumerate(problem.stretches):
        if stretch.run == "static":
            continue
        y, dy = problem.responses(s, done.z[None])
        w, dw = _speeds(problem, stretch, y[0], dy[0])
        current = (stretch.inputs.command[:, 0] - emf * w) / resistance
        slopes = -(emf / resistance) * dw
        slopes[:, labels.index("R")] -= current / resistance * rates[labels.index("R")]
        if by_emf >= 0:
            slopes[:, by_emf] -= emf * w / resistance / values[by_emf] * rates[by_emf]
        scale = CURRENT_NOISE * float(np.abs(current).max())
        moving += _information(slopes / max(scale, 1e-300), own, size)
    u = np.concatenate([s.inputs.command[:, 0] for s in data.stretches])
    locked = np.zeros_like(moving)
    r = list(own).index(labels.index("R"))
    locked[r, r] = float(((u / np.abs(u).max()) ** 2).sum()) / CURRENT_NOISE**2
    found = {"a locked-rotor test with current": locked}
    return found if "current" in data.signals else {"a log of the current beside the voltage": moving, **found}


def _speeds(problem: DriveProblem, stretch: Driven, y: np.ndarray, dy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predicted speed (rows,) and its derivatives (rows, k)."""
    names = problem.response.signals
    for name in ("qd", "qd_mean"):
        if name in names:
            return y[:, names.index(name)], dy[:, names.index(name)]
    period = stretch.inputs.period
    return np.gradient(y[:, 0]) / period, np.gradient(dy[:, 0], axis=0) / period[:, None]


def _of_experiment(kind: str, data: Measured, problem: DriveProblem, guess: Guess) -> DriveProblem | None:
    """The problem of an experiment instead of the log; None where it cannot be sized, or rows are too few for it."""
    most = largest_command(data.stretches)
    try:
        coarse = MotorGuess(guess.gain, max(guess.time, data.period), most, min(guess.band, 0.4 * most))
        found = motor_experiment(kind, coarse, period=data.period)
    except ScenarioError:
        return None
    every = max(round(found.period / data.period), 1)
    u = np.repeat(found.values, every)[:MOST_ROWS, None]
    first, at = next((s, p) for s, p in zip(problem.stretches, problem.places, strict=True) if s.run != "static")
    rows = len(u)
    values = {name: np.zeros((rows, 1)) for name in first.values}
    stretch = replace(
        first, t=np.arange(rows) * data.period, inputs=DriveInputs(np.full(rows, data.period), u), values=values,
        weights=np.ones((rows, first.weights.shape[1])),
    )  # fmt: skip
    return replace(problem, stretches=(stretch,), places=(at,))
