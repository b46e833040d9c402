"""Numbers of a joint's drive, friction and limits, all referred to the joint side; the equations are in `actuators`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.friction_laws import LAWS
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction of a joint against its speed, all numbers referred to the joint side; equations in `actuators.friction`."""

    viscous: Scalar = 0.0  # [N m s/rad | N s/m]
    coulomb_positive: Scalar = 0.0  # [N m | N], magnitude where q̇ > 0
    coulomb_negative: Scalar = 0.0  # [N m | N], magnitude where q̇ < 0
    offset: Scalar = 0.0  # [N m | N]
    stribeck: Scalar | None = None  # [N m | N], level at standstill; None: Coulomb only
    stribeck_speed: Scalar = 1.0  # [rad/s | m/s]
    smoothing: Scalar | None = None  # [rad/s | m/s]; None: dry friction is a set at rest (`sticks`), or there is none
    law: str = "coulomb"
    parameters: tuple[Scalar, ...] = ()  # the law's own, in the order of `own` of `friction_laws.LAWS`
    on_motor: bool = False  # whose speed it acts on, where the gear gives way or the motor turns several joints
    load_coefficient: Scalar | None = None  # friction by the torque through the gear [-]; equation in `actuators.gear`
    viscous_fall: Scalar | None = None  # warming over which viscous falls to 1/e [K]
    viscous_temperature_coefficient: Scalar | None = None  # relative change of viscous [1/K]
    coulomb_temperature_coefficient: Scalar | None = None  # of Coulomb's and Stribeck's levels [1/K]

    @property
    def is_dry(self) -> bool:
        """True if part of it does not vanish with the speed: Coulomb's or Stribeck's level, or friction by load."""
        levels = (self.coulomb_positive, self.coulomb_negative, self.stribeck, self.load_coefficient)
        dry = any(level is not None and (scalar.is_symbolic(level) or level != 0) for level in levels)
        return dry or LAWS[self.law].by_loads

    @property
    def has_bristles(self) -> bool:
        """True if the simulator has bristles as a state of the joint."""
        return LAWS[self.law].bristles

    @property
    def sticks(self) -> bool:
        """True if dry friction has no smoothing speed: at rest it is any torque within its levels. LuGre's bristles hold."""
        return LAWS[self.law].sticks and self.smoothing is None and self.is_dry


@dataclass(frozen=True, eq=False)
class Thermal:
    """Temperatures of a motor with one or two bodies (winding, housing). Equations in `actuators.thermal`."""

    ambient: Scalar  # [°C]
    reference: Scalar  # [°C] at which the constants were measured
    winding: tuple[Scalar, Scalar]  # heat capacity [J/K], resistance to housing or ambient [K/W]
    housing: tuple[Scalar, Scalar] | None = None  # heat capacity [J/K], resistance to the ambient [K/W]
    resistance_temperature_coefficient: Scalar | None = None  # relative change of R [1/K]
    magnet_temperature_coefficient: Scalar | None = None  # of Kt and Ke, at most 0 [1/K]


@dataclass(frozen=True, eq=False)
class Cogging:
    """Torque of the magnets on the slots, motor side. Equation in `actuators.cogging`."""

    amplitude: Scalar  # [N m]
    periods: Scalar  # of a turn of the motor
    phase: Scalar  # [rad]


@dataclass(frozen=True, eq=False)
class Elasticity:
    """A gear that gives way, joint side. Equations in `actuators.elasticity`."""

    stiffness: Scalar  # [N m/rad | N/m]
    damping: Scalar  # [N m s/rad | N s/m]
    cubic: Scalar | None = None  # [N m/rad³ | N/m³]
    backlash: Scalar | None = None  # width of the gap [rad | m]
    error: tuple[Scalar, Scalar] | None = None  # amplitude [rad | m] and phase [rad] at twice a turn of the motor


@dataclass(frozen=True, eq=False)
class Stops:
    """End stops at the joint's position limits. Equation in `actuators.stops`."""

    stiffness: Scalar  # [N m/rad | N/m]
    damping: Scalar  # [N m s/rad | N s/m]


@dataclass(frozen=True, eq=False)
class Brake:
    """A holding brake, joint side. Equations in `actuators.brake`."""

    holding: Scalar  # [N m | N]
    stiffness: Scalar | None  # [N m/rad | N/m]; None: it is rigid, and holds and lets go at once
    damping: Scalar | None  # [N m s/rad | N s/m]
    release_time: Scalar | None  # [s]
    on_motor: bool  # whose speed it acts on

    @property
    def is_rigid(self) -> bool:
        """True if it does not give way: at rest it is any torque up to the holding torque."""
        return self.stiffness is None


