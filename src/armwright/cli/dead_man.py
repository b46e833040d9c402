"""A dead-man key: the space bar, which a user keeps pressed while an arm moves."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from armwright.errors import BusError
from armwright.terminal import say

FIRST, NEXT = 0.8, 0.25  # [s] from the first press to the terminal's repetition, and between repetitions
PATIENCE = 30.0  # [s] that the first press is waited for


class Key:
    """The key: called once a cycle, True while it is pressed.

    Args:
        pressed: gives the characters that came since it was asked last.   clock: [s].
    """

    def __init__(self, pressed: Callable[[], str], clock: Callable[[], float] = time.monotonic):
        self._pressed, self._clock = pressed, clock
        self._last: float | None = None
        self._first = 0.0
        self._repeats = 0
        self._gone = False

    def __call__(self) -> bool:
        """True while the key is held, from its first press on."""
        now, spaces = self._clock(), self._pressed().count(" ")
        if spaces:
            self._first = now if self._last is None else self._first
            self._last, self._repeats = now, self._repeats + spaces
        if self._last is None:  # waiting for the first press
            return False
        self._gone = self._gone or now - self._last > (FIRST if self._repeats < 2 else NEXT)
        return not self._gone


@contextlib.contextmanager
def dead_man_key() -> Iterator[Callable[[], bool] | None]:
    """The key of this terminal, from its first press on; None without a terminal.

    Raises:
        BusError: nobody presses it.
    """
    if not sys.stdin.isatty():
        yield None
        return
    with _characters() as pressed:
        key = Key(pressed)
        say("hold the space bar down; releasing it stops the arm", err=True)
        end = time.monotonic() + PATIENCE
        while not key():
            if time.monotonic() > end:
                raise BusError(
                    "the space bar was not pressed", place="standard input", expected="the space bar held down"
                )
            time.sleep(0.02)
        yield key


@contextlib.contextmanager
def _characters() -> Iterator[Callable[[], str]]:
    """Characters as they are typed, without waiting for the end of the line."""
    if sys.platform == "win32":
        import msvcrt

        def typed() -> str:
            found = ""
            while msvcrt.kbhit():
                found += msvcrt.getwch()
            return found

        yield typed
        return
    import termios
    import tty

    stream = sys.stdin.fileno()
    before: Any = termios.tcgetattr(stream)
    tty.setcbreak(stream)
    try:
        yield lambda: _waiting(stream)
    finally:
        termios.tcsetattr(stream, termios.TCSADRAIN, before)


def _waiting(stream: int) -> str:
    """Characters of a descriptor that wait to be read; none of one whose other end is gone."""
    found = b""
    with contextlib.suppress(OSError):
        while select.select([stream], [], [], 0.0)[0]:
            more = os.read(stream, 1024)
            if not more:  # the end, which is always there to be read
                break
            found += more
    return found.decode(errors="replace")
