"""Log files that cannot be believed: each mistake is one line with file, key, value and what was expected."""

from __future__ import annotations

import re

import pytest

import armwright as aw
from armwright.errors import LogError
from identification.logs.example_logs import ALL, written
from raises_at import raises_at

MISTAKES = {  # replaced → by; what the error says
    "an unknown key": ('title = "Two joints"', 'titel = "x"', r"titel = 'x': unknown key; did you mean title"),
    "an unknown quantity": ('quantity = "speed"', 'quantity = "velocity"', r"signals\[1\].quantity = 'velocity'"),
    "a unit of another quantity": ('unit = "rad/s"', 'unit = "rad"', r"signals\[1\].unit = 'rad': no unit of a speed"),
    "no unit at all": ('unit = "rad/s"', 'unit = "furlong"', r"signals\[1\].unit = 'furlong'"),
    "no side": ('unit = "rad/s"\nside = "joint"', 'unit = "rad/s"', r"signals\[1\].side: missing; expected"),
    "motor side without gears": (
        'unit = "rad/s"\nside = "joint"', 'unit = "rad/s"\nside = "motor"', r"signals\[1\].side = 'motor': gears are not known",
    ),
    "an unknown column": ('"v1"', '"w1"', r"column = 'w1': no such column; did you mean"),
    "a column's number too high": ('["v1", "v2"]', "[4, 9]", r"column = 9: expected 1 to 7"),
    "one column too few": ('["v1", "v2"]', '["v1"]', r"signals\[1\].columns: 1 columns; expected 2"),
    "an unknown joint": ('unit = "rad/s"', 'unit = "rad/s"\njoints = ["shoulder", "wrist"]', r"'wrist': no joint of the log"),
    "a sign that is none": ('unit = "rad/s"', 'unit = "rad/s"\nsigns = [1, 2]', r"signs = \[1.0, 2.0\]: expected 1 or -1"),
    "counts without counts": ('unit = "rad"', 'unit = "counts"', r"counts_per_turn: needed with unit counts"),
    "per cent of nothing": ('unit = "N m"', 'unit = "%"', r"rated: needed with unit %"),
    "two clocks in one": ('unit = "s"', 'unit = "s"\nrate_hz = 100', r"time: expected either column"),
    "a unit of time": ('unit = "s"', 'unit = "h"', r"time.unit = 'h'"),
    "no unit of time": ('column = "t"\nunit = "s"', 'column = "t"', r"time.unit: missing"),
    "gears that cannot be inverted": ("[time]", "gears = 1\n[time]", r"gears"),
    "singular gears": ('[time]', '[gears]\nratios = [0, 50]\n[time]', r"gears.ratios: cannot be inverted"),
    "too few gears": ('[time]', '[gears]\nratios = [50]\n[time]', r"gears.ratios: 1 motors; expected 2"),
    "a file that is not there": ('path = "arm.csv"', 'path = "leg.csv"', r"leg.csv: no such file"),
    "an ending that is not offered": ('path = "arm.csv"', 'path = "arm.xls"', r"'.xls' is not offered"),
    "a file key that is not there": ('quantity = "speed"', 'quantity = "speed"\nfile = "leg"', r"'leg': no such file"),
    "a quantity twice": ('quantity = "speed"', 'quantity = "position"', r"unit = 'rad/s': no unit of a position"),
    "another robot": ("joints =", 'robot = "cmu-dd"\njoints =', r"joints = 'shoulder': no joint of the robot"),
    "no robot": ('joints = ["shoulder", "elbow"]', "", r"joints: missing"),
    "no TOML": ("[time]", "[time", r"not TOML"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_explained(tmp_path, name):
    old, new, said = MISTAKES[name]
    assert old in ALL
    path = written(tmp_path, ALL.replace(old, new, 1))
    with pytest.raises(LogError) as error:
        aw.identification.read_log(path)
    line = str(error.value)
    assert re.search(said, line), line
    assert ".log.toml" in line or "leg.csv" in line or "arm." in line
    assert "\n" not in line or name == "another robot"  # two joints that it does not have


def test_a_unit_in_the_header_is_that_of_the_signal(tmp_path):
    path, table = written(tmp_path, ALL), tmp_path / "arm.csv"
    text = table.read_text("utf-8")
    table.write_text(text.replace("q1", "q1 [rad]", 1), "utf-8")
    assert aw.identification.read_log(path).joints == ("shoulder", "elbow")
    table.write_text(text.replace("q1", "q1 [deg]", 1), "utf-8")
    with raises_at(LogError, "signals[0].unit"):
        aw.identification.read_log(path)


def test_several_mistakes_are_all_reported(tmp_path):
    text = ALL.replace('unit = "rad/s"', 'unit = "miles"').replace('title = "Two joints"', 'titel = "x"')
    with pytest.raises(LogError, match=r"2 mistakes") as error:
        aw.identification.read_log(written(tmp_path, text))
    assert {problem.place for problem in error.value.problems} == {"titel", "signals[1].unit"}


def test_units_of_time_and_signals_that_are_missing_are_reported_together_with_their_lines(tmp_path):
    text = ALL.replace('unit = "s"\n', "").replace('unit = "rad/s"\n', "")
    path = written(tmp_path, text)
    with pytest.raises(LogError) as error:
        aw.identification.read_log(path)
    problems = error.value.problems
    assert [problem.place for problem in problems] == ["time.unit", "signals[1].unit"]
    lines = text.splitlines()
    assert [problem.line for problem in problems] == [1 + lines.index("[time]"), lines.index('quantity = "speed"')]


@pytest.mark.parametrize(("old", "new"), [("[time]", "[[time]]"), ("[[signals]]", "[signals]")])
def test_tables_for_lists_and_lists_for_tables_are_refused_with_their_lines(tmp_path, old, new):
    text = "[[signals]]".join(ALL.split("[[signals]]")[:2])  # with one table of signals
    with pytest.raises(LogError) as error:
        aw.identification.read_log(written(tmp_path, text.replace(old, new, 1)))
    assert all(problem.line <= text.count("\n") + 1 for problem in error.value.problems)


def test_coupled_motors_must_all_be_logged(tmp_path):
    gears = "[gears]\nmatrix = [[50, 0], [20, 50]]\n[time]"
    text = ALL.replace("[time]", gears).replace(
        'columns = ["m1", "m2"]\nunit = "N m"\nside = "joint"',
        'columns = ["m1"]\njoints = ["shoulder"]\nunit = "N m"\nside = "motor"',
    )
    with raises_at(LogError, "signals[2].columns", "'shoulder'.*'elbow'"):
        aw.identification.read_log(written(tmp_path, text))


@pytest.mark.parametrize("path", [None, 3, "nowhere.log.toml"])
def test_no_log(path):
    with pytest.raises(LogError):
        aw.identification.read_log(path)
