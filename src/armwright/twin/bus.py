"""Time that frames take on a CAN bus, and buses by name.

A data frame of the classic base format with k bytes takes 47 + 8 k bits with the pause behind it, and at most
⌊(34 + 8 k - 1) / 4⌋ stuffed bits more. [ISO2015] [DavisEtAl2007]
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import BusError
from armwright.simulation.checks import is_whole

if TYPE_CHECKING:
    import can

BITRATE = 500_000  # [bit/s] of the LWA 4P
FASTEST = 1_000_000  # [bit/s] of a classic CAN bus
INTERFACES = ("virtual", "socketcan", "udp_multicast")
INSTALL = 'pip install "armwright[twin]"'
FIRST_NODE = 3  # of the LWA 4P, whose nodes are 3 to 8
FRAME = 47  # bits of a frame without data, with the pause of 3 bits between frames
LOOK = 0.05  # [s] in which a thread that listens notices that it is to end
STUFFED = 34  # bits of a frame without data that stuffing looks at


def frame_bits(length: int, *, stuffed: bool) -> int:
    """Number of bits of a frame with `length` bytes, with the most stuff bits or without any."""
    return FRAME + 8 * length + ((STUFFED + 8 * length - 1) // 4) * stuffed


@dataclass(frozen=True)
class BusLoad:
    """Load of a bus by one cycle: SYNC, an answer from each node, a command to each.

    Args:
        nodes: how many.   period: [s] of the cycle.   bitrate: [bit/s].
    """

    nodes: int
    period: float
    bitrate: int = BITRATE

    def answered(self, *, stuffed: bool) -> float:
        """[s] from the beginning of SYNC to the end of the last answer."""
        bits = frame_bits(0, stuffed=stuffed) + self.nodes * frame_bits(8, stuffed=stuffed)
        return bits / self.bitrate

    def cycle(self, *, stuffed: bool) -> float:
        """[s] from the beginning of SYNC to the end of the last command."""
        return self.answered(stuffed=stuffed) + self.nodes * frame_bits(8, stuffed=stuffed) / self.bitrate

    def load(self, *, stuffed: bool) -> float:
        """Share of the period in which frames are on the bus."""
        return self.cycle(stuffed=stuffed) / self.period

    def check(self) -> None:
        """Refuses periods that are too short for all frames, or that object 60C2 cannot represent.

        Raises:
            BusError: names the load and the shortest period.
        """
        if not is_whole(self.bitrate, 1) or self.bitrate > FASTEST:
            raise BusError(place="bitrate", value=self.bitrate, expected=f"a whole number of bit/s, 1 to {FASTEST}")
        if self.load(stuffed=True) >= 1.0:
            what = f"{self.nodes} nodes load a bus of {self.bitrate / 1e3:g} kbit/s to {self.load(stuffed=True):.0%}"
            expected = f"a period above {1e3 * self.cycle(stuffed=True):.3g} ms in [loop], or a faster bus (--bitrate)"
            raise BusError(what, place="loop.period", value=self.period, expected=expected)
        self.interpolation()

    def interpolation(self) -> tuple[int, int]:
        """The period in the form of object 60C2: 8 bits, and a power of ten.

        Raises:
            BusError: a period that is no such number.
        """
        for power in range(-1, -7, -1):
            value = self.period / 10.0**power
            if abs(value - round(value)) < 1e-9 * value and 1 <= round(value) <= 255:
                return round(value), power
        expected = "a whole number up to 255 of 0.1 s, 10 ms, 1 ms, 0.1 ms, 10 µs or 1 µs, as object 60C2 holds it"
        raise BusError(place="loop.period", value=self.period, expected=expected)

    def __str__(self) -> str:
        low, high = self.load(stuffed=False), self.load(stuffed=True)
        answered = 1e3 * self.answered(stuffed=False), 1e3 * self.answered(stuffed=True)
        return (
            f"{self.nodes} nodes at {1e3 * self.period:g} ms and {self.bitrate / 1e3:g} kbit/s: load {low:.0%} to "
            f"{high:.0%}, last answer after {answered[0]:.2f} to {answered[1]:.2f} ms"
        )


def is_virtual(name: str) -> bool:
    """True for a bus within this process."""
    return name.partition(":")[0] == "virtual"


def check_bus(name: str) -> tuple[str, str]:
    """Interface and channel of a bus by name: "socketcan:can0" → ("socketcan", "can0").

    Raises:
        BusError: no such interface, no channel, or the packages are not installed.
    """
    interface, _, channel = name.partition(":") if isinstance(name, str) else ("", "", "")
    if interface not in INTERFACES:
        raise BusError(place="bus", value=name, expected="virtual, socketcan:CHANNEL or udp_multicast:ADDRESS")
    if not channel and interface != "virtual":
        example = {"socketcan": "socketcan:can0", "udp_multicast": "udp_multicast:239.74.163.2"}[interface]
        raise BusError("no channel", place="bus", value=name, expected=example)
    require_twin()
    return interface, channel or "armwright"


def require_twin() -> None:
    """Refuses to continue without the packages of the extra `twin`.

    Raises:
        BusError: says what to install.
    """
    try:
        import can
        import canopen
    except ImportError:
        raise BusError("canopen and python-can are not installed", expected=INSTALL) from None
    _ = can, canopen


def bus_errors() -> tuple[type[Exception], ...]:
    """Exceptions of a bus that fails while it is open."""
    import can

    return can.CanError, OSError


def open_bus(name: str) -> can.BusABC:
    """A bus by name, open; the caller closes it.

    Raises:
        BusError: no such bus; says what the system says.
    """
    interface, channel = check_bus(name)
    import can

    for package in ("can", "canopen"):
        # what they log comes as our errors; without a handler it would go to the terminal
        logger = logging.getLogger(package)
        if not logger.handlers:
            logger.addHandler(logging.NullHandler())
    try:
        return can.Bus(channel=channel, interface=interface, ignore_config=True)  # a ~/can.conf says nothing
    except (can.CanError, OSError, ValueError, NotImplementedError, ImportError, TypeError) as error:
        text = (str(error).splitlines() or [type(error).__name__])[0]
        expected = "a bus that is there and up, such as `ip link set can0 up type can bitrate 500000` makes it"
        raise BusError(f"cannot be opened: {text}", place="bus", value=name, expected=expected) from None


def node_numbers(nodes: Sequence[int] | None, joints: int) -> tuple[int, ...]:
    """Numbers of the nodes, one for each joint; by default from 3 up.

    Raises:
        BusError: another number of nodes than joints, one that is none, or one that is there twice.
    """
    given = range(FIRST_NODE, FIRST_NODE + joints) if nodes is None else nodes
    numbers = tuple(np.atleast_1d(np.array(given, dtype=object)).tolist())
    right = all(is_whole(number, 1) and number <= 127 for number in numbers)
    if not right or len(numbers) != joints or len(set(numbers)) != joints:
        expected = f"{joints} different numbers from 1 to 127, one for each joint (--nodes)"
        raise BusError(place="nodes", value=list(numbers), expected=expected)
    return numbers
