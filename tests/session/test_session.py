"""What the session computes is what the Python functions compute; torque and voltage are tied; undo, save and record keep."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import armwright as aw
from armwright.control import JointPID
from armwright.errors import RunError, ScenarioError
from armwright.session import Session
from armwright.session.arguments import same, words
from armwright.session.commands import COMMANDS, TABLE as ALL_COMMANDS
from armwright.session.listing import Drawing, Sheet, TextLine, significant
from armwright.session.simulation import at_dac_ticks
from armwright.session.variables import TABLE as ALL_VARIABLES, VARIABLES
from armwright.simulation.inputs.schedule import Schedule
from pictures.reading import Page
from raises_at import raises_at
from session.walks import refused, write_files

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
    return " ".join(part.text for part in shown if isinstance(part, TextLine))


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
    scenario = aw.Scenario(
        aw.load("cmu-dd"), command=[5, 4, 3, 2, 1, 0], duration=0.1, start=aw.Start(numbers(Q), numbers(QD)),
        solver=aw.Solver(step=1e-3),
    )  # fmt: skip
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


def test_the_dac_holds_its_voltage(session):
    rows = Schedule(np.array([0.0, 0.001, 0.0031, 0.006]), np.arange(4.0)[:, None], ("j",))
    assert at_dac_ticks(rows, 0.002).times.tolist() == [0.0, 0.002, 0.004, 0.006]
    assert at_dac_ticks(rows, 0.002).commands[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert at_dac_ticks(rows, 0.005).times.tolist() == [0.0, 0.005, 0.010]
    assert at_dac_ticks(rows, 0.005).commands[:, 0].tolist() == [0.0, 2.0, 3.0]
    on_ticks = Schedule(np.array([0.0, 0.002]), np.zeros((2, 1)), ("j",))
    assert at_dac_ticks(on_ticks, 0.001) is on_ticks


def test_a_controller_follows_dacout(session):
    session.run('controller joint-pid kp=300 kd=40 scale="10 deg"')
    session.run("DACOut = 0.5 0 1 0 0 0")
    session.run("DACSampTimePeriod = 2 ms")
    session.run("simulate new zero=yes steps=100")
    asked = np.deg2rad([5, 0, 10, 0, 0, 0])
    law = JointPID(kp=300.0, kd=40.0)
    scenario = aw.Scenario(
        aw.load("cmu-dd"),
        duration=0.1,
        loop=aw.Loop(controller=law, reference=asked, period=0.002),
        solver=aw.Solver(substeps=2),
    )
    assert np.array_equal(session.state.run["q"].values, aw.simulate(scenario)["q"].values)
    assert np.allclose(session.state.run["q_reference"].values, asked, rtol=1e-12)
    assert refused(session, "simulate new steps=3").place == "simulate steps"


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


@pytest.mark.sample(1)
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


def test_gravity_is_the_report_s(session):
    """v̇₀ = [0 0 g]: below 0 where z₀ points down, as in cmu-dd, which hangs; `arm.gravity` is free fall."""
    assert VARIABLES["gravity"].get(session.state) == -9.80621
    assert session.state.arm.gravity.tolist() == [0.0, 0.0, 9.80621]
    assert VARIABLES["gravity"].get(Session("puma560").state) == 9.81
    session.run("gravity = -1.62")
    assert session.state.arm.gravity.tolist() == [0.0, 0.0, 1.62]
    moon = Session("two-link")
    moon.run("gravity = 1.62")
    assert moon.state.arm.gravity.tolist() == [0.0, -9.81, -1.62]
    session.run("theta = 0")
    session.run("theta[2] = 1 deg")
    session.run("omega = 0")
    session.run("voltage = 0")
    session.run("forward-arm")
    assert session.state.qdd[1] < 0.0  # it swings back to where it hangs


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
    assert "payload: 2 kg at (0, 0, 0.05) m" in texts(session.run("payload"))
    session.run("payload none")
    assert texts(session.run("payload")) == "the hand is empty"
    session.run("inverse-arm")
    assert np.array_equal(session.state.u, empty)


def test_undo_goes_back_and_keeps_what_was_not_undone(session):
    before = session.state
    session.run("theta = 1")
    session.run("simulate new steps=5")
    session.run("undo 2")
    assert session.state is before
    assert refused(session, "undo 99").place == "undo steps"


@pytest.mark.study
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
    for name in ("q", "qd", "qdd", "u", "dac", "dac_period", "step", "controller"):
        assert np.all(getattr(other.state, name) == getattr(session.state, name)), name
    assert other.state.run.equals(session.state.run)
    for one in (session, other):
        one.run("simulate continue steps=10")
    assert np.array_equal(other.state.run["q"].values, session.state.run["q"].values)
    assert other.state.lines == tuple(line for line in session.state.lines if not line.startswith("save"))
    assert aw.load_run("here.nc")["q"].shape == (21, 6)


def test_a_saved_arm_needs_no_file_and_names_none_that_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(
        aw.robotfiles.to_toml(aw.load("two-link").record).replace("mass_kg = 4.0", "mass_kg = 3.0")
    )
    session = Session("arm.toml")
    session.run("theta = 0.1 0.2")
    session.run("save here.nc")
    Path("arm.toml").write_text("t,root\n")
    run = aw.load_run("here.nc")
    other = Session("two-link")
    other.run("restore here.nc")
    np.testing.assert_array_equal(other.state.arm.inertial_parameters, session.state.arm.inertial_parameters)
    saved = json.loads(run.attrs["armwright_session"])
    saved["record"]["text"] = saved["record"]["text"].replace("mass_kg = 3.0", "mass_kg = 4.0")
    run.attrs["armwright_session"] = json.dumps(saved)
    aw.save(run, "there.nc")
    with raises_at(RunError, "record", "checksum"):
        other.run("restore there.nc")


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
    assert refused(session, "print-simulation what=omega").place == "columns"
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
    for line, what in (
        ("python 1/0", "ZeroDivisionError"), ("python for", "SyntaxError"),
        ("python torque = 1; voltage = 2", "torque and voltage were both set"),
        ("python if 1:", "the statement is not finished"), ("python", "no terminal"),
    ):  # fmt: skip
        error = refused(session, line)
        assert error.place == "python"
        assert error.what.startswith(what)


def test_an_unstable_step_is_told_and_the_session_lives():
    session = Session()
    session.run("TimeStep = 0.5")
    error = refused(session, "simulate new steps=10")
    assert isinstance(error, ScenarioError)
    assert error.place == "TimeStep"
    assert re.fullmatch(r"0\.00[125] s", error.expected)  # rules and substeps are not a session's to choose
    session.run("TimeStep = 1 ms")
    session.run("simulate new steps=10")


def test_voltages_of_an_arm_without_motor_constants():
    assert refused(Session("panda"), "voltage = 1").expected == "torque, its command"
    assert refused(Session("lwa4p"), "DACOut = 1").expected == "current, its command"


def test_what_is_not_finite_is_refused_without_a_warning():
    session = Session()
    session.run("omega = 1e300")
    assert refused(session, "inverse-arm").expected == "smaller theta, omega and alpha"
    assert refused(session, "forward-arm").expected == "smaller theta, omega and voltage"


def test_blanks_around_signs_and_before_units_are_as_nothing(session):
    assert words("simulate new steps = 100 schedule =x.csv every= 2") == [
        *("simulate", "new", "steps=100", "schedule=x.csv", "every=2"),
    ]
    assert words("print-simulation 0 0.1 20 ms step=5 s") == ["print-simulation", "0", "0.1", "20 ms", "step=5 s"]
    assert words("run-script m") == ["run-script", "m"]
    session.run("payload 500 g com = '0 0 1 cm'")
    assert session.state.loaded.payload.mass == 0.5
    assert session.state.loaded.payload.com == (0.0, 0.0, 0.01)


def test_a_part_of_a_simulation_is_drawn(session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session.run("simulate new steps=5")
    (drawing,) = session.run("plot-simulation what=theta,current joints=2,joint5")
    assert isinstance(drawing, Drawing)
    assert (drawing.joints, drawing.quantities) == (["joint2", "joint5"], ["q", "current"])
    session.run("plot-simulation run.html what=voltage joints=3")
    page = Page(tmp_path / "run.html")
    assert [entry["name"] for entry in page.plot["legend"]] == ["joint3"]
    assert [panel["symbol"] for panel in page.plot["panels"]] == ["V"]
    assert refused(session, "plot-simulation what=volts").value == "volts"
    assert refused(session, "plot-simulation joints=elbow").value == "elbow"


def test_one_variable_is_shown_as_by_its_name(session):
    assert session.run("show theta") == session.run("theta")


def test_prompts_are_those_of_the_report_and_arguments_answer_them():
    asked = []
    answers = iter(["maybe", "new", "", "none", "", "x", "20"])

    def ask(argument, default):
        asked.append(argument.name)
        return next(answers)

    shown = []
    session = Session(ask=ask)
    session.show = shown.append
    session.run("simulate")
    assert asked == ["start", "start", "zero", "schedule", "steps", "steps", "steps"]
    assert [part.text.split()[:2] for part in shown] == [
        ["simulate", "start"],
        ["simulate", "steps:"],
        ["simulate", "steps"],
    ]
    assert session.state.lines[-1] == "simulate start=new steps=20"


def test_no_more_answers_drop_the_command():
    def ask(argument, default):
        raise EOFError

    session = Session(ask=ask)
    assert refused(session, "simulate").what == "not done"


@pytest.mark.study
def test_an_interrupted_run_is_kept_in_part_and_named(monkeypatch, tmp_path):
    session = Session(ask=lambda argument, default: "")
    session.show = lambda shown: None
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
    monkeypatch.chdir(tmp_path)
    for line in ("open-output-file out.csv", "print-simulation", "plot-simulation p.html", "plot-simulation p.svg"):
        session.run(line)
    for line in ("write-graphic-file g.html", "write-graphic-file g.glb"):
        session.run(line)
    assert (tmp_path / "out.csv").read_text().startswith("t of a partial run [s],")
    for file in ("p.html", "p.svg", "g.html", "g.glb"):
        assert "interrupted after" in (tmp_path / file).read_bytes().decode("latin-1"), file


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
    text = texts(shown)
    assert command.summary in text
    first = command.example.split()[0]
    assert same(first) == same(command.name)
    assert COMMANDS[same(command.name)] is command
    assert bool(command.equation) == bool(command.source)
    if command.equation:
        assert command.equation in text
        assert command.source in text
    assert words(command.example)


def test_every_source_that_is_named_is_listed():
    listed = (Path(__file__).parents[2] / "docs" / "references.md").read_text(encoding="utf-8")
    keys = {key for entry in (*ALL_COMMANDS, *ALL_VARIABLES) for key in re.findall(r"\[(\w+)\]", entry.source)}
    assert len(keys) > 5
    assert not [key for key in keys if f"**{key}.**" not in listed]


@pytest.mark.parametrize("variable", ALL_VARIABLES, ids=lambda variable: variable.name)
def test_every_variable_says_all_of_itself(variable):
    text = texts(HELPED.run(f"help {variable.name}"))
    assert variable.meaning in text
    assert variable.equation
    assert variable.source
    assert variable.equation in text
    assert variable.source in text
    HELPED.run(variable.name.replace("S", "_S").lower() if variable.name.startswith("DAC") else variable.name)


HELPED = Session()
