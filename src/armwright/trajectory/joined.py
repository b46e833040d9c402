"""Motions in sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.entry import expect
from armwright.errors import ScenarioError
from armwright.model.payload import Payload
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion

LATE = 1e-9  # of a time: a gap between motions that is rounding
LARGEST_JUMP = 1e-6  # [rad | m] between the end of a motion and the beginning of the next


@dataclass(frozen=True, eq=False)
class Joined(Motion):
    """Motions in sequence: each is valid from its own time until that of the next.

    Args:
        motions: in order; each begins when and where the one before ends.
        payloads: bodies in the hand, each from its time on; a simulation that follows the motion has them there.
    Raises:
        ScenarioError: none, motions of different joints, one that begins elsewhere or at another time; names it.
    Example:
        >>> there = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=1.0)
        >>> back = aw.trajectories.Quintic([0.5, -0.5], [0.0, 0.0], duration=1.0, time=1.0)
        >>> aw.trajectories.Joined([there, back]).at([1.0, 2.0])[0]
        array([[ 0.5, -0.5],
               [ 0. ,  0. ]])
    """

    motions: Sequence[Motion]
    payloads: Sequence[Payload] = ()

    def __post_init__(self) -> None:
        expect(self.motions, Sequence, "Joined.motions", "motions, one at least", ScenarioError)
        if not self.motions or not all(isinstance(each, Motion) for each in self.motions):
            raise ScenarioError(place="Joined.motions", value=self.motions, expected="motions, one at least")
        object.__setattr__(self, "motions", tuple(self.motions))
        for k, (before, after) in enumerate(zip(self.motions[:-1], self.motions[1:], strict=True), 1):
            end, place = before.time + before.duration, f"Joined.motions[{k}]"
            if before.n != after.n:
                raise ScenarioError(f"{after.n} joints", place=place, expected=f"{before.n}, as the others have")
            if not abs(after.time - end) <= LATE * (1.0 + abs(end)):
                raise ScenarioError(
                    place=f"{place}.time", value=after.time, expected=f"{end:.10g} s, where the last ends"
                )
            distance = np.abs(after.at(after.time)[0] - before.at(end)[0])
            if not (distance <= LARGEST_JUMP).all():
                joint = int(np.argmax(distance))
                what = f"joint {joint + 1} begins {distance[joint]:.4g} from where the motion before ends"
                raise ScenarioError(what, place=place, expected="the same pose")

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.motions[0].n

    @property
    def time(self) -> float:
        """Time of the beginning [s]."""
        return float(self.motions[0].time)

    @property
    def duration(self) -> float:
        """Duration of all [s]."""
        return float(self.motions[-1].time + self.motions[-1].duration - self.time)

    @property
    def breaks(self) -> np.ndarray:
        """(k,) [s] times at which a higher derivative may jump: those of all motions."""
        found = np.unique(np.concatenate([np.asarray(each.breaks, dtype=float) for each in self.motions]))
        # ends and beginnings but for rounding
        distinct = np.diff(found, prepend=-np.inf) > LATE * (1.0 + np.abs(found))
        return found[distinct]

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        begins = [float(each.time) for each in self.motions[1:]]
        which = np.searchsorted(begins, times, side="right")
        q, qd, qdd = (np.zeros((*times.shape, self.n)) for _ in range(3))
        for k, motion in enumerate(self.motions):
            chosen = which == k
            if chosen.any():
                q[chosen], qd[chosen], qdd[chosen] = motion.at(times[chosen])
        return q, qd, qdd

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]; a trace holds all motions."""
        if not scalar.is_symbolic(t):
            return self.at(t)
        found = np.concatenate(self.motions[0](t))
        for motion in self.motions[1:]:
            begun = scalar.less_equal(motion.time, t)
            later = np.concatenate(motion(t))
            found = scalar.array([scalar.where(begun, b, a) for a, b in zip(found, later, strict=True)])
        q, qd, qdd = np.split(found, 3)
        return q, qd, qdd
