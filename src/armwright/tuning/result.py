"""Result of a tuning: gains, their scores on held-out lanes, and the scenario file with them."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from armwright.control.gains import gain_units
from armwright.errors import ScenarioError
from armwright.output import check_destination, whole_file
from armwright.scenarios.file import read_scenario
from armwright.scenarios.writer import write_scenario
from armwright.simulation.scenario import Scenario
from armwright.tuning.objective import measure_units
from armwright.tuning.search import Tried

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORSE = 1.05  # times the start: what a sentence names
HEADS = ("joint", "gain", "unit", "start", "tuned", "factor")
JUDGED = ("joint", "measure", "unit", "start", "tuned")
PICTURES = (".png", ".svg", ".pdf")


@dataclass(frozen=True, eq=False)
class TuningResult:
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

    def rows(self) -> list[list[str]]:
        """A row for each gain and joint, as `HEADS`."""
        arm, law = self.scenario.arm, self.scenario.controller
        return [
            [joint, name, unit or "—", f"{old:.4g}", f"{new:.4g}", f"{new / old:.3g}" if old > 0.0 else "—"]
            for name, values in self.gains.items()
            for joint, unit, old, new in zip(
                arm.names, gain_units(arm, law, name), self.start[name], values, strict=True
            )
        ]

    def judged(self) -> list[list[str]]:
        """A row for each joint and measure, as `JUDGED`; means over the held-out lanes."""
        arm = self.scenario.arm
        return [
            [joint, name, unit, f"{old:.4g}", f"{new:.4g}"]
            for name, (before, after) in self.held_out.items()
            for joint, unit, old, new in zip(arm.names, measure_units(arm, name), before, after, strict=True)
        ]

    @property
    def changed(self) -> bool:
        """True if the gains differ from the scenario's own, so that writing them makes sense."""
        return self.improved or not self.start_keeps or self.begun != "scenario"

    def objective_rows(self) -> list[list[str]]:
        """A row for each objective: its name, at the start and with the gains on held-out lanes, and the change."""
        return [
            [name, f"{before:.4g}", f"{after:.4g}", f"{100.0 * (after / before - 1.0):+.1f} %" if before > 0.0 else "—"]
            for name, (before, after) in self.objectives.items()
        ]

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure | None:
        """Figure of the Pareto front of the first two objectives: all gains tried, the front, start and result.

        Args:
            path: .png, .svg or .pdf to write; None: the figure is returned.
        Raises:
            ScenarioError: a single objective.   OutputError: it cannot be written.
        """
        from matplotlib.figure import Figure

        from armwright.results.plot import save_figure
        from armwright.tuning.pictures import draw_front

        self.tried.front()  # which refuses a single objective
        figure = Figure(figsize=(7.0, 5.0), dpi=150, layout="constrained", facecolor="white")
        draw_front(figure, self.tried, self.chosen, "#222222", "#777777")
        if path is None:
            return figure
        target = check_destination(path, PICTURES)
        with whole_file(target, PICTURES) as temporary:
            save_figure(figure, temporary, target.suffix[1:].lower())
        return None

    @property
    def chosen(self) -> np.ndarray:
        """(objectives,) of the returned gains on the lanes of the search."""
        row = np.concatenate([self.gains[name] for name in self.searched])
        same = np.flatnonzero((self.tried.gains == row).all(axis=1)) if len(self.tried.gains) else []
        return self.tried.values[same[0]] if len(same) else self.tried.first

    def sentences(self) -> list[str]:
        """The result in sentences."""
        (before, after), (tuned, held) = self.score, self.lanes
        gain, phase = self.asked
        asked = f"a gain margin of {gain:g} and a phase margin of {np.degrees(phase):.3g}°"
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
    ) -> None:
        """Writes the scenario with these gains as a file, as `write_scenario` does; comments of the file it was read from stay.

        Args:
            path: of the new file; where it names files, they lie in its folder or below.
            source: scenario file that gets the controller in place of its own; None: the tuned scenario itself.
            allow: further folders that it may name files in.
        Raises:
            ArmwrightError: a file that cannot be written, or a scenario that no file can express.
        """
        check_destination(path, (".toml",), read=(source,))
        scenario = self.scenario
        if source is not None:
            read = read_scenario(source, allow=allow)
            if read.loop is None:
                raise ScenarioError("has no loop", place="loop", file=source, expected="the scenario that was tuned")
            scenario = replace(read, loop=replace(read.loop, controller=scenario.controller))
        write_scenario(scenario, path, allow=allow)
