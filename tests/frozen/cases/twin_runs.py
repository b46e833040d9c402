"""Runs over a bus whose time is counted: frames, monitors, faults and how they end; rehearsals, and what a run is permitted."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, RunStopped
from armwright.model import Brake
from armwright.simulation.scenario import Scenario
from armwright.twin import objects as od
from armwright.twin.cycles import CycleReport
from armwright.twin.difference import first_difference
from armwright.twin.faults import read_fault
from armwright.twin.law import Law
from armwright.twin.listen import DATA, BusListener, bus_recording, shadow_bus
from armwright.twin.master import Ending, Identity, Trouble, _dictionary
from armwright.twin.on_bus import plant_on_bus, scenario_on_bus
from armwright.twin.rehearsal import Rehearsal, rehearse
from armwright.twin.run import BusRun, check_arguments, release_drives, run_controller
from armwright.twin.safety import Permission, Slowed, joints_without_brake, reduced
from frozen.cases.twin import refusals
from frozen.numbers import Case
from frozen.texts import rounded, texts
from twin.buses import counted_bus, small_arm, small_scenario, watched_twin
from twin.simulated_bus import Chaos

PAYLOAD = aw.Payload(0.033, 0.5, [0.0, 0.0, 0.1], [1e-3] * 3)


def transcript(bus: Any) -> str:
    """All frames of a bus with their times."""
    return "\n".join(f"{time:.6f} {number:03x} {data.hex()}" for time, number, data in bus.sent)


def ended(run: BusRun) -> dict[str, Any]:
    """A run without what the clock of the computer says."""
    counts = (run.cycles.cycles, run.cycles.incomplete, run.cycles.late)
    flags = (run.complete, run.counts, run.equal, run.good)
    return {
        "q": run.q,
        "u": run.u,
        "applied": run.applied,
        "time": run.time,
        "errors": run.errors,
        "counts": counts,
        "flags": flags,
        "ending": run.ending,
        "trouble": run.trouble,
        "sentences": run.sentences(),
        "heading": run.heading,
        "difference": run.first_difference,
        "table": run.tables()[0].rows(),
    }


def driven(
    scenario: Scenario | Rehearsal,
    faults: tuple[str, ...] = (),
    disturbance: Any = None,
    twin: dict[str, Any] | None = None,
    acting: Scenario | None = None,
    **options: Any,
) -> dict[str, Any]:
    """A run on a twin with faults, the frames that crossed the bus, and the drives at its end."""
    source = acting or (scenario.source if isinstance(scenario, Rehearsal) else scenario)
    joints = source.arm.names
    said = [read_fault(text, joints) for text in faults]
    with counted_bus() as bus, aw.bus.Twin(source, faults=said, **(twin or {})) as made:
        if disturbance is not None:
            bus.disturbance = disturbance
        stopped = ""
        try:
            run = run_controller(scenario, "virtual", **options)
        except RunStopped as error:
            run, stopped = error.run, rounded(str(error))
        drives = {
            drive.name: (drive.state.name, drive.statusword, drive.error, str(drive.machine.passed))
            for drive in made.drives
        }
        return {**ended(run), "stopped": stopped, "frames": transcript(bus), "count": len(bus.sent), "drives": drives}


@cache
def gentle() -> Rehearsal:
    """A run that bears losses."""
    law = aw.Cascade(position_kp=3.0, speed_kp=[150.0, 40.0], speed_ki=[300.0, 80.0], delay_ticks=1)
    return rehearse(small_scenario(0.24, controller=law))


@cache
def plain() -> Rehearsal:
    """A run of 0.2 s."""
    return rehearse(small_scenario())


def pushed(newtons: float) -> Scenario:
    """The same arm, pushed at its tip behind 60 ms."""
    rows = np.array([[0.0] * 6, [newtons, newtons, 0.0, 0.0, 0.0, 0.0]])
    wrench = aw.Schedule([0.0, 0.06], rows, ("fx", "fy", "fz", "mx", "my", "mz"))
    return replace(small_scenario(), inputs=aw.Inputs(wrench=wrench))


@cache
def slow() -> Rehearsal:
    """A short run at a quarter of its speed and half of its torque."""
    return rehearse(small_scenario(0.02), speed=0.25, torque=0.5)


def chaos(kind: str, at: int = 28, node: int = 3, **options: Any) -> Callable[[Path], dict[str, Any]]:
    """A run whose bus is disturbed from a SYNC on."""
    return lambda _: driven(gentle(), disturbance=Chaos(kind, at, node, 1), following_error=0.3, **options)


def braked(torque: float) -> aw.Model:
    """The small arm with brakes at both joints."""
    arm = small_arm()
    brake = Brake(torque, 1e4, 20.0, 0.02, on_motor=False)
    return replace(arm, bodies=tuple(replace(body, brake=brake) for body in arm.bodies))


# Objects over the bus.


def objects() -> dict[str, Any]:
    """Values of all objects that a client reads, and what is refused."""
    with watched_twin(small_scenario(), serial=42) as (twin, client, bus):
        values = {}
        for index, sub in od.ENTRIES:
            try:
                values[f"{index:04X}:{sub}"] = client.get((index, sub))
            except Exception as error:  # noqa: BLE001  what canopen says of a text or of a code
                values[f"{index:04X}:{sub}"] = str(error).partition(",")[0]
        return {"values": repr(values), "load": str(twin.load), "frames": transcript(bus)}


def refused_objects() -> list[str]:
    """Writes that a node refuses, and those that it takes."""
    writes = [
        (od.MAX_TORQUE, 1001),
        (od.MAX_TORQUE, 1000),
        (od.MODE, 5),
        (od.MODE, 9),
        (od.ACCELERATION, 0),
        (od.HOME_SPEED, 1),
        (od.QUICK_STOP_OPTION, 4),
        (od.HALT_OPTION, 0),
        (od.OUTPUT, 2),
        ((0x1600, 1), 0x60400010),
        ((0x1600, 1), 0x60400020),
        ((0x1600, 1), 0x60650020),
        ((0x1600, 2), 0x607A0020),
        ((0x1600, 3), 0x60FF0020),
        ((0x1600, 4), 0x60C10120),
        ((0x1A01, 1), 0x60410010),
        ((0x1A01, 2), 0),
        ((0x1A01, 2), 0x12340010),
    ]
    found = []
    with watched_twin(small_scenario()) as (_, client, _bus):
        for key, value in writes:
            try:
                client.put(key, value)
                found.append(f"{client.get(key)}")
            except Exception as error:  # noqa: BLE001  as canopen says it
                found.append(str(error).partition(",")[0])
    return found


def allowed_values() -> dict[str, str]:
    """Values that a node takes of every object that has choices."""
    with watched_twin(small_scenario()) as (twin, _, _bus):
        found = {}
        for key in (*od.CHOICES, *od.ABOVE_ZERO, od.MAX_TORQUE):
            taken = []
            for value in (*range(-2, 41), 1000, 1001):
                try:
                    twin.nodes[0]._check(key, value)
                    taken.append(value)
                except Exception:  # noqa: BLE001  canopen's, of a value that is refused
                    continue
            found[f"{key[0]:04X}:{key[1]}"] = repr(taken)
        return found


def another_mapping() -> dict[str, Any]:
    """Process data that a client maps: second sets, each third SYNC, and on change only."""
    with watched_twin(small_scenario()) as (twin, client, bus):
        for sub, value in ((1, 0x607A0020), (2, 0x60FE0120)):
            client.put((0x1601, sub), value)
        client.put((0x1601, 0), 2)
        client.put((0x1401, 1), 0x323)
        for sub, value in ((1, 0x60640020), (2, 0x606C0020)):
            client.put((0x1A01, sub), value)
        client.put((0x1A01, 0), 2)
        client.put((0x1801, 2), 3)
        client.put((0x1801, 1), 0x2A3)
        client.put((0x1800, 2), 255)
        client.enable(8, 0)
        for k in range(20):
            client.network.send_message(0x323, struct.pack("<iI", -68_000 + 100 * k, 0))
            client.sync()
        client.put((0x1A01, 0), 9)
        client.sync(3)
        client.put((0x1801, 1), 0x800002A3)
        client.sync(3)
        return {"frames": transcript(bus), "target": client.get(od.TARGET_POSITION), "state": twin.drives[0].state.name}


def moved(mode: int, *steps: tuple[int | None, int, dict[Any, int]]) -> dict[str, Any]:
    """The twin's arm under a client that writes objects and controlwords of both drives."""
    with watched_twin(small_scenario(), serial=3) as (twin, client, bus):
        client.enable(mode)
        rows: list[list[int]] = []
        for word, count, values in steps:
            for joint in (0, 1):
                for key, value in values.items():
                    client.put(key, value, joint)
                if word is not None:
                    client.put(od.CONTROLWORD, word, joint)
            for _ in range(count):
                client.sync()
                seen = (od.STATUSWORD, od.POSITION, od.VELOCITY, od.TORQUE)
                rows += [[client.get(key, joint) for key in seen] for joint in (0, 1)]
        demand = [client.get(od.TORQUE_DEMAND, k) for k in (0, 1)]
        return {"rows": np.array(rows), "demand": demand, "tick": twin.simulation.tick, "frames": transcript(bus)}


