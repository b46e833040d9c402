"""`armwright animate`: a run as an arm that moves."""

import numpy as np
import pytest

import armwright as aw
from armwright.pictures.posed_arm import upright
from cli.test_commands import run
from pictures.gltf_rules import Gltf
from pictures.playing import pose_of
from simulation.runs import invented


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A run, and one of several lanes, in the folder that commands run in."""
    monkeypatch.chdir(tmp_path)
    arm = aw.load("two-link")
    aw.save(invented(arm), "run.nc")
    aw.save(invented(arm, lanes=3), "batch.nc")
    aw.save(invented(arm.replace(name="mine")), "unnamed.nc")
    return tmp_path


def test_glb_is_what_the_function_writes(folder):
    assert run("animate", "two-link", "run.nc", "-o", "run.glb").stdout == "wrote run.glb\n"
    arm, recorded = aw.load("two-link"), aw.load_run("run.nc")
    aw.animate(recorded, arm, "same.glb")
    assert (folder / "run.glb").read_bytes() == (folder / "same.glb").read_bytes()
    gltf = Gltf((folder / "run.glb").read_bytes())
    hand = pose_of(gltf, "run", f"tip {arm.tip}", 2.0)
    expected = aw.forward_kinematics(arm, recorded["q"].values[-1])[:3, 3]
    assert np.abs(hand[[0, 2, 1], 3] * [1, -1, 1] - upright(arm) @ expected).max() < 1e-5


def test_a_built_in_arm_need_not_be_named(folder):
    run("animate", "run.nc", "-o", "one.glb")
    run("animate", "two-link", "run.nc", "-o", "two.glb")
    assert (folder / "one.glb").read_bytes() == (folder / "two.glb").read_bytes()


def test_the_arm_of_a_scenario_file_need_not_be_named(folder):
    text = aw.robotfiles.to_toml(aw.load("two-link")).replace('name = "two-link"', 'name = "mine"')
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    text = 'robot = "mine.toml"\nduration_s = 0.1\n[commands]\nconstant = 0\n'
    (folder / "mine.scenario.toml").write_text(text, encoding="utf-8")
    run("simulate", "mine.scenario.toml", "-o", "mine.nc")
    run("animate", "mine.toml", "mine.nc", "-o", "named.glb")
    (folder / "mine.toml").unlink()
    run("animate", "mine.nc", "-o", "kept.glb")
    assert (folder / "kept.glb").read_bytes() == (folder / "named.glb").read_bytes()


def test_a_lane_as_a_page(folder):
    run("animate", "two-link", "batch.nc", "--lane", "2", "-o", "lane.html")
    text = (folder / "lane.html").read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>")
    assert "lane 2" in text


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("panda", "run.nc", "-o", "x.glb"), "the run is of two-link; expected those of panda"),
        (("two-link", "batch.nc", "-o", "x.glb"), "lane: the run has 3 lanes; expected one of 0, 1, 2"),
        (
            ("two-link", "run.nc", "-o", "x.gif"),
            "x.gif: the ending '.gif' is not offered; expected .glb or .html",
        ),
        (("two-link", "gone.nc", "-o", "x.glb"), "gone.nc: no such file"),
        (("two-lnk", "run.nc", "-o", "x.glb"), "did you mean two-link?"),
        (("two-link", "run.nc"), "Missing option '--output'"),
        (("unnamed.nc", "-o", "x.glb"), "not built in, and the run keeps no scenario; expected ROBOT before it"),
    ],
)
def test_refused(folder, arguments, words):
    done = run("animate", *arguments, code=2)
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(entry.name for entry in folder.iterdir()) == ["batch.nc", "run.nc", "unnamed.nc"]
