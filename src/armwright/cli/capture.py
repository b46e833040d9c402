"""`armwright capture`: a motion played by an arm of bus servos, and what they measured on the way."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import Robot, as_options, flag, option, output_option
from armwright.cli.outcome import check_file
from armwright.cli.servo_arm import line_of, stopping
from armwright.cli.tables import console_for_tables, table
from armwright.errors import BusError, RunStopped
from armwright.terminal import say

HEADS = ("joint", "id", "range [rad]", "range [counts]", "speed [rad/s]", "goal speed [rad/s]")
WARNING = (
    "the arm will move. Ctrl-C stops it where it is, with torque on. If this computer dies, a servo without a watchdog of the "
    "bus (STS) holds its last goal: keep a hand at the switch of the supply"
)


def capture(
    robot: Robot,
    serial: str = option("PORT", "Serial port of the arm, such as /dev/ttyUSB0 or COM3.", ...),
    motion: Path = option("FILE", "Motion: .csv or .nc of `armwright plan` or `armwright excite`.", ...),
    output: Path | None = output_option("LOG.csv", "Goals and measurements, a row a cycle; needed with --go."),
    go: bool = flag("--go", "Move. Without it nothing is sent, and the motion is only checked."),
    servo: str | None = option("MODEL", "Of all servos: sts3215 (default), xl330-m288, xl430-w250."),
    ids: str | None = option("1-6", "Ids of the servos, such as 1-6 or 1,2,5; default from 1."),
    baud: int | None = option("BIT/S", "Of the serial line; default 1000000."),
    zero: str | None = option("C1,C2,…", "Counts of the encoders where joints are at 0; default 2048."),
    reverse: str | None = option("J1,J2,…", "Joints that turn the other way than their encoders count."),
    rate: float = option("HZ", "Cycles a second; default 50.", 50.0),
    step: float = option("RAD", "That a goal may be away from the measured position; default 0.3.", 0.3),
    torque: float = option("F", "Largest duty, in parts of the whole; default 0.5.", 0.5),
    release: bool = flag("--release", "Switch torque off at the end; the arm then falls."),
) -> None:
    """Play a motion on an arm of bus servos, and log goals, positions, speeds, loads and voltages with their times.

    By default this is a dry run: limits of the record and of the encoders are checked, and nothing is sent. With --go, ids
    and models are checked, goal speed and torque limit are written, and the arm must stand where the motion begins before
    torque is switched on. Whatever ends a run, the present position becomes the goal, with torque on.

    Exit code: 0 complete or stopped by Ctrl-C; 1 ended early, since a servo was silent or too far from its goal; 2 refused.

    \b
    Examples:
      armwright capture arm.toml --serial /dev/ttyUSB0 --motion swing.csv
      armwright capture arm.toml --serial /dev/ttyUSB0 --motion swing.csv --go -o swing-log.csv
    """
    from armwright.twin.serial.capture import CaptureSettings, capture as play, plan_capture
    from armwright.twin.serial.client import SerialPort

    if go and output is None:
        raise BusError("missing", place="--output", expected="-o LOG.csv beside --go")
    check_file(output, (".csv",))
    with as_options("servo", "ids", "baud", "rate", "step", "torque", "serial", zeros="--zero", reversed="--reverse"):
        line = line_of({"servo": servo, "ids": ids, "baud": baud, "zero": zero, "reverse": reverse})
        plan = plan_capture(aw.load(robot), motion, line, CaptureSettings(rate, step, torque, release))
        title = f"{plan.arm.name}: {plan.times[-1]:.4g} s in {len(plan.times)} cycles"
        console_for_tables().print(table(title, HEADS, plan.rows(), HEADS))
        if not go:
            say("dry run: nothing was sent; --go moves the arm")
            return
        assert output is not None
        say(f"armwright: note: {WARNING}", err=True)
        with SerialPort(serial, line.baud) as port, stopping(None) as stopped:
            try:
                found = play(plan, port, stopped)
            except RunStopped as error:
                error.run.write(output)
                say(f"wrote {output}, until the run ended")
                raise
    found.write(output)
    say(f"wrote {output}: {len(found.rows)} rows until {found.reason}, {found.missed} answers missed")
