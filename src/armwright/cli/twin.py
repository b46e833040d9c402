"""`armwright twin` and `run-controller`: a simulated arm as drives on a bus, and a controller run over CAN."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import armwright as aw
from armwright.cli.arguments import (
    Allow,
    Position,
    argument,
    as_options,
    flag,
    node_numbers,
    option,
    output_option,
    refuse,
    robot_argument,
)
from armwright.cli.outcome import exit_unless
from armwright.cli.servo_arm import run_servos, serve_servos
from armwright.cli.tables import console_for_tables, show, table
from armwright.errors import BusError
from armwright.terminal import note, result, say

if TYPE_CHECKING:
    from armwright.simulation.scenario import Scenario
    from armwright.twin.cycles import CycleReport
    from armwright.twin.faults import Fault
    from armwright.twin.run import BusRun
    from armwright.twin.twin import Twin

CYCLES = ("what", "how much")  # heads of a table
ALONE = (
    "no other program reaches a virtual bus, so nothing will move; --bus udp_multicast:239.74.163.2 is one that "
    "other programs reach, and `armwright run-controller … --go` has a twin of its own on a virtual bus"
)
CAN_BUS = "virtual (default), socketcan:CHANNEL such as socketcan:can0, or udp_multicast:ADDRESS."
Nodes = Annotated[str | None, option("N1,N2,…", "Node numbers of the joints; default from 3.", ..., names="--nodes")]
Faults = Annotated[
    list[str] | None,
    option(
        "FAULT",
        "Inject a fault into the twin, KIND[:JOINT][=AMOUNT][@S]: lost-frames, late-sync, stuck-encoder, over-temperature, "
        "supply-sag; may be repeated.",
        ...,
        names="--fault",
    ),
]
File = Annotated[Path, argument("SCENARIO", "A .scenario.toml with a controller.")]
Reference = Annotated[
    Path | None,
    option("FILE", "Motion that the controller follows: .motion.toml, .csv or .nc.", ..., names="--reference"),
]
Seconds = Annotated[
    float | None, option("S", "Duration in s of the run; default: the scenario's.", ..., names="--duration")
]


def twin(
    arm: Annotated[
        str,
        robot_argument(
            "A .scenario.toml with a controller; with --serial, a built-in arm or a robot's file.",
            metavar="ROBOT|SCENARIO",
        ),
    ],
    bus: str | None = option("BUS", CAN_BUS),
    nodes: Nodes = None,
    bitrate: int | None = option("BIT/S", "Bit rate of the CAN bus, for the time that frames take; default 500000."),
    serial_number: int | None = option("N", "Serial number in object 1018 of every node; default 1."),
    fault: Faults = None,
    duration: float | None = option("S", "Duration in s on the bus; by default until Ctrl-C."),
    write_eds: Path | None = option("FOLDER", "Write the nodes' electronic data sheets and exit."),
    reference: Reference = None,
    speed: float | None = option("V", "Speed of the run; stretches times of payloads and wrenches too; default 1."),
    allow: Allow = None,
    serial: str | None = option("PORT", "Be servos on a serial line instead, a pseudo-terminal with this link."),
    servo: str | None = option("MODEL", "Model of all servos: sts3215 (default), xl330-m288, xl430-w250."),
    ids: str | None = option("1-6", "Ids of the servos, such as 1-6 or 1,2,5; default from 1."),
    baud: int | None = option("BIT/S", "Baud rate of the serial line; default 1000000."),
    zero: str | None = option("C1,C2,…", "Counts of the encoders where joints are at 0; default 2048."),
    reverse: str | None = option("J1,J2,…", "Joints that turn the other way than their encoders count."),
    q0: Position = None,
    period: float | None = option(
        "S", "Period in s of a cycle in lock-step, where frames advance the time; default real time."
    ),
    tick: str | None = option("NAME[:ADDRESS]", "Instruction that closes a cycle; default sync-write:42 or :116."),
    patience: float | None = option(
        "S", "Longest time in s of a reply; a later one is dropped; default 0.025, as clients give up at 0.034."
    ),
    write_schedule: Path | None = option(
        "FILE.scenario.toml", "Write goals and their times; simulated, they have the same bits."
    ),
) -> None:
    """Put a simulated arm on a bus, as its drives: a CAN bus with CiA 402 drives, or a serial line with servos.

    On a CAN bus, time is counted in SYNCs, which a master sends. A virtual bus exists within one process: there
    `run-controller` starts its own twin. The end shows the number of cycles, and how many were late or incomplete.

    With --serial the arm's joints must follow goals by their servos' firmware (`command = "position"`). The makers' own
    software and LeRobot open PORT as the port of the arm. Its registers begin with the numbers of the record.

    \b
    Examples:
      armwright twin arm.scenario.toml --bus udp_multicast:239.74.163.2
      armwright twin arm.scenario.toml --bus socketcan:vcan0 --fault stuck-encoder:joint2@1.5
      armwright twin arm.scenario.toml --write-eds sheets
      armwright twin arm.toml --serial /tmp/arm --ids 1-6
      armwright twin arm.toml --serial /tmp/arm --period 0.02 --tick sync-write:42 --write-schedule run.scenario.toml
    """
    on_can = {"bus": bus, "nodes": nodes, "bitrate": bitrate, "serial-number": serial_number, "fault": fault}
    on_can |= {"write-eds": write_eds, "reference": reference, "speed": speed, "allow": allow}
    on_line = {"servo": servo, "ids": ids, "baud": baud, "zero": zero, "reverse": reverse, "start": q0}
    on_line |= {"period": period, "tick": tick, "patience": patience, "write-schedule": write_schedule}
    if serial is not None:
        refuse(on_can, "is of a CAN bus, beside --serial", error=BusError, with_value=True)
        serve_servos(arm, Path(serial), duration, on_line)
        return
    refuse(on_line, "is of servos", error=BusError, with_value=True, expected="--serial PATH beside it")
    _can_twin(Path(arm), duration, on_can)


def _can_twin(scenario: Path, duration: float | None, options: Mapping[str, Any]) -> None:
    """The arm of a scenario on a CAN bus.

    Args:
        scenario: its file.   duration: [s]; None: until Ctrl-C.   options: of the command that are of a CAN bus, by name.
    """
    from armwright.twin.bus import is_virtual
    from armwright.twin.safety import reduced
    from armwright.twin.twin import Twin

    given = {name: value for name, value in options.items() if value is not None}
    bus, eds = given.get("bus", "virtual"), options["write-eds"]
    _, found = _scenarios(scenario, options["allow"], options["reference"], None)
    with as_options("nodes", "bus", "bitrate", "speed", serial="--serial-number"):
        found = reduced(found, given.get("speed", 1.0))
        made = Twin(
            found,
            bus,
            nodes=node_numbers(options["nodes"], BusError),
            serial=given.get("serial-number", 1),
            faults=_faults(found, options["fault"]),
            bitrate=given.get("bitrate", 500_000),
        )
    if eds is not None:
        _write_sheets(made, eds)
        return
    if is_virtual(bus):
        note(ALONE)
    with made:
        numbers = ", ".join(f"{name} {node.number}" for name, node in zip(made.arm.names, made.nodes, strict=True))
        say(f"{made.arm.name} on {bus}: {numbers}; {made.load}")
        _wait(made, duration)
    _show_cycles("the twin's cycles", made.cycles.report)
    heads = ("joint", "state", "error")
    states = [(drive.name, drive.state.name.lower().replace("_", " "), f"0x{drive.error:04X}") for drive in made.drives]
    console_for_tables().print(table("drives at the end", heads, states, heads))
    if made.failure is not None:
        raise made.failure


def run_controller(
    scenario: File,
    bus: str | None = option("BUS", CAN_BUS),
    go: bool = flag("--go", "Run. Without it nothing is sent, and the run is only simulated."),
    nodes: Nodes = None,
    eds: list[Path] | None = option("FILE", "Data sheet of the nodes, or one for each; by default that of the twin."),
    real_time: bool = flag("--real-time", "A SYNC every period by the clock; on a virtual bus SYNC waits by default."),
    speed: float = option("V", "Speed of the reference, in parts of it; default 1.", 1.0),
    torque: float = option(
        "F",
        "Largest torque, in parts of the rated one; of servos largest duty; default 1.",
        1.0,
        names="--torque-fraction",
    ),
    following_error: float | None = option(
        "E", "In rad or m, ends the run; by default twice that of the simulated run."
    ),
    missing: int | None = option("N", "Answers that a node misses in a row before the run ends; default 2."),
    bitrate: int | None = option("BIT/S", "Bit rate of the CAN bus, for the time that frames take; default 500000."),
    release: bool = flag(
        "--release", "Disable drives that hold the arm after a run; where nothing else does, it falls."
    ),
    arm: int | None = option(
        "N", "Serial number of the arm, on a CAN bus that is not virtual.", names="--serial-number"
    ),
    fault: Faults = None,
    reference: Reference = None,
    duration: Seconds = None,
    allow: Allow = None,
    serial: str | None = option("PORT", "Serial port of an arm of servos, in place of a CAN bus."),
    calibration: Path | None = option("FILE", "Stored calibration of the servos; needed with --go."),
    servo: str | None = option("MODEL", "Model of all servos: sts3215 (default), xl330-m288, xl430-w250."),
    ids: str | None = option("1-6", "Ids of the servos, such as 1-6 or 1,2,5; default the calibration's, or from 1."),
    baud: int | None = option("BIT/S", "Baud rate of the serial line; default 1000000."),
    zero: str | None = option(
        "C1,C2,…", "Counts that the servos show where joints are at 0; default the calibration's, or 2048."
    ),
    reverse: str | None = option("J1,J2,…", "Joints that turn the other way than their encoders count."),
    goal_distance: float | None = option("RAD", "Farthest that a goal may be from the measured position; default 0.3."),
    approach: float | None = option("RAD_PER_S", "Largest speed on the way to where the run begins; default 0.2."),
    patience: float | None = option("S", "Longest wait in s for the servos' answers; default 0.05."),
    output: Path | None = output_option("LOG.csv", "Goals and measurements of servos, a row a cycle."),
) -> None:
    """Run the controller of a scenario over a CAN bus or a line of servos, against the twin or a real arm.

    By default this is a dry run: the run is simulated as the bus would carry it, limits are checked, and nothing is sent.
    With --go it happens: on a virtual bus against a twin in this process, in lock-step and so exactly as simulated;
    elsewhere in real time, against nodes with the serial number given by --serial-number. A real arm needs a passing verdict of
    `armwright validate` on the scenario, a first run with at most --speed 0.25 --torque-fraction 0.5, and the space bar held down
    while it moves. Whatever ends a run, all drives that answer get a quick stop; where the record has no brakes they hold
    the arm until --release.

    With --serial the controller's commands are the goals of servos. --go needs their calibration, of `armwright capture
    --calibrate` or of LeRobot, and goes slowly to where the scenario begins; in a terminal the space bar is held down.
    Whatever ends a run, the present position becomes the goal, with torque on; --release switches it off after a
    complete run.

    Exit code: 0 complete; 1 ended early (a node lost, a fault, a following error, the key released) or, in lock-step,
    different from the simulation; 2 refused before a drive was enabled; 130 Ctrl-C on a CAN bus, with the state of all joints.
    With --serial Ctrl-C ends a run early, exit code 1.

    \b
    Examples:
      armwright run-controller arm.scenario.toml
      armwright run-controller arm.scenario.toml --go
      armwright run-controller arm.scenario.toml --bus udp_multicast:239.74.163.2 --serial-number 1 --go
      armwright run-controller arm.scenario.toml --serial /dev/ttyUSB0 --calibration my.calibration.json --go -o run.csv
    """
    on_line = {"calibration": calibration, "servo": servo, "ids": ids, "baud": baud, "zero": zero, "reverse": reverse}
    on_line |= {"goal-distance": goal_distance, "approach": approach, "patience": patience, "output": output}
    if serial is not None:
        on_can = {"bus": bus, "nodes": nodes, "eds": eds, "real-time": real_time or None, "missing": missing}
        on_can |= {"bitrate": bitrate, "serial-number": arm, "fault": fault}
        refuse(on_can, "is of a CAN bus, beside --serial", error=BusError, with_value=True)
        _, found = _scenarios(scenario, allow, reference, duration)
        limits = {"speed": speed, "torque": torque, "following_error": following_error}
        run_servos(found, serial, on_line | limits, go, release)
        return
    refuse(on_line, "is of servos", error=BusError, with_value=True, expected="--serial PORT beside it")
    bus, bitrate, missing = bus or "virtual", 500_000 if bitrate is None else bitrate, 2 if missing is None else missing
    from armwright.twin.bus import check_bus, is_virtual
    from armwright.twin.rehearsal import rehearse
    from armwright.twin.run import check_arguments, release_drives, run_controller as run_over_bus
    from armwright.twin.safety import Permission

    check_bus(bus)
    read, found = _scenarios(scenario, allow, reference, duration)
    faults, numbers = _faults(found, fault), node_numbers(nodes, BusError)
    with as_options("speed", "nodes", "bitrate", "following_error", "missing", torque="--torque-fraction"):
        rehearsal = rehearse(found, bitrate=bitrate, speed=speed, torque=torque, nodes=numbers)
        check_arguments(rehearsal, following_error=following_error, missing=missing)
    motion = (b"" if reference is None else reference.read_bytes()) + str(duration).encode()
    permission = Permission.of(scenario, read, motion, serial=arm, speed=speed, torque=torque)
    if release:
        with as_options("nodes", arm="--serial-number"):
            release_drives(rehearsal, bus, nodes=numbers, permission=permission)
        say("all drives are disabled")
        return
    show(rehearsal)
    if not go:
        say("dry run: nothing was sent; --go runs it")
        return
    with contextlib.ExitStack() as stack:
        if is_virtual(bus):
            from armwright.twin.twin import Twin

            made = Twin(rehearsal.source, bus, nodes=numbers, faults=faults, bitrate=bitrate)
            stack.enter_context(made)
        elif fault:
            raise BusError("are injected where the twin runs", place="--fault", expected="armwright twin … --fault")
        else:
            from armwright.cli.dead_man import dead_man_key

            permission = replace(permission, may_move=stack.enter_context(dead_man_key()))
        with as_options("speed", "real_time", "nodes", arm="--serial-number"):
            run = run_over_bus(
                rehearsal,
                bus,
                nodes=numbers,
                eds=[str(path) for path in eds or ()],
                real_time=real_time or not is_virtual(bus),
                following_error=following_error,
                missing=missing,
                permission=permission,
            )
    in_lock_step = is_virtual(bus) and not real_time  # where nothing but the twin can differ
    _show_run(run, faults, rehearsal.recording.ticks, in_lock_step)
    if not is_virtual(bus):
        say(str(run.ending))
        if permission.reduced and run.complete and not run.counts:
            incomplete = f"{run.cycles.incomplete} of {run.cycles.cycles} cycles were incomplete"
            say(f"this run is no rehearsal: {incomplete}, 0.1 % are allowed")
    exit_unless(run.complete and (run.equal or not in_lock_step))


def _show_run(run: BusRun, faults: Sequence[Fault], ticks: int, in_lock_step: bool) -> None:
    """The run's table, its cycles where a clock made them, and how it differs from the simulation."""
    console_for_tables().print(run.tables()[0])
    if not in_lock_step:
        _show_cycles("the master's cycles", run.cycles)
    say("positions and commands are those of the simulation, to the bit" if run.equal else _how_it_differs(run, faults))
    if not run.complete:
        say(f"stopped after {len(run.time)} of {ticks} cycles: the space bar was released")


def _how_it_differs(run: BusRun, faults: Sequence[Fault]) -> str:
    """The first difference from the simulation as a sentence, with the faults that the twin had."""
    if run.first_difference is None:
        return "as far as it ran, positions and commands are those of the simulation"
    cause = f"; faults were injected: {', '.join(map(str, faults))}" if faults else ""
    return f"{run.first_difference}{cause}"


def _scenarios(
    path: Path, allow: Sequence[Path] | None, reference: Path | None, duration: float | None
) -> tuple[Scenario, Scenario]:
    """The scenario of a file unchanged, and with one arm that starts at the beginning of a motion and follows it.

    Lanes, and what varies by lane, are left out.
    """
    from armwright.cli.simulate import following

    read = found = aw.read_scenario(path, allow=allow or ())
    if (found.lane_count or 1) > 1:
        note(f"{path.name} has {found.lane_count} lanes; the twin is the nominal arm, without them")
        found = replace(found, lanes=None, vary={})
    if reference is not None:
        found = following(found, reference, str(path))
        motion = found.reference
        at = motion(0.0)
        q = getattr(at, "q", at[0] if isinstance(at, tuple) else at)
        ticks = math.ceil(motion.duration / found.tick - 1e-9)
        found = replace(found, start=q, duration=ticks * found.tick)
    if duration is not None:
        found = replace(found, duration=duration)
    return read, found


def _faults(scenario: Scenario, texts: Sequence[str] | None) -> list[Fault]:
    from armwright.twin.faults import read_fault

    with as_options("fault"):
        return [read_fault(text, scenario.arm.names) for text in texts or ()]


def _write_sheets(made: Twin, folder: Path) -> None:
    from armwright.export.c import folder_to_write
    from armwright.output import file_stem, write_whole

    with folder_to_write(folder):
        for node in made.nodes:
            path = folder / f"{file_stem(made.arm.name)}-{node.number}.eds"
            write_whole(path, node.eds)
            say(f"wrote {path}")


def _wait(made: Twin, duration: float | None) -> None:
    """Waits until the time is over, Ctrl-C, or the simulation has ended."""
    end = None if duration is None else time.monotonic() + duration
    with contextlib.suppress(KeyboardInterrupt):  # what was counted is shown
        while made.failure is None and (end is None or time.monotonic() < end):
            time.sleep(0.05)


def _show_cycles(title: str, report: CycleReport) -> None:
    console_for_tables().print(table(title, CYCLES, report.rows(), CYCLES))
    result(report)
