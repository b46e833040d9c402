"""Arms of bus servos: the arm behind the servos, calibrations, motions that are captured, controllers that are run over them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.errors import RunStopped
from armwright.twin.serial.arm_plant import ArmPlant, Mounting
from armwright.twin.serial.arm_servos import ArmServos, ServoFit, ServoSettings
from armwright.twin.serial.calibration import (
    STORED_IN,
    Calibration,
    StoredServo,
    read_calibration,
    registers_of,
    stored_servo,
)
from armwright.twin.serial.capture import Captured, approach, capture, plan_capture
from armwright.twin.serial.frames import BROADCAST, FEETECH
from armwright.twin.serial.registers import servo_model
from armwright.twin.serial.replay import replay, write_goals
from armwright.twin.serial.run import ServoUnits, goal_limits, line_time, rehearse_servos, run_on_servos
from armwright.twin.serial.servo_arm import Line, ServoArm, ids_of, mountings_of
from armwright.twin.serial.timing import CycleEnd, LockStep
from frozen.cases.servos import MODELS, scripted
from frozen.cases.twin import refusals
from frozen.texts import rounded, texts
from simulation.test_servo import ALL, PLAIN, pendulum
from twin.serial.locked_port import LockedPort
from twin.serial.test_arm_plant import JOINTS, MOUNTED, START, driven, goal
from twin.serial.test_run import LIMITS, LINES, PERIOD, STIFF, scenario, weightless

MOVE = aw.trajectories.Waypoints([[0.0, 0.0], [0.4, -0.3], [0.1, 0.0]], times=[0.0, 0.3, 0.6])
CHANGES = {12: {"gains": (25, 2, 8), "limit": 0.5}, 20: {"speed": 500.0, "acceleration": 3000.0}}


# The arm behind the servos.


@cache
def three() -> aw.Model:
    """Three servos with dry friction that sticks."""
    dry = {"viscous_n_m_s_per_rad": 0.1, "coulomb_positive_n_m": 0.02, "coulomb_negative_n_m": 0.02}
    return pendulum(ALL, JOINTS, friction=dry)


def plant_values(plant: ArmPlant) -> dict[str, Any]:
    """Goals, parameters and states of a plant."""
    return {
        "turns": [row.turn for row in plant.rows],
        "goals": np.array([row.goals for row in plant.rows]),
        "enabled": np.array([row.enabled for row in plant.rows]),
        "names": plant.names,
        "at": [turn for turn, _ in plant.values],
        "values": np.array([values for _, values in plant.values]),
        "states": np.array(plant.states or [0.0]),
        "state": plant.state,
        "measured": [plant.measure(k) for k in range(3)],
        "period": plant.period,
        "turn": plant.turn,
    }


def noted() -> dict[str, Any]:
    """What the model cannot carry out, and registers without numbers in the record."""
    notes: list[str] = []
    plant = ArmPlant(pendulum(PLAIN, JOINTS), MOUNTED, START, notes.append)
    plant.states = []
    plant.advance(0.003)
    for servo, each in enumerate((goal(2300.0), goal(0.3, mode="speed"), goal(0.0, mode="duty"))):
        plant.command(servo, each)
    plant.advance(0.0101)
    plant.command(0, goal(2300.0, gains=(16, 3, 40), acceleration=900.0, dead_band=(4, 2), limit=0.4))
    plant.command(0, goal(2200.0, gains=(16, 3, 40), acceleration=900.0, dead_band=(4, 2), limit=0.4, current=0.3))
    plant.advance(0.0205)
    plant.command(2, goal(0.4, mode="duty"))
    plant.command(1, goal(100.0, torque=False, speed=0.0))
    plant.advance(0.03)
    return {**plant_values(plant), "notes": notes}


def with_currents() -> dict[str, Any]:
    """Servos whose loops give currents."""
    loop = PLAIN | {"output": "current", "output_limit": 1.5}
    plant = ArmPlant(pendulum(loop, JOINTS, limits={"voltage_v": 6.0, "current_a": 1.2}), MOUNTED, START)
    plant.states = []
    for servo in range(3):
        plant.command(servo, goal(2300.0, current=0.7 + 0.2 * servo))
    plant.advance(0.02)
    return plant_values(plant)


def replayed(folder: Path) -> dict[str, Any]:
    """Goals and registers written as a scenario, and its runs."""
    plant = driven(three(), 4, 5, CHANGES.items())
    paths = write_goals(plant, folder / "run.scenario.toml")
    runs = replay(folder / "run.scenario.toml")
    return {
        "files": [path.name for path in paths],
        "texts": texts(folder),
        "q": np.concatenate([run.q.values for run in runs]),
        "refused": [each.replace(str(folder), "") for each in refusals(write_goals, (plant, folder / "run.toml"))],
    }


def registers(model: str, arm: aw.Model) -> dict[str, Any]:
    """Registers of servos at power-up by the numbers of a record."""
    made = ServoArm(arm, Line(model, reversed=arm.names[:1]))
    values = {name: [servo[name] for servo in made.bus.servos if name in servo] for name in servo_model(model).by_name}
    return {"words": str(made), "values": values, "mountings": made.plant.mountings}


def served_arm(folder: Path) -> dict[str, Any]:
    """An arm on a terminal in lock-step, whose goals are written as a scenario."""
    goals = FEETECH.pack(
        BROADCAST, 0x83, b"\x2a\x02" + b"".join(bytes((k,)) + (2100 + 50 * k).to_bytes(2, "little") for k in (1, 2, 3))
    )
    reads = FEETECH.pack(BROADCAST, 0x82, b"\x38\x02\x01\x02\x03")
    made, said = ServoArm(three(), start=START), list[str]()
    with (
        scripted([(0.001, each) for each in (goals, reads, goals, goals, reads)]) as terminal,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr("armwright.twin.serial.servo_arm.Terminal", lambda path: terminal)
        ended = lambda: not terminal.script  # noqa: E731
        counts = made.serve(
            None, ended, cycle=(PERIOD, "sync-write:42"), schedule=folder / "run.scenario.toml", ready=said.append
        )
    return {"counts": repr(counts), "written": terminal.written, "said": said, **texts(folder)}


def refused_lines() -> list[str]:
    """Lines that do not fit an arm."""
    arm, model = three(), servo_model("sts3215")
    found = refusals(lambda ids: ids_of(arm, ids), (None,), ([1, 2],), ([1, 1, 2],), ([5, 6, 7],))
    lines = [Line(zeros=[1.0, 2.0]), Line(reversed=["none"]), Line(reversed=["knee"], zeros=[1.0, 2.0, 3.0])]
    found += refusals(lambda line: mountings_of(arm, line, model), *((line,) for line in lines))
    found += refusals(lambda line: str(ServoArm(arm, line)), (Line(baud=9600),), (Line("none"),), (Line(),))
    return found + refusals(lambda name: str(ServoArm(name)), ("panda",))


# Calibrations and what servos may do.


def servo(number: int, **changes: Any) -> StoredServo:
    """A servo of a calibration."""
    values = {
        "homing_offset": 0,
        "range_min": 830,
        "range_max": 3061,
        "model_number": 777,
        "firmware": "3.10",
        **changes,
    }
    return StoredServo(id=number, **values)


def fitted(line: Line, calibration: Calibration | None = None) -> dict[str, Any]:
    """Servos on the joints of an arm."""
    fit = ServoFit.of(weightless(), line, calibration)
    qd, qdd = np.array([[0.1, -3.0], [0.2, 9.0]]), np.array([[1.0, 2.0], [-9.0, 70.0]])
    return {"ids": fit.ids, "mountings": fit.mountings, "allowed": fit.allowed, "limits": fit.goal_limits(qd, qdd)}


def refused_calibrations(folder: Path) -> list[str]:
    """Calibrations that contradict a line, an arm or themselves."""
    zeros = Calibration({"hip": servo(1, zero=1000.0), "knee": servo(2, reversed=True)}, "stored")
    calls = [
        (Line(zeros=[1.0, 2.0]), zeros),
        (Line(reversed=["hip"]), zeros),
        (Line(ids=[2, 1]), zeros),
        (Line(), Calibration({"hip": servo(1)}, "one")),
    ]
    found = refusals(lambda *words: fitted(*words), *calls)
    good = json.loads(json.dumps({"hip": {"id": 1, "homing_offset": 0, "range_min": 5, "range_max": 9}}))
    tables: list[Any] = [
        good,
        {**good, "knee": good["hip"]},
        {"hip": good["hip"] | {"range_max": 5}},
        {"hip": good["hip"] | {"id": 254}},
        [],
        {},
        {"hip": {}},
        {"hip": good["hip"] | {"firmware": 3}},
    ]
    for k, table in enumerate(tables):
        path = folder / f"{k}.json"
        path.write_text(json.dumps(table), encoding="utf-8")
        found += [
            each.replace(str(folder), "") for each in refusals(lambda p: repr(read_calibration(p).joints), (path,))
        ]
    return found


def differing() -> dict[str, Any]:
    """Differences of servos from a calibration, and how servos are stored."""
    stored = Calibration({"hip": servo(4), "knee": servo(5, firmware=None)}, "arm.json")
    changes = (
        {},
        {"homing_offset": 8},
        {"range_min": 99, "range_max": 7},
        {"firmware": "3.9"},
        {"drive_mode": 1},
        {"model_number": 1},
    )
    found = [refusals(stored.check, (Calibration({"hip": servo(4, **each), "knee": servo(5)}),)) for each in changes]
    made = {}
    for name in MODELS:
        model = servo_model(name)
        values = {register: 10 * k for k, register in enumerate(registers_of(model))}
        made[name] = {"registers": registers_of(model), "servo": stored_servo(model, 3, values, zero=7.0)}
    return {"differences": found, "made": repr(made), "keys": repr(STORED_IN)}


def written(folder: Path) -> dict[str, Any]:
    """A calibration that is written and read again."""
    mine = Calibration({"hip": servo(1, zero=1000.0), "knee": servo(2, reversed=True, drive_mode=4)})
    mine.write(folder / "arm.json")
    return {"texts": texts(folder), "same": read_calibration(folder / "arm.json").joints == mine.joints}


def refused_goals() -> list[str]:
    """Goals beyond limits, settings that are none."""
    fit = ServoFit.of(weightless(), Line(), Calibration({"hip": servo(1), "knee": servo(2)}, "stored"))
    times = np.arange(3) * 0.1

    def check(k: int, joint: int, position: float, speed: float) -> str:
        q, qd = np.zeros((3, 2)), np.zeros((3, 2))
        q[k, joint], qd[k, joint] = position, speed
        fit.check_goals(times, q, qd)
        return "kept"

    rows = [
        (1, 0, 1.5, 0.0),
        (1, 1, 1.6, 0.0),
        (2, 0, -1.501, 0.0),
        (0, 1, 0.0, 5.1),
        (2, 1, 0.0, -5.0),
        (2, 0, np.nan, 0.0),
    ]
    found = refusals(check, *rows)
    names = ("rate", "step", "torque", "approach", "patience")
    return found + refusals(
        lambda name, value: str(ServoSettings(**{name: value})),
        *((name, each) for name in names for each in (0.0, 1.0, 7.0, 1e4)),
    )


# Runs in lock-step.


@contextmanager
def at_once() -> Iterator[None]:
    """Waits of a run take no time."""
    clock = SimpleNamespace(time=0.0)

    def sleep_until(t: float) -> None:
        clock.time = max(t, clock.time)

    with pytest.MonkeyPatch.context() as patch:
        now = SimpleNamespace(now=lambda: clock.time, sleep_until=sleep_until)
        patch.setattr("armwright.twin.serial.capture.clock", now)
        yield


class Recorded(LockedPort):
    """A port that keeps what is sent, and loses answers from a moment on."""

    def __init__(self, made: ServoArm, timing: LockStep, silent: range = range(0)):
        super().__init__(made, timing)
        self.sent, self.silent = list[str](), silent

    def write(self, data: bytes) -> None:
        """Takes instructions."""
        self.sent.append(data.hex())
        super().write(data)
        if len(self.sent) in self.silent:
            self.waiting = b""


def served(model: str, start: tuple[float, float] = (0.0, 0.0), silent: range = range(0), **joint: Any) -> Recorded:
    """An arm of two servos that answers in lock-step."""
    line, tick = LINES[model]
    made = ServoArm(weightless(**joint), line, start=start)
    return Recorded(made, LockStep(made.bus, PERIOD, CycleEnd.parse(tick, made.bus.framing)), silent)


def stored(port: Recorded) -> Calibration:
    """What the servos of a port show."""
    return replace(
        ArmServos(port, ServoFit.of(port.made.arm, port.made.line)).read_calibration(port.made.line), file="stored"
    )


def captured(
    model: str, start: tuple[float, float] = (0.05, -0.1), silent: range = range(0), stop: int = 10**6, **settings: Any
) -> dict[str, Any]:
    """A motion that is played, with all that is sent."""
    port, said = served(model, start, silent), list[str]()
    line = Line(port.made.line.model, ids=port.made.line.ids)
    chosen = ServoSettings(**{"step": 1.0, "torque": 0.9, "patience": 0.001, "approach": 0.5, "rate": 50.0, **settings})
    plan = plan_capture(port.made.arm, MOVE, line, chosen, stored(port))
    asked = list[None]()

    def stopped() -> bool:
        asked.append(None)
        return len(asked) >= stop

    stop_error = ""
    with at_once():
        try:
            found: Captured = capture(plan, port, stopped, said.append)
        except RunStopped as error:
            found, stop_error = error.run, rounded(str(error))
    servos = [
        [servo["torque_enable"], servo["goal_position"], servo["present_position"]] for servo in port.made.bus.servos
    ]
    return {
        "said": said,
        "rows": np.array(found.rows),
        "began": found.began,
        "missed": found.missed,
        "reason": found.reason,
        "complete": found.complete,
        "sent": "\n".join(port.sent),
        "count": len(port.sent),
        "servos": servos,
        "stopped": stop_error,
        "speed": plan.speed,
        "acceleration": plan.acceleration,
        "table": plan.rows(),
        "longest": plan.longest_approach,
        "words": str(plan.longest_approach),
        "calibration": repr(plan.fit.calibration),
    }


def logged(folder: Path) -> dict[str, str]:
    """A log of what was captured."""
    rows = np.linspace(-1.0, 1.0, 40).reshape(4, 5, 2)
    found = Captured(JOINTS[:2], [0.0, 0.1, 0.2, 0.3], [0.01, 0.11, 0.21, 0.31], list(rows), 2)
    found.write(folder / "run.csv", weightless())
    return texts(folder)


def ways() -> list[str]:
    """Approaches from where an arm stands."""
    fit, settings = ServoFit.of(weightless(), Line()), ServoSettings(step=0.1, approach=0.4)
    poses = ([0.0, 0.0], [0.5, -0.2], [1.55, 0.0], [1.65, 0.0], [0.0, -1.59], [-1.4, 1.4])
    return refusals(lambda q: str(approach(fit, np.array(q), np.array([0.1, -0.1]), settings)), *((q,) for q in poses))


def run(
    model: str,
    start: tuple[float, float] = (0.0, 0.0),
    silent: range = range(0),
    following: float | None = None,
    speed: float = 1.0,
    stop: int = 10**6,
    **settings: Any,
) -> dict[str, Any]:
    """A controller that is run over servos, with its rehearsal."""
    port = served(model, start, silent)
    chosen = ServoSettings(**{"step": 1.0, "torque": 0.8, "patience": 0.001, **settings})
    given = replace(scenario(port.made.arm), duration=0.6)
    rehearsal = rehearse_servos(
        given, Line(port.made.line.model), calibration=stored(port), settings=chosen, speed=speed
    )
    asked, stop_error = list[None](), ""

    def stopped() -> bool:
        asked.append(None)
        return len(asked) >= stop

    with at_once():
        try:
            made = run_on_servos(rehearsal, port, stopped=stopped, following_error=following)
        except RunStopped as error:
            made, stop_error = error.run, rounded(str(error))
    return {
        "q": made.q,
        "time": made.time,
        "complete": made.complete,
        "good": made.good,
        "sentences": made.sentences(),
        "heading": made.heading,
        "table": made.tables()[0].rows(),
        "stopped": stop_error,
        "sent": "\n".join(port.sent),
        "rehearsed": rehearsal.q,
        "commands": rehearsal.recording.u,
        "rehearsal": rehearsal.tables()[0].rows(),
        "said": rehearsal.sentences(),
        "line": rehearsal.line_time,
        "times": rehearsal.times,
        "rate": rehearsal.settings.rate,
        "vary": rehearsal.source.vary,
    }


def refused_runs() -> list[str]:
    """Runs that servos cannot carry out, and calibrations that are missing or other ones."""
    good = scenario()
    loop = good.loop
    assert loop is not None
    scenarios = [
        replace(good, start=aw.Start([0.0, 0.0], [0.1, 0.0])),
        replace(good, loop=replace(loop, controller=None)),
        replace(good, loop=replace(loop, period=2e-3)),
        replace(good, inputs=aw.Inputs(enabled=aw.Schedule([0.0], [[1.0, 1.0]], ["hip", "knee"]))),
        replace(good, loop=replace(loop, sensors=aw.Sensors(velocity_noise=0.1))),
        replace(good, loop=replace(loop, command_filter=aw.CommandFilter(resolution=0.1))),
    ]
    found = refusals(lambda each: rehearse_servos(each).line_time, *((each,) for each in scenarios))
    port = served("sts3215")
    plain = ServoFit.of(port.made.arm, port.made.line)
    found += refusals(lambda: ArmServos(port, plain, 0.001).check_permitted(), ())
    for name, value in (("operating_mode", 1), ("homing_offset", 5), ("model_number", 3)):
        held = stored(port)
        port.made.bus.servos[0][name] = value
        fit = ServoFit.of(port.made.arm, replace(port.made.line, reversed=()), held)
        found += refusals(lambda fit=fit: ArmServos(port, fit, 0.001).check_permitted(), ())
        port.made.bus.servos[0][name] = 0
    timed = served("xl330-m288")
    timed.made.bus.servos[1]["drive_mode"] = 4
    fit = ServoFit.of(timed.made.arm, replace(timed.made.line, zeros=None), stored(timed))
    return found + refusals(lambda: ArmServos(timed, fit, 0.001).check_permitted(), ())


def units() -> dict[str, Any]:
    """Counts of encoders, and the time that frames take."""
    both = ServoUnits.of([Mounting(), Mounting(8192, 1000.0, -1)])
    q = np.array([0.12345, -0.5])
    times = [
        line_time(servo_model(name), joints, baud)
        for name in MODELS
        for joints in (1, 6)
        for baud in (57_600, 1_000_000)
    ]
    so101 = goal_limits(aw.load("so101"))
    return {
        "counts": both.counts(q),
        "position": both.position(both.counts(q)),
        "count": both.count,
        "times": times,
        "limits": [
            *so101,
            *goal_limits(pendulum(ALL, ("a", "b"), limits=LIMITS)),
            *goal_limits(pendulum(STIFF, ("a",), limits={"voltage_v": 5.0})),
        ],
        "there": [each.position(1234.0) for each in MOUNTED],
        "back": [each.counts(0.3) for each in MOUNTED],
    }


CASES = {
    "goals in turns": lambda _: plant_values(driven(three(), 1, 2)),
    "registers in turns": lambda _: plant_values(driven(three(), 4, 5, CHANGES.items())),
    "what is noted": lambda _: noted(),
    "loops of currents": lambda _: with_currents(),
    "goals as scenarios": replayed,
    **{f"registers of {model}": lambda _, model=model: registers(model, three()) for model in MODELS},
    "an arm on a terminal": served_arm,
    "lines that do not fit": lambda _: refused_lines(),
    "servos on joints": lambda _: fitted(Line(zeros=[2000.0, 3000.0], reversed=["knee"])),
    "calibrated servos on joints": lambda _: fitted(
        Line(),
        Calibration(
            {"hip": servo(7, zero=1000.0), "knee": servo(3, reversed=True, range_min=-5, range_max=9999)}, "stored"
        ),
    ),
    "servos on joints of lerobot": lambda _: fitted(
        Line(reversed=["hip"], zeros=[2048.0, 2000.0]), Calibration({"hip": servo(7), "knee": servo(3)}, "stored")
    ),
    "calibrations that do not fit": refused_calibrations,
    "differences from calibrations": lambda _: differing(),
    "a calibration": written,
    "goals beyond limits": lambda _: refused_goals(),
    "approaches": lambda _: ways(),
    **{f"a motion over {model}": lambda _, model=model: captured(model) for model in LINES},
    "a motion whose servos are silent": lambda _: captured("sts3215", silent=range(112, 10**6)),
    "a motion with a short silence": lambda _: captured("sts3215", silent=range(112, 115)),
    "a motion that is stopped": lambda _: captured("xl330-m288", stop=46),
    "a motion that is stopped before": lambda _: captured("sts3215", stop=6),
    "a motion that is too fast": lambda _: captured("sts3215", step=0.02),
    "a motion behind which the arm is released": lambda _: captured("sts3215", release=True),
    "a log": logged,
    **{f"a run over {model}": lambda _, model=model: run(model) for model in LINES},
    "a run from elsewhere": lambda _: run("sts3215", start=(0.1, -0.05), approach=0.5),
    "a run at half speed": lambda _: run("sts3215", speed=0.5, torque=0.1),
    "a run with a small following error": lambda _: run("sts3215", following=0.02),
    "a run that is stopped": lambda _: run("sts3215", stop=41),
    "a run with a short silence": lambda _: run("sts3215", silent=range(114, 117)),
    "runs that are refused": lambda _: refused_runs(),
    "units of servos": lambda _: units(),
}
