"""Protocols for users' controllers, sensors and trajectories, as plain functions and small frozen dataclasses.

All are written with `armwright.scalar` on the arrays of one lane, and are traced into the compiled loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from armwright.errors import nearest
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.signals import Signal


@dataclass(frozen=True, eq=False)
class JointReference:
    """Reference of the joints at one time: positions, speeds and accelerations, each (n,)."""

    q: Array  # [rad | m]
    qd: Array  # [rad/s | m/s]
    qdd: Array  # [rad/s² | m/s²]


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measured signals of the joints, each (n,); `applied` is what the drives did with the last command, within their limits.

    Signals of further sensors are attributes too: `y.force`.
    """

    q: Array  # [rad | m], referred to the joints
    qd: Array  # [rad/s | m/s]
    current: Array  # [A]; NaN of joints whose motor constants are not known
    applied: Array  # [V | A | N m | N], in each joint's own unit
    further: Mapping[str, Array] = field(default_factory=dict)  # by name, of sensors that a user added

    def __getattr__(self, name: str) -> Array:
        further = self.__dict__.get("further", {})
        if name in further:
            return further[name]
        known = ("q", "qd", "current", "applied", *further)
        raise AttributeError(f"no measured signal {name!r}; {nearest(name, known)}")


@runtime_checkable
class Controller(Protocol):
    """A controller with memory: `init` gives its initial state, `step` its command and next state.

    A controller without memory may be a plain function (t, r, y) → u. Fields of a dataclass may be of any shape; one that is
    given as a `Batch` has a value a lane, and `init` and `step` see that of their lane.
    One that depends on the sample period, or checks its gains, may have `configure(arm, period) → Controller`, asked first.
    One that has `vectorised = True` is not traced, but called in Python with all lanes at once: arrays are then (lanes, n).
    """

    def init(self, arm: Model, y: Measurement) -> Array:
        """The state (k,) before the first tick.

        Args:
            arm: the model.   y: what is measured at the beginning.
        """
        ...

    def step(self, t: Scalar, r: Any, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick.

        Args:
            t: [s].   r: the reference at t, a `JointReference` or the trajectory's own signals.   y: what was measured.
            s: (k,) the state.
        Returns:
            u: (n,) commands [V | A | N m | N], each in its joint's own unit.   s: (k,) the next state.
        """
        ...


class Sensor(Protocol):
    """A sensor: a measurement of the plant, with its errors. Delays and losses belong to the loop's `Timing`.

    Three further methods are optional. `init(plant)` gives what the sensor remembers before the first tick, (k,) numbers; a
    sensor without it remembers nothing. `draws(arm)` is the number of random numbers that a measurement takes. `exact()` is
    the sensor without noise, which measures before the first tick; without it the random numbers are 0.5 there.
    """

    def signals(self, arm: Model) -> Sequence[Signal]:
        """Names, units and shapes of what is measured."""
        ...

    def measure(self, plant: Any, s: Array, w: Array) -> tuple[Mapping[str, Array], Array]:
        """One measurement.

        Args:
            plant: a `PlantView`, the plant at the instant of measuring: `plant.q`, `plant.current`, `plant.wrench`, ….
            s: (k,) what was remembered.   w: (draws,) random numbers, uniform in (0, 1).
        Returns:
            values: one for each signal, by name.   s: (k,) for the next time.
        """
        ...


class Trajectory(Protocol):
    """A reference over time.

    Without a method `signals` it is one of the joints: positions q (n,), or (q, q̇, q̈), or a `JointReference`. Positions that
    are written with `armwright.scalar` are differentiated exactly. A method `at(t)`, for times (k,) at once, gives the same with
    a row for each time: q (k, n), or (q, q̇, q̈). With `signals(arm)`, as a `Sensor` has it, the trajectory
    gives values by name, and the controller's `r` has them as attributes: a Cartesian reference `r.position`.
    """

    def __call__(self, t: Scalar) -> Any:
        """The reference at a time t [s]."""
        ...


def called(function: Any) -> str:
    """The name of a function, or the class name of an object used as one."""
    return getattr(function, "__name__", type(function).__name__)


UNTRACEABLE = (Exception,)  # whatever users' code raises on symbols that it cannot take


def why(error: Exception) -> str:
    """Cause of a failed trace, in one line."""
    return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"
