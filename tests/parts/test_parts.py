"""The Parts Database: refusals, overlaps, the arm that it is built into, its audit, and that files know when they are old."""

from __future__ import annotations

import copy
import functools
import tomllib
from importlib import resources
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import tomlkit
import trimesh
from hypothesis import given, reject, settings, strategies as st

import armwright as aw
from armwright.description import read_description
from armwright.description.built_from import built_from
from armwright.description.writer import to_toml
from armwright.errors import ArmwrightError, DescriptionError, OutputError
from armwright.parts.audit import adding_up, audit
from armwright.parts.build import arm_of_parts, build_parts
from armwright.parts.mass_properties import weigh
from armwright.parts.materials import common_materials
from armwright.parts.overlap import overlaps
from armwright.parts.records import PartsDatabase
from armwright.robotfiles.audit_page import audit_page
from armwright.robotfiles.difference import changed_parameters
from armwright.robotfiles.write_parts import write_parts
from armwright.validation import validated
from description.test_any_input import places, values
from parts.parts_arms import ORIGIN, built, database, document, part, section
from raises_at import raises_at

CMU = resources.files("armwright.robots") / "cmu-dd.parts.toml"
CMU_DATA = tomllib.loads(CMU.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([part(section(), material="stel")], "part '10-01' material = 'stel': no key of [materials]; did you mean steel"),
        ([part(section(material="aluminum-6061"))], "section 'block' material = 'aluminum-6061': no key"),
        ([part(section(), material=None)], "section 'block': expected a material or density_kg_per_m3"),
        ([part(section(), density_kg_per_m3=1)], "material and density_kg_per_m3; expected one of them"),
        ([part(section(), section())], "name = 'block': two sections have this name"),
        ([part(section()), part(section())], "name = '10-01': two parts have this name"),
        ([part()], "a part without sections; expected weighed_mass_kg and measured_com_m and measured_inertia_kg_m2"),
        ([part(section(count=3))], "section 'block' count = 3: expected a pattern"),
        ([part(section(count=0))], "section 'block' count = 0: expected greater than or equal to 1"),
        ([part(section(count=2, pattern={"type": "round"}))], "type = 'round': expected linear or polar"),
        ([part(section(solid={"shape": "cube"}))], "section 'block' solid.shape = 'cube': expected cylinder, semi-cylinder"),
        ([part(section(solid={"shape": "sphere", "radius_m": 1500}))], "radius_m: expected metres, at most 1000"),
        ([part(section(solid={"shape": "sphere", "radius_mm": 15}))], "radius_mm = 15: unknown key; did you mean radius_m?"),
        ([part(section(solid={"shape": "mesh", "file": "../x.stl", "scale": 1}))], "solid.file = '../x.stl': leads out of"),
        ([part(section(solid={"shape": "mesh", "file": "/etc/x.stl", "scale": 1}))], "solid.file = '/etc/x.stl': leads out of"),
        ([part(section(), overlaps="yes")], "overlaps = 'yes': expected 'ok'"),
    ],
)  # fmt: skip
def test_refusals(parts, message):
    for one in parts:
        if one.get("material") is None:
            one.pop("material")
    with pytest.raises(DescriptionError) as caught:
        database(*parts, folder=Path("/tmp"))
    assert message in str(caught.value)
    assert str(caught.value).startswith("arm.parts.toml: ")
    assert "\n" not in str(caught.value)


def test_materials_have_sources_and_can_be_overridden():
    table = common_materials()
    assert all(material.source in table.sources for material in table.materials.values())
    assert all(500 < material.density < 25_000 for material in table.materials.values())
    own = built(part(section()), materials={"steel": {"density_kg_per_m3": 8000.0}})
    assert float(own.description.links[0].mass_kg) == pytest.approx(16.0)
    with pytest.raises(DescriptionError, match="expected source"):
        database(part(section()), materials={"steel": {"density_kg_per_m3": 8000.0, "source": "nobody"}})


