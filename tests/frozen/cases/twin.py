"""Drives by CiA 402: units, objects, states, and what they do at every SYNC when they are commanded, stopped and at fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

import armwright as aw
from armwright.errors import ArmwrightError
from armwright.model import build_model
from armwright.twin import faults, objects as od
from armwright.twin.bus import BusLoad, check_bus, frame_bits, is_virtual, node_numbers
from armwright.twin.cycles import CycleReport, Cycles
from armwright.twin.drive import TwinDrive
from armwright.twin.faults import KINDS, Fault, read_fault
from armwright.twin.homing import Homing
from armwright.twin.profile import Servo, approach, slowed
from armwright.twin.state_machine import CODES, HELD, POWERED, TRANSITIONS, Event, State, StateMachine, commanded
from armwright.twin.units import BusUnits
from frozen.cases.export import linked
from frozen.numbers import Case
from frozen.texts import rounded
from simulation.plants import MOTOR
from twin.buses import small_arm, small_scenario
from twin.test_drive import Joint

LIMITS = {"position_rad": [-2.0, 1.5], "velocity_rad_per_s": 2.0, "torque_n_m": 40.0, "current_a": 6.0}


def refusals(call: Callable[..., Any], *arguments: tuple[Any, ...]) -> list[str]:
    """What a call says to each of some arguments: its result, or the error's fields."""
    found = []
    for each in arguments:
        try:
            found.append(f"{call(*each)}")
        except ArmwrightError as error:
            found.append("; ".join(f"{p.place} | {p.value} | {p.expected} | {p.what}" for p in error.problems))
    return [rounded(each) for each in found]


# Frames, numbers, units.


def load(nodes: int, period: float, bitrate: int = 500_000) -> dict[str, Any]:
    """Times of frames of a cycle."""
    it = BusLoad(nodes, period, bitrate)
    times = [[each(stuffed=s) for each in (it.answered, it.cycle, it.load)] for s in (False, True)]
    return {"times": times, "words": str(it), "checked": refusals(it.check, ()), "60C2": refusals(it.interpolation, ())}


def drives() -> aw.Model:
    """A turning drive of torque, one of current against its joint, and a sliding one."""
    slide = {"position_m": [0.0, 0.5], "velocity_m_per_s": 0.3, "force_n": 80.0}
    return build_model(
        linked(
            {"command": "torque", "limits": LIMITS},
            {"command": "current", "motor": {**MOTOR, "gear_ratio": -30.0}, "limits": LIMITS},
            {"type": "prismatic", "command": "torque", "limits": slide},
            {"command": "current", "motor": MOTOR, "limits": LIMITS | {"current_a": 1e3}},
        )
    )  # fmt: skip


def units_of(arm: aw.Model, **sensors: Any) -> BusUnits:
    """Units of an arm's bus."""
    return BusUnits.of(aw.Scenario(arm, 1.0, loop=aw.Loop(period=1e-3, sensors=aw.Sensors(side="link", **sensors))))


def conversions(units: BusUnits) -> dict[str, Any]:
    """Numbers there and back."""
    q, u = np.array([0.1234567, -1.0, 0.30000049, 1.0]), np.array([7.77, -3.0, 79.96, 0.0149])
    return {
        "counts": units.counts(q), "position": units.position(units.counts(q)), "thousandths": units.thousandths(u),
        "command": units.command(units.thousandths(u)), "limit": units.limit, "units": units,
    }  # fmt: skip


def refused_units() -> list[str]:
    """Arms that no frame can carry."""
    row = {"command": "torque", "limits": LIMITS}
    motors = {"command": "current", "motor": {**MOTOR, "coupling": [{"joint": "j0", "ratio": 2.0}]}, "limits": LIMITS}
    driven = {"command": "voltage", "motor": MOTOR, "limits": LIMITS}
    free, weak = {"velocity_rad_per_s": 2.0, "torque_n_m": 1.0}, {k: v for k, v in LIMITS.items() if "_n_m" not in k}
    models = (
        (row, driven, driven), (row, motors), ({**row, "limits": free},), ({**row, "limits": weak},),
        ({**row, "limits": {k: v for k, v in LIMITS.items() if "velocity" not in k}},),
    )  # fmt: skip
    found = refusals(units_of, *((build_model(linked(*each)),) for each in models))
    far = build_model(linked({**row, "limits": LIMITS | {"position_rad": [-9e4, 1.0]}}))
    return found + refusals(partial(units_of, far, counts=2_000_000), ()) + refusals(units_of, (aw.load("so101"),))


