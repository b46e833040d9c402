"""Servos on a bus in this process, and on a pseudo-terminal in a process of their own."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from typing import Any

import pytest

from armwright.twin.serial.bus import ServoBus, make_servo
from armwright.twin.serial.frames import Parser
from armwright.twin.serial.plant import KinematicPlant
from armwright.twin.serial.registers import servo_model

BAUD = 1_000_000
VOLTAGES = {"sts3215": 7.4, "xl330-m288": 5.0, "xl430-w250": 12.0}
BAUD_CODES = {"sts3215": 0, "xl330-m288": 3, "xl430-w250": 3}


class Client:
    """Instructions to a bus in this process, by name."""

    def __init__(self, bus: ServoBus, plant: Any):
        self.bus, self.plant = bus, plant
        self.codes = {name: code for code, name in bus.framing.instructions.items()}
        self.registers = bus.servos[0].model.by_name

    def frames(self, instruction, number, data=b"", baud=BAUD):
        """Frames of all answers, as a receiver finds them."""
        sent = self.bus.framing.pack(number, self.codes[instruction], bytes(data))
        answers = [a for frame in self.bus.feed(sent, baud) for a in self.bus.answer(frame, baud)]
        return Parser(self.bus.framing).feed(b"".join(answer.data for answer in answers))

    def words(self, *values):
        return b"".join(value.to_bytes(self.bus.framing.word, "little") for value in values)

    def status(self, instruction, number, data=b"", baud=BAUD):
        """Error and data of the one answer."""
        (frame,) = self.frames(instruction, number, data, baud)
        assert frame.number == number
        if self.bus.framing.word == 1:
            return frame.instruction, frame.data
        return frame.data[0], frame.data[1:]

    def put(self, number, name, value):
        """Error of a write."""
        register = self.registers[name]
        return self.status("write", number, self.words(register.address) + register.encode(value))[0]

    def get(self, number, name):
        """Value of a register; there must be no error."""
        register = self.registers[name]
        error, data = self.status("read", number, self.words(register.address, register.size))
        assert error == 0
        return register.decode(data)


def client(model, positions=(1000.0, 2000.0, 3000.0), numbers=None, **values):
    """A bus with servos 1, 2, … of a model, at 1 Mbit/s."""
    values = {"baud_rate": BAUD_CODES[model]} | values
    servos = [make_servo(servo_model(model), k, **values) for k in numbers or range(1, len(positions) + 1)]
    plant = KinematicPlant(positions, voltage=VOLTAGES[model])
    return Client(ServoBus(servos, plant), plant)


@pytest.fixture
def sts():
    return client("sts3215")


@pytest.fixture(params=["xl330-m288", "xl430-w250"])
def dynamixel(request):
    return client(request.param)


class Process:
    """`python -m armwright.twin.serial` on a path; `end` returns what it counted."""

    def __init__(self, path, *words):
        command = [sys.executable, "-m", "armwright.twin.serial", "--path", str(path), *words]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line == f"servos on {path}\n", line + self.process.communicate(timeout=60)[1]

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        out, error = self.process.communicate(timeout=60)
        assert (self.process.returncode, error) == (0, "")
        return json.loads(out)


@pytest.fixture
def serve(tmp_path):
    """A function that starts servos in a process of their own."""
    if sys.platform == "win32":
        pytest.skip("pseudo-terminals need Linux or macOS")
    with contextlib.ExitStack() as stack:

        def start(*words):
            found = Process(tmp_path / "port", *words)
            stack.callback(found.process.communicate)
            stack.callback(found.process.kill)
            return found

        yield start


def open_port(path, baud=BAUD):
    """Descriptor of a port, raw and at a baud rate that the system has a name for."""
    import termios
    import tty

    port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(port)
    attributes = termios.tcgetattr(port)
    attributes[4] = attributes[5] = getattr(termios, f"B{baud}")
    termios.tcsetattr(port, termios.TCSANOW, attributes)
    return port


@pytest.fixture
def hangs_up():
    """SIGHUP ends processes, as on a terminal, where tests run under nohup too."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)