@dataclass(frozen=True, eq=False)
class Supply:
    """Supply of all drives. Equations in `actuators.supply`."""

    voltage: Scalar  # [V] without load
    resistance: Scalar  # of the source [Ω]
    capacitance: Scalar  # of the bus [F]
    chopper: tuple[Scalar, Scalar, Scalar] | None = None  # from [V], over [V], resistor [Ω]


@dataclass(frozen=True, eq=False)
class EfficiencyTable:
    """Efficiency of a gear by load and speed, constant beyond the ends. Equations in `actuators.gear`."""

    torques: tuple[Scalar, ...]  # that leave the gear, magnitudes [N m | N], increasing
    speeds: tuple[Scalar, ...]  # of the joint, magnitudes [rad/s | m/s], increasing, one a row; empty: one row for all
    # η where the motor drives [-], a row for each speed, a column for each torque
    driving: tuple[tuple[Scalar, ...], ...]
    driven_back: tuple[tuple[Scalar, ...], ...]  # η where the load drives


@dataclass(frozen=True, eq=False)
class Firmware:
    """The position loop of a servo. Equations in `actuators.firmware`."""

    period: float  # [s]
    every: int  # turns of the arm's fastest such loop from one of its own to the next
    count: Scalar | None  # [rad] of the encoder; None: it is exact
    output: Literal["duty", "current"]
    limit: Scalar  # of the output [1 | A]
    proportional: Scalar  # [1/rad | A/rad]
    integral: Scalar | None = None  # [1/(rad s) | A/(rad s)]; None: there is none
    derivative: Scalar | None = None  # [s/rad | A s/rad]
    dead_band: Scalar | None = None  # [rad]
    speed: Scalar | None = None  # of the goal [rad/s]; None: it jumps
    acceleration: Scalar | None = None  # of the goal [rad/s²]
    goals: tuple[float, float] | None = None  # [rad] within which they are followed
    latency: int = 0  # periods


@dataclass(frozen=True, eq=False)
class Drive:
    """Motor and gear of a joint. θ_motor = gear_ratio q; constants are DC-equivalent; None where the record is silent."""

    command: Literal["voltage", "current", "torque", "position"]
    gear_ratio: Scalar = 1.0  # n [motor rad / rad | rad/m], signed
    rotor_inertia: Scalar = 0.0  # J_m [kg m²], motor side
    efficiency: Scalar | EfficiencyTable | None = None  # η [-]; None: 1, no loss
    smoothing: Scalar | None = None  # speed over which the gear's loss is smoothed [rad/s | m/s]; None: it is not
    torque_constant: Scalar | None = None  # Kt [N m/A]
    back_emf_constant: Scalar | None = None  # Ke [V s/rad]
    resistance: Scalar | None = None  # R [Ω]
    inductance: Scalar | None = None  # L [H]
    current_loop: Scalar | None = None  # bandwidth of the current controller [Hz]
    coasts: bool = False  # the bridge opens while it is off, in place of shorting the motor
    dead_zone: Scalar | None = None  # commands within give no voltage [V]; None: no such zone
    thermal: Thermal | None = None
    cogging: Cogging | None = None
    firmware: Firmware | None = None  # what follows a command of position
    coupling: tuple[tuple[str, Scalar], ...] = ()  # other joints that turn the motor [motor rad / rad | rad/m]

    @property
    def bridge(self) -> Drive:
        """The drive behind a servo's loop, by voltages or currents; the drive itself without such a loop."""
        if self.firmware is None:
            return self
        return replace(self, command="voltage" if self.firmware.output == "duty" else "current", firmware=None)

    @property
    def armature(self) -> Scalar:
        """n² J_m: the rotor's inertia referred to the joint [kg m² | kg].

        Raises:
            ModelError: a motor that other joints turn as well, whose inertia is no number of one joint.
        """
        if self.coupling:
            raise ModelError(
                f"{self.coupling[0][0]!r} turns this motor too, so its inertia is between joints; `mass_matrix` has it",
                place="motor.coupling",
            )
        return self.reflected

    @property
    def joint_inertia(self) -> Scalar:
        """n² J_m of a motor that its joint alone turns, else 0 [kg m² | kg]."""
        return 0.0 if self.coupling else self.reflected

    @property
    def reflected(self) -> Scalar:
        """n² J_m of the motor's own gear ratio, without coupling [kg m² | kg]."""
        return self.gear_ratio * self.gear_ratio * self.rotor_inertia


@dataclass(frozen=True, eq=False)
class DriveLimits:
    """Limits of a joint and its drive; infinite where unknown."""

    position: tuple[float, float] = (-np.inf, np.inf)  # [rad | m]
    velocity: float = np.inf  # [rad/s | m/s]
    acceleration: float = np.inf  # [rad/s² | m/s²], of planned motions
    torque: float = np.inf  # motor torque referred to the joint [N m | N]
    voltage: float = np.inf  # [V]
    current: float = np.inf  # [A]
