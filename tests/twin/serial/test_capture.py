"""`armwright capture` against an arm of our own: what it refuses, what it logs, and how it stops."""

import importlib.util
import os
import select
import signal
import sys
import threading
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import BusError, RunStopped
from armwright.twin.serial.arm_servos import ArmServos, ServoFit, ServoSettings
from armwright.twin.serial.calibration import Calibration
from armwright.twin.serial.capture import LEAST, Captured, approach, capture, plan_capture, play
from armwright.twin.serial.client import ServoClient
from armwright.twin.serial.registers import servo_model
from armwright.twin.serial.servo_arm import Line, ServoArm
from armwright.twin.serial.terminal import Terminal, serve
from armwright.twin.serial.timing import RealTime
from raises_at import raises_at
from simulation.test_servo import PLAIN, pendulum
from twin.serial.conftest import open_port

if sys.platform == "win32":
    pytest.skip("pseudo-terminals need Linux or macOS", allow_module_level=True)

JOINTS, LONG = ("hip", "knee"), 20.0
LIMITS = {"voltage_v": 5.0, "position_rad": [-1.5, 1.5], "velocity_rad_per_s": 4.0}
LINES = {
    "sts3215": Line(ids=[3, 1], reversed=["knee"]),
    "xl330-m288": Line("xl330-m288", ids=[3, 1], reversed=["knee"]),
}


class Descriptor:
    """A port by its descriptor."""

    def __init__(self, path):
        self.port = open_port(path)

    def write(self, data):
        os.write(self.port, data)

    def read(self, seconds):
        ready = select.select([self.port], [], [], seconds)[0]
        return os.read(self.port, 4096) if ready else b""


@pytest.fixture(scope="module")
def arm():
    stiff = PLAIN | {"p": 200, "d": 20, "d_scale_s_per_rad": 0.01}
    return pendulum(stiff, JOINTS, limits=LIMITS)


@pytest.fixture(scope="module")
def motion(arm):
    """There and back within two seconds."""
    return aw.trajectories.Waypoints([[0.0, 0.0], [0.4, -0.3], [0.0, 0.0]], times=[0.0, 0.5, 1.0])


class Served:
    """An arm served in real time by a thread of this process."""

    def __init__(self, arm, line):
        self.made, self.terminal, self.ended = ServoArm(arm, line), Terminal(), threading.Event()
        timing = RealTime(self.made.bus)
        arguments = (self.terminal, self.made.bus, timing, self.ended.is_set, LONG)
        self.thread = threading.Thread(target=serve, args=arguments, daemon=True)
        self.thread.start()

    def end(self):
        self.ended.set()
        self.thread.join(LONG)
        self.terminal.close()


@pytest.fixture
def served():
    """A function that serves an arm."""
    found = []

    def start(arm, line):
        found.append(Served(arm, line))
        return found[-1]

    yield start
    for each in found:
        each.end()


def calibration_of(arm, line, port):
    """Calibration with the servos' own values, as if it had been stored."""
    return replace(ArmServos(port, ServoFit.of(arm, line)).read_calibration(), file="stored")


def planned(arm, moved, line, one, **settings):
    """A plan with the calibration of an arm that is served."""
    stored = calibration_of(arm, line, Descriptor(one.terminal.device))
    return plan_capture(arm, moved, line, ServoSettings(rate=25.0, **settings), stored)


def client_of(served, line):
    return ServoClient(Descriptor(served.terminal.device), servo_model(line.model), LONG)


@pytest.mark.parametrize("model", LINES)
def test_it_plays_a_motion_and_logs_what_was_measured(arm, motion, served, tmp_path, model, monkeypatch):
    monkeypatch.setattr(
        "armwright.twin.serial.arm_servos.ServoClient", lambda port, model, patience: ServoClient(port, model, LONG)
    )
    monkeypatch.setattr("armwright.twin.serial.arm_servos.WATCHDOG", 2.5)
    line, one = LINES[model], served(arm, LINES[model])
    plan = planned(arm, motion, line, one, step=1.0, torque=0.9)
    found = capture(plan, Descriptor(one.terminal.device))
    found.write(tmp_path / "log.csv", arm)
    table = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True)
    assert (len(table), found.reason, found.missed) == (26, "the motion's end", 0)
    began, ended = table["t_s"], table["t_end_s"]
    assert (np.diff(began) > 0.0).all()
    assert (ended >= began).all()
    assert (began >= plan.times - 1e-3).all()
    rows = np.array(found.rows)
    assert np.ptp(rows[:, 1], axis=0) == pytest.approx([0.4, 0.3], abs=0.15)
    assert (rows[:, 4] == 5.0).all()
    assert np.abs(rows[:, 3]).max() > 0.01
    client = client_of(one, line)
    registers = ("torque_enable", "torque_limit" if model == "sts3215" else "goal_pwm")
    assert client.read(1, registers[0]) == 1
    assert client.read(1, registers[1]) == (900 if model == "sts3215" else round(0.9 / 1.129944e-3))
    assert abs(client.read(1, "goal_position") - client.read(1, "present_position")) < 60


