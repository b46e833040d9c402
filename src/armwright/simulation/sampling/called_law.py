"""A control law that is called in Python, once a tick for every lane, because it cannot be traced or asks for it.

A lane's call means what it would in the compiled loop: arrays are (n,), its gains are its own, its state is what it returned the
tick before. Laws that have `vectorised = True` are called once for all lanes instead, with arrays (lanes, n).
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ArmwrightError, ScenarioError, SymbolError
from armwright.kernels.loop import Lanes
from armwright.model import Model
from armwright.simulation.sampling.law import Law, hidden_state, measurement_of, reference_of, wrong_shape
from armwright.simulation.sampling.protocols import ControlLaw, Measurement, Reference

ELSEWHERE = 1e-3  # [rad | m] and so on: how far measurements are moved to ask a law something else


class CalledLaw:
    """A law with what its lanes remember.

    Attributes:
        law: taken apart.   arm: the model.   period: [s].
    """

    def __init__(self, law: Law, arm: Model, period: float):
        self.law, self.arm, self.period = law, arm, period
        self._controls: dict[int, ControlLaw] = {}  # by lane, or by the first lane of a group that is called at once
        self._states: dict[int, Any] = {}

    def begin(self, lanes: Lanes, y: np.ndarray) -> None:
        """Asks the law for the states of a group of lanes, from what is measured before the first tick (count or 1, 4n)."""
        rows = np.array(np.broadcast_to(y, (lanes.count, y.shape[1])))
        for lane, of in self._calls(lanes):
            control = self._control(lane, lanes.count)
            told = self.arm, measurement_of(rows[of], self.arm.n)
            self._controls[lane] = control
            self._states[lane] = self._ask(control.init, *told) if hasattr(control, "init") else np.zeros(0)

    def step(self, lanes: Lanes, tick: int) -> None:
        """One tick of a group of lanes: block "u_asked" from blocks "r" and "y"; lanes that are frozen are asked no more."""
        n, u = self.arm.n, np.array(lanes.get("u_asked"))
        r, y = np.array(lanes.get("r")), np.array(lanes.get("y"))  # the law's own: it may write into them
        alive = lanes.get("frozen")[:, 0] < 0.0
        if tick == 0 and lanes.first == 0:
            lane, of = self._calls(lanes)[0]
            self._check_memory(lane, r[of], y[of])
        for lane, of in self._calls(lanes):
            if np.any(alive[of]):
                told = reference_of(r[of], n), measurement_of(y[of], n)
                u[of], self._states[lane] = self._answer(lane, tick * self.period, *told, self._states[lane])
        lanes.set("u_asked", u)

    def _calls(self, lanes: Lanes) -> list[tuple[int, Any]]:
        """What is asked at once: number, and rows of the group's blocks."""
        if self.law.vectorised:
            return [(lanes.first, slice(None))]
        return [(lanes.first + k, k) for k in range(lanes.count)]

    def _control(self, lane: int, count: int) -> ControlLaw:
        """The controller with the gains of a lane, or of all that are called at once."""
        if self.law.vectorised:
            return self.law.of_group(lane, count)
        return self.law.told(self.law.values[lane] if self.law.varying else self.law.values[0])

    def _answer(self, lane: int, t: float, r: Reference, y: Measurement, s: Any) -> tuple[np.ndarray, Any]:
        """Commands, of the shape that they ought to have, and the next state."""
        control = self._controls[lane]
        if hasattr(control, "step"):
            u, following = self.law.pair(self._ask(control.step, t, r, y, s))
        else:
            u, following = self._ask(control, t, r, y), s
        if scalar.is_symbolic(np.asarray(u, dtype=object)):  # of the trace that was tried before
            raise hidden_state(self.law.name)
        try:
            commands = np.asarray(u, dtype=float)
        except (TypeError, ValueError):
            commands = None
        if u is None or commands is None or commands.shape != y.q.shape:
            raise wrong_shape(self.law.name, "u", u, y.q.shape)
        return commands, following

    def _ask(self, function: Any, *arguments: Any) -> Any:
        """What the user's code returns.

        Raises:
            ScenarioError: what it raised, and where; with nothing but numbers for arguments, a symbol is one that it kept.
        """
        try:
            return function(*arguments)
        except SymbolError:
            raise hidden_state(self.law.name) from None
        except ArmwrightError:
            raise
        except Exception as error:
            raise ScenarioError(
                f"controller {self.law.name!r}: {type(error).__name__}: {_first_line(error)}{_place(error)}; "
                "expected commands from t, r (q, qd, qdd) and y (q, qd, current, applied)"
            ) from error

    def _check_memory(self, lane: int, r: np.ndarray, y: np.ndarray) -> None:
        """Asks the law the same before and after something else; nothing is kept of the answers.

        Raises:
            ScenarioError: it answers otherwise: it remembers what it was asked.
        """
        n = self.arm.n

        def asked(t: float, moved: float) -> tuple[np.ndarray, Any]:
            told = reference_of(r.copy(), n), measurement_of(y + moved, n)
            return self._answer(lane, t, *told, copy.deepcopy(self._states[lane]))

        try:
            asked(0.0, 0.0)
            first, _, again = asked(self.period, 0.0), asked(0.0, ELSEWHERE), asked(self.period, 0.0)
        except (ScenarioError, TypeError, copy.Error):
            return  # what it cannot answer comes again, at its time; or its state cannot be copied
        if not all(_same(a, b) for a, b in zip(first, again, strict=True)):
            raise hidden_state(self.law.name)


def _same(a: Any, b: Any) -> bool:
    """Whether two answers have the same bits; what is no numbers cannot be told apart."""
    try:
        return np.array_equal(np.asarray(a, dtype=float), np.asarray(b, dtype=float), equal_nan=True)
    except (TypeError, ValueError):
        return True


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0]


def _place(error: Exception) -> str:
    """Where in the user's own file it happened."""
    step = error.__traceback__
    step = None if step is None else step.tb_next  # behind our own call
    if step is None:
        return ""
    own, line = step.tb_frame.f_code.co_filename, step.tb_lineno
    while step is not None:
        line = step.tb_lineno if step.tb_frame.f_code.co_filename == own else line
        step = step.tb_next
    return f" ({own}:{line})"
