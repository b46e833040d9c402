"""The afternoon's page runs as it says, from the bare URDF to the verdict, on the measured log of the Staubli TX40."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import armwright as aw
from docs.pages import blocks, python, sessions, shell, write_files
from identification.real_logs import LOGS

PAGE = "docs/identify-in-an-afternoon.md"


def test_the_files_that_it_shows_come_with_the_log(tmp_path: Path) -> None:
    write_files(PAGE, tmp_path)
    shown = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    assert set(shown) == {"tx40.urdf", "tx40.log.toml", "limits.toml"}
    for name, text in shown.items():
        assert (LOGS / "tx40" / name).read_text(encoding="utf-8") == text


@pytest.mark.study
def test_the_page_runs_as_it_says(tmp_path: Path) -> None:
    """Python and commands in the page's order, in one folder; each line that is shown is printed."""
    pytest.importorskip("pyarrow", reason="the extra `logs` is not installed")
    shutil.copy(LOGS / "tx40" / "tx40.parquet", tmp_path)
    write_files(PAGE, tmp_path)
    commands = 0
    for kind, text in blocks(PAGE):
        if kind == "python":
            python(text, tmp_path)
        for command, lines in sessions(text) if kind == "console" else ():
            done = shell(command, tmp_path)
            fails = any("fails its limits" in line for line in lines)
            assert done.returncode == int(fails), done.stdout + done.stderr
            printed = [" ".join(line.split()) for line in done.stdout.splitlines()]
            for line in lines:
                assert " ".join(line.split()) in printed, f"{command}: {line!r} is shown, and not printed"
            commands += 1
    assert commands == 4
    verdict = aw.identification.stored_verdict(tmp_path / "tx40.toml")
    assert verdict is not None
    assert verdict.passed
    shown = {
        row.split()[0]: float(row.split()[2])
        for kind, text in blocks(PAGE)
        if kind == "text"
        for row in text.splitlines()[1:]
    }
    for joint, r2 in shown.items():
        assert verdict.table.measures[joint]["torque"]["r2"] == pytest.approx(r2, abs=0.005)
        fit = aw.load(tmp_path / "tx40.toml").record.fits["fit"]  # what identify said of the same run
        assert fit.measures[f"torque of {joint} (held out)"]["r2"] == verdict.table.measures[joint]["torque"]["r2"]
