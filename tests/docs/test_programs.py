"""Pages whose code is one program: it runs, and prints what the page shows."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from docs.pages import ROOT, blocks, comparable, page, python

PROGRAMS = (
    "docs/extending.md",
    "docs/cartesian-motion.md",
    "docs/collision.md",
    "docs/how-to/inverse-kinematics.md",
    "docs/how-to/simulation.md",
    "docs/identify-linear.md",
    "docs/time-optimal.md",
)
HUNK = re.compile(r"^```diff\n(?P<text>.*?)^```", re.DOTALL | re.MULTILINE)
FILE = "--- a/"
LAW = """
import numpy as np
import armwright as aw
from armwright.actuators.friction import friction_torques

text = open("smooth.toml", encoding="utf-8").read()
open("tanh.toml", "w", encoding="utf-8").write(text.replace("[joints.friction]", "[joints.friction]\\nlaw = 'tanh'"))
smooth, tanh = aw.load("smooth.toml"), aw.load("tanh.toml")
qd, zero = np.linspace(-0.1, 0.1, smooth.n), np.zeros(smooth.n)
change = []
for body, v in zip(smooth.coordinates, qd):
    level, width = body.friction.coulomb_positive, body.friction.smoothing
    change.append(level * (np.tanh(v / width) - v / np.hypot(v, width)))
np.testing.assert_allclose(friction_torques(tanh, qd) - friction_torques(smooth, qd), change, atol=1e-12)
assert max(np.abs(change)) > 0.1
found = aw.compile(tanh).inverse_dynamics(zero, qd, zero)
np.testing.assert_allclose(found, aw.inverse_dynamics(tanh, zero, qd, zero), atol=1e-9)
run = aw.simulate(aw.Scenario(tanh, command=np.full(tanh.n, 0.5), solver=aw.Solver(step=1e-4), duration=0.05))
assert np.isfinite(run.q.values).all()
print(aw.__file__)
"""


@pytest.mark.parametrize("name", PROGRAMS)
def test_it_prints_what_the_page_shows(name: str, tmp_path: Path) -> None:
    found = blocks(name)
    program = "\n".join(text for kind, text in found if kind == "python")
    shown = "".join(text for kind, text in found if kind == "text")
    assert comparable(python(program, tmp_path).splitlines()) == comparable(shown.splitlines())


def test_extensions_are_compiled_in_the_loop() -> None:
    shown = "".join(text for kind, text in blocks("docs/extending.md") if kind == "text")
    assert shown.count("controller: compiled") == 3


def test_the_friction_law_takes_the_changes_that_are_shown(tmp_path: Path) -> None:
    """The page's changes, made in a copy of the package, in two files."""
    shutil.copytree(ROOT / "src" / "armwright", tmp_path / "armwright", ignore=shutil.ignore_patterns("__pycache__"))
    (text,) = HUNK.findall(page("docs/extending.md"))
    hunks = [hunk.splitlines() for hunk in text.split(FILE) if hunk]
    assert len({name for name, *_ in hunks}) <= 2
    for name, *lines in hunks:
        path = tmp_path / name.removeprefix("src/")
        before, after = ("".join(f"{line[1:]}\n" for line in lines if line[0] in kept) for kept in (" -", " +"))
        source = path.read_text(encoding="utf-8")
        assert before in source, f"{name}: not as the page shows it"
        path.write_text(source.replace(before, after), encoding="utf-8")
    record = (ROOT / "src" / "armwright" / "robots" / "lwa4p.toml").read_text(encoding="utf-8")
    (tmp_path / "smooth.toml").write_text(record, encoding="utf-8")
    apart = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", LAW]
    done = subprocess.run(command, cwd=tmp_path, env=apart, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(tmp_path))
