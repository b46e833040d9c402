"""The page on springs: its program prints what it shows, and its cylinder is the example's."""

from __future__ import annotations

import re
import tomllib

import pytest

from docs.pages import ROOT, blocks, page, sessions, shell


@pytest.mark.study
def test_the_program_prints_what_the_page_shows(tmp_path):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    ((command, lines),) = [
        session for kind, text in blocks("docs/springs.md") if kind == "console" for session in sessions(text)
    ]
    assert shell(f"{command} {tmp_path / 'out'}", tmp_path).stdout.splitlines() == lines


def test_the_tables_are_those_of_a_robot_file():
    tables = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", page("docs/springs.md"), re.DOTALL)]
    (shown,) = tables[-1]["cylinders"]
    (cylinder,) = tomllib.loads((ROOT / "examples" / "heavy.toml").read_text(encoding="utf-8"))["cylinders"]
    assert shown == {key: value["value"] if isinstance(value, dict) else value for key, value in cylinder.items()}
