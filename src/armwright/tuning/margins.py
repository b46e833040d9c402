"""Margin constraint on gains: the coupled sampled loop keeps its margins at the poses of extreme inertia and gravity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armwright.control.analysis.instability import growing_mode
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.regions import longest_delay, longest_period, margins_text
from armwright.control.analysis.remedies import slower_gains
from armwright.control.analysis.workspace import joint_inertias
from armwright.errors import ScenarioError
from armwright.simulation.scenario import Scenario
from armwright.tuning.linear_measures import measure
from armwright.tuning.space import GainSpace, rounded

WATCHED = 6  # poses that all candidates are judged at; each that a best one fails at joins them


class MarginTest:
    """Test of gains against margins at all poses.

    Attributes:
        poses: (k, n) [rad | m].   asked: gain and phase margin [rad].
    """

    def __init__(self, scenario: Scenario, space: GainSpace, poses: int, seed: int, asked: tuple[float, float]):
        """The constraint of a scenario of one lane, with the arm of the record."""
        assert scenario.loop is not None
        self._space, self.asked = space, asked
        self._one = replace(scenario, loop=replace(scenario.loop, controller=space.controller(space.start)))
        batch = replace(scenario, loop=replace(scenario.loop, controller=space.controller(space.start[None])))
        self._loop = LinearLoop(batch)
        inertias = joint_inertias(self._loop.plant.arm, poses, seed)
        self.poses = inertias.q[inertias.extremes()]
        self._watched = list(range(0, len(self.poses), max(1, len(self.poses) // WATCHED)))
        self._measured = tuple(self._watched)

    def check_start(self) -> None:
        """Refuses start gains that are not stable.

        Raises:
            ScenarioError: names the largest eigenvalue and the pose.
        """
        radius = self._loop.radius(self.poses, gains=self._space.start[None])
        worst = int(radius.argmax())
        if not radius[worst] < 1.0:
            pose = ", ".join(f"{value:.3g}" for value in self.poses[worst])
            mode = growing_mode(self._loop, self.poses[worst : worst + 1], self._space.start[None])
            why = "" if mode is None else f"; {mode}"
            what = f"the start gains are unstable: an eigenvalue of {radius[worst]:.4g} a tick at q = [{pose}]{why}"
            raise ScenarioError(
                what,
                place="loop.controller",
                expected="stable gains to start from: `armwright loops FILE` shows margins, --start analytic designs some",
            )

    def failing(self, gains: np.ndarray) -> np.ndarray:
        """(candidates,) share of the watched poses at which gains (candidates, gains * n) violate the margins."""
        kept = np.zeros(len(gains))
        for k in self._watched:
            kept += self._loop.keeps(self._loop.slopes(self.poses[k], gains), *self.asked)
        return 1.0 - kept / len(self._watched)

    def excess(self, gains: np.ndarray) -> np.ndarray:
        """(candidates,) by how much the largest radius of gains exceeds 1, in the mean over the watched poses."""
        radii = [self._loop.largest_radius(self._loop.slopes(self.poses[k], gains), *self.asked) for k in self._watched]
        return np.maximum(np.array(radii) - 1.0, 0.0).mean(axis=0)

    def measured(self, name: str, gains: np.ndarray) -> np.ndarray:
        """(candidates, n) of a measure of the linear loop, the largest over the initially watched poses."""
        return measure(name, self._loop, self.poses[list(self._measured)], gains)

    def keeps(self, gains: np.ndarray) -> bool:
        """True if gains (gains * n,) keep the margins at all poses; else the first failing pose is added to the watched ones."""
        kept = self._loop.keeps(self._loop.slopes(self.poses, gains[None]), *self.asked)
        failing = [int(k) for k in np.flatnonzero(~kept) if k not in self._watched]
        self._watched += failing[:1]
        return bool(kept.all())

    def slower(self) -> np.ndarray | None:
        """(gains * n,) the start with lower bandwidths, as `armwright loops` recommends it; None if it lacks the margins."""
        space, n = self._space, self._space.n
        _, gains = slower_gains(LinearLoop(self._one), self.poses, self.asked)
        row = space.start.copy()
        for k, name in enumerate(space.names):
            row[k * n : (k + 1) * n] = gains.get(name, row[k * n : (k + 1) * n])
        row = np.clip(rounded(row), space.low, space.high)
        return row if self.keeps(row) else None

    def refusal(self) -> ScenarioError:
        """The error for a search without feasible gains, with the period or delay at which the start gains would be feasible."""
        gain, phase = self.asked
        period, _ = longest_period(self._one, self.poses, gain_margin=gain, phase_margin=phase)
        loop = LinearLoop(self._one)
        what = (
            f"no gains found that keep {margins_text(gain, phase)} at "
            f"{1e3 * loop.period:.4g} ms with {1e3 * loop.delay:.4g} ms of delay"
        )
        advice = ["less margin or wider bounds"]
        if period > 0.0:
            advice.insert(0, f"a sample period of {1e3 * period:.3g} ms or less, at which the start keeps them")
        delay = longest_delay(self._one, self.poses, gain_margin=gain, phase_margin=phase)
        if delay is not None and loop.delay > 0.0:
            advice.insert(0, f"a delay of {1e3 * delay:.3g} ms or less, with which the start keeps them")
        return ScenarioError(what, place="gains", expected=", or ".join(advice))