def warned(*parts, **changes):
    """Overlaps of the one link, as text."""
    (link,) = weigh(database(*parts, **changes))
    problems = overlaps(link)
    assert {problem.place for problem in problems} <= {"link 'arm'"}
    return [problem.what for problem in problems]


def cylinder(name, radius, length, **changes):
    return section(name, solid={"shape": "cylinder", "radius_m": radius, "length_m": length}, **changes)


def test_overlaps_are_told_with_their_volume():
    """Half a litre that two blocks share; a ball in a block; a shaft where there is no bore."""
    (warning,) = warned(part(section("a"), section("b", xyz_m=[0.05, 0.05, 0.0])))
    assert "'10-01' 'a' and '10-01' 'b' overlap by 500 cm³, 3.93 kg counted twice (12.5 % of the part)" in warning
    ball = section("ball", solid={"shape": "sphere", "radius_m": 0.03})
    (warning,) = warned(part(section("a")), part(ball, name="10-02"))
    assert "overlap by 113 cm³" in warning
    (warning,) = warned(part(section("plate")), part(cylinder("shaft", 0.02, 0.4), name="10-02"))
    assert "overlap by 251 cm³" in warning
    copies = {"type": "linear", "step_m": [0.05, 0.0, 0.0]}
    (warning,) = warned(part(section("a", count=2, pattern=copies)))
    assert "copies of '10-01' 'a' overlap by 1e+03 cm³" in warning


def test_what_fits_is_silent():
    """Faces that touch, a shaft in its bore, a sliver below one per cent, and what is so by design."""
    assert not warned(part(section("a"), section("b", xyz_m=[0.1, 0.0, 0.0])))
    bored = part(section("plate"), cylinder("bore", 0.02, 0.2, hole=True))
    assert not warned(bored, part(cylinder("shaft", 0.02, 0.4), name="10-02"))
    assert not warned(part(section("a"), section("b", xyz_m=[0.0995, 0.0, 0.0])))
    deep = [section("a"), section("b", xyz_m=[0.05, 0.05, 0.0])]
    assert not warned(part(*deep, overlaps="ok"))


def test_holes_in_the_air_are_told():
    """A bore that is drawn longer than its plate takes mass that is not there."""
    (warning,) = warned(part(section("plate"), cylinder("bore", 0.02, 0.24, hole=True)))
    assert "hole '10-01' 'bore' takes 50.2 cm³ where its part has nothing" in warning
    assert not warned(part(section("plate"), cylinder("bore", 0.02, 0.24, hole=True), overlaps="ok"))


@settings(max_examples=25)
@given(st.floats(0.001, 0.999), st.floats(0.001, 0.999), st.floats(0.001, 0.999), st.tuples(*[st.floats(-3, 3)] * 3))
def test_overlap_volumes_are_the_truth(x, y, z, turn):
    """Two equal blocks, shifted by shares of their sizes, anywhere: the box that they share, to the digits shown."""
    shift = [0.1 * x, 0.1 * y, 0.2 * z]
    warnings = warned(part(section("a"), section("b", xyz_m=shift), rpy_rad=list(turn)))
    shared = (1 - x) * (1 - y) * (1 - z) * 2000
    assert bool(warnings) == (shared > 0.01 * 4000) or shared == pytest.approx(40, rel=1e-9)
    if warnings:
        assert float(warnings[0].split("overlap by ")[1].split()[0]) == pytest.approx(shared, rel=0.0051)


CORNERS = st.tuples(*[st.integers(0, 4)] * 3)
SIZES = st.tuples(*[st.integers(1, 3)] * 3)


def cells(corner, size):
    """A block on a grid of centimetres, as the cells that it fills."""
    filled = np.zeros((8, 8, 8), dtype=int)
    filled[tuple(slice(c, c + s) for c, s in zip(corner, size, strict=True))] = 1
    return filled


