"""`armwright parts build`: the page's example as it says, bad input in one line, nothing half-written."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app

PAGE = (Path(__file__).parents[2] / "docs" / "parts.md").read_text(encoding="utf-8")
FILE = re.search(r"parts\.toml`\*\*\n\n```toml\n(.*?)```", PAGE, re.S)
SHOWN = re.search(r"```console\n(.*?)```", PAGE, re.S)
assert FILE is not None
assert SHOWN is not None
EXAMPLE, CONSOLE = FILE[1], SHOWN[1]


def run(*arguments, code=0):
    """The result of a command that should end with that exit code."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result


def test_the_page_s_example_does_what_it_shows(tmp_path, monkeypatch):
    """Copied as it stands; the arm that comes out loads and moves."""
    monkeypatch.chdir(tmp_path)
    Path("small-arm.parts.toml").write_text(EXAMPLE, encoding="utf-8")
    command, *lines = CONSOLE.strip().splitlines()
    result = run(*command.removeprefix("$ armwright ").split())
    assert [*result.stderr.splitlines(), *result.stdout.splitlines()] == lines
    arm = aw.load("small-arm.toml")
    assert arm.provenance("arm.mass_kg").text.startswith("sum of 7 sections in 2 parts of small-arm.parts.toml")
    assert run("info", "small-arm.toml").exit_code == 0
    assert Path("audit.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_a_second_folder_still_knows_its_parts(tmp_path):
    """The arm's file names the parts relative to itself."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "a.parts.toml").write_text(EXAMPLE, encoding="utf-8")
    run("parts", "build", tmp_path / "parts" / "a.parts.toml", "-o", tmp_path / "a.toml")
    assert 'file = "parts/a.parts.toml"' in (tmp_path / "a.toml").read_text()
    (tmp_path / "parts" / "a.parts.toml").write_text(EXAMPLE + "\n", encoding="utf-8")
    (warning,) = aw.load(tmp_path / "a.toml").warnings
    assert "older than parts/a.parts.toml" in warning


def test_help_teaches_by_example():
    assert "armwright parts build my-arm.parts.toml" in run("parts", "build", "--help").stdout
    assert "build" in run("parts", "--help").stdout


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("aluminium-6061", "unobtainium", "a.parts.toml: link 'arm' part '100-01' material = 'unobtainium': no key"),
        ("radius_m = 0.012", "radius_m = 0.2", "a.parts.toml: link 'arm' part '100-01': a mass of"),
        ("[0.0, 0.02]]", "[0.025, 0.0], [0.05, 0.02]]", "section 'body' solid.outline_m: edge"),
        ("count = 5", "count = 5.5", "section 'lightening holes' count = 5.5: expected"),
        ("[[links.parts.sections]]", "[[links.parts.section]]", "unknown key; did you mean sections?"),
        ("title = ", "titel = ", "titel = 'One joint, two parts': unknown key; did you mean title or tip?"),
        ('child = "arm"', 'child = "leg"', "joint 'shoulder' child = 'leg': no link"),
        ("[[joints]]", "[[joints", "not TOML"),
    ],
)
def test_bad_parts(old, new, message, tmp_path):
    path = tmp_path / "a.parts.toml"
    path.write_text(EXAMPLE.replace(old, new, 1), encoding="utf-8")
    result = run("parts", "build", path, "-o", tmp_path / "a.toml", "--audit", tmp_path / "a.html", code=2)
    assert result.stdout == ""
    assert result.stderr.startswith("armwright: error: ")
    assert message in re.sub(r"toml:\d+: ", "toml: ", result.stderr)
    first, *mistakes = result.stderr.splitlines()
    assert not mistakes or f": {len(mistakes)} mistakes" in first
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_no_such_parts(tmp_path):
    assert "no such file" in run("parts", "build", tmp_path / "a.parts.toml", "-o", tmp_path / "a.toml", code=2).stderr
