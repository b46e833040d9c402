"""One vocabulary: old names work and say the new ones; each option has one meaning in all commands."""

import re
from math import pi
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from armwright.cli.app import app
from armwright.cli.arguments import angle
from armwright.cli.old_names import OLD, UNTIL
from armwright.errors import ScenarioError
from cli.commands import COMMANDS, ROOT
from raises_at import raises_at

Error = typer.BadParameter.__mro__[1]  # UsageError, which typer keeps to itself


def options(command):
    return {name: each for each in command.params if each.param_type_name == "option" for name in each.opts}


def read(*words):
    """Values that a command is called with, by parameter."""
    context = None
    command, name, rest = ROOT, "armwright", list(words)
    while True:
        context = command.make_context(name, rest, parent=context)
        if not hasattr(command, "commands"):
            return {key: value for key, value in context.params.items() if value not in (None, [], (), False)}
        name, command, rest = command.resolve_command(context, [*context._protected_args, *context.args])


def test_every_old_name_is_of_a_command_and_gone_from_it():
    for path, names in OLD.items():
        known = options(COMMANDS[path])
        for old, entry in names.items():
            new = entry[0] if isinstance(entry, tuple) else entry
            assert new in known or new == "ROBOT", (path, new)
            assert new == old or old not in known, (path, old)
            assert new == old or new not in names, (path, new)  # no chains


PAGE = Path(__file__).parents[2] / "docs/reference/options.md"
ROW = re.compile(
    r"^\| (?P<names>`--[^|]+?) \| (?P<value>(?:\\\||[^|])*) \| (?P<meaning>(?:\\\||[^|])+) \|$", re.MULTILINE
)
WITH_DEVIATION = "[,STD]"  # of a value that may have one


def vocabulary():
    """Rows of the page by the option's long name: names, value, words that all its help texts have."""
    found = {}
    for row in ROW.finditer(PAGE.read_text(encoding="utf-8")):
        names = [name.strip(" `") for name in row["names"].split(",")]
        words = [each.lower() for each in re.findall(r"\*\*(.+?)\*\*", row["meaning"])]
        value = row["value"].strip("` ").replace("\\|", "|")
        assert names[0] not in found, names[0]
        found[names[0]] = (set(names), value, words)
    return found


def kind(option):
    """Of a value: none, a file or another; numbers of the same option may be whole in one command."""
    if option.is_flag:
        return "flag"
    return "file" if "Path" in str(option.type_descriptor.annotation) else "value"


def test_each_option_has_one_meaning_in_all_commands():
    """Its row says its names, its value, and the words that stand in each of its help texts."""
    table, kinds, seen = vocabulary(), {}, {}
    for path, command in COMMANDS.items():
        for option in (each for each in command.params if each.param_type_name == "option"):
            name = max(option.opts, key=len)
            assert name in table, f"{path} {name}: add it to {PAGE.name}, or take the name that there is"
            names, value, words = table[name]
            assert set(option.opts) <= names, (path, option.opts)
            if name != "--output":  # whose value says what is written
                assert (option.metavar or "").removesuffix(WITH_DEVIATION) == value.removesuffix(WITH_DEVIATION), (
                    path,
                    name,
                )
            help_text = option.help.replace("\\[", "[").lower()
            assert all(word in help_text for word in words), (path, name, words)
            assert kinds.setdefault(name, kind(option)) == kind(option), (path, name)
            seen.setdefault(name, []).append(path)
    assert set(table) == set(seen), set(table) - set(seen)
    shared = [name for name, paths in seen.items() if len(paths) > 1 and name != "--output"]
    # without words nothing would hold their meaning together
    assert [name for name in shared if not table[name][2]] == []
    assert len(shared) > 50


def test_a_robot_or_a_scenario_comes_first_and_no_value_is_in_degrees():
    named = ("ROBOT", "SCENARIO", "ROBOT|SCENARIO", "SCENARIO…", "ROBOT|RUN", "A")
    for path, command in COMMANDS.items():
        places = [each.metavar for each in command.params if each.param_type_name == "argument"]
        assert all(place not in named for place in places[1:]) or path == "diff", (path, places)
        assert "OUT" not in places, path
        values = [each.metavar or "" for each in command.params]
        assert not any("DEG" in value for value in values), path
        assert all("--output" in each.opts for each in command.params if "-o" in each.opts), path
        robot = options(command).get("--robot")
        assert robot is None or places[0] == "ROBOT|SCENARIO", path  # in place of the scenario's own


CASES = [(path, old) for path, names in sorted(OLD.items()) for old in names if old.startswith("-")]