@pytest.mark.parametrize(
    "asked", [1, 2, 16, None]
)  # before torque, at the first cycle of the approach, of the motion, and never
def test_release_switches_torque_off_after_a_complete_run(arm, motion, served, monkeypatch, asked):
    monkeypatch.setattr(
        "armwright.twin.serial.arm_servos.ServoClient", lambda port, model, patience: ServoClient(port, model, LONG)
    )
    line, one, cycles = LINES["sts3215"], served(arm, LINES["sts3215"]), []
    plan = planned(arm, motion, line, one, step=1.0, release=True)

    def stopped():
        cycles.append(None)
        return len(cycles) == asked

    found = capture(plan, Descriptor(one.terminal.device), stopped=stopped)
    expected = {
        1: ("it was stopped before torque was switched on", 0),
        2: ("it was stopped on the way to its beginning", 0),
        16: ("it was stopped", 1),
        None: ("the motion's end", 26),
    }
    assert found.complete == (asked is None)
    assert (found.reason, len(found.rows)) == expected[asked]
    assert client_of(one, line).read(3, "torque_enable") == (asked not in (1, None))


def test_a_joint_that_is_too_far_from_its_goal_ends_it_with_torque_on(arm, motion, served, monkeypatch):
    monkeypatch.setattr(
        "armwright.twin.serial.arm_servos.ServoClient", lambda port, model, patience: ServoClient(port, model, LONG)
    )
    line, one = LINES["sts3215"], served(arm, LINES["sts3215"])
    plan = planned(arm, motion, line, one, step=0.05, torque=1e-3)
    with pytest.raises(RunStopped, match=r"joint '\w+': .* \S+ rad .* \S+ s; .* 0\.05") as stop:
        capture(plan, Descriptor(one.terminal.device))
    assert 1 < len(stop.value.run.rows) < 26
    client = client_of(one, line)
    assert client.read(1, "torque_enable") == 1
    assert client.read(1, "goal_position") == pytest.approx(client.read(1, "present_position"), abs=5)


def test_nothing_moves_before_all_is_checked(arm, motion, served, monkeypatch):
    monkeypatch.setattr(
        "armwright.twin.serial.arm_servos.ServoClient", lambda port, model, patience: ServoClient(port, model, 2.0)
    )
    line, one = LINES["sts3215"], served(arm, LINES["sts3215"])
    port = Descriptor(one.terminal.device)
    stored = calibration_of(arm, line, port)
    with raises_at(BusError, "calibration", "--calibration FILE"):
        capture(plan_capture(arm, motion, line), port)
    elsewhere = Calibration({**stored.joints, "knee": stored.joints["knee"].model_copy(update={"id": 2})}, "stored")
    with raises_at(BusError, "model_number of servo 2", "no answer"):
        capture(plan_capture(arm, motion, replace(line, ids=None), calibration=elsewhere), port)
    client = client_of(one, line)
    for register, value, words in (
        ("homing_offset", 100, "homing_offset of joint 'knee', servo 1 = 100: .*expected 0, as stored in stored"),
        ("max_position_limit", 3000, "range_max of joint 'knee', servo 1 = 3000: .*expected 4095, as stored in stored"),
        ("operating_mode", 2, "operating mode of servo 1, joint 'knee' = 2: expected 0"),
    ):
        before = client.read(1, register)
        client.write(1, register, value)
        with pytest.raises(BusError, match=words):
            capture(plan_capture(arm, motion, line, calibration=stored), port)
        client.write(1, register, before)
    assert [client.read(number, "torque_enable") for number in (1, 3)] == [0, 0]
    assert [client.read(number, "torque_limit") for number in (1, 3)] == [1000, 1000]


