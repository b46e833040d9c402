"""The live page as other programs see it: who may read and move it, what it sends, and what is left when it ends."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import OutputError, RunError, ShapeError
from foreground import FOREGROUND
from raises_at import raises_at

ARM = aw.load("two-link")
SHOW = (sys.executable, "-m", "armwright", "show", "two-link", "--live")
ADDRESS = re.compile(r"http://127\.0\.0\.1:(\d+)/[0-9a-f]{32}/")


@pytest.fixture
def live():
    with aw.show(ARM, live=True) as live:
        yield live


def asked(live, path="", method="GET", body=None, **headers):
    """Status and text of an answer; `path` is what stands behind the token, or a whole path."""
    address = urlsplit(live.url)
    connection = http.client.HTTPConnection(address.hostname, address.port, timeout=20)
    headers = {name.capitalize(): value for name, value in headers.items()}
    connection.request(method, path if path.startswith("/") else address.path + path, body, headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text


class Events:
    """The events that a page reads."""

    def __init__(self, live):
        address = urlsplit(live.url)
        self.connection = http.client.HTTPConnection(address.hostname, address.port, timeout=20)
        self.connection.request("GET", address.path + "events")
        self.answer = self.connection.getresponse()
        assert self.answer.headers["Content-Type"] == "text/event-stream"

    def next(self):
        """The next message; {} at the end."""
        while True:
            line = self.answer.readline()
            if not line or line.startswith(b"data: "):
                return json.loads(line[6:] or b"{}")


def reachable(port, host="127.0.0.1"):
    with socket.socket() as client:
        client.settimeout(5)
        return client.connect_ex((host, port)) == 0


def port_of(live):
    return urlsplit(live.url).port


def own_addresses():
    """This machine's addresses beside 127.0.0.1: all of 127.0.0.0/8 on Linux, and those of its network, if any."""
    found = {"127.0.0.2"} if sys.platform == "linux" else set()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        try:
            client.connect(("192.0.2.1", 9))  # sends nothing
            found.add(client.getsockname()[0])
        except OSError:
            pass
    return sorted(found - {"127.0.0.1"})


def test_only_this_machine_reaches_it(live):
    assert live._server.socket.getsockname()[0] == "127.0.0.1"
    assert reachable(port_of(live))
    for address in own_addresses():
        assert not reachable(port_of(live), address), address


def test_the_page_needs_the_token(live):
    status, text = asked(live)
    assert status == 200
    assert "<title>two-link</title>" in text
    token = urlsplit(live.url).path.strip("/")
    for path in ("/", f"/{token}", f"/{token[:-1]}/", f"/{token}x/events", "/events", "/../", "/%C3%A9/", "other"):
        assert asked(live, path)[0] == 404, path
    assert asked(live, "", "POST", "{}")[0] == 404
    with aw.show(ARM, live=True) as other:
        assert urlsplit(other.url).path != urlsplit(live.url).path


def test_other_origins_are_refused(live):
    """A page of another site, and a name that an attacker's DNS lets point at this machine."""
    own = f"127.0.0.1:{port_of(live)}"
    for host in (
        "evil.example",
        f"evil.example:{port_of(live)}",
        "127.0.0.1",
        f"127.0.0.1:{port_of(live) % 65535 + 1}",
        "",
    ):
        assert asked(live, host=host)[0] == 403, host
    for origin in ("http://evil.example", "null", f"https://{own}", f"http://localhost:{port_of(live)}", "file://"):
        for path, method in (("", "GET"), ("events", "GET"), ("q", "POST")):
            assert asked(live, path, method, '{"q": [1, 1]}', host=own, origin=origin)[0] == 403, origin
    assert live.q.tolist() == [0, 0]
    assert asked(live, host=own, origin=f"http://{own}")[0] == 200
    assert asked(live, host=f"localhost:{port_of(live)}")[0] == 200


def test_what_the_page_may_load_and_who_may_frame_it(live):
    address = urlsplit(live.url)
    connection = http.client.HTTPConnection(address.hostname, address.port, timeout=20)
    connection.request("GET", address.path)
    headers = connection.getresponse().headers
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "Access-Control-Allow-Origin" not in headers


