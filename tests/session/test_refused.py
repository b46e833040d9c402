"""Wrong lines: an error in one line, the session as it was before, no file written."""

from __future__ import annotations

import pytest

import armwright as aw
from armwright import errors
from armwright.session import Session
from session.walks import refused

REFUSED = [  # line, place or file, value, reason where the expectation does not say it all
    ("inverse-amr", "", "inverse-amr", "no such command or variable"),
    ("thta = 1", "", "thta", "no such variable"),
    ("xyzzy", "", "xyzzy", "no such command or variable"),
    ("theta 1 2", "", "theta", "a variable"),
    ("theta = 1 2 3", "theta", "1 2 3", "3 values"),
    ("theta = 1 V", "theta", "1 V", "unit 'V' does not fit"),
    ("theta[7] = 1", "theta joint", 7, ""),
    ("theta[0] = 1", "theta joint", 0, ""),
    ("theta[elbow]", "theta joint", "elbow", "no such joint"),
    ("gravity[1] = 2", "gravity[1]", None, "one number"),
    ("gravity = 1 2", "gravity", "1 2", "2 values"),
    ("TimeStep = 0", "TimeStep", 0.0, ""),
    ("DACSampTimePeriod = -1 ms", "DACSampTimePeriod", -0.001, ""),
    ("simulate", "simulate start", None, "missing"),
    ("simulate new", "simulate steps", None, "missing"),
    ("simulate soon steps=1", "simulate start", "soon", ""),
    ("simulate continue steps=1", "simulate continue", None, "there is no simulation to continue"),
    ("simulate new steps=1.5", "simulate steps", "1.5", ""),
    ("simulate new steps=0", "simulate steps", "0", ""),
    ("simulate new schedule=none.csv", "simulate schedule", "none.csv", "no such file"),
    ("simulate new stps=1", "simulate argument", "stps", "unknown"),
    ("simulate new steps=10 every=7", "simulate every", 7, ""),
    ("torque = 1e308", "torque", "1e308", "the voltage of joint 'joint5' is not finite"),
    ("voltage = 1e308", "voltage", "1e308", "the torque of joint 'joint1' is not finite"),
    ("voltage[2] = 1e308", "voltage", "1e308", "the torque of joint 'joint2' is not finite"),
    ("omega = 1e308", "omega", "1e308", "the torque of joint 'joint1' is not finite"),
    ("show thta", "show name", "thta", "no such variable"),
    ("simulate new new", "simulate zero", "new", ""),
    ("simulate new steps=1 steps=2", "simulate steps", "2", "given twice"),
    ("energy 1", "energy argument", "1", "one word too many"),
    ("print-simulation", "print-simulation", None, "there is no simulation yet"),
    ("plot-simulation x.png", "plot-simulation", None, "there is no simulation yet"),
    ("write-graphic-file x.glb", "write-graphic-file", None, "there is no simulation yet"),
    ("save-simulation x.nc", "save-simulation", None, "there is no simulation yet"),
    ("close-output-file", "close-output-file", None, "no output file is open"),
    ("open-output-file", "open-output-file file", None, "missing"),
    ("open-output-file ''", "open-output-file file", None, "missing"),
    ("save ''", "save file", None, "missing"),
    ("controller fuzzy", "controller kind", "fuzzy", "no such controller"),
    ("controller joint-pid kp=1", "controller scale", None, "missing"),
    ("controller joint-pid scale=1", "controller joint-pid kp", None, "missing"),
    ("controller joint-pid kp=1 kf=2 scale=1", "controller joint-pid gain", "kf", "no such gain"),
    ("controller joint-pid kp=1 scale=0", "controller scale", "0", ""),
    ("controller joint-pid kp=1 scale=1V", "controller scale", "1 V", "unit 'V' does not fit"),
    ("payload com=1", "payload mass", None, "missing"),
    ("payload none 1", "payload argument", "1", "one word too many"),
    ("simulate new no none.csv 5", "simulate schedule", "none.csv", "no such file"),
    ("payload -1", "payload mass", -1.0, ""),
    ("payload 1 com=1", "payload com", "1", "1 value"),
    ('payload 1 inertia="1 0 0"', "payload inertia", "1 0 0", "no body has these principal moments"),
    ('payload 1 inertia="1 1 -1"', "payload inertia", "1 1 -1", "no body has these principal moments"),
    ("payload none com=1", "payload com", "1", "does not go with the rest"),
    ("save here.txt", "save file", "here.txt", ""),
    ("restore run.nc", "run.nc", None, "no session"),
    ("run-script none.sim", "none.sim", None, "no such file"),
    ("run-script self.sim", "self.sim:1: self.sim", None, "scripts call each other more than 20 deep"),
    ("run-script bytes.sim", "bytes.sim", None, "no text in UTF-8"),
    ("record off", "record off", None, "nothing is being recorded"),
    ("undo x", "undo steps", "x", "unknown name in 'x'"),
    ('plot-simulation "x', "", 'plot-simulation "x', "a quote is not closed"),
    ("help me", "help topic", "me", "no such command or variable"),
]
REFUSED_ELSEWHERE = [  # line, error of another room, part of its sentence
    ("simulate new schedule=other.csv", errors.ScheduleError, "column = 'shoulder': unknown"),
    ("simulate new schedule=half.csv", errors.ScheduleError, "column 'joint3': missing"),
    ("simulate new steps=1e15", errors.ScenarioError, "expected a shorter one, or recording.every above 1"),
    ("inverse-arm none.csv", errors.ScheduleError, "no such file"),
    ("inverse-arm half.csv", errors.ScheduleError, "half.csv:1: column"),
    ("open-output-file no/such/folder.txt", errors.OutputError, "there is no folder"),
    ("database-read pma560", errors.DescriptionError, "robot = 'pma560'"),
    ("database-read half.csv", errors.DescriptionError, "half.csv"),
    ("controller joint-pid kp=-1 scale=1", errors.ScenarioError, "kp of joint 'joint1' = -1.0: expected"),
    ("payload 1 frame=toe", errors.DescriptionError, "toe"),
    ("pose toe", errors.ModelError, "frame = 'toe': "),
    ("restore none.nc", errors.RunError, "no such file"),
    ("restore half.nc", errors.RunError, "cannot be read"),
    ("record no/such/folder.sim", errors.OutputError, "there is no folder"),
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


@pytest.mark.parametrize(("line", "where", "value", "what"), REFUSED, ids=[line for line, *_ in REFUSED])
def test_refused(line, where, value, what, place, monkeypatch):
    folder, session = place
    monkeypatch.chdir(folder)
    files = sorted(folder.iterdir())
    error = refused(session, line)
    assert isinstance(error, errors.SessionError)
    assert where in (error.place, error.file)
    assert (None if error.value is errors.ABSENT else error.value, error.what) == (value, what)
    assert error.what or error.expected
    assert sorted(folder.iterdir()) == files


@pytest.mark.parametrize(("line", "kind", "message"), REFUSED_ELSEWHERE, ids=[line for line, *_ in REFUSED_ELSEWHERE])
def test_refused_by_other_rooms(line, kind, message, place, monkeypatch):
    folder, session = place
    monkeypatch.chdir(folder)
    files = sorted(folder.iterdir())
    error = refused(session, line)
    assert isinstance(error, kind)
    assert message in str(error)
    assert sorted(folder.iterdir()) == files