def managed() -> dict[str, Any]:
    """Nodes that are stopped and reset while their drives are enabled, and their heartbeats."""
    with watched_twin(small_scenario(), nodes=[5, 9]) as (twin, client, bus):
        states = []
        for command in ([2, 5], [1, 5], [129, 0], [130, 9], [128, 9], [2, 77]):
            client.enable(9)
            client.network.send_message(0, command)
            client.sync(3)
            states.append(
                [(drive.state.name, node.local.nmt.state) for drive, node in zip(twin.drives, twin.nodes, strict=True)]
            )
        return {
            "states": repr(states),
            "frames": transcript(bus),
            "passed": [drive.machine.passed for drive in twin.drives],
        }


# Rehearsals.


def rehearsed(scenario: Scenario, **options: Any) -> dict[str, Any]:
    """All that a rehearsal says."""
    found = rehearse(scenario, **options)
    said = {"table": found.tables()[0].rows(), "sentences": found.sentences(), "heading": found.heading}
    numbers = {
        name: getattr(found, name) for name in ("q", "reference", "largest_error", "largest_speed", "largest_command")
    }
    sizes = {"speed": found.speed, "torque": found.torque, "full": found.full is not None, "load": found.load}
    return {
        **said,
        **numbers,
        **sizes,
        "recording": found.recording,
        "units": found.units,
        "limits": found.stages.limits,
    }


