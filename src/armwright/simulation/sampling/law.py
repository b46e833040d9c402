"""A control law, taken apart for the loop: what varies by lane, its state, and its program."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import HiddenStateError, ScenarioError
from armwright.kernels.stages import NEXT
from armwright.model import Model
from armwright.parameters import Batch, batches, check_counts
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.sampling.protocols import ControlLaw, Measurement, Reference, called

LAW = "a function (t, r, y) → u, or an object with init(arm, y) and step(t, r, y, s) → u, s"
TAKEN = {"init": ("arm", "y"), "step": ("t", "r", "y", "s"), "": ("t", "r", "y")}


@dataclass(frozen=True, eq=False)
class Law:
    """A controller, taken apart: the fields that vary by lane, and the control law of one lane.

    Attributes:
        control: the controller.   varying: fields of it that are batches.   shapes: of one lane's value of each.
        values: (lanes, k) of them, side by side; (1, 0) where nothing varies.
    """

    control: ControlLaw
    varying: tuple[str, ...]
    shapes: tuple[tuple[int, ...], ...]
    values: np.ndarray

    @classmethod
    def of(cls, control: ControlLaw, arm: Model, period: float) -> Law:
        """A plain function, or a frozen dataclass some of whose fields may be batches; `fitted` where it can be.

        Raises:
            ScenarioError: no controller, or one that takes other arguments; lanes of its gains that do not fit together.
        """
        _check_law(control)
        if hasattr(control, "fitted"):
            control = control.fitted(arm, period)
        rows: dict[str, np.ndarray] = {}
        if is_dataclass(control) and not isinstance(control, type):
            given = {f.name: getattr(control, f.name) for f in fields(control)}
            rows = {name: _numbers(control, name, value) for name, value in given.items() if isinstance(value, Batch)}
        check_counts({f"controller.{name}": len(value) for name, value in rows.items()})
        _check_place(control)
        flat = [value.reshape(len(value), -1) for value in rows.values()]
        values = np.concatenate(flat, axis=1) if rows else np.zeros((1, 0))
        return cls(control, tuple(rows), tuple(value.shape[1:] for value in rows.values()), values)

    @property
    def name(self) -> str:
        """What it goes by."""
        return called(self.control)

    @property
    def vectorised(self) -> bool:
        """Whether it asks to be called in Python, with all lanes at once."""
        return bool(getattr(self.control, "vectorised", False))

    @property
    def lanes(self) -> int | None:
        """How many lanes its gains are given for."""
        return len(self.values) if self.varying else None

    def told(self, c: Array) -> ControlLaw:
        """The controller of one lane."""
        if not self.varying:
            return self.control
        return replace(self.control, **self._fields(np.asarray(c, dtype=object)))

    def _fields(self, rows: np.ndarray) -> dict[str, Any]:
        """The varying fields from (…, k) values."""
        ends = np.cumsum([math.prod(shape) for shape in self.shapes])
        parts = np.split(rows, ends[:-1], axis=-1)
        found = {
            name: scalar.array(part.reshape(*rows.shape[:-1], *shape))
            for name, part, shape in zip(self.varying, parts, self.shapes, strict=True)
        }
        return {name: value if value.ndim else value[()] for name, value in found.items()}

    def initial(self, arm: Model, y: Measurement, c: Array) -> np.ndarray:
        """Its state before the first tick (k,)."""
        control = self.told(c)
        return np.atleast_1d(scalar.array(control.init(arm, y))) if hasattr(control, "init") else np.zeros(0)

    def step(self, t: Any, r: Reference, y: Measurement, s: Array, c: Array) -> tuple[Array, Array]:
        """Its command and its next state."""
        control = self.told(c)
        return self.pair(control.step(t, r, y, s)) if hasattr(control, "step") else (control(t, r, y), s)

    def pair(self, result: Any) -> tuple[Any, Any]:
        """What `step` returned, if it is two things.

        Raises:
            ScenarioError: it is not.
        """
        if not isinstance(result, tuple) or len(result) != 2:
            raise ScenarioError(
                f"controller {self.name!r}: step returned no pair; expected (u, s), the commands and the next state"
            )
        return result

    def of_group(self, first: int, count: int) -> ControlLaw:
        """The controller of some lanes at once, whose gains are (count, k)."""
        return (
            replace(self.control, **self._fields(self.values[first : first + count])) if self.varying else self.control
        )


def _numbers(control: ControlLaw, name: str, value: Batch) -> np.ndarray:
    """(lanes, …) numbers of a field.

    Raises:
        ScenarioError: other values.
    """
    if value.shape is None:
        raise ScenarioError(f"controller {called(control)!r}: {name} = {value!r}: expected numbers")
    return value.values.astype(float)


def _check_place(control: ControlLaw) -> None:
    """Refuses batches that are not fields of the controller itself, such as one in a part of it.

    Raises:
        ScenarioError: names the place.
    """
    for path, _ in batches(control, "controller"):
        if path.count(".") != 1 or "[" in path:
            raise ScenarioError(f"{path} is a Batch: expected it as a field of the controller itself")


def hidden_state(name: str) -> ScenarioError:
    """What a controller is refused with that remembers on its own."""
    return ScenarioError(
        f"controller {name!r}: keeps hidden state: two calls with the same arguments compute different things; "
        "expected all memory in s, which step takes and returns"
    )


def wrong_shape(name: str, what: str, value: Any, expected: tuple[int, ...]) -> ScenarioError:
    """What a controller is refused with that returns something else than its commands or its state."""
    try:
        shape = np.shape(value)
    except ValueError:  # rows of unequal length
        shape = None
    told = f"= {value!r}" if value is None or shape in (None, expected) else f"of shape {shape}"
    return ScenarioError(f"controller {name!r}: returned {what} {told}, expected {expected}")


def _check_law(control: Any) -> None:
    """Refuses what is no controller, or takes other arguments.

    Raises:
        ScenarioError: names it, and what was expected.
    """
    if isinstance(control, type):
        raise ScenarioError(
            f"controller is the class {control.__name__}; expected a controller that it makes, {control.__name__}(…)"
        )
    if not callable(control) and not callable(getattr(control, "step", None)):
        raise ScenarioError(f"controller = {control!r}: expected {LAW}")
    for part, names in TAKEN.items():
        function = getattr(control, part, None) if part else None if hasattr(control, "step") else control
        if function is None:
            continue
        try:
            taken = inspect.signature(function)
        except ValueError:  # a built-in function that does not tell
            continue
        try:
            taken.bind(*names)
        except TypeError:
            place = f"{called(control)}.{part}" if part else called(control)
            raise ScenarioError(f"controller {place!r}: takes {taken}, expected ({', '.join(names)})") from None


def traced_law(law: Law, arm: Model, period: float, states: int) -> Program:
    """One tick of a controller as a program: (tick, r, y, s, c) → u_asked, s_next.

    Raises:
        ScenarioError: it returns a wrong shape, or other programs when traced twice: it keeps state outside of s.
        Others: whatever the controller does with symbols that it cannot.
    """
    n = arm.n

    def control(tick: Array, r: Array, y: Array, s: Array, c: Array) -> tuple[Array, Array]:
        u, following = law.step(tick[0] * period, reference_of(r, n), measurement_of(y, n), s, c)
        given = {"u": (u, (n,)), "s": (following, (states,))}
        arrays = {name: scalar.array(value) for name, (value, _) in given.items()}
        for name, (value, expected) in given.items():
            if value is None or arrays[name].shape != expected:
                raise wrong_shape(law.name, name, value, expected)
        return arrays["u"], arrays["s"]

    inputs = {"tick": (1,), "r": (3 * n,), "y": (4 * n,), "s": (states,), "c": (law.values.shape[1],)}
    try:
        first, second = (trace("control", control, inputs, ("u_asked", f"s{NEXT}")) for _ in range(2))
    except HiddenStateError:
        raise hidden_state(law.name) from None
    if str(first) != str(second):
        raise hidden_state(law.name)
    return first


def reference_of(r: Array, n: int) -> Reference:
    """A reference from its block."""
    return Reference(r[..., :n], r[..., n : 2 * n], r[..., 2 * n :])


def measurement_of(y: Array, n: int) -> Measurement:
    """A measurement from its block."""
    return Measurement(y[..., :n], y[..., n : 2 * n], y[..., 2 * n : 3 * n], y[..., 3 * n :])
