"""`armwright twin ARM --serial PATH`: a simulated arm as servos on a pseudo-terminal."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import armwright as aw
from armwright.cli.arguments import as_options, numbers, refuse, start_of, words
from armwright.cli.tables import console_for_tables, table
from armwright.errors import BusError
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.twin.serial.servo_arm import Line

HEADS = ("what", "how much")
RANGES = "ids with commas or a dash between: 1-6 or 1,2,5"


def serve_servos(robot: str, path: Path, duration: float | None, options: Mapping[str, Any]) -> None:
    """An arm as servos on a serial line, until the time is over, Ctrl-C or SIGTERM.

    Args:
        robot: name or file.   path: of the link to the terminal.   duration: [s]; None: no end.
        options: of the command that are of servos, by name.
    """
    from armwright.twin.serial.registers import servo_model
    from armwright.twin.serial.servo_arm import ServoArm

    if options["period"] is None:
        refuse({"tick": options["tick"]}, "is of lock-step", error=BusError, expected="--period beside it")
    arm = aw.load(robot)
    with as_options(
        "servo", "ids", "baud", "schedule", "serial", "period", "tick", zeros="--zero", reversed="--reverse"
    ):
        line = line_of(options)
        start = start_of(arm, options["q0"], None).q
        goals = servo_model(line.model).by_name["goal_position"].address
        cycle = None if options["period"] is None else (options["period"], options["tick"] or f"sync-write:{goals}")
        made = ServoArm(arm, line, start=start, note=_note)
        with stopping(duration) as ended:
            more = {} if options["patience"] is None else {"patience": options["patience"]}
            counts = made.serve(path, ended, cycle=cycle, schedule=options["schedule"], ready=_ready(made), **more)
    rows = [
        ("simulated time", f"{made.plant.turn * made.plant.period:.6g} s"),
        ("instructions", str(counts.instructions)),
        ("replies", str(counts.replies)),
        ("late replies, not sent", str(counts.late)),
        ("baud rates of clients", ", ".join(map(str, sorted(counts.baud_rates))) or "none"),
    ]
    console_for_tables().print(table("servos at the end", HEADS, rows, HEADS))


def line_of(options: Mapping[str, Any]) -> Line:
    """The line of servos that options describe: servo, ids, baud, zero, reverse; None of those that were not given.

    Raises:
        BusError: words that are no ids or numbers.
    """
    from armwright.twin.serial.servo_arm import BAUD, Line

    return Line(
        options["servo"] or "sts3215",
        id_numbers(options["ids"]),
        BAUD if options["baud"] is None else options["baud"],
        numbers("--zero", options["zero"], "counts with commas between, one for each joint", error=BusError),
        words(options["reverse"] or ""),
    )


def id_numbers(text: str | None) -> list[int] | None:
    """Ids of text such as "1-6" or "1,2,5"; None of None.

    Raises:
        BusError: something else.
    """
    if text is None:
        return None
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if (
            not first.isdecimal()
            or (dash and not last.isdecimal())
            or (dash and int(last) - int(first) not in range(254))
        ):
            raise BusError(place="--ids", value=text, expected=RANGES)
        found += range(int(first), int(last or first) + 1)
    return found


def _ready(made: Any) -> Callable[[str], None]:
    def tell(device: str) -> None:
        say(made)
        say(f"servos on {device}")
        sys.stdout.flush()

    return tell


def _note(text: str) -> None:
    say(f"armwright: note: {text}", err=True)
    sys.stderr.flush()


@contextlib.contextmanager
def stopping(duration: float | None) -> Iterator[Callable[[], bool]]:
    """A function that is true once the time [s] is over, or after Ctrl-C or SIGTERM."""
    stopped, end = threading.Event(), None if duration is None else time.monotonic() + duration
    before = {name: signal.signal(name, lambda *_: stopped.set()) for name in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield lambda: stopped.is_set() or (end is not None and time.monotonic() >= end)
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)