def on_bus(scenario: Scenario, **options: Any) -> dict[str, Any]:
    """What changes of a scenario that runs over a bus."""
    found = {}
    for name, each in (("run", scenario_on_bus(scenario, **options)), ("plant", plant_on_bus(scenario))):
        loop = each.loop
        assert loop is not None
        found[name] = {
            "timing": loop.timing, "filter": loop.command_filter, "sensors": loop.joint_sensors, "period": loop.period,
            "controlled": loop.controller is not None, "duration": each.duration, "payload": repr(each.inputs.payload),
        }  # fmt: skip
    return found


def refused_runs() -> list[str]:
    """Scenarios that no bus can carry."""
    good = small_scenario()
    loop = good.loop
    assert loop is not None
    looped = lambda **changes: replace(good, loop=replace(loop, **changes))  # noqa: E731
    scenarios = [
        replace(good, loop=replace(loop, controller=None)), replace(good, start=aw.Start([0.0, 0.0], [0.1, 0.0])),
        looped(command_filter=aw.CommandFilter(resolution=0.1)), looped(sensors=aw.Sensors(side="motor", counts=100)),
        looped(sensors=aw.Sensors(velocity_noise=0.1)), looped(sensors=aw.Sensors(current_noise=0.1)),
        looped(sensors=aw.Sensors(position_noise=0.1)), looped(period=1e-3), looped(period=6.25e-3),
        replace(good, loop=replace(loop, period=5e-4), duration=0.2),
    ]  # fmt: skip
    return refusals(
        lambda scenario, **options: scenario_on_bus(scenario, **options).duration, *((each,) for each in scenarios)
    )


def refused_rehearsals() -> list[str]:
    """Motions beyond the limits of joints, and those that are no slower at a lower speed."""
    far = small_scenario(0.3, reference=lambda t: aw.scalar.array([-1.2 - 3.0 * t, 0.0 * t]))
    fast = small_scenario(0.3, reference=lambda t: aw.scalar.array([-1.2 + 3.0 * t, 0.0 * t]))
    found = refusals(lambda each: rehearse(each).speed, (far,), (fast,), (small_scenario(0.02),))
    return found + refusals(
        lambda s, t: reduced(small_scenario(0.02), s, t).duration, (0.0, 1.0), (1.5, 1.0), (0.5, -1.0), (0.3, 0.5)
    )


