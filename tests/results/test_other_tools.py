"""Runs for other programs: MCAP read by the mcap libraries, .mat by scipy, and a recording that goes back into a fit."""

from __future__ import annotations

import importlib.util
import json
import re

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import OutputError, RunError
from armwright.results.mat_file import KEYWORDS, matlab_names
from raises_at import raises_at

LOG = """
joints = ["joint1", "joint2"]
[files.log]
path = "run.mcap"
topic = "/joint_states"
[time]
column = "stamp"
[[signals]]
quantity = "position"
columns = ["position/joint1", "position/joint2"]
unit = "rad"
side = "joint"
[[signals]]
quantity = "torque"
columns = ["effort/joint1", "effort/joint2"]
unit = "N m"
side = "joint"
held = true
"""


@pytest.fixture(scope="module")
def run():
    """A loop with encoders, whose controller follows a ramp."""
    ramp = aw.trajectories.Ramp(np.zeros(2), 0.2 * np.ones(2), 0.1)
    loop = aw.Loop(aw.JointPID(kp=50.0, kd=5.0), ramp, 1e-3, sensors=aw.Sensors(counts=4096))
    return aw.simulate(aw.Scenario(aw.load("two-link"), 0.05, loop=loop))


def messages(path):
    """(topic → [(log time, message)], topic → schema); ROS 2 messages decoded by mcap_ros2, JSON by json."""
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    factory, found, schemas = decoder.DecoderFactory(), {}, {}
    with open(path, "rb") as file:
        for schema, channel, message in reader.make_reader(file, validate_crcs=True).iter_messages():
            if channel.message_encoding == "cdr":
                value = factory.decoder_for("cdr", schema)(message.data)
            else:
                value = json.loads(message.data)
            found.setdefault(channel.topic, []).append((message.log_time, value))
            schemas[channel.topic] = schema
    return found, schemas


def test_joint_states_have_every_bit(tmp_path, run):
    aw.save(run, tmp_path / "run.mcap")
    found, schemas = messages(tmp_path / "run.mcap")
    sides = {"/joint_states": "", "/measured/joint_states": "_measured", "/reference/joint_states": "_reference"}
    for topic, ending in sides.items():
        assert schemas[topic].name == "sensor_msgs/msg/JointState"
        assert schemas[topic].encoding == "ros2msg"
        rows = [message for _, message in found[topic]]
        assert rows[0].name == list(run["joint"].values)
        fields = {"position": f"q{ending}", "velocity": f"qd{ending}", "effort": f"tau{ending}"}
        for field, name in fields.items():
            values = np.array([getattr(row, field) for row in rows])
            expected = run[name].values if name in run else np.zeros((run.sizes["time"], 0))
            np.testing.assert_array_equal(values, expected)
        stamps = [row.header.stamp.sec * 10**9 + row.header.stamp.nanosec for row in rows]
        assert stamps == [time for time, _ in found[topic]] == [round(1e9 * t) for t in run["time"].values]


def test_other_signals_are_json_with_units(tmp_path, run):
    aw.save(run, tmp_path / "run.mcap")
    found, schemas = messages(tmp_path / "run.mcap")
    for name in ("qdd", "u", "u_issued"):
        values = np.array([list(message.values()) for _, message in found[f"/signals/{name}"]])
        np.testing.assert_array_equal(values, run[name].values)
    schema = json.loads(schemas["/signals/qdd"].data)
    assert schemas["/signals/qdd"].encoding == "jsonschema"
    assert schema["properties"][str(run["joint"].values[0])]["description"] == "rad/s²"
    times = {name for name, each in run.data_vars.items() if "time" in each.dims}
    states = {f"{field}{end}" for field in ("q", "qd", "tau") for end in ("", "_measured", "_reference")}
    assert {topic for topic in found if "signals" in topic} == {f"/signals/{name}" for name in times - states}


def test_lanes_have_topics_of_their_own_and_nan_is_null(tmp_path):
    arm = aw.load("two-link")
    run = aw.simulate(aw.Scenario(arm, 0.01, np.zeros(2), start=aw.Start(aw.Batch(np.array([[0.1, 0.2], [0.3, 0.4]])))))
    run["qdd"][1, 2, 0] = np.nan
    aw.save(run, tmp_path / "run.mcap")
    found, _ = messages(tmp_path / "run.mcap")
    for lane in (0, 1):
        positions = np.array([message.position for _, message in found[f"/lane{lane}/joint_states"]])
        np.testing.assert_array_equal(positions, run["q"].values[lane])
    assert found["/lane1/signals/qdd"][2][1][arm.names[0]] is None


@pytest.mark.parametrize("names", [["a"], ["joint", "é2"], ["a" * k for k in range(1, 12)]])
def test_names_of_any_length_keep_the_alignment(tmp_path, names):
    """Doubles of CDR stand on multiples of 8, behind texts of any length."""
    run = aw.simulate(aw.Scenario(aw.load("two-link"), 0.01, np.zeros(2))).isel(joint=[0] * len(names))
    run = run.assign_coords(joint=names, kind=("joint", ["revolute"] * len(names)))
    aw.save(run, tmp_path / "run.mcap")
    found, _ = messages(tmp_path / "run.mcap")
    last = found["/joint_states"][-1][1]
    assert last.name == names
    np.testing.assert_array_equal([last.position, last.effort], [run["q"].values[-1], run["tau"].values[-1]])


