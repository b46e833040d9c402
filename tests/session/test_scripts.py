"""Scripts on standard input: an error ends them with its line and exit code 2; killed, they leave whole files or none."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time

import pytest

from armwright.results.run_file import load_run

SIM = (sys.executable, "-m", "armwright", "sim")


def sim(text, *arguments, cwd=None):
    given = text if isinstance(text, bytes) else text.encode()
    return subprocess.run([*SIM, *arguments], input=given, capture_output=True, check=False, cwd=cwd)


def test_the_first_error_ends_it_with_its_line():
    done = sim("theta[1] = 0.5\n\n# a comment\ntheta[1]\ntheta = 1 2\ntheta[2]\n")
    assert done.returncode == 2
    assert done.stdout.decode() == "theta[joint1] = 0.5 rad = 28.6479 deg\n"
    error = done.stderr.decode()
    assert error.startswith("armwright: error: standard input:5: theta = '1 2': 2 values; expected 6")
    assert error.count("\n") == 1


def test_a_script_in_a_script_tells_both_lines(tmp_path):
    (tmp_path / "inner.sim").write_text("theta = 0\nfoo\n")
    done = sim("run-script inner.sim\n", cwd=tmp_path)
    assert done.returncode == 2
    assert b"standard input:1: inner.sim:2: 'foo': no such command" in done.stderr


def test_a_script_that_calls_itself_is_told_once(tmp_path):
    (tmp_path / "a.sim").write_text("theta = 0\nrun-script b.sim\n")
    (tmp_path / "b.sim").write_text("run-script a.sim\n")
    done = sim("run-script a.sim\n", cwd=tmp_path)
    error = done.stderr.decode()
    assert "deep" in error
    assert [error.count(place) for place in ("standard input:1: ", "a.sim:2: ", "b.sim:1: ")] == [1] * 3


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("arguments", "text", "message"),
    [
        (("pma560",), "", "robot = 'pma560'"),
        (("--script", "none.sim"), "", "none.sim: no such file"),
        ((), b"theta\n\xff\xfe\n", "standard input:2: b'\\xff\\xfe\\n': not UTF-8"),
        ((), "simulate\n", "standard input:1: simulate start: missing"),
    ],
)
def test_errors_are_one_line(arguments, text, message, tmp_path):
    done = sim(text, *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr.decode()
    assert done.stderr.count(b"\n") == 1
    assert b"Traceback" not in done.stderr


def test_nothing_to_do_is_no_error():
    done = sim("")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")
def test_without_any_input_it_says_so():
    done = subprocess.run(["sh", "-c", f"{shlex.join(SIM)} <&-"], capture_output=True, check=False)
    assert done.returncode == 2
    assert done.stderr.decode().startswith("armwright: error: standard input: is closed; expected a terminal")
    assert done.stderr.count(b"\n") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")
def test_a_reader_that_goes_away_is_no_error():
    done = subprocess.run(
        ["sh", "-c", f"{shlex.join(SIM)} | head -1"], input=b"help\n" * 50, capture_output=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, b"Variables\n", b"")


@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_killed_in_the_middle_it_leaves_whole_files_or_none(tmp_path):
    """Printing, saving and recording for ever, killed at some moment, several times over."""
    lines = ["simulate new steps=50", "record day.sim", "open-output-file rows.csv"]
    lines += ["print-simulation", "save here.nc", "save-simulation run.nc", "theta = 0.1"] * 200
    script = tmp_path / "long.sim"
    script.write_text("\n".join(lines))
    for wait in (0.05, 0.3):
        process = subprocess.Popen([*SIM, "--script", "long.sim"], cwd=tmp_path, stdout=subprocess.DEVNULL)
        end = time.monotonic() + 60
        while not (tmp_path / "run.nc").exists() and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(wait)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert process.returncode == -signal.SIGKILL
        rows = (tmp_path / "rows.csv").read_text().splitlines()
        assert (len(rows) - 1) % 51 == 0
        assert {line.count(",") for line in rows} == {24}
        for name in ("here.nc", "run.nc"):
            assert load_run(tmp_path / name)["q"].shape == (51, 6)
        recorded = (tmp_path / "day.sim").read_text()
        assert recorded.endswith("\n")
        assert recorded.splitlines()[0] == "database-read robot=cmu-dd"
        for file in tmp_path.iterdir():
            if file != script:
                os.unlink(file)
