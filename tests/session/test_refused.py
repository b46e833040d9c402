"""Lines that are wrong: told in one line, the session as it was before, no file written."""

from __future__ import annotations

import pytest

import armwright as aw
from armwright.session import Session
from session.walks import refused

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
    ("simulate new steps=10 every=7", "every = 7 does not divide the 10 steps"),
    ("simulate new steps=1e15", "expected a shorter one, or every above 1"),
    ("torque = 1e308", "the voltage of joint 'joint5' is not finite"),
    ("voltage = 1e308", "the torque of joint 'joint1' is not finite"),
    ("voltage[2] = 1e308", "the torque of joint 'joint2' is not finite"),
    ("omega = 1e308", "the torque of joint 'joint1' is not finite"),
    ("show thta", "did you mean theta?"),
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
    ("payload com=1", "mass is missing"),
    ("payload none 1", "one word too many"),
    ("simulate new no none.csv 5", "schedule = none.csv: no such file"),
    ("payload -1", "expected 0 or more"),
    ("payload 1 com=1", "expected 3"),
    ("payload 1 frame=toe", "toe"),
    ('payload 1 inertia="1 0 0"', "no body has these principal moments"),
    ('payload 1 inertia="1 1 -1"', "no body has these principal moments"),
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
