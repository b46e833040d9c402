"""Schedules: what is read, what is refused and in which words."""

import numpy as np
import pytest

from armwright.errors import ABSENT, ScheduleError
from armwright.simulation.inputs.schedule import Schedule, read_schedule
from raises_at import raises_at

NAMES = ("waist", "elbow")


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "volts.csv"
    path.write_bytes(text.encode(encoding) if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "t,waist,elbow\n0,1,2\n0.5,3,-4e0\n",
        "t,elbow,waist\n0,2,1\n0.5,-4,3\n",
        "0,1,2\n0.5,3,-4\n",
        " t , waist , elbow \n 0 , 1 , 2 \n\n 0.5 , 3 , -4 \n\n\n",
        "t [s],waist [V],elbow [V]\r\n0,1,2\r\n0.5,3,-4",
        '"t","elbow [V]","waist"\n0,2,1\n"0.5",-4,3\n',
        "\ufefft,waist,elbow\n0,1,2\n0.5,3,-4\n",
        "\ufeff0,1,2\n0.5,3,-4\n",
    ],
)
def test_reads(tmp_path, text):
    schedule = read_schedule(written(tmp_path, text), NAMES, units=("V", "V"))
    assert schedule.names == NAMES
    np.testing.assert_array_equal(schedule.times, [0, 0.5])
    np.testing.assert_array_equal(schedule.commands, [[1, 2], [3, -4]])


COLUMNS = "3 columns: t, waist, elbow"
ROWS = f"at least one row of {COLUMNS}"
FINITE = "a finite number"
REFUSED = [  # text, line, place, value, expected
    ("", "", "", ABSENT, ROWS),
    ("\n\n", "", "", ABSENT, ROWS),
    ("t,waist,elbow\n", "", "", ABSENT, ROWS),
    ("t,waist\n0,1\n", ":1", "column 'elbow'", ABSENT, COLUMNS),
    ("0,1\n", ":1", "", ABSENT, COLUMNS),
    ("t,waist,elbow\n0,1,2\n1,2\n", ":3", "", ABSENT, COLUMNS),
    ("t,waist,elbow\n0,1,2,3\n", ":2", "", ABSENT, COLUMNS),
    ("0,1,2,\n", ":1", "", ABSENT, COLUMNS),
    ("t,waist,elbwo\n0,1,2\n", ":1", "column", "elbwo", ""),
    ("t,waist,elbow,wrist\n0,1,2,3\n", ":1", "column", "wrist", ""),
    ("t,waist,waist\n0,1,2\n", ":1", "column 'waist'", ABSENT, ""),
    ("t,waist,\n0,1,2\n", ":1", "", ABSENT, COLUMNS),
    ("t,waist [mV],elbow\n0,1,2\n", ":1", "unit of column 'waist'", "mV", "V"),
    ("t [ms],waist,elbow\n0,1,2\n", ":1", "unit of column 't'", "ms", "s"),
    ("t;waist;elbow\n0;1;2\n", ":1", "", ABSENT, COLUMNS),
    ("0;1;2\n", ":1", "", ABSENT, COLUMNS),
    ("0\t1\t2\n", ":1", "", ABSENT, COLUMNS),
    ("t,waist,elbow\n0,1,nan\n", ":2", "column 'elbow'", "nan", FINITE),
    ("t,waist,elbow\n0,1,2\n1,-inf,2\n", ":3", "column 'waist'", "-inf", FINITE),
    ("t,waist,elbow\n0,1,2\n1,fast,2\n", ":3", "column 'waist'", "fast", FINITE),
    ("t,waist,elbow\n0,1,2\n1,,2\n", ":3", "column 'waist'", "", FINITE),
    ("0,1,2\n1,x,2\n", ":2", "column 'waist'", "x", FINITE),
    ("t,waist,elbow\n0,1_000,2\n", ":2", "column 'waist'", "1_000", FINITE),
    ("t,waist,elbow\n0,1e999,2\n", ":2", "column 'waist'", "1e999", FINITE),
    ('t,waist,elbow\n0,"1,2\n', ":2", "", ABSENT, ""),
]


@pytest.mark.parametrize(("text", "line", "place", "value", "expected"), REFUSED)
def test_refuses(tmp_path, text, line, place, value, expected):
    path = written(tmp_path, text)
    with pytest.raises(ScheduleError) as error:
        read_schedule(path, NAMES, units=("V", "V"))
    problem = error.value
    assert (problem.file, problem.place, problem.value, problem.expected) == (f"{path}{line}", place, value, expected)
    assert problem.what or expected
    assert "\n" not in str(problem)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,waist,elbwo\n0,1,2\n", "did you mean elbow?"),
        ("t,waist,elbow,wrist\n0,1,2,3\n", "did you mean waist?"),
        ("t,waist,waist\n0,1,2\n", "given twice"),
        ("t;waist;elbow\n0;1;2\n", "cells are separated by semicolons, not by commas"),
        ("0\t1\t2\n", "cells are separated by tabs, not by commas"),
        (
            "t,waist,elbow\n0,1,2\n1,2,3\n0.5,2,3\n",
            ":4: column 't' = 0.5: earlier than 1 before it; expected times to increase",
        ),
        ("t,waist,elbow\n0,1,2\n1,2,3\n1,2,3\n", ":4: column 't' = 1.0: repeats the time before it"),
        ("t,waist,elbow\n0.1,1,2\n", ":2: column 't' = 0.1: expected the first time to be 0"),
        ("t,waist,elbow\n\n-1,1,2\n", ":3: column 't' = -1.0: expected the first time to be 0"),
        ('t,waist,elbow\n0,"1,2\n', "not CSV"),
    ],
)
def test_says_why(tmp_path, text, message):
    with pytest.raises(ScheduleError) as error:
        read_schedule(written(tmp_path, text), NAMES, units=("V", "V"))
    assert message in str(error.value)


