"""Ctrl-C, as a signal to a process: what was found so far is kept and said, exit code 130, and bars say how long is left."""

import importlib
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli import main
from armwright.cli.app import app
from armwright.control.analysis import analyse
from armwright.control.comparison import compare
from armwright.identification.arm import drive_gains, friction, identify as arm_fit, payload
from armwright.identification.linear import n4sid, selection
from armwright.identification.logs import read
from armwright.identification.motor import fitting
from armwright.tuning.search import GainSearch
from foreground import FOREGROUND
from identification.arm.moved_arm import moved
from identification.linear.test_records import data, log_file
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
    found = re.search(
        r"note: stopped by Ctrl-C; ([\d,]+) finished lanes are kept in runs.zarr: the same command continues", said
    )
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


NOTHING = "armwright: note: stopped by Ctrl-C before anything was found; nothing is kept or written\n"


def test_before_a_generation_is_complete_nothing_is_written(tmp_path, stopping):
    stopping(GainSearch, "_scores", 1)
    assert tuned(tmp_path) == (130, NOTHING)
    assert not (tmp_path / "tuned.scenario.toml").exists()


def test_a_command_without_long_work_says_that_it_was_stopped(stopping):
    stopping(aw.robotfiles, "servos", 1)
    result = invoke("servos")
    assert (result.exit_code, result.stderr) == (130, "armwright: note: stopped by Ctrl-C\n")


@pytest.fixture
def moving(tmp_path):
    """Folder with a log of a moving arm, one with a payload, one of a motor, and scenarios."""
    moved(tmp_path, "arm", aw.load("two-link"), seconds=12.0, torque_noise=0.01)
    moved(
        tmp_path,
        "loaded",
        aw.load("two-link").with_payload(1.5, [0.0] * 3, [0.01] * 3),
        seconds=12.0,
        torque_noise=0.01,
    )
    log_file(tmp_path, {"a": ("fit", data(0))})
    for name, kp in (("soft", 100), ("stiff", 300)):
        (tmp_path / f"{name}.scenario.toml").write_text(SCENARIO.format(period=2e-3).replace("[600, 120]", str(kp)))
    aw.trajectories.Quintic(np.zeros(2), np.array([0.2, 0.1]), 0.1).save(aw.load("two-link"), tmp_path / "move.csv")
    return tmp_path


study = importlib.import_module("armwright.simulation.step_study")  # the package's name of it is the function
ARM = "identify arm two-link arm.log.toml"
COMPARE = "compare-controllers soft.scenario.toml stiff.scenario.toml --reference move.csv --settle 0.1 --lanes 1"
STUDY = "step-study two-link --torque 20,5 --duration 0.1 --step-count 4"
KEPT = {  # the command, the function whose call is interrupted, what is said, and what the written file has
    "arm, the bootstrap": (
        f"{ARM} --bootstrap", arm_fit, "block_bootstrap", 1, "Not checked, .*: bootstrap, residuals", "not identified"
    ),
    "arm, the remarks": (ARM, arm_fit, "sentences", 1, "Not checked, .*: residuals", "not identified"),
    "friction": (
        "identify friction two-link arm.log.toml", friction, "choose_terms", 2, "not fitted, .*: elbow", "not identified"
    ),
    "payload": (
        "identify payload two-link loaded.log.toml", payload, "_fitted", 2, "before the low-pass of .* Hz", "stopped by Ctrl-C"
    ),
    "linear": ("identify linear motor.log.toml", selection, "cross_validation", 3, "after 2 of 5 orders", None),
    "n4sid": (
        "identify linear motor.log.toml --model n4sid", n4sid.SubspaceFit, "_held_error", 4, "after 3 of 10 orders", None
    ),
    "compare-controllers": (COMPARE, compare, "_case", 2, "before stiff could be compared", "soft"),
    "step-study": (STUDY, study, "simulate", 4, "after 2 of 4 steps", None),
    "step-study, auto": (STUDY, study, "_auto", 1, "after 4 of 4 steps", None),
    "loops": ("loops stiff.scenario.toml --poses 50 --gain-margin 50", analyse, "loop_remedies", 1, "no file is written", None),
}  # fmt: skip


@pytest.mark.parametrize("case", KEPT)
def test_what_was_found_is_kept_and_said(moving, stopping, monkeypatch, case):
    command, module, function, at, said, written = KEPT[case]
    stopping(module, function, at)
    monkeypatch.chdir(moving)
    output = "found.csv" if command == COMPARE else "found.toml"
    result = invoke(*command.split(), *(["-o", output] if written else []))
    assert result.exit_code == 130, result.output
    assert "note: stopped by Ctrl-C" in result.stderr
    assert re.search(said, result.output.replace("\n", " ")), result.output
    assert (written == "not identified") == ("\nnot identified\n" in result.stdout)
    assert result.stdout
    if written:
        text = (moving / output).read_text()
        assert written in text
        assert "stiff" not in text
        if output == "found.toml":
            aw.load(moving / output)


NOT_YET = {
    "arm": (ARM, arm_fit, "record_parameters"),
    "arm, its log": (ARM, read, "census_of"),
    "friction": ("identify friction two-link arm.log.toml", friction, "choose_terms"),
    "payload": ("identify payload two-link loaded.log.toml", payload, "_fitted"),
    "gains": (
        "identify gains two-link arm.log.toml --loaded-log loaded.log.toml --payload-mass 1.5", drive_gains, "equations_of"
    ),
    "linear": ("identify linear motor.log.toml", selection, "cross_validation"),
    "n4sid": ("identify linear motor.log.toml --model n4sid", n4sid.SubspaceFit, "_held_error"),
    "motor": ("identify motor motor.log.toml", fitting, "many_starts"),
    "compare-controllers": (COMPARE, compare, "_case"),
    "step-study": (STUDY, study, "simulate"),
    "loops": ("loops stiff.scenario.toml --poses 50", analyse, "noise_gain"),
}  # fmt: skip


@pytest.mark.parametrize("case", NOT_YET)
def test_before_anything_is_found_nothing_is_kept(moving, stopping, monkeypatch, case):
    command, module, function = NOT_YET[case]
    stopping(module, function, 1)
    monkeypatch.chdir(moving)
    before = sorted(moving.iterdir())
    output = (
        []
        if "linear" in command or "study" in command
        else ["-o", "x.csv" if command == COMPARE else "x.scenario.toml"]
    )
    result = invoke(*command.split(), *output)
    assert (result.exit_code, result.stdout, result.stderr) == (130, "", NOTHING)
    assert sorted(moving.iterdir()) == before


@pytest.mark.study
def test_friction_keeps_the_joints_that_are_fitted(tmp_path):
    moved(tmp_path, "arm", aw.load("lwa4p"), seconds=40.0, torque_noise=0.1)
    half = re.compile(rb"\b(33|50|67)% +\d:\d\d:\d\d")  # of the joints
    code, out, said = stopped(tmp_path, "identify", "friction", "lwa4p", "arm.log.toml", "-o", "found.toml", seen=half)
    assert code == 130, said
    assert re.search(r"note: stopped by Ctrl-C before (joint\d, )*joint6 could be fitted", said), said
    assert "\nnot identified\n" in out
    assert aw.load(tmp_path / "found.toml").record.fits["friction"].verdict == "not identified"
    assert "Traceback" not in said


def test_ctrl_c_before_a_command_runs_ends_without_a_traceback(monkeypatch):
    def starting(**options):
        raise KeyboardInterrupt

    monkeypatch.setattr("armwright.cli.app.app", starting)
    monkeypatch.setattr("gc.set_threshold", lambda number: None)
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 130
