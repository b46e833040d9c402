"""A controller run over a bus of servos: in lock-step its motion is that of the rehearsal; what is refused, and how it stops."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import BusError, RunStopped
from armwright.twin.serial.arm_servos import ArmServos, ServoFit, ServoSettings
from armwright.twin.serial.client import ServoClient
from armwright.twin.serial.frames import Parser
from armwright.twin.serial.registers import servo_model
from armwright.twin.serial.run import line_time, rehearse_servos, run_on_servos
from armwright.twin.serial.servo_arm import Line, ServoArm
from armwright.twin.serial.timing import CycleEnd, LockStep
from raises_at import raises_at
from simulation.test_servo import PLAIN, pendulum
from twin.serial.locked_port import LockedPort

JOINTS, PERIOD, COUNT = ("hip", "knee"), 0.02, 2.0 * np.pi / 4096.0
LIMITS = {"voltage_v": 5.0, "position_rad": [-1.5, 1.5], "velocity_rad_per_s": 5.0}
STIFF = PLAIN | {"p": 200, "d": 20, "d_scale_s_per_rad": 0.01, "dead_band_counts": 0}
LIMITED = {"output_limit": 0.2, "goal_speed_rad_per_s": 5.0}  # of the record 0.97 and 5.2
LINES = {
    "sts3215": (Line(ids=[3, 1], reversed=["knee"]), "sync-write:42"),
    "xl330-m288": (Line("xl330-m288", ids=[3, 1], zeros=[2048.0, 1500.0]), "sync-write:116"),
}


def weightless(firmware=STIFF, **joint):
    """Two rods about upright axes, which stand still at their goals."""
    return pendulum(firmware, JOINTS, **{"limits": LIMITS, "axis": [0.0, 0.0, 1.0], **joint})


def swing(t):
    slow = 0.5 * (1.0 - aw.scalar.cos(4.0 * t))
    return aw.scalar.array([0.6 * slow, -0.4 * slow])


def scenario(arm=None, reference=swing, **changes):
    loop = aw.Loop(aw.JointPID(kp=1.1, kd=0.01), reference, period=PERIOD)
    return replace(aw.Scenario(arm or weightless(), duration=1.0, loop=loop, start=[0.0, 0.0]), **changes)


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Waits of the run take no time."""
    ticking = SimpleNamespace(time=0.0)
    now = SimpleNamespace(
        now=lambda: ticking.time, sleep_until=lambda t: setattr(ticking, "time", max(t, ticking.time))
    )
    monkeypatch.setattr("armwright.twin.serial.capture.clock", now)


def served(arm, model="sts3215", start=(0.0, 0.0)):
    line, tick = LINES[model]
    made = ServoArm(arm, line, start=start)
    return LockedPort(made, LockStep(made.bus, PERIOD, CycleEnd.parse(tick, made.bus.framing)))


def rehearsed(port, given, **settings):
    line = port.made.line
    stored = replace(ArmServos(port, ServoFit.of(given.arm, line)).read_calibration(), file="stored")
    chosen = {"step": 1.0, "torque": 1.0, "patience": 0.1, **settings}
    return rehearse_servos(given, line, calibration=stored, settings=ServoSettings(**chosen))


@pytest.mark.parametrize("model", LINES)
def test_its_motion_is_that_of_the_rehearsal(model):
    given = scenario()
    port = served(given.arm, model)
    rehearsal, said = rehearsed(port, given), []
    run = run_on_servos(rehearsal, port, say=said.append)
    assert run.complete
    assert run.captured.missed == 0
    assert [text.startswith("approach of 0.5 s to where the motion begins") for text in said] == [True]
    assert np.ptp(rehearsal.q, axis=0) == pytest.approx([0.6, 0.4], abs=0.15)
    assert np.abs(run.q - rehearsal.q).max() < 1.01 * COUNT
    written = np.array(run.captured.rows)[1:, 0]
    assert np.abs(written - rehearsal.recording.u[:-1]).max() < 2.01 * COUNT
    client = ServoClient(port, servo_model(model))
    assert client.read(3, "torque_enable") == 1


def test_the_rehearsal_is_the_simulation_but_for_counts_and_the_line():
    given = scenario()
    rehearsal = rehearse_servos(given, settings=ServoSettings(torque=1.0))
    ideal = aw.simulate(replace(given, recording=aw.Recording(period=PERIOD)))
    difference = np.abs(rehearsal.q - ideal.q.values[: len(rehearsal.q)]).max()
    quick = np.abs(np.diff(rehearsal.q, axis=0)).max() / PERIOD
    assert COUNT / 4 < difference < 2.0 * quick * rehearsal.line_time + 4.0 * COUNT