@pytest.mark.study
def test_the_approach_is_slow_and_within_limits(arm, motion, served, monkeypatch):
    monkeypatch.setattr(
        "armwright.twin.serial.arm_servos.ServoClient", lambda port, model, patience: ServoClient(port, model, LONG)
    )
    line, one = LINES["sts3215"], served(arm, LINES["sts3215"])
    moved = aw.trajectories.Waypoints([[0.8, -0.2], [0.7, 0.0]], times=[0.0, 0.5])
    plan = planned(arm, moved, line, one, step=0.3, torque=0.9, approach=0.5)
    said = []
    found = capture(plan, Descriptor(one.terminal.device), say=said.append)
    assert said == ["approach of 3 s to where the motion begins, hip farthest: 0.8 rad"]  # 15/8 · 0.8 / 0.5
    assert (found.reason, len(found.rows)) == ("the motion's end", 14)
    assert found.rows[0][1] == pytest.approx([0.8, -0.2], abs=0.1)


def test_an_approach_begins_at_a_limit_that_is_near():
    arm = pendulum(PLAIN, JOINTS, limits={**LIMITS, "acceleration_rad_per_s2": 0.5})
    fit = ServoFit.of(arm, LINES["sts3215"])
    way = approach(fit, np.array([1.6, 0.0]), np.array([1.0, 0.0]), ServoSettings(step=0.2, approach=1.0))
    t = np.linspace(0.0, way.motion.duration, 999)
    q, qd, qdd = way.motion.at(t)
    assert q[0] == pytest.approx([1.5, 0.0])
    assert np.abs(qdd).max() == pytest.approx(0.5, rel=1e-3)
    assert np.abs(qd).max() <= 1.0
    with raises_at(BusError, "position of joint 'hip' [rad]", "-1.5 to 1.5", value=1.6):
        approach(fit, np.array([1.6, 0.0]), np.zeros(2), ServoSettings(step=0.05))
    assert approach(fit, np.zeros(2), np.zeros(2), ServoSettings()).motion.duration == LEAST


def test_a_servo_that_falls_silent_ends_it(arm, motion, served, monkeypatch):
    monkeypatch.setattr(
        "armwright.twin.serial.arm_servos.ServoClient", lambda port, model, patience: ServoClient(port, model, 0.3)
    )
    line, one = LINES["sts3215"], served(arm, LINES["sts3215"])
    asked = []

    def stopped():
        asked.append(True)
        if len(asked) == 18:  # the third cycle of the motion, behind 14 of the approach and the question before torque
            one.made.bus.servos[1]["id"] = 77
        return False

    plan = planned(arm, motion, line, one, step=1.0)
    with raises_at(RunStopped, "joint 'knee', servo 1", "3 cycles") as stop:
        capture(plan, Descriptor(one.terminal.device), stopped)
    assert np.isnan(stop.value.run.rows[-1][1, 1])
    assert stop.value.run.missed >= 3


BEYOND = {
    "a position": (
        [[0.0, 0.0], [1.6, 0.0]],
        4.0,
        r"joint 'hip': its position is 1\.5\d* rad at \S+ s; expected -1\.5 to 1\.5",
    ),
    "a speed": ([[0.0, 0.0], [0.0, 1.0]], 0.2, r"joint 'knee': its speed is \S+ rad/s at \S+ s; expected -4 to 4"),
}


@pytest.mark.parametrize(("poses", "duration", "words"), BEYOND.values(), ids=BEYOND)
def test_a_motion_beyond_limits_is_refused(arm, poses, duration, words):
    with pytest.raises(BusError, match=words):
        plan_capture(arm, aw.trajectories.Waypoints(poses, times=[0.0, duration]))


def test_goals_have_speeds_and_accelerations_above_those_of_the_motion_and_within_limits():
    arm = pendulum(PLAIN, JOINTS, limits={**LIMITS, "velocity_rad_per_s": 4.0, "acceleration_rad_per_s2": 30.0})
    fit = ServoFit.of(arm, LINES["sts3215"])
    for qd, qdd, speed, acceleration in ((0.0, 0.0, 0.2, 20.0), (-2.0, 6.0, 3.0, 24.0), (3.9, -50.0, 4.0, 30.0)):
        found = fit.goal_limits(np.array([[0.0, 0.0], [qd, 0.0]]), np.array([[qdd, 0.0], [0.0, 0.0]]))
        assert [each.tolist() for each in found] == [[speed, 0.2], [acceleration, 20.0]]