def data_sheets(folder: Path) -> list[str]:
    """Dictionaries of nodes from files that are whole, lack objects, or are none."""
    text = od.eds_text(3, "arm", {od.MAX_SPEED: 7})
    for name, content in {
        "whole": text,
        "lacking": text.replace("[6502]", "[6503]").replace("=0x6502", "=0x6503"),
        "none": "x",
    }.items():
        (folder / f"{name}.eds").write_text(content, encoding="utf-8")
    path = {name: str(folder / f"{name}.eds") for name in ("whole", "lacking", "none", "absent")}
    calls = [
        (3, None, 0),
        (3, [path["whole"]], 1),
        (3, [path["lacking"]], 0),
        (3, [path["none"]], 0),
        (3, [path["absent"]], 0),
        (3, path["whole"], 0),
        (3, [path["none"], path["whole"]], 1),
        (3, [path["whole"]] * 2, 2),
    ]
    found = refusals(lambda *words: f"{len(_dictionary(*words))} objects", *calls)
    return [each.replace(str(folder), "").partition(": Missing")[0] for each in found]  # what follows is Python's


def strangers(change: Callable[[Any], None]) -> list[str]:
    """What a master says of nodes before it enables them."""
    with counted_bus(), aw.bus.Twin(small_scenario(0.02), serial=7) as twin:
        change(twin)
        return refusals(lambda: f"{run_controller(slow(), 'virtual').complete}", ())


def put(key: od.Key, value: int, joint: int = 1) -> Callable[[Any], None]:
    """Another value of a drive's object."""

    def change(twin: Any) -> None:
        twin.drives[joint].values[key] = value

    return change


def slowed_scenario(speed: float, torque: float) -> dict[str, Any]:
    """A scenario with all inputs at a part of its speed and torque."""
    wrench = aw.Schedule([0.0, 0.1], np.arange(12.0).reshape(2, 6), ("fx", "fy", "fz", "mx", "my", "mz"))
    bodies = [PAYLOAD, replace(PAYLOAD, time=0.1)]
    held = aw.CommandFilter(limit=[100.0, 70.0])
    given = replace(small_scenario(command_filter=held), inputs=aw.Inputs(payload=bodies, wrench=wrench))
    found = reduced(given, speed, torque)
    loop = found.loop
    assert loop is not None
    reference = loop.reference
    at = (
        np.array([np.asarray(reference(t), dtype=float) for t in (0.0, 0.1, 0.4)]) if callable(reference) else reference
    )
    return {
        "reference": at, "limit": loop.command_filter.limit, "duration": found.duration, "wrench": found.inputs.wrench,
        "payload": found.inputs.payload,
    }  # fmt: skip


def slowed_motion() -> dict[str, Any]:
    """Positions, speeds and accelerations of a motion in slow motion."""
    whole = Slowed(lambda t: (np.array([t, t * t]), np.array([1.0, 2.0 * t]), np.array([0.0, 2.0])), 0.25)
    return {"whole": whole(2.0), "positions": Slowed(lambda t: np.array([t, t * t]), 0.5)(2.0)}


# What a run is permitted.


def permissions(folder: Path) -> dict[str, Any]:
    """Reduced runs that are stored beside a scenario, and which runs they permit."""
    path = folder / "arm.scenario.toml"
    facts = {"bus": "socketcan:can0", "nodes": [3, 4]}
    first = Permission(serial=7, path=path, sha256="abc", speed=0.25, torque=0.5)
    before = first.has_run_reduced(facts)
    stored = first.write_reduced(facts)
    others = [
        first, replace(first, serial=8), replace(first, sha256="abd"), replace(first, path=None),
        replace(first, path=folder / "b.toml"),
    ]  # fmt: skip
    permitted = [each.has_run_reduced(facts) for each in others] + [first.has_run_reduced({**facts, "nodes": [3]})]
    written = texts(folder)
    for speed, torque in ((0.26, 0.5), (0.25, 0.51), (0.0, 0.5), (0.1, 0.1)):
        replace(first, speed=speed, torque=torque).write_reduced(facts)
        permitted.append(first.has_run_reduced(facts))
    shares = [replace(first, speed=s, torque=t).reduced for s, t in ((0.25, 0.5), (0.26, 0.5), (0.25, 0.51))]
    return {
        "before": before, "permitted": permitted, "files": written, "reduced": shares, "stored": stored is not None,
        "none": Permission().write_reduced(facts) is None,
    }  # fmt: skip


