"""Every picture of the README and the docs is what its commands make, and there are no others."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image

import armwright as aw
from docs.pages import ROOT, page
from pictures.alike import unlike
from pictures.browser import CHROMIUM
from pictures.gallery import IMAGES, TABLE
from pictures.paper import on_white

SHOWN = re.compile(r"!\[[^\]]+\]\((?P<path>[^)]+)\)")
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
BENCHMARK = {path.name for path in IMAGES.glob("bench-*.png")}  # drawn by `make bench ARGS=--save`, of its own numbers
LARGEST = 200_000  # bytes


HERE = [picture for picture in TABLE if not picture.commands[0].startswith("python")]  # those: tests/examples


@pytest.mark.parametrize("picture", HERE, ids=lambda picture: picture.file)
@pytest.mark.sample(1)
def test_a_picture_is_what_its_commands_make(picture, tmp_path):
    if picture.opened is not None and CHROMIUM is None:
        pytest.skip("no chromium on this machine: the page was not opened")
    difference = picture.changed(picture.make(tmp_path))
    assert difference is None, f"{picture.file}: {difference}; if it is meant to: make pictures, and look at it"


def test_the_table_has_all_pictures_once():
    files = [picture.file for picture in TABLE]
    assert sorted(files) == sorted({path.name for path in IMAGES.iterdir()} - BENCHMARK)


def test_pages_show_pictures_that_are_there_and_all_of_them():
    shown = {(path.parent / found["path"]).resolve() for path in PAGES for found in SHOWN.finditer(page_of(path))}
    shown |= {IMAGES / f"robot-{name}.png" for name in aw.builtin_names()}  # docs/ext/armwright_tables.py
    assert not [path for path in shown if not path.exists()]
    assert {path for path in shown if path.parent == IMAGES} == set(IMAGES.iterdir())


def test_pages_show_the_commands_of_their_pictures():
    for picture in [picture for picture in TABLE if picture.page is not None]:
        words = [
            " ".join(line.removeprefix("$ ").split()) for line in page(picture.page).replace("\\\n", " ").splitlines()
        ]
        assert not set(picture.commands) - set(words), f"{picture.page} does not show the commands of {picture.file}"


@pytest.mark.parametrize("path", sorted(IMAGES.iterdir()), ids=lambda path: path.name)
def test_pictures_are_small(path):
    assert path.stat().st_size < LARGEST


def page_of(path):
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def run():
    scenario = aw.Scenario(aw.load("two-link"), command=[1.0, 0.5], duration=0.5)
    return aw.simulate(scenario)


@pytest.mark.study
@pytest.mark.parametrize("ending", [".png", ".svg"])
def test_what_makes_a_picture_another_one(run, tmp_path, ending):
    """The comparison sees a joint that moves by a tenth more, another name and another size, and nothing in a copy."""
    changes = {
        "kept": run, "same": run * (1 + 1e-9), "joint": run.assign(q=run["q"] * [1.0, 1.1]),
        "name": run.assign_coords(joint=["shoulder", "wristwatch"]), "size": run.drop_vars("qd"),
    }  # fmt: skip
    for name, changed in changes.items():
        aw.plot({"run": changed.assign_attrs(run.attrs)}, tmp_path / f"{name}{ending}")
    differences = {name: unlike(tmp_path / f"{name}{ending}", tmp_path / f"kept{ending}") for name in changes}
    assert differences.pop("kept") is differences.pop("same") is None
    assert None not in differences.values(), differences


def test_pictures_of_arms_in_other_poses_are_told_apart(tmp_path):
    arm = aw.load("two-link")
    for name, elbow in (("kept", 0.5), ("moved", 0.7)):
        aw.show(arm, tmp_path / f"{name}.png", [0.3, elbow], size=300)
    assert unlike(tmp_path / "moved.png", tmp_path / "kept.png")
    pixels = on_white(tmp_path / "kept.png").astype("uint8")
    Image.fromarray(np.roll(pixels, 1, axis=1)).save(tmp_path / "shifted.png")
    assert unlike(tmp_path / "shifted.png", tmp_path / "kept.png") is None
