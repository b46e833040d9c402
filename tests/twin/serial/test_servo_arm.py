"""`armwright twin ARM --serial PATH`: an arm in a process of its own, driven through its pseudo-terminal."""

import contextlib
import importlib.util
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.twin.serial.frames import FEETECH, Parser
from armwright.twin.serial.replay import replay
from simulation.test_servo import ALL, pendulum
from twin.serial.conftest import open_port
from twin.serial.test_terminal import received

if sys.platform == "win32":
    pytest.skip("pseudo-terminals need Linux or macOS", allow_module_level=True)

JOINTS = ("hip", "knee", "ankle")
PERIOD, TURN = 0.02, 1e-3


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Records of arms, by the number of their joints."""
    folder = tmp_path_factory.mktemp("arms")
    for names, volts in ((JOINTS, 5.0), (tuple("abcdef"), 7.4)):
        arm = pendulum(ALL, names, limits={"voltage_v": volts})
        aw.robotfiles.write_toml(arm, folder / f"{len(names)}.toml")
    return folder


@pytest.fixture
def twin(files, tmp_path):
    """A function that starts the command for an arm of so many joints, and one that ends it and returns what it printed."""
    with contextlib.ExitStack() as stack:

        def start(joints, *words):
            command = [sys.executable, "-m", "armwright", "twin", str(files / f"{joints}.toml")]
            command += ["--serial", str(tmp_path / "port"), "--patience", "20", *map(str, words)]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            stack.callback(process.communicate)
            stack.callback(process.kill)
            assert process.stdout is not None
            lines = [process.stdout.readline(), process.stdout.readline()]
            assert lines[1] == f"servos on {tmp_path / 'port'}\n", [*lines, process.communicate(timeout=60)[1]]

            def end(by=signal.SIGTERM):
                process.send_signal(by)
                out, error = process.communicate(timeout=60)
                assert (process.returncode, error) == (0, "")
                assert not (tmp_path / "port").exists()
                return {line[:24].strip(): line[24:].strip() for line in out.splitlines()}

            return end

        yield start


def checked(path, positions, turn):
    """Compares positions [counts], read when each cycle began, with the simulation of the written schedule."""
    (run,) = replay(path)
    ends = round(run.time.values[-1] / PERIOD)
    assert run.time.values[-1] == pytest.approx(ends * PERIOD, abs=1e-9)
    counts = np.rint(turn / 2 + run.q.values * turn / (2 * np.pi))
    began = [round((ends - len(positions) + k) * PERIOD / TURN) for k in range(1, len(positions))]
    np.testing.assert_array_equal(counts[began], positions[1:])
    assert np.ptp(positions, axis=0).min() > 50


def texts(folder):
    """Contents of the files that a twin wrote, but for the robot's own."""
    return [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*")) if "robot" not in path.name]


def test_dynamixel_sdk_drives_an_arm_in_lock_step(twin, tmp_path):
    if importlib.util.find_spec("dynamixel_sdk") is None:
        pytest.skip("needs dynamixel-sdk")
    found = []
    for seed in (1, 2):
        folder = tmp_path / str(seed)
        folder.mkdir()
        end = twin(3, "--servo", "xl330-m288", "--period", PERIOD, "--write-schedule", folder / "run.scenario.toml")
        command = [sys.executable, str(Path(__file__).with_name("client_arm.py")), str(tmp_path / "port"), str(seed)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path[1:])}
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment, check=False)
        assert done.returncode == 0, done.stderr
        assert end()["late replies, not sent"] == "0"
        found.append((json.loads(done.stdout), texts(folder)))
    assert found[0] == found[1]
    checked(tmp_path / "1" / "run.scenario.toml", found[0][0], 4096)


def words(values):
    return b"".join(value.to_bytes(2, "little") for value in values)


