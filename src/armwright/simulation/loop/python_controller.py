"""Controllers called in Python, once a tick for every lane, because they cannot be traced or request it.

A lane's call means what it would in the compiled loop: arrays are (n,), its gains are its own, its state is what it returned the
tick before. Controllers that have `vectorised = True` are called once for all lanes instead, with arrays (lanes, n).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ArmwrightError, ScenarioError, SymbolError
from armwright.kernels.loop import LaneGroup
from armwright.model import Model
from armwright.simulation.loop.controller import (
    ControlLaw,
    ControllerAdapter,
    hidden_state,
    place_of,
    reference_of,
    wrong_shape,
)
from armwright.simulation.loop.sensor_set import measurement_of

ELSEWHERE = 1e-3  # [rad | m] and so on: how far measurements are moved to ask a controller something else


class PythonController:
    """A controller that is called in Python, with the states of its lanes.

    Attributes:
        adapter: the controller.   arm: the model.   period: [s].
        states: by lane, or by the first lane of a group that is called at once.
    """

    def __init__(self, adapter: ControllerAdapter, arm: Model, period: float):
        self.adapter, self.arm, self.period = adapter, arm, period
        self._controls: dict[int, ControlLaw] = {}  # as states
        self.states: dict[int, Any] = {}
        self._checked = False

    def begin(self, lanes: LaneGroup, y: np.ndarray) -> None:
        """Asks for the states of a group of lanes, from what is measured before the first tick (count or 1, size).

        Those of lanes that go on from an earlier state are there already.
        """
        rows = np.array(np.broadcast_to(y, (lanes.count, y.shape[1])))
        for lane, of in self._calls(lanes):
            control = self._controls[lane] = self._control(lane, lanes.count)
            if lane not in self.states:
                first = measurement_of(self.adapter.y, rows[of])
                self.states[lane] = (
                    self._ask(control.init, self.arm, first) if hasattr(control, "init") else np.zeros(0)
                )

    def memories(self, groups: Sequence[LaneGroup]) -> dict[int, Any]:
        """Memory of every lane; by the first lane of a group where a group's memory has no row a lane."""
        memories: dict[int, Any] = {}
        for lanes in groups:
            whole = self.states.get(lanes.first)
            if self.adapter.vectorised and isinstance(whole, np.ndarray) and len(whole) == lanes.count:
                memories |= {lanes.first + k: row.copy() for k, row in enumerate(whole)}
            else:
                memories |= {lane: copy.deepcopy(self.states[lane]) for lane, _ in self._calls(lanes)}
        return memories

    def restore(self, lanes: LaneGroup, memories: Mapping[int, Any]) -> None:
        """Takes what is remembered of the lanes of a group, as `memories` gave it."""
        if self.adapter.vectorised and len(memories) == lanes.count and lanes.count > 0:
            rows = [memories[lane] for lane in sorted(memories)]
            if all(isinstance(row, np.ndarray) for row in rows):
                self.states[lanes.first] = np.stack(rows)
                return
        self.states |= copy.deepcopy(dict(memories))

    def step(self, lanes: LaneGroup, tick: int) -> None:
        """One tick of a group of lanes: block "u_asked" from blocks "r" and "y"; lanes that are frozen are asked no more."""
        u = np.array(lanes.get("u_asked"))
        r, y = np.array(lanes.get("r")), np.array(lanes.get("y"))  # the controller's own: it may write into them
        alive = lanes.get("frozen")[:, 0] < 0.0
        if not self._checked and lanes.first == 0:
            lane, of = self._calls(lanes)[0]
            self._checked = True
            self._check_memory(lane, r[of], y[of])
        for lane, of in self._calls(lanes):
            if np.any(alive[of]):
                u[of], self.states[lane] = self._answer(lane, tick * self.period, r[of], y[of], self.states[lane])
        lanes.set("u_asked", u)

    def _calls(self, lanes: LaneGroup) -> list[tuple[int, Any]]:
        """Calls of a tick: the number of each, and its rows of the group's blocks."""
        if self.adapter.vectorised:
            return [(lanes.first, slice(None))]
        return [(lanes.first + k, k) for k in range(lanes.count)]

    def _control(self, lane: int, count: int) -> ControlLaw:
        """The controller with the gains of a lane, or of all that are called at once."""
        values = self.adapter.values
        if self.adapter.vectorised:
            return self.adapter.of_lane(values[lane : lane + count])
        return self.adapter.of_lane(values[lane if len(values) > 1 else 0])

    def _answer(self, lane: int, t: float, r: np.ndarray, y: np.ndarray, s: Any) -> tuple[np.ndarray, Any]:
        """Commands, of the shape that they ought to have, and the next state."""
        control = self._controls[lane]
        signals = reference_of(self.adapter.r, r), measurement_of(self.adapter.y, y)
        if hasattr(control, "step"):
            u, following = self.adapter.pair(self._ask(control.step, t, *signals, s))
        else:
            u, following = self._ask(control, t, *signals), s
        if scalar.is_symbolic(np.asarray(u, dtype=object)):  # of the trace that was tried before
            raise hidden_state(self.adapter.name)
        try:
            commands = np.asarray(u, dtype=float)
        except (TypeError, ValueError):
            commands = None
        if u is None or commands is None or commands.shape != (*y.shape[:-1], self.arm.n):
            raise wrong_shape(self.adapter.name, "u", u, (*y.shape[:-1], self.arm.n))
        return commands, following

    def _ask(self, function: Any, *arguments: Any) -> Any:
        """The value that the user's code returns.

        Raises:
            ScenarioError: what it raised, and where; with nothing but numbers for arguments, a symbol is one that it kept.
        """
        try:
            return function(*arguments)
        except SymbolError:
            raise hidden_state(self.adapter.name) from None
        except ArmwrightError:
            raise
        except Exception as error:
            what = f"{type(error).__name__}: {_first_line(error)}{_place(error)}"
            expected = "commands from t, r (q, qd, qdd) and y (q, qd, current, applied)"
            raise ScenarioError(what, place=place_of(self.adapter.name), expected=expected) from error

    def _check_memory(self, lane: int, r: np.ndarray, y: np.ndarray) -> None:
        """Asks the controller the same before and after something else; nothing is kept of the answers.

        Raises:
            ScenarioError: it answers otherwise: it remembers what it was asked.
        """

        def asked(t: float, moved: float) -> tuple[np.ndarray, Any]:
            return self._answer(lane, t, r.copy(), y + moved, copy.deepcopy(self.states[lane]))

        try:
            asked(0.0, 0.0)
            first, _, again = asked(self.period, 0.0), asked(0.0, ELSEWHERE), asked(self.period, 0.0)
        except (ScenarioError, TypeError, copy.Error):
            return  # what it cannot answer comes again, at its time; or its state cannot be copied
        if not all(_same(a, b) for a, b in zip(first, again, strict=True)):
            raise hidden_state(self.adapter.name)


def _same(a: Any, b: Any) -> bool:
    """True for two answers with the same bits, and for answers that are not numbers."""
    try:
        return np.array_equal(np.asarray(a, dtype=float), np.asarray(b, dtype=float), equal_nan=True)
    except (TypeError, ValueError):
        return True


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0]


def _place(error: Exception) -> str:
    """File and line of the user's code where it happened."""
    step = error.__traceback__
    step = None if step is None else step.tb_next  # behind our own call
    if step is None:
        return ""
    file, line = step.tb_frame.f_code.co_filename, step.tb_lineno
    while step is not None:
        line = step.tb_lineno if step.tb_frame.f_code.co_filename == file else line
        step = step.tb_next
    return f" ({file}:{line})"
