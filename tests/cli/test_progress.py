"""The bar: silent without a terminal, silent for quick work, there for the rest."""

import os
import sys

import pytest

from armwright.progress import PATIENCE, _NotebookBar, automatic, progress, rate


def test_silent_without_a_terminal(capfd):
    with progress("working") as tell:
        tell(1, 2)
    assert capfd.readouterr() == ("", "")


@pytest.mark.sample(1)
@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
@pytest.mark.parametrize(("seconds", "seen"), [(0.0, False), (1.4 * PATIENCE, True)])
def test_on_a_terminal(seconds, seen):
    script = (
        "import time\nfrom armwright.progress import progress\n"
        f"with progress('working', 'steps') as tell:\n    tell(1, 2)\n    time.sleep({seconds})"
    )
    assert (b"working" in on_terminal(script)) == seen


@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
@pytest.mark.parametrize(("argument", "seen"), [("", True), ("progress=False", False)])
def test_a_simulation_in_python_shows_one_bar_where_a_person_sees_it(argument, seen):
    script = (
        "import armwright as aw, armwright.progress\narmwright.progress.PATIENCE = 0.0\n"
        "scenario = aw.Scenario(aw.load('two-link'), command=[0.1, 0.0], duration=200.0, solver=aw.Solver(step=1e-3),"
        " recording=aw.Recording(1000))\n"
        f"aw.simulate(scenario, {argument})"
    )
    shown = on_terminal(script)
    assert (b"simulating two-link" in shown) == seen
    assert b"compiling" not in shown  # inside of another bar none is opened


def test_a_notebook_shows_the_time_left(monkeypatch):
    bar = _NotebookBar("working", "steps")
    bar.at, bar.began = (1, 4), 0.0
    monkeypatch.setattr("armwright.progress.perf_counter", lambda: 30.0)
    assert bar._page() == '<div>working <progress value="1" max="4"></progress> 0:01:30 left 0.0333 steps/s</div>'
    bar.at = (0, 4)
    assert "left" not in bar._page()


def on_terminal(script):
    """Text that a script writes to standard error on a terminal."""
    import pty
    import subprocess

    leader, follower = pty.openpty()
    environment = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "CI")} | {"TERM": "xterm"}
    subprocess.run([sys.executable, "-c", script], stderr=follower, env=environment, check=True)
    os.set_blocking(leader, False)
    try:
        shown = os.read(leader, 100000)
    except BlockingIOError:
        shown = b""
    os.close(leader)
    os.close(follower)
    return shown


@pytest.mark.parametrize(
    ("speed", "said"), [(None, ""), (12.3456, "12.3 steps/s"), (2.4e6, "2.4 M steps/s"), (7e9, "7 G steps/s")]
)
def test_rates(speed, said):
    assert rate(speed, "steps") == said


def test_other_threads_and_pipes_see_nothing(capfd):
    for shown in (None, True, False):
        with automatic(shown, "working") as tell:
            tell(1, 2)
    calls = []
    with automatic(lambda *at: calls.append(at), "working") as tell:
        assert tell
        tell(1, 2)
    assert calls == [(1, 2)]
    assert capfd.readouterr() == ("", "")
