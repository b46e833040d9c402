"""Expected result of an experiment, before it is run: standard deviations, and separable directions.

With Jacobian J of what is measured by the parameters, and noise of standard deviation σ, the Fisher information is
I = Σ JᵀJ / σ², and no unbiased estimate has a covariance below I⁻¹ (Cramér and Rao). [Ljung1999]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.entry import as_arm
from armwright.errors import IdentificationError, check_known
from armwright.fitting.directions import Direction, directions_of, listed
from armwright.identification.experiments.columns import DRIVES, BaseRegressor
from armwright.identification.experiments.information import column_norms, scaled
from armwright.model import Model
from armwright.parameters import lane_counts
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.simulation.scenario import Scenario
from armwright.simulation.sensitivity import sensitivities

ROUNDING = 1e-12  # of the longest column: shorter ones are 0
NOTHING = 1e-12  # of the largest eigenvalue of the scaled information: below, a direction is not seen at all
WEAK = 30.0  # times the best direction's deviation: a direction that is told this much worse is called weak
SHARE = 0.25  # of a direction's largest component: parameters with less are not named
BETTER = 2.0  # times smaller a deviation must be to be worth a sentence
RANGE, PERIODS, STATES = 0.6, 3.0, 200  # of a probing motion: part of the joint's range, its periods, instants


@dataclass(frozen=True, eq=False)
class Expected:
    """Expected precision of an experiment for some parameters.

    Attributes:
        names: (p,) of the parameters.   values: (p,) of the record; NaN where it says nothing.   units: (p,).
        information: (p, p) Fisher information, in 1 / units².
    """

    names: tuple[str, ...]
    values: np.ndarray
    units: tuple[str, ...]
    information: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """(p,) expected standard deviations; infinite for a parameter that the experiment alone does not identify."""
        return deviations(self.information)

    @property
    def condition(self) -> float:
        """Condition number of the Jacobian with columns of length 1; infinite if a direction is not observed."""
        values = np.linalg.eigvalsh(scaled(self.information, "columns"))
        return float(np.sqrt(values[-1] / values[0])) if values[0] > NOTHING * values[-1] else np.inf

    def weak(self) -> list[np.ndarray]:
        """Directions (p,) in parameters with `WEAK` times the best direction's deviation or unidentifiable, the worst first.

        In units of each parameter's deviation if all others were known.
        """
        return [each.vector for each in weak_directions(self.information)]


@dataclass(frozen=True, eq=False)
class ExperimentComparison(Result):
    """Several experiments side by side; `str` gives a table.

    Attributes:
        experiments: by name.   remarks: sentences: what only some of them separate.
    """

    experiments: Mapping[str, Expected]
    remarks: tuple[str, ...] = ()

    @property
    def best(self) -> str:
        """Name of the experiment with the smallest mean log deviation, if possible of those that identify everything."""

        def rank(name: str) -> tuple[int, float]:
            std = self.experiments[name].std
            known = std[np.isfinite(std)]
            return int(np.isinf(std).sum()), float(np.log(known).mean()) if len(known) else np.inf

        return min(self.experiments, key=rank)

    def sentences(self) -> list[str]:
        """Remarks on parameters that only some of the experiments separate."""
        return list(self.remarks)

    def tables(self) -> list[Table]:
        """A row for each parameter: the expected deviation by experiment; infinite where it is not identifiable."""
        first, *_ = every = list(self.experiments.values())
        rows = [[name, *(number(each.std[k]) for each in every), first.units[k]] for k, name in enumerate(first.names)]
        rows.append(["condition number", *(number(each.condition) for each in every), ""])
        return [Table("expected deviations", ("parameter", *self.experiments, "unit"), rows, ("unit",))]

    def __str__(self) -> str:
        first = next(iter(self.experiments.values()))
        width = max(
            len("condition number"), *(len(f"{n} [{u}]") for n, u in zip(first.names, first.units, strict=True))
        )
        wide = max(16, *(len(name) + 2 for name in self.experiments))
        heads = "".join(f"{name:>{wide}}" for name in self.experiments)
        lines = [f"{'expected deviation':{width}}{heads}"]
        for k, name in enumerate(first.names):
            cells = "".join(f"{_deviation(each, k):>{wide}}" for each in self.experiments.values())
            lines.append(f"{f'{name} [{first.units[k]}]':{width}}{cells}")
        cells = "".join(f"{_number(each.condition):>{wide}}" for each in self.experiments.values())
        lines.append(f"{'condition number':{width}}{cells}")
        return "\n".join([*lines, *self.remarks])


def _deviation(expected: Expected, k: int) -> str:
    std, value = expected.std[k], expected.values[k]
    if np.isinf(std):
        return "not identifiable"
    part = f" {abs(std / value):.2%}" if np.isfinite(value) and value != 0 and abs(std / value) < 10 else ""
    return f"{std:.2g}{part}"


def _number(value: float) -> str:
    return "infinite" if np.isinf(value) else f"{value:.3g}"


def deviations(information: np.ndarray) -> np.ndarray:
    """(p,) standard deviations from an information (p, p); infinite for a parameter with a part in an unobserved direction."""
    lengths = column_norms(information)
    values, vectors = np.linalg.eigh(scaled(information, "columns"))
    seen = values > NOTHING * max(values[-1], np.finfo(float).tiny)
    variance = (vectors[:, seen] ** 2 / values[seen]).sum(axis=1) / lengths**2
    lost = (vectors[:, ~seen] ** 2).sum(axis=1) > 1e-8
    return np.where(lost, np.inf, np.sqrt(variance))


def weak_directions(information: np.ndarray) -> list[Direction]:
    """Directions of the scaled information with `WEAK` times the best direction's deviation, the worst first.

    Parameters that change nothing that is measured come first, each for itself; then eigenvectors of the others.
    """
    lengths = np.sqrt(np.maximum(np.diag(information), 0.0))
    seen = lengths > ROUNDING * lengths.max(initial=0.0)
    unit = np.eye(len(seen))
    found = [Direction(each, 0.0, np.inf) for each in unit[~seen]]
    weak = directions_of(scaled(information[np.ix_(seen, seen)], "columns")) if seen.any() else []
    return found + [replace(each, vector=each.vector @ unit[seen]) for each in weak if each.condition > WEAK]


def experiments_that_separate(
    names: Sequence[str], information: np.ndarray, candidates: Mapping[str, np.ndarray]
) -> tuple[str, ...]:
    """Sentences: parameters that a log does not distinguish, and the further experiment that would.

    Args:
        names: (p,) of the parameters.   information: (p, p) of the log.
        candidates: by name, the information (p, p) of experiments that were not run, in the same units.
    Returns:
        remarks: one for each weak direction, the worst first; none where there is no weak direction.
    """
    remarks = []
    own = np.sqrt(np.maximum(np.diag(information), 0.0))
    with_all = column_norms(sum(candidates.values(), start=np.array(information)))
    # the scale that the directions are found in
    lengths = np.where(own > ROUNDING * own.max(initial=0.0), own, with_all)
    for direction in weak_directions(information):
        words, change = direction.names(names, SHARE), direction.vector / lengths
        what, several = listed(words), len(words) > 1
        before = max(float(change @ information @ change), 0.0)
        gains = {name: float(change @ each @ change) for name, each in candidates.items()}
        name = max(gains, key=lambda each: gains[each], default="")
        head = f"{what} {'cannot be distinguished with' if several else 'cannot be identified from'} this log"
        if not name or gains[name] <= max((BETTER**2 - 1.0) * before, 0.0):
            remarks.append(f"{head}, and no other experiment that was compared would do much better")
        elif before <= NOTHING * gains[name]:
            remarks.append(f"{head}; {name} would do it")
        else:
            factor = np.sqrt(1.0 + gains[name] / before)
            remarks.append(
                f"{head}; {name} would determine {'their combination' if several else 'it'} {factor:.3g} times as precisely"
            )
    return tuple(remarks)


def joints_that_separate(regressor: BaseRegressor, information: np.ndarray, rows: int) -> tuple[str, ...]:
    """Sentences: base parameters that a motion identifies badly, and the joint whose motion would identify them.

    For every joint a probing motion is compared, over part of its range, the others standing in three poses.

    Args:
        regressor: of the arm.   information: (p, p) Σ YᵀY of the present motion.   rows: instants that it is the sum of.
    Returns:
        remarks: one for each weak direction, the worst first; none where there is none.
    """
    arm = regressor.model.arm
    candidates = {f"a motion of {name}": probe(regressor, k, rows) for k, name in enumerate(arm.names)}
    return experiments_that_separate(regressor.names, information, candidates)


def probe(regressor: BaseRegressor, joint: int, rows: int) -> np.ndarray:
    """Information (p, p) of `rows` instants of one joint moving to and fro, the others fixed in three poses."""
    arm = regressor.model.arm
    bounds = np.array([body.limits.position for body in arm.coordinates], dtype=float)
    bounds = np.where(np.isfinite(bounds), bounds, [-np.pi, np.pi])
    middle, half = bounds.mean(axis=1), 0.5 * (bounds[:, 1] - bounds[:, 0])
    speed = float(arm.coordinates[joint].limits.velocity)
    amplitude = RANGE * half[joint]
    w = speed / amplitude if np.isfinite(speed) else 1.0
    t = np.linspace(0.0, PERIODS * 2.0 * np.pi / w, STATES, endpoint=False)
    total = np.zeros((len(regressor), len(regressor)))
    for part in (-0.4, 0.0, 0.4):
        q, qd, qdd = (np.zeros((STATES, arm.n)) for _ in range(3))
        q[:] = middle + part * half
        q[:, joint] = middle[joint] + amplitude * np.sin(w * t)
        qd[:, joint], qdd[:, joint] = amplitude * w * np.cos(w * t), -amplitude * w * w * np.sin(w * t)
        total += regressor.information(q, qd, qdd)
    return total * (rows / (3 * STATES))


def compare_experiments(
    candidates: Mapping[str, Any],
    *,
    noise: Any,
    by: Sequence[str] = (),
    arm: Model | None = None,
    rate: float = 100.0,
    drives: Sequence[str] = DRIVES,
) -> ExperimentComparison:
    """Expected precision of several experiments, side by side, before any is run.

    A candidate is a `Scenario`: its signals are simulated with their sensitivities. Or, with `arm`, a motion such as `Fourier`
    or the result of `design_excitation`: the torques along it tell the arm's base parameters.

    Args:
        candidates: by name.
        noise: of scenarios, standard deviations of what is measured, by signal: {"qd": 0.01, "current": 0.05}; of motions the
            torques' standard deviation, one or (n,) [N m | N].
        by: of scenarios, names of the record's numbers, as `sensitivities` takes them.   arm: of motions.
        rate: of motions, measurements in a second.   drives: of motions, columns beside the links'.
    Returns:
        comparison: expected deviations, condition numbers, and sentences on what only some of them separate.
    Raises:
        ScenarioError, IdentificationError: what cannot be compared; names it.
    Example:
        >>> wave, still = aw.trajectories.Fourier, np.zeros((2, 1))
        >>> small = wave([-1.5, 0.0], [[0.2], [0.1]], still, cycle=4.0, cycles=1)
        >>> large = wave([-1.5, 0.0], [[0.8], [0.6]], still, cycle=4.0, cycles=1)
        >>> both, arm = {"small": small, "large": large}, aw.load("two-link")
        >>> found = aw.identification.compare_experiments(both, noise=0.1, arm=arm)
        >>> found.sentences()[0]
        'small: Izz2, Izz1* and Ia2 cannot be distinguished with it; large would do it'
    """
    if not isinstance(candidates, Mapping) or not candidates:
        raise IdentificationError(place="candidates", value=candidates, expected="experiments by name")
    if arm is not None:
        arm = as_arm(arm)
        regressor = BaseRegressor.of(arm, drives, np.full(arm.n, 1e-3))
        found = {name: _of_motion(name, each, regressor, noise, rate) for name, each in candidates.items()}
    else:
        found = {name: _of_scenario(name, each, by, noise) for name, each in candidates.items()}
    remarks = []
    for name, each in found.items():
        others = {other: item.information for other, item in found.items() if other != name}
        sentences = experiments_that_separate(each.names, each.information, others) if others else ()
        remarks += [f"{name}: {sentence}".replace("this log", "it") for sentence in sentences[:3]]
    return ExperimentComparison(found, tuple(remarks))


def _of_scenario(name: str, scenario: Any, by: Sequence[str], noise: Any) -> Expected:
    if not isinstance(scenario, Scenario):
        expected = "a Scenario, or a motion beside `arm`"
        raise IdentificationError(place=f"candidates[{name!r}]", value=scenario, expected=expected)
    if not isinstance(noise, Mapping) or not noise:
        raise IdentificationError(place="noise", value=noise, expected="standard deviations by signal")
    if lane_counts(scenario, "scenario"):
        raise IdentificationError("has lanes", place=f"candidates[{name!r}]", expected="one run")
    dataset = sensitivities(scenario, by)
    names = tuple(str(each) for each in dataset["parameter"].values)
    information = np.zeros((len(names), len(names)))
    for signal, std in noise.items():
        known = [str(each).removeprefix("d_") for each in dataset.data_vars if str(each).startswith("d_")]
        check_known(IdentificationError, signal, known, "not simulated", place="noise")
        jacobian = dataset[f"d_{signal}"].values.reshape(-1, len(names)) / _std(f"noise[{signal!r}]", std)
        information += jacobian.T @ jacobian
    rows = {row.name: row for row in scenario.arm.parameters}
    values = np.array([float(rows[each].value) if each in rows else np.nan for each in names])
    units = tuple(rows[each].unit if each in rows else "" for each in names)
    return Expected(names, values, units, information)


def _of_motion(name: str, motion: Any, regressor: BaseRegressor, noise: Any, rate: float) -> Expected:
    motion = getattr(motion, "trajectory", motion)
    duration = getattr(motion, "duration", np.nan)
    if not hasattr(motion, "at") or not np.isfinite(duration):
        expected = "a motion that ends, with `at` and `duration`, such as Fourier(…, periods=1)"
        raise IdentificationError(place=f"candidates[{name!r}]", value=motion, expected=expected)
    if not scalar.real_number(rate) or rate <= 0:
        raise IdentificationError(place="rate", value=rate, expected="a number above 0 [Hz]")
    states = motion.at(np.arange(0.0, duration, 1.0 / rate) + getattr(motion, "time", 0.0))
    std, joints = _std("noise", noise), regressor.model.arm.n
    if std.shape not in ((), (1,), (joints,)):
        raise IdentificationError(place="noise", value=noise, expected=f"one number for all joints, or {joints}")
    std = np.broadcast_to(std, (joints,))
    rows = (regressor.rows(*states) / std[:, None]).reshape(-1, len(regressor))
    prior, matrix = regressor.model.prior, regressor.base.matrix
    values = np.where((matrix != 0) @ np.isnan(prior), np.nan, matrix @ np.nan_to_num(prior))
    return Expected(regressor.names, values, tuple(regressor.base.units), rows.T @ rows)


def _std(place: str, value: Any) -> np.ndarray:
    try:
        numbers = scalar.real_numbers(value)
    except ValueError:
        numbers = np.zeros(1)
    if not (numbers > 0.0).all() or not np.isfinite(numbers).all():
        raise IdentificationError(place=place, value=value, expected="standard deviations above 0")
    return numbers
