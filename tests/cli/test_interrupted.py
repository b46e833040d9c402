"""Ctrl-C, as a signal to a process: what was found so far is kept and said, exit code 130, and bars say how long is left."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.identification.motor import fitting
from armwright.tuning.search import GainSearch
from foreground import FOREGROUND
from identification.motor_truth import write_log

from .test_tune import SCENARIO, run as tuned

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals and a pseudo-terminal")
AT_WORK = re.compile(rb"\b[1-9]\d*% +\d:\d\d:\d\d")  # a bar that moves, with the time left


def stopped(folder, *words, seen=AT_WORK, most=100.0):
    """Exit code, stdout and stderr of a command that gets SIGINT once its bar, on a terminal, has shown that."""
    leader, follower = pty.openpty()
    environment = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "CI")}
    process = subprocess.Popen(
        [*FOREGROUND, sys.executable, "-m", "armwright", *map(str, words)], cwd=folder, stdout=subprocess.PIPE, stderr=follower,
        start_new_session=True,
        env=environment | {"TERM": "xterm", "COLUMNS": "200"},
    )  # fmt: skip
    os.close(follower)
    shown, end, sent = b"", time.monotonic() + most, False
    while time.monotonic() < end:
        if select.select([leader], [], [], 0.1)[0]:
            try:
                shown += os.read(leader, 65536)
            except OSError:  # the other side is closed
                break
        plain = re.sub(rb"\x1b\[[0-9;?]*[A-Za-z]", b"", shown)
        if not sent and seen.search(plain):
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does
            sent = True
    out = process.communicate(timeout=30)[0].decode()
    os.close(leader)
    assert sent, shown.decode()
    return process.returncode, out, re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())


@pytest.mark.study
def test_tuning_keeps_its_best_gains(tmp_path):
    (tmp_path / "arm.scenario.toml").write_text(SCENARIO.format(period=2e-3))
    words = ("tune", "arm.scenario.toml", "-o", "tuned.scenario.toml", "--lanes", "16", "--generations", "500")
    code, out, said = stopped(tmp_path, *words)
    assert code == 130, said
    found = re.search(
        r"note: stopped by Ctrl-C after (\d+) of 500 generations; what was found until then is kept", said
    )
    assert found, said
    assert int(found[1]) >= 1
    assert "wrote tuned.scenario.toml" in out
    assert "held-out lanes goes from" in out
    assert aw.read_scenario(tmp_path / "tuned.scenario.toml").controller.kp.tolist() != [600.0, 120.0]
    assert "Traceback" not in said


SWEPT = """\
robot = "two-link"
duration_s = 0.05

[loop]
period_s = 1e-3
controller = { kind = "joint_pid", kp = 60.0, kd = 4.0 }
reference = { kind = "step", start = [0.0, 0.0], goal = [0.5, 0.2] }

[recording]
reduce = ["rms_error"]

[lanes]
kind = "draws"
count = 3
seed = 7
vary = { "forearm.mass_kg" = { normal = [1.0, 0.1] } }
"""


@pytest.mark.study
def test_a_sweep_keeps_its_chunks_and_goes_on(tmp_path):
    pytest.importorskip("distributed", reason="dask is not installed: pip install armwright[sweep]")
    (tmp_path / "arm.scenario.toml").write_text(SWEPT)
    words = ("sweep", "arm.scenario.toml", "--lanes", "1e5", "--chunk", "500", "-o", "runs.zarr")
    code, _, said = stopped(tmp_path, *words)
    assert code == 130, said
    found = re.search(r"stopped; ([\d,]+) finished lanes are kept in runs.zarr, and the same command goes on", said)
    assert found, said
    kept = int(found[1].replace(",", ""))
    assert 500 <= kept < 100_000
    assert kept == aw.sweeps.load_sweep(tmp_path / "runs.zarr", verify=True).attrs["lanes_finished"]
    assert "Traceback" not in said


@pytest.mark.study
def test_a_motion_design_keeps_the_best_start(tmp_path):
    words = ("excite", "two-link", "-o", "motion.csv", "--starts", "1000", "--harmonics", "3", "--max-velocity", "2")
    code, out, said = stopped(tmp_path, *words)
    assert code == 130, said
    assert re.search(r"note: stopped by Ctrl-C after \d+ of 1000 starts; what was found until then is kept", said), said
    assert "wrote motion.csv" in out
    assert "condition number" in out
    assert aw.trajectories.load_motion(tmp_path / "motion.csv", aw.load("two-link")).duration == pytest.approx(10.0)


@pytest.fixture
def stopping(monkeypatch):
    """Lets the n-th call of a function raise KeyboardInterrupt, as Ctrl-C does."""

    def let(module, name, at):
        calls, function = [], getattr(module, name)

        def counted(*arguments, **options):
            calls.append(name)
            if len(calls) == at:
                raise KeyboardInterrupt
            return function(*arguments, **options)

        monkeypatch.setattr(module, name, counted)

    return let


def invoke(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_motor_fit_shows_its_numbers_and_writes_nothing(tmp_path, stopping):
    log, record = write_log(tmp_path, 0, ("qd",), rows=200), tmp_path / "motor.toml"
    stopping(fitting, "refined", 2)
    result = invoke("identify", "motor", log, "--starts", "2", "-o", record)
    assert result.exit_code == 130, result.output
    assert re.search(r"stopped by Ctrl-C in round \d of 3; this fit is not finished", result.stderr), result.stderr
    shown = dict(re.findall(r"^(\S+) +(\S+)$", result.stdout.split("numbers so far")[1], re.MULTILINE))
    assert float(shown["motor.motor.torque_constant_n_m_per_a"]) > 0.0
    assert not record.exists()


def test_tuning_judges_the_generations_that_are_complete(tmp_path, stopping):
    stopping(GainSearch, "_scores", 4)
    code, shown = tuned(tmp_path, "--generations", "9")
    assert code == 130, shown
    assert "note: stopped by Ctrl-C after 3 of 9 generations; what was found until then is kept" in shown
    assert "held-out lanes goes from" in shown
    assert f"wrote {tmp_path / 'tuned.scenario.toml'}" in shown


def test_before_a_generation_is_complete_nothing_is_written(tmp_path, stopping):
    stopping(GainSearch, "_scores", 1)
    assert tuned(tmp_path) == (130, "")
    assert not (tmp_path / "tuned.scenario.toml").exists()


def test_before_anything_is_found_it_ends_quietly(tmp_path, stopping):
    log = write_log(tmp_path, 0, ("qd",), rows=200)
    stopping(fitting, "many_starts", 1)
    result = invoke("identify", "motor", log, "-o", tmp_path / "motor.toml")
    assert (result.exit_code, result.stdout, result.stderr) == (130, "", "")
