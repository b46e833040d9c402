"""Statistics of bus cycles: jitter of SYNC, missing frames, and processor load."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from armwright.twin import clock

LATE = 0.5  # of a period behind the time at which a SYNC was to come


@dataclass(frozen=True)
class CycleReport:
    """Statistics of bus cycles.

    Attributes:
        cycles: SYNCs.   incomplete: of them, in how many an expected frame was missing.   late: in how many SYNC came more than
            half a period late.
        jitter: [s] root mean square of the intervals' difference to the period.   worst: [s] its largest.
        work: [s] mean time from SYNC to the last frame that was sent.   longest: [s].   load: of one processor, by this process.
    """

    cycles: int
    incomplete: int
    late: int
    jitter: float
    worst: float
    work: float
    longest: float
    load: float

    def rows(self) -> list[tuple[str, str]]:
        """The report as a table: name, value."""
        return [
            ("cycles", f"{self.cycles}"),
            ("incomplete cycles", f"{self.incomplete}"),
            ("SYNC more than half a period late", f"{self.late}"),
            ("jitter of SYNC, rms", f"{1e3 * self.jitter:.3f} ms"),
            ("jitter of SYNC, largest", f"{1e3 * self.worst:.3f} ms"),
            ("work in a cycle, mean", f"{1e3 * self.work:.3f} ms"),
            ("work in a cycle, largest", f"{1e3 * self.longest:.3f} ms"),
            ("load of one processor core", f"{self.load:.0%}"),
        ]


class Cycles:
    """Counter of bus cycles.

    Args:
        period: [s] from SYNC to SYNC.
    """

    def __init__(self, period: float):
        self.period = period
        self.reset()

    def reset(self) -> None:
        """Restarts the counts."""
        self._begun: list[float] = []
        self._worked: list[float] = []
        self._incomplete = 0
        self._clock, self._processor = clock.now(), time.process_time()

    def began(self) -> None:
        """Counts a SYNC that was received or sent."""
        self._begun.append(clock.now())

    def received(self, expected: int, came: int) -> None:
        """Compares the numbers of expected and received frames of a cycle."""
        self._incomplete += came < expected

    def ended(self) -> None:
        """Marks the end of a cycle's work."""
        if self._begun:
            self._worked.append(clock.now() - self._begun[-1])

    @property
    def report(self) -> CycleReport:
        """Statistics of the cycles so far."""
        intervals = np.diff(self._begun) if len(self._begun) > 1 else np.full(1, self.period)
        off = intervals - self.period
        spent = clock.now() - self._clock
        return CycleReport(
            len(self._begun),
            self._incomplete,
            int(np.sum(off > LATE * self.period)),
            float(np.sqrt(np.mean(off * off))),
            float(np.max(np.abs(off))),
            float(np.mean(self._worked)) if self._worked else 0.0,
            max(self._worked, default=0.0),
            (time.process_time() - self._processor) / spent if spent > 0.0 else 0.0,
        )
