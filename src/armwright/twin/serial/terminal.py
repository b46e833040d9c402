"""A pseudo-terminal that programs open as the serial port of servos (Linux, macOS).

One descriptor of the slave stays open, so that the master never hangs up between two clients. Nothing here waits for a client to
read. The baud rate is the one that the client set, which the kernel keeps with the terminal's attributes.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import struct
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from armwright.errors import BusError
from armwright.twin import clock
from armwright.twin.serial.bus import ServoBus
from armwright.twin.serial.timing import PATIENCE, Timing

SLICE = 0.005  # [s] of one wait for bytes: how well it is known when they came
PAUSE = 0.02  # [s] without bytes after which a frame that has begun is given up
MOST = 4096  # bytes read at once
TCGETS2, TERMIOS2, OUTPUT_SPEED = (
    0x802C542A,
    44,
    40,
)  # Linux: the attributes with speeds in bit/s, their size, its place
DEVICES = ("/dev/pts/", "/dev/tty")  # where pseudo-terminals live


class Terminal:
    """The pseudo-terminal, with a link to it; a context manager, which removes the link at its end.

    Args:
        path: of the link that clients open; None: none, they open `device`.

    Attributes:
        device: name of the slave.   unsent: bytes that no client had room for.
    Raises:
        BusError: no such system, or something else is at `path`.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None):
        if sys.platform == "win32":
            raise BusError("pseudo-terminals need Linux or macOS", place="serial", value=str(path))
        import tty

        self.path, self.unsent = Path(path) if path is not None else None, 0
        if self.path is not None:
            _check_link(self.path)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        if self.path is not None:
            with contextlib.suppress(FileNotFoundError):
                self.path.unlink()
            try:
                self.path.symlink_to(self.device)
            except OSError as error:
                self.close()
                raise BusError(f"no link can be made: {error.strerror}", place="serial", value=str(path)) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the terminal and removes the link, if it is still this terminal's."""
        if self.path is not None:
            with contextlib.suppress(OSError):
                if os.readlink(self.path) == self.device:
                    self.path.unlink()
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    @property
    def baud(self) -> int:
        """Baud rate [bit/s] that the client has set."""
        import fcntl
        import termios

        if sys.platform == "linux":
            with contextlib.suppress(OSError):  # machines on which the request has another number
                attributes = fcntl.ioctl(self._slave, TCGETS2, bytes(TERMIOS2))
                return struct.unpack_from("I", attributes, OUTPUT_SPEED)[0]
        code = termios.tcgetattr(self._slave)[5]
        names = (name for name in dir(termios) if name[:1] == "B" and name[1:].isdecimal())
        return next((int(name[1:]) for name in names if getattr(termios, name) == code), int(code or 0))

    def read(self, seconds: float) -> bytes:
        """Bytes that a client has sent, as soon as there are any; none after a time [s]."""
        ready, _, _ = select.select([self._master], [], [], seconds)
        if not ready:
            return b""
        with contextlib.suppress(OSError):
            return os.read(self._master, MOST)
        return b""

    def write(self, data: bytes) -> None:
        """Sends bytes. What a client that does not read has no room for is lost, and counted."""
        try:
            sent = os.write(self._master, data)
        except OSError:
            sent = 0
        self.unsent += len(data) - sent


def _check_link(path: Path) -> None:
    """Refuses a path where something else is than a link to a pseudo-terminal, such as a killed process left."""
    if not os.path.lexists(path):
        return
    if not path.is_symlink() or not os.readlink(path).startswith(DEVICES):
        raise BusError("something else is there", place="serial", value=str(path), expected="a path that is free")


@dataclass
class Counts:
    """Counts of a server: instructions, replies that were sent, that were dropped because they were late, and that no client
    had room for."""

    instructions: int = 0
    replies: int = 0
    late: int = 0
    unread: int = 0
    baud_rates: set[int] = field(default_factory=set)


def serve(
    terminal: Terminal,
    bus: ServoBus,
    timing: Timing,
    ended: Callable[[], bool],
    patience: float = PATIENCE,
    ready: Callable[[], None] = lambda: None,
) -> Counts:
    """Answers on a terminal until `ended` says so; calls `ready` as soon as it answers in time.

    A reply that is ready more than `patience` [s] after it is due, counted from the last moment at which its instruction cannot
    have been there, is not sent: its client may have gone on, and would take it for the answer to the next instruction.

    Raises:
        BusError: in lock-step, when a reply was dropped.
    """
    counts = Counts()
    gc.collect()
    gc.freeze()  # a pass over the objects of all modules takes 50 ms of a slow core
    try:
        ready()
        _serve(terminal, bus, timing, ended, patience, counts)
    finally:
        gc.unfreeze()
    return counts


def _serve(
    terminal: Terminal, bus: ServoBus, timing: Timing, ended: Callable[[], bool], patience: float, counts: Counts
) -> None:
    quiet, baud = 0.0, terminal.baud
    while not ended():
        looked = clock.now()
        data = terminal.read(SLICE)
        came = clock.now()
        if data:
            baud, quiet = terminal.baud, 0.0
            counts.baud_rates.add(baud)
            frames = list(bus.feed(data, baud))
        else:
            timing.idle()
            quiet += SLICE
            frames = list(bus.pause()) if quiet >= PAUSE else []
        for frame in frames:
            counts.instructions += 1
            reply = timing.reply(frame, baud)
            if reply.data:
                clock.sleep_until(came + reply.wire)
                late = clock.now() - looked - reply.wire
                if late > patience:
                    counts.late += 1
                    timing.late(late)
                else:
                    before = terminal.unsent
                    terminal.write(reply.data)
                    whole = terminal.unsent == before
                    counts.replies += whole
                    counts.unread += not whole
            timing.close(frame)