@pytest.mark.parametrize("model", LINES)
def test_the_time_of_a_cycle_is_that_of_its_frames(model):
    port = served(weightless(), model)
    servos = ArmServos(port, ServoFit.of(port.made.arm, port.made.line))
    servos.written = servos.positions()
    begin = port.timing.nanoseconds
    row = servos.read()
    read = port.timing.nanoseconds - begin
    sent = []
    port.write = sent.append
    servos.command(row[1], row, 1.0, "now")
    taken = 1e-9 * read + 10.0 * len(sent[0]) / 1e6
    assert line_time(servos.fit.model, 2, 1_000_000) == pytest.approx(taken, abs=1e-9)
    assert Parser(servos.fit.model.framing).feed(sent[0])


def test_it_goes_to_where_it_begins_and_stops_when_it_is_told():
    given = scenario()
    port = served(given.arm, start=(0.3, -0.2))
    rehearsal, asked = rehearsed(port, given, approach=0.5), []

    def stopped():
        asked.append(None)
        return len(asked) == 70

    run = run_on_servos(rehearsal, port, stopped=stopped)
    assert run.captured.reason == "it was stopped"
    assert not run.complete
    assert run.q[0] == pytest.approx([0.0, 0.0], abs=4 * COUNT)
    client = ServoClient(port, servo_model("sts3215"))
    assert client.read(3, "torque_enable") == 1
    assert client.read(3, "goal_position") == pytest.approx(2048 + run.q[-1, 0] / COUNT, abs=40)


def test_a_following_error_ends_it():
    given = scenario()
    port = served(given.arm)
    with raises_at(RunStopped, re.compile(r"joint '\w+'"), r"error \S+ rad .* \S+ s; .* 0\.02") as stop:
        run_on_servos(rehearsed(port, given), port, following_error=0.02)
    assert 0 < len(stop.value.run.q) < 50


def away(t):
    return aw.scalar.array([2.0 * t, 0.0])


def refused():
    coarse = aw.Loop(aw.JointPID(kp=1.0), swing, period=1e-3)
    still = aw.Schedule([0.0], [[0.0, 0.0]], JOINTS)
    off = aw.Schedule([0.0], [[0.0, 1.0]], JOINTS)
    return {
        "voltages": (lambda: scenario(weightless(None, command="voltage")), "driven by voltage; expected joints with command"),
        "no controller": (lambda: aw.Scenario(weightless(), duration=1.0, command=still), "loop.controller"),
        "a moving start": (lambda: scenario(start=aw.Start([0.0, 0.0], [1.0, 0.0])), "start.qd: the arm moves at the start"),
        "servos off": (lambda: scenario(inputs=aw.Inputs(enabled=off)), "inputs.enabled: servos that are off"),
        "a period too short": (lambda: scenario(loop=coarse), r"loop.period = 0\.001: frames of a cycle take 1\.\d+ ms"),
        "beyond a limit": (lambda: scenario(reference=away), r"joint 'hip': the reference is 1\.\d+ at"),
    }  # fmt: skip


@pytest.mark.parametrize("case", refused())
def test_a_scenario_that_the_line_cannot_carry_is_refused_by_name(case):
    make, words = refused()[case]
    with pytest.raises(BusError, match=words):
        rehearse_servos(make())


def test_without_a_calibration_nothing_moves():
    given = scenario()
    port = served(given.arm)
    with raises_at(BusError, "calibration"):
        run_on_servos(rehearse_servos(given, port.made.line), port)
    assert ServoClient(port, servo_model("sts3215")).read(3, "torque_enable") == 0


def test_a_reference_that_begins_away_from_the_start_is_said_before_the_arm_moves():
    at = [0.0, 0.2]
    away = scenario(reference=lambda t: swing(t) + np.array(at))
    said = rehearse_servos(away).sentences()[1:]
    assert len(said) == 1
    assert all(word in said[0] for word in ("knee", "0.2 rad", "start q = [0, 0.2]"))
    assert rehearse_servos(replace(away, start=at)).sentences()[1:] == []


