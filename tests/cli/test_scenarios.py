"""`armwright simulate FILE.scenario.toml`: what is shown of lanes and reducers, and what is refused before anything runs."""

import re

import numpy as np
import pytest

import armwright as aw
from cli.test_bad_input import refused
from cli.test_commands import run

SCENARIO = """
robot = "two-link"
duration_s = 0.05
solver.step_s = 1e-3
[loop.controller]
kind = "joint_pid"
kp = [10, 5]
kd = [1, 0.5]
[loop.reference]
kind = "pose"
q = [0.2, -0.1]
"""
LANES = """
[lanes]
kind = "list"
[lanes.vary]
"loop.controller.kp[0]" = {{ values = [{values}] }}
"""
RECORD = '[recording]\nwhat = "{what}"\nreduce = ["rms_error", "peak_torque"]\n'
SHOULDER = r"^shoulder +mean +(?P<mean>\S+).*\n +min +(?P<min>\S+).*\n +max +(?P<max>\S+)"


def scenario(folder, values=None, what=None):
    text = SCENARIO + ("" if what is None else RECORD.format(what=what))
    path = folder / "swing.scenario.toml"
    path.write_text(text + ("" if values is None else LANES.format(values=values)), encoding="utf-8")
    return path


def numbers(found):
    return {name: float(text.replace("−", "-")) for name, text in found.groupdict().items()}


def test_the_end_state_of_lanes_is_shown_as_statistics(tmp_path):
    path = scenario(tmp_path, "5, 10, 40")
    shown = run("simulate", path).stdout
    assert "in 3 lanes, compiled" in shown
    assert "at the end, t = 0.05 s, over 3 lanes\n" in shown
    assert re.search(r"^joint +over lanes +q \[rad\] +qd \[rad/s\] +tau \[N m\]$", shown, re.M)
    printed = numbers(re.search(SHOULDER, shown, re.M))
    q = aw.simulate(aw.read_scenario(path)).q.values[:, -1, 0]
    assert printed == pytest.approx({"mean": q.mean(), "min": q.min(), "max": q.max()}, rel=1e-4)


@pytest.mark.parametrize("what", ["none", "state"])
def test_a_lane_that_diverged_is_left_out_and_counted(tmp_path, what):
    path = scenario(tmp_path, "5, 1e300, 40", what)
    shown = run("simulate", path).stdout
    assert "in 3 lanes, of which 1 diverged or ran out of steps, compiled" in shown
    assert "over the 2 of 3 lanes that came to their end" in shown
    assert "∞" not in shown
    printed = numbers(re.search(SHOULDER, shown.partition("of the whole run")[2], re.M))
    errors = aw.simulate(aw.read_scenario(path)).rms_error.values[[0, 2], 0]
    assert printed == pytest.approx({"mean": errors.mean(), "min": errors.min(), "max": errors.max()}, rel=1e-4)
    assert ("at the end" in shown) == (what == "state")


def test_nothing_is_averaged_where_no_lane_came_to_its_end(tmp_path):
    shown = run("simulate", scenario(tmp_path, "1e300, 2e300")).stdout
    assert "at the end, t = 0.05 s: none of the 2 lanes came to its end" in shown


def test_reducers_of_a_single_run_are_shown(tmp_path):
    shown = run("simulate", scenario(tmp_path, what="none")).stdout
    assert re.search(r"^of the whole run\njoint +rms_error \[rad\] +peak_torque \[N m\]$", shown, re.M)
    assert "at the end" not in shown
    assert "over lanes" not in shown


@pytest.mark.parametrize(("option", "value"), [("--step", "1e-3"), ("--record-every", "1"), ("--duration", "1")])
def test_options_that_the_file_says_are_refused(tmp_path, option, value):
    message = refused(("simulate", scenario(tmp_path), option, value))
    assert f"swing.scenario.toml: {option}: the scenario file states this already" in message


def test_a_picture_of_no_rows_is_refused_before_the_run(tmp_path, monkeypatch):
    path = scenario(tmp_path, what="none")
    monkeypatch.setattr(aw, "simulate", lambda *_, **__: pytest.fail("it ran"))
    message = refused(("simulate", path, "-o", tmp_path / "run.nc", "--plot", tmp_path / "run.png"))
    assert "swing.scenario.toml: recording.what = 'none': expected" in message
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_recorded_lanes_are_drawn_and_saved(tmp_path):
    path, files = scenario(tmp_path, "5, 10", "state"), [tmp_path / "run.nc", tmp_path / "run.png"]
    run("simulate", path, "-o", files[0], "--plot", files[1])
    assert np.isfinite(aw.load_run(files[0]).rms_error.values).all()
    assert files[1].read_bytes().startswith(b"\x89PNG")
