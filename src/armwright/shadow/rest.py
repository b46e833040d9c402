"""Friction of joints at rest: a torque between bounds, of which nothing says where it is.

Each element k of friction acts on one speed s = row · q̇, a joint's or a motor's (wrists turn one motor by several joints), and
on the joints as rowᵀ F. While it slides, F is the model's f(s). At rest, and while its direction is not certain, F lies between
the bounds of the record: static levels of either direction, and what gears lose by their load in either direction. Without a
contact the torque that the model leaves unexplained is then in

    Σ rowᵀ (f - F)  =  centre ± width,     centre = Σ row (f - (F₊ + F₋)/2),     width = Σ |row| (F₊ - F₋)/2.

Of friction by loads each bound is at the motor torque that just moves the joint either way.

The bounds are those of the record's numbers SURE of their standard deviations away, to the side that widens them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.actuators.friction import by_loads, motor_friction
from armwright.actuators.gear import gear_loss, loses_power
from armwright.friction_laws import LAWS
from armwright.kernels.compiled import compile_arm
from armwright.model import Body, Friction, Model

SURE = 3.0  # standard deviations
LEVELS = ("coulomb_positive", "coulomb_negative", "stribeck_", "load_coefficient", "sigmoid_amplitude")
STRIBECK_SPEED = "stribeck_speed"
EFFICIENCY = "gear_efficiency"
SLOW = 1e-300  # [rad/s | m/s] a speed whose sign alone counts
LEAST = 0.5  # of an efficiency that is uncertain


@dataclass(frozen=True, eq=False)
class Resting:
    """Torques of joints whose friction is not certain, each (rows, n).

    Attributes:
        centre, width: [N m | N] what the model leaves unexplained without a contact, centre ± width.
        turning: True where a joint turns back, stops or starts; else it is at rest, or its friction is certain.
    """

    centre: np.ndarray
    width: np.ndarray
    turning: np.ndarray


@dataclass(frozen=True, eq=False)
class _Element:
    """Friction and gear loss at one speed, row · q̇ (n,).

    Attributes:
        friction: of the model and of the bounds.   gear: its motor and the joints of the model and of the bounds; None: no loss.
        on_motor: the friction is before the gear.   at_own_speed: it acts at another speed than the gear, whose load it changes.
    """

    row: np.ndarray
    friction: tuple[Friction | None, Friction | None]
    gear: tuple[int, Body, Body] | None = None
    on_motor: bool = False
    at_own_speed: bool = False


class RestingFriction:
    """Friction of an arm's joints at rest.

    Args:
        modelled: the arm as the observer has it.   whole: the arm with all of its friction; a log's torques may lack terms that
            hold a joint nevertheless.
        rest: [rad/s | m/s] slower is at rest.   turning: [s] by which a turn is near where |q̇| is below that times |q̈|.
    """

    def __init__(self, modelled: Model, whole: Model, rest: float, turning: float):
        self._rest, self._turning = rest, turning
        self._elements = _elements(modelled, widened(whole), motor_shares(modelled))
        loaded = any(map(by_loads, (*modelled.coordinates, *whole.coordinates)))
        self._free = compile_arm(modelled.replace(friction=None)) if loaded else None
        self._rows = np.array([each.row for each in self._elements]).reshape(-1, modelled.n)

    def of(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, motors: np.ndarray) -> Resting:
        """Torques at rest along rows.

        Args:
            q, qd, qdd: (rows, n) filtered.   motors: (rows, n) [N m | N] the model's torques of the motors there.
        """
        external = np.zeros_like(qd) if self._free is None else -self._free.bias_torques(q, qd)
        speeds, rates = (np.einsum("kj,ej->ke", each, self._rows) for each in (qd, qdd))  # (rows, elements)
        size, change = np.abs(speeds), self._turning * np.abs(rates)
        turns = size < change
        uncertain = turns | (size < self._rest)
        turns &= change >= self._rest  # else it stays at rest, and what shakes there is noise
        middles, widths = np.zeros_like(speeds), np.zeros_like(speeds)
        for k in np.flatnonzero(uncertain.any(axis=0)):
            where = uncertain[:, k]
            each = self._elements[k]
            value, low, high = self._bounds(each, speeds[where, k], rates[where, k], motors[where], external[where])
            middles[where, k], widths[where, k] = value - 0.5 * (low + high), 0.5 * (high - low)
        turning = (turns @ (self._rows != 0.0)).astype(bool)
        return Resting(_on_joints(middles, self._rows), _on_joints(widths, np.abs(self._rows)), turning)

    def _bounds(
        self, each: _Element, speed: np.ndarray, rate: np.ndarray, motors: np.ndarray, external: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """The model's f, and the bounds F₋ and F₊ (rows,) [N m | N]."""
        value, low, high = np.zeros((3, len(speed)))
        modelled, bounds = each.friction
        if bounds is not None and LAWS[bounds.law].by_loads:
            joint = int(np.flatnonzero(each.row)[0])
            return _by_loads(modelled, bounds, speed, (motors[:, joint], external[:, joint]))
        if modelled is not None:
            value = value + LAWS[modelled.law].add(0.0, modelled, speed, None, None)
        if bounds is not None:
            backward, forward = LAWS[bounds.law].holding(bounds)
            low, high = low + backward, high + forward
        if each.gear is None:
            return value, low, high
        motor, body, wide = each.gear
        entering = motors[:, motor] - motor_friction(body, speed) - body.drive.reflected * rate
        loss = gear_loss(body.drive, speed, body.friction)
        leaving = entering if loss is None else loss.output(entering)
        if each.at_own_speed:
            ends = [leaving, leaving + (low - high), leaving + (high - low)]
            lost = _lost(wide, ends, ends)
            return entering - leaving, lost.min(axis=0), lost.max(axis=0)
        if each.on_motor:
            lost = _lost(wide, [leaving], [leaving])
            return value + entering - leaving, low + lost.min(axis=0), high + lost.max(axis=0)
        load = leaving - value
        both = _lost(wide, [load + low, load + high], [load, load])
        return entering - load, both.min(axis=0), both.max(axis=0)