def brakes() -> dict[str, Any]:
    """Joints that gravity moves and that nothing holds."""
    arms = {
        "small": small_arm(), "strong": braked(400.0), "weak": braked(60.0),
        "lwa4p": aw.load("lwa4p"), "puma560": aw.load("puma560"),
        "two-link": small_arm().replace(gravity=[0.0, 0.0, 0.0]),
    }  # fmt: skip
    return {name: list(joints_without_brake(arm)) for name, arm in arms.items()}


def refused_arguments() -> list[str]:
    """Limits and monitors that are none."""
    options: list[dict[str, Any]] = [
        {"following_error": each} for each in (0.0, -1.0, 4.0, 3.9, [0.1, 0.2], [0.1], [0.1, 0.0], "x", np.nan)
    ]
    options += [{"missing": each} for each in (0, 1, 5, 6, 1.5)]
    options += [{"heartbeat": each} for each in (0.0, 9e-4, 1e-3, 21.8, 21.9, [0.1], np.inf)]
    return refusals(lambda each: check_arguments(gentle(), **each), *((each,) for each in options))


def sentences() -> list[str]:
    """Endings, troubles and nodes in words."""
    endings = [
        Ending(("a", "b"), (), (), True, ("a",), 0.512), Ending(("a",), ("b",), (), False, (), 3.0),
        Ending((), (), ("a", "b"), True, ("a", "b"), 0.5), Ending(("a",), (), ("b",), True, ("b", "c"), 0.4321, ("a",)),
    ]  # fmt: skip
    twins = [Identity(od.TWIN_VENDOR, od.TWIN_PRODUCT, 3), Identity(1, od.TWIN_PRODUCT, 3), Identity(0, 7, 3)]
    return [*map(str, endings), *(f"{each.is_twin}" for each in twins), str(Trouble(1, "it is", "it were"))]


# Differences, listeners, laws.


def differences() -> dict[str, Any]:
    """First differences of runs from a simulation in which a body is taken up in tick 8."""
    found = rehearse(replace(small_scenario(0.08), inputs=aw.Inputs(payload=PAYLOAD)))
    q, u = found.q, found.recording.u
    applied = np.asarray(found.units.command(found.units.thousandths(found.recording.y[:, -2:])))
    rows = {}
    for name, tick in (("position", 0), ("applied", 9), ("command", 8), ("command", 19), ("none", 0)):
        values = {"position": q.copy(), "applied": applied.copy(), "command": u.copy()}
        if name in values:
            values[name][tick:, 1] += 0.5
        made = first_difference(found, values["position"][:20], values["command"][:20], values["applied"][:20])
        rows[f"{name} {tick}"] = {"fields": made, "words": "" if made is None else rounded(str(made))}
    report = CycleReport(20, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0)
    run = BusRun(found, 4e-3 * np.arange(20), q, u, applied, report)
    short = replace(run, q=q[:15], u=u[:15], applied=applied[:15])
    lossy = [replace(run, cycles=replace(report, cycles=1000, incomplete=each)) for each in (1, 2)]
    return {
        **rows,
        "whole": ended(run),
        "short": ended(short),
        "lossy": [each.counts for each in lossy],
        "words": lossy[1].sentences(),
    }


class Frames:
    """A bus on which frames wait."""

    def __init__(self, frames: list[can.Message]):
        self.frames, self.waited = frames, list[bool]()

    def recv(self, timeout: float) -> can.Message | None:
        """The next frame."""
        self.waited.append(timeout > 0.0)
        return self.frames.pop(0) if self.frames else None

    def shutdown(self) -> None:
        """Nothing."""


