"""What a controller, a reference and sensors are to a simulation: plain functions and small frozen dataclasses.

All are written with `armwright.scalar` on arrays of one lane, and are traced into the compiled loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from armwright.model import Model
from armwright.scalar import Array, Scalar


@dataclass(frozen=True, eq=False)
class Reference:
    """Where the arm should be: positions, speeds and accelerations of the joints, each (n,)."""

    q: Array  # [rad | m]
    qd: Array  # [rad/s | m/s]
    qdd: Array  # [rad/s² | m/s²]


@dataclass(frozen=True, eq=False)
class Measurement:
    """What the sensors say, each (n,); `applied` is what the drives really did with the last command, within their limits."""

    q: Array  # [rad | m], referred to the joints
    qd: Array  # [rad/s | m/s]
    current: Array  # [A]; NaN of joints whose motor constants are not known
    applied: Array  # [V | A | N m | N], in each joint's own unit


@runtime_checkable
class Controller(Protocol):
    """A control law with memory: `init` gives its state at the beginning, `step` what it commands and its next state.

    A law without memory may be a plain function (t, r, y) → u. Fields of a dataclass may be of any shape; one that is
    given as a `Batch` has a value a lane, and `init` and `step` see that of their lane.
    One that depends on the sample period, or checks its gains, may have `fitted(arm, period) → Controller`, asked first.
    One that has `vectorised = True` is not traced, but called in Python with all lanes at once: arrays are then (lanes, n).
    """

    def init(self, arm: Model, y: Measurement) -> Array:
        """The state (k,) before the first tick.

        Args:
            arm: the model.   y: what is measured at the beginning.
        """
        ...

    def step(self, t: Scalar, r: Reference, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick.

        Args:
            t: [s].   r: the reference at t.   y: what was measured.   s: (k,) the state.
        Returns:
            u: (n,) commands [V | A | N m | N], each in its joint's own unit.   s: (k,) the next state.
        """
        ...


class Sensing(Protocol):
    """Sensors: what of the plant's state is measured, and how well."""

    @property
    def draws(self) -> int:
        """Random numbers that a measurement takes."""
        ...

    def memory(self, arm: Model, q: Array, qd: Array) -> Array:
        """(k,) what they remember at the beginning."""
        ...

    def measure(
        self, arm: Model, period: float, seen: dict[str, Array], memory: Array, w: Array
    ) -> tuple[Array, Array, Array, Array]:
        """q, q̇ and current as measured (n,), and the memory for the next time; w (draws,) uniform in (0, 1)."""
        ...


UNTRACEABLE = (Exception,)  # what users' code makes of symbols that it cannot take: anything, of classes of its own too


def why(error: Exception) -> str:
    """What went wrong in a trace, in one line."""
    return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"


def called(function: Any) -> str:
    """What a function, or an object that stands for one, goes by."""
    return getattr(function, "__name__", type(function).__name__)


ControlLaw = Any  # a Controller, or a plain function (t, r, y) → u
