"""Tables of data sets: read by name or order, written so that they read back to the last bit."""

import io

import numpy as np
import pandas
import pytest

from armwright.errors import ABSENT, OutputError, ScheduleError
from armwright.results.csv_tables import joint_columns, read_table, write_table
from raises_at import raises_at

NAMES = ["waist", "elbow"]
WANTED = {"q": NAMES, "qd": NAMES}
UNITS = {"q": ["rad", "m"], "qd": ["rad/s", "m/s"]}


def written(tmp_path, text):
    path = tmp_path / "sets.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "q_waist,q_elbow,qd_waist,qd_elbow\n1,2,3,4\n5,6,7,8\n",
        "1,2,3,4\n5,6,7,8\n",
        "qd_elbow,q_waist,qd_waist,q_elbow\n4,1,3,2\n8,5,7,6\n",
        "q_waist [rad],q_elbow [m],qd_waist [rad/s],qd_elbow [m/s]\n1,2,3,4\n5,6,7,8\n\n",
    ],
)
def test_reads(tmp_path, text):
    data = read_table(written(tmp_path, text), WANTED, UNITS)
    assert list(data) == ["q", "qd"]
    np.testing.assert_array_equal(data["q"], [[1, 2], [5, 6]])
    np.testing.assert_array_equal(data["qd"], [[3, 4], [7, 8]])


COLUMNS = "4 columns: q_waist, q_elbow, qd_waist, qd_elbow"


@pytest.mark.parametrize(
    ("text", "line", "place", "value", "expected"),
    [
        ("q_waist,q_elbow,qd_waist\n1,2,3\n", 1, "column 'qd_elbow'", ABSENT, COLUMNS),
        ("q_waist [deg],q_elbow,qd_waist,qd_elbow\n1,2,3,4\n", 1, "unit of column 'q_waist'", "deg", "rad"),
        ("1,2,3,4\n1,2,3\n", 2, "", ABSENT, COLUMNS),
        ("1,2,3,4\n1,2,3,four\n", 2, "column 'qd_elbow'", "four", "a finite number"),
        ("q1,q2,q3,q4\n1,2,3,4\n", 1, "column", "q1", ""),
    ],
)
def test_refuses(tmp_path, text, line, place, value, expected):
    path = written(tmp_path, text)
    with pytest.raises(ScheduleError) as error:
        read_table(path, WANTED, UNITS)
    problem = error.value
    assert (problem.file, problem.place, problem.value, problem.expected) == (f"{path}:{line}", place, value, expected)


def test_what_is_written_reads_back_to_the_last_bit(tmp_path):
    values = np.random.default_rng(1).normal(size=(5000, 2)) * 10.0 ** np.arange(-150, 150, 150)
    path = tmp_path / "q.csv"
    write_table(path, joint_columns("q", NAMES, UNITS["q"], values))
    np.testing.assert_array_equal(read_table(path, {"q": NAMES}, UNITS)["q"], values)
    frame = pandas.read_csv(path)  # and pandas reads it without being told how
    assert list(frame.columns) == ["q_waist [rad]", "q_elbow [m]"]
    np.testing.assert_allclose(frame.to_numpy(), values, rtol=1e-15)


def test_writes_to_a_stream():
    stream = io.StringIO()
    write_table(None, {"lane": np.arange(2), "x [m]": np.array([0.1, np.nan])}, stream)
    assert stream.getvalue() == "lane,x [m]\n0,0.1\n1,nan\n"


def test_writes_whole_or_not_at_all(tmp_path):
    path = tmp_path / "q.csv"
    path.write_text("before")
    with pytest.raises(ValueError, match="zip"):
        write_table(path, {"a": np.zeros(2), "b": np.zeros(1)})
    assert path.read_text() == "before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["q.csv"]


def test_output_errors(tmp_path):
    with raises_at(OutputError, file=tmp_path):
        write_table(tmp_path, {"a": np.zeros(2)})
    with raises_at(OutputError, file=tmp_path / "nowhere" / "a.csv"):
        write_table(tmp_path / "nowhere" / "a.csv", {"a": np.zeros(2)})