@settings(max_examples=40)
@given(st.lists(st.tuples(CORNERS, SIZES), max_size=3), st.lists(st.tuples(CORNERS, SIZES), max_size=3), st.booleans())
def test_overlaps_are_those_of_a_count(solids, holes, turned):
    """Blocks and holes with faces, edges and corners in common, several on one spot: told is what cells that are counted say."""
    blocks = [(f"s{k}", *each, False) for k, each in enumerate([((0, 0, 0), (8, 8, 4)), *solids])]
    blocks += [(f"h{k}", *each, True) for k, each in enumerate(holes)]
    sections = [
        section(
            name, solid={"shape": "box", "size_m": [0.01 * s for s in size]}, hole=hole,
            xyz_m=[0.01 * (c + s / 2) for c, s in zip(corner, size, strict=True)],
        )
        for name, corner, size, hole in blocks
    ]  # fmt: skip
    filled = {name: cells(corner, size) for name, corner, size, _ in blocks}
    solid, hole = (sum(v for k, v in filled.items() if k[0] == kind) for kind in "sh")
    net = np.asarray(solid) - hole
    expected = {
        f"'10-01' '{a}' and '10-01' '{b}' overlap": ((net >= 2) & (filled[a] * filled[b] > 0)).sum()
        for a, b in combinations([name for name in filled if name[0] == "s"], 2)
    }
    expected |= {f"hole '10-01' '{a}' takes": ((net < 0) & (filled[a] > 0)).sum() for a in filled if a[0] == "h"}
    try:
        warnings = warned(part(*sections, rpy_rad=[0.3, 0.4, 0.5] if turned else [0.0, 0.0, 0.0]))
    except DescriptionError:  # holes that take more than there is
        reject()
    for words, volume in expected.items():
        (number,) = [text.split(words)[1].removeprefix(" by").split()[0] for text in warnings if words in text] or ["0"]
        assert float(number) == pytest.approx(volume if volume > 0.01 * net.sum() else 0, rel=0.0051)


def test_round_things_that_fit_turned_are_silent():
    """A thin sleeve in its bore, a ball in its socket: flat sides stand elsewhere, and nothing is told of it."""
    turn = {"rpy_rad": [0.0, 0.0, 0.0123]}
    bored = part(section("plate"), cylinder("bore", 0.04, 0.2, hole=True))
    tube = {"shape": "tube", "outer_radius_m": 0.04, "inner_radius_m": 0.039, "length_m": 0.2}
    assert not warned(bored, part(section("sleeve", solid=tube, **turn), name="10-02"))
    ball = {"shape": "sphere", "radius_m": 0.04}
    socket = part(section("plate"), section("socket", solid=ball, hole=True))
    assert not warned(socket, part(section("ball", solid=ball, rpy_rad=[0.1, 0.2, 0.3]), name="10-02"))


def test_meshes_among_sections(tmp_path):
    """A ball from a file: weighed, held against a block, hashed into the record, and drawn."""
    trimesh.creation.icosphere(3, 30.0).export(tmp_path / "ball.stl")
    ball = section("ball", solid={"shape": "mesh", "file": "ball.stl", "scale": 0.001})
    (warning,) = warned(part(section("a")), part(ball, name="10-02"), folder=tmp_path)
    assert "overlap by 112 cm³" in warning
    done = built(part(ball), folder=tmp_path)
    assert float(done.description.links[0].mass_kg) == pytest.approx(7850 * 4 / 3 * np.pi * 0.03**3, rel=0.02)
    assert done.description.links[0].visuals[0].solid.shape == "mesh"
    assert "data:image/png;base64," in audit_page(done)


