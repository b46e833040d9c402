"""Result of a tuning: gains, their scores on held-out lanes, and the scenario file with them."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.control.analysis.regions import margins_text
from armwright.control.gains import gain_units
from armwright.errors import ScenarioError
from armwright.output import check_destination
from armwright.results.page_parts import plotted
from armwright.results.result import Result
from armwright.results.svg import INK, page_svg
from armwright.results.table import Table, number
from armwright.scenarios.file import read_scenario
from armwright.scenarios.writer import write_scenario
from armwright.simulation.scenario import Scenario
from armwright.tuning.objective import measure_units
from armwright.tuning.pictures import draw_front, draw_history
from armwright.tuning.search import Tried

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORSE = 1.05  # times the start: what a sentence names
RELATIVE = "1 is the start's mean over the lanes tuned in, saturation and overshoot are shares of their own"


@dataclass(frozen=True, eq=False)
class TuningResult(Result):
    """Gains found by a search, with scores.

    Attributes:
        scenario: with the gains.   gains, start: (n,) by name, the returned ones and the scenario's own.
        improved: whether the tuned gains beat the start on held-out lanes; else `gains` are the start's, unless those do not
            keep the margins.
        start_keeps: whether the start keeps the margins.   score: of the start and of `gains` on held-out lanes; less is better.
        held_out: (2, n) by reducer, its mean over the held-out lanes at the start and with `gains`; inf where runs fail.
        history: (generations + 1,) best score on the tuned lanes.   lanes: tuned in, and held out.   simulations: how many runs.
        asked: gain and phase margin [rad] that are kept.   poses: at how many.
        objectives: (start, tuned) by objective on held-out lanes, the mean over joints relative to the start on the tuned ones.
        tried: all gains that were simulated and end their runs.   begun: what the start was.   drawn: the uncertainty, in words.
        searched: names of the gains that were searched for; others were designed.
    """

    scenario: Scenario
    gains: dict[str, np.ndarray]
    start: dict[str, np.ndarray]
    improved: bool
    start_keeps: bool
    score: tuple[float, float]
    held_out: dict[str, np.ndarray]
    history: np.ndarray
    lanes: tuple[int, int]
    simulations: int
    asked: tuple[float, float]
    poses: int
    objectives: dict[str, tuple[float, float]]
    tried: Tried
    begun: str
    drawn: tuple[str, ...]
    searched: tuple[str, ...]

    def __repr__(self) -> str:
        return f"TuningResult({self.sentences()[0]!r})"

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.scenario.arm.name}: tuned gains"

    def tables(self) -> list[Table]:
        """Gains by joint; measures by joint, and objectives, at the start and with the gains on the held-out lanes."""
        arm, law, held = self.scenario.arm, self.scenario.controller, f"{self.lanes[1]} held-out lanes"
        gains = []
        for name, values in self.gains.items():
            joints = zip(arm.names, gain_units(arm, law, name), self.start[name], values, strict=True)
            for joint, unit, old, new in joints:
                factor = number(new / old if old > 0.0 else None, ".3g")
                gains.append([joint, name, unit or "—", number(old, ".4g"), number(new, ".4g"), factor])
        measures = [
            [joint, name, unit, number(old, ".4g"), number(new, ".4g")]
            for name, (before, after) in self.held_out.items()
            for joint, unit, old, new in zip(arm.names, measure_units(arm, name), before, after, strict=True)
        ]
        objectives = []
        for name, (before, after) in self.objectives.items():
            change = number(100.0 * (after / before - 1.0) if before > 0.0 else None, "+.1f")
            objectives.append([name, number(before, ".4g"), number(after, ".4g"), change])
        heads = ("joint", "measure", "unit", "start", "tuned")
        return [
            Table(f"{arm.name}: gains", ("joint", "gain", "unit", "start", "tuned", "factor"), gains, ("gain", "unit")),
            Table(f"{arm.name}: means over {held}", heads, measures, heads[1:3]),
            Table(f"objectives over {held}; {RELATIVE}", ("objective", "start", "tuned", "change [%]"), objectives),
        ]

    @property
    def good(self) -> bool:
        """True if the gains beat the start."""
        return self.improved

    @property
    def changed(self) -> bool:
        """True if the gains differ from the scenario's own, so that writing them makes sense."""
        return self.improved or not self.start_keeps or self.begun != "scenario"

    @property
    def _has_front(self) -> bool:
        return len(self.tried.names) > 1 and len(self.tried.values) > 0

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws the Pareto front of the first two objectives: all gains tried, the front, start and result; of a single
        objective the best score of each generation.
        """
        if self._has_front:
            draw_front(figure, self.tried, self.chosen, ink, quiet)
        else:
            draw_history(figure, self.history, ink)

    def sections(self) -> list[tuple[str, str]]:
        """The search, beside the Pareto front."""
        history = page_svg(lambda figure: draw_history(figure, self.history, INK), (9.2, 3.2), "constrained")
        return [("Search", plotted(history))] if self._has_front else []

    @property
    def chosen(self) -> np.ndarray:
        """(objectives,) of the returned gains on the lanes of the search."""
        row = np.concatenate([self.gains[name] for name in self.searched])
        same = np.flatnonzero((self.tried.gains == row).all(axis=1)) if len(self.tried.gains) else []
        return self.tried.values[same[0]] if len(same) else self.tried.first

    def sentences(self) -> list[str]:
        """The result in sentences."""
        (before, after), (tuned, held) = self.score, self.lanes
        asked = margins_text(*self.asked)
        if self.improved:
            first = f"tuned: the score on {held} held-out lanes goes from {before:.4g} to {after:.4g}"
        elif self.start_keeps:
            first = f"the start is returned: nothing found beats it on {held} held-out lanes (score {before:.4g})"
        else:
            first = f"tuned for the margins: the score on {held} held-out lanes goes from {before:.4g} to {after:.4g}"
        lines = [
            first,
            f"{self.simulations} simulations in {len(self.history) - 1} generations, {tuned} lanes tuned in"
            + (f": {', '.join(self.drawn)}" if self.drawn else ""),
        ]
        if self.begun != "scenario":
            lines.append(f"the start was designed ({self.begun})")
        worse = [name for name, (before, after) in self.objectives.items() if after > before]
        if self.improved and worse:
            lines.append(f"worse than the start: {', '.join(worse)}; improve_each refuses that")
        joints = [
            f"{name} of {joint} ({100.0 * (new / old - 1.0):+.0f} %)"
            for name, (before, after) in self.held_out.items()
            for joint, old, new in zip(self.scenario.arm.names, before, after, strict=True)
            if new > WORSE * old > 0.0
        ]
        if self.improved and joints:
            lines.append(f"worse than the start at single joints, whose shares are averaged: {', '.join(joints)}")
        if not self.start_keeps:
            lines.append(f"the start gains do not keep {asked}")
        lines.append(
            f"the gains keep {asked} at {self.poses} extreme poses of the record's arm; between them nothing is proven"
        )
        return lines

    def save(
        self,
        path: str | os.PathLike[str],
        source: str | os.PathLike[str] | None = None,
        allow: Iterable[str | os.PathLike[str]] = (),
    ) -> Path:
        """Writes the scenario with these gains as a file, as `write_scenario` does; comments of the file it was read from stay.

        Args:
            path: of the new file; where it names files, they lie in its folder or below.
            source: scenario file that gets the controller in place of its own; None: the tuned scenario itself.
            allow: further folders that it may name files in.
        Returns:
            path: of the file.
        Raises:
            ArmwrightError: a file that cannot be written, or a scenario that no file can express.
        """
        path = check_destination(path, (".toml",), read=(source,))
        scenario = self.scenario
        if source is not None:
            read = read_scenario(source, allow=allow)
            if read.loop is None:
                raise ScenarioError("has no loop", place="loop", file=source, expected="the scenario that was tuned")
            scenario = replace(read, loop=replace(read.loop, controller=scenario.controller))
        write_scenario(scenario, path, allow=allow)
        return path
