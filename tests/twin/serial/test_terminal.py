"""The pseudo-terminal: raw bytes of a client in this process, servos in this one or in their own."""

import json
import os
import random
import select
import signal
import subprocess
import sys
import threading
import time

import pytest

from armwright.errors import BusError
from armwright.twin.serial.frames import FEETECH, Parser
from armwright.twin.serial.terminal import Counts, Terminal, serve as answer
from armwright.twin.serial.timing import CycleEnd, LockStep, RealTime
from raises_at import raises_at
from twin.serial.conftest import client, open_port

if sys.platform == "win32":
    pytest.skip("pseudo-terminals need Linux or macOS", allow_module_level=True)

PING = FEETECH.pack(1, 1)
ANSWER = FEETECH.status(1, 0)
LONG = 20.0  # [s] for machines that do other work
PATIENT = ("--patience", str(LONG))
HALF = """
import os, sys, time
port = os.open(sys.argv[1], os.O_RDWR)
os.write(port, bytes((255, 255, 1)))
print(1, flush=True)
time.sleep(60)
"""  # a client that dies in the middle of a frame
SERVOS = ("--servo", "sts3215:1-6", *PATIENT)


def received(port, count, seconds=LONG):
    """Up to `count` bytes, as they come."""
    data, until = b"", time.monotonic() + seconds
    while len(data) < count and (left := until - time.monotonic()) > 0:
        if select.select([port], [], [], left)[0]:
            data += os.read(port, count - len(data))
    return data


@pytest.fixture
def port(request, serve, tmp_path):
    """A client's descriptor to six servos in real time."""
    serve(*SERVOS, *getattr(request, "param", ()))
    found = open_port(tmp_path / "port")
    yield found
    os.close(found)