def heard(
    arm: aw.Model,
    period: float | None,
    lost: tuple[tuple[int, int], ...] = (),
    counts: Any = None,
    shadowed: bool = False,
) -> dict[str, Any]:
    """Rows of frames that were sent, some of which were lost."""
    frames = []
    for k in range(8):
        frames.append(can.Message(arbitration_id=0x80, timestamp=10.0 + 0.004 * k, is_extended_id=False))
        frames.append(can.Message(arbitration_id=0x703, data=[5], is_extended_id=False))
        for i in range(arm.n):
            data = DATA.pack(0x27, 10 * k - 3 * i, (i + 1) * 1000 * k)
            if (k, i) not in lost:
                frames.append(
                    can.Message(arbitration_id=0x183 + i, data=data if k != 5 else data + b"\0", is_extended_id=False)
                )
                frames += frames[-1:] if k == 6 else []
    listener = BusListener(arm, "virtual", period=period, counts=counts)
    listener._bus = Frames(frames)
    if shadowed:
        shadow = aw.shadow.ArmShadow(arm, deviation=1e3)
        pairs = list(shadow_bus(shadow, listener, silence=0.05))
        rows = [row for row, _ in pairs]
        recorded = bus_recording(arm, rows, [shadow.last] * len(rows) if shadow.last is not None else ())
    else:
        rows = list(listener.rows(silence=0.05))
        recorded = bus_recording(arm, rows)
    units = {name: recorded[name].attrs.get("units", "") for name in recorded.data_vars}
    return {"rows": rows, "incomplete": listener.incomplete, "latest": listener.latest, "run": recorded, "units": units}


def stopped_listener() -> dict[str, Any]:
    """Frames that came before a listener is stopped, which are taken without waiting, and periods that are none."""
    bus = Frames([can.Message(arbitration_id=0x80, timestamp=1.0 + k, is_extended_id=False) for k in range(3)])
    listener = BusListener(small_arm(), "virtual")
    listener._bus = bus
    listener.stop()
    rows = list(listener.rows(silence=30.0))
    periods = refusals(
        lambda each: BusListener(small_arm(), "virtual", period=each)._period,
        *((p,) for p in (None, 1, 0.0, -1.0, np.inf, "x")),
    )
    silent = refusals(lambda *words: list(listener.rows(*words)), (None, 1.0), (0.5, 1.0), (0.5, 0.2))
    listener._bus = None
    listener.__exit__()
    return {
        "rows": len(rows),
        "waited": bus.waited,
        "incomplete": listener.incomplete,
        "periods": periods,
        "silent": silent,
    }


def law(scenario: Scenario) -> np.ndarray:
    """Commands of a controller's programs that are called tick by tick."""
    found = rehearse(scenario)
    made, n = Law(found), found.scenario.arm.n
    y = found.recording.y
    made.begin(found.recording.y_begin[:n], found.recording.y_begin[-n:])
    return np.array([made.command(k, found.recording.r[k], y[k, :n], y[k, -n:]) for k in range(len(y))])


def stopped_by_key(after: int) -> dict[str, Any]:
    """A run whose dead-man key is released."""
    asked: list[int] = []

    def may_move() -> bool:
        asked.append(0)
        return len(asked) <= after

    return driven(plain(), permission=Permission(may_move=may_move)) | {"asked": len(asked)}


def starts() -> list[str]:
    """Where an arm may stand that is to begin at -1.2 and 0 rad."""
    found = []
    for count in (0.0, 1.4, 1.6, -1.6):
        source = replace(small_scenario(0.02), start=[-1.2 + count * 2.0 * np.pi / 360_000, 0.0])
        with counted_bus(), aw.bus.Twin(source):
            found += refusals(lambda: run_controller(small_scenario(0.02), "virtual").complete, ())
    return found


def released() -> dict[str, Any]:
    """Drives that hold the arm after a run, and are released."""
    scenario = small_scenario(0.04)
    with counted_bus() as bus, aw.bus.Twin(scenario) as twin:
        run_controller(scenario, "virtual")
        before = [drive.state.name for drive in twin.drives]
        release_drives(scenario, "virtual")
        return {"before": before, "after": [drive.state.name for drive in twin.drives], "frames": transcript(bus)}