def test_the_arm_names_its_sums():
    """A source a link that says what was added up; the weakest of its sources gives the kind."""
    done = built(part(section(), weighed_mass_kg={"value": 15.0, "source": "measurement"}))
    source = done.description.provenance("arm.mass_kg")
    assert source.text == "sum of 1 sections in 1 parts of arm.parts.toml: 10-01; steel 7850 kg/m³; measured: 10-01"
    assert source.kind == "drawing"
    assert list(map(str, done.overrides)) == [
        "link 'arm' part '10-01': weighed 15 kg, computed 15.7 kg: densities and with them its tensor scaled by 0.955414",
    ]
    assert done.description.links[0].visuals[0].name == "10-01 block"


def test_links_without_parts_are_massless_as_written():
    done = built()
    assert float(done.description.links[0].mass_kg) == 0.0
    assert done.description.provenance("arm.mass_kg").kind == "definition"


def test_warnings_stay_with_the_arm():
    """Whoever loads it hears of overlaps."""
    done = built(part(section("a"), section("b", xyz_m=[0.05, 0.05, 0.0])))
    assert done.description.remarks == tuple(map(str, done.warnings)) != ()


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=12), st.integers(0, 8))
def test_shown_digits_add_up(numbers, decimals):
    """Each within one of its last digit, and their sum is the total's."""
    shown = [float(text) for text in adding_up(numbers, sum(numbers), decimals)]
    assert sum(shown) == pytest.approx(round(sum(numbers), decimals), abs=0.4 * 10**-decimals)
    assert np.abs(np.array(shown) - numbers).max() <= 1.001 * 10**-decimals


@functools.cache
def cmu_build():
    """The built-in arm from its parts."""
    return cmu(CMU_DATA)


def cmu(data):
    """The built-in arm from a changed document."""
    return arm_of_parts(validated(PartsDatabase, data, file="cmu-dd.parts.toml"), built_from(Path(str(CMU))))


def test_the_audit_of_cmu_dd_adds_up():
    """To the last digit shown, in masses and in tensors; the total is the database's own number."""
    done, shipped = cmu_build(), read_description("cmu-dd")
    for weighed, link in zip(done.links, shipped.links, strict=True):
        rows, total = audit(weighed, link)
        assert len(rows) == sum(len(p.sections) for p in weighed.parts)
        units = sum(round(float(r.mass) * 1e6) for r in rows)
        assert units == round(float(total.mass) * 1e6) == round(float(link.mass_kg) * 1e6)
        for k in range(6):
            assert sum(round(float(r.inertia[k]) * 1e8) for r in rows) == round(float(total.inertia[k]) * 1e8)
        centre = sum(float(r.mass) * np.array(r.centre, dtype=float) for r in rows) / float(total.mass)
        np.testing.assert_allclose(centre, np.array(link.com_m), atol=2e-6)


def test_cmu_dd_is_built_from_its_parts(tmp_path):
    """Byte for byte, without a warning."""
    (tmp_path / CMU.name).write_bytes(CMU.read_bytes())
    done = write_parts(tmp_path / CMU.name, tmp_path / "cmu-dd.toml")
    assert done.warnings == ()
    shipped = (resources.files("armwright.robots") / "cmu-dd.toml").read_text(encoding="utf-8")
    assert (tmp_path / "cmu-dd.toml").read_text(encoding="utf-8") == shipped
    assert aw.load("cmu-dd").warnings == ()


def test_one_density_changes_exactly_what_it_should():
    """Copper made lighter: the rows of copper and the links that hold some."""
    data = copy.deepcopy(CMU_DATA)
    data["materials"] = {**data.get("materials", {}), "copper": {"density_kg_per_m3": 8000.0, "source": "estimate"}}
    before, after = cmu_build(), cmu(data)
    with_copper = {
        link.link.name for link in before.links for p in link.parts for s in p.sections if s.substance == "copper"
    }
    assert with_copper
    found = {change.path for change in changed_parameters(before.description, after.description)}
    assert {path.split(".")[0] for path in found} == with_copper
    assert {f"{name}.mass_kg" for name in with_copper} <= found
    for old, new in zip(before.links, after.links, strict=True):
        for one, two in zip(old.parts, new.parts, strict=True):
            for a, b in zip(one.sections, two.sections, strict=True):
                assert np.array_equal(a.moments.matrix, b.moments.matrix) == (a.substance != "copper")


