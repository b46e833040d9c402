"""Status of lanes at the end of a run: where they stopped, what their steps cost, and the events they met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import DivergenceError
from armwright.kernels.loop import LaneGroup
from armwright.results.notes import notes_of
from armwright.simulation.integrate.cvodes import GAVE_UP, WHY
from armwright.simulation.integrate.stepping import Adaptivity

if TYPE_CHECKING:
    import xarray

BLOCKS = {"frozen": -1.0, "stalled": 0.0, "stalled_by": 0.0, "trials": 0.0, "repeats": 0.0, GAVE_UP: 0.0}


@dataclass(frozen=True, eq=False)
class LaneStatus:
    """Status of the lanes at the end of a run: (lanes, …) each.

    Attributes:
        frozen: tick in which a lane stopped, -1: none.   stalled: 1 where for want of substeps.   stalled_by: entry of the
            state whose error asked for more.
        trials: substeps tried.   repeats: those that were too long.
        gave_up: why CVODES could not go on, its place in `cvodes.WHY` from 1 on; 0: it could.
        first, count: (lanes, E) of events: the first time [s], NaN: none, and how often.
    """

    frozen: np.ndarray
    stalled: np.ndarray
    stalled_by: np.ndarray
    trials: np.ndarray
    repeats: np.ndarray
    gave_up: np.ndarray
    first: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, lanes: int, events: int) -> LaneStatus:
        """Status of lanes to which nothing has happened yet."""
        blocks = {name: np.full(lanes, value) for name, value in BLOCKS.items()}
        return cls(**blocks, first=np.full((lanes, events), np.nan), count=np.zeros((lanes, events), dtype=int))

    def read(self, lanes: LaneGroup) -> None:
        """Takes over the status of a group of lanes from their blocks."""
        group = slice(lanes.first, lanes.first + lanes.count)
        for name in BLOCKS:
            if name in lanes.blocks:
                getattr(self, name)[group] = lanes.get(name)[:, 0]
        if "event_first" in lanes.blocks:
            self.first[group] = lanes.get("event_first")
            self.count[group] = lanes.get("event_count")

    def of_lanes(self, lanes: np.ndarray) -> LaneStatus:
        """Status of some of the lanes."""
        if len(lanes) == len(self.frozen):
            return self
        return LaneStatus(**{each.name: getattr(self, each.name)[lanes] for each in fields(self)})

    def check(self, name: str, tick: float, entries: Sequence[str], last_row: str = "", remedy: str = "") -> None:
        """Refuses a single run that stopped.

        Args:
            name: of the arm.   tick: [s].   entries: names of those of the state.   last_row: in words.
            remedy: what may help besides.
        Raises:
            DivergenceError: with the time, the reason and the last row.
        """
        if self.frozen[0] < 0:
            return
        what, expected = "the simulation diverged to infinite numbers or NaN", remedy
        if self.stalled[0]:
            what = (
                f"the integrator ran out of substeps, as {entries[int(self.stalled_by[0])]} asked for more, in the tick"
            )
            expected = "a looser accuracy or tolerance, a larger max_substeps, or integrator = 'rodas3'"
            expected += f"; {remedy}" if remedy else ""
        what += f" at t = {self.frozen[0] * tick:g} s"
        if self.gave_up[0]:
            what = f"CVODES gave up at t = {self.frozen[0] * tick:g} s: {_why(self.gave_up[0])}"
            expected = "integrator = 'auto', or a shorter duration" + f"; {remedy}" * bool(remedy)
        what += f"{'; ' * bool(last_row)}{last_row}"
        raise DivergenceError(what, expected=expected, file=name)

    def add_to(
        self, run: xarray.Dataset, tick: float, adaptivity: Adaptivity | None, entries: Sequence[str], single: bool
    ) -> None:
        """Adds variables to a run: times at which lanes diverged or stalled, substeps, events."""

        dims, first = ((), 0) if single else (("lane",), slice(None))
        added: dict[str, Any] = {}  # put in at once: xarray aligns all variables at every change

        def put(name: str, values: np.ndarray, unit: str, about: str, *more: str) -> None:
            added[name] = ((*dims, *more), values[first], {"units": unit, "long_name": about})

        stopped, stalled = np.where(self.frozen < 0, np.nan, self.frozen * tick), self.stalled > 0.0
        gave_up = self.gave_up > 0.0
        choosing = adaptivity if adaptivity is not None and adaptivity.most else None
        if not single:
            diverged = np.where(stalled | gave_up, np.nan, stopped)
            put("diverged_at", diverged, "s", "time at which the lane diverged")
        if adaptivity is not None:
            run.attrs |= adaptivity.allowed.attributes
        if choosing is not None and not single:
            put("stalled_at", np.where(stalled, stopped, np.nan), "s", "time at which the lane ran out of substeps")
            if stalled.any():
                lane = int(np.argmin(np.where(stalled, stopped, np.inf)))
                note = (
                    f"{np.count_nonzero(stalled)} of {len(stalled)} lanes ran out of substeps and stay where they are, first at "
                    f"t = {stopped[lane]:g} s, as {entries[int(self.stalled_by[lane])]} asked for more"
                )
                run.attrs["notes"] = "\n".join([*notes_of(run), note])
                asked = np.where(stalled, np.array(entries)[self.stalled_by.astype(int)], "")
                put("stalled_by", asked, "1", "what asked for more substeps")
        if gave_up.any() and not single:
            lane = int(np.argmin(np.where(gave_up, stopped, np.inf)))
            note = (
                f"CVODES gave up in {np.count_nonzero(gave_up)} of {len(gave_up)} lanes, which stay where they are, first at "
                f"t = {stopped[lane]:g} s: {_why(self.gave_up[lane])}"
            )
            run.attrs["notes"] = "\n".join([*notes_of(run), note])
            put("stalled_at", np.where(gave_up, stopped, np.nan), "s", "time at which CVODES gave up")
            words = np.array([_why(each) if each else "" for each in self.gave_up])
            put("stalled_by", words, "1", "why CVODES gave up")
        if choosing is not None:
            put("steps_tried", self.trials, "1", "substeps that the integrator tried")
            put("steps_repeated", self.repeats, "1", "substeps that were too long, and taken again")
        if choosing is not None and choosing.events:
            run.coords["event"] = ("event", [name for name, _ in choosing.events])
            put("event_time", self.first, "s", "first time of the event", "event")
            put("event_count", self.count, "1", "how often the event happened", "event")
        run.update(added)


def _why(place: float) -> str:
    """Why CVODES gave up, in words, with its flag."""
    flag, words = list(WHY.items())[int(place) - 1]
    return f"{words} ({flag})" if flag.startswith("CV_") else words
