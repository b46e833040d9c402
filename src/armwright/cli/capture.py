"""`armwright capture`: a motion played by an arm of bus servos, and what they measured on the way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import armwright as aw
from armwright.cli.arguments import Robot, as_options, flag, option, output_option, refuse
from armwright.cli.outcome import check_file
from armwright.cli.servo_arm import NAMED, SAID, WARNING, calibration_of, keep, kept, line_of, stopping
from armwright.cli.tables import console_for_tables, table
from armwright.errors import BusError, RunStopped
from armwright.terminal import note, say

if TYPE_CHECKING:
    from armwright.model import Model
    from armwright.twin.serial.capture import CapturePlan
    from armwright.twin.serial.servo_arm import Line

HEADS = ("joint", "id", "range [rad]", "range [counts]", "speed [rad/s]", "goal speed [rad/s]")
STORED = ("joint", "id", "model", "firmware", "drive mode", "offset", "lowest", "highest")


def capture(
    robot: Robot,
    serial: str = option("PORT", "Serial port of the arm, such as /dev/ttyUSB0 or COM3.", ...),
    reference: Path | None = option("FILE", "Motion to follow: .csv or .nc of `armwright plan` or `armwright excite`."),
    calibration: Path | None = option(
        "FILE", "Stored calibration, of --calibrate or LeRobot, that the servos must have; needed with --go."
    ),
    calibrate: Path | None = option(
        "FILE.json", "Write the servos' ids, models, firmware, offsets and limits as a calibration; moves nothing."
    ),
    output: Path | None = output_option("LOG.csv", "Goals and measurements, a row a cycle; needed with --go."),
    go: bool = flag("--go", "Move. Without it nothing is written to servos, and the motion is only checked."),
    servo: str | None = option("MODEL", "Model of all servos: sts3215 (default), xl330-m288, xl430-w250."),
    ids: str | None = option("1-6", "Ids of the servos, such as 1-6 or 1,2,5; default the calibration's, or from 1."),
    baud: int | None = option("BIT/S", "Baud rate of the serial line; default 1000000."),
    zero: str | None = option(
        "C1,C2,…", "Counts that the servos show where joints are at 0; default the calibration's, or 2048."
    ),
    reverse: str | None = option("J1,J2,…", "Joints that turn the other way than their encoders count."),
    period: float = option("S", "Period in s of a cycle; default 0.02.", 0.02),
    goal_distance: float = option("RAD", "Farthest that a goal may be from the measured position; default 0.3.", 0.3),
    approach: float = option(
        "RAD_PER_S", "Largest speed of a joint on the way to where the motion begins; default 0.2.", 0.2
    ),
    torque_fraction: float = option("F", "Largest duty, in parts of the whole; default 0.5.", 0.5),
    patience: float = option("S", "Longest wait in s for the servos' answers; default 0.05.", 0.05),
    release: bool = flag("--release", "Switch torque off at the end; the arm then falls."),
) -> None:
    """Play a motion on an arm of bus servos, and log goals, positions, speeds, loads and voltages with their times.

    With --calibrate, ids, models, firmware, offsets and limits are read from the servos and stored; nothing moves. By default
    a motion gets a dry run: limits of the record, the encoders and the calibration are checked, and, if the port can be
    opened, the servos are read and compared; nothing is written to them. With --go, servos that differ from the calibration
    are refused, goal speed and torque limit are written, torque is switched on, and the arm goes slowly to where the motion
    begins. Whatever ends a run, the present position becomes the goal, with torque on.

    Exit code: 0 complete or stopped by Ctrl-C; 1 ended early: a servo was silent, had an alarm, restarted or was too far from its
    goal, or cycles took longer than their period; 2 refused.

    \b
    Examples:
      armwright capture arm.toml --serial /dev/ttyUSB0 --calibrate my.calibration.json
      armwright capture arm.toml --serial /dev/ttyUSB0 --reference swing.csv --calibration my.calibration.json
      armwright capture arm.toml --serial /dev/ttyUSB0 --reference swing.csv --calibration my.calibration.json --go -o log.csv
    """
    from armwright.twin.serial.arm_servos import ServoSettings
    from armwright.twin.serial.capture import capture as play, plan_capture
    from armwright.twin.serial.client import SerialPort

    with as_options(*SAID, **NAMED):
        arm, line = (
            aw.load(robot),
            line_of({"servo": servo, "ids": ids, "baud": baud, "zero": zero, "reverse": reverse}),
        )
        if calibrate is not None:
            refuse(
                {"reference": reference, "calibration": calibration, "output": output}, "is of a motion", error=BusError
            )
            _store(arm, line, serial, calibrate)
            return
        if reference is None:
            raise BusError("missing", place="--reference", expected="--reference FILE or --calibrate FILE.json")
        if go and output is None:
            raise BusError("missing", place="--output", expected="-o LOG.csv beside --go")
        check_file(output, (".csv",))
        if not 1e-3 <= period <= 10.0:
            raise BusError(place="--period", value=period, expected="1e-3 … 10 s")
        settings = ServoSettings(1.0 / period, goal_distance, torque_fraction, release, approach, patience)
        plan = plan_capture(arm, reference, line, settings, calibration_of(calibration, needed=go))
        title = f"{arm.name}: {plan.times[-1]:.4g} s in {len(plan.times)} cycles"
        console_for_tables().print(table(title, HEADS, plan.rows(), HEADS))
        if not go:
            _end_of_dry_run(plan, serial, line.baud)
            return
        assert output is not None
        say(f"armwright: note: {WARNING}", err=True)  # with --quiet too
        with SerialPort(serial, line.baud) as port, stopping(None) as stopped:
            try:
                found = play(plan, port, stopped, say)
            except RunStopped as error:
                raise kept(error, output, error.run, arm) from None
    keep(output, found, arm, f": {len(found.rows)} rows until {found}")


def _store(arm: Model, line: Line, serial: str, path: Path) -> None:
    """Reads a calibration from the servos and writes it."""
    from armwright.twin.serial.arm_servos import ArmServos, ServoFit
    from armwright.twin.serial.client import SerialPort

    check_file(path, (".json",))
    with SerialPort(serial, line.baud) as port:
        found = ArmServos(port, ServoFit.of(arm, line)).read_calibration(line)
    keys = ("id", "model_number", "firmware", "drive_mode", "homing_offset", "range_min", "range_max")
    rows = [[name, *(str(getattr(servo, key)) for key in keys)] for name, servo in found.joints.items()]
    console_for_tables().print(table(f"{arm.name}: servos", STORED, rows, STORED))
    found.write(path)
    say(f"wrote {path}")


def _end_of_dry_run(plan: CapturePlan, serial: str, baud: int) -> None:
    """The end of a dry run: compares the servos if the port can be opened, and says how far the approach is."""
    from armwright.twin.serial.arm_servos import ArmServos
    from armwright.twin.serial.capture import approach
    from armwright.twin.serial.client import SerialPort

    try:
        port = SerialPort(serial, baud)
    except BusError as error:
        note(f"{error}; the servos were not read")
        say(f"approach: at most {plan.longest_approach}")
    else:
        with port:
            servos = ArmServos(port, plan.fit, plan.settings.patience)
            servos.identify()
            say(f"approach of {approach(plan.fit, servos.positions(), plan.goals[0], plan.settings)}")
    if plan.fit.calibration is None:
        note("without --calibration, --go is refused")
    say("dry run: nothing was written to servos; --go moves the arm")