def _by_loads(
    modelled: Friction | None, bounds: Friction, speed: np.ndarray, loads: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, ...]:
    """The model's f, and the bounds (rows,) [N m | N] of friction by loads, at torques (rows,) of the model's motor and τ_e."""
    motor, external = loads
    value = np.zeros_like(speed)
    if modelled is not None:
        value = LAWS[modelled.law].add(value, modelled, speed, loads, None)
    needed, dry = motor - value, replace(bounds, smoothing=None)
    low, high = (
        LAWS[bounds.law].motor_torque(dry, np.full_like(speed, way), needed, external) - needed for way in (-SLOW, SLOW)
    )
    return value, low, high


def _lost(body: Body, leaving: list[np.ndarray], less: list[np.ndarray]) -> np.ndarray:
    """Torques that enter a gear, at rest and either way, for those that leave it, less others: (3 loads, rows) [N m | N]."""
    drive = replace(body.drive, smoothing=None)
    ways = [gear_loss(drive, 0.0, body.friction, way) for way in (-1.0, 0.0, 1.0)]
    return np.array(
        [
            (out if way is None else way.input(out)) - other
            for out, other in zip(leaving, less, strict=True)
            for way in ways
        ]
    )


def _on_joints(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Σ row value (rows, n) of values (rows, elements); equal bits for one row and many, unlike a product of BLAS."""
    return np.einsum("ke,ej->kj", values, rows)


def _elements(modelled: Model, bounds: Model, shares: np.ndarray) -> list[_Element]:
    """All elements; the friction of joints that follow others acts on those."""
    elements, own = [], np.eye(modelled.n)
    for k, (body, wide) in enumerate(zip(modelled.coordinates, bounds.coordinates, strict=True)):
        friction, pair = wide.friction or body.friction, (body.friction, wide.friction)
        gear = (k, body, wide) if loses_power(body) or loses_power(wide) else None
        on_motor = friction is not None and friction.on_motor
        at_own_speed = gear is not None and not on_motor and bool(body.drive.coupling)
        if friction is not None and (gear is None or at_own_speed):
            elements.append(_Element(shares[k] if on_motor else own[k], pair))
        if gear is not None:
            elements.append(
                _Element(shares[k], (None, wide.friction) if at_own_speed else pair, gear, on_motor, at_own_speed)
            )
    if modelled.mimics is not None:
        rows = zip(
            modelled.mimics.coordinate, modelled.mimics.factor, modelled.tree.bodies, bounds.tree.bodies, strict=True
        )
        for k, factor, body, wide in rows:
            if body.joint not in modelled.names and (body.friction or wide.friction) is not None:
                elements.append(_Element(float(factor) * own[k], (body.friction, wide.friction)))
    return elements


def widened(arm: Model) -> Model:
    """The arm with friction and losses SURE of their standard deviations above the record's; itself if it states none."""
    if arm.description is None:
        return arm
    values = {}
    for each in arm.parameters:
        key = each.name.rsplit(".", 1)[-1]
        if each.std and key.startswith(LEVELS) and not key.startswith(STRIBECK_SPEED):
            values[each.name] = each.value + SURE * each.std
        elif each.std and key == EFFICIENCY:
            values[each.name] = max(each.value - SURE * each.std, LEAST * each.value)
    return arm.with_values(values) if values else arm
