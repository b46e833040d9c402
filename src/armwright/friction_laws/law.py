"""A friction law: its equation, its keys in files, and all that other rooms do because of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar, Literal

import numpy as np

from armwright import scalar
from armwright.friction_laws.levels import dry_level, static_levels
from armwright.joint_kinds import Dimension
from armwright.scalar import Scalar

# Torques of the motor and of all else that depends on the state alone; positive, they push forward.
Loads = tuple[Scalar, Scalar]


@dataclass(frozen=True)
class OwnKey:
    """A number that only one law has.

    Attributes:
        stem: its key without unit.   dimension: of its unit.   about: its description.
        takes: numbers that it may have.   linear: whether friction is linear in it: a column of `regressor_drive`.
        start: where a fit begins, from the mean torque and the largest speed of a log; None: no fit tries the law.
        low: the lower bound of a fit.
    """

    stem: str
    dimension: Dimension
    about: str
    takes: Literal["Number", "NotNegative", "Positive"] = "Number"
    linear: bool = False
    start: Any = None
    low: float = -inf


class FrictionLaw:
    """A friction law, beside viscous friction and an offset, which all have.

    Attributes:
        name: its `law` in robot files.   equation: for the reference.   own: the keys that only it has, and needs.
        dry: Coulomb's and Stribeck's levels: "allowed", "needed" (Coulomb's, above 0), or "none".
        smoothed: whether it needs a smoothing speed; others take sgn q̇ without one.
        sticks: whether, without a smoothing speed, it is any torque within its levels at rest, which the simulator solves for.
        bristles: whether the simulator has bristles as a state of the joint (`actuators.lugre`), which hold it at rest.
        by_loads: whether its level depends on `Loads`, and on a Stribeck speed: it has `motor_torque`. Of all others the load is
            the torque through the gear, where it is known.
        bends: whether its slope jumps where a joint turns back, so that steps end there.
        feature: what notes and the table of features call it; "": no name.
        lost: what a URDF or an MJCF does not have of it, in words; "": nothing beside its levels.
        step_limits: numbers of `own` that may make the step small: (what notes say, the key to change, the number scaled).
    """

    name: ClassVar[str]
    equation: ClassVar[str]
    own: ClassVar[tuple[OwnKey, ...]] = ()
    dry: ClassVar[Literal["allowed", "needed", "none"]] = "allowed"
    smoothed: ClassVar[bool] = False
    sticks: ClassVar[bool] = False
    bristles: ClassVar[bool] = False
    by_loads: ClassVar[bool] = False
    bends: ClassVar[bool] = False
    feature: ClassVar[str] = ""
    lost: ClassVar[str] = ""
    step_limits: ClassVar[tuple[tuple[str, int, int], ...]] = ()

    def level(
        self,
        friction: Any,
        speed: Scalar,
        load: Loads | Scalar | None = None,
        warming: Scalar | None = None,
        direction: Scalar | None = None,
    ) -> Scalar:
        """Level of dry friction [N m | N], above 0; arguments as of `levels.dry_level`, or `Loads` for the load."""
        assert not isinstance(load, tuple)
        return dry_level(friction, speed, load, warming, direction)

    def add(
        self, torque: Scalar, friction: Any, speed: Scalar, load: Loads | Scalar | None, warming: Scalar | None
    ) -> Scalar:
        """The torque with the law's added to viscous friction and offset [N m | N].

        Args:
            friction: numbers referred to the joint, as `armwright.model.Friction`; `parameters` are the law's own.
            speed: [rad/s | m/s].   load: [N m | N], or `Loads`, and warming: [K], where they are known.
        """
        raise NotImplementedError

    def motor_torque(self, friction: Any, speed: Scalar, needed: Scalar, external: Scalar) -> Scalar:
        """Torque of the motor [N m | N] of a law `by_loads`, that with its own dry friction leaves the torque `needed`."""
        raise NotImplementedError

    def steep(self, friction: Any) -> tuple[Scalar, Scalar]:
        """Middle and half width [rad/s | m/s] of the speeds, beside standstill, where it is steepest."""
        return 0.0, 1.0

    def holding(self, friction: Any) -> tuple[Scalar, Scalar]:
        """Torques [N m | N], negative and positive, between which it holds a joint at rest, without load."""
        return static_levels(friction)

    def falling(self, friction: Any, load: Loads | Scalar | None = None) -> Scalar:
        """Torque [N m | N] by which its level at rest is above that of fast sliding, at least 0."""
        if friction.stribeck is None:
            return 0.0
        least = scalar.minimum(friction.coulomb_positive, friction.coulomb_negative)
        return scalar.maximum(friction.stribeck - least, 0.0)

    def fitted(self, values: Mapping[str, float], speed: np.ndarray) -> np.ndarray:
        """Torques (k,) [N m | N] at speeds with fitted values by stem; of a law whose own keys all have a `start`."""
        raise NotImplementedError

    @property
    def is_candidate(self) -> bool:
        """True if `identify_friction` tries the law in place of Coulomb's."""
        return bool(self.own) and all(key.start is not None for key in self.own)
