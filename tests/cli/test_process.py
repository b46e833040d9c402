"""The command line as a process: `python -m armwright`, start-up, pipes and Ctrl-C."""

import os
import signal
import subprocess
import sys
import time

import pytest

from armwright.results.run_file import load_run
from foreground import FOREGROUND

COMMAND = (sys.executable, "-m", "armwright")


def run(*arguments, **options):
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, encoding="utf-8", check=False, **options
    )


def test_module_runs():
    done = run("--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("armwright ")


def test_an_error_is_one_line_and_exit_code_2():
    done = run("info", "pma560")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("armwright: error: robot = 'pma560'")
    assert done.stderr.count("\n") == 1


DATA = {"pydantic", "numpy", "casadi"}  # of whatever reads a robot's record and builds its model
WATCHED = {
    "llvmlite",
    "xarray",
    "pandas",
    "matplotlib",
    "scipy",
    "tomlkit",
    "trimesh",
    "networkx",
    "dask",
    "plotly",
} | DATA
IMPORTED = {  # packages that a command may import, of those that cost something
    ("--help",): set(),
    ("info", "--help"): {"pydantic"},  # typer's own
    ("info", "cmu-dd"): DATA,
    ("check", "puma560"): DATA,
    ("check", "cmu-dd"): DATA | {"trimesh", "scipy", "networkx"},  # hulls of its shapes
    ("robots",): DATA,
    # xarray imports pandas, and asks dask, which imports scipy, about each array where it is installed
    ("simulate", "cmu-dd", "--voltage", "0", "--duration", "0.01"): DATA
    | {"llvmlite", "xarray", "pandas", "dask", "scipy"},
}


@pytest.mark.parametrize("command", IMPORTED, ids=" ".join)
def test_a_command_imports_nothing_unasked(command):
    script = (
        "import sys\n"
        "from armwright.cli import main\n"
        f"sys.argv[1:] = {list(command)}\n"
        "try:\n    main()\n"
        f"finally:\n    print(*sorted({WATCHED} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert set(done.stderr.split("\n")[-2].split()) <= IMPORTED[command]


def test_a_console_without_greek_letters():
    done = run("info", "cmu-dd", env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"})
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_ctrl_c_ends_quietly_and_keeps_what_is_finished(tmp_path, tmp_path_factory):
    cache = tmp_path_factory.mktemp("cache")
    arguments = ("simulate", "cmu-dd", "--voltage", "0", "--duration", "100000", "--record-every", "1000")
    process = subprocess.Popen(
        [*FOREGROUND, *COMMAND, *arguments, "-o", str(tmp_path / "run.nc")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "ARMWRIGHT_CACHE_DIR": str(cache)},
    )
    end = time.monotonic() + 60.0
    while len(list(cache.glob("*.code"))) < 2 and time.monotonic() < end:  # the loop and its outputs are compiled
        time.sleep(0.05)
    time.sleep(1.0)  # until there are rows
    assert process.poll() is None, process.communicate()
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "wrote" in out
    assert error.startswith("armwright: note: stopped by Ctrl-C after ")
    assert "Traceback" not in error
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]
    assert 0.0 < float(load_run(tmp_path / "run.nc").time[-1]) < 100000.0


@pytest.mark.skipif(sys.platform == "win32", reason="pipes break differently there")
def test_a_reader_that_leaves_early(tmp_path):
    rows = "\n".join(["0,0,0,0,0,0"] * 20000)
    (tmp_path / "in.csv").write_text(rows)
    inverse = f'"{sys.executable}" -m armwright inverse-dynamics two-link "{tmp_path / "in.csv"}" | head -1'
    done = subprocess.run(inverse, shell=True, capture_output=True, text=True, check=False)
    assert done.stdout == "tau_shoulder [N m],tau_elbow [N m]\n"
    assert done.stderr == ""


FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
COMMANDS = [
    ("inverse-dynamics", "two-link", "in.csv"),
    ("simulate", "two-link", "--torque=0", "--duration=0.1"),
    ("info", "panda"),
]


@FULL
@pytest.mark.parametrize(
    "arguments", [*COMMANDS, ("robots",), ("--help",), ("inverse-dynamics", "--help"), ("--version",)]
)
@pytest.mark.parametrize("rows", [1, 20000])
@pytest.mark.sample(1)
def test_a_full_disk_behind_standard_output(arguments, rows, tmp_path):
    """Found at once or at the last flush: one line, no traceback."""
    (tmp_path / "in.csv").write_text("\n".join(["0,0,0,0,0,0"] * rows))
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False, cwd=tmp_path
        )
    assert done.stderr == "armwright: error: standard output: cannot be written: No space left on device\n"
    assert done.returncode == 2


@pytest.mark.sample(1)
@pytest.mark.skipif(sys.platform == "win32", reason="pipes break differently there")
@pytest.mark.parametrize("arguments", COMMANDS)
def test_a_reader_that_never_reads(arguments, tmp_path):
    """Quiet, and the exit code is that of any command that a broken pipe ends."""
    (tmp_path / "in.csv").write_text("\n".join(["0,0,0,0,0,0"] * 20000))
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*COMMAND, *arguments], stdout=write, stderr=subprocess.PIPE, text=True, check=False, cwd=tmp_path
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")
