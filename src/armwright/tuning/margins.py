"""Margins as a constraint on gains: the coupled sampled loop keeps them at poses where inertias and gravity are extreme."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.regions import longest_period
from armwright.control.analysis.workspace import joint_inertias
from armwright.errors import ScenarioError
from armwright.simulation.scenario import Scenario
from armwright.tuning.space import GainSpace

WATCHED = 6  # poses that all candidates are judged at; each that a best one fails at joins them


class MarginConstraint:
    """Which gains keep the margins at all poses.

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

    def check_start(self) -> None:
        """Refuses start gains that are not stable.

        Raises:
            ScenarioError: names the largest eigenvalue and the pose.
        """
        radius = self._loop.radius(self.poses, gains=self._space.start[None])
        worst = int(radius.argmax())
        if not radius[worst] < 1.0:
            pose = ", ".join(f"{value:.3g}" for value in self.poses[worst])
            what = f"the start gains are unstable: an eigenvalue of {radius[worst]:.4g} a tick at q = [{pose}]"
            raise ScenarioError(what, place="loop.controller", expected="stable gains to start from; armwright loops")

    def failing(self, gains: np.ndarray) -> np.ndarray:
        """(candidates,) share of the watched poses at which gains (candidates, gains * n) fail."""
        kept = np.zeros(len(gains))
        for k in self._watched:
            kept += self._loop.keeps(self._loop.slopes(self.poses[k], gains), *self.asked)
        return 1.0 - kept / len(self._watched)

    def keeps(self, gains: np.ndarray) -> bool:
        """True where gains (gains * n,) keep the margins at all poses; else the first pose where they fail is watched too."""
        kept = self._loop.keeps(self._loop.slopes(self.poses, gains[None]), *self.asked)
        failing = [int(k) for k in np.flatnonzero(~kept) if k not in self._watched]
        self._watched += failing[:1]
        return bool(kept.all())

    def refusal(self) -> ScenarioError:
        """The error where no gains that keep the margins were found, with the sample period at which the start would."""
        gain, phase = self.asked
        period, _ = longest_period(self._one, self.poses, gain_margin=gain, phase_margin=phase)
        what = f"no gains found that keep a gain margin of {gain:g} and a phase margin of {np.degrees(phase):.3g}°"
        advice = "less margin, wider bounds or less delay"
        if period > 0.0:
            advice = f"a sample period of {1e3 * period:.3g} ms or less, at which the start keeps them, or {advice}"
        return ScenarioError(what, place="gains", expected=advice)