def test_an_encoder_has_ends(arm, motion):
    with raises_at(BusError, "joint 'hip'", r"\S+ rad .* its encoder$"):
        plan_capture(arm, motion, Line(zeros=[4000.0, 2048.0]))


@pytest.mark.parametrize(("field", "value"), [("rate", 0.0), ("step", -1.0), ("torque", 1.5)])
def test_settings_that_are_none_are_refused(field, value):
    with pytest.raises(BusError, match=rf"{field} = {value}"):
        ServoSettings(**{field: value})


def test_the_command_is_dry_by_default_and_plays_with_go(arm, motion, served, tmp_path):
    robot, file, log = (tmp_path / name for name in ("arm.toml", "motion.csv", "log.csv"))
    aw.robotfiles.write_toml(arm, robot)
    motion.save(arm, file)
    servos = ["capture", robot, "--ids", "3,1", "--reverse", "knee"]
    words = [*servos, "--reference", file, "--goal-distance", "1", "--period", "0.04"]

    def run(*more, words=words):
        return CliRunner().invoke(app, [str(word) for word in (*words, *more)])

    dry = run("--serial", tmp_path / "nowhere")
    assert dry.exit_code == 0
    assert "dry run: nothing was written" in dry.output
    assert "approach: at most 14.1 s to where the motion begins" in dry.output
    assert "hip" in dry.output
    wrong = run("--serial", tmp_path / "nowhere", "--period", "0.0005")
    assert (wrong.exit_code, "--period = 0.0005" in wrong.output) == (2, True)
    wrong = run("--serial", tmp_path / "nowhere", "--go")
    assert (wrong.exit_code, "expected -o LOG.csv beside --go" in wrong.output) == (2, True)
    wrong = run("--serial", tmp_path / "nowhere", "--go", "-o", log)
    assert (wrong.exit_code, "--calibrate FILE` writes one" in " ".join(wrong.output.split())) == (2, True)
    if importlib.util.find_spec("serial") is None:
        pytest.skip("needs pyserial")
    one, stored = served(arm, LINES["sts3215"]), tmp_path / "arm.calibration.json"
    made = run("--serial", one.terminal.device, "--calibrate", stored, words=servos)
    assert made.exit_code == 0, made.output
    words[2:6] = []  # ids and directions are those of the calibration
    wrong = run("--serial", tmp_path / "nowhere", "--calibration", stored, "--go", "-o", log)
    assert (wrong.exit_code, "cannot be opened" in wrong.output) == (2, True)
    dry = run("--serial", one.terminal.device, "--calibration", stored)
    assert "approach of 0.5 s to where the motion begins" in dry.output
    done = run("--serial", one.terminal.device, "--calibration", stored, "--go", "-o", log)
    assert done.exit_code in (0, 1), done.output  # 1 where the machine does too much other work
    assert log.exists() == (done.exit_code == 0 or "until the run ended" in done.output)


class Slow:
    """A port of one servo, at which this process finds an answer only when it may no longer wait, and loses some of them."""

    def __init__(self, lost):
        self.model, self.answers, self.lost, self.sent = servo_model("sts3215"), [], lost, 0

    def write(self, data):
        self.sent += 1
        self.answers = [b"", b"", b"" if self.sent <= self.lost else self.model.framing.status(1, 0, b"\x09\x03")]

    def read(self, seconds):
        if len(self.answers) == 2 and self.sent:
            time.sleep(0.02)
        return self.answers.pop(0) if self.answers else b""


def test_an_answer_counts_that_came_while_the_process_had_to_wait():
    client = ServoClient(Slow(lost=0), servo_model("sts3215"), patience=0.01)
    assert (client.read(1, "model_number"), client.missed) == (777, 0)


