"""What the session computes is what the Python functions compute; torque and voltage are tied; undo, save and record keep."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armwright as aw
from armwright.control import JointPID
from armwright.errors import ArmwrightError
from armwright.session import Session
from armwright.session.arguments import words
from armwright.session.commands import COMMANDS
from armwright.session.commands import TABLE as ALL_COMMANDS
from armwright.session.listing import Line, Sheet, significant
from armwright.session.simulation import held
from armwright.session.variables import TABLE as ALL_VARIABLES
from armwright.session.variables import VARIABLES, same
from armwright.simulation.schedule import Schedule
from session.walks import write_files

Q, QD, QDD = "0.1 0.2 -0.3 0.4 0.5 -0.6", "0.3 -0.2 0.1 1 -1 2", "1 2 3 -3 -2 -1"


@pytest.fixture
def session():
    session = Session()
    for name, values in (("theta", Q), ("omega", QD), ("alpha", QDD)):
        session.run(f"{name} = {values}")
    return session


def numbers(text):
    return np.array([float(word) for word in text.split()])


def column(shown, head):
    """The cells of a sheet's column."""
    sheet = next(part for part in shown if isinstance(part, Sheet))
    k = next(k for k, own in enumerate(sheet.heads) if own.startswith(head))
    return [row[k] for row in sheet.rows]


def texts(shown):
    return " ".join(part.text for part in shown if isinstance(part, Line))


def test_the_inverse_arm_is_the_functions_to_the_last_digit(session):
    shown = session.run("inverse-arm")
    arm = aw.load("cmu-dd")
    tau = aw.compile(arm).inverse_dynamics(numbers(Q), numbers(QD), numbers(QDD))
    voltage = aw.motor_voltage(arm, numbers(QD), tau)
    assert np.array_equal(session.state.u, voltage)
    assert column(shown, "voltage") == [significant(v) for v in voltage]
    assert column(shown, "torque") == [significant(t) for t in aw.motor_torque(arm, numbers(QD), voltage)]
    assert np.allclose(aw.motor_torque(arm, numbers(QD), voltage), tau, rtol=1e-12)


def test_the_forward_arm_is_the_functions_to_the_last_digit(session):
    session.run("voltage = 5 4 3 2 1 0")
    shown = session.run("forward-arm")
    alpha = aw.compile(aw.load("cmu-dd")).forward_arm(numbers(Q), numbers(QD), np.arange(5.0, -1.0, -1.0))
    assert np.array_equal(session.state.qdd, alpha)
    assert column(shown, "alpha") == [significant(a) for a in alpha]


def test_forward_undoes_inverse(session):
    session.run("inverse-arm")
    session.run("forward-arm")
    assert np.allclose(session.state.qdd, numbers(QDD), rtol=1e-9)


def test_energy_pose_and_jacobian_are_the_functions(session):
    arm, q, qd = aw.load("cmu-dd"), numbers(Q), numbers(QD)
    assert column(session.run("energy"), "[J]")[:2] == [significant(float(e)) for e in aw.energy(arm, q, qd)]
    dyn = aw.compile(arm)
    assert column(session.run("pose"), "position") == [significant(p) for p in dyn.forward_kinematics(q)[:3, 3]]
    frame = next(iter(arm.frames))
    jacobian = dyn.jacobian(q, frame=frame)
    assert column(session.run(f"jacobian {frame}"), "joint1") == [significant(x) for x in jacobian[:, 0]]


def test_a_simulation_is_the_functions_to_the_bit(session):
    session.run("voltage = 5 4 3 2 1 0")
    session.run("simulate new steps=100")
    scenario = aw.Scenario(aw.load("cmu-dd"), command=[5, 4, 3, 2, 1, 0], duration=0.1, q0=numbers(Q), qd0=numbers(QD))
    run = aw.simulate(scenario)
    for name in ("q", "qd", "tau", "voltage", "current"):
        assert np.array_equal(session.state.run[name].values, run[name].values), name
    assert np.array_equal(session.state.q, run["q"].values[-1])


def test_a_continued_simulation_is_one_long_one(session):
    session.run("voltage = 5 4 3 2 1 0")
    session.run("simulate new steps=100")
    whole = session.state.run
    session.run("undo")
    for start in ("new", "continue", "continue"):
        session.run(f"simulate {start} steps={60 if start == 'new' else 20}")
    joined = session.state.run
    assert np.allclose(joined["time"].values, whole["time"].values, rtol=0, atol=1e-15)
    assert np.array_equal(joined["q"].values, whole["q"].values)
    assert np.array_equal(joined["tau"].values, whole["tau"].values)


