"""Joints and motors that stick: dry friction, brakes and lossy gears as sets, solved for the speeds at the end of a step.

Each torque y that jumps where a speed s = row · v passes through 0 is any value between its limits there, and decreases with s:

    M (v⁺ - v)/h + b = Σ rowᵀ y(s⁺),     y = y₊(s) where s > 0,   y = y₋(s) where s < 0,   y₊(0) ≤ y ≤ y₋(0) where s = 0.

So v⁺ is where a strictly convex function of v⁺ is least: there is one, and it sticks where the torque that holds lies within the
limits.  [Moreau1988] [StewartTrinkle1996] The jump is drawn as a line steep enough to be one, which makes this the problem of
lossy gears: Newton's method with an exact line search finds v⁺ (`dynamics.gears`). Elements that end on the steep line stick,
and their speeds are then exactly 0.

Between changes, directions of motion are held: what slides feels y of its direction, what sticks has no acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armwright import scalar
from armwright.actuators.gear import GearLoss
from armwright.dynamics.gears import Gear, linearised, solved, through_gears
from armwright.scalar import Array, Scalar

STEEP = 1e9  # of what inertia asks for: a joint that sticks would give way by that part of what the load would move it
# Of the inertia: added where one speed sticks, or a sum of speeds, whose digits it costs.
HELD, HELD_TOGETHER = 1e20, 1e8
# solves: of 7·10⁵ adversarial states five end after 12, by 14, and six stand at the limit, one of them marked
MOST = 24
NEVER = 1e30  # [rad/s | m/s] of a jump that is not reached
MULTIPLIERS = 3
REST = 1e-14  # of the speeds in a sum of speeds: rounding of one that sticks

Row = list[tuple[int, Scalar]]  # of B or its inverse: places among the speeds, and their factors


@dataclass(frozen=True, eq=False)
class BrokenLine(GearLoss):
    """An increasing function that is linear between knots, y = slope t + offset, with a slope so steep that it is a jump."""

    offsets: tuple[Scalar, ...] = ()

    @property
    def jumps(self) -> bool:
        """True."""
        return True

    def packed(self) -> list[Scalar]:
        """Its numbers, for `unpacked`."""
        return [*self.knots, *self.slopes, *self.offsets]

    def unpacked(self, values: Array) -> BrokenLine:
        """The function with other numbers."""
        k = len(self.knots)
        return BrokenLine(tuple(values[:k]), tuple(values[k : 2 * k + 1]), tuple(values[2 * k + 1 :]))

    def flat(self, where: Scalar) -> BrokenLine:
        """The function, or 0 everywhere."""
        return BrokenLine(
            self.knots,
            tuple(scalar.where(where, 0.0, slope) for slope in self.slopes),
            tuple(scalar.where(where, 0.0, offset) for offset in self.offsets),
        )

    @property
    def _offsets(self) -> list[Scalar]:
        return list(self.offsets)


@dataclass(frozen=True, eq=False)
class Side:
    """Torque of a drive that moves in one direction:  y = G(entering - D ẇ) - resisting  [N m | N]."""

    entering: Scalar
    resisting: Scalar
    loss: GearLoss | None

    @property
    def standing(self) -> Scalar:
        """y of a drive without acceleration."""
        return (self.entering if self.loss is None else self.loss.output(self.entering)) - self.resisting

    def lines(self, inertia: Scalar, speed: Scalar, h: Scalar) -> tuple[list[Scalar], list[tuple[Scalar, Scalar]]]:
        """Knots of y in t = -s⁺, and slopes and offsets of its lines, for a rotor that had `speed` h seconds before."""
        if self.loss is None or (not scalar.is_symbolic(inertia) and inertia == 0.0):
            return [], [(0.0, self.standing)]
        rate = inertia / h
        standing = self.entering + rate * speed
        return (
            [(knot - standing) / rate for knot in self.loss.knots],
            [(slope * rate, slope * standing + offset - self.resisting) for slope, offset in self.loss.lines],
        )


@dataclass(frozen=True, eq=False)
class DryElement:
    """Dry elements at one speed, of a joint or of a motor: torques that jump at speed 0.

    Attributes:
        row: the speed by those of the coordinates.   inertia: D of a rotor before a lossy gear [kg m² | kg], else 0.
        forward, backward: the torque for either direction.
    """

    row: Row
    inertia: Scalar
    forward: Side
    backward: Side

    def jump(self, speed: Scalar, h: Scalar, stiffness: Scalar, place: Scalar) -> TorqueJump:
        """The element as Newton's method takes it, by the speed after the step.

        Args:
            speed: before the step of h.   stiffness: of the steep line [N m s/rad | N s/m].
            place: of the jump in t = -s⁺: 0, or ± `NEVER` of an element that keeps its direction.
        """
        (knots, forward), (others, backward) = (
            side.lines(self.inertia, speed, h) for side in (self.forward, self.backward)
        )
        low, high = _value(knots, forward), _value(others, backward)
        width = scalar.where(scalar.equal(place, 0.0), 0.5 * (high - low) / stiffness, 0.0)
        begins, ends = place - width, place + width
        middle = 0.5 * (high + low) - stiffness * place
        lines = [  # each side's lines meet the steep one where it ends
            *((slope, offset + slope * width) for slope, offset in forward),
            (stiffness, middle),
            *((slope, offset - slope * width) for slope, offset in backward),
        ]
        bends = [
            *(scalar.minimum(knot - width, begins) for knot in knots),
            begins,
            ends,
            *(scalar.maximum(knot + width, ends) for knot in others),
        ]
        slopes, offsets = zip(*lines, strict=True)
        return TorqueJump(self.row, BrokenLine(tuple(bends), slopes, offsets), begins, ends)


@dataclass(frozen=True, eq=False)
class TorqueJump:
    """An element as a lossy gear without a rotor, entered by t = -s⁺."""

    row: Row
    line: BrokenLine
    begins: Scalar  # of the steep line [rad/s | m/s]
    ends: Scalar

    @property
    def gear(self) -> Gear:
        """The gear."""
        return Gear(self.row, 1.0, 0.0, self.line)

    def sticks(self, speeds: Array) -> Scalar:
        """1 where the element is on the steep line."""
        t = -at_row(self.row, speeds)
        return scalar.less_equal(self.begins, t) * scalar.less(t, self.ends)

    def sliding(self, sticks: Scalar) -> Gear:
        """The gear, without torque where the element sticks."""
        return Gear(self.row, 1.0, 0.0, self.line.flat(sticks))


def _value(knots: Sequence[Scalar], lines: Sequence[tuple[Scalar, Scalar]]) -> Scalar:
    """y at t = 0."""
    value = lines[0][1]
    for knot, (_, offset) in zip(knots, lines[1:], strict=True):
        value = scalar.where(scalar.less(0.0, knot), value, offset)
    return value


def at_row(row: Row, values: Array) -> Scalar:
    """row · values."""
    return sum(factor * values[j] for j, factor in row)


def at_rest(row: Row, speeds: Array) -> Scalar:
    """1 where the speed of a row is 0, of a sum of speeds to rounding."""
    speed = at_row(row, speeds)
    if len(row) == 1:
        return scalar.equal(speed, 0.0)
    return scalar.less_equal(scalar.abs(speed), REST * sum(scalar.abs(factor * speeds[j]) for j, factor in row))


def next_speeds(
    mass: Array, bias: Array, speeds: Array, h: Scalar, elements: Sequence[DryElement], gears: Sequence[Gear] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds after a step, and the directions in which elements move in it.

    Args:
        mass: (n, n) without the rotors of elements and gears.   bias: (n,) [N m | N] what resists, less what drives.
        speeds: (n,) [rad/s | m/s] before the step.   h: () [s].   elements: all that may stick.   gears: lossy ones that may not.
    Returns:
        speeds: (n,) after the step, those of elements that stick exactly 0 where they are one of the n; NaN where `MOST`
            solves do not end it.
        directions: (elements,) the sign of a speed that is not 0 before the step; else 1, -1, or 0: it sticks.
    """
    after, at_end = _after(mass, bias, speeds, h, elements, gears, [0.0] * len(elements))
    directions = [
        scalar.where(at_rest(each.row, speeds), moves, scalar.sign(at_row(each.row, speeds)))
        for each, moves in zip(elements, at_end, strict=True)
    ]
    return after, scalar.array(directions)


