"""The afternoon's page runs as it says, from the bare URDF to the verdict, on the measured log of the Staubli TX40."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import armwright as aw
from docs.pages import blocks, python, sessions, shell, write_files
from identification.real_logs import DATA

PAGE = "docs/identify-in-an-afternoon.md"


@pytest.mark.study
def test_the_page_runs_as_it_says(tmp_path: Path) -> None:
    """Python and commands in the page's order, in one folder; each line that is shown is printed."""
    folder = DATA / "staubli_tx40"
    if not folder.is_dir():
        pytest.skip(f"the measurements are not here: {folder}")
    for name in ("pos_read_data.csv", "curr_data.csv"):
        shutil.copy(folder / name, tmp_path)
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
