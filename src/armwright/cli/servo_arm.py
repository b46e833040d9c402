"""`armwright twin ARM --serial PATH`: a simulated arm as servos on a pseudo-terminal; `run-controller … --serial PORT`."""

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
from armwright.cli.dead_man import dead_man_key
from armwright.cli.outcome import check_file, exit_unless
from armwright.cli.tables import console_for_tables, show, table
from armwright.errors import BusError, OutputError, RunStopped
from armwright.terminal import note, say

if TYPE_CHECKING:
    from armwright.model import Model
    from armwright.simulation.scenario import Scenario
    from armwright.twin.serial.calibration import Calibration
    from armwright.twin.serial.capture import Captured
    from armwright.twin.serial.servo_arm import Line

HEADS = ("what", "how much")
SAID = ("servo", "ids", "baud", "approach", "patience", "serial", "calibration")  # options by argument
NAMED = {"zeros": "--zero", "reversed": "--reverse", "rate": "--period", "step": "--goal-distance"}
NAMED |= {"torque": "--torque-fraction"}
WARNING = (
    "the arm will move. Ctrl-C stops it at its present position, with torque on. If this computer or the cable fails, a servo "
    "without a bus watchdog (STS) goes to its last goal and holds it: keep a hand on the switch of the power supply"
)
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
    others = {"zeros": "--zero", "reversed": "--reverse", "schedule": "--write-schedule"}
    with as_options("servo", "ids", "baud", "serial", "period", "tick", **others):
        line = line_of(options)
        start = start_of(arm, options["start"], None).q
        goals = servo_model(line.model).by_name["goal_position"].address
        cycle = None if options["period"] is None else (options["period"], options["tick"] or f"sync-write:{goals}")
        made = ServoArm(arm, line, start=start, note=_note)
        with stopping(duration) as ended:
            more = {} if options["patience"] is None else {"patience": options["patience"]}
            counts = made.serve(
                path, ended, cycle=cycle, schedule=options["write-schedule"], ready=_ready(made), **more
            )
    rows = [
        ("simulated time", f"{made.plant.turn * made.plant.period:.6g} s"),
        ("instructions", str(counts.instructions)),
        ("replies", str(counts.replies)),
        ("late replies, not sent", str(counts.late)),
        ("replies that no client had room for", str(counts.unread)),
        ("baud rates of clients", ", ".join(map(str, sorted(counts.baud_rates))) or "none"),
    ]
    console_for_tables().print(table("servos at the end", HEADS, rows, HEADS))


def run_servos(scenario: Scenario, serial: str, options: Mapping[str, Any], go: bool, release: bool) -> None:
    """The controller of a scenario, run over a line of servos; without `go` it is only simulated.

    Args:
        scenario: with the controller.   serial: the port.   options: of the command that are of servos, by name.
        go: True: the arm moves.   release: True: torque is switched off after a complete run.
    """
    from armwright.twin.serial.arm_servos import ServoSettings
    from armwright.twin.serial.client import SerialPort
    from armwright.twin.serial.run import rehearse_servos, run_on_servos

    output = options["output"]
    check_file(output, (".csv",))
    names = {"step": "goal-distance", "approach": "approach", "patience": "patience"}
    given = {name: options[word] for name, word in names.items() if options[word] is not None}
    with as_options(*SAID, "speed", "following_error", **NAMED):
        line, stored = line_of(options), calibration_of(options["calibration"], needed=go)
        settings = ServoSettings(torque=options["torque"], release=release, **given)
        rehearsal = rehearse_servos(scenario, line, calibration=stored, settings=settings, speed=options["speed"])
        show(rehearsal)
        if not go:
            say("dry run: nothing was sent; --go runs it")
            return
        say(f"armwright: note: {WARNING}", err=True)  # with --quiet too
        # the key first: until it is pressed, Ctrl-C ends the command
        with SerialPort(serial, line.baud) as port, dead_man_key() as held, stopping(None) as stopped:
            try:
                run = run_on_servos(
                    rehearsal,
                    port,
                    stopped=lambda: stopped() or not (held is None or held()),
                    following_error=options["following_error"],
                    say=say,
                )
            except RunStopped as error:
                raise kept(error, output, error.run.captured, scenario.arm) from None
    keep(output, run.captured, scenario.arm)  # before all that is shown: standard output may have gone
    console_for_tables().print(run.tables()[0])
    say(f"{run.sentences()[0]}")
    exit_unless(run.complete)


def keep(output: Path | None, captured: Captured, arm: Model, how: str = "") -> None:
    """Writes the readings of a run, if there are any and they are to be kept; says so, and `how` the run ended."""
    if output is None:
        return
    if not captured.rows:
        note(f"no cycles until {captured}: {output} is left as it is")
        return
    log = captured.write(output, arm)
    say(f"wrote {output} and {log}{how}")


def kept(stop: RunStopped, output: Path | None, captured: Captured, arm: Model) -> RunStopped:
    """The error of a run that ended early, whose readings are written; with one more problem if they cannot be."""
    if not captured.rows:
        return stop
    try:
        keep(output, captured, arm, ", until the run ended")
    except OutputError as lost:
        return stop.joined(*lost.problems)
    return stop


def calibration_of(path: Path | None, *, needed: bool) -> Calibration | None:
    """The stored calibration of a file; None without one.

    Raises:
        BusError: there is none, and the arm is to move.
    """
    from armwright.twin.serial.arm_servos import HOW
    from armwright.twin.serial.calibration import read_calibration

    if path is None:
        if needed:
            raise BusError("there is none to compare the servos with", place="calibration", expected=HOW)
        return None
    return read_calibration(path)


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
    note(text)
    sys.stderr.flush()


@contextlib.contextmanager
def stopping(duration: float | None) -> Iterator[Callable[[], bool]]:
    """A function that is true once the time [s] is over, or after Ctrl-C, SIGTERM or the end of the terminal (SIGHUP)."""
    stopped, end = threading.Event(), None if duration is None else time.monotonic() + duration
    names, hang_up = [signal.SIGTERM, signal.SIGINT], getattr(signal, "SIGHUP", None)
    if hang_up is not None and signal.getsignal(hang_up) != signal.SIG_IGN:  # which nohup sets
        names.append(hang_up)
    before = {name: signal.signal(name, lambda *_: stopped.set()) for name in names}
    try:
        yield lambda: stopped.is_set() or (end is not None and time.monotonic() >= end)
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)
