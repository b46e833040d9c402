"""`armwright twin` and `armwright run-controller`: dry by default, exact in lock-step, one line where something is wrong."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.twin.twin import Twin

EXAMPLES = Path(__file__).parents[2] / "examples"
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


def holding(scenario, body):
    return replace(scenario, inputs=aw.Inputs(payload=body))


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


@pytest.mark.parametrize("options", [["--duration", 3.6], pytest.param([], marks=pytest.mark.study)])
def test_the_hand_takes_up_what_the_motion_grips(bus, options):
    """The grip, at 3.26 s; and the whole motion with its release."""
    files = [EXAMPLES / "bus-4ms.scenario.toml", "--reference", EXAMPLES / "motions" / "pick-and-place.motion.toml"]
    result = invoked("run-controller", *files, *options, "--bus", bus, "--go")
    assert result.exit_code == 0, result.output
    assert "those of the simulation, to the bit" in result.output


def test_in_lock_step_a_difference_is_no_success(file, bus, monkeypatch):
    """A twin with a body in its hand, of which the simulation knows nothing."""
    body = aw.Payload(0.1, 2.0, [0.0, 0.0, 0.1], [1e-3] * 3)
    monkeypatch.setattr("armwright.twin.twin.Twin", lambda given, *a, **k: Twin(holding(given, body), *a, **k))
    result = invoked("run-controller", file, "--bus", bus, "--go")
    assert result.exit_code == 1
    found = re.search(r"differs from the simulation from tick (\d+) on, at .* s: position of elbow is", result.output)
    assert int(found[1]) > 25  # the tick in which the hand takes it up
    assert "to the bit" not in result.output


def test_in_lock_step_a_fault_that_passes_is_no_success(file, bus):
    result = invoked("run-controller", file, "--bus", bus, "--go", "--fault", "lost-frames:elbow=3@0.1")
    assert result.exit_code == 1
    assert "differs from the simulation from tick 2" in result.output
    assert "faults were injected: lost-frames:elbow=3@0.1" in result.output


def test_a_twin_for_a_while(file, bus):
    result = invoked("twin", file, "--bus", bus, "--duration", 0.1, "--json")
    assert result.exit_code == 0, result.output
    tables = json.loads(result.stdout)["tables"]
    assert [row["state"] for row in tables[-1]["rows"]] == ["switch on disabled"] * 2


def test_a_twin_of_a_slower_run_is_pushed_later(file, bus, monkeypatch):
    made = []
    monkeypatch.setattr("armwright.twin.twin.Twin", lambda given, *a, **k: made.append(given) or Twin(given, *a, **k))
    push = '[inputs]\nwrench = "push.csv"\n'
    file.write_text(file.read_text(encoding="utf-8") + push, encoding="utf-8")
    rows = "t,fx,fy,fz,mx,my,mz\n0,0,0,0,0,0,0\n0.1,5,0,0,0,0,0\n"
    file.with_name("push.csv").write_text(rows, encoding="utf-8")
    result = invoked("twin", file, "--bus", bus, "--duration", 0.05, "--speed", 0.25)
    assert result.exit_code == 0, result.output
    assert made[0].inputs.wrench.times == pytest.approx([0.0, 0.4])
    assert invoked("twin", file, "--speed", 0).exit_code == 2


def test_data_sheets_are_written(file, tmp_path):
    from canopen.objectdictionary.eds import import_eds

    assert invoked("twin", file, "--write-eds", tmp_path / "sheets").exit_code == 0
    found = import_eds(str(tmp_path / "sheets" / "two-link-4.eds"), 4)
    assert found[0x1018][4].default == 1


def test_data_sheets_of_any_name_stay_in_their_folder(file, tmp_path):
    robot = tmp_path / "two.toml"
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text.replace('name = "two-link"', 'name = "../räum"', 1), encoding="utf-8")
    result = invoked("twin", file, "--write-eds", tmp_path / "sheets")
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "sheets").iterdir()) == ["_räum-3.eds", "_räum-4.eds"]
    refused = invoked("twin", file, "--write-eds", robot)
    assert refused.exit_code == 2
    assert "is no folder" in refused.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run-controller", "--bus", "serial:1"], "bus = 'serial:1': expected virtual"),
        (["run-controller", "--nodes", "3;4", "--go"], "--nodes = '3;4': expected whole numbers with commas"),
        (["run-controller", "--nodes", "3,200", "--go"], "nodes = [3, 200]: expected 2 different numbers"),
        (["twin", "--nodes", "3,200"], "--nodes = [3, 200]: expected 2 different numbers"),
        (["twin", "--serial-number", "-1"], "--serial-number = -1: expected a whole number of 32 bits"),
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
    assert result.exit_code == 1
    assert "node 4 of elbow is in state" in result.output
    assert "error 0x4310: motor too hot" in result.output


def test_ctrl_c_says_whether_the_arm_is_held(file, bus, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("armwright.twin.law.Law.command", interrupted)
    result = invoked("run-controller", file, "--bus", bus, "--go")
    assert result.exit_code == 130
    assert "--release" in result.output