def test_a_torque_limit_is_rehearsed():
    found = rehearse_servos(scenario(), settings=ServoSettings(torque=0.2))
    assert found.source.vary == {f"{name}.firmware.{key}": value for name in JOINTS for key, value in LIMITED.items()}
    strong = rehearse_servos(scenario(), settings=ServoSettings(torque=1.0))
    assert strong.source.vary == {f"{name}.firmware.goal_speed_rad_per_s": 5.0 for name in JOINTS}
    assert np.abs(found.q - strong.q).max() > COUNT


def test_the_command_is_dry_by_default_and_refuses_what_is_of_the_other_bus(tmp_path):
    file = tmp_path / "run.scenario.toml"
    file.write_text(
        'robot = "so101"\nduration_s = 0.2\n[start]\nq = [0, 0, 0, 0, 0, 0]\n[loop]\nperiod_s = 0.02\n'
        '[loop.controller]\nkind = "joint_pid"\nkp = 1.0\n',
        encoding="utf-8",
    )
    words = ["run-controller", str(file), "--serial", str(tmp_path / "nowhere")]
    for more, code, said in (
        ([], 0, "frames of a cycle take 4.18 ms, 21% of its period"),
        (["--go"], 2, "there is none to compare the servos with; expected --calibration FILE"),
        (["--bus", "virtual"], 2, "--bus = 'virtual': is of a CAN bus, beside --serial"),
        (["--missing", "2"], 2, "--missing = 2: is of a CAN bus"),
        (["--torque-fraction", "2"], 2, "--torque-fraction = 2"),
    ):
        result = CliRunner().invoke(app, [*words, *more])
        output = " ".join(result.output.split())
        assert (result.exit_code, said in output) == (code, True), output
    result = CliRunner().invoke(app, ["run-controller", str(file), "--goal-distance", "1"])
    assert (result.exit_code, "--goal-distance = 1.0: is of servos" in result.output) == (2, True)


def changed(given, change, model="sts3215", **settings):
    """A run at whose port a function has its way with every answer: of the port, what was sent, and the answers."""
    port = served(given.arm, model)
    rehearsal, write = rehearsed(port, given, **settings), port.write

    def sent(data):
        write(data)
        port.waiting = change(port, data, port.waiting)

    port.write = sent
    return port, lambda **options: run_on_servos(rehearsal, port, **options)


def calls(*numbers, act):
    """Acts on a port at instructions of these numbers, and leaves its answers as they are."""
    count = iter(range(10**6))

    def change(port, data, answers):
        return act(port, answers) if next(count) in numbers else answers

    return change


@pytest.mark.parametrize("model", LINES)
def test_an_adapter_that_hears_itself_changes_nothing(model):
    _port, run = changed(scenario(), lambda port, sent, answers: sent + answers, model)
    found = run()
    assert (found.complete, found.captured.missed) == (True, 0)


@pytest.mark.parametrize("model", LINES)
@pytest.mark.parametrize("silent", [False, True])
def test_a_servo_that_restarts_ends_the_run(model, silent):
    def restart(port, answers):
        port.made.bus.servos[0].power_up()
        return b"" if silent else answers

    given = scenario(reference=lambda t: 0.02 * swing(t))  # so little that no joint is far from its goal without torque
    _port, run = changed(given, calls(120, 121, act=restart), model)
    with raises_at(RunStopped, re.compile(r"\w+ of joint 'hip', servo 3")) as stop:
        run()
    assert not stop.value.run.complete
    assert (len(stop.value.run.q) < 50) == silent  # at its first answer, else at the end
    off = [each.place for each in stop.value.problems[1:]]
    assert off == ([] if model == "sts3215" else ["joints 'hip'"])  # a goal switches an STS on


def test_a_watchdog_that_has_stopped_a_servo_ends_the_run():
    def pause(port, answers):
        port.timing.nanoseconds += 500_000_000
        return answers

    given = scenario(reference=lambda t: 0.02 * swing(t))
    port, run = changed(given, calls(120, act=pause), "xl330-m288")
    with raises_at(RunStopped, re.compile(r"\w+ of joint 'hip', servo 3")):
        run()
    assert [servo["bus_watchdog"] for servo in port.made.bus.servos] == [0, 0]