# Objects.


def dictionary() -> dict[str, Any]:
    """The table of objects, as an EDS and as it is."""
    keys = (od.RECEIVED, od.SENT, (od.CONTROLWORD, od.MODE), tuple(od.CHOICES)[:1])
    tables = (od.MODES, od.CYCLIC, od.HERE, od.SEARCHES, od.CHOICES, od.ABOVE_ZERO, od.RECORDS, od.ENTRIES)
    return {
        "eds": od.eds_text(5, "arm jöint", {od.MAX_SPEED: 77, (0x608F, 1): 5}),
        "mappings": [od.mapping(each) for each in keys], "packings": [od.packing(each).format for each in keys],
        "bounds": [od.bounds(kind) for kind in (od.I8, od.I16, od.I32, od.U8, od.U16, od.U32)],
        "too long": refusals(od.mapping, ((od.POSITION, od.POSITION_DEMAND, od.MODE),), ((od.POSITION, od.VELOCITY),)),
        **{f"table {k}": repr(each) for k, each in enumerate(tables)},
        "bits": [od.BRAKE, od.NEGATIVE, od.POSITIVE, od.HOME, od.INVALID, od.DEVICE_TYPE, od.TWIN_PRODUCT],
    }  # fmt: skip


# States.


def machine_at(state: State) -> StateMachine:
    """A machine in a state."""
    machine = StateMachine()
    machine.state = state
    return machine


def transitions(**options: bool) -> dict[str, str]:
    """Numbers of the transitions that every controlword and every event make, by state; the last word was 0, then 0x80."""
    found = {}
    for state in State:
        rows = []
        for last in (0x00, 0x80):
            for word in range(0x100):
                machine = machine_at(state)
                machine.word = last
                row = machine.command(word, **options)
                after = machine.proceed()
                rows.append((row and row.number, after and after.number, machine.state.name, machine.word))
        events = [
            (event.name, row and row.number) for event in Event if (row := machine_at(state).happened(event)) or True
        ]
        found[state.name] = f"{rows} {events}"
    return found


def tables_of_states() -> dict[str, Any]:
    """The table of transitions, and what words command."""
    return {
        "rows": repr([(each.number, each.source.name, each.cause.name, each.target.name) for each in TRANSITIONS]),
        "codes": repr([code and code.name for code in CODES]), "values": [state.value for state in State],
        "powered": repr([state.name for state in POWERED]), "held": repr([state.name for state in HELD]),
        "commanded": repr([(word, last, commanded(word, last)) for word in range(0, 256, 3) for last in (0, 0x80)]),
    }  # fmt: skip


# A drive with an ideal motor.

Steps = list[tuple[int | None, int, dict[tuple[int, int], int]]]  # controlword or none, ticks, values of objects before


def walked(joint: Joint, steps: Steps, received: bool = True) -> dict[str, Any]:
    """Speeds, set-points, statuswords and what a master reads, at every tick of some steps."""
    rows, words, drive = [], [], joint.drive
    for word, ticks, values in steps:
        drive.values |= values
        if word is not None:
            drive.values[od.CONTROLWORD] = word
            drive.command(word)
        for _ in range(ticks):
            joint.run()
            point = joint.point
            rows.append((joint.q, joint.v, point.torque or 0.0, point.position, point.speed, point.feedforward))
            words.append((drive.statusword, drive.state.value, drive.mode, drive.error, drive.inputs, drive.moves))
    return {
        "rows": np.array(rows), "words": np.array(words), "passed": drive.machine.passed, "sent": drive.emergencies,
        "reads": [drive.read(key) or 0 for key in READ], "offset": drive.offset, "none": drive.read((0x7FFF, 0)),
    }  # fmt: skip


READ = (
    od.STATUSWORD, od.POSITION, od.POSITION_DEMAND, od.FOLLOWING_ERROR, od.VELOCITY, od.CURRENT, od.INPUTS, od.SUPPLY,
    od.ERROR_CODE, od.ERROR_REGISTER, od.MODE_DISPLAY, od.TORQUE, od.SUPPORTED_MODES, od.MAX_TORQUE,
)  # fmt: skip


