"""Faults injected into the twin: their effect, duration, and the error that the drives report. [IEC2015]

armwright twin arm.scenario.toml --bus virtual --fault stuck-encoder:joint2@1.5
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from armwright.errors import BusError, check_known

# error codes of CiA 301 and CiA 402; 0x3222 is the undervoltage that users of the LWA 4P report
UNDERVOLTAGE, OVER_TEMPERATURE, ENCODER, LATE_SYNC = 0x3222, 0x4310, 0x7305, 0x8700
HEARTBEAT, NO_DATA, SPEEDING, FOLLOWING, BEYOND_LIMITS = 0x8130, 0x8250, 0x8400, 0x8611, 0x8612
TEXT = {
    UNDERVOLTAGE: "supply below its least voltage",
    OVER_TEMPERATURE: "motor too hot",
    ENCODER: "encoder and commutation differ",
    LATE_SYNC: "SYNC came too late",
    HEARTBEAT: "no heartbeat of the master",
    NO_DATA: "no process data of the master",
    SPEEDING: "speed above the limit",
    FOLLOWING: "following error",
    BEYOND_LIMITS: "position beyond the limits",
}
REGISTER = {
    0x3: 0x04,
    0x4: 0x08,
    0x7: 0x20,
    0x8: 0x10,
}  # error register by the code's first digit: voltage, temperature, …
PATTERN = re.compile(r"(?P<kind>[a-z-]+)(:(?P<joint>[^=@]+))?(=(?P<amount>[^@]+))?(@(?P<at>.+))?")


@dataclass(frozen=True)
class FaultKind:
    """A kind of fault.

    Attributes:
        does: what it does.   code: the error that follows.   unit, usual: of its amount.
    """

    does: str
    code: int
    unit: str
    usual: float


KINDS = {
    "lost-frames": FaultKind("so many commands in turn do not arrive", NO_DATA, "frames", 100.0),
    "late-sync": FaultKind("a SYNC comes so much later", LATE_SYNC, "s", 0.01),
    "stuck-encoder": FaultKind("a position stays where it is for so long", ENCODER, "s", 0.5),
    "over-temperature": FaultKind("a motor is too hot for so long", OVER_TEMPERATURE, "s", 0.5),
    "supply-sag": FaultKind("the supply is too low for so long", UNDERVOLTAGE, "s", 0.5),
}


@dataclass(frozen=True)
class Fault:
    """A fault to inject.

    Args:
        kind: a name of `KINDS`.   joint: its name; None: all.   at: [s] from the first SYNC with an enabled drive.
        amount: in the kind's unit: how long, how many; None: the usual one.
    Raises:
        BusError: no such kind, or a number below 0.
    Example:
        >>> fault = aw.bus.Fault("lost-frames", joint="joint2", at=0.5)
        >>> print(fault)  # 100 frames, 0.5 s after the start
        lost-frames:joint2=100@0.5
    """

    kind: str
    joint: str | None = None
    at: float = 0.0
    amount: float | None = None

    def __post_init__(self) -> None:
        check_known(BusError, self.kind, KINDS, place="fault")
        if not (self.at >= 0.0 and self.size >= 0.0):
            raise BusError(place="fault", value=str(self), expected="a time and an amount of 0 or more")

    @property
    def size(self) -> float:
        """The amount, in the kind's unit."""
        return KINDS[self.kind].usual if self.amount is None else self.amount

    def __str__(self) -> str:
        joint = "" if self.joint is None else f":{self.joint}"
        return f"{self.kind}{joint}={self.size:g}@{self.at:g}"

    def ticks(self, period: float) -> tuple[int, int]:
        """First tick of the fault, and the tick after its last, at a period [s]."""
        first = round(self.at / period)
        lasts = self.size if self.kind == "lost-frames" else 1 if self.kind == "late-sync" else self.size / period
        return first, first + round(lasts)


def read_fault(text: str, joints: Sequence[str]) -> Fault:
    """A fault from its text, "KIND[:JOINT][=AMOUNT][@TIME]".

    Args:
        text: such as "stuck-encoder:joint2@1.5".   joints: names of the arm's joints.
    Raises:
        BusError: no such kind or joint, or no number.
    """
    found = PATTERN.fullmatch(text)
    try:
        if found is None:
            raise ValueError
        amount, at = (None if found[name] is None else float(found[name]) for name in ("amount", "at"))
    except ValueError:
        raise BusError(place="fault", value=text, expected="KIND[:JOINT][=AMOUNT][@SECONDS]") from None
    fault = Fault(found["kind"], found["joint"], at or 0.0, amount)
    if fault.joint is not None and fault.joint not in joints:
        raise BusError(place="fault", value=fault.joint, choices=tuple(joints))
    return fault
