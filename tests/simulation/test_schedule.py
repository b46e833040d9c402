"""Schedules: what is read, what is refused and in which words."""

import numpy as np
import pytest

from armwright.errors import ScheduleError
from armwright.simulation.inputs.schedule import Schedule, read_schedule

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


REFUSED = {
    "": "empty; expected 3 columns: t, waist, elbow",
    "\n\n": "empty; expected",
    "t,waist,elbow\n": "a header without rows; expected at least one row",
    "t,waist\n0,1\n": "line 1: no column 'elbow'; expected 3 columns: t, waist, elbow",
    "0,1\n": "line 1: 2 columns, expected 3 columns: t, waist, elbow",
    "t,waist,elbow\n0,1,2\n1,2\n": "line 3: 2 columns, expected 3",
    "t,waist,elbow\n0,1,2,3\n": "line 2: 4 columns, expected 3",
    "0,1,2,\n": "line 1: 4 columns, expected 3",
    "t,waist,elbwo\n0,1,2\n": "line 1: unknown column 'elbwo'; did you mean elbow?",
    "t,waist,elbow,wrist\n0,1,2,3\n": "line 1: unknown column 'wrist'; did you mean waist?",
    "t,waist,waist\n0,1,2\n": "line 1: two columns are called 'waist'",
    "t,waist,\n0,1,2\n": "line 1: column 3 has no name",
    "t,waist [mV],elbow\n0,1,2\n": "line 1, column 'waist': in 'mV'; expected its unit to be V",
    "t [ms],waist,elbow\n0,1,2\n": "line 1, column 't': in 'ms'; expected its unit to be s",
    "t;waist;elbow\n0;1;2\n": "unknown column 't;waist;elbow'; its cells are separated by semicolons, expected commas",
    "0;1;2\n": "separated by semicolons, expected commas",
    "0\t1\t2\n": "separated by tabs, expected commas",
    "t,waist,elbow\n0,1,2\n1,2,3\n0.5,2,3\n": "line 4, column 't' = 0.5: earlier than 1 before it; expected times to increase",
    "t,waist,elbow\n0,1,2\n1,2,3\n1,2,3\n": "line 4, column 't' = 1: repeats the time before it",
    "t,waist,elbow\n0.1,1,2\n": "line 2, column 't' = 0.1: expected the first time to be 0",
    "t,waist,elbow\n\n-1,1,2\n": "line 3, column 't' = -1: expected the first time to be 0",
    "t,waist,elbow\n0,1,nan\n": "line 2, column 'elbow': nan: expected a finite number",
    "t,waist,elbow\n0,1,2\n1,-inf,2\n": "line 3, column 'waist': -inf: expected a finite number",
    "t,waist,elbow\n0,1,2\n1,fast,2\n": "line 3, column 'waist': 'fast': expected a finite number",
    "t,waist,elbow\n0,1,2\n1,,2\n": "line 3, column 'waist': empty: expected a finite number",
    "0,1,2\n1,x,2\n": "line 2, column 'waist': 'x': expected a finite number",
    "t,waist,elbow\n0,1_000,2\n": "line 2, column 'waist': '1_000': expected a finite number",
    "t,waist,elbow\n0,1e999,2\n": "line 2, column 'waist': inf: expected a finite number",
    't,waist,elbow\n0,"1,2\n': "not CSV",
}


@pytest.mark.parametrize("text", REFUSED)
def test_refuses(tmp_path, text):
    path = written(tmp_path, text)
    with pytest.raises(ScheduleError) as error:
        read_schedule(path, NAMES, units=("V", "V"))
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert REFUSED[text] in message
    assert "\n" not in message


def test_refuses_what_is_no_file(tmp_path):
    with pytest.raises(ScheduleError, match=r"volts\.csv: no such file"):
        read_schedule(tmp_path / "volts.csv", NAMES)
    with pytest.raises(ScheduleError, match="a folder, expected a CSV file"):
        read_schedule(tmp_path, NAMES)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("t,waist,elbow\n0,1,2\n".encode("utf-16"), "line 1: byte 0xff"),
        (b"t,waist,elbow\n0,1,\xb5\n", "line 2: byte 0xb5"),
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
    with pytest.raises(ScheduleError, match="in 'mV'; expected its unit to be V or A or N m or N"):
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
    ("times", "commands", "message"),
    [
        ([0.0], [[1.0]], "commands have the shape"),
        ([0.0, 1.0], [[1.0, 2.0]], "commands have the shape"),
        ([], np.zeros((0, 2)), "times have the shape"),
        ([[0.0]], [[1.0, 2.0]], "times have the shape"),
        ([0.0], [[1.0, np.nan]], r"commands\[0, 1\] = nan: expected finite numbers"),
        ([np.inf], [[1.0, 2.0]], r"times\[0\] = inf"),
        ([1.0], [[1.0, 2.0]], "expected the first time to be 0"),
        ([0.0, 0.0], [[1.0, 2.0]] * 2, r"times\[1\] = 0: repeats"),
        ([0.0, 2.0, 1.0], [[1.0, 2.0]] * 3, r"times\[2\] = 1: earlier than 2"),
        (["a"], [[1.0, 2.0]], "expected an array of numbers"),
    ],
)
def test_refuses_arrays(times, commands, message):
    with pytest.raises(ScheduleError, match=message):
        Schedule(np.array(times), np.array(commands), NAMES)