@pytest.mark.parametrize(("model", "bit"), [("sts3215", "0x20"), ("xl330-m288", "0x80")])
def test_a_servo_with_an_alarm_is_named_with_it_and_stopped(model, bit):
    def alarm(port, answers):
        port.made.bus.servos[0]["hardware_error_status"] = 0x20
        return answers

    port, run = changed(scenario(), calls(*range(120, 10**4), act=alarm), model)
    if model != "sts3215":
        port.made.bus.servos[0]["shutdown"] = 0
    with raises_at(RunStopped, "joint 'hip', servo 3", bit) as stop:
        run()
    assert not np.isnan(stop.value.run.q).any()
    assert len(stop.value.problems) == 1
    servo = port.made.bus.servos[0]
    assert servo["goal_position"] == pytest.approx(servo["present_position"], abs=10)


def test_cycles_that_take_longer_than_their_period_end_the_run(monkeypatch):
    from armwright.twin.serial import capture

    now, sleep, slow = capture.clock.now, capture.clock.sleep_until, [0.0]
    monkeypatch.setattr(
        capture, "clock", SimpleNamespace(now=lambda: now() + slow[0], sleep_until=lambda t: sleep(t - slow[0]))
    )

    def wait(port, sent, answers):
        slow[0] += 0.02
        return answers

    port, run = changed(scenario(), wait)
    with raises_at(RunStopped, "period", "approach", value=PERIOD):
        run()
    assert [servo["torque_enable"] for servo in port.made.bus.servos] == [1, 1]


def test_a_stop_before_torque_writes_nothing():
    port, run = changed(scenario(), lambda port, sent, answers: answers)
    found = run(stopped=lambda: True)
    assert not found.complete
    assert found.tables()[0].rows() == [{"joint": n, "largest error": 0.0, "from the simulation": 0.0} for n in JOINTS]
    assert [servo["torque_enable"] for servo in port.made.bus.servos] == [0, 0]


def mute(register, value):
    """Loses the answers to writes of a value to a register of servo 3."""

    def change(port, sent, answers):
        each, at = Parser(port.made.bus.framing).feed(sent)[0], servo_model("sts3215").by_name[register]
        return b"" if (each.number, each.instruction, each.data) == (3, 3, bytes((at.address, value))) else answers

    return change


def test_servos_that_were_not_reached_stay_off():
    port, run = changed(scenario(), mute("profile_acceleration", 254), patience=0.001)
    with raises_at(RunStopped, re.compile("profile_acceleration = .* of servo 3"), "3 tries"):
        run()
    assert [servo["torque_enable"] for servo in port.made.bus.servos] == [0, 0]


def test_a_release_that_is_not_answered_keeps_the_run_and_releases_the_others():
    port, run = changed(scenario(), mute("torque_enable", 0), patience=0.001, release=True)
    with raises_at(RunStopped, "torque_enable = 0 of servo 3", "3 tries") as stop:
        run()
    assert len(stop.value.run.q) == 50
    assert port.made.bus.servos[1]["torque_enable"] == 0


def test_a_servo_that_does_not_answer_at_the_end_is_named():
    silent = calls(*range(120, 10**4), act=lambda port, answers: b"")
    _port, run = changed(scenario(), silent, patience=0.001)
    with raises_at(RunStopped, "joint 'hip', servo 3", "3 cycles") as stop:
        run(following_error=1.0)
    assert [each.place for each in stop.value.problems[1:]] == ["joints 'hip', 'knee'"]


@pytest.mark.parametrize("line", [Line(baud=0), Line(baud=12345), Line(ids=[1, 254]), Line(ids=[-1, 2])])
def test_a_line_that_no_servo_has_is_refused(line):
    with raises_at(BusError, "ids" if line.ids else "baud", value=line.ids or line.baud):
        rehearse_servos(scenario(), line)


@pytest.mark.parametrize("model", LINES)
def test_a_joint_just_outside_its_limits_of_position_begins_and_ends_at_the_limit(model):
    given = scenario(reference=lambda t: 0.02 * swing(t))
    port = served(given.arm, model, start=(-0.05, 0.0))
    hip = port.made.bus.servos[0]
    hip["min_position_limit"] = 2048
    found = run_on_servos(rehearsed(port, given), port)
    assert found.complete
    assert hip["goal_position"] == pytest.approx(2048, abs=20)
    hip["min_position_limit"] = 2100  # as if the joint had been pushed beyond it at the end
    servos = ArmServos(port, found.rehearsal.fit)
    stored = found.rehearsal.fit.calibration.joints["hip"].model_copy(update={"range_min": 2100})
    servos.fit = replace(servos.fit, calibration=replace(servos.fit.calibration, joints={"hip": stored}))
    servos._prepared = {0: {}}
    assert servos.hold() == []
    assert hip["goal_position"] == 2100
