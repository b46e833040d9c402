"""A control law, taken apart for the loop: what varies by lane, its state, and its program."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.kernels.stages import NEXT
from armwright.model import Model
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.protocols import ControlLaw, Measurement, Reference


@dataclass(frozen=True, eq=False)
class Law:
    """A controller, taken apart: what varies by lane, and how long its state is."""

    control: ControlLaw
    varying: tuple[str, ...]  # its fields that are given a row a lane
    sizes: tuple[int, ...]
    values: np.ndarray  # (lanes, sum of sizes)

    @classmethod
    def of(cls, control: ControlLaw, arm: Model, period: float) -> Law:
        """A plain function, or a frozen dataclass some of whose fields are (lanes, k) arrays; `fitted` where it can be."""
        if hasattr(control, "fitted"):
            control = control.fitted(arm, period)
        rows = {}
        if is_dataclass(control) and not isinstance(control, type):
            rows = {f.name: np.asarray(getattr(control, f.name)) for f in fields(control)}
            rows = {name: value for name, value in rows.items() if value.ndim == 2 and value.dtype.kind in "fiu"}
        counts = {len(value) for value in rows.values()}
        if len(counts) > 1:
            told = ", ".join(f"{len(value)} of {name}" for name, value in rows.items())
            raise ScenarioError(f"controller: lanes do not fit together: {told}")
        values = np.concatenate([*rows.values()], axis=1).astype(float) if rows else np.zeros((1, 0))
        return cls(control, tuple(rows), tuple(value.shape[1] for value in rows.values()), values)

    @property
    def lanes(self) -> int | None:
        """How many lanes its gains are given for."""
        return len(self.values) if self.varying else None

    def told(self, c: Array) -> ControlLaw:
        """The controller of one lane."""
        if not self.varying:
            return self.control
        parts = np.split(np.asarray(c, dtype=object), np.cumsum(self.sizes)[:-1])
        return replace(self.control, **{n: scalar.array(part) for n, part in zip(self.varying, parts, strict=True)})

    def initial(self, arm: Model, y: Measurement, c: Array) -> np.ndarray:
        """Its state before the first tick (k,)."""
        control = self.told(c)
        return np.atleast_1d(scalar.array(control.init(arm, y))) if hasattr(control, "init") else np.zeros(0)

    def step(self, t: Any, r: Reference, y: Measurement, s: Array, c: Array) -> tuple[Array, Array]:
        """Its command and its next state."""
        control = self.told(c)
        if hasattr(control, "step"):
            result = control.step(t, r, y, s)
            if not isinstance(result, tuple) or len(result) != 2:
                raise ScenarioError(
                    "controller: step returned no pair; expected (u, s), the commands and the next state"
                )
            return result
        return control(t, r, y), s

    def begun(self, arm: Model, y: Measurement, first: int, count: int) -> Any:
        """Its state, of whatever kind, where it runs in Python for a group of lanes at once."""
        control = self._group(first, count)
        return control.init(arm, y) if hasattr(control, "init") else None

    def called(self, t: float, r: Reference, y: Measurement, s: Any, first: int, count: int) -> tuple[Any, Any]:
        """Its command and next state in Python: arrays are (lanes, n) of a group of lanes, (n,) of a single run."""
        control = self._group(first, count)
        return control.step(t, r, y, s) if hasattr(control, "step") else (control(t, r, y), s)

    def _group(self, first: int, count: int) -> ControlLaw:
        if not self.varying:
            return self.control
        parts = np.split(self.values[first : first + count], np.cumsum(self.sizes)[:-1], axis=1)
        return replace(self.control, **dict(zip(self.varying, parts, strict=True)))


def traced_law(law: Law, arm: Model, period: float, states: int) -> Program:
    """One tick of a controller as a program: (tick, r, y, s, c) → u_asked, s_next.

    Raises:
        ScenarioError: it returns a wrong shape, or other programs when traced twice: it keeps state outside of s.
        Others: whatever the controller does with symbols that it cannot.
    """
    n = arm.n

    def control(tick: Array, r: Array, y: Array, s: Array, c: Array) -> tuple[Array, Array]:
        u, following = law.step(tick[0] * period, reference_of(r, n), measurement_of(y, n), s, c)
        u, following = scalar.array(u), scalar.array(following)
        for name, found, expected in (("u", u, (n,)), ("s", following, (states,))):
            if found.shape != expected:
                raise ScenarioError(f"controller: returned {name} of shape {found.shape}, expected {expected}")
        return u, following

    inputs = {"tick": (1,), "r": (3 * n,), "y": (4 * n,), "s": (states,), "c": (law.values.shape[1],)}
    first, second = (trace("control", control, inputs, ("u_asked", f"s{NEXT}")) for _ in range(2))
    if str(first) != str(second):
        raise ScenarioError(
            "controller: keeps hidden state: two calls with the same arguments compute different things; "
            "expected all memory in s, which step takes and returns"
        )
    return first


def reference_of(r: Array, n: int) -> Reference:
    """A reference from its block."""
    return Reference(r[..., :n], r[..., n : 2 * n], r[..., 2 * n :])


def measurement_of(y: Array, n: int) -> Measurement:
    """A measurement from its block."""
    return Measurement(y[..., :n], y[..., n : 2 * n], y[..., 2 * n : 3 * n], y[..., 3 * n :])