@pytest.mark.study
def test_a_recorded_mcap_goes_back_into_a_fit(tmp_path):
    pytest.importorskip("mcap_ros2.decoder")
    arm = aw.load("two-link")
    rng = np.random.default_rng(3)
    a, b = 0.3 * rng.normal(size=(2, 2, 5))
    motion = aw.trajectories.Fourier(np.array([0.3, -0.2]), a, b, 4.0)
    loop = aw.Loop(aw.ComputedTorque(kp=100.0, kd=20.0), motion, 2e-3)
    aw.save(aw.simulate(aw.Scenario(arm, 8.0, loop=loop)), tmp_path / "run.mcap")
    (tmp_path / "run.log.toml").write_text(LOG.replace("joint1", arm.names[0]).replace("joint2", arm.names[1]))
    found = aw.identification.identify_arm(
        aw.identification.read_log(tmp_path / "run.log.toml"), arm, record=False, checks=()
    )
    assert found.verdict == "identified", str(found)
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    np.testing.assert_allclose(found.fit.values, truth, rtol=2e-3, atol=2e-3 * np.abs(truth).max())


def test_matlab_has_names_units_and_columns(tmp_path, run):
    aw.save(run, tmp_path / "run.mat")
    found = loadmat(tmp_path / "run.mat", simplify_cells=True)
    raw = loadmat(tmp_path / "run.mat")
    np.testing.assert_array_equal(raw["t"], run["time"].values[:, None])
    for name in ("q", "qd", "tau", "q_measured", "u_issued"):
        np.testing.assert_array_equal(raw[name], run[name].values)
    assert list(found["joint"]) == list(run["joint"].values)
    assert list(found["units"]["qdd"]) == ["rad/s²"] * 2
    assert found["units"]["t"] == "s"
    assert found["about"]["robot"] == "two-link"
    assert found["about"]["step_s"] == run.attrs["step_s"]
    assert set(run.variables) - {"time"} <= set(found)


def test_matlab_stacks_lanes_behind_joints(tmp_path):
    start = aw.Start(aw.Batch(np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])))
    run = aw.simulate(aw.Scenario(aw.load("two-link"), 0.01, np.zeros(2), start=start))
    aw.save(run, tmp_path / "run.mat")
    q = loadmat(tmp_path / "run.mat")["q"]
    assert q.shape == (run.sizes["time"], 2, 3)
    np.testing.assert_array_equal(q[:, 1, 2], run["q"].values[2, :, 1])


def test_names_are_those_of_matlab():
    names = ["joint 1.q", "joint_1_q", "end", "2nd", "_x", "é", "a" * 70, "a" * 69 + "b", "t", ""]
    found = matlab_names(names, ("t",))
    assert len(set(found)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z]\w{0,62}", name, re.ASCII) for name in found)
    assert not {*found} & ({*KEYWORDS} | {"t"})
    assert found[0] == "joint_1_q"


def command(*arguments, code=0):
    result = CliRunner().invoke(app, [str(each) for each in arguments])
    assert result.exit_code == code, result.output
    return result.output


def test_convert_and_simulate_write_them(tmp_path, run):
    pytest.importorskip("mcap")
    aw.save(run, tmp_path / "run.nc")
    for ending in ("mcap", "mat", "csv"):
        command("convert", tmp_path / "run.nc", "-o", tmp_path / f"run.{ending}")
        aw.save(aw.load_run(tmp_path / "run.nc"), tmp_path / f"saved.{ending}")
    assert (tmp_path / "run.mcap").read_bytes() == (tmp_path / "saved.mcap").read_bytes()
    assert (tmp_path / "run.csv").read_bytes() == (tmp_path / "saved.csv").read_bytes()
    command("simulate", "two-link", "--torque", "0", "--duration", "0.01", "-o", tmp_path / "free.mcap")
    assert "/joint_states" in messages(tmp_path / "free.mcap")[0]


def test_refusals_are_one_line(tmp_path, run, monkeypatch):
    aw.save(run, tmp_path / "run.nc")
    (tmp_path / "bad.nc").write_bytes(b"no run")
    cases = [
        (("convert", tmp_path / "run.nc", "-o", tmp_path / "run.toml"), "the ending '.toml' is not offered"),
        (("convert", tmp_path / "none.nc", "-o", tmp_path / "run.mcap"), "no such file"),
        (("convert", tmp_path / "bad.nc", "-o", tmp_path / "run.mcap"), "cannot be read as a run"),
        (("convert", tmp_path / "run.nc", "-o", tmp_path / "run.nc"), "is read, and would be replaced"),
        (("convert", tmp_path / "run.nc", "-o", tmp_path / "x.mat", "--smoothing", "0.1"), "goes with a robot file"),
        (("convert", "cmu-dd", "-o", tmp_path / "run.mcap"), "the ending '.mcap' is not offered"),
    ]
    for arguments, expected in cases:
        shown = command(*arguments, code=2).strip()
        assert expected in shown
        assert "\n" not in shown
    early = run.assign_coords(time=run["time"].values - 1.0)
    with raises_at(OutputError, "time", "0 to 2147483647 s", value=-1.0):
        aw.save(early, tmp_path / "early.mcap")
    with pytest.raises(RunError):
        aw.save(run.drop_dims("time"), tmp_path / "none.mcap")
    assert not list(tmp_path.glob("*.mcap"))
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "mcap" else find(name))
    with pytest.raises(OutputError, match=r"pip install armwright\[logs\]"):
        aw.save(run, tmp_path / "run.mcap")