def test_poses_go_to_the_page_and_come_from_it(live):
    events = Events(live)
    assert events.next() == {"page": 1, "q": [0, 0]}
    live.q = [0.1, -0.2]
    assert events.next() == {"page": 1, "q": [0.1, -0.2]}
    assert asked(live, "q", "POST", json.dumps({"q": [0.25, 0.5], "from": "a"})) == (200, "")
    assert live.q.tolist() == [0.25, 0.5]
    assert events.next() == {"page": 1, "q": [0.25, 0.5], "from": "a"}
    live.q[0] = 9.0  # a copy
    assert live.q.tolist() == [0.25, 0.5]
    late = Events(live)
    assert late.next()["q"] == [0.25, 0.5]


@pytest.mark.sample(6)
@pytest.mark.parametrize(
    "body",
    [
        "", "{}", "[]", "3", "{", '{"q": [1]}', '{"q": [1, NaN]}', '{"q": [1, 1e999]}', '{"q": ["a", 1]}', '{"q": null}',
        f'{{"q": [1, 1{"0" * 400}]}}', '{"q": {"0": 1}}', '{"q": [1, [2]]}', "[" * 50_000, '{"q": [1, 2' + " " * 200_000 + "]}",
    ],
)  # fmt: skip
def test_what_is_no_pose_is_refused(live, body):
    assert asked(live, "q", "POST", body)[0] == 400
    assert live.q.tolist() == [0, 0]


def test_a_length_that_is_no_length_is_refused(live):
    for length in ("-1", "1e3", "9" * 30):
        with socket.create_connection(("127.0.0.1", port_of(live)), timeout=20) as client:
            head = f"POST {urlsplit(live.url).path}q HTTP/1.0\r\nHost: 127.0.0.1:{port_of(live)}\r\n"
            client.sendall(f"{head}Content-Length: {length}\r\n\r\n".encode())
            assert client.recv(100).startswith(b"HTTP/1.0 400")


def test_a_run_is_sent_as_it_moves(live):
    run = aw.simulate(aw.Scenario(ARM, 0.5, [0.0, 0.0], start=aw.Start([0.3, 0.2])))
    events = Events(live)
    events.next()
    live.play(run)
    sent = events.next()
    t, q = np.array(sent["t"]), np.array(sent["q"])
    assert (t[0], t[-1]) == (0.0, 0.5)
    assert (np.diff(t) > 0.0).all()
    assert 0.5 * 60 <= len(t) <= 0.5 * 60 + 2
    for k in range(2):
        exact = np.interp(t, run["time"], run["q"][:, k])
        np.testing.assert_allclose(q[:, k], exact, atol=1e-6)
    np.testing.assert_array_equal(live.q, run["q"][-1])
    with pytest.raises(RunError, match="two-link"):
        live.play(aw.simulate(aw.Scenario(aw.load("cmu-dd"), 0.01, [0.0] * 6)))
    with pytest.raises(RunError):
        live.play(run.assign(q=run["q"] * np.nan))
    one_row = run.isel(time=[0])
    live.play(one_row)
    assert events.next()["t"] == [0.0]


def test_another_arm_is_another_page(live):
    events = Events(live)
    events.next()
    live.show(aw.load("panda"), [0.1] * 7)
    assert events.next() == {"page": 2, "q": [0.1] * 7}
    assert "<title>panda</title>" in asked(live)[1]
    live.show(live.arm)
    assert events.next() == {"page": 2, "q": [0] * 7}
    assert asked(live, "q", "POST", '{"q": [1, 1]}')[0] == 400  # of the arm before


def test_it_ends_and_leaves_nothing():
    threads = threading.active_count()
    live = aw.show(ARM, live=True)
    events = Events(live)
    events.next()
    idle = socket.create_connection(("127.0.0.1", port_of(live)))  # as browsers open them ahead
    port = port_of(live)
    live.close()
    live.close()
    assert events.next() == {}
    assert not reachable(port)
    idle.close()
    end = time.monotonic() + 20
    while threading.active_count() > threads and time.monotonic() < end:
        time.sleep(0.05)
    assert threading.active_count() == threads
    assert "closed" in repr(live)
    live.wait()  # returns
    with aw.show(ARM, live=True, port=port) as again:  # the port is free
        assert port_of(again) == port