def test_files_older_than_their_parts_say_so(tmp_path):
    """On load; and not where the parts are as they were, or are not there."""
    parts, arm = tmp_path / "a.parts.toml", tmp_path / "a.toml"
    parts.write_text(tomlkit.dumps(document(part(section()))), encoding="utf-8")
    write_parts(parts, arm)
    assert aw.load(arm).warnings == ()
    parts.write_bytes(parts.read_bytes().replace(b"\n", b"\r\n"))
    assert aw.load(arm).warnings == ()
    parts.write_text(parts.read_text() + "\n# changed\n")
    (warning,) = aw.load(arm).warnings
    assert "older than a.parts.toml, which has changed since" in warning
    parts.unlink()
    assert aw.load(arm).warnings == ()


def test_pages_stand_alone_and_tell_what_changed(tmp_path):
    """No address, no script; the second build lists the parameters that moved."""
    parts, arm, page = tmp_path / "a.parts.toml", tmp_path / "a.toml", tmp_path / "audit.html"
    bored = part(section(), cylinder("bore", 0.02, 0.2, hole=True), weighed_mass_kg=15.0)
    parts.write_text(tomlkit.dumps(document(bored)), encoding="utf-8")
    write_parts(parts, arm, page)
    first = page.read_text()
    assert "There was no previous file." in first
    assert not any(word in first for word in ("http:", "https:", "src='", "<link"))
    assert first.count("data:image/png;base64,") == 1
    assert "weighed 15 kg" in first
    parts.write_text(parts.read_text().replace("weighed_mass_kg = 15.0", "weighed_mass_kg = 16.0"))
    write_parts(parts, arm, page)
    assert '<td class="word">arm.mass_kg</td>' in page.read_text()


def test_nothing_half_written(tmp_path):
    parts = tmp_path / "a.parts.toml"
    parts.write_bytes(CMU.read_bytes())
    for arm, page, at_fault in (
        (parts, None, parts),
        (tmp_path / "a.urdf", None, tmp_path / "a.urdf"),
        (tmp_path / "a.toml", tmp_path / "no" / "audit.html", tmp_path / "no" / "audit.html"),
        (tmp_path / "a.toml", tmp_path / "audit.pdf", tmp_path / "audit.pdf"),
        (tmp_path / "a.toml", tmp_path / "a.toml", tmp_path / "a.toml"),
    ):
        with pytest.raises(OutputError) as caught:
            write_parts(parts, arm, page)
        assert str(caught.value).startswith(str(at_fault))
    parts.write_text(parts.read_text().replace("electrical-steel", "cheese"))
    with pytest.raises(DescriptionError, match="cheese"):
        write_parts(parts, tmp_path / "a.toml")
    assert [entry.name for entry in tmp_path.iterdir()] == [parts.name]


def test_file_is_named_where_a_part_cannot_be(tmp_path):
    path = tmp_path / "a.parts.toml"
    path.write_bytes(CMU.read_bytes().replace(b"hole = true", b"hole = true\ndensity_kg_per_m3 = 1e6"))
    with raises_at(DescriptionError, "link 'link1' part '1-30' hole 'bore'", r"1e\+06 kg/m³") as caught:
        build_parts(path)
    assert caught.value.file == str(path)


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("nope.stl", "mesh = 'nope.stl': no such"),
        ("nope.step", "mesh = 'nope.step': no such"),
        ("folder", "mesh = 'folder': a folder"),
        ("arm.step", "kind of mesh"),
    ],
)
def test_meshes_that_are_not_there(file, message, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "arm.step").write_text("ISO-10303-21;")
    path = tmp_path / "a.parts.toml"
    solid = {"shape": "mesh", "file": file, "scale": 1}
    path.write_text(tomlkit.dumps(document(part(section(solid=solid)))), encoding="utf-8")
    with pytest.raises(DescriptionError, match=rf"a\.parts\.toml: .*{message}") as refused:
        build_parts(path)
    assert "\n" not in str(refused.value)


