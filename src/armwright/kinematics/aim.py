"""Part of a pose that counts: the position, with all, a part or nothing of the orientation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.scalar import Array

AXES = "xyz"
DEFAULTS = {"axis": "z", "pitch": "z", "yaw": "x"}  # axis of the frame where the word names none
EXPECTED = (
    "'pose', 'position', 'axis', 'pitch' or 'yaw' (of z, z and x; of others 'axis x', 'pitch y', …), "
    "or the axes about which the rotation counts: 'base xy', 'tool z'"
)
VERTICAL = 1e-9  # sine of the angle to base z below which a horizontal direction is undefined


@dataclass(frozen=True)
class Aim:
    """Part of a pose that counts; `str` gives it as a word.

    With R the frame's rotation and R* its target's, the position counts, and of the rotation:

        pose: R = R*.   position: nothing.   axis k: R k = R* k; in the base Rᵀ k = R*ᵀ k.
        pitch k: the angle of R k to the base's xy plane.   yaw k: the direction of R k seen along the base's z axis.
        twist k: R* Rᵀ, or in the frame Rᵀ R*, turns about an axis without component along k.

    Attributes:
        kind: which of these.   axis: k, 0 to 2.   base: True if k is an axis of the base, False of the frame.
    """

    kind: Literal["pose", "position", "axis", "pitch", "yaw", "twist"] = "pose"
    axis: int = 0
    base: bool = False

    @classmethod
    def of(cls, value: Any) -> Aim:
        """The aim that a word names, such as "axis", "pitch x", "base xy".

        Raises:
            ModelError: no such word; says which there are.
        """
        if isinstance(value, cls):
            return value
        word, _, rest = value.partition(" ") if isinstance(value, str) else ("", "", "")
        if word in ("pose", "position") and not rest:
            return cls(word)  # type: ignore[arg-type]
        if word in DEFAULTS and (rest or DEFAULTS[word]) in AXES and len(rest) < 2:
            return cls(word, AXES.index(rest or DEFAULTS[word]))  # type: ignore[arg-type]
        counted = [k for k, name in enumerate(AXES) if name in rest]
        if word not in ("base", "tool") or not rest or len(counted) != len(rest):
            raise ModelError(place="aim", value=value, expected=EXPECTED)
        if len(counted) == 3:
            return cls()
        if len(counted) == 2:  # free about the third axis
            return cls("axis", 3 - sum(counted), word == "base")
        return cls("twist", counted[0], word == "base")

    @property
    def others(self) -> tuple[int, int]:
        """The two axes that are not k, in order."""
        return tuple(k for k in range(3) if k != self.axis)  # type: ignore[return-value]

    @property
    def counted(self) -> int:
        """Number of turns, of three, that count."""
        return {"pose": 3, "position": 0, "axis": 2}.get(self.kind, 1)

    def __str__(self) -> str:
        if self.kind in ("pose", "position"):
            return self.kind
        if self.kind == "twist":
            return f"{'base' if self.base else 'tool'} {AXES[self.axis]}"
        if self.base:
            return "base " + "".join(AXES[k] for k in self.others)
        return self.kind if AXES[self.axis] == DEFAULTS[self.kind] else f"{self.kind} {AXES[self.axis]}"


POSE, POSITION = Aim("pose"), Aim("position")


def turning_rows(aim: Aim, rotation: Array) -> np.ndarray:
    """Rows (m, 3) of the turns, in base axes, that change what counts of a rotation R (3, 3).

    m = 3 of a pose, 2 of an axis, 1 of pitch, yaw and twist, 0 of a position.
    """
    axes = np.eye(3) if aim.base or aim.kind == "pose" else np.asarray(rotation)
    if aim.kind == "pose":
        return axes
    if aim.kind == "axis":
        return scalar.stack([axes[:, k] for k in aim.others])
    if aim.kind == "twist":
        return scalar.stack([axes[:, aim.axis]])
    if aim.kind == "pitch":
        return scalar.stack([horizontal_normal(axes[:, aim.axis])])
    return scalar.stack([yaw_row(axes[:, aim.axis])]) if aim.kind == "yaw" else scalar.zeros(0, 3)


def horizontal_normal(direction: Array) -> np.ndarray:
    """Axis (3,) normal to a direction (3,) and to base z, about which a turn changes the direction's angle to base z.

    n = z × t / |z × t|; the base's y axis where t is vertical.
    """
    x, y = direction[0], direction[1]
    length = scalar.sqrt(x * x + y * y)
    upright = scalar.less(length, VERTICAL)
    scale = 1.0 / scalar.maximum(length, VERTICAL)
    return scalar.array([scalar.where(upright, 0.0, -y * scale), scalar.where(upright, 1.0, x * scale), 0.0])


def yaw_row(direction: Array) -> np.ndarray:
    """Change (3,) of a direction's angle about base z by turns about the base's axes.

    dψ = ω_z - t_z (t_x ω_x + t_y ω_y) / (t_x² + t_y²)
    """
    x, y, z = direction
    slope = z / scalar.maximum(x * x + y * y, VERTICAL)
    return scalar.array([-x * slope, -y * slope, 1.0])
