"""--quiet and --traceback: options of the whole program, which may stand anywhere."""

import json

import pytest
from typer.testing import CliRunner

from armwright.cli.app import app
from armwright.cli.spelling import global_first
from armwright.progress import _target
from armwright.terminal import is_quiet

NOTED = ("simulate", "two-link", "--command", "0", "--duration", "0.01", "--start", "40,0")  # radians?


def run(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.stdout, result.stderr


def test_the_same_result_without_notes():
    code, shown, notes = run(*NOTED)
    assert (code, notes.count("armwright: note: ")) == (0, 1)
    for words in (("--quiet", *NOTED), (*NOTED, "--quiet"), (NOTED[0], "--quiet", *NOTED[1:])):
        quiet = run(*words)
        assert quiet[0] == 0
        assert quiet[2] == ""
        assert quiet[1].splitlines()[1:] == shown.splitlines()[1:]  # the first says how long it took
    assert not is_quiet()  # it ended with the command


def test_with_a_file_to_write_nothing_else_is_shown(tmp_path):
    assert run(*NOTED, "-o", tmp_path / "run.nc", "--quiet") == (0, "", "")
    assert (tmp_path / "run.nc").exists()
    code, shown, notes = run(*NOTED, "-o", tmp_path / "run.nc", "--json", "--quiet")
    assert (code, notes, json.loads(shown)["command"]) == (0, "", "simulate")


def test_errors_are_shown():
    assert run("info", "pma560", "--quiet") == run("info", "pma560")
    assert run("info", "pma560")[0] == 2


def test_no_bar(monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr("armwright.progress.is_quiet", lambda: True)
    assert _target() is None


def test_an_error_with_its_traceback():
    code, shown, error = run("info", "pma560", "--traceback")
    assert (code, shown) == (2, "")
    assert error.startswith("Traceback (most recent call last):")
    assert "in read_description" in error
    assert error.splitlines()[-1] == run("info", "pma560")[2].rstrip()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["a", "--quiet", "b"], ["--quiet", "a", "b"]),
        (["a", "--", "--quiet"], ["a", "--", "--quiet"]),
        (["--traceback", "a", "--quiet"], ["--traceback", "--quiet", "a"]),
    ],
)
def test_they_stand_anywhere_before_two_dashes(words, expected):
    assert global_first(words) == expected