def moving(mode: int, *steps: Any, **options: int) -> Callable[[Any], dict[str, Any]]:
    """A case of a joint that moves in a mode and is then commanded."""
    return lambda _: walked(
        Joint(mode, **options).moving(), [(*each, {}) if len(each) == 2 else each for each in steps]
    )


def standing(mode: int, *steps: Any, start: int = 1000, **options: int) -> Callable[[Any], dict[str, Any]]:
    """A case of a joint that stands in a mode and is then commanded."""
    return lambda _: walked(Joint(mode, start, **options), [(*each, {}) if len(each) == 2 else each for each in steps])


def at_fault(code: int, reaction: int) -> dict[str, Any]:
    """A moving joint with a fault, which is reset twice."""
    joint = Joint(9, REACTION_OPTION=reaction).moving()
    joint.drive.fail(code)
    joint.drive.fail(faults.NO_DATA)  # one that comes later says nothing
    return walked(joint, [(None, 60, {}), (0x80, 1, {}), (0x00, 1, {}), (0x06, 1, {}), (0x0F, 2, {})])


def watched(
    mode: int, ticks: int, change: Callable[[TwinDrive], None], received: Callable[[int], bool] = lambda k: True
) -> dict[str, Any]:
    """What an enabled drive finds wrong with what it measures, at every tick."""
    joint = Joint(mode)
    rows = []
    for k in range(ticks):
        change(joint.drive)
        joint.drive.measured(joint.drive.true, 3, joint.drive.true)
        point = joint.drive.tick(received=received(k))
        rows.append((joint.drive.state.value, joint.drive.statusword, joint.drive.error, point.position, point.speed))
    return {"rows": np.array(rows), "sent": joint.drive.emergencies, "register": joint.drive.register}


def moved(by: int) -> Callable[[TwinDrive], None]:
    """Moves the motor by so many counts in a tick."""

    def change(drive: TwinDrive) -> None:
        drive.measured(drive.true + by, 0, drive.true + by)

    return change


def held(**faults: bool) -> Callable[[TwinDrive], None]:
    """Faults that are there, of a motor that moves."""

    def change(drive: TwinDrive) -> None:
        for name, value in faults.items():
            setattr(drive, name, value)
        drive.measured(drive.true + 40, 0, drive.true + 40)

    return change


def aborted(option: int) -> dict[str, Any]:
    """A connection that is lost."""
    joint = Joint(9, ABORT_OPTION=option).moving()
    joint.drive.abort_connection(faults.HEARTBEAT)
    return walked(joint, [(None, 40, {})])


def profiles() -> dict[str, Any]:
    """Steps of a trapezoid, and of a ramp to rest."""
    grid = [(q, v, to) for q in (0.0, 90.0, 99.9) for v in (-30.0, 0.0, 5.0, 80.0) for to in (100.0, -50.0, 100.4)]
    ways = []
    for acceleration, deceleration in ((100.0, 300.0), (300.0, 50.0)):
        q, v = 0.0, 0.0
        for _ in range(40):
            q, v = approach(q, v, 37.0, 60.0, acceleration, deceleration, 0.05)
            ways.append((q, v))
    steps = np.array([approach(*each, 60.0, 200.0, 100.0, 0.05) for each in grid])
    ramps = np.array([slowed(3.0, v, 100.0, 0.05) for v in (-30.0, -4.0, 0.0, 4.0, 5.0, 30.0)])
    return {"steps": steps, "ways": np.array(ways), "ramps": ramps}


def servo(arm: aw.Model, period: float) -> dict[str, Any]:
    """Commands of position loops, within their limits and at them."""
    loops = Servo(arm, units_of(arm), np.linspace(0.1, 0.4, arm.n), period)
    zero, limit = np.zeros(arm.n), 30.0 * np.ones(arm.n)
    rows = []
    for k in range(12):
        if k == 6:
            loops.begin(0, -2.0)
        wanted = np.full(arm.n, 0.01 * k)
        rows.append(loops.command(wanted, zero + 0.2, 0.5 * wanted, zero + 0.1 * k, limit, 0.3 * np.arange(arm.n)))
        rows.append(loops.integral.copy())
    return {"rows": np.array(rows)}


