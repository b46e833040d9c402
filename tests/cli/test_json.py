"""--json: one document a command, with the numbers that Python computes, to their last digit."""

import io
import json
import os
import subprocess
import sys

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.cli.json_output import document
from armwright.cli.tables import number, table
from armwright.terminal import console, say

NO_JSON = {"show", "plot", "animate", "sim"}  # these draw, or converse


def shown(*arguments, code=0):
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert result.exit_code == code, result.output
    return json.loads(result.stdout)


def commands(name, command):
    if not hasattr(command, "commands"):
        return [(name.strip(), command)]
    return [each for word, inner in command.commands.items() for each in commands(f"{name} {word}", inner)]


def test_every_command_that_prints_numbers_has_it():
    found = dict(commands("", typer.main.get_command(app)))
    having = {name for name, each in found.items() if any("--json" in parameter.opts for parameter in each.params)}
    assert set(found) - having == NO_JSON


def test_info_has_every_digit():
    tables = {each["title"]: each for each in shown("info", "puma560")["tables"]}
    links = {row["link"]: row for row in tables["Links: mass [kg], centre of mass [m] in the link's frame"]["rows"]}
    description = aw.load("puma560").description
    assert description is not None
    for link in description.links:
        assert links[link.name]["mass"] == (None if link.mass_kg is None else float(link.mass_kg))
    drives = next(each for title, each in tables.items() if title.startswith("Drives"))
    assert drives["units"]["Kt"] == "N m/A"
    assert [row["gear n"] for row in drives["rows"]] == [
        body.drive.gear_ratio for body in aw.load("puma560").coordinates
    ]


def test_a_simulation_ends_where_python_says(tmp_path):
    arguments = ("simulate", "two-link", "--torque=1,0", "--duration", "0.05", "--step", "1e-3")
    scenario = aw.Scenario(aw.load("two-link"), command=[1.0, 0.0], duration=0.05, solver=aw.Solver(step=1e-3))
    end = aw.simulate(scenario).isel(time=-1)
    for more in ((), ("-o", tmp_path / "run.nc")):
        (rows,) = shown(*arguments, *more)["tables"]
        assert [row["q"] for row in rows["rows"]] == end["q"].values.tolist()
        assert rows["units"]["tau"] == "N m"


def test_columns_and_results(tmp_path):
    motions = tmp_path / "in.csv"
    motions.write_text("0.1,-0.2,0.3,0.4,0.5,0.6\n0,0,0,0,0,0\n")
    (columns,) = shown("inverse-dynamics", "two-link", motions)["tables"]
    tau = aw.inverse_dynamics(aw.load("two-link"), [0.1, -0.2], [0.3, 0.4], [0.5, 0.6])
    row = columns["rows"][0]
    np.testing.assert_allclose([row["tau_shoulder"], row["tau_elbow"]], np.asarray(tau, dtype=float), rtol=1e-12)
    spread = shown("workspace", "two-link", "--samples", 2000)["results"]
    reach = next(each for each in spread if each["quantity"] == "reach")
    assert 0 < reach["percentiles"]["1.0"] < reach["percentiles"]["100.0"] <= 2.0 + 1e-9


def test_other_exit_codes_and_errors(tmp_path):
    poses = tmp_path / "poses.csv"
    poses.write_text("9,9,9\n")
    (found,) = shown("ik", "puma560", poses, code=1)["tables"]
    assert next(iter(found["rows"][0].values())) is None  # nan is null
    result = CliRunner().invoke(app, ["info", "pma560", "--json"])
    assert (result.exit_code, result.stdout) == (2, "")


@pytest.mark.parametrize(
    "words", ["robots", "servos", "servos mx-64", "examples list", "check two-link", "diff panda puma560"]
)
def test_a_command_without_numbers_is_one_document_too(words):
    made = shown(*words.split())
    assert made["command"] == words.removesuffix(" mx-64").removesuffix(" two-link").removesuffix(" panda puma560")
    assert made["tables"] or made["text"] or made["results"]


def test_numbers_words_and_repeated_rows():
    rows = [["1", number(1 / 3), "−2.5", "7"], ["", number(np.inf), "—", "a word"]]
    (made,) = document("x", [table("t", ("joint", "q [rad]", "qd [rad/s]", "n"), rows), None])["tables"]
    assert made["units"] == {"q": "rad", "qd": "rad/s"}
    assert made["rows"] == [
        {"joint": "1", "q": 1 / 3, "qd": -2.5, "n": 7}, {"joint": "1", "q": None, "qd": None, "n": "a word"}
    ]  # fmt: skip


def process(*arguments, **environment):
    words = (sys.executable, "-m", "armwright", *arguments)
    done = subprocess.run(words, capture_output=True, text=True, check=True, env={**os.environ, **environment})
    return done.stdout


def test_a_pipe_has_the_ascii_minus():
    text = process("info", "cmu-dd")
    assert "−" not in text
    assert "-9.80" in text


def test_a_terminal_has_the_minus_of_typographers(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdout", stream)
    say("q = −1")
    console(force_terminal=True).print("qd = −2")
    assert stream.getvalue() == "q = −1\nqd = −2\n"


@pytest.mark.sample(1)
@pytest.mark.parametrize(("words", "expected"), [("armwright info pu", "puma560"), ("armwright simu", "simulate")])
def test_shells_complete_commands_and_robots(words, expected):
    count = str(len(words.split()) - 1)
    text = process(_ARMWRIGHT_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=count)
    assert expected in text.split()
