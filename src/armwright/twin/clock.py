"""The clock of a bus: the computer's. A test replaces these functions to count time in cycles."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


def now() -> float:
    """Time [s] from an arbitrary beginning."""
    return time.perf_counter()


def sleep_until(at: float) -> None:
    """Waits until a time of `now` [s]; at once if it has passed."""
    time.sleep(max(at - now(), 0.0))


def wait(condition: threading.Condition, done: Callable[[], bool], until: float) -> bool:
    """True as soon as `done` holds; False if it does not at a time of `now` [s]. The caller holds the condition."""
    return bool(condition.wait_for(done, max(until - now(), 0.0)))