def homings() -> dict[str, Any]:
    """Speeds and bits of procedures by their inputs."""
    found = {}
    inputs = (0, 0, od.NEGATIVE, od.NEGATIVE, 0, od.HOME, od.HOME, 0, od.POSITIVE, od.POSITIVE, 0, od.HOME, 0)
    for method in (17, 18, 19, 20, 35, 37):
        homing, rows = Homing(), []
        rows.append((homing.speed(0), homing.bits(at_rest=True)))
        homing.begin(method, 1000, 50)
        for each in inputs:
            speed = homing.speed(each)
            rows += [(speed, homing.running, homing.outcome, homing.bits(at_rest=each == 0))]
        homing.begin(method, 1000, 50)
        homing.interrupt()
        rows.append((homing.speed(0), homing.running, homing.bits(at_rest=False)))
        found[str(method)] = repr(rows)
    return found


TEXTS = (
    "stuck-encoder:joint2@1.5",
    "lost-frames",
    "late-sync=0.02",
    "supply-sag@0.25",
    "over-temperature:joint1=0.3@0",
)
WRONG = ("stuck", "late-sync=x", "late-sync@-1", "lost-frames:joint9", "late-sync=-2", "")


def read_faults() -> dict[str, Any]:
    """Faults as they are written, and when they are there."""
    joints = ("joint1", "joint2")
    found = [read_fault(text, joints) for text in TEXTS]
    return {
        "faults": found,
        "words": [str(each) for each in found],
        "ticks": [each.ticks(4e-3) for each in found],
        "sizes": [each.size for each in found],
        "refused": refusals(read_fault, *((text, joints) for text in WRONG)),
        "none": refusals(Fault, ("no-such",), ("late-sync", None, -1.0), ("late-sync", None, 0.0, -1.0)),
        "kinds": KINDS,
        "registers": faults.REGISTER,
        "texts": faults.TEXT,
    }


def counted() -> dict[str, Any]:
    """Statistics of cycles by a clock that is given."""
    ticks: Iterator[float] = iter([0.0, 0.01, 0.012, 0.02, 0.0215, 0.036, 0.037, 0.04, 0.041, 0.05, 0.06])
    with patch("armwright.twin.clock.now", lambda: next(ticks)):
        cycles = Cycles(0.01)
        cycles.ended()
        for came in (2, 1, 2, 0):
            cycles.began()
            cycles.received(2, came)
            cycles.ended()
        report = cycles.report
    none = Cycles(0.01).report
    fixed = CycleReport(10, 2, 1, 1e-4, 2e-3, 3e-4, 4e-3, 0.25)
    return {"report": replace(report, load=0.0), "none": replace(none, load=0.0), "rows": repr(fixed.rows())}


