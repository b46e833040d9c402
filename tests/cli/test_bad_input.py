"""Bad input: one line on stderr that says what is wrong, exit code 2, no traceback and no file."""

import errno

import pytest
from typer.testing import CliRunner

from armwright.cli.app import app
from simulation.runs import mixed_file

SIMULATE = ("simulate", "two-link", "--torque", "0", "--duration", "0.1")

REFUSED = [
    (("simulat",), "No such command 'simulat'"),
    (("--colour",), "No such option: --colour"),
    (("simulate",), "Missing argument 'ROBOT|SCENARIO'"),
    (("simulate", "two-link", "--colour"), "No such option: --colour"),
    (("inverse-dynamics", "two-link"), "Missing argument 'IN.csv'"),
    (("info", "pma560"), "robot = 'pma560': not a built-in arm and not a file; did you mean puma560?"),
    (("info", "nowhere.toml"), "nowhere.toml: no such file"),
    (
        ("simulate", "two-link"),
        "two-link: no command given; expected --schedule FILE or --torque with one number for each joint [N m]",
    ),
    (("simulate", "two-link", "--torque", "0"), "error: --duration: expected a time above 0 [s]"),
    (
        ("simulate", "lwa4p", "--voltage", "1"),
        "lwa4p --voltage: joint 'joint1' is driven by current; expected --current",
    ),
    (("simulate", "cmu-dd", "--voltage", "1", "--torque", "1"), "--voltage and --torque given; expected --schedule"),
    (("simulate", "cmu-dd", "--voltage", "1", "--schedule", "v.csv"), "--voltage and --schedule given"),
    (
        ("simulate", "cmu-dd", "--voltage", "1,2", "--duration", "1"),
        "--voltage = '1,2': expected 6 numbers (joint1",
    ),
    (
        ("simulate", "cmu-dd", "--voltage", "", "--duration", "1"),
        "--voltage of joint 'joint1' = '': expected a finite number",
    ),
    (
        ("simulate", "cmu-dd", "--voltage", "nan", "--duration", "1"),
        "--voltage of joint 'joint1' = 'nan': expected a finite number [V]",
    ),
    (("simulate", "cmu-dd", "--voltage", "30deg", "--duration", "1"), "joint 'joint1' = '30deg'"),
    (("simulate", "cmu-dd", "--schedule", "nowhere.csv"), "nowhere.csv: no such file"),
    (
        (*SIMULATE, "--start", "1,up"),
        "--start of joint 'elbow' = 'up': expected a finite number [rad], such as 0.5, 30deg or pi/6",
    ),
    ((*SIMULATE, "--start", "pi/0"), "--start of joint 'shoulder' = 'pi/0'"),
    ((*SIMULATE, "--duration", "long"), "error: --duration = 'long': expected a valid number"),
    ((*SIMULATE, "--duration", "-1"), "error: --duration = -1.0: expected a time above 0 [s]"),
    ((*SIMULATE, "--duration", "1s"), "error: --duration = '1s': expected a valid number"),
    ((*SIMULATE, "--record-every", "2.5"), "error: --record-every = '2.5': expected a valid integer"),
    ((*SIMULATE, "--duration", "nan"), "duration = nan"),
    ((*SIMULATE, "--step", "0"), "error: --step = 0.0: expected a time above 0 [s]"),
    ((*SIMULATE, "--step", "0.03"), "--duration = 0.1: expected a multiple of --step = 0.03 s"),
    ((*SIMULATE, "--record-period", "0.03"), "--duration = 0.1: expected a multiple of --record-period = 0.03 s"),
    ((*SIMULATE, "--record-period", "1e-12"), "a --record-period longer than 1e-12 s"),
    ((*SIMULATE[:-1], "0.0105"), "of 0.001 s, the time from row to row; another --record-period changes it"),
    ((*SIMULATE, "--integrator", "rk5"), "error: --integrator = 'rk5': unknown"),
    (
        (*SIMULATE, "--step", "1e-3", "--accuracy", "1e-4"),
        "--accuracy = 0.0001: beside --step, which is taken as it is",
    ),
    ((*SIMULATE, "--record-every", "-1"), "error: --record-every = -1"),
    ((*SIMULATE, "--accuracy", "0"), "--accuracy = 0.0: expected a number of at least 1e-12 and below 1"),
    ((*SIMULATE, "--record-every", "1.5"), "--record-every = '1.5': expected a valid integer"),
    (
        (*SIMULATE, "-o", "run.xls"),
        "run.xls: the ending '.xls' is not offered; expected .nc, .csv, .parquet, .mcap or .mat",
    ),
    ((*SIMULATE, "-o", "nowhere/run.nc"), "nowhere/run.nc: there is no folder 'nowhere'"),
    ((*SIMULATE, "--plot", "run.gif"), "run.gif: the ending '.gif' is not offered; expected .png, .svg, .pdf or .html"),
    ((*SIMULATE, "-o", "run.nc", "--plot", "nowhere/run.png"), "nowhere/run.png: there is no folder"),
    (("simulate", "cmu-dd", "--voltage", "1", "--duration", "1", "--step", "0.1"), "--step = 0.1: too large"),
]


