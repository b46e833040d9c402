"""A session that walks through every variable and command: as a script, and typed at a terminal."""

from __future__ import annotations

import os
import re
import subprocess
import time
from pathlib import Path

import pytest

from armwright.session.arguments import same
from armwright.session.commands import TABLE as COMMANDS
from armwright.session.variables import TABLE as VARIABLES
from session.terminal import SIM, WIDTH, Terminal, needs_pty
from session.walks import SCRIPT, TRANSCRIPT, same_text, write_files


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """The folder and what the script said; made once. TRANSCRIPT is this, looked over: `armwright sim --echo < walk.sim`."""
    folder = tmp_path_factory.mktemp("walk")
    write_files(folder)
    with SCRIPT.open() as script:
        done = subprocess.run(
            [*SIM, "--echo"], stdin=script, capture_output=True, encoding="utf-8", cwd=folder, check=False
        )
    assert (done.returncode, done.stderr) == (0, "")
    return folder, done.stdout


@pytest.mark.study
def test_the_transcript(walked):
    assert same_text(walked[1], TRANSCRIPT.read_text(encoding="utf-8")) is None


def test_every_variable_and_command_is_in_it():
    first = [re.split(r"[\s\[=]", line, maxsplit=1)[0] for line in SCRIPT.read_text().splitlines()]
    walked_through = {same(word) for word in first}
    assert {same(entry.name) for entry in (*VARIABLES, *COMMANDS)} <= walked_through


@pytest.mark.study
def test_the_record_replays_to_the_same_files(walked, tmp_path):
    folder, _ = walked
    write_files(tmp_path)
    done = subprocess.run([*SIM, "--script", str(folder / "day.sim")], capture_output=True, cwd=tmp_path, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    for name in ("rows.csv", "rows.txt", "run.nc"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_the_page_shows_what_is_said(tmp_path):
    """The session at the head of docs/how-to/session.md."""
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "session.md").read_text(encoding="utf-8")
    block = page.partition("$ armwright sim\n")[2].partition("```")[0].partition("sim> ")
    shown = block[1] + block[2]
    typed = "".join(line.removeprefix("sim> ") + "\n" for line in shown.splitlines() if line.startswith("sim> "))
    done = subprocess.run(
        [*SIM, "--echo"], input=typed, capture_output=True, encoding="utf-8", check=True, cwd=tmp_path
    )
    assert same_text(done.stdout.rstrip(), shown.rstrip()) is None


@pytest.fixture
def terminal(tmp_path):
    write_files(tmp_path)
    terminal = Terminal(tmp_path)
    terminal.wait(lambda: terminal.text.rstrip().endswith("sim>"))
    yield terminal
    terminal.close()


@pytest.mark.study
@needs_pty
def test_typed_at_a_terminal(terminal, walked):
    """The same lines typed say the same as the script; the tour, which pauses there, is in a test of its own."""
    lines = [
        line for line in SCRIPT.read_text().splitlines() if line.strip() and not line.startswith(("#", "tour", "help"))
    ]
    for line in lines[: lines.index("quit")]:
        terminal.enter(line + "\r\r\r" * (line == "print-simulation"))  # which asks for start, finish and step
    shown = {" ".join(line.split()) for line in terminal.text.splitlines()}
    typed = walked[1].partition("sim> tour")[0].splitlines()
    rows = [line for line in typed if re.match(r"\s*(joint\d|[\d.]+) +-?\d", line) and len(line) < WIDTH - 30]
    assert len(rows) > 100
    assert not [row for row in rows if " ".join(row.split()) not in shown][:3]


@needs_pty
def test_prompts_completion_and_help(terminal):
    assert "inverse-arm" in terminal.type("inv\t", until="inverse-arm")
    assert "Inverse Arm" in terminal.type("\r", until="joint6")
    assert "theta[joint3]" in terminal.type("theta[joint3\t", until="theta[joint3]").replace(" ", "")
    assert "Start [s]" not in terminal.type("\x15print-simulation\r", until="there is no simulation yet")
    assert "Name of" not in terminal.type("write-graphic-file\r", until="there is no simulation yet")
    terminal.type("simulate\r", until="Start a new simulation, or continue the last one?")
    assert "Name of" not in terminal.type("continue\r", until="there is no simulation to continue")
    terminal.type("simulate\r", until="Start a new simulation, or continue the last one?")
    terminal.type("new\r", until="Zero theta and omega first?")
    assert "expected yes or no" in terminal.type("perhaps\r", until="expected yes or no")
    terminal.type("yes\r", until="Name of the voltage schedule file")
    assert "For how many" not in terminal.type("none.csv\r", until="no such file")
    terminal.type("\r", until="For how many time steps?")
    terminal.type("10\r", until="10 steps of 1 ms, t = 0.01 s")
    terminal.type("print-simulation\r", until="Start [s]")
    terminal.type("0\r", until="Finish [s]")
    terminal.type("\r", until="Step [s]")
    terminal.type("5 ms\r", until="voltage [V]")
    assert "Kutta" in terminal.type("help simulate\r", until="example")
    assert "did you mean theta?" in terminal.type("thta = 1\r", until="theta?")
    terminal.type("tour\r", until="Enter goes on")
    terminal.enter("q")
    terminal.type("save-simulation\r", until="Name of the file")
    assert "nothing has changed" in terminal.type("\x03", until="nothing has changed")
    terminal.type("plot-simulation\r", until="Enter: on the screen")
    terminal.type("\r", until="Joint angles")


@pytest.mark.study
@needs_pty
def test_ctrl_c_keeps_what_was_done_and_names_it(terminal):
    terminal.type("simulate new every=1000 steps=400000000\r", until="simulating")
    time.sleep(1.0)
    said = terminal.type("\x03", until="partial: interrupted after")
    assert "these are kept" in said
    terminal.wait(lambda: terminal.text.rstrip().endswith("sim>"))
    terminal.type("print-simulation step=1\r", until="partial run, theta")
    assert "steps=" in terminal.type("history\r", until="steps=")


@needs_pty
def test_the_end_of_input_leaves_soon_after_a_quick_start(terminal):
    os.write(terminal.fd, b"\x04")
    _, status, used = os.wait4(terminal.process.pid, 0)
    terminal.process.returncode = os.waitstatus_to_exitcode(status)
    assert terminal.process.returncode == 0
    assert used.ru_utime + used.ru_stime < 2.0  # [s] of the processor; 0.7 where this was written
