"""Every number of every built-in arm has a source, and the arm says which."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

import armwright
from armwright.description import builtin_names, read_description
from armwright.description.paths import quantities
from armwright.errors import DescriptionError, ModelError
from physics.arms import arm
from raises_at import raises_at

ROBOTS = Path(armwright.__file__).parent / "robots"


@pytest.mark.parametrize("name", builtin_names())
def test_every_number_has_a_source(name):
    """Each quantity leads to a kind and a text."""
    robot = read_description(name)
    keys = {path: key for path, _, key in quantities(robot)}
    assert len(keys) == len(list(quantities(robot))) > 20
    for key in keys.values():
        source = robot.source_of(key or "")
        assert source.kind
        assert source.text
    for path in list(keys)[:: len(keys) // 5]:
        assert robot.provenance(path) == robot.source_of(keys[path] or "")


OWN = ("estimate", "definition")  # of our own reasoning
FILES = sorted(path for path in ROBOTS.rglob("*.toml") if "sources" in tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_what_others_wrote_has_a_licence_and_was_read(path):
    sources = tomllib.loads(path.read_text(encoding="utf-8"))["sources"]
    for key, source in sources.items():
        assert source["kind"] in OWN or source.get("licence"), key
        assert source["kind"] == "estimate" or "recalled" not in source["text"].lower(), key


def test_nearest_source_holds():
    """A number's own source, else its table's, else the file's."""
    puma = arm("puma560")
    assert puma.provenance("link3.mass_kg").text.startswith("P. I. Corke, B. Armstrong")
    assert puma.provenance("elbow.motor.resistance_ohm").text.startswith("Recalled from P. I. Corke")
    assert puma.provenance("elbow.motor.resistance_ohm").kind == "estimate"
    assert puma.provenance("elbow.friction.smoothing_rad_per_s").text.startswith("Chosen")
    assert puma.provenance("gravity_m_s2").licence == "MIT"
    assert arm("panda").provenance("joint1.limits.velocity_rad_per_s").licence == "Apache-2.0"
    assert arm("lwa4p").provenance("joint1.limits.position_rad").licence == "Apache-2.0"
    assert arm("two-link").provenance("forearm.mass_kg").kind == "definition"


def test_cmu_dd_is_an_estimate_throughout():
    """Its true numbers are not published: all but the report's gravity say `estimate`."""
    robot = read_description("cmu-dd")
    kinds = {path: robot.source_of(key or "").kind for path, _, key in quantities(robot)}
    assert kinds.pop("gravity_m_s2") == "publication"
    assert set(kinds.values()) == {"estimate"}


def test_unknown_number():
    """A path that leads to no number suggests the nearest that do."""
    with raises_at(DescriptionError, "path", r"link3\.mass_kg", value="link3.mass", file="puma560"):
        arm("puma560").provenance("link3.mass")


def test_model_without_a_record():
    """A model that no description made has no sources to name."""
    import dataclasses

    with raises_at(ModelError, "arm", value="panda"):
        dataclasses.replace(arm("panda"), description=None).provenance("link1.mass_kg")