def refused(arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("armwright: error: ")
    first, *mistakes = result.stderr.splitlines()
    assert not mistakes or f": {len(mistakes)} mistakes" in first
    assert all(line.startswith("  ") for line in mistakes)
    return result.stderr


@pytest.mark.sample(10)
@pytest.mark.parametrize(
    ("arguments", "message"), REFUSED, ids=lambda value: " ".join(value) if isinstance(value, tuple) else ""
)
def test_refused(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in refused(arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,shoulder\n0,1\n", "volts.csv:1: column 'elbow': missing"),
        ("t,shoulder,elbow\n0,1,2\n1,2,3\n0.5,2,3\n", "volts.csv:4: column 't' = 0.5: earlier than 1 before it"),
        ("t,shoulder,elbow\n0,1,nan\n", "volts.csv:2: column 'elbow' = 'nan': expected a finite number"),
        ("t,shoulder,elbow\n0,1,much\n", "volts.csv:2: column 'elbow' = 'much': expected a finite number"),
        ("t,shoulder [V],elbow\n0,1,2\n", "volts.csv:1: unit of column 'shoulder' = 'V': expected N m"),
    ],
)
def test_bad_schedules(text, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "volts.csv").write_text(text)
    assert message in refused(("simulate", "two-link", "--schedule", "volts.csv", "--duration", "1", "-o", "run.nc"))
    assert [entry.name for entry in tmp_path.iterdir()] == ["volts.csv"]


@pytest.mark.parametrize("command", ["inverse-dynamics", "forward-dynamics"])
def test_bad_tables(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.csv").write_text("1,2,3\n")
    message = refused((command, "two-link", "in.csv", "-o", "out.csv"))
    assert "in.csv:1: 3 columns; expected 6 columns: q_shoulder, q_elbow" in message
    (tmp_path / "in.csv").write_text("1,2,3,4,5,6\n")
    assert "nowhere/out.csv: there is no folder" in refused((command, "two-link", "in.csv", "-o", "nowhere/out.csv"))
    assert [entry.name for entry in tmp_path.iterdir()] == ["in.csv"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg = 2\n", "", "mass_kg: missing"),
        ("mass_kg = 2\n", "mass_kg = -2\n", "mass_kg = -2"),
        ("mass_kg = 2\n", "mass_lb = 2\n", "unknown key; did you mean mass_kg?"),
        ("torque_constant_n_m_per_a = 0.2\n", "", "needs motor.torque_constant_n_m_per_a"),
        ("[[joints]]", "[[joints", "not TOML"),
    ],
)
def test_bad_robots(old, new, message, tmp_path):
    path = mixed_file(tmp_path)
    path.write_text(path.read_text().replace(old, new, 1))
    error = refused(("simulate", path, "--command", "0", "--duration", "0.1", "-o", tmp_path / "run.nc"))
    assert message in error
    assert "lathe.toml" in error
    assert not (tmp_path / "run.nc").exists()


@pytest.mark.parametrize(
    ("integrator", "said"),
    [
        ("rk3", "diverged to infinite numbers or NaN at t = "),
        ("auto", "ran out of substeps, as qd of shoulder asked for more"),
    ],
)
def test_a_simulation_that_diverges(integrator, said, tmp_path):
    command = ("simulate", "two-link", "--torque", "1e9", "--duration", "5", "--integrator", integrator)
    assert said in refused((*command, "-o", tmp_path / "run.nc"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "not enough memory\n"),
        (MemoryError("Unable to allocate 7.28 TiB for an array"), "not enough memory: Unable to allocate 7.28 TiB"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), "not enough memory\n"),
        (OSError(errno.EIO, "Input/output error", "/dev/odd"), "/dev/odd: Input/output error"),
    ],
)
def test_what_the_machine_cannot_do(error, message, monkeypatch):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("armwright.simulation.simulation.simulate", fail)
    monkeypatch.setattr("armwright.simulate", fail, raising=False)
    assert message in refused(SIMULATE)


def test_a_word_of_any_length_is_one_short_line():
    assert len(refused(("x" * 100_000,))) < 3000