def test_units_that_look_like_others(tmp_path):
    """Densities in g/cm³ and g/m³, a mesh in millimetres; foam, tungsten and a large mesh pass."""
    trimesh.creation.box([120, 120, 120]).export(tmp_path / "hand.stl")

    def doubts(**changes):
        return built(part(section(**changes)), folder=tmp_path).warnings

    (light,) = doubts(density_kg_per_m3=2.7)
    assert (light.place, light.value) == ("link 'arm' part '10-01' section 'block' density_kg_per_m3", 2.7)
    assert (light.what, light.expected) == ("g/cm³ for kg/m³?", "2700")
    assert "g/m³ for kg/m³" in doubts(density_kg_per_m3=2.7e6)[0].what
    assert "a mesh of 120 m: millimetres" in doubts(solid={"shape": "mesh", "file": "hand.stl", "scale": 1})[0].what
    (tiny,) = doubts(solid={"shape": "mesh", "file": "hand.stl", "scale": 1e-6})  # 0.001 twice
    assert tiny.what.startswith("a mesh of 0.00012 m")
    assert doubts(density_kg_per_m3=25.0) == doubts(density_kg_per_m3=19300.0) == ()
    assert doubts(solid={"shape": "mesh", "file": "hand.stl", "scale": 0.001}) == ()


def test_deviations_of_scales_come_through():
    """Weighed parts: the link's mass has the square root of the sum of squares; the other parts count as exact."""
    weighed = {"value": 16.0, "std": 0.03}
    link = built(
        part(section(), weighed_mass_kg=weighed),
        part(section(xyz_m=[0.5, 0.0, 0.0]), name="2", weighed_mass_kg={**weighed, "std": 0.04}),
        part(section(xyz_m=[1.0, 0.0, 0.0]), name="3"),
    ).description.links[0]
    assert link.mass_kg.std == pytest.approx(0.05, rel=1e-12)
    assert built(part(section())).description.links[0].mass_kg.std is None
    assert built(part(section(), weighed_mass_kg=16.0)).description.links[0].mass_kg.std is None


@settings(max_examples=250)
@given(st.lists(st.tuples(st.integers(0, 10**6), values), min_size=1, max_size=3))
def test_any_change_of_a_good_file(changed):
    """Entries replaced by anything: an arm comes out, or one line of ours."""
    data = document(
        part(section(), cylinder("bore", 0.02, 0.2, hole=True), weighed_mass_kg=12.0, measured_com_m=[0, 0, 0]),
        part(
            section("p", solid={"shape": "prism", "outline_m": [[0, 0], [0.1, 0], [0, 0.1]], "length_m": 0.1},
                    count=2, pattern={"type": "polar", "axis": [0, 0, 1], "through_m": [1, 0, 0]}),
            name="2", pendulums=[{"axis": [0, 0, 1], "through_m": [0, 0, 0], "inertia_kg_m2": 10.0}],
        ),
        materials={"gold": {"density_kg_per_m3": 19300.0, "colour": [1, 0.8, 0]}},
    )  # fmt: skip
    for where, value in changed:
        every = places(data)[1:]
        *path, last = every[where % len(every)]
        at = data
        for key in path:
            at = at[key]
        at[last] = value
    refusal, count = "", 0
    try:
        done = arm_of_parts(validated(PartsDatabase, data, file="arm.parts.toml", folder=Path("/tmp")), ORIGIN)
        assert to_toml(done.description)
    except ArmwrightError as error:
        refusal, count = str(error), len(error.problems)
    assert len(refusal.splitlines()) == count + (count > 1)
    assert len(refusal) < 1000 * max(count, 1)
