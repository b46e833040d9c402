"""`watch`: the page follows theta, plays simulations, and changes with the arm."""

from __future__ import annotations

import json
import re
import urllib.request
import webbrowser

import numpy as np
import pytest

from armwright.session import Session
from armwright.session.watch import NO_BROWSER
from session.terminal import Terminal, needs_pty
from session.walks import refused

ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/[0-9a-f]{32}/")


@pytest.fixture
def session():
    session = Session("two-link")
    session.run("watch")
    yield session
    session.stop_watching()


def sent(session):
    """The message that a page gets which is opened now."""
    with urllib.request.urlopen(session.live.url + "events", timeout=20) as events:
        return json.loads(events.readline().removeprefix(b"data: "))


def test_it_says_where_the_page_is(session):
    texts = [session.run(line)[0].text for line in ("watch", "watch on", "watch open=no")]
    assert texts == [f"two-link is at {session.live.url}"] * 3
    assert ADDRESS.fullmatch(session.live.url)
    assert not [line for line in session.state.lines if "watch" in line]  # it is no part of the record
    assert session.undo_stack == []


def test_every_change_of_theta_is_seen(session):
    session.run("theta = 30 deg")
    assert sent(session)["q"] == pytest.approx([np.pi / 6] * 2)
    session.run("theta[elbow] = 0.25")
    session.run("python theta = theta + 1")
    assert sent(session)["q"] == pytest.approx([np.pi / 6 + 1, 1.25])
    session.run("undo")
    assert sent(session)["q"] == pytest.approx([np.pi / 6, 0.25])
    session.live.update([9.0, 9.0])  # as the page's sliders do
    session.run("omega = 1")
    assert sent(session)["q"] == pytest.approx([np.pi / 6, 0.25])


def test_a_simulation_is_played_and_only_its_new_part(session):
    session.run("theta = 0.3 0.2")
    session.run("simulate new steps=100")
    played = sent(session)
    assert (played["t"][0], played["t"][-1], played["q"][0]) == (0.0, pytest.approx(0.1), [0.3, 0.2])
    assert played["q"][-1] == pytest.approx(session.state.q, abs=1e-6)
    middle = session.state.q
    session.run("simulate continue steps=50")
    played = sent(session)
    assert played["t"][-1] - played["t"][0] == pytest.approx(0.05)
    assert played["q"][0] == pytest.approx(middle, abs=1e-6)
    assert session.live.q.tolist() == session.state.q.tolist()
    session.run("undo")
    assert sent(session)["q"] == pytest.approx(middle)


def test_a_line_that_fails_moves_nothing(session):
    session.run("theta = 0.3 0.2")
    before = session.live._message
    refused(session, "theta = 1 2 3")
    session.run("torque = 1e200")
    refused(session, "simulate new steps=200")
    assert session.live._message == before


@pytest.mark.study
def test_another_arm_is_another_page(session):
    session.run("database-read cmu-dd")
    assert sent(session) == {"page": 2, "q": [0.0] * 6}
    page = urllib.request.urlopen(session.live.url, timeout=20).read().decode()
    assert "<title>cmu-dd</title>" in page
    session.run("undo")
    assert sent(session) == {"page": 3, "q": [0.0] * 2}
    session.run("gravity = 1")  # which turns the picture: it stands upright
    assert sent(session)["page"] == 4


def test_off_closes_it(session):
    url = session.live.url
    assert session.run("watch off")[0].text == "the page is closed"
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url, timeout=20)
    assert session.run("watch off")[0].text == "no page is open"
    session.run("theta = 1")
    session.run("simulate new steps=10")


@pytest.mark.parametrize("found", [True, False])
def test_it_opens_the_browser_where_asked(session, monkeypatch, found):
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or found)
    shown = [line.text for line in session.run("watch open=yes")]
    assert opened == [session.live.url]
    assert (NO_BROWSER in shown) is not found


def test_refused(session):
    assert "expected on or off" in str(refused(session, "watch perhaps"))
    assert "does not go with the rest" in str(refused(session, "watch off open=yes"))


@pytest.mark.study
@needs_pty
def test_the_page_goes_with_the_session(tmp_path):
    terminal = Terminal(tmp_path)
    terminal.wait(lambda: terminal.text.rstrip().endswith("sim>"))
    address = ADDRESS.search(terminal.enter("watch").replace("\n", ""))
    assert address is not None
    terminal.enter("theta = 0.5")
    with urllib.request.urlopen(address[0] + "events", timeout=20) as events:
        assert b"[0.5,0.5" in events.readline()
        terminal.send("\x04")
        terminal.wait(lambda: terminal.gone)
        assert events.read().strip() in (b"", b":")
    assert terminal.close() == 0
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address[0], timeout=20)