@pytest.mark.parametrize(("path", "old"), CASES, ids=" ".join)
def test_an_old_name_means_what_the_new_one_means(path, old, capsys):
    """Beside the words that the command demands, of which the robot comes first."""
    command, entry = COMMANDS[path], OLD[path][old]
    new, change = entry if isinstance(entry, tuple) else (entry, None)
    words = [word for each in command.params for word in demanded(each, new)]
    if new == "ROBOT":
        before, after = [*words, old, "4"], ["4", *words]
    elif options(command)[new].is_flag:
        before, after = [*words, old], [*words, new]
    else:
        value = {None: "4", "1/x": "0.25", "deg": "4deg"}[change]
        before, after = [*words, f"{old}=4"], [*words, new, value]
    got = read(*path.split(), *before)
    said = capsys.readouterr().err
    assert said.startswith(f"armwright: note: {old}")
    assert f" is now {new}" in said
    assert UNTIL in said
    assert said.count("\n") == 1
    assert got == read(*path.split(), *after)
    assert capsys.readouterr().err == ""


def demanded(parameter, new):
    """Words for a parameter that must be there, unless they are those of the new name."""
    if not parameter.required or new in parameter.opts:
        return []
    if parameter.param_type_name == "argument":
        return [] if new == parameter.metavar == "ROBOT" else ["file"]
    return [f"{parameter.opts[0]}=1"]


def test_a_file_that_was_the_last_argument(tmp_path):
    files = [tmp_path / name for name in ("old.toml", "new.toml")]
    old, new = ["convert", "panda", str(files[0])], ["convert", "panda", "-o", str(files[1])]
    results = [CliRunner().invoke(app, words) for words in (old, new)]
    assert [each.exit_code for each in results] == [0, 0]
    assert (
        results[0].stderr
        == f"armwright: note: the last argument is now --output; version {UNTIL} refuses the old name\n"
    )
    assert results[1].stderr == ""
    assert files[0].read_bytes() == files[1].read_bytes()


def test_old_names_leave_other_words_alone(capsys):
    assert read("plan", "--", "--rate") == {"file": Path("--rate"), "record_period": 0.002}
    assert read("convert", "OUT", "-o", "new.toml")["source"] == "OUT"
    assert read("plan", "a", "--record-period", "4")["record_period"] == 4.0
    assert read("loops", "a", "--phase-margin", "45deg")["phase_margin"] == "45deg"
    assert capsys.readouterr().err == ""
    with pytest.raises(Error, match="--record-period"):
        read("plan", "a", "--rate")


def test_margins_are_angles_with_their_unit():
    assert angle("--phase-margin", "45deg") == pytest.approx(pi / 4)
    assert angle("--phase-margin", "pi/6") == pytest.approx(pi / 6)
    with raises_at(ScenarioError, "--phase-margin", r"finite number \[rad\]", value="wide"):
        angle("--phase-margin", "wide")


def test_robot_may_be_left_out_where_a_file_names_it():
    assert read("identify", "arm", "a.log.toml")["file"] == Path("a.log.toml")
    assert read("identify", "arm", "lwa4p", "a.log.toml")["robots"] == ["lwa4p"]
    found = CliRunner().invoke(app, ["identify", "arm", "lwa4p", "puma560", "a.log.toml"])
    assert (
        found.stderr == "armwright: error: arguments = 'lwa4p puma560': one robot, then the file; expected ROBOT once\n"
    )


@pytest.mark.parametrize(("word", "meant"), [
    ("version", "--version"), ("help", "--help"), ("desing", "design"), ("compare", "compare-controllers"),
    ("rnea", "inverse-dynamics"), ("ikine", "ik"), ("inverse-kinematics", "ik"), ("teach", "show"),
])  # fmt: skip
def test_a_command_that_is_none_suggests_what_is_meant(word, meant):
    found = CliRunner().invoke(app, [word])
    assert found.exit_code == 2
    assert found.stderr.startswith(f"armwright: error: No such command {word!r}. Did you mean {meant!r}?")
    assert found.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("word", "here"),
    [
        ("fkine", "forward_kinematics"),
        ("linearize", "loops.state_space"),
        ("mass-matrix", "mass_matrix"),
        ("crba", "mass_matrix"),
    ],
)
def test_a_function_that_no_command_has_is_named(word, here):
    found = CliRunner().invoke(app, [word])
    assert found.exit_code == 2
    assert f"aw.{here} " in found.stderr


IN_BRACKETS = re.compile(r"\[[^\[\]\n]+\]")


@pytest.mark.parametrize("path", COMMANDS)
def test_brackets_of_help_survive(path):
    """Units such as [s] are no markup of the terminal: each bracket of the sources stands in what is shown."""
    command = COMMANDS[path]
    shown = " ".join(CliRunner().invoke(app, [*path.split(), "--help"], env={"COLUMNS": "2000"}).stdout.split())
    texts = [command.help, *(f"{each.help} {each.metavar}".replace("\\[", "[") for each in command.params)]
    wanted = [" ".join(found.split()) for text in texts for found in IN_BRACKETS.findall(text or "")]
    assert [each for each in wanted if each not in shown] == []


def test_units_of_values_are_spelt_in_one_way():
    values = {each.metavar or "" for command in COMMANDS.values() for each in command.params}
    assert "RAD_PER_S" in values
    assert not [value for value in values if re.search(r"(RAD|M)/S\b", value)]