def test_raw_frames_drive_an_arm_in_lock_step(twin, tmp_path):
    """Registers as LeRobot writes them, reads between cycles, torque off and on; other pauses, the same bits."""
    found = []
    for seed in (1, 2):
        folder, rng, positions = tmp_path / str(seed), random.Random(seed), []
        folder.mkdir()
        end = twin(3, "--period", PERIOD, "--tick", "sync-write:42", "--write-schedule", folder / "run.scenario.toml")
        port = open_port(tmp_path / "port")

        def put(number, address, *data, port=port):
            os.write(port, FEETECH.pack(number, 3, bytes((address, *data))))
            assert received(port, 6)[4:5] == b"\0"

        for number in (1, 2, 3):
            for address, value in ((55, 0), (7, 0), (21, 16), (23, 0), (22, 32), (41, 254), (40, 1)):
                put(number, address, value)
        for k in range(20):
            os.write(port, FEETECH.pack(254, 0x82, bytes((56, 2, 1, 2, 3))))
            frames = Parser(FEETECH).feed(received(port, 24))
            positions.append([int.from_bytes(frame.data, "little") for frame in frames])
            time.sleep(rng.choice((0.0, 0.0, 0.01, 0.04)))
            if k in (10, 14):
                put(2, 40, int(k == 14))
            on = (1, 3) if 10 <= k < 14 else (1, 2, 3)
            goals = b"".join(bytes((n,)) + words([2048 + 25 * k * (-1) ** n]) for n in on)
            os.write(port, FEETECH.pack(254, 0x83, b"\x2a\x02" + goals))
        os.write(port, FEETECH.pack(1, 1))  # the last cycle is closed before this is answered
        assert received(port, 6)
        os.close(port)
        assert end(signal.SIGINT)["late replies, not sent"] == "0"
        found.append((positions, texts(folder)))
    assert found[0] == found[1]
    run = aw.simulate(tmp_path / "1" / "run.scenario.toml")
    duration = run.time.values[-1]
    # the ping's bytes pass, no whole turn
    assert round(duration / PERIOD) * PERIOD == pytest.approx(duration, abs=1e-9)
    checked(tmp_path / "1" / "run.scenario.toml", positions, 4096)


@pytest.mark.study
def test_six_servos_in_real_time(twin, tmp_path):
    end, lost = twin(6), 0
    port = open_port(tmp_path / "port")
    for number in range(1, 7):
        os.write(port, FEETECH.pack(number, 3, bytes((40, 1))))
        assert received(port, 6)
    began = time.monotonic()
    for k in range(100):
        os.write(port, FEETECH.pack(254, 0x82, bytes((56, 8, *range(1, 7)))))
        frames = Parser(FEETECH).feed(received(port, 6 * 14))
        lost += len(frames) != 6
        goals = b"".join(bytes((n,)) + words([2048 + round(300 * np.sin(k / 20))]) for n in range(1, 7))
        os.write(port, FEETECH.pack(254, 0x83, b"\x2a\x02" + goals))
        time.sleep(max(began + 0.02 * (k + 1) - time.monotonic(), 0.0))
    took = time.monotonic() - began
    os.close(port)
    counts = end()
    assert lost == 0
    assert counts["late replies, not sent"] == "0"
    assert counts["baud rates of clients"] == "1000000"
    assert float(counts["simulated time"].removesuffix(" s")) > took - 0.5


MISTAKES = {
    "no servos": (
        ["cmu-dd"],
        "joint 'joint1' of cmu-dd is driven by voltage; expected joints with command = \"position\"",
    ),
    "ids": (["3.toml", "--ids", "1-2"], "--ids = [1, 2]: expected 3 different ones: hip, knee, ankle"),
    "words": (["3.toml", "--ids", "1-x"], "--ids = '1-x': expected ids with commas or a dash"),
    "a model": (["3.toml", "--servo", "ax12"], "--servo = 'ax12'"),
    "a tick": (["3.toml", "--tick", "action"], "--tick: is of lock-step; expected --period beside it"),
    "a bus": (["3.toml", "--bus", "virtual"], "--bus = 'virtual': is of a CAN bus, beside --serial"),
    "a joint": (["3.toml", "--reverse", "toe"], "--reverse = 'toe': no such joint; there is ankle, hip, knee"),
    "a file": (
        ["3.toml", "--write-schedule", "goals.csv"],
        "--write-schedule = 'goals.csv': expected NAME.scenario.toml",
    ),
}


@pytest.mark.parametrize(("given", "message"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes_are_one_line(files, tmp_path, given, message):
    given = [str(files / word) if word.endswith(".toml") else word for word in given]
    done = CliRunner().invoke(app, ["twin", *given, "--serial", str(tmp_path / "port")])
    assert done.exit_code == 2
    assert message in done.output
    assert len(done.output.strip().splitlines()) == 1


def test_options_of_servos_need_a_line(files):
    done = CliRunner().invoke(app, ["twin", str(files / "3.toml"), "--ids", "1-3"])
    assert (done.exit_code, done.output.strip()) == (
        2,
        "armwright: error: --ids = '1-3': is of servos; expected --serial PATH beside it",
    )