def test_browsers_that_go_are_passed_over(live, capfd):
    events = Events(live)
    events.next()
    events.connection.close()
    events.answer.close()
    for k in range(20):
        live.q = [k, k]
        time.sleep(0.01)
    assert asked(live)[0] == 200
    assert capfd.readouterr().err == ""


def test_what_is_no_request_is_passed_over(live, capfd):
    """Requests with some bytes changed, or cut: no pose that nobody sent, and not a word on the terminal."""
    random = np.random.default_rng(18)
    address = urlsplit(live.url)
    head = f"POST {address.path}q HTTP/1.1\r\nHost: 127.0.0.1:{address.port}\r\nContent-Length: 11\r\n\r\n"
    for _ in range(200):
        request = np.frombuffer(f'{head}{{"q":[1,2]}}'.encode(), dtype=np.uint8).copy()
        request[random.integers(len(request), size=3)] = random.integers(256, size=3)
        with socket.create_connection(("127.0.0.1", address.port), timeout=20) as client:
            client.sendall(request[: random.integers(20, len(request))].tobytes())
            client.shutdown(socket.SHUT_WR)
            assert not client.recv(100).startswith(b"HTTP/1.0 200")
    assert live.q.tolist() == [0, 0]
    assert capfd.readouterr().err == ""


def test_refused(tmp_path, live):
    for wrong in ([0.0], [0.0, np.nan], "ab"):
        with raises_at(ShapeError, "q", "2 finite numbers"):
            live.q = wrong
        with raises_at(ShapeError, "q", "2 finite numbers"):
            aw.show(ARM, q=wrong, live=True)
    for port in (-1, 65536, 1.5, True, "80"):
        with pytest.raises(OutputError, match=r"0 to 65535"):
            aw.show(ARM, live=True, port=port)  # type: ignore[arg-type]
    with pytest.raises(OutputError, match="in use") as refused:
        aw.show(ARM, live=True, port=port_of(live))
    assert (refused.value.place, refused.value.value) == ("port", port_of(live))
    with pytest.raises(OutputError, match="no file"):
        aw.show(ARM, tmp_path / "arm.html", live=True)  # type: ignore[call-overload]
    with pytest.raises(OutputError, match="no file"):
        aw.show(ARM, live=True, size=300)  # type: ignore[call-overload]
    with pytest.raises(OutputError, match="or live"):
        aw.show(ARM)  # type: ignore[call-overload]
    with raises_at(OutputError, "port", value=8000):
        aw.show(ARM, tmp_path / "arm.html", port=8000)  # type: ignore[call-overload]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "--output: missing"),
        (["--live", "-o", "arm.html"], "--output = 'arm.html': does not go with --live"),
        (["--live", "--size", "300"], "--size = 300: does not go with --live"),
        (["-o", "arm.html", "--port", "8000"], "--port = 8000: only --live has it"),
        (["-o", "arm.html", "--open"], "--open"),
        (["--live", "--port", "70000"], "--port = 70000: expected 0 to 65535"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(options, words):
    done = CliRunner().invoke(app, ["show", "two-link", *options])
    assert done.exit_code == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_port_in_use_is_one_line(live):
    done = CliRunner().invoke(app, ["show", "two-link", "--live", "--port", str(port_of(live))])
    assert done.exit_code == 2
    assert f"--port = {port_of(live)}: " in done.stderr
    assert "in use" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_ctrl_c_ends_it_and_leaves_no_process_and_no_port():
    process = subprocess.Popen(
        [*FOREGROUND, *SHOW, "--open"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "BROWSER": "false", "DISPLAY": "", "PYTHONUNBUFFERED": ""},
    )  # fmt: skip
    assert process.stdout is not None
    address = ADDRESS.search(process.stdout.readline())
    assert address is not None
    assert process.stdout.readline() == "The address is for this machine alone; Ctrl-C ends it.\n"
    port = int(address[1])
    assert reachable(port)
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", urlsplit(address[0]).path + "events")
    assert connection.getresponse().readline().startswith(b"data: ")  # a page is open
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (0, "")
    assert "Traceback" not in err
    assert not reachable(port)
    assert ends(process.pid)


def ends(group, seconds=20.0):
    """True once no process of the group is left."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False
