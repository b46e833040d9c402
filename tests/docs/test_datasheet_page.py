"""The page from datasheets to C runs as it says."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from docs.pages import blocks, comparable, page, sessions, shell, write_files

PAGE = "docs/datasheet-to-c.md"


@pytest.mark.study
def test_the_page_runs_as_it_says(tmp_path: Path) -> None:
    write_files(PAGE, tmp_path)
    shown = [session for kind, text in blocks(PAGE) if kind == "console" for session in sessions(text)]
    assert len(shown) == 3
    for command, lines in shown:
        done = shell(command, tmp_path)
        assert done.returncode == 0, done.stderr
        for line in comparable(lines):
            assert line in comparable(done.stdout.splitlines()), (
                f"{command}: {line!r} is shown, but it prints {done.stdout}"
            )
    run = aw.load_run(tmp_path / "run.nc")
    np.testing.assert_allclose(run.q.values[-1], [0.8, 0.6, -0.5], atol=0.01)
    header = (tmp_path / "firmware" / "arm3.h").read_text(encoding="utf-8")
    for name in re.findall(r"^arm3_(\w+)\(", page(PAGE), re.MULTILINE):
        assert f"arm3_{name}(" in header
    if shutil.which("gcc") is None or sys.platform == "darwin":
        pytest.skip("the self-test needs gcc")
    (compile_and_test,) = (text for kind, text in blocks(PAGE) if kind == "sh")
    done = shell(compile_and_test, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_conversions_are_right() -> None:
    """The speed constant beside the torque constant, and the file beside the table."""
    (shown,) = re.findall(r"60 ÷ \(2π · ([\d.]+)\) = ([\d.]+)", page(PAGE))
    assert 60 / (2 * np.pi * float(shown[0])) == pytest.approx(float(shown[1]), abs=5e-4)
    assert "rotor_inertia_kg_m2 = 1.21e-4" in page(PAGE)
    assert pytest.approx(1.21e-4) == 1210 * 1e-7
