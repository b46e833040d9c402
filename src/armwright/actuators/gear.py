"""Gear loss between rotor and link: the torque that leaves a gear for the one that enters it, an increasing function."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from armwright import scalar
from armwright.friction_laws.levels import smooth_sign
from armwright.interpolation import piecewise_linear
from armwright.model import Body, Drive, EfficiencyTable, Friction
from armwright.scalar import Array, Scalar


@dataclass(frozen=True, eq=False)
class GearLoss:
    """G, the torque that leaves a gear for the torque t that enters it, at one speed: linear between knots, increasing, G(0) = 0.

    Both count positive in the direction of positive motion. The slope G/t is below 1 where the motor drives, above 1 where it
    is driven back.
    """

    knots: tuple[Scalar, ...]  # t where the slope changes [N m | N], in rising order; 0 is the one in the middle
    slopes: tuple[Scalar, ...]  # between them and beyond, one more [-]

    @property
    def jumps(self) -> bool:
        """True if a slope is so steep that only a search of all knots finds a way down it."""
        return False

    def line(self, t: Scalar) -> tuple[Scalar, Scalar]:
        """Slope [-] and offset [N m | N] of  G = slope t + offset  about t; at a knot those of the side above."""
        return self._chosen(t, self.knots)

    def line_of_output(self, torque: Scalar) -> tuple[Scalar, Scalar]:
        """Slope and offset where G is that torque."""
        lines = zip(self.slopes[1:], self._offsets[1:], self.knots, strict=True)
        return self._chosen(torque, [slope * knot + offset for slope, offset, knot in lines])

    def output(self, t: Scalar) -> Scalar:
        """G(t)."""
        slope, offset = self.line(t)
        return slope * t + offset

    def input(self, torque: Scalar) -> Scalar:
        """The input torque t with G(t) equal to a given torque."""
        slope, offset = self.line_of_output(torque)
        return (torque - offset) / slope

    def packed(self) -> list[Scalar]:
        """Its numbers, for `unpacked`."""
        return [*self.knots, *self.slopes]

    def unpacked(self, values: Array) -> GearLoss:
        """The loss with other numbers."""
        knots = len(self.knots)
        return GearLoss(tuple(values[:knots]), tuple(values[knots:]))

    def with_friction(self, share: Scalar, on_motor: bool) -> GearLoss:
        """The gear with friction  share · |torque|  beside it, where share has the sign of the speed.

        Behind the gear it takes from what leaves,  G - share |G|.  On the motor's side it takes from what enters: the gear gets
        the x for which  x + share |x| = t.
        """
        middle = len(self.knots) // 2
        below, above = (1.0 - share, 1.0 + share) if on_motor else (1.0 + share, 1.0 - share)
        backward, forward = self.slopes[: middle + 1], self.slopes[middle + 1 :]
        if not on_motor:
            return GearLoss(self.knots, (*(slope * below for slope in backward), *(slope * above for slope in forward)))
        knots = (
            *(knot * below for knot in self.knots[:middle]),
            self.knots[middle],
            *(knot * above for knot in self.knots[middle + 1 :]),
        )
        return GearLoss(knots, (*(slope / below for slope in backward), *(slope / above for slope in forward)))

    @property
    def lines(self) -> list[tuple[Scalar, Scalar]]:
        """Slopes and offsets of all lines, in order."""
        return list(zip(self.slopes, self._offsets, strict=True))

    @property
    def _offsets(self) -> list[Scalar]:
        """Offsets of the lines, by which neighbours meet at their knot."""
        middle = len(self.knots) // 2
        offsets: list[Scalar] = [0.0] * len(self.slopes)
        for k in range(middle + 1, len(self.knots)):
            offsets[k + 1] = offsets[k] + (self.slopes[k] - self.slopes[k + 1]) * self.knots[k]
        for k in reversed(range(middle)):
            offsets[k] = offsets[k + 1] + (self.slopes[k + 1] - self.slopes[k]) * self.knots[k]
        return offsets

    def _chosen(self, value: Scalar, limits) -> tuple[Scalar, Scalar]:
        (slope, *slopes), (offset, *offsets) = self.slopes, self._offsets
        for limit, next_slope, next_offset in zip(limits, slopes, offsets, strict=True):
            below = scalar.less(value, limit)
            slope, offset = scalar.where(below, slope, next_slope), scalar.where(below, offset, next_offset)
        return slope, offset


LOSSLESS = GearLoss((0.0,), (1.0, 1.0))


def loses_power(body: Body) -> bool:
    """True if a joint's gear has an efficiency, or friction that is proportional to its load."""
    return body.drive.efficiency is not None or (
        body.friction is not None and body.friction.load_coefficient is not None
    )


