"""What the page on modules shows is what happens."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.pages import blocks, comparable, python, sessions, shell, write_files


def test_the_page_runs_as_it_says(tmp_path: Path) -> None:
    """Commands and Python of the page, in its order, in one folder."""
    write_files("docs/modules.md", tmp_path)
    shown = blocks("docs/modules.md")
    assert sum(kind == "console" for kind, _ in shown) >= 4
    for k, (kind, text) in enumerate(shown):
        if kind == "python":
            assert comparable(python(text, tmp_path).splitlines()) == comparable(shown[k + 1][1].splitlines())
        for command, lines in sessions(text) if kind == "console" else ():
            done = shell(command, tmp_path)
            assert done.returncode == (2 if any("error:" in line for line in lines) else 0), done.stderr
            happened = comparable((done.stdout + done.stderr).splitlines())
            for line in comparable(lines):
                assert line in happened, f"{command}: {line!r} is shown, but what it prints is {happened}"


def test_every_key_of_the_module_files_has_a_meaning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs" / "ext"))
    import armwright_record  # pyright: ignore[reportMissingImports]

    for _, _, records in armwright_record.MODULE_TABLES:
        for record in records:
            for name, field in record.model_fields.items():
                assert armwright_record.meaning(name, field), f"{record.__name__}.{name} says nothing of itself"
