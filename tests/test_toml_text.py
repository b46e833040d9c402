"""TOML texts statement by statement, judged by the standard parser and by the texts themselves."""

from __future__ import annotations

import re
import tomllib
from importlib import resources
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from armwright.errors import DescriptionError, Problem
from armwright.toml_text import TomlText, _locations, _split

ROOT = Path(__file__).parents[1]
FILES = sorted(
    [
        *Path(str(resources.files("armwright.robots"))).glob("*.toml"),
        *ROOT.glob("examples/**/*.toml"),
        ROOT / "pyproject.toml",
    ]
)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_key_is_found_on_the_line_on_which_its_statement_begins(path):
    text = path.read_text(encoding="utf-8")
    lines, tables = text.split("\n"), tomllib.loads(text)
    found = dict(reversed(list(_locations(_split(text)[0]))))
    for location, line in found.items():
        at = tables
        for key in location:
            at = at[key]  # it is there
        name = next(key for key in reversed(location) if isinstance(key, str))
        statement = "\n".join(lines[line - 1 : line + 40])
        assert re.search(re.escape(name), statement), (location, line)
    assert {location[0] for location in found} == tables.keys()


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(FILES), st.data())
def test_a_broken_line_hides_no_other_statement(path, data):
    text = path.read_text(encoding="utf-8")
    lines = text.split("\n")
    starts = [line for line, statement, _ in _split(text)[0] if "[" not in statement.partition("=")[0]]
    at = data.draw(st.sampled_from(starts)) - 1
    lines.insert(at, "this is no TOML")
    broken = TomlText("\n".join(lines), path)
    assert broken.tables == tomllib.loads(text)
    assert [(problem.line, problem.file) for problem in broken.problems] == [(at + 1, f"{path}:{at + 1}")]


def test_what_is_there_twice_is_found_without_its_keys():
    text = TomlText("a = 1\n[b]\nc = 1\nc = 2\n[b]\nd = 1\n[e]\nf = [\n 1,\n 2]\na.b = { x = 1 }\n", "t.toml")
    assert text.tables == {"a": 1, "b": {"c": 1}, "e": {"f": [1, 2], "a": {"b": {"x": 1}}}}
    assert [problem.line for problem in text.problems] == [4, 5]
    place = text.with_line(Problem(place="e.a.b.x"))
    assert place.file == "t.toml:11"


def test_errors_of_other_files_stay_as_they_are():
    text = TomlText("a = 1\nb = 2\n", "t.toml")
    with pytest.raises(DescriptionError) as raised, text.checked(DescriptionError):
        raise DescriptionError.of(Problem("x", place="b.c", file="t.toml"), Problem("y", place="a", file="other.toml"))
    assert [problem.file for problem in raised.value.problems] == ["t.toml:2", "other.toml"]


def test_a_key_whose_line_is_broken_is_not_said_to_be_missing():
    text = TomlText("a = 1\nb = \n", "t.toml")
    with pytest.raises(DescriptionError) as raised, text.checked(DescriptionError):
        raise DescriptionError.of(Problem("missing", place="b"))
    assert [problem.line for problem in raised.value.problems] == [2]


def test_a_note_may_speak_of_a_joint():
    text = TomlText('notes = """\n[joint]\n"""\n', "t.toml")
    assert (text.tables, text.problems) == ({"notes": "[joint]\n"}, ())


@pytest.mark.parametrize(
    ("broken", "kept"), [("mass = 2,0", "no link"), ('name = "a', "missing"), ("[[joint", "missing")]
)
def test_what_follows_from_a_broken_line_is_left_out(broken, kept):
    text = TomlText(f"[[joint]]\nx = 1\n[[links]]\n{broken}\n", "t.toml")
    problems = [Problem("no link", place="joints[0] child"), Problem("missing", place="links[0] mass")]
    with pytest.raises(DescriptionError) as raised, text.checked(DescriptionError):
        raise DescriptionError.of(*problems)
    assert [each.what.partition(":")[0] for each in raised.value.problems] == [kept, "unknown key", "not TOML"]
