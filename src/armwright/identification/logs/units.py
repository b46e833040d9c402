"""Quantities of a log, and the units that their columns may have."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

ALIASES = {
    "Nm": "N m", "mNm": "mN m", "kNm": "kN m", "°": "deg", "°/s": "deg/s", "°/s²": "deg/s²", "degrees": "deg",
    "1/min": "rpm", "min⁻¹": "rpm", "min^-1": "rpm", "min-1": "rpm", "r/min": "rpm", "rev/min": "rpm", "U/min": "rpm",
    "rev": "turn", "rev/s": "turn/s", "degC": "°C", "celsius": "°C", "kelvin": "K",
    "rad/s2": "rad/s²", "rad/s^2": "rad/s²", "deg/s2": "deg/s²", "deg/s^2": "deg/s²", "m/s2": "m/s²", "m/s^2": "m/s²",
}  # fmt: skip
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}  # unit → seconds
COUNTS = ("counts", "counts/s")  # of an encoder; need counts_per_turn
ZERO = {"K": -273.15}  # unit → its zero, in °C
SHARES = {"%": 0.01, "permille": 0.001}  # of a rated value, as drives report torque and current; need `rated`
_TURN = {"rad": 1.0, "deg": pi / 180, "turn": 2 * pi, "counts": 2 * pi}
_LENGTH = {"m": 1.0, "mm": 1e-3}


@dataclass(frozen=True)
class QuantityKind:
    """A quantity of a log.

    Attributes:
        signal: its name in the log's data.   turning: unit → rad, rad/s, N m, A, V; of counts: of one turn.
        sliding: unit → m, m/s, N, on the joint side of a slide.   sided: motor and joint side differ.
        unit, sliding_unit: in the log's data.
    """

    signal: str
    about: str
    unit: str
    turning: dict[str, float]
    sliding: dict[str, float]
    sliding_unit: str
    sided: bool = True

    @property
    def units(self) -> tuple[str, ...]:
        """All valid units of a column."""
        return tuple(dict.fromkeys((*self.turning, *self.sliding)))


def _per_second(units: dict[str, float], ending: str) -> dict[str, float]:
    return {f"{unit}{ending}": factor for unit, factor in units.items()}


_TORQUE = {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3, **SHARES}
_FORCE = {"N": 1.0, "kN": 1e3, **SHARES}
_CURRENT = {"A": 1.0, "mA": 1e-3, **SHARES}
_VOLTAGE = {"V": 1.0, "mV": 1e-3, **SHARES}
_TEMPERATURE = {"°C": 1.0, "K": 1.0}
_ACCELERATION = _per_second({unit: factor for unit, factor in _TURN.items() if unit in ("rad", "deg")}, "/s²")

QUANTITIES = {
    "position": QuantityKind("q", "joint position", "rad", _TURN, _LENGTH, "m"),
    "speed": QuantityKind(
        "qd", "joint velocity", "rad/s", {**_per_second(_TURN, "/s"), "rpm": pi / 30}, _per_second(_LENGTH, "/s"), "m/s"
    ),
    "acceleration": QuantityKind(
        "qdd", "joint acceleration", "rad/s²", _ACCELERATION, _per_second(_LENGTH, "/s²"), "m/s²"
    ),
    "torque": QuantityKind("tau", "motor torque referred to the joint", "N m", _TORQUE, _FORCE, "N"),
    "link torque": QuantityKind(
        "tau_link", "torque behind the gear, as a joint torque sensor reads it", "N m", _TORQUE, _FORCE, "N"
    ),
    "current": QuantityKind("current", "motor current", "A", _CURRENT, _CURRENT, "A", sided=False),
    "voltage": QuantityKind("voltage", "motor voltage", "V", _VOLTAGE, _VOLTAGE, "V", sided=False),
    "temperature": QuantityKind(
        "temperature", "temperature of the motor", "°C", _TEMPERATURE, _TEMPERATURE, "°C", sided=False
    ),
}
OF_SIGNAL = {kind.signal: kind for kind in QUANTITIES.values()}


def plain_unit(unit: str) -> str:
    """Armwright's spelling of a unit: `Nm` → `N m`."""
    text = " ".join(unit.split())
    return ALIASES.get(text, text)
