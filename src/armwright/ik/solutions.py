"""Solutions of inverse kinematics: joint positions, how near they come, and how far they are from limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armwright.kinematics.reach import reach
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.results.result import Result
from armwright.results.table import Table, number


def distance_text(distance: float, angle: float | None) -> str:
    """Distance and angle between two poses in words, such as "435.7 mm and 0 mrad".

    Rounded to 1 µm and 10 µrad: finer digits depend on where a search happens to end.

    Args:
        distance: [m].   angle: [rad]; None where orientations do not count.
    """
    return f"{round(1e3 * distance, 3):.4g} mm" + ("" if angle is None else f" and {round(1e3 * angle, 2):.4g} mrad")


@dataclass(frozen=True, eq=False)
class PoseBranches:
    """All solutions of a closed form, eight to a target; at singular poses some of them are the same.

    Attributes:
        q: (…, 8, n) [rad], whole turns added until it is within the limits where it can be.
        success: (…, 8) True where the pose is met within the tolerance and the limits; the others are no solutions.
        position_error: (…, 8) [m].   angle_error: (…, 8) [rad].
        margin: (…, 8) least distance to a joint limit as a share of its range; negative beyond it.
        limits: (2, n) lowest and highest positions [rad].   joints: names.
    """

    q: np.ndarray
    success: np.ndarray
    position_error: np.ndarray
    angle_error: np.ndarray
    margin: np.ndarray
    limits: np.ndarray
    joints: tuple[str, ...]

    def reshaped(self, shape: tuple[int, ...]) -> PoseBranches:
        """The branches of (k,) targets as those of targets `shape`."""
        names = ("q", "success", "position_error", "angle_error", "margin")
        parts = {name: getattr(self, name) for name in names}
        return replace(self, **{name: part.reshape((*shape, *part.shape[1:])) for name, part in parts.items()})

    def obstacle(self, k: tuple[int, ...], tolerance: float) -> str:
        """Reason why target k has no solution, in words: the limit exceeded by the best branch that reaches the pose."""
        met = np.maximum(self.position_error[k], self.angle_error[k]) <= tolerance
        if not met.any():
            return UNREACHABLE
        q = self.q[k][np.argmax(np.where(met, self.margin[k], -np.inf))]
        beyond = np.maximum(self.limits[0] - q, q - self.limits[1])
        joint = int(np.argmax(beyond))
        return f"not within the limits, {self.joints[joint]} would be {beyond[joint]:.3g} rad beyond its own"


@dataclass(frozen=True, eq=False)
class PoseSolutions(Result):
    """Joint positions for targets, `…` as for the targets, with one more axis if several solutions were requested.

    Attributes:
        q: (…, n) [rad | m]; where a target was not solved, the positions that came nearest.
        success: (…,) True where the pose is met within the tolerance and the limits.
        position_error: (…,) [m].   angle_error: (…,) [rad] of the part of the orientation that counts; 0 of a position alone.
        margin: (…,) least distance to a joint limit, as a share of that joint's range; 1/2 in the middle of all.
        iterations: (…,) of all attempts together, 0 of closed forms and several.
        attempts: (…,) starts that were tried, counted likewise.   tolerance: on both errors, [m] and [rad].   arm: whose joints.
        method: "numeric", or the closed form.   branches: all of the closed form's; None of numeric solutions.
        branch: (…,) number of the branch that is `q`, -1 where it is numeric; None where all are.
        several: True where the last axis of `…` is that of different solutions.
    """

    q: np.ndarray
    success: np.ndarray
    position_error: np.ndarray
    angle_error: np.ndarray
    margin: np.ndarray
    iterations: np.ndarray
    attempts: np.ndarray
    tolerance: float
    arm: Model
    method: str = "numeric"
    branches: PoseBranches | None = None
    branch: np.ndarray | None = None
    several: bool = False

    @property
    def good(self) -> bool:
        """True if all targets were reached."""
        return bool(self.success.all())

    def sentences(self) -> list[str]:
        """Counts, largest errors, and the first targets that were not solved."""
        return str(self).split("\n")

    def tables(self) -> list[Table]:
        """A row for each target, or solution: whether it is solved, errors, margin and joint positions."""
        columns = [each.reshape(-1) for each in (self.position_error, self.angle_error, self.margin)]
        rows = [
            [str(k), "yes" if solved else "no", *map(number, errors), *map(number, q)]
            for k, (solved, *errors, q) in enumerate(
                zip(self.success.reshape(-1), *columns, self.q.reshape(-1, self.arm.n), strict=True)
            )
        ]
        units = (f"{name} [{unit}]" for name, unit in zip(self.arm.names, joint_units(self.arm, "q"), strict=True))
        heads = ("target", "solved", "position error [m]", "angle error [rad]", "margin", *units)
        return [Table("inverse kinematics", heads, rows, ("solved",))]

    def __str__(self) -> str:
        """Counts, largest errors, and the first targets that were not solved with how far off they stay."""
        if self.several:
            first = (self.success, self.position_error, self.angle_error, self.margin, self.iterations, self.attempts)
            best = PoseSolutions(
                self.q[..., 0, :], *(each[..., 0] for each in first), tolerance=self.tolerance, arm=self.arm
            )
            counts = self.success.sum(axis=-1)[best.success]
            return f"{best}\n{counts.mean() if counts.size else 0.0:.3g} different solutions of a target on average"
        solved, of = int(self.success.sum()), self.success.size
        lines = [f"{solved} of {of} solved"]
        if solved:
            lines[0] += f", {way}" if (way := self._way()) else ""
            far, turned = self.position_error[self.success].max(), self.angle_error[self.success].max()
            lines[0] += f", within {far:.1e} m and {turned:.1e} rad"
        for place in np.argwhere(~self.success)[:SHOWN]:
            k = tuple(place)
            if not np.isfinite(self.position_error[k]):
                why = self.branches.obstacle(k, self.tolerance) if self.branches is not None else UNREACHABLE
                lines.append(f"target {', '.join(map(str, place)) or 0}: {why}")
                continue
            off = distance_text(float(self.position_error[k]), float(self.angle_error[k]))
            lines.append(
                f"target {', '.join(map(str, place)) or 0}: not reached, the nearest pose is {off} off{self._limits(k)}"
            )
        if of - solved > SHOWN:
            lines.append(f"and {of - solved - SHOWN} more")
        if self._in_millimetres:
            length = f"{self.arm.name} reaches {reach(self.arm):.3g} m"
            lines.append(f"note: targets are in metres, and {length}; are these in millimetres?")
        return "\n".join(lines)

    @property
    def _in_millimetres(self) -> bool:
        """True where targets lie so far out of reach that their unit may be another one."""
        off = self.position_error[np.isfinite(self.position_error) & ~self.success]
        return bool(off.size and self.arm.tip is not None and np.median(off) > FAR * reach(self.arm))

    def _way(self) -> str:
        """Solution method, in words."""
        iterations = self.iterations[self.success]
        numeric = int((iterations > 0).sum())
        many = f"{np.median(iterations[iterations > 0]):.0f} iterations as a rule" if numeric else ""
        if self.branches is None:
            return many
        return f"in {self.method}" + (f", {numeric} of them numerically, {many}" if numeric else "")

    @property
    def at_limit(self) -> np.ndarray:
        """(…, n) True for joints within a millionth of their range of a limit: they hold back a target that is not reached."""
        low, high = np.array([body.limits.position for body in self.arm.coordinates]).T
        with np.errstate(invalid="ignore"):
            near = np.minimum(self.q - low, high - self.q) <= AT_LIMIT * (high - low)
        return near & np.isfinite(high - low)

    def _limits(self, k: tuple[int, ...]) -> str:
        """Joints whose limits keep a target from being reached, in words."""
        if self.branches is not None:
            met = np.maximum(self.branches.position_error[k], self.branches.angle_error[k]) <= self.tolerance
            if met.any():
                best = int(np.where(met, self.branches.margin[k], -np.inf).argmax())
                low, high = np.array([body.limits.position for body in self.arm.coordinates]).T
                beyond = np.maximum(low - self.branches.q[k][best], self.branches.q[k][best] - high)
                joint = int(np.argmax(beyond / (high - low)))
                return f"; it would be met with joint {self.arm.names[joint]} {beyond[joint]:.4g} rad beyond its limit"
        names = [name for name, there in zip(self.arm.names, self.at_limit[k], strict=True) if there]
        return f", with {', '.join(names)} at {'its limit' if len(names) == 1 else 'their limits'}" if names else ""


SHOWN = 5  # targets that are listed
FAR = 20.0  # of the reach: targets that far outside of it are thought to be in another unit
AT_LIMIT = 1e-6  # of a joint's range
UNREACHABLE = "no joint positions reach it"
