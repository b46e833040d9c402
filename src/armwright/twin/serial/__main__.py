"""Servos on a pseudo-terminal, in a process of their own: `python -m armwright.twin.serial --servo sts3215:1-6 --path PATH`.

The joints are kinematic, for tests and first steps; `armwright twin ARM --serial PATH` has an arm behind them.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Sequence

from armwright.errors import ArmwrightError, BusError
from armwright.terminal import say
from armwright.twin.serial.bus import Losses, ServoBus, make_servo
from armwright.twin.serial.plant import KinematicPlant
from armwright.twin.serial.registers import model_names, servo_model
from armwright.twin.serial.servo import Servo
from armwright.twin.serial.terminal import Terminal, serve
from armwright.twin.serial.timing import PATIENCE, CycleEnd, GoalSchedule, LockStep, RealTime

MIDDLE = 2048.0  # [counts] where every joint begins


def _servos(texts: Sequence[str], values: dict[str, int]) -> list[Servo]:
    """Servos by texts such as "sts3215:1-6" or "xl330-m288:1,3"."""
    servos = []
    for text in texts:
        name, _, numbers = text.partition(":")
        model = servo_model(name)
        for part in numbers.split(","):
            first, _, last = part.partition("-")
            if not first.isdecimal() or not (last or first).isdecimal():
                raise BusError(place="--servo", value=text, expected="MODEL:IDS, such as sts3215:1-6 or sts3215:1,3")
            servos += [make_servo(model, number, **values) for number in range(int(first), int(last or first) + 1)]
    return servos


def _values(texts: Sequence[str]) -> dict[str, int]:
    """EEPROM values by texts such as "return_delay_time=0"."""
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not value.lstrip("-").isdecimal():
            raise BusError(place="--set", value=text, expected="REGISTER=WHOLE NUMBER")
        found[name] = int(value)
    return found


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m armwright.twin.serial", description="Servos on a pseudo-terminal.")
    parser.add_argument("--path", help="link to the terminal")
    parser.add_argument("--servo", action="append", required=True, metavar="MODEL:IDS", help=", ".join(model_names()))
    parser.add_argument(
        "--set", action="append", default=[], metavar="REGISTER=VALUE", help="of the EEPROM, of all servos"
    )
    parser.add_argument("--voltage", type=float, default=7.4, help="of the supply [V]")
    parser.add_argument("--period", type=float, help="of a cycle [s]: lock-step instead of real time")
    parser.add_argument("--tick", default="sync-write", help="instruction that closes a cycle, such as sync-write:42")
    parser.add_argument("--schedule", help="CSV file of the goals, written at the end")
    parser.add_argument("--lose", type=float, default=0.0, help="share of bytes that are lost")
    parser.add_argument("--seed", type=int, default=0, help="of what is lost")
    parser.add_argument("--patience", type=float, default=PATIENCE, help="[s] after which a reply is dropped")
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Exit code: 0 after SIGTERM or Ctrl-C, 1 after an error, which it prints."""
    given = _arguments().parse_args(words)
    ended = threading.Event()
    for name in {signal.SIGTERM, signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)}:
        if signal.getsignal(name) != signal.SIG_IGN:  # which nohup sets, and a shell for Ctrl-C of what runs behind it
            signal.signal(name, lambda *_: ended.set())
    try:
        servos = _servos(given.servo, _values(given.set))
        plant = KinematicPlant([MIDDLE] * len(servos), voltage=given.voltage)
        bus = ServoBus(servos, plant, Losses(given.lose, given.seed))
        schedule = GoalSchedule(bus, [f"servo{servo.number}" for servo in servos]) if given.schedule else None
        timing = RealTime(bus)
        if given.period is not None:
            timing = LockStep(bus, given.period, CycleEnd.parse(given.tick, bus.framing))
        with Terminal(given.path) as terminal:

            def ready() -> None:
                say(f"servos on {terminal.path or terminal.device}")
                sys.stdout.flush()  # who waits for the line reads it through a pipe

            try:
                counts = serve(terminal, bus, timing, ended.is_set, given.patience, ready)
            finally:
                if schedule is not None:
                    schedule.write(given.schedule)
            say(json.dumps(vars(counts) | {"baud_rates": sorted(counts.baud_rates), "unsent": terminal.unsent}))
    except ArmwrightError as error:
        say(str(error), err=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
