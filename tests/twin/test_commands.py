"""`armwright twin` and `armwright run-controller`: dry by default, exact in lock-step, one line where something is wrong."""

import json

import pytest
from typer.testing import CliRunner

from armwright.cli.app import app

SCENARIO = """
robot = "two.toml"
duration_s = 0.2

[start]
q = [-1.2, 0.0]

[loop]
period_s = 4e-3

[loop.controller]
kind = "cascade"
position_kp = 15.0
speed_kp = [700.0, 160.0]
speed_ki = [7000.0, 1600.0]
delay_ticks = 1

[loop.reference]
kind = "pose"
q = [-1.19, 0.01]

[loop.sensors]
side = "link"
counts = 360000
velocity = "difference"

[loop.timing]
preset = "one-tick"
"""


@pytest.fixture
def file(arm_file, tmp_path):
    (tmp_path / "two.toml").write_text(arm_file.read_text(encoding="utf-8"), encoding="utf-8")
    path = tmp_path / "arm.scenario.toml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


def invoked(*arguments):
    return CliRunner().invoke(app, [str(each) for each in arguments])


def test_by_default_nothing_is_sent(file, monkeypatch):
    monkeypatch.setattr("can.Bus", None)  # nobody opens one
    result = invoked("run-controller", file)
    assert result.exit_code == 0, result.output
    assert "dry run: nothing was sent" in result.output
    assert "load" in result.output


def test_in_lock_step_it_is_the_simulation(file, bus):
    result = invoked("run-controller", file, "--bus", bus, "--go")
    assert result.exit_code == 0, result.output
    assert "those of the simulation, to the bit" in result.output


def test_a_twin_for_a_while(file, bus):
    result = invoked("twin", file, "--bus", bus, "--duration", 0.1, "--json")
    assert result.exit_code == 0, result.output
    tables = json.loads(result.stdout)["tables"]
    assert [row["state"] for row in tables[-1]["rows"]] == ["switch on disabled"] * 2


def test_data_sheets_are_written(file, tmp_path):
    from canopen.objectdictionary.eds import import_eds

    assert invoked("twin", file, "--eds", tmp_path / "sheets").exit_code == 0
    found = import_eds(str(tmp_path / "sheets" / "two-link-4.eds"), 4)
    assert found[0x1018][4].default == 1


def test_data_sheets_of_any_name_stay_in_their_folder(file, tmp_path):
    robot = tmp_path / "two.toml"
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text.replace('name = "two-link"', 'name = "../räum"', 1), encoding="utf-8")
    result = invoked("twin", file, "--eds", tmp_path / "sheets")
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "sheets").iterdir()) == ["_räum-3.eds", "_räum-4.eds"]
    refused = invoked("twin", file, "--eds", robot)
    assert refused.exit_code == 2
    assert "is no folder" in refused.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run-controller", "--bus", "serial:1"], "bus = 'serial:1': expected virtual"),
        (["run-controller", "--nodes", "3;4", "--go"], "--nodes = '3;4': expected whole numbers with commas"),
        (["run-controller", "--nodes", "3,200", "--go"], "nodes = [3, 200]: expected 2 different numbers"),
        (["twin", "--nodes", "3,200"], "--nodes = [3, 200]: expected 2 different numbers"),
        (["twin", "--serial", "-1"], "--serial = -1: expected a whole number of 32 bits"),
        (["run-controller", "--speed", "2"], "--speed = 2.0: expected a number above 0 and at most 1"),
        (["run-controller", "--bus", "socketcan:nocan7", "--go"], "bus = 'socketcan:nocan7': cannot be opened"),
        (["twin", "--bus", "socketcan:nocan7"], "bus = 'socketcan:nocan7': cannot be opened"),
        (["twin", "--fault", "rust"], "fault = 'rust'"),
    ],
)
def test_bad_input_is_one_line(file, arguments, message):
    command, *options = arguments
    result = invoked(command, file, *options)
    assert result.exit_code == 2
    assert message in result.output
    assert "Traceback" not in result.output


def test_a_fault_is_one_line_too(file, bus):
    result = invoked("run-controller", file, "--bus", bus, "--go", "--fault", "over-temperature:elbow@0.1")
    assert result.exit_code == 2
    assert "node 4 of elbow is in state" in result.output
    assert "error 0x4310: motor too hot" in result.output
