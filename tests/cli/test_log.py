"""`armwright log`: a summary, findings, and exit code 2 for a log that cannot be used."""

import pytest

from cli.test_commands import run
from identification.logs.example_logs import ALL, columns, written


def test_a_log_is_shown(tmp_path):
    shown = run("log", str(written(tmp_path, ALL))).stdout
    for words in ("Two joints", "run1", "fit", "4001", "500", "shoulder", "prepared for a fit", "cut-off", "no delay"):
        assert words in shown
    assert "error" not in shown


@pytest.mark.study
def test_a_picture_of_a_run(tmp_path):
    path = written(tmp_path, ALL)
    for ending, begin in (("png", b"\x89PNG"), ("svg", b"<?xml")):
        picture = tmp_path / f"log.{ending}"
        assert "wrote" in run("log", str(path), "--plot", str(picture), "--cutoff", "40").stdout
        assert picture.read_bytes().startswith(begin)


def test_an_unusable_log_ends_with_2_and_all_its_errors(tmp_path):
    table = columns()
    table["v1"] *= -1
    table["q2"] *= 57.29577951308232
    result = run("log", str(written(tmp_path, ALL, {"arm.csv": table})), "--plot", str(tmp_path / "x.png"), code=2)
    assert "wrong sign" in result.stdout
    assert "degrees" in result.stdout
    assert "2 errors: the log cannot be used" in result.stderr
    assert not (tmp_path / "x.png").exists()


def test_mistakes_are_one_line(tmp_path):
    path = written(tmp_path, ALL)
    for arguments in (
        ["nowhere.log.toml"],
        [str(path), "--run", "run7"],
        [str(path), "--plot", "x.gif"],
        [str(path), "--cutoff", "400"],
        [str(path), "--decimate", "0"],
    ):
        result = run("log", *arguments, code=2)
        assert result.stderr.startswith("armwright: error: ")
        assert result.stderr.count("\n") == 1
        option = next((each for each in ("--run", "--cutoff", "--decimate") if each in arguments), "")
        assert option in result.stderr


@pytest.mark.study
@pytest.mark.filterwarnings("error")
def test_a_picture_of_constants_has_no_spectrum_of_them(tmp_path):
    table = columns()
    table["m1"][:], table["m2"][:] = 4.0, 1.5
    text = run("log", str(written(tmp_path, ALL, {"arm.csv": table})), "--plot", str(tmp_path / "log.svg")).stdout
    assert "constant, 4 N m" in text
    assert "wrote" in text
