"""Homing: the search for a switch, leg by leg, and what bits 13, 12 and 10 of the statusword say of it. [IEC2015]

0 0 0  in progress               0 0 1  interrupted or not started
0 1 0  attained, not at rest     0 1 1  completed
1 0 0  error, not at rest        1 0 1  error, at rest
"""

from __future__ import annotations

from armwright.twin import objects as od

REACHED, ATTAINED, FAILED = 1 << 10, 1 << 12, 1 << 13


class Homing:
    """A homing procedure.

    Attributes:
        running: True from its start until home is found or it fails.   outcome: of the last one: `ATTAINED`, `FAILED`, or 0.
    """

    def __init__(self) -> None:
        self.running, self.outcome = False, 0
        self._legs: list[tuple[int, int, bool]] = []  # still to go: speed [counts/s], switch, its level at the end

    def begin(self, method: int, search: int, slow: int) -> None:
        """Starts a procedure.

        Args:
            method: of 6098.   search, slow: speeds of 6099, to a switch and to its edge [counts/s].
        """
        self.running, self.outcome, self._legs = True, 0, []
        if method in od.SEARCHES:
            way, switch, level = od.SEARCHES[method]
            speeds = ((way, level, search), (-way, not level, search), (way, level, slow))
            self._legs = [(sign * speed, switch, wanted) for sign, wanted, speed in speeds]

    def interrupt(self) -> None:
        """Ends a procedure that runs."""
        self.running = False

    def speed(self, inputs: int) -> float:
        """Speed [counts/s] to search at, by the digital inputs 60FD; when `running` ends home is here, or cannot be found."""
        if not self.running:
            return 0.0
        while self._legs and bool(inputs & self._legs[0][1]) is self._legs[0][2]:
            self._legs.pop(0)
        if not self._legs:
            self.running, self.outcome = False, ATTAINED
            return 0.0
        speed = self._legs[0][0]
        if inputs & (od.POSITIVE if speed > 0 else od.NEGATIVE):  # the end of the way, and no edge on it
            self.running, self.outcome = False, FAILED
            return 0.0
        return float(speed)

    def bits(self, *, at_rest: bool) -> int:
        """Bits 13, 12 and 10 of the statusword."""
        return 0 if self.running else self.outcome | at_rest * REACHED
