"""`armwright export`: what it writes, and what it refuses in one line."""

import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from armwright.cli.app import app
from kernels.c_compilers import BITS, STRICT, build, compiler

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SWING = EXAMPLES / "swing.scenario.toml"


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result


@pytest.mark.parametrize("real", [(), ("--float",)])
def test_a_library_that_compiles_and_passes_its_self_test(tmp_path, real):
    folder = tmp_path / "firmware"
    shown = run("export", "c", "cmu-dd", "--functions", "inverse_dynamics, forward_arm", *real, "-o", folder).stdout
    names = ["cmu_dd.h", "cmu_dd.c", "cmu_dd_selftest.c"]
    assert [line.split("/")[-1] for line in shown.splitlines()] == names
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    assert ("float q[" if real else "double q[") in (folder / "cmu_dd.h").read_text()
    build([compiler("gcc"), *BITS, *STRICT, *folder.glob("*.c"), "-o", tmp_path / "selftest", "-lm"])
    assert subprocess.run([tmp_path / "selftest"], capture_output=True).returncode == 0


def test_a_controller_that_is_compared_with_its_simulation(tmp_path):
    folder = tmp_path / "firmware"
    shown = run("export", "controller", SWING, "--name", "swing", "-o", folder).stdout
    names = ["swing.h", "swing.c", "swing_selftest.c", "CMakeLists.txt", "README.md", "swing.parameters"]
    lines = shown.splitlines()
    assert [line.split("/")[-1] for line in lines[:6]] == names
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    compiler("gcc")
    assert lines[6].startswith("1000 steps: every command has the bits of the simulation; ")


def test_help_teaches_by_example():
    shown = run("export", "c", "--help").stdout
    assert "Examples:" in shown
    assert "armwright export c puma560" in shown


LANES = EXAMPLES / "bus-4ms.scenario.toml"
REFUSED = [
    (("export", "controller", "none.scenario.toml", "-o", "x"), "none.scenario.toml"),
    (
        ("export", "controller", str(LANES), "-o", "x"),
        "lanes: 64 lanes; expected one arm: a scenario without batches and draws",
    ),
    (("export", "controller", str(SWING), "-o", "x", "--gains", "kq"), "--gains = 'kq': did you mean kp or ki or kd?"),
    (("export", "controller", str(SWING), "-o", "file"), "file: cannot be created, or is no folder"),
    (("export",), "Missing command"),
    (("export", "rust"), "No such command 'rust'"),
    (("export", "c"), "Missing argument 'ROBOT'"),
    (("export", "c", "panda"), "Missing option '--functions'"),
    (("export", "c", "panda", "--functions", "jacobian"), "Missing option '--output'"),
    (("export", "c", "pnda", "--functions", "jacobian", "-o", "x"), "did you mean panda?"),
    (
        ("export", "c", "panda", "--functions", "gravity", "-o", "x"),
        "function = 'gravity': did you mean gravity_torques?",
    ),
    (
        ("export", "c", "panda", "--functions", ",", "-o", "x"),
        "functions: none is named; expected NAME, NAME+INPUT or NAME:OPTION=VALUE",
    ),
    (
        ("export", "c", "panda", "--functions", "motor_torque", "-o", "x"),
        "joint1.motor.resistance_ohm: motor_torque needs it",
    ),
    (("export", "c", "panda", "--functions", "jacobian", "-o", "file"), "file: cannot be created, or is no folder"),
    (("export", "c", "panda", "--functions", "jacobian", "-o", "file/x"), "file/x: cannot be created, or is no folder"),
]


@pytest.mark.parametrize(
    ("arguments", "message"), REFUSED, ids=lambda value: " ".join(value) if isinstance(value, tuple) else ""
)
def test_refused_in_one_line(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    result = run(*arguments, code=2)
    assert result.stdout == ""
    assert result.stderr.startswith("armwright: error: ")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
