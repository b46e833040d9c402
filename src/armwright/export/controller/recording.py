"""A controller's inputs and commands in a simulation, tick by tick: the vectors that its C is tested with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.errors import ScenarioError
from armwright.export.controller.stages import DRAWN, LOSS, ControllerStages

CHUNK = 4096  # ticks recorded at once: a row takes room for all lanes of a tile


@dataclass(frozen=True, eq=False)
class ControllerRecording:
    """Inputs and commands of a controller in a simulation.

    Attributes:
        y_begin, u_begin: (size,) and (n,) the measurement and the command before the first tick.
        lost: (ticks,) whether the sample was lost.   r: (ticks, size) references.   u: (ticks, n) commands.
        y: (ticks, size) measurements, what the drives applied behind them; the last one that arrived where a sample was lost.
    """

    y_begin: np.ndarray
    u_begin: np.ndarray
    lost: np.ndarray
    r: np.ndarray
    y: np.ndarray
    u: np.ndarray

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.u)

    def first(self, ticks: int) -> ControllerRecording:
        """The recording cut after a number of ticks."""
        rows = (each[:ticks] for each in (self.lost, self.r, self.y, self.u))
        return ControllerRecording(self.y_begin, self.u_begin, *rows)


def record(stages: ControllerStages, ticks: int) -> ControllerRecording:
    """Inputs and commands of the controller in a number of ticks of its scenario.

    Args:
        stages: the controller's, with the loop.   ticks: how many.
    Raises:
        ScenarioError: the simulation diverges; says when.
    """
    loop = stages.loop
    lanes, initial = loop.lanes(1), loop.initial
    loop.begin(lanes, None)
    sizes = {name: layout.size for name, layout in loop.config.recorded.items()}
    parts = np.cumsum(list(sizes.values()))[:-1]
    rows = np.empty((ticks, sum(sizes.values())))
    for start in range(0, ticks, CHUNK):
        count = min(CHUNK, ticks - start)
        loop.tick = loop.origin = start
        loop.reference = loop.reference_of_ticks(count)
        room = np.empty((count + 1, lanes.width, rows.shape[1]))
        loop.advance(lanes, start, start + count, ticks + 1, room, 1)
        rows[start : start + count] = room[:count, 0]
    frozen = lanes.get("frozen")[0, 0]
    if frozen >= 0.0:
        what = f"the simulation diverged to infinite numbers or NaN at t = {frozen * loop.period:g} s"
        raise ScenarioError(what, place="loop.controller", expected="a loop that is stable")
    columns = dict(zip(sizes, np.split(rows, parts, axis=1), strict=True))
    lost = columns[DRAWN][:, LOSS] < stages.loss if DRAWN in columns else np.zeros(ticks, dtype=bool)
    return ControllerRecording(initial["y"], initial["u"], lost, columns["r"], columns["y"], columns["u_issued"])
