"""A simulation continued is one long simulation: drives, controllers and time go on, whatever the drives remember."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.session import Session
from armwright.session.listing import TextLine
from simulation.plants import ELASTIC, LUGRE, MOTOR, SUPPLY, THERMAL, chain

PID = "controller joint-pid kp=40 ki=80 kd=3"
LAWS = {
    "voltage": "controller none",
    "pid": f'{PID} scale="10 deg"',
    "pid-filtered": f'{PID} cutoff_hz=60 anti_windup=back-calculation tracking_time=0.1 scale="10 deg"',
    "pid-delayed": f'{PID} delay_ticks=2 anti_windup=clamping limit=12 scale="10 deg"',
    "cascade": 'controller cascade position_kp=8 speed_kp=4 speed_ki=20 scale="10 deg"',
    "computed-torque": 'controller computed-torque kp=80 kd=16 ki=20 scale="10 deg"',
}
NAMES = ",".join(aw.load("two-link").names)
STATES = {"current", "bristle", "motor_q", "motor_qd", "winding_temperature", "housing_temperature", "bus_voltage"}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Two joints whose drives remember what drives can: currents, bristles, a motor behind a spring, heat, the bus."""
    motor = {**MOTOR, "inductance_h": 1e-3}
    joints = [
        {"command": "voltage", "friction": LUGRE, "motor": motor, "limits": {"voltage_v": 40.0}},
        {"command": "voltage", "friction": LUGRE, "motor": {**motor, "thermal": THERMAL}, "elasticity": ELASTIC},
    ]
    path = tmp_path_factory.mktemp("robot") / "rich.toml"
    description = chain(joints, robot={"supply": SUPPLY}).description
    assert description is not None
    aw.robotfiles.write_toml(description, path)
    return str(path)


def begun(robot, law):
    session = Session(robot)
    for line in ("theta = 0.2 -0.1", "TimeStep = 0.5 ms", "DACSampTimePeriod = 2 ms", law, "DACOut = 20 -12"):
        session.run(line)
    return session


def notes(session):
    return session.state.run.attrs["notes"]


@pytest.mark.study
@pytest.mark.parametrize("law", LAWS)
def test_one_second_and_another_are_two(robot, law):
    whole, parts = begun(robot, LAWS[law]), begun(robot, LAWS[law])
    whole.run("simulate new steps=4000")
    for line in ("simulate new steps=2000", "simulate continue steps=1200", "simulate continue steps=800"):
        parts.run(line)
    one, joined = whole.state.run, parts.state.run
    assert set(one.data_vars) >= STATES
    np.testing.assert_allclose(joined["time"], one["time"], rtol=0, atol=1e-12)
    for name in one.data_vars:
        size = max(float(np.abs(one[name]).max()), 1e-3)
        np.testing.assert_allclose(joined[name], one[name], rtol=0, atol=1e-12 * size, err_msg=str(name))
    assert "anew" not in notes(parts)
    assert np.ptp(one["bristle"].values) > 1e-5


def test_it_goes_on_from_a_file(robot, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session, other = begun(robot, LAWS["pid-filtered"]), Session("two-link")
    session.run("simulate new steps=400")
    session.run("save half.nc")
    other.run("restore half.nc")
    for one in (session, other):
        one.run("simulate continue steps=400")
    for name in STATES | {"q", "qd", "u"}:
        assert session.state.run[name].identical(other.state.run[name]), name


def test_drives_go_on_under_other_gravity_and_other_commands(robot):
    session = begun(robot, LAWS["voltage"])
    session.run("voltage = 20 -15")
    session.run("simulate new steps=400")
    before = session.state.run
    for line in ("gravity = -1.62", "payload 0.5", "voltage = 3", "simulate continue steps=2"):
        session.run(line)
    for name in STATES | {"q", "qd"}:
        np.testing.assert_array_equal(session.state.run[name][-3], before[name][-1], err_msg=name)
    assert float(abs(session.state.run["qdd"][-3] - before["qdd"][-1]).min()) > 1.0  # another world
    assert "anew" not in notes(session)
    expected = [f"{what} was changed at t = 0.2 s, between two parts of the run" for what in ("gravity", "payload")]
    assert [note for note in notes(session).splitlines() if "was changed" in note] == expected
    session.run("simulate continue steps=2")
    assert notes(session).count("was changed") == 2


def test_a_joint_beyond_its_limits_is_told_once_at_the_time_of_the_whole_run():
    whole, parts = Session(), Session()
    for session in (whole, parts):
        session.run("voltage = 8 12 8 4 2 1")
    whole.run("simulate new steps=2000")
    for line in ("simulate new steps=1000", "simulate continue steps=1000"):
        parts.run(line)
    assert sorted(notes(parts).splitlines()) == sorted(notes(whole).splitlines())
    assert "joint3: passed its position limits [-2.88, 2.88] at t = 1.541 s" in notes(parts)


def test_what_goes_on_is_given_by_place_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "volts.csv").write_text("t,shoulder,elbow\n0,1,2\n0.01,0,0\n".replace("shoulder,elbow", NAMES))
    session = Session("two-link")
    for line, end in (
        ("simulate new yes 10", 0.01), ("simulate continue 10", 0.02), ("simulate continue volts.csv 5", 0.025),
        ("simulate new no volts.csv 7", 0.007), ("simulate continue none 3", 0.01),
    ):  # fmt: skip
        session.run(line)
        assert float(session.state.run["time"][-1]) == pytest.approx(end, abs=1e-12), line
    assert session.state.lines[-2] == "simulate start=new schedule=volts.csv steps=7"


