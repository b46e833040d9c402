"""Units of a joint's coordinate, an angle or a length: in texts, and as endings of keys in files."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Literal

Dimension = Literal[
    "position", "speed", "acceleration", "torque", "slope", "stiffness", "damping", "cubic", "per torque", "number"
]
ENDINGS: dict[Dimension, str] = {  # of keys, by the endings of a position and of a torque or force; the longest first
    "cubic": "{torque}_per_{position}3",
    "damping": "{torque}_s_per_{position}",
    "stiffness": "{torque}_per_{position}",
    "slope": "s_per_{position}",
    "per torque": "per_{torque}",
    "acceleration": "{position}_per_s2",
    "speed": "{position}_per_s",
    "torque": "{torque}",
    "position": "{position}",
    "number": "",
}


@dataclass(frozen=True)
class JointUnits:
    """Units of a joint whose coordinate is an angle or a length.

    Attributes:
        linear: whether it is a length.   position, torque, inertia: as texts show them.   endings: of keys, by dimension.
        effort: "torque" or "force".   half_range: [rad | m] to either side, what is drawn or sampled of a joint without limits.
    """

    linear: bool
    position: str
    torque: str
    inertia: str
    endings: dict[Dimension, str]
    effort: str
    half_range: float

    @property
    def whole(self) -> float:
        """A whole turn [rad], or a metre [m]."""
        return 2.0 * self.half_range

    @property
    def speed(self) -> str:
        """Unit of a speed: "rad/s" or "m/s"."""
        return f"{self.position}/s"

    @property
    def acceleration(self) -> str:
        """Unit of an acceleration: "rad/s²" or "m/s²"."""
        return f"{self.position}/s²"

    def key(self, stem: str, dimension: Dimension) -> str:
        """A key with its unit: `ROTARY.key("holding_torque", "torque")` → "holding_torque_n_m", `LINEAR` → "holding_force_n"."""
        return f"{stem.replace('torque', self.effort)}_{self.endings[dimension]}".rstrip("_")

    def renamed(self, key: str) -> str:
        """A rotary key in these units: `LINEAR.renamed("damping_n_m_s_per_rad")` → "damping_n_s_per_m"."""
        for dimension, ending in ROTARY.endings.items():
            if ending and key.endswith(f"_{ending}"):
                return self.key(key.removesuffix(f"_{ending}"), dimension)
        return key


def _endings(position: str, torque: str) -> dict[Dimension, str]:
    return {dimension: form.format(position=position, torque=torque) for dimension, form in ENDINGS.items()}


ROTARY = JointUnits(False, "rad", "N m", "kg m²", _endings("rad", "n_m"), "torque", pi)
LINEAR = JointUnits(True, "m", "N", "kg", _endings("m", "n"), "force", 0.5)
UNITS = {False: ROTARY, True: LINEAR}  # by whether the coordinate is a length