def of_metal(real_time: bool = True, values: dict[od.Key, int] | None = None, **changes: Any) -> list[str]:
    """What a real arm needs before it moves."""
    said = {
        "serial": 7,
        "verdict": SimpleNamespace(passed=True),
        "speed": 0.25,
        "torque": 0.5,
        "may_move": lambda: True,
    }
    with counted_bus() as _, aw.bus.Twin(small_scenario(0.02), serial=7) as twin, pytest.MonkeyPatch.context() as patch:
        patch.setattr("armwright.twin.safety.is_virtual", lambda name: False)
        for drive in twin.drives:
            drive.values[od.VENDOR] = 0x1234
            drive.values |= values or {}
        try:
            run_controller(
                small_scenario(0.02), "virtual", permission=Permission(**said | changes), real_time=real_time
            )
        except ArmwrightError as error:
            return [rounded(str(error))]
    return ["moved"]


WIDE = {"following_error": 1.0}
CASES = {
    "run": lambda _: driven(plain()),
    "run of brakes": lambda _: driven(small_scenario(0.08, braked(400.0))),
    "run of weak brakes": lambda _: driven(small_scenario(0.04, braked(60.0))),
    "run with a step at its start": lambda _: driven(small_scenario(0.08, reference=[-1.19, 0.005])),
    "run of other nodes": lambda _: driven(
        small_scenario(0.04), nodes=[9, 5], twin={"nodes": [9, 5]}, bitrate=1_000_000
    ),
    "run with a body": lambda _: driven(replace(small_scenario(0.1), inputs=aw.Inputs(payload=PAYLOAD))),
    "run at half torque": lambda _: driven(small_scenario(0.04), permission=Permission(speed=0.5, torque=0.5)),
    "run with a small following error": lambda _: driven(plain(), following_error=[0.02, 1e-3]),
    "run that is not ended by the usual following error": lambda _: driven(plain(), faults=("lost-frames=24@0.04",)),
    "run that is ended by the usual following error": lambda _: driven(plain(), acting=pushed(400.0)),
    "run that starts elsewhere": lambda _: starts(),
    "run whose key is released": lambda _: stopped_by_key(7),
    **{
        f"run with {text}": lambda _, text=text: driven(plain(), faults=(text,), **WIDE)
        for text in (
            "lost-frames:elbow=5@0.04",
            "lost-frames=40@0.04",
            "late-sync=0.003@0.04",
            "late-sync=0.01@0.04",
            "over-temperature:elbow=0.1@0.04",
            "supply-sag=0.02@0.1",
            "stuck-encoder:shoulder=0.1@0.02",
        )
    },
    **{f"chaos: {kind}": chaos(kind) for kind in ("kill", "silence", "freeze", "duplicate", "drop", "second")},
    "chaos: drop that ends it": chaos("drop", missing=1),
    "chaos: silence at the beginning": chaos("silence", at=8, node=4),
    "run in real time": lambda _: driven(small_scenario(0.08), real_time=True, heartbeat=0.02),
    **{f"chaos in real time: {kind}": chaos(kind, real_time=True) for kind in ("freeze", "unplug", "drop")},
    "drives that are released": lambda _: released(),
    "objects over the bus": lambda _: objects(),
    "objects that are refused": lambda _: refused_objects(),
    "numbers of twins": lambda _: refusals(
        lambda serial: aw.bus.Twin(small_scenario(0.02), serial=serial).drives[1].values[od.SERIAL],
        *((each,) for each in (-1, 0, 2**32 - 1, 2**32, 1.5)),
    ),
    "values of choices": lambda _: allowed_values(),
    "another mapping": lambda _: another_mapping(),
    "network management": lambda _: managed(),
    "moved by profile": lambda _: moved(1, (0x1F, 40, {od.TARGET_POSITION: -60_000}), (0x10F, 20, {}), (0x02, 30, {})),
    "moved by position": lambda _: moved(
        8, (None, 25, {od.TARGET_POSITION: -64_000, od.TORQUE_OFFSET: 20}), (0x07, 30, {})
    ),
    "moved by speed": lambda _: moved(
        9, (None, 20, {od.TARGET_VELOCITY: 9000}), (0x02, 30, {od.QUICK_STOP_OPTION: 7}), (0x0F, 5, {})
    ),
    "moved by torque": lambda _: moved(
        10, (None, 6, {od.TARGET_TORQUE: 120}), (None, 4, {od.TARGET_TORQUE: -90, od.MAX_TORQUE: 60}), (0x00, 60, {})
    ),
    "moved home": lambda _: moved(6, (0x1F, 10, {od.HOMING_METHOD: 35, od.HOME_OFFSET: 100}), (0x0F, 60, {})),
    "rehearsal": lambda _: rehearsed(small_scenario()),
    "rehearsal at a quarter": lambda _: rehearsed(small_scenario(0.1), speed=0.25, torque=0.5),
    "rehearsal of a step at a quarter": lambda _: rehearsed(small_scenario(0.1, reference=[-1.15, 0.02]), speed=0.25),
    "rehearsal with noise": lambda _: rehearsed(
        small_scenario(0.08, sensors=aw.Sensors(position_noise=1e-4, velocity="observer", cutoff_hz=20.0)), speed=0.5
    ),
    "rehearsal with losses": lambda _: rehearsed(
        small_scenario(0.08, timing=aw.Timing("one-tick", measurement_loss=0.3, command_delay=1e-3))
    ),
    "on the bus": lambda _: on_bus(small_scenario()),
    "limited on the bus": lambda _: on_bus(
        replace(
            small_scenario(command_filter=aw.CommandFilter(limit=[33.33, 500.0])), inputs=aw.Inputs(payload=PAYLOAD)
        ),
        bitrate=1_000_000,
    ),
    "rehearsal of a step": lambda _: rehearsed(small_scenario(0.1, reference=[-1.15, 0.02])),
    "data sheets": data_sheets,
    **{
        f"nodes with {name}": lambda _, change=change: strangers(change)
        for name, change in {
            "another type": put((0x1000, 0), 0x20191),
            "a type that is near": put((0x1000, 0), 0x40192),
            "other modes": put(od.SUPPORTED_MODES, 0x1FF),
            "that mode alone": put(od.SUPPORTED_MODES, 0x200),
            "another mapping": put((0x1600, 2), 0x60710010),
            "fewer objects": put((0x1A00, 0), 2),
            "no object": put((0x1A00, 0), 0),
        }.items()
    },
    "runs that are refused": lambda _: refused_runs(),
    "rehearsals that are refused": lambda _: refused_rehearsals(),
    **{
        f"at {v} of the speed and {m} of the torque": lambda _, v=v, m=m: slowed_scenario(v, m)
        for v, m in ((0.5, 1.0), (1.0, 0.5), (0.3, 0.2))
    },
    "slow motion": lambda _: slowed_motion(),
    "permissions": permissions,
    "joints without brakes": lambda _: brakes(),
    "arguments": lambda _: refused_arguments(),
    "sentences": lambda _: sentences(),
    "differences": Case(lambda _: differences()),
    "rows of frames": lambda _: heard(small_arm(), 4e-3, lost=((2, 1), (4, 0))),
    "rows of time stamps": lambda _: heard(small_arm(), None, counts=4096),
    "rows of currents": lambda _: heard(aw.load("lwa4p"), 4e-3),
    "rows with a shadow": lambda _: heard(small_arm(), 4e-3, lost=((7, 1),), shadowed=True),
    "a listener that is stopped": lambda _: stopped_listener(),
    "commands of a law": lambda _: law(small_scenario(0.08)),
    "commands of a law with a rate": lambda _: law(small_scenario(0.08, command_filter=aw.CommandFilter(rate=2000.0))),
    **{
        f"a real arm with {name}": lambda _, changes=changes: of_metal(**changes)
        for name, changes in {
            "all": {},
            "no clock": {"real_time": False},
            "no verdict": {"verdict": None},
            "a bad verdict": {"verdict": SimpleNamespace(passed=False)},
            "no key": {"may_move": None},
            "another number": {"serial": 8},
            "no number": {"serial": None},
            "full speed": {"speed": 1.0},
            "another rated torque": {"values": {od.RATED_TORQUE: 297_000 - 1}},
            "a torque that is near": {"values": {od.RATED_TORQUE: 297_001}},
            "other counts": {"values": {(0x608F, 1): 360_001}},
            "other turns": {"values": {(0x608F, 2): 2, (0x608F, 1): 720_000}},
        }.items()
    },
}