def holds_by_loss(body: Body) -> bool:
    """True if a joint's gear loses power and has no smoothing speed: at rest it passes on any torque between both laws'.

    Of bristles the part by load is in their level, which needs no smoothing.
    """
    by_load = (
        body.friction is not None and body.friction.load_coefficient is not None and not body.friction.has_bristles
    )
    return body.drive.smoothing is None and (body.drive.efficiency is not None or by_load)


def sticks(body: Body) -> bool:
    """True if a joint's friction or gear loss has no smoothing speed: in simulation it holds the joint at rest."""
    return holds_by_loss(body) or (body.friction is not None and body.friction.sticks)


def gear_loss(
    drive: Drive, speed: Scalar, friction: Friction | None = None, direction: Scalar | None = None
) -> GearLoss | None:
    """G of design section 3 at a speed of the motor, referred to the joint [rad/s | m/s]; None: a gear without loss.

    With s = |w| / √(w² + smoothing²), without a smoothing speed s = 1 in motion and 0 at rest, and t what the rotor's
    acceleration and motor-side friction leave of the motor's torque:

        G = (1 - (1-η) s) t  where the motor drives, t w ≥ 0,     G = (1 + (1/η - 1) s) t  where it is driven back.

    As Modelica's `LossyGear`. A table gives η at torques T that leave the gear: these two equations hold with each T for G, which
    gives t there; G is linear between, and η of the ends holds beyond them. By speed η is interpolated linearly. Continuous in t
    and, with a smoothing speed, in w; slopes by w at rest are then those for w > 0, and without one they are 0.

    With `friction` also its load-proportional part, load_coefficient · |torque| · `smooth_sign(w)` of the torque that
    leaves the gear, or of that which enters it where the friction is the motor's.

    Without a smoothing speed, `direction` of 1 or -1 stands for the sign of the speed; 0: a gear at rest, G = t.
    """
    share = None if friction is None else friction.load_coefficient
    if drive.efficiency is None and share is None:
        return None
    loss = (
        LOSSLESS
        if drive.efficiency is None
        else _loss_by_efficiency(drive.efficiency, drive.smoothing, speed, direction)
    )
    if friction is None or share is None:
        return loss
    turning = speed if drive.smoothing is not None or direction is None else direction
    return loss.with_friction(share * smooth_sign(turning, drive.smoothing), friction.on_motor)


def _loss_by_efficiency(
    efficiency: Scalar | EfficiencyTable, smoothing: Scalar | None, speed: Scalar, direction: Scalar | None
) -> GearLoss:
    turning = speed if smoothing is not None or direction is None else direction
    backward = scalar.less(turning, 0.0)
    size = scalar.where(backward, -speed, speed)  # not abs, whose slope at 0 would be 0
    s = (
        scalar.abs(scalar.sign(turning))
        if smoothing is None
        else size / scalar.sqrt(speed * speed + smoothing * smoothing)
    )
    torques: Sequence[Scalar] = ()
    if not isinstance(efficiency, EfficiencyTable):
        driving = driven_back = [efficiency]
    else:
        torques = efficiency.torques if len(efficiency.torques) > 1 else ()
        driving, driven_back = (_at_speed(efficiency, of, size) for of in (efficiency.driving, efficiency.driven_back))
    forth = _broken_line(torques, [1.0 - (1.0 - eta) * s for eta in driving])
    back = _broken_line(torques, [1.0 + (1.0 / eta - 1.0) * s for eta in driven_back])
    with_w = [scalar.where(backward, b, f) for f, b in zip(forth, back, strict=True)]
    against_w = [scalar.where(backward, f, b) for f, b in zip(forth, back, strict=True)]
    count = len(torques)  # knots first, then slopes
    knots = (*(-knot for knot in reversed(against_w[:count])), 0.0, *with_w[:count])
    return GearLoss(knots, (*reversed(against_w[count:]), *with_w[count:]))


def _at_speed(table: EfficiencyTable, rows: Sequence[Sequence[Scalar]], size: Scalar) -> list[Scalar]:
    """η at each torque of a table, at a speed of that size."""
    if len(rows) == 1:
        return list(rows[0])
    return [piecewise_linear(size, table.speeds, column, "constant") for column in zip(*rows, strict=True)]


def _broken_line(torques: Sequence[Scalar], factors: Sequence[Scalar]) -> list[Scalar]:
    """Knots t = T / factor of G for one direction of power, then its slopes: before, between and beyond them."""
    knots = [torque / factor for torque, factor in zip(torques, factors, strict=True)] if torques else []
    between = [(b - a) / (t_b - t_a) for (a, b), (t_a, t_b) in zip(pairwise(torques), pairwise(knots), strict=True)]
    return [*knots, factors[0], *between, *([factors[-1]] if torques else [])]