def test_what_does_not_go_on_is_told(robot):
    session = begun(robot, LAWS["pid"])
    session.run("simulate new steps=40")
    session.run(LAWS["pid"].replace("ki=80", "ki=81"))
    session.run("simulate continue steps=40")
    assert "the state of joint-pid began anew at t = 0.02 s" in notes(session)
    session.run("simulate continue steps=40")
    assert "began anew at t = 0.04 s" not in notes(session)
    session.run("theta[1] = 0.7")
    session.run("simulate continue steps=40")
    for memory in ("what the drives remember besides theta and omega", "the state of joint-pid"):
        assert f"{memory} began anew at t = 0.06 s" in notes(session)
    assert "theta or omega was set at t = 0.06 s" in notes(session)
    session.run("controller none")
    session.run("simulate continue steps=40")
    assert session.state.run.attrs["controller_settings"] == ""
    assert "began anew at t = 0.08 s" not in notes(session)


@pytest.mark.study
def test_notes_on_limits_are_those_of_the_whole_run(robot):
    session = begun(robot, LAWS["voltage"])
    session.run("simulate new steps=20")
    session.run("voltage[1] = 100")
    said = [
        [text for text in texts(session.run("simulate continue steps=20")) if "is coarse" not in text] for _ in range(3)
    ]
    clipped = (
        "joint0: the drive's limits clipped its voltage in {} of the rows, first at t = 0.01 s (asked for up to 100 V)"
    )
    assert said == [[clipped.format(f"{share:.0%}")] for share in (21 / 41, 41 / 61, 61 / 81)]
    assert [note for note in notes(session).splitlines() if "is coarse" not in note] == [clipped.format("75%")]


def texts(shown):
    return [part.text for part in shown if isinstance(part, TextLine) and part.style == "note"]


def test_another_time_step_continues_drives_and_schedule(robot, tmp_path, monkeypatch):
    """Times of a schedule count from where the part begins, whatever the time steps before it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "volts.csv").write_text("t,joint0,joint1\n0,8,-3\n0.004,2,1\n0.008,0,0\n")
    session = begun(robot, LAWS["voltage"])
    for line in ("simulate new steps=21", "TimeStep = 0.4 ms", "DACSampTimePeriod = 0.4 ms"):
        session.run(line)
    before = session.state.run
    session.run("simulate continue volts.csv")
    run = session.state.run
    for name in STATES | {"q", "qd"}:
        np.testing.assert_array_equal(run[name][21], before[name][-1], err_msg=name)
    np.testing.assert_allclose(run["time"][[20, 21, 22, -1]], [0.01, 0.0105, 0.0109, 0.0185], rtol=1e-12)
    np.testing.assert_array_equal(run["u"][[21, 30, 31, 40]], [[8, -3], [8, -3], [2, 1], [2, 1]])
    assert "anew" not in notes(session)
    session.run("simulate continue volts.csv")
    again = session.state.run
    np.testing.assert_allclose(again["time"][[-1]], [0.0265], rtol=1e-12)
    np.testing.assert_array_equal(again["u"][[41, 50, 51, 60]], [[8, -3], [8, -3], [2, 1], [2, 1]])


def test_another_sampling_time_begins_the_controller_anew_and_says_so(robot):
    session = begun(robot, LAWS["pid"])
    session.run("simulate new steps=40")
    before = session.state.run
    for line in ("DACSampTimePeriod = 1 ms", "simulate continue steps=40"):
        session.run(line)
    assert "the state of joint-pid began anew at t = 0.02 s" in notes(session)
    for name in STATES | {"q", "qd"}:
        np.testing.assert_array_equal(session.state.run[name][10], before[name][-1], err_msg=name)
    session.run("simulate continue steps=40")
    assert float(session.state.run["time"][-1]) == pytest.approx(0.06)


def test_a_joined_run_is_a_start_in_python(robot, tmp_path, monkeypatch):
    """Also where another time step has the ticks counted anew."""
    monkeypatch.chdir(tmp_path)
    session = begun(robot, LAWS["voltage"])
    for line in ("simulate new steps=20", "TimeStep = 0.25 ms", "simulate continue steps=20", "save-simulation run.nc"):
        session.run(line)
    run = aw.load_run("run.nc")
    after = aw.simulate(
        aw.Scenario(session.state.arm, command=session.state.u, duration=5e-3, start=run, solver=aw.Solver(step=2.5e-4))
    )
    session.run("simulate continue steps=20")
    for name in STATES | {"q", "qd"}:
        np.testing.assert_array_equal(after[name], session.state.run[name][-21:], err_msg=name)


def test_a_run_without_the_state_of_its_end_continues_from_theta_and_omega(robot):
    """As of a file that an earlier version saved."""
    session = begun(robot, LAWS["pid"])
    session.run("simulate new steps=40")
    session.state = session.state.replace(run=session.state.run.drop_vars("loop_state"))
    session.run("simulate continue steps=40")
    for memory in ("what the drives remember besides theta and omega", "the state of joint-pid"):
        assert f"{memory} began anew at t = 0.02 s" in notes(session)
