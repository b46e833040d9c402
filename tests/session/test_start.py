"""What a session needs before its prompt stands: little, so that it stands at once."""

from __future__ import annotations

import sys

from session.terminal import Terminal, needs_pty

HEAVY = ("llvmlite", "scipy", "xarray", "pandas", "h5netcdf", "trimesh", "matplotlib", "tomlkit", "IPython", "jedi")
LATER = ("kernels", "program", "dynamics", "kinematics", "control", "pictures", "scenarios", "export", "modules")
LATER_FILES = ("simulation.scenario", "simulation.simulation", "simulation.plant", "results.plot")
AT_THE_PROMPT = """
import sys
from pathlib import Path
import prompt_toolkit

def prompt(self, message):
    Path("modules.txt").write_text("\\n".join([message, *sys.modules]))
    raise EOFError

prompt_toolkit.PromptSession.prompt = prompt
sys.argv = ["armwright", "sim"]
from armwright.cli.app import app
app()
"""


@needs_pty
def test_what_a_prompt_does_not_wait_for(tmp_path):
    """Compilers, arrays with names, pictures: all that only commands need. The time itself is in `make bench`."""
    terminal = Terminal(tmp_path, (sys.executable, "-c", AT_THE_PROMPT))
    file = tmp_path / "modules.txt"
    terminal.wait(lambda: terminal.gone)
    terminal.close()
    asked, *modules = file.read_text().splitlines()
    assert asked == "sim> "
    assert {"prompt_toolkit", "armwright.session.terminal"} <= set(modules)
    unwanted = {*HEAVY, *(f"armwright.{room}" for room in (*LATER, *LATER_FILES))}
    parents = {".".join(name.split(".")[:k]) for name in modules for k in (1, 2, 3)}
    assert not unwanted & parents


@needs_pty
def test_the_arrow_brings_back_lines_of_earlier_sessions(tmp_path, monkeypatch):
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", str(tmp_path / "cache"))
    line = "theta[2] = 0.25"
    terminal = begun(tmp_path)
    terminal.enter(line)
    ended(terminal)
    terminal = begun(tmp_path)
    for _ in range(100):  # the file is read while the reader looks; a further arrow goes nowhere
        terminal.send("\x1b[A")
        if line in terminal.soon():
            break
    terminal.enter("")
    assert "0.25 rad" in terminal.enter("theta[2]")
    ended(terminal)


@needs_pty
def test_lines_that_cannot_be_kept_end_no_session(tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", str(cache))
    (cache / "sim.history").mkdir(parents=True)
    terminal = begun(tmp_path)
    terminal.enter("theta[2] = 0.25")
    assert "0.25 rad" in terminal.enter("theta[2]")
    assert "Error" not in terminal.text
    ended(terminal)


def begun(folder):
    terminal = Terminal(folder)
    terminal.wait(lambda: terminal.text.rstrip().endswith("sim>"))
    return terminal


def ended(terminal):
    terminal.send("\x04")
    terminal.wait(lambda: terminal.gone)
    terminal.close()