def present_directions(
    mass: Array, bias: Array, speeds: Array, elements: Sequence[DryElement], gears: Sequence[Gear] = ()
) -> np.ndarray:
    """Directions (elements,) of a state: signs of the speeds; at rest that of the acceleration, 0 where the element sticks.

    The same problem for accelerations: those that move keep their directions. Arguments as of `next_speeds`.
    """
    signs = [scalar.where(at_rest(each.row, speeds), 0.0, scalar.sign(at_row(each.row, speeds))) for each in elements]
    places = [NEVER * sign for sign in signs]
    _, begins = _after(mass, bias, scalar.zeros(len(bias)), 1.0, elements, gears, places)
    return scalar.array([scalar.where(sign, sign, moves) for sign, moves in zip(signs, begins, strict=True)])


def _after(
    mass: Array, bias: Array, speeds: Array, h: Scalar, elements: Sequence[DryElement], gears: Sequence[Gear],
    places: Sequence[Scalar],
) -> tuple[np.ndarray, list[Scalar]]:  # fmt: skip
    """Speeds after a step of h, and the direction of each element then; NaN where the solves did not end it."""
    matrix, right, jumps, gears = as_gears(mass, bias, speeds, h, elements, gears, places)
    pieces = [*(jump.gear for jump in jumps), *gears]
    near, _, ended = solved(matrix, right, pieces, speeds, MOST)
    sticks = [jump.sticks(near) for jump in jumps]
    # What sticks is held instead, exactly.
    sliding = [jump.sliding(stuck) for jump, stuck in zip(jumps, sticks, strict=True)]
    rows = [each.row for each in elements]
    after, _ = _held(*linearised(matrix, right, [*sliding, *gears], near), rows, sticks)
    backward = [scalar.less(at_row(row, near), 0.0) for row in rows]
    directions = [
        scalar.where(stuck, 0.0, scalar.where(back, -1.0, 1.0)) for stuck, back in zip(sticks, backward, strict=True)
    ]
    return scalar.array(scalar.where(ended, after, np.nan)), [scalar.where(ended, way, np.nan) for way in directions]


