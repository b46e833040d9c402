"""Gear loss between rotor and link: the torque that leaves a gear for the one that enters it, an increasing function."""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.model import Drive
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class GearLoss:
    """G, the torque that leaves a gear for the torque t that enters it, at one speed: linear between knots, increasing, G(0) = 0.

    Both count positive in the direction of positive motion. The slope G/t is below 1 where the motor drives, above 1 where it
    is driven back.
    """

    knots: tuple[Scalar, ...]  # t where the slope changes [N m | N], in rising order; 0 is the one in the middle
    slopes: tuple[Scalar, ...]  # between them and beyond, one more [-]

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
        """The t for which G(t) is that torque."""
        slope, offset = self.line_of_output(torque)
        return (torque - offset) / slope

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


def gear_loss(drive: Drive, speed: Scalar) -> GearLoss | None:
    """G of design section 3 at a speed of the motor, referred to the joint [rad/s | m/s]; None: a gear without loss.

    With s = |w| / √(w² + smoothing²), and t what the rotor's acceleration and motor-side friction leave of the motor's torque:

        G = (1 - (1-η) s) t  where the motor drives, t w ≥ 0,     G = (1 + (1/η - 1) s) t  where it is driven back.

    As Modelica's `LossyGear` with one efficiency. Continuous in t and w; slopes by w at rest are those for w > 0.
    """
    if drive.efficiency is None:
        return None
    assert drive.smoothing is not None, "a record that is read has it"
    backward = scalar.less(speed, 0.0)
    size = scalar.where(backward, -speed, speed)  # not abs, whose slope at 0 would be 0
    s = size / scalar.sqrt(speed * speed + drive.smoothing * drive.smoothing)
    driving, driven = 1.0 - (1.0 - drive.efficiency) * s, 1.0 + (1.0 / drive.efficiency - 1.0) * s
    return GearLoss((0.0,), (scalar.where(backward, driving, driven), scalar.where(backward, driven, driving)))