START, AT_ONCE, RELATIVE, HALT = 0x10, 0x20, 0x40, 0x100
TO, AND = {od.TARGET_POSITION: 9000}, {od.TARGET_POSITION: -3000}
CASES = {
    "bits of frames": lambda _: [frame_bits(size, stuffed=s) for size in (0, 1, 7, 8) for s in (False, True)],
    **{
        f"load of {nodes} nodes at {1e3 * period:g} ms": lambda _, nodes=nodes, period=period, rate=rate: load(
            nodes, period, rate
        )
        for nodes, period, rate in (
            (6, 4e-3, 500_000),
            (2, 1.25e-3, 1_000_000),
            (7, 3e-3, 500_000),
            (3, 0.3, 125_000),
            (2, 1.0, 500_000),
            (2, 2.56e-2, 500_000),
            (2, 25.5e-3, 1_000_001),
            (1, 1e-6, 500_000),
        )
    },
    "numbers of nodes": lambda _: refusals(
        node_numbers, (None, 6), ([127, 1], 2), ([128, 1], 2), ([0, 1], 2), ([3, 3], 2), ([3], 2), ([1.5, 2], 2), (5, 1)
    ),
    "names of buses": lambda _: (
        [is_virtual(each) for each in ("virtual", "virtual:a", "socketcan:virtual")]
        + refusals(
            check_bus,
            *(
                (each,)
                for each in ("virtual", "virtual:x", "socketcan:can0", "socketcan", "udp_multicast", "none:1", 7)
            ),
        )
    ),
    "units of drives": lambda _: conversions(units_of(drives())),
    "units of encoders": lambda _: conversions(units_of(drives(), counts=[4096, 8192, 100, 2**20], counts_per_m=5e4)),
    "units of the LWA 4P": lambda _: units_of(aw.load("lwa4p")),
    "units that no frame carries": lambda _: refused_units(),
    "objects": lambda _: dictionary(),
    "states": lambda _: tables_of_states(),
    "transitions": lambda _: transitions(),
    "transitions without reset": lambda _: transitions(resettable=False, resumable=False),
    **{f"quick stop {k}": moving(9, (0x02, 30), (0x0F, 3), QUICK_STOP_OPTION=k) for k in (0, 1, 2, 3, 5, 6, 7)},
    "a quick stop's other option": moving(9, (0x02, 2), (None, 40, {od.QUICK_STOP_OPTION: 2}), QUICK_STOP_OPTION=3),
    **{f"shutdown {k}": moving(9, (0x06, 40), (0x06, 100), SHUTDOWN_OPTION=k) for k in (0, 1)},
    **{f"disable operation {k}": moving(9, (0x07, 5), (0x0F, 100), DISABLE_OPTION=k) for k in (0, 1)},
    "a shutdown while it is disabled": moving(9, (0x07, 5), (0x06, 150), SHUTDOWN_OPTION=1),
    "a quick stop while it is disabled": moving(9, (0x07, 5), (0x02, 60)),
    "another mode while it is disabled": moving(9, (0x07, 5), (None, 150, {od.MODE: 8})),
    "no voltage while it moves": moving(9, (0x00, 60)),
    **{f"reaction {k} to heat": lambda _, k=k: at_fault(faults.OVER_TEMPERATURE, k) for k in (0, 1, 2, 3)},
    **{f"reaction to {code:x}": lambda _, code=code: at_fault(code, 2) for code in faults.TEXT},
    **{
        f"halt {k} in mode {mode}": moving(
            mode, (0x11F if mode == 7 else 0x10F, 80), (0x1F if mode == 7 else 0x0F, 200), HALT_OPTION=k
        )
        for mode in (1, 7)
        for k in (1, 2, 3)
    },
    "a halt that is taken back": moving(1, (0x10F, 2), (0x0F, 40), HALT_OPTION=3),
    "profile position": standing(1, (0x1F, 60, TO), (0x0F, 250)),
    "profile that changes at once": standing(1, (0x1F, 60, TO), (0x0F, 2), (0x3F, 200, AND)),
    "profile that waits": standing(1, (0x1F, 60, TO), (0x0F, 2), (0x1F, 20, AND), (0x0F, 250), (0x1F, 250)),
    "relative profile": standing(1, (0x5F, 20, TO), (0x0F, 2), (0x7F, 300, AND)),
    "relative profile from rest": standing(1, (0x5F, 300, AND), POSITION_OFFSET=5),
    "profile beyond the limits": standing(
        1, (0x1F, 900, {od.TARGET_POSITION: 90_000}), (0x0F, 2), (0x1F, 20, {od.TARGET_POSITION: -50_000})
    ),
    "profile faster than it may be": standing(
        1, (0x1F, 200, {**TO, od.PROFILE_SPEED: 90_000, od.ACCELERATION: 900_000})
    ),
    "profile that loses its mode": moving(
        1, (None, 30, {od.MODE: 9}), (None, 40, {od.MODE: 3}), (None, 10, {od.MODE: 1})
    ),
    "profile without a target": moving(1, (0x02, 3), (0x0F, 30), QUICK_STOP_OPTION=6),
    "interpolated position": standing(
        7, (0x1F, 30, {od.SET_POINT: 1500}), (0x0F, 5), (0x1F, 60, {od.SET_POINT: 70_000})
    ),
    "cyclic position": standing(
        8,
        (None, 30, {od.TARGET_POSITION: 1400, od.POSITION_OFFSET: 250, od.VELOCITY_OFFSET: 300, od.TORQUE_OFFSET: -70}),
        (None, 5, {od.VELOCITY_OFFSET: -(2**31)}),
    ),
    "cyclic position beyond the limits": standing(
        8, (None, 250, {od.TARGET_POSITION: 60_000}), (None, 400, {od.TARGET_POSITION: -60_000})
    ),
    "cyclic speed": standing(
        9,
        (None, 10, {od.TARGET_VELOCITY: 1000, od.VELOCITY_OFFSET: -400, od.TORQUE_OFFSET: 25}),
        (None, 200, {od.TARGET_VELOCITY: 70_000}),
    ),
    "cyclic torque": standing(
        10,
        (None, 3, {od.TARGET_TORQUE: 100, od.TORQUE_OFFSET: -30}),
        (None, 2, {od.MAX_TORQUE: 50}),
        (0x10F, 2, {od.TARGET_TORQUE: -200}),
    ),
    **{
        f"homing by {m} from {start}": standing(6, (0x1F, 900), (0x0F, 30), start=start, HOMING_METHOD=m, HOME_OFFSET=5)
        for m, start in (
            (17, -48_000),
            (18, 39_000),
            (19, 1500),
            (19, -1500),
            (20, -1500),
            (20, 1500),
            (35, 700),
            (37, 700),
        )
    },
    "homing that is halted": standing(6, (0x1F, 200), (0x11F, 60), (0x1F, 30), HOMING_METHOD=17, HALT_OPTION=2),
    "homing that is interrupted": standing(6, (0x1F, 200), (0x0F, 60), (0x1F, 30), HOMING_METHOD=17),
    "homing faster than it may be": standing(6, (0x1F, 300), HOMING_METHOD=17, SEARCH_SPEED=90_000),
    "positions behind homing": standing(
        6,
        (0x1F, 5),
        (0x0F, 5),
        (None, 20, {od.MODE: 8, od.TARGET_POSITION: 300}),
        (None, 60, {od.MODE: 7, od.SET_POINT: 200}),
        (0x1F, 30),
        (0x0F, 3, {od.MODE: 1}),
        (0x1F, 80, {od.TARGET_POSITION: 900}),
        HOMING_METHOD=35,
        HOME_OFFSET=77,
    ),
    "the brake of an enabled drive": moving(
        9, (None, 40, {od.OUTPUT: 1, od.OUTPUT_MASK: 1}), (None, 30, {od.OUTPUT: 0})
    ),
    "a brake that is not meant": moving(9, (None, 10, {od.OUTPUT: 1, od.OUTPUT_MASK: 0})),
    "homings": lambda _: homings(),
    **{f"connection lost {k}": lambda _, k=k: aborted(k) for k in (0, 1, 2, 3)},
    **{
        f"no data in mode {mode}": lambda _, mode=mode: watched(mode, 60, lambda drive: None, lambda k: k < 10)
        for mode in od.MODES
    },
    "some data": lambda _: watched(9, 60, lambda drive: None, lambda k: k % 20 == 0),
    "as fast as it may be": lambda _: watched(10, 12, moved(264)),
    "too fast": lambda _: watched(10, 12, moved(265)),
    "beyond the upper end": lambda _: watched(10, 260, moved(180)),
    "beyond the lower end": lambda _: watched(10, 330, moved(-180)),
    "a following error": lambda _: watched(8, 60, moved(150)),
    "a following error of no profile": lambda _: watched(9, 60, moved(150)),
    "a stuck encoder": lambda _: watched(9, 60, held(stuck=True)),
    "heat": lambda _: watched(9, 10, held(hot=True)),
    "a low supply": lambda _: watched(9, 10, held(sagging=True)),
    "profiles": lambda _: profiles(),
    **{f"servo at {1e3 * period:g} ms": lambda _, period=period: servo(drives(), period) for period in (4e-3, 0.02)},
    "servo of two links": lambda _: servo(small_arm(), 4e-3),
    "faults": lambda _: read_faults(),
    "cycles": Case(lambda _: counted()),
    "objects of the small arm": lambda _: {
        f"{k} {index:x}:{sub}": value
        for k, drive in enumerate(aw.bus.Twin(small_scenario(), serial=42, nodes=[7, 9]).drives)
        for (index, sub), value in drive.values.items()
        if drive.values[index, sub]
    },
}