def test_ten_thousand_frames_through_the_terminal(serve, tmp_path):
    """Damaged ones among them: no exception, no hang; all pings in between are answered."""
    process, rng, pings = serve(*SERVOS, "--period", "0.02"), random.Random(3), 0
    port = open_port(tmp_path / "port")
    for _ in range(10_000 // 20):
        batch = b""
        for _ in range(19):
            number, code = rng.choice(((9, 2), (9, 3), (9, 4), (254, 0x55)))  # nobody, or nothing that is known
            frame = bytearray(FEETECH.pack(number, code, rng.randbytes(rng.randrange(6))))
            if rng.random() < 0.2:
                frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
            batch += frame
        os.write(port, batch)
        time.sleep(0.0 if rng.random() < 0.98 else 0.05)
        os.write(port, bytes(260) + PING)  # what a damaged frame claims to contain ends before the ping
        assert received(port, 6) == ANSWER
        pings += 1
    os.close(port)
    counts = process.end()
    assert counts["replies"] >= pings == 500
    assert counts["late"] == 0


def test_a_frame_that_was_cut_off_is_given_up(port):
    os.write(port, FEETECH.pack(1, 3, bytes(100))[:20])
    time.sleep(0.3)
    os.write(port, PING)
    assert received(port, 6) == ANSWER


def test_clients_come_and_go(serve, tmp_path):
    """Ports that are closed in the middle of a frame, opened twice, or not read: the next client is served."""
    process = serve(*SERVOS)
    for k in range(20):
        port = open_port(tmp_path / "port")
        if k % 4 == 1:
            other = open_port(tmp_path / "port")
            os.close(other)
        os.write(port, PING)
        assert received(port, 6) == ANSWER
        if k % 4 == 2:
            os.write(port, PING[:3])
            time.sleep(0.1)
        if k % 4 == 3:
            os.write(port, PING)
            time.sleep(0.1)  # the answer stays unread
        os.close(port)
        if k % 4 == 3:
            import termios

            port = open_port(tmp_path / "port")
            termios.tcflush(port, termios.TCIFLUSH)  # as the makers' software does
            os.close(port)
    assert process.end()["late"] == 0


def test_nothing_waits_for_a_client_that_does_not_read(serve, tmp_path):
    process = serve(*SERVOS)
    port = open_port(tmp_path / "port")
    ask, sent = FEETECH.pack(1, 2, bytes((0, 80))) * 40, 0
    until = time.monotonic() + LONG
    while sent < 2000 and time.monotonic() < until:
        try:
            os.write(port, ask)
            sent += 40
        except BlockingIOError:
            time.sleep(0.01)
    os.close(port)
    time.sleep(0.2)
    port = open_port(tmp_path / "port")
    import termios

    found, until = b"", time.monotonic() + LONG
    while found != ANSWER and time.monotonic() < until:  # answers to what was asked before come first
        termios.tcflush(port, termios.TCIFLUSH)
        os.write(port, PING)
        found = received(port, 7, 0.2)
    assert found == ANSWER
    os.close(port)
    assert sent >= 2000
    assert process.end()["late"] == 0


def test_bytes_without_room_are_counted():
    with Terminal() as terminal:
        for _ in range(1000):
            terminal.write(bytes(1000))
        assert 0 < terminal.unsent < 1_000_000


@pytest.mark.parametrize("baud", [9600, 57600, 115200, 500_000])
def test_nothing_is_answered_at_another_baud_rate(port, tmp_path, baud):
    other = open_port(tmp_path / "port", baud)
    os.write(other, PING)
    assert received(other, 1, 0.2) == b""
    os.close(other)
    again = open_port(tmp_path / "port")
    os.write(again, PING)
    assert received(again, 6) == ANSWER
    os.close(again)


@pytest.mark.skipif(sys.platform != "linux", reason="speeds without a name: Linux")
def test_baud_rates_without_a_name(tmp_path):
    serial = pytest.importorskip("serial", reason="speeds without a name are set by pyserial")
    with Terminal(tmp_path / "port") as terminal:
        for baud in (76_800, 128_000, 250_000, 1_000_000, 4_500_000):
            serial.Serial(str(tmp_path / "port"), baud).close()
            assert terminal.baud == baud


@pytest.mark.parametrize("port", [("--servo", "sts3215:1")], indirect=True)
def test_two_servos_with_one_id(port):
    os.write(port, PING)
    found = received(port, 6, 0.3)
    assert found not in (b"", ANSWER)
    assert Parser(FEETECH).feed(found) == []
    os.write(port, FEETECH.pack(2, 1))
    assert received(port, 6) == FEETECH.status(2, 0)


def test_the_link(tmp_path):
    path = tmp_path / "port"
    with Terminal(path) as first:
        assert os.readlink(path) == first.device
    assert not os.path.lexists(path)
    path.symlink_to("/dev/pts/99999")  # left by a process that was killed
    with Terminal(path) as terminal, Terminal(path) as second:  # taken over
        assert os.readlink(path) == second.device != terminal.device
    path.write_text("mine")
    with raises_at(BusError, "serial", "else", value=str(path)):
        Terminal(path)
    assert path.read_text() == "mine"
    with raises_at(BusError, "serial", "no link", value=str(tmp_path / "none" / "port")):
        Terminal(tmp_path / "none" / "port")


def test_a_port_outlives_a_client_that_is_killed(serve, tmp_path):
    serve(*SERVOS)
    command = [sys.executable, "-c", HALF, str(tmp_path / "port")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        child.kill()
    time.sleep(0.3)
    port = open_port(tmp_path / "port")
    os.write(port, PING)
    assert received(port, 6) == ANSWER
    os.close(port)


class Served:
    """A terminal served by a thread of this process."""

    def __init__(self, timing, bus, patience):
        self.terminal, self.ended = Terminal(), threading.Event()
        self.error, self.counts = None, Counts()
        self.thread = threading.Thread(target=self.run, args=(timing, bus, patience), daemon=True)
        self.thread.start()

    def run(self, timing, bus, patience):
        try:
            self.counts = answer(self.terminal, bus, timing, self.ended.is_set, patience)
        except BusError as error:
            self.error = error

    def end(self):
        self.ended.set()
        self.thread.join(LONG)
        self.terminal.close()


@pytest.mark.parametrize("lock_step", [True, False])
def test_a_reply_that_is_late_is_dropped(lock_step, monkeypatch):
    """In lock-step that is the end."""
    line = client("sts3215")
    timing = LockStep(line.bus, 0.02, CycleEnd("sync-write")) if lock_step else RealTime(line.bus)
    slow, reply = [True], timing.reply

    def slowly(frame, baud):
        if slow[0]:
            time.sleep(1.6)
        return reply(frame, baud)

    monkeypatch.setattr(timing, "reply", slowly)
    served = Served(timing, line.bus, 1.5)
    try:
        port = open_port(served.terminal.device)
        os.write(port, PING)
        assert received(port, 6, 2.0) == b""
        slow[0] = False
        os.write(port, PING)
        assert received(port, 6, 1.0 if lock_step else LONG) == (b"" if lock_step else ANSWER)
        os.close(port)
    finally:
        served.end()
    if lock_step:
        assert "lock-step ends" in str(served.error)
    else:
        assert (served.counts.late, served.counts.replies, served.error) == (1, 1, None)


def test_lock_step_is_the_same_whatever_the_pauses(serve, tmp_path):
    """Goals with their times, from processes whose clients make other pauses."""
    schedules = []
    for seed in (1, 2):
        file = tmp_path / f"{seed}.csv"
        process = serve(*SERVOS, "--period", "0.02", "--tick", "sync-write:42", "--schedule", str(file))
        port, rng, read = open_port(tmp_path / "port"), random.Random(seed), b""
        for k in range(50):
            os.write(port, FEETECH.pack(254, 0x82, bytes((56, 2, 1, 2))))
            read = received(port, 16)
            goals = b"".join(bytes((n,)) + (2048 + 9 * k).to_bytes(2, "little") for n in (1, 2))
            os.write(port, FEETECH.pack(254, 0x83, b"\x2a\x02" + goals))
            time.sleep(rng.choice((0.0, 0.0, 0.01, 0.03)))
        os.close(port)
        counts = process.end()
        assert (counts["instructions"], counts["replies"], counts["late"]) == (100, 50, 0)
        schedules.append((file.read_text(encoding="utf-8"), read))
    assert schedules[0] == schedules[1]
    assert len(schedules[0][0].splitlines()) == 51


def test_words_that_are_wrong(tmp_path, capsys):
    from armwright.twin.serial.__main__ import main

    for words, message in (
        (("--servo", "sts3215"), "--servo = 'sts3215': expected MODEL:IDS"),
        (("--servo", "sts:1"), "servo = 'sts'"),
        (("--servo", "sts3215:1", "--set", "id=x"), "--set = 'id=x'"),
        (("--servo", "sts3215:300"), "sts3215 id = 300: expected 0 to 253"),
        (("--servo", "sts3215:1", "--period", "0.02", "--tick", "jump"), "tick = 'jump'"),
    ):
        assert main([*words, "--path", str(tmp_path / "port")]) == 1
        assert message in capsys.readouterr().err


def test_a_reply_that_no_client_has_room_for_is_not_counted_as_sent():
    line = client("sts3215")
    asked = [PING] * 3

    class Full:
        baud, unsent = 1_000_000, 0

        def read(self, seconds):
            return asked.pop()

        def write(self, data):
            self.unsent += 4 if not asked else 0  # of the last one

    found = answer(Full(), line.bus, LockStep(line.bus, 0.02, CycleEnd("sync-write")), lambda: not asked, LONG)
    assert (found.instructions, found.replies, found.unread) == (3, 2, 1)


@pytest.mark.usefixtures("hangs_up")
def test_the_end_of_its_terminal_ends_a_process_of_servos(serve, tmp_path):
    made = serve("--servo", "sts3215:1").process
    made.send_signal(signal.SIGHUP)
    assert json.loads(made.communicate(timeout=LONG)[0])["instructions"] == 0
    assert not (tmp_path / "port").is_symlink()
