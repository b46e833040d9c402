"""`armwright plot`: runs in the terminal, as pictures and as pages."""

import pytest

import armwright as aw
from cli.test_commands import run
from simulation.runs import invented


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Two runs of an arm, and one of another, in the folder that commands run in."""
    monkeypatch.chdir(tmp_path)
    arm = aw.load("two-link")
    aw.save(invented(arm), "before.nc")
    aw.save(invented(arm, rows=21), "after.nc")
    aw.save(invented(aw.load("cmu-dd")), "other.nc")
    return tmp_path


def test_in_the_terminal(runs):
    shown = run("plot", "before.nc").stdout
    for title in ("Joint angles [rad]", "Joint velocities [rad/s]", "Motor torques, joint side [N m]"):
        assert title in shown
    assert "⠤" in shown
    assert all(f"\n{name}" in shown for name in aw.load("two-link").names)


def test_chosen_joints_and_quantities(runs):
    shown = run("plot", "before.nc", "after.nc", "--joints", "elbow", "--quantities", "qd, u").stdout
    assert "shoulder" not in shown
    assert "Joint angles" not in shown
    assert shown.index("Joint velocities") < shown.index("Drive commands")
    assert "after.nc" in shown


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["all.html", "all.png", "all.svg", "all.pdf"])
def test_files(runs, name):
    assert run("plot", "before.nc", "after.nc", "-o", name).stdout == f"wrote {name}\n"
    assert (runs / name).stat().st_size > 5000


def test_runs_of_one_name_are_told_apart_by_their_folder(runs):
    (runs / "old").mkdir()
    (runs / "before.nc").rename(runs / "old" / "after.nc")
    shown = run("plot", "old/after.nc", "after.nc", "--quantities", "q").stdout
    assert "old/after.nc" in shown


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("gone.nc",), "gone.nc: no such file; expected a run saved as .nc"),
        (("before.nc", "other.nc"), "other.nc joints = ['joint1'"),
        (("before.nc", "before.nc"), "before.nc: named twice"),
        (("before.nc", "--joints", "elbo"), "before.nc joint = 'elbo': no such joint; did you mean elbow?"),
        (("before.nc", "--quantities", "q,,u"), "--quantities = 'q,,u': an empty name"),
        (("before.nc", "-o", "x.gif"), "x.gif: the ending '.gif' is not offered; expected .png, .svg, .pdf or .html"),
        ((), "Missing argument 'RUN"),
    ],
)
def test_refused(runs, arguments, words):
    before = sorted(entry.name for entry in runs.iterdir())
    done = run("plot", *arguments, code=2)
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(entry.name for entry in runs.iterdir()) == before


def test_a_file_that_is_no_run(runs):
    (runs / "text.nc").write_text("hello")
    assert "text.nc: cannot be read as a run" in run("plot", "text.nc", code=2).stderr
