"""Solutions of inverse kinematics: joint positions, how near they come, and how far they are from limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class PoseSolutions:
    """Joint positions for targets, `…` as the targets have it, with one more axis where several solutions were asked for.

    Attributes:
        q: (…, n) [rad | m]; where a target was not solved, the positions that came nearest.
        success: (…,) True where the pose is met within the tolerance and the limits.
        position_error: (…,) [m].   angle_error: (…,) [rad]; 0 where the rotation does not count.
        margin: (…,) least distance to a joint limit, as a share of that joint's range; 1/2 in the middle of all.
        iterations: (…,) of all attempts together.   tolerance: on both errors, [m] and [rad].
    """

    q: np.ndarray
    success: np.ndarray
    position_error: np.ndarray
    angle_error: np.ndarray
    margin: np.ndarray
    iterations: np.ndarray
    tolerance: float

    def __str__(self) -> str:
        """Counts, largest errors, and the first targets that were not solved with how far off they stay."""
        solved, of = int(self.success.sum()), self.success.size
        lines = [f"{solved} of {of} solved"]
        if solved:
            lines[0] += f", {np.median(self.iterations[self.success]):.0f} iterations as a rule"
            far, turned = self.position_error[self.success].max(), self.angle_error[self.success].max()
            lines[0] += f", within {far:.1e} m and {turned:.1e} rad"
        for place in np.argwhere(~self.success)[:SHOWN]:
            k = tuple(place)
            off = f"{1e3 * self.position_error[k]:.4g} mm and {1e3 * self.angle_error[k]:.4g} mrad"
            lines.append(f"target {', '.join(map(str, place)) or 0}: not reached, the nearest pose is {off} off")
        if of - solved > SHOWN:
            lines.append(f"and {of - solved - SHOWN} more")
        return "\n".join(lines)


SHOWN = 5  # targets that are listed
