"""Search for gains over compiled simulations, by CMA-ES [Hansen2016] or differential evolution [StornPrice1997]."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.progress import Progress
from armwright.tuning.margins import MarginTest
from armwright.tuning.objective import Objective
from armwright.tuning.space import rounded

SPREAD = 0.15  # standard deviation of the first generation, as a share of the bounds' logarithm
REFUSED = 1e9  # score of gains without the margins, and beyond: worse than any run that ends
FAILED = 1e6  # of a run that diverges
LOWER, LOWERINGS = 0.8, 4  # factor of all gains that lack the margins, and how often
PENALTY = 1e-3  # for each time


@dataclass(frozen=True, eq=False)
class Tried:
    """Gains tried: simulated, within the margins at the watched poses, all runs complete; on the front at all poses.

    Attributes:
        names: of the objectives.   values: (k, objectives) on the tuned lanes, relative to the start's.
        gains: (k, gains * n).   first: (objectives,) of the start.
    """

    names: tuple[str, ...]
    values: np.ndarray
    gains: np.ndarray
    first: np.ndarray

    def front(self, names: tuple[str, str] | None = None) -> np.ndarray:
        """Indices of the Pareto-optimal gains of two objectives, sorted by the first; by default the first two objectives.

        Raises:
            ScenarioError: names that are no objectives, or a single objective.
        """
        chosen = self.names[:2] if names is None else tuple(names)
        if len(chosen) != 2 or not set(chosen) <= set(self.names):
            raise ScenarioError(place="names", value=chosen, expected="two objectives", choices=self.names)
        first, second = (self.values[:, self.names.index(name)] for name in chosen)
        order, best, found = np.lexsort((second, first)), np.inf, []
        for k in order:
            if second[k] < best:
                found.append(int(k))
                best = second[k]
        return np.array(found, dtype=int)


class GainSearch:
    """Best gains so far, which keep the margins at all poses, their score, and the best score of each generation."""

    def __init__(self, objective: Objective, margins: MarginTest, scales: Any, lanes: np.ndarray, first: float) -> None:
        self.objective, self.margins, self.scales, self.lanes = objective, margins, scales, lanes
        self.start_keeps = np.isfinite(first)
        self.best: np.ndarray | None = objective.space.start if self.start_keeps else None
        self.score, self.history = first, [first]
        self.simulated = len(lanes)
        self.begun: np.ndarray | None = objective.space.start
        self.tried: list[tuple[np.ndarray, np.ndarray]] = []

    def begin_at(self, gains: np.ndarray) -> None:
        """Begins at gains (gains * n,) that keep the margins at all poses, where the start does not."""
        values = self.objective.values(gains[None], self.lanes)
        score = float(self.objective.score(values, self.scales)[0])
        self.begun, self.simulated = gains, self.simulated + len(self.lanes)
        if np.isfinite(score):
            self.best, self.score = gains, score
            means = self.objective.means(values, self.scales)
            self.tried.append((gains, np.array([float(each[0]) for each in means.values()])))

    def run(self, method: str, generations: int, candidates: int | None, seed: int, progress: Progress) -> None:
        """Runs all generations."""
        space = self.objective.space
        count = candidates or max(8, 4 + int(3 * np.log(space.free.sum())))
        numbers = np.random.default_rng(seed)  # NumPy's global numbers stay as they are
        search = _evolve if method == "cma" else _differential_evolution

        def score(points: np.ndarray) -> np.ndarray:
            scores = self._scores(space.gains(points))
            self.history.append(self.score)
            progress(len(self.history) - 1, generations)
            return scores

        begun = space.start if self.begun is None else self.begun
        search(score, np.clip(space.point(begun), 0.0, 1.0), count, generations, numbers)

    def _scores(self, gains: np.ndarray) -> np.ndarray:
        """(candidates,) scores of a generation; the best is kept if its margins hold everywhere.

        Gains without the margins are lowered together until they have them, and scored as these with a small penalty: a start
        lies at the border of its margins, and beyond a border nothing says where to go.
        """
        gains, failing, lowered = self._lowered(gains)
        scores, kept = REFUSED * (1.0 + failing), np.flatnonzero(failing == 0.0)
        if not kept.size:  # equal scores would end the search
            scores += REFUSED * self.margins.excess(gains)
        if kept.size:
            values = self.objective.values(gains[kept], self.lanes)
            found = self.objective.score(values, self.scales)
            penalty = PENALTY * lowered[kept]
            scores[kept] = np.where(np.isfinite(found), np.minimum(found + penalty, FAILED), FAILED)
            means = np.array(list(self.objective.means(values, self.scales).values()))
            self.tried += [
                (row, mean) for row, mean, each in zip(gains[kept], means.T, found, strict=True) if np.isfinite(each)
            ]
            self.simulated += kept.size * len(self.lanes)
        for k in np.argsort(scores, kind="stable"):
            score = float(scores[k] - PENALTY * lowered[k])
            if scores[k] >= FAILED or score >= self.score:
                break
            if self.margins.keeps(gains[k]):
                self.best, self.score = gains[k], score
                break
            scores[k] = REFUSED
        return scores

    def _lowered(self, gains: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gains, lowered together where that gives them the margins; the share of poses where they fail; how often lowered."""
        space, gains = self.objective.space, gains.copy()
        failing, lowered = self.margins.failing(gains), np.zeros(len(gains))
        for _ in range(LOWERINGS):
            places = np.flatnonzero(failing > 0.0)
            if not places.size:
                break
            gains[places] = np.clip(rounded(LOWER * gains[places]), space.low, space.high)
            lowered[places] += 1.0
            failing[places] = self.margins.failing(gains[places])
        return gains, failing, lowered


def _evolve(
    score: Callable[[np.ndarray], np.ndarray], x: np.ndarray, count: int, generations: int, numbers: np.random.Generator
) -> None:
    """CMA-ES from x (k,) within [0, 1]^k."""
    cma = _cma()
    options = {
        "bounds": [0.0, 1.0], "popsize": count, "verbose": -9, "verb_log": 0, "maxiter": generations,
        "seed": np.nan, "randn": lambda *shape: numbers.standard_normal(shape),
    }  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about a single gain, and of options
        strategy = cma.CMAEvolutionStrategy(x, SPREAD, options)
        for _ in range(generations):
            if strategy.stop():
                break
            points = strategy.ask()
            strategy.tell(points, score(np.array(points)).tolist())


def _differential_evolution(
    score: Callable[[np.ndarray], np.ndarray], x: np.ndarray, count: int, generations: int, numbers: np.random.Generator
) -> None:
    """SciPy's differential evolution within [0, 1]^k, whose first generation lies about x (k,) as that of CMA-ES does."""
    from scipy.optimize import differential_evolution

    first = np.clip(x + SPREAD * numbers.standard_normal((max(count, 5), len(x))), 0.0, 1.0)
    first[0] = x
    options: Any = {
        "init": first, "maxiter": generations - 1, "tol": 0.0, "atol": 0.0, "polish": False, "updating": "deferred",
        "vectorized": True, "rng": numbers,
    }  # fmt: skip
    differential_evolution(lambda points: score(points.T), [(0.0, 1.0)] * len(x), **options)


def _cma() -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about plots it cannot make
            import cma  # type: ignore[import-untyped]
    except ImportError:
        expected = "pip install armwright[control], or method = 'differential-evolution'"
        raise ScenarioError("needs cma, which is not installed", place="tune", expected=expected) from None
    return cma