def test_a_continuation_says_what_began_anew(session):
    session.run('controller joint-pid kp=300 kd=40 scale="10 deg"')
    session.run("simulate new steps=20")
    assert "the state of joint-pid began anew at t = 0.02 s" in texts(session.run("simulate continue steps=10"))
    session.run("theta = 0")
    assert "theta or omega was set at t = 0.03 s" in texts(session.run("simulate continue steps=10"))


def test_the_dac_holds_its_voltage(session):
    rows = Schedule(np.array([0.0, 0.001, 0.0031, 0.006]), np.arange(4.0)[:, None], ("j",))
    assert held(rows, 0.002).times.tolist() == [0.0, 0.002, 0.004, 0.006]
    assert held(rows, 0.002).commands[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert held(rows, 0.005).times.tolist() == [0.0, 0.005, 0.010]
    assert held(rows, 0.005).commands[:, 0].tolist() == [0.0, 2.0, 3.0]
    on_ticks = Schedule(np.array([0.0, 0.002]), np.zeros((2, 1)), ("j",))
    assert held(on_ticks, 0.001) is on_ticks


def test_a_controller_follows_dacout(session):
    session.run('controller joint-pid kp=300 kd=40 scale="10 deg"')
    session.run("DACOut = 0.5 0 1 0 0 0")
    session.run("DACSampTimePeriod = 2 ms")
    session.run("simulate new zero=yes steps=100")
    asked = np.deg2rad([5, 0, 10, 0, 0, 0])
    law = JointPID(kp=300.0, kd=40.0)
    scenario = aw.Scenario(
        aw.load("cmu-dd"), controller=law, reference=asked, sample_period=0.002, substeps=2, duration=0.1
    )
    assert np.array_equal(session.state.run["q"].values, aw.simulate(scenario)["q"].values)
    assert np.allclose(session.state.run["q_reference"].values, asked, rtol=1e-12)
    assert "no whole number" in refused(session, "simulate new steps=3")


@given(st.lists(st.floats(-80, 80), min_size=6, max_size=6), st.lists(st.floats(-5, 5), min_size=6, max_size=6))
def test_voltage_torque_voltage_is_the_same_voltage(volts, speeds):
    session = TIED
    session.run(f"omega = {' '.join(map(repr, speeds))}")
    session.run(f"voltage = {' '.join(map(repr, volts))}")
    torque = VARIABLES["torque"].get(session.state)
    session.run(f"torque = {' '.join(repr(float(t)) for t in torque)}")
    assert np.allclose(VARIABLES["voltage"].get(session.state), volts, rtol=1e-12, atol=1e-12)


TIED = Session()


def test_the_voltage_is_what_is_stored(session):
    session.run("voltage = 10")
    before = VARIABLES["torque"].get(session.state)
    session.run("omega = 0")
    assert VARIABLES["voltage"].get(session.state).tolist() == [10.0] * 6
    assert np.abs(VARIABLES["torque"].get(session.state) - before).min() > 0.0
    session.run("dac_out[3] = 4")
    assert VARIABLES["voltage"].get(session.state)[2] == 4.0


@pytest.mark.parametrize("robot", ["panda", "lwa4p", "two-link", "puma560"])
def test_every_drive_stores_its_own_command(robot):
    session = Session(robot)
    session.run("omega = 0.2")
    session.run("alpha = 1")
    session.run("inverse-arm")
    session.run("forward-arm")
    assert np.allclose(session.state.qdd, 1.0, rtol=1e-9)
    tau = session.state.loaded.dyn.inverse_dynamics(session.state.q, session.state.qd, np.ones(session.state.arm.n))
    assert np.allclose(VARIABLES["torque"].get(session.state), tau, rtol=1e-12)


def test_gravity_is_the_z_component(session):
    session.run("gravity = -1.62")
    assert session.state.arm.gravity.tolist() == [0.0, 0.0, -1.62]
    moon = Session("two-link")
    moon.run("gravity = -1.62")
    assert moon.state.arm.gravity.tolist() == [0.0, -9.81, -1.62]


def test_a_payload_is_felt_and_taken_out(session):
    session.run("omega = 0")
    session.run("alpha = 0")
    session.run("inverse-arm")
    empty = session.state.u
    session.run('payload 2 com="0 0 5 cm"')
    session.run("inverse-arm")
    jacobian = aw.jacobian(session.state.arm, session.state.q)
    placed = aw.forward_kinematics(session.state.arm, session.state.q)
    lever = placed[:3, :3] @ [0.0, 0.0, 0.05]
    weight = 2.0 * np.asarray(session.state.arm.gravity)
    expected = -jacobian.T @ np.concatenate([weight, np.cross(lever, weight)])
    stall = np.array([body.drive.torque_constant / body.drive.resistance for body in session.state.arm.bodies])
    assert np.allclose((session.state.u - empty) * stall, expected, atol=1e-9)
    session.run("payload none")
    session.run("inverse-arm")
    assert np.array_equal(session.state.u, empty)


def test_undo_goes_back_and_keeps_what_was_not_undone(session):
    before = session.state
    session.run("theta = 1")
    session.run("simulate new steps=5")
    session.run("undo 2")
    assert session.state is before
    assert "at most" in refused(session, "undo 99")


def test_what_is_saved_comes_back(session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for line in (
        "gravity = -3.7",
        'payload 1 com="0 0 1 cm"',
        "voltage = 3",
        "TimeStep = 0.5 ms",
        "simulate new steps=20",
    ):
        session.run(line)
    session.run('controller computed-torque kp=100 kd=20 scale="10 deg"')
    session.run("DACOut = 1 2 3 4 5 6")
    session.run("save here.nc")
    other = Session("two-link")
    other.run("restore here.nc")
    for name in ("q", "qd", "qdd", "u", "dac", "dac_period", "step", "wiring"):
        assert np.all(getattr(other.state, name) == getattr(session.state, name)), name
    assert other.state.run.equals(session.state.run)
    for one in (session, other):
        one.run("simulate continue steps=10")
    assert np.array_equal(other.state.run["q"].values, session.state.run["q"].values)
    assert other.state.lines == tuple(line for line in session.state.lines if not line.startswith("save"))
    assert aw.load_run("here.nc")["q"].shape == (21, 6)


def test_a_recorded_session_replays_to_the_same_bits(session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path)
    session.run("record day.sim")
    for line in (
        "theta = 9",
        "undo",
        "simulate new schedule=volts.csv",
        "python omega = omega / 3",
        "simulate continue steps=7",
    ):
        session.run(line)
    again = Session("two-link")
    again.run("run-script day.sim")
    assert again.state.lines[1:] == session.state.lines
    assert again.state.run.identical(session.state.run)
    for name in ("q", "qd", "qdd", "u"):
        assert np.array_equal(getattr(again.state, name), getattr(session.state, name))


def test_printed_files_hold_the_runs_own_numbers(session, tmp_path, monkeypatch):
    import pandas

    monkeypatch.chdir(tmp_path)
    session.run("simulate new steps=10")
    session.run("open-output-file rows.csv")
    session.run('print-simulation 2e-3 8e-3 "2 ms" what=theta')
    session.run("print-simulation start=0.009 what=theta")
    rows = pandas.read_csv("rows.csv")
    assert np.array_equal(rows.values[:, 1:], session.state.run["q"].values[[2, 4, 6, 8, 9, 10]])
    assert "holds the columns" in refused(session, "print-simulation what=omega")
    session.run("close-output-file")
    session.run("open-output-file rows.txt")
    session.run("print-simulation what=theta")
    text = (tmp_path / "rows.txt").read_text().splitlines()
    assert text[0] == "theta [rad]"
    assert len({len(line) for line in text[1:13]}) == 1  # aligned


def test_python_knows_the_same_names(session):
    assert (
        texts(session.run("python print(np.array_equal(theta, session.state.q), arm.n, gravity)")) == "True 6 -9.80621"
    )
    session.run("python theta[2] = 1; voltage = 2.0")
    assert session.state.q[2] == 1.0
    assert session.state.u.tolist() == [2.0] * 6
    assert session.state.lines[-1] == "voltage = 2.0 2.0 2.0 2.0 2.0 2.0"
    for line, message in (
        ("python 1/0", "ZeroDivisionError"), ("python theta = [1, 2]", "has shape (2,)"), ("python for", "invalid syntax"),
        ("python torque = 1; voltage = 2", "are tied"), ("python if 1:", "not finished"), ("python", "nobody is there"),
        ("python gravity = 'x'", "expected one number"), ("python theta = np.nan", "nan"),
    ):  # fmt: skip
        assert message in refused(session, line)


def refused(session, line):
    """The error of a line, in one line; the session is as it was before."""
    before, past = session.state, session.past
    with pytest.raises(ArmwrightError) as error:
        session.run(line)
    assert session.state is before
    assert session.past == past
    assert "\n" not in str(error.value)
    return str(error.value)


REFUSED = [
    ("inverse-amr", "did you mean inverse-arm?"),
    ("thta = 1", "did you mean theta?"),
    ("xyzzy", "help lists all there are"),
    ("theta 1 2", "is a variable; expected theta = …"),
    ("theta = 1 2 3", "3 values; expected 6"),
    ("theta = 1 V", "does not fit"),
    ("theta[7] = 1", "joints count from 1 to 6"),
    ("theta[0] = 1", "joints count from 1 to 6"),
    ("theta[elbow]", "no joint 'elbow'"),
    ("gravity[1] = 2", "is one number"),
    ("gravity = 1 2", "2 values"),
    ("TimeStep = 0", "expected a time above 0 s"),
    ("DACSampTimePeriod = -1 ms", "expected a time above 0 s"),
    ("simulate", "start is missing"),
    ("simulate new", "steps is missing"),
    ("simulate soon steps=1", "expected new or continue"),
    ("simulate continue steps=1", "there is no simulation to continue"),
    ("simulate new steps=1.5", "expected a whole number"),
    ("simulate new steps=0", "expected a whole number"),
    ("simulate new schedule=none.csv", "none.csv: no such file"),
    ("simulate new schedule=other.csv", "unknown column 'shoulder'"),
    ("simulate new schedule=half.csv", "expected 7 columns"),
    ("simulate new stps=1", "unknown argument 'stps'"),
    ("simulate new new", "expected yes or no"),
    ("simulate new steps=1 steps=2", "given twice"),
    ("energy 1", "one word too many"),
    ("print-simulation", "there is no simulation yet"),
    ("plot-simulation x.png", "there is no simulation yet"),
    ("write-graphic-file x.glb", "there is no simulation yet"),
    ("save-simulation x.nc", "there is no simulation yet"),
    ("inverse-arm none.csv", "no such file"),
    ("inverse-arm half.csv", "half.csv: line"),
    ("close-output-file", "no output file is open"),
    ("open-output-file no/such/folder.txt", "there is no folder"),
    ("open-output-file", "file is missing"),
    ("database-read pma560", "no robot 'pma560'"),
    ("database-read half.csv", "half.csv"),
    ("controller fuzzy", "no 'fuzzy'"),
    ("controller joint-pid kp=1", "scale is missing"),
    ("controller joint-pid scale=1", "kp is missing"),
    ("controller joint-pid kp=1 kf=2 scale=1", "no gain 'kf'"),
    ("controller joint-pid kp=-1 scale=1", "kp of joint 'joint1' is -1"),
    ("controller joint-pid kp=1 scale=0", "asks for nothing"),
    ("controller joint-pid kp=1 scale=1V", "does not fit"),
    ("payload", "mass is missing"),
    ("payload -1", "expected 0 or more"),
    ("payload 1 com=1", "expected 3"),
    ("payload 1 frame=toe", "toe"),
    ("payload none com=1", "does not go with the rest"),
    ("pose toe", "no frame 'toe'"),
    ("save here.txt", "expected a name that ends in .nc"),
    ("restore none.nc", "no such file"),
    ("restore half.nc", "cannot be read"),
    ("restore run.nc", "holds no session"),
    ("run-script none.sim", "no such file"),
    ("run-script self.sim", "deep"),
    ("run-script bytes.sim", "no text in UTF-8"),
    ("record no/such/folder.sim", "there is no folder"),
    ("record off", "nothing is being recorded"),
    ("undo x", "unknown name"),
    ('plot-simulation "x', "a quote is not closed"),
    ("help me", "no command or variable 'me'"),
]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    (folder / "other.csv").write_text("t,shoulder,elbow\n0,1,2\n")
    (folder / "half.csv").write_text("t,joint1,joint2\n0,1")
    (folder / "half.nc").write_bytes(b"\x89HDF\r\n\x1a\n half")
    (folder / "self.sim").write_text("run-script self.sim\n")
    (folder / "bytes.sim").write_bytes(b"\xff\xfe\x00")
    scenario = aw.Scenario(aw.load("two-link"), command=[0.0, 0.0], duration=0.01)
    aw.save(aw.simulate(scenario), folder / "run.nc")
    return folder, Session()


@pytest.mark.parametrize(("line", "message"), REFUSED, ids=[line for line, _ in REFUSED])
def test_refused(line, message, place, monkeypatch):
    folder, session = place
    monkeypatch.chdir(folder)
    files = sorted(folder.iterdir())
    assert message in refused(session, line)
    assert sorted(folder.iterdir()) == files


def test_an_unstable_step_is_told_and_the_session_lives():
    session = Session()
    session.run("TimeStep = 0.5")
    assert "a step of" in refused(session, "simulate new steps=10")
    session.run("TimeStep = 1 ms")
    session.run("simulate new steps=10")


def test_voltages_of_an_arm_without_motor_constants():
    assert "expected torque" in refused(Session("panda"), "voltage = 1")
    assert "expected current" in refused(Session("lwa4p"), "DACOut = 1")


def test_prompts_are_those_of_the_report_and_arguments_answer_them():
    asked = []
    answers = iter(["maybe", "new", "", "none", "", "x", "20"])

    def ask(argument, default):
        asked.append(argument.name)
        return next(answers)

    told = []
    session = Session(ask=ask)
    session.tell = told.append
    session.run("simulate")
    assert asked == ["start", "start", "zero", "schedule", "steps", "steps", "steps"]
    assert len(told) == 2
    assert session.state.lines[-1] == "simulate start=new steps=20"


def test_no_more_answers_drop_the_command():
    def ask(argument, default):
        raise EOFError

    session = Session(ask=ask)
    assert "not done" in refused(session, "simulate")


def test_an_interrupted_run_is_kept_in_part_and_named(monkeypatch):
    session = Session(ask=lambda argument, default: "")
    session.tell = lambda shown: None
    session.run("voltage = 2")

    def progress(done, steps):
        if 0 < done < steps:
            raise KeyboardInterrupt

    session.progress = progress
    shown = session.run("simulate new zero=yes every=100 steps=1000000")
    session.progress = None
    run = session.state.run
    assert "interrupted after" in run.attrs["partial"]
    assert "partial" in texts(shown)
    line = session.state.lines[-1]
    again = Session()
    again.run("voltage = 2")
    again.run(line)
    assert np.array_equal(again.state.run["q"].values, run["q"].values)
    assert "partial run" in session.run("print-simulation what=theta")[0].title


def test_a_script_that_is_interrupted_changes_nothing():
    session = Session()
    before = session.state

    def progress(done, steps):
        raise KeyboardInterrupt

    session.progress = progress
    with pytest.raises(KeyboardInterrupt):
        session.run("simulate new steps=1000")
    assert session.state is before


@pytest.mark.parametrize("command", ALL_COMMANDS, ids=lambda command: command.name)
def test_every_command_says_all_of_itself(command):
    shown = HELPED.run(f"help {command.name}")
    told = texts(shown)
    assert command.summary in told
    first = command.example.split()[0]
    assert same(first) == same(command.name)
    assert COMMANDS[same(command.name)] is command
    assert bool(command.equation) == bool(command.source)
    if command.equation:
        assert command.equation in told
        assert command.source in told
    assert words(command.example)


def test_every_source_that_is_named_is_listed():
    listed = (Path(__file__).parents[2] / "docs" / "references.md").read_text(encoding="utf-8")
    keys = {key for entry in (*ALL_COMMANDS, *ALL_VARIABLES) for key in re.findall(r"\[(\w+)\]", entry.source)}
    assert len(keys) > 5
    assert not [key for key in keys if f"**{key}.**" not in listed]


@pytest.mark.parametrize("variable", ALL_VARIABLES, ids=lambda variable: variable.name)
def test_every_variable_says_all_of_itself(variable):
    assert variable.meaning in texts(HELPED.run(f"help {variable.name}"))
    HELPED.run(variable.name.replace("S", "_S").lower() if variable.name.startswith("DAC") else variable.name)


HELPED = Session()