def test_refuses_what_is_no_file(tmp_path):
    with raises_at(ScheduleError, file=tmp_path / "volts.csv"):
        read_schedule(tmp_path / "volts.csv", NAMES)
    with raises_at(ScheduleError, file=tmp_path):
        read_schedule(tmp_path, NAMES)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("t,waist,elbow\n0,1,2\n".encode("utf-16"), ":1: byte 0xff"),
        (b"t,waist,elbow\n0,1,\xb5\n", ":2: byte 0xb5"),
    ],
)
def test_refuses_other_encodings(tmp_path, text, where):
    with pytest.raises(ScheduleError, match=f"{where} is not UTF-8"):
        read_schedule(written(tmp_path, text), NAMES)


def test_binary_file_is_refused_in_one_line(tmp_path):
    with pytest.raises(ScheduleError) as error:
        read_schedule(written(tmp_path, b"\x89PNG\r\n\x1a\n\x00\x00"), NAMES)
    assert "\n" not in str(error.value)


def test_unknown_units_are_refused_where_the_drive_is_not_known(tmp_path):
    schedule = read_schedule(written(tmp_path, "t,waist [V],elbow [N m]\n0,1,2\n"), NAMES)
    np.testing.assert_array_equal(schedule.commands, [[1, 2]])
    with raises_at(ScheduleError, "unit of column 'waist'", "V or A or N m or N", value="mV"):
        read_schedule(written(tmp_path, "t,waist [mV],elbow\n0,1,2\n"), NAMES)


def test_a_joint_may_be_called_like_a_number(tmp_path):
    schedule = read_schedule(written(tmp_path, "t,2,1\n0,20,10\n"), ("1", "2"))
    np.testing.assert_array_equal(schedule.commands, [[10, 20]])


def test_constant_and_held_values():
    schedule = Schedule.constant(NAMES, [1, 2])
    np.testing.assert_array_equal(schedule.at(5.0), [1, 2])
    steps = Schedule(np.array([0.0, 0.5, 1.0]), np.array([[0.0, 0], [1, 1], [2, 2]]), NAMES)
    assert [steps.at(t)[0] for t in (0.0, 0.49, 0.5, 0.99, 1.0, 9.0)] == [0, 0, 1, 1, 2, 2]


def test_is_frozen():
    values = np.array([[1.0, 2.0]])
    schedule = Schedule(np.zeros(1), values, NAMES)
    values[0, 0] = 9.0
    assert schedule.commands[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        schedule.commands[0, 0] = 3.0


@pytest.mark.parametrize(
    ("times", "commands", "place", "value", "said"),
    [
        ([0.0], [[1.0]], "commands", ABSENT, r"shape (1, 1); expected (1, 2): one row a time"),
        ([0.0, 1.0], [[1.0, 2.0]], "commands", ABSENT, "shape (1, 2)"),
        ([], np.zeros((0, 2)), "times", ABSENT, "shape (0,)"),
        ([[0.0]], [[1.0, 2.0]], "times", ABSENT, "shape (1, 1)"),
        ([0.0], [[1.0, -np.inf]], "commands[0, 1]", -np.inf, "expected finite numbers"),
        ([np.inf], [[1.0, 2.0]], "times[0]", np.inf, "expected finite numbers"),
        ([1.0], [[1.0, 2.0]], "times[0]", 1.0, "expected the first time to be 0"),
        ([0.0, 0.0], [[1.0, 2.0]] * 2, "times[1]", 0.0, "repeats the time before it"),
        ([0.0, 2.0, 1.0], [[1.0, 2.0]] * 3, "times[2]", 1.0, "earlier than 2 before it"),
        (["a"], [[1.0, 2.0]], "times", ["a"], "expected an array of numbers"),
    ],
)
def test_refuses_arrays(times, commands, place, value, said):
    with pytest.raises(ScheduleError) as refused:
        Schedule(np.array(times), np.array(commands), NAMES)
    assert (refused.value.place, refused.value.value) == (place, value)
    assert said in str(refused.value)


@pytest.mark.parametrize("time", [[0.1, 0.2], np.zeros(1), np.nan, "now", None])
def test_a_schedule_is_asked_for_one_time(time):
    with raises_at(ScheduleError, "time"):
        Schedule.constant(NAMES, [1.0, 2.0]).at(time)
