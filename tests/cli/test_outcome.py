"""Outcomes of commands: files that were asked for, notes, exit codes, and errors with the file of a scenario."""

from typing import Any

import pytest
import typer

from armwright.cli.arguments import numbers, refuse, words
from armwright.cli.outcome import PAGE, check_file, exit_unless, naming_file, say_notes, write
from armwright.errors import BusError, OutputError, ScenarioError


def test_a_file_that_was_not_asked_for_is_neither_checked_nor_written(capsys):
    check_file(None, PAGE)
    write(None, lambda path: pytest.fail("written"))
    assert capsys.readouterr().out == ""


def test_a_file_is_checked_before_and_named_behind_its_writing(tmp_path, capsys):
    page = tmp_path / "a.html"
    check_file(page, PAGE)
    write(page, lambda path: path.write_text("page"))
    assert page.read_text() == "page"
    assert capsys.readouterr().out == f"wrote {page}\n"
    with pytest.raises(OutputError):
        check_file(tmp_path / "a.png", PAGE)
    with pytest.raises(OutputError, match="is read"):
        check_file(page, PAGE, [page])


def test_notes_go_to_standard_error_and_a_bad_verdict_is_exit_code_1(capsys):
    say_notes(["one", "two"])
    assert capsys.readouterr() == ("", "armwright: note: one\narmwright: note: two\n")
    exit_unless(True)
    with pytest.raises(typer.Exit) as stop:
        exit_unless(False)
    assert stop.value.exit_code == 1


def test_an_error_of_a_run_names_the_scenario_file_and_its_keys():
    with pytest.raises(ScenarioError) as raised, naming_file("arm.scenario.toml"):
        raise ScenarioError("is wrong", place="duration")
    assert (raised.value.file, raised.value.place) == ("arm.scenario.toml", "duration_s")


def test_words_and_numbers_between_commas():
    assert words(" a, b,,c ") == ["a", "b", "c"]
    assert numbers("--nodes", None, "whole numbers") is None
    assert numbers("--nodes", "3,4", "whole numbers", kind=int) == [3, 4]
    cases: list[tuple[str, dict[str, Any]]] = [("3,x", {}), ("3.5", {"kind": int}), ("1,2", {"count": 3})]
    for text, more in cases:
        with pytest.raises(BusError) as raised:
            numbers("--nodes", text, "whole numbers", error=BusError, **more)
        assert (raised.value.place, raised.value.value) == ("--nodes", text)


def test_an_option_that_does_not_go_with_others_is_named():
    refuse({"run": None}, "does not go with it")
    with pytest.raises(ScenarioError) as raised:
        refuse({"run": None, "report": "a.html"}, "does not go with it", with_value=True)
    assert (raised.value.place, raised.value.value) == ("--report", "a.html")
