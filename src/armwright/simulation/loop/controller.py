"""Controllers in the loop: the adapter that calls one for a lane, and its program."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import HiddenStateError, ScenarioError, shown
from armwright.interfaces import JointReference, called
from armwright.kernels.stages import NEXT
from armwright.model import Model
from armwright.parameters import LaneFields
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.signals import Layout, SignalValues
from armwright.simulation.checks import check_arguments
from armwright.simulation.loop.sensor_set import measurement_of

ControlLaw = Any  # a Controller, or a plain function (t, r, y) → u
LAW = "a function (t, r, y) → u, or an object with init(arm, y) and step(t, r, y, s) → u, s"
TAKEN = {"init": ("arm", "y"), "step": ("t", "r", "y", "s"), "": ("t", "r", "y")}


@dataclass(frozen=True, eq=False)
class ControllerAdapter:
    """A controller as the loop calls it: for one lane, with that lane's values in place of its batches.

    Attributes:
        lanes: the controller, and its fields that vary.   y, r: layouts of what it sees and follows.
    """

    lanes: LaneFields
    y: Layout
    r: Layout

    @classmethod
    def of(cls, control: ControlLaw, arm: Model, period: float, y: Layout, r: Layout) -> ControllerAdapter:
        """The adapter of a plain function or a controller, configured where it can be."""
        return cls(configured(control, arm, period), y, r)

    @property
    def control(self) -> ControlLaw:
        """The controller itself."""
        return self.lanes.owner

    @property
    def values(self) -> np.ndarray:
        """(lanes or 1, k) values of its fields that vary."""
        return self.lanes.values

    @property
    def name(self) -> str:
        """Its name in errors and results."""
        return called(self.control)

    @property
    def vectorised(self) -> bool:
        """True for a controller that asks to be called in Python, with all lanes at once."""
        return bool(getattr(self.control, "vectorised", False))

    def of_lane(self, c: Array) -> ControlLaw:
        """The controller with values c (…, k) in place of its batches."""
        return self.lanes.with_values(c)

    def initial(self, arm: Model, y: Array, c: Array) -> np.ndarray:
        """Its state before the first tick (k,)."""
        control, y = self.of_lane(c), measurement_of(self.y, y)
        return np.atleast_1d(scalar.array(control.init(arm, y))) if hasattr(control, "init") else np.zeros(0)

    def step(self, t: Any, r: Array, y: Array, s: Array, c: Array) -> tuple[Array, Array]:
        """Its command and its next state."""
        control, r, y = self.of_lane(c), reference_of(self.r, r), measurement_of(self.y, y)
        return self.pair(control.step(t, r, y, s)) if hasattr(control, "step") else (control(t, r, y), s)

    def pair(self, result: Any) -> tuple[Any, Any]:
        """The command and the next state that `step` returned.

        Raises:
            ScenarioError: it returned something else.
        """
        if not isinstance(result, tuple) or len(result) != 2:
            expected = "(u, s), the commands and the next state"
            raise ScenarioError("step returned no pair", place=place_of(self.name), expected=expected)
        return result


def configured(control: ControlLaw, arm: Model, period: float, ticks: int = 0) -> LaneFields:
    """A controller, configured for its arm and sample period where it can be, with its fields that vary.

    Args:
        control: the controller.   arm: the model.   period: [s].
        ticks: whole ticks from a command to its drive, for a controller that leaves its `delay_ticks` open.
    Raises:
        ScenarioError: no controller, or one that takes other arguments; lanes of its gains that do not fit together.
    """
    control = _timed(control, ticks)
    if hasattr(control, "configure"):
        control = control.configure(arm, period)
    return LaneFields.of(control, "loop.controller")


def _timed(control: ControlLaw, ticks: int) -> ControlLaw:
    """The controller with `delay_ticks` that are None, its own or those of the controller within it, set to the loop's delay.

    Anti-windup compares what the drives did with what was asked of them `delay_ticks` before: with too few, each moving command
    looks as if it had been cut off, and the integrator waits.
    """
    if not is_dataclass(control) or isinstance(control, type):
        return control
    names = {each.name for each in fields(control)}
    law: Any = control
    if "delay_ticks" in names and law.delay_ticks is None:
        return replace(law, delay_ticks=ticks)
    if "inner" in names:
        inner = _timed(law.inner, ticks)
        return law if inner is law.inner else replace(law, inner=inner)
    return law


def place_of(name: str) -> str:
    """The controller as errors name it."""
    return f"loop.controller {name!r}"


def hidden_state(name: str) -> ScenarioError:
    """The error of a controller that has memory outside of its state."""
    what = "keeps hidden state: two calls with the same arguments compute different things"
    expected = "all memory in s, which step takes and returns"
    return ScenarioError(what, place=place_of(name), expected=expected)


def wrong_shape(name: str, output: str, value: Any, expected: tuple[int, ...]) -> ScenarioError:
    """The error of a controller that returns other things than its commands or its state."""
    try:
        shape = np.shape(value)
    except ValueError:  # rows of unequal length
        shape = None
    description = f"= {shown(value)}" if value is None or shape in (None, expected) else f"of shape {shape}"
    return ScenarioError(f"returned {output} {description}", place=place_of(name), expected=str(expected))


def check_controller(control: Any) -> None:
    """Refuses what is no controller, or takes other arguments.

    Raises:
        ScenarioError: names it, and what was expected.
    """
    if isinstance(control, type):
        expected = f"a controller that it makes, {control.__name__}(…)"
        raise ScenarioError("a class", place="loop.controller", value=control.__name__, expected=expected)
    if not callable(control) and not callable(getattr(control, "step", None)):
        raise ScenarioError(place="loop.controller", value=control, expected=LAW)
    for part, names in TAKEN.items():
        function = getattr(control, part, None) if part else None if hasattr(control, "step") else control
        if function is not None:
            check_arguments(function, names, place_of(f"{called(control)}.{part}" if part else called(control)))


def traced_controller(adapter: ControllerAdapter, arm: Model, period: float, states: int) -> Program:
    """One tick of a controller as a program: (tick, r, y, s, c) → u_asked, s_next.

    Raises:
        ScenarioError: it returns a wrong shape, or other programs when traced twice: it keeps state outside of s.
        Others: whatever the controller does with symbols that it cannot.
    """

    def control(tick: Array, r: Array, y: Array, s: Array, c: Array) -> tuple[Array, Array]:
        u, following = adapter.step(tick[0] * period, r, y, s, c)
        returned = {"u": (u, (arm.n,)), "s": (following, (states,))}
        arrays = {name: scalar.array(value) for name, (value, _) in returned.items()}
        for name, (value, expected) in returned.items():
            if value is None or arrays[name].shape != expected:
                raise wrong_shape(adapter.name, name, value, expected)
        return arrays["u"], arrays["s"]

    inputs = {
        "tick": (1,),
        "r": (adapter.r.size,),
        "y": (adapter.y.size,),
        "s": (states,),
        "c": adapter.values.shape[1:],
    }
    try:
        first, second = (trace("control", control, inputs, ("u_asked", f"s{NEXT}")) for _ in range(2))
    except HiddenStateError:
        raise hidden_state(adapter.name) from None
    if str(first) != str(second):
        raise hidden_state(adapter.name)
    return first


def counters_of(law: Program) -> list[int]:
    """Entries of a controller's state that change by themselves and by constants alone: counters of slower loops.

    Args:
        law: as `traced_controller` gives it.
    """
    ports = [port.name for port in law.inputs]
    state, constant = ports.index("s"), {ports.index("tick"), ports.index("c")}
    needs: dict[int, frozenset[tuple[int, int]]] = {}  # inputs that a value is computed from, by port and entry
    read: dict[int, tuple[int, int]] = {}
    following: dict[int, frozenset[tuple[int, int]]] = {}
    for i in law.instructions:
        found = frozenset().union(*(needs[argument] for argument in i.arguments))
        if i.operation == "INPUT" and i.place is not None:
            read[i.results[0]] = i.place
            found = found if i.place[0] in constant else frozenset({i.place})
        needs.update(dict.fromkeys(i.results, found))
        if i.operation == "OUTPUT" and i.place is not None and law.outputs[i.place[0]].name == f"s{NEXT}":
            place = state, i.place[1]
            if place in found and read.get(i.arguments[0]) != place:  # not merely kept
                following[i.place[1]] = found
    entries = set(following)
    while others := {k for k in entries if not following[k] <= {(state, entry) for entry in entries}}:
        entries -= others
    return sorted(entries)


def reference_of(layout: Layout, r: Array) -> JointReference | SignalValues:
    """A reference from vectors r (…, size): of the joints, or whatever the trajectory's own signals are."""
    parts = layout.parts(r)
    return JointReference(**parts) if layout.names == ("q", "qd", "qdd") else SignalValues(parts)
