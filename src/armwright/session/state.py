"""State of a session: frozen, so that undo, save and record can store it without copying."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.model import Model
from armwright.session.listing import OutputFile

if TYPE_CHECKING:
    import xarray as xr

    from armwright.kernels.compiled import CompiledArm

STEP = 1e-3  # [s] initial TimeStep and DACSampTimePeriod, those of the report


@dataclass(frozen=True)
class HandLoad:
    """Load in the hand: mass [kg], centre of mass [m] and principal moments about it [kg m²], in a frame's axes."""

    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float]
    frame: str | None = None


@dataclass(frozen=True)
class ControllerSettings:
    """A controller with DACOut as its reference.

    Attributes:
        kind: name of a controller, such as joint-pid.   gains: by name, as they were typed.
        scale: (n,) [rad/V | m/V] position that one volt asks for.
    """

    kind: str
    gains: Mapping[str, str]
    scale: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class LoadedArm:
    """The arm of a robot's file, with the session's gravity and payload."""

    robot: str
    base: Model
    gravity: float | None = None  # [m/s²] along z of the base; None: the file's
    payload: HandLoad | None = None

    @cached_property
    def arm(self) -> Model:
        """The arm with that gravity and payload."""
        arm = self.base
        if self.payload is not None:
            arm = arm.with_payload(self.payload.mass, self.payload.com, self.payload.inertia, self.payload.frame)
        if self.gravity is not None:
            x, y, _ = (float(g) for g in self.base.gravity)
            arm = arm.replace(gravity=[x, y, self.gravity])
        return arm

    @cached_property
    def dyn(self) -> CompiledArm:
        """Its kernels, compiled when first used."""
        return aw.compile(self.arm)


@dataclass(frozen=True, eq=False)
class SessionState:
    """All variables and settings of a session.

    Attributes:
        loaded: the arm.   q, qd, qdd: (n,) theta, omega, alpha.
        u: (n,) commands of the drives, each in its own unit: the voltage of a voltage drive. Torque, voltage and current
            follow from it.
        dac: (n,) [V] DACOut where it is the reference of a controller.
        dac_period: [s] DACSampTimePeriod.   step: [s] TimeStep of the integration.
        controller: None without one.   run: the last simulation, if there was one.   output_file: None where none is open.
        lines: all lines so far, as a script that leads to this state.
    """

    loaded: LoadedArm
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    u: np.ndarray
    dac: np.ndarray
    dac_period: float = STEP
    step: float = STEP
    controller: ControllerSettings | None = None
    run: xr.Dataset | None = None
    output_file: OutputFile | None = None
    lines: tuple[str, ...] = field(default=())

    @property
    def arm(self) -> Model:
        """The arm with the session's gravity and payload."""
        return self.loaded.arm

    def replace(self, **changes: Any) -> SessionState:
        """The state with other values; arrays are copied and frozen."""
        return replace(self, **{name: _frozen(value) for name, value in changes.items()})


def _frozen(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = np.array(value, dtype=float)
        value.flags.writeable = False
    return value


def load_arm(robot: str) -> LoadedArm:
    """An arm by its name or path.

    Raises:
        ArmwrightError: no such robot, or an invalid file.
    """
    return LoadedArm(robot, aw.load(robot))


def initial_state(loaded: LoadedArm) -> SessionState:
    """Initial state of a session with that arm: everything at zero."""
    zero = _frozen(np.zeros(loaded.base.n))
    return SessionState(loaded, zero, zero, zero, zero, zero)