def as_gears(
    mass: Array, bias: Array, speeds: Array, h: Scalar, elements: Sequence[DryElement], gears: Sequence[Gear],
    places: Sequence[Scalar],
) -> tuple[np.ndarray, np.ndarray, list[TorqueJump], list[Gear]]:  # fmt: skip
    """The problem as one of lossy gears, with speeds in place of accelerations: matrix, bias, jumps, and other gears."""
    matrix = scalar.array(mass / h)
    jumps = []
    for each, place in zip(elements, places, strict=True):
        inertia = sum(factor * factor * matrix[j, j] for j, factor in each.row) + each.inertia / h
        stiffness = STEEP * inertia
        jumps.append(each.jump(at_row(each.row, speeds), h, stiffness, place))
    turned = []
    for gear in gears:
        inertia = gear.inertia / h
        turned.append(replace(gear, inertia=inertia, torque=gear.torque + inertia * gear.turned(speeds)))
    return matrix, scalar.array(bias - matrix @ speeds), jumps, turned


def held_accelerations(
    mass: Array, bias: Array, gears: Sequence[Gear], rows: Sequence[Row], directions: Array
) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations with given directions of motion:  M q̈ + b = Σ Bᵢᵀ Gᵢ + Σ rowᵀ λ,  row · q̈ = 0 for direction 0.

    Args:
        mass, bias, gears: as `gears.through_gears`.   rows: of the elements.   directions: (elements,) 0: it sticks.
    Returns:
        qdd: (n,) [rad/s² | m/s²], exactly 0 where one speed sticks.   torques: (elements,) λ, 0 for those that slide [N m | N].
    """
    sticks = [scalar.equal(direction, 0.0) for direction in directions]
    if not gears:
        return _held(mass, -bias, rows, sticks)
    near, _ = through_gears(_stiffened(mass, rows, sticks)[0], bias, gears)
    return _held(*linearised(mass, bias, gears, near), rows, sticks)


def _held(matrix: Array, right: Array, rows: Sequence[Row], sticks: Sequence[Scalar]) -> tuple[np.ndarray, np.ndarray]:
    """x (n,) of  A x = right + Σ rowᵀ λ  with row · x = 0 where a row sticks, and λ there, else 0.

    By stiff springs; where rows are sums, λ in steps that leave ever less of  row · x  (the method of multipliers).
    """
    stiff, stiffness = _stiffened(matrix, rows, sticks)
    factors = scalar.factor_symmetric(stiff)
    x = scalar.solve_factored(factors, right)
    torques = [-added * at_row(row, x) for row, added in zip(rows, stiffness, strict=True)]
    if any(len(row) > 1 for row in rows):
        for _ in range(MULTIPLIERS):
            push = scalar.zeros(len(x))
            for row, added in zip(rows, stiffness, strict=True):
                for j, factor in row if len(row) > 1 else ():
                    push[j] = push[j] - factor * (added * at_row(row, x))
            x = x + scalar.solve_factored(factors, push)
            torques = [
                torque - added * at_row(row, x) if len(row) > 1 else -added * at_row(row, x)
                for row, added, torque in zip(rows, stiffness, torques, strict=True)
            ]
        size = [scalar.abs(value) / matrix[j, j] for j, value in enumerate(right)]
        most = sum(size)
        x = scalar.array([scalar.where(scalar.less(scalar.abs(value), REST * most), 0.0, value) for value in x])
    return stopped(rows, sticks, x), scalar.array(torques)


def _stiffened(matrix: Array, rows: Sequence[Row], sticks: Sequence[Scalar]) -> tuple[np.ndarray, list[Scalar]]:
    """A + Σ rowᵀ k row (n, n) over the rows that stick, and all k, 0 for the others."""
    stiff, stiffness = np.array(matrix, dtype=object), []
    for row, stuck in zip(rows, sticks, strict=True):
        most = HELD if len(row) == 1 else HELD_TOGETHER
        added = most * sum(factor * factor * matrix[j, j] for j, factor in row) * stuck
        stiffness.append(added)
        for i, a in row:
            for j, b in row:
                stiff[i, j] = stiff[i, j] + a * b * added
    return scalar.array(stiff), stiffness


def stopped(rows: Sequence[Row], sticks: Sequence[Scalar], values: Array) -> np.ndarray:
    """Speeds or accelerations (n,) with 0 for those of the n that stick."""
    still = list(values)
    for row, stuck in zip(rows, sticks, strict=True):
        if len(row) == 1:
            j = row[0][0]
            still[j] = scalar.where(stuck, 0.0, still[j])
    return scalar.array(still)
