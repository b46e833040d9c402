"""The animation of a run: which run, which arm, which lane; and one line where it cannot be."""

import itertools

import numpy as np
import pytest

import armwright as aw
from armwright.errors import OutputError, RunError
from physics.arms import arm as sprung
from pictures.gltf_rules import Gltf
from pictures.playing import pose_of
from pictures.reading import Page
from pictures.test_arm_glb import TO_Z_UP, to_base
from raises_at import raises_at
from simulation.runs import MIXED, invented, mixed_arm


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return mixed_arm(tmp_path_factory.mktemp("robot"))


def hand(path, animation="run", t=2.0):
    return TO_Z_UP @ pose_of(Gltf(path.read_bytes()), animation, "tip hand", t)


@pytest.mark.study
def test_simulated_run_ends_where_kinematics_says(tmp_path):
    arm = aw.load("cmu-dd")
    run = aw.simulate(aw.Scenario(arm, command=[8, 12, 8, 4, 2, 1], duration=0.5))
    aw.animate(run, arm, tmp_path / "run.glb")
    gltf = Gltf((tmp_path / "run.glb").read_bytes())
    assert len(gltf.animation("run")["channels"]) == 6
    last = to_base(arm) @ pose_of(gltf, "run", "tip hand", 0.5)
    assert np.abs(last - aw.forward_kinematics(arm, run["q"].values[-1])).max() < 1e-5


def test_cylinders_stay_at_their_ends(tmp_path):
    """Barrel and rod begin at the points that their links carry, point at each other, and overlap at all times."""
    arm = sprung("sprung")
    run = invented(arm)
    t, q = run["time"].values, run["q"].values
    aw.animate(run, arm, tmp_path / "run.glb")
    gltf = Gltf((tmp_path / "run.glb").read_bytes())
    for at, spring in itertools.product((0.0, 0.31, 1.07, 2.0), arm.cylinders):
        positions = [np.interp(at, t, column) for column in q.T]
        links = ["base" if body < 0 else arm.bodies[body].link for body in spring.bodies]
        poses = [aw.forward_kinematics(arm, positions, frame=link) for link in links]
        bodies = [
            pose @ np.linalg.inv(arm.frames[link].placement.matrix()) for pose, link in zip(poses, links, strict=True)
        ]
        ends = [(body @ [*end, 1.0])[:3] for body, end in zip(bodies, np.asarray(spring.ends), strict=True)]
        for name, own, other in (("barrel", *ends), ("rod", *ends[::-1])):
            pose = to_base(arm) @ pose_of(gltf, "run", f"{spring.name} {name}", at)
            along = (other - own) / np.linalg.norm(other - own)
            assert np.abs(pose[:3, 3] - own).max() < 1e-3
            assert pose[:3, 2] @ along > 1.0 - 1e-4


def test_page_plays_the_same_file(arm, tmp_path):
    run = invented(arm)
    run = run.assign(q_reference=run["q"] * 0.5)
    aw.animate(run, arm, tmp_path / "run.html")
    aw.animate(run, arm, tmp_path / "run.glb")
    page = Page(tmp_path / "run.html")
    assert page.unpacked("arm") == (tmp_path / "run.glb").read_bytes()
    assert page.fetched() == []
    assert (page.plot["start"], page.plot["duration"]) == (0.0, 2.0)
    expected = aw.forward_kinematics(arm, 0.5 * run["q"].values[-1])
    assert np.abs(hand(tmp_path / "run.glb", "reference") - expected).max() < 1e-5


def test_a_lane_of_many(arm, tmp_path):
    run = invented(arm, lanes=5)
    run["q"].values[2] = np.nan
    aw.animate(run, arm, tmp_path / "lane.glb", lane=3)
    expected = aw.forward_kinematics(arm, run["q"].values[3, -1])
    assert np.abs(hand(tmp_path / "lane.glb") - expected).max() < 1e-5
    for lane, words in (
        (None, "lane: the run has 5 lanes; expected one of 0 … 4"),
        (7, "lane = 7: no such lane; expected one of 0 … 4"),
        (2, "q of joint 'turn' = nan: from t = 0 s on the simulation diverges"),
    ):
        with pytest.raises(RunError) as caught:
            aw.animate(run, arm, tmp_path / "x.glb", lane=lane)
        assert words in str(caught.value)
    with pytest.raises(RunError) as caught:
        aw.animate(invented(arm), arm, tmp_path / "x.glb", lane=0)
    assert (caught.value.place, caught.value.value, caught.value.expected) == ("lane", 0, "none")
    assert [entry.name for entry in tmp_path.iterdir()] == ["lane.glb"]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("run.gltf", "run.gltf: the ending '.gltf' is not offered; expected .glb or .html"),
        ("run", "run: has no ending; expected .glb or .html"),
        ("no/run.glb", "there is no folder"),
    ],
)
def test_paths_that_cannot_be_written(arm, tmp_path, path, words):
    with pytest.raises(OutputError) as error:
        aw.animate(invented(arm), arm, tmp_path / path)
    assert words in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_runs_that_are_none_of_this_arm(arm, tmp_path):
    run = invented(arm)
    other = aw.load("two-link")
    kinds = run.assign_coords(kind=("joint", ["revolute"] * 3))
    for bad, place, expected in (
        (invented(other), "joint", "those of lathe: turn, slide, hinge"),
        (run.isel(joint=[0, 1]), "joint", "those of lathe: turn, slide, hinge"),
        (kinds, "kind of joint 'slide'", "prismatic, as it is in lathe"),
        (run.drop_vars("q"), "q", "all variables that simulate returns"),
        (run.isel(time=slice(0, 0)), "", "at least one"),
        (run.isel(time=[3, 2]), "time[1]", "increasing values"),
        (run.where(run["time"] < 1), "q of joint 'turn'", "a run, or the part of it before"),
    ):
        with pytest.raises(RunError) as caught:
            aw.animate(bad, arm, tmp_path / "run.glb")
        assert (caught.value.place, caught.value.expected) == (place, expected)
        assert "\n" not in str(caught.value)
    with raises_at(RunError, "run"):
        aw.animate(run.to_dataframe(), arm, tmp_path / "run.glb")
    assert list(tmp_path.iterdir()) == []


def test_a_mesh_that_has_gone(tmp_path):
    visual = """
    [[links.visuals]]
    name = "cover"
    solid = { shape = "mesh", file = "gone.stl", scale = 0.001 }
    xyz_m = [0.0, 0.0, 0.0]
    rpy_rad = [0.0, 0.0, 0.0]
    """
    (tmp_path / "lathe.toml").write_text(MIXED + visual, encoding="utf-8")
    arm = aw.load(tmp_path / "lathe.toml")
    with pytest.raises(RunError) as error:
        aw.animate(invented(arm), arm, tmp_path / "run.glb")
    assert (error.value.file, error.value.place) == ("lathe", "link 'hand' visual 'cover' mesh")
    assert error.value.value == "gone.stl"
    assert "cannot be read" in error.value.what
    assert [entry.name for entry in tmp_path.iterdir()] == ["lathe.toml"]


def test_a_part_of_a_run_starts_at_0(arm, tmp_path):
    run = invented(arm)
    aw.animate(run.sel(time=slice(1.0, None)), arm, tmp_path / "run.glb")
    expected = aw.forward_kinematics(arm, run["q"].values[20])
    assert np.abs(hand(tmp_path / "run.glb", t=0.0) - expected).max() < 1e-5