def test_an_instruction_to_one_servo_is_sent_three_times():
    port = Slow(lost=2)
    client = ServoClient(port, port.model, patience=0.01)
    assert (client.read(1, "model_number"), client.missed, port.sent) == (777, 2, 3)
    with raises_at(BusError, "model_number of servo 1", "3 tries"):
        ServoClient(Slow(lost=3), port.model, patience=0.01).read(1, "model_number")


class Line3:
    """A port of servo 3: what comes back for the k-th instruction, at once, and later, at the next wait for bytes."""

    def __init__(self, *answers):
        self.answers, self.now, self.later = list(answers), b"", b""
        self.sent = []

    def write(self, data):
        self.sent.append(data)
        self.now, self.later = self.answers.pop(0) if self.answers else (b"", b"")

    def read(self, seconds):
        found, self.now = self.now, b""
        if not found and seconds > 0.0:
            found, self.later = self.later, b""
        return found


def sts(data, error=0, number=3):
    return servo_model("sts3215").framing.status(number, error, bytes(data))


def test_a_computer_that_stands_still_before_the_first_cycle_ends_the_run(monkeypatch):
    """As after SIGSTOP, or a lid that was shut."""
    times = iter([0.0, 3.0])
    monkeypatch.setattr("armwright.twin.clock.now", lambda: next(times))
    monkeypatch.setattr("armwright.twin.clock.sleep_until", lambda _: None)
    servos: Any = SimpleNamespace(silent=np.zeros(2, dtype=bool))
    with raises_at(BusError, "period"):
        play(servos, np.array([0.0, 0.02]), lambda _, row: row[0], ServoSettings(), Captured(JOINTS), lambda: False)


def test_a_late_answer_is_not_taken_for_that_to_the_next_instruction():
    model = servo_model("sts3215")
    port = Line3((b"", b""), (sts([7]), sts([7])), (sts([50]), b""))
    client = ServoClient(port, model, patience=0.001)
    assert [client.read(3, name) for name in ("torque_enable", "profile_acceleration")] == [7, 50]
    eight = list(range(8))
    port.answers = [(sts(eight), b""), (sts(eight), sts([*eight, 0], number=1))]
    names = ("present_position", "present_temperature")
    assert list(client.sync_read([3, 1], names)) == [3]
    assert list(client.sync_read([3, 1], names)) == [1]  # the answer of servo 3 is one to the reading before
    assert client.missed == 3


def test_frames_that_are_no_answers_are_skipped():
    model = servo_model("sts3215")
    other, read = model.framing.pack(3, 3, b"\x2a\x00\x08"), model.framing.pack(3, 2, b"\x03\x02")
    damaged = bytearray(sts([1, 2], number=5))
    damaged[3] = 60  # a length that reaches over all that follows
    port = Line3((b"\x00\xff" + other + read + sts([9]) + bytes(damaged) + sts([9, 3]), b""))
    assert ServoClient(port, model, patience=0.001).read(3, "model_number") == 777


def test_a_line_that_is_never_quiet_ends_the_wait():
    class Noise:
        def write(self, data):
            """Nothing hears it."""

        def read(self, seconds):
            return b"\xff"

    with raises_at(BusError, "model_number of servo 3", "3 tries"):
        ServoClient(Noise(), servo_model("sts3215"), patience=0.002).read(3, "model_number")


@pytest.mark.usefixtures("hangs_up")
def test_the_end_of_a_terminal_stops_a_run_as_ctrl_c_does():
    from armwright.cli.servo_arm import stopping

    with stopping(None) as stopped:
        assert not stopped()
        os.kill(os.getpid(), signal.SIGHUP)
        assert stopped()
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with stopping(None) as stopped:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stopped()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_error_of_a_run_stays_where_its_log_cannot_be_written_and_a_log_without_rows_is_not(arm, tmp_path):
    from armwright.cli.servo_arm import keep, kept

    file, found = tmp_path / "log.csv", Captured(JOINTS)
    file.write_text("before")
    keep(file, found, arm)
    stop = RunStopped("was silent")
    assert kept(stop, file, found, arm) is stop
    assert file.read_text() == "before"
    found.began, found.ended, found.rows = [0.0], [0.1], [np.zeros((5, 2))]
    nowhere = kept(stop, tmp_path / "none" / "log.csv", found, arm)
    assert (nowhere.what, len(nowhere.problems)) == ("was silent", 2)
    assert kept(stop, file, found, arm) is stop
    assert file.read_text().startswith("t [s]")
