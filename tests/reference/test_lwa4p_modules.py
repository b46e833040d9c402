"""The LWA 4P of its modules against the model that TU Munich publishes for the whole arm (built in as `lwa4p`)."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import DescriptionError
from armwright.lint.feasibility import about_com, impossible
from armwright.model import build_model
from armwright.modules.assemble import assemble
from armwright.modules.assembly import Assembly, read_modules
from armwright.modules.library import ModuleLibrary

PRINTED = 1.01e-7  # [kg m²]: tensors are published to 1e-7, and both sides are rounded


@pytest.fixture(scope="module")
def library() -> ModuleLibrary:
    return read_modules("improv")


def tensor(library: ModuleLibrary, name: str, body: int = 0):
    found = library.module(name).bodies[body]
    return float(found.mass_kg), np.array(found.com_m), found.inertia_kg_m2.matrix()


def test_it_weighs_what_the_modules_weigh() -> None:
    assert aw.modules.assemble("lwa4p").total_mass == pytest.approx(12.32, abs=1e-12)
    assert aw.modules.assemble("lwa4p-tool").total_mass == pytest.approx(13.72, abs=1e-12)


def test_the_tip_is_where_the_published_rows_put_it() -> None:
    made, published = build_model(aw.modules.assemble("lwa4p-tool")), aw.load("lwa4p")
    for q in np.random.default_rng(1).uniform(-2.7, 2.7, (10, 6)):
        np.testing.assert_allclose(
            aw.forward_kinematics(made, q), aw.forward_kinematics(published, q), rtol=0, atol=1e-12
        )
    straight = aw.forward_kinematics(build_model(aw.modules.assemble("lwa4p")), np.zeros(6))
    np.testing.assert_allclose(straight[:3, 3], [0.0, 0.0, 0.1013 + 0.35 + 0.3012 + 0.0748], atol=1e-12)


def test_links_have_the_published_masses_centres_and_tensors() -> None:
    """Body by body, in the published link frames: to the last digit that is printed."""
    made, published = build_model(aw.modules.assemble("lwa4p-tool")), aw.load("lwa4p")
    for q in np.random.default_rng(2).uniform(-2.7, 2.7, (3, 6)):
        np.testing.assert_allclose(aw.gravity_torques(made, q), aw.gravity_torques(published, q), rtol=0, atol=1e-12)
    for ours, theirs in zip(made.bodies, published.bodies, strict=True):
        assert ours.mass == pytest.approx(theirs.mass, abs=1e-12)
        assert ours.drive.armature == theirs.drive.armature
        assert ours.drive.torque_constant == theirs.drive.torque_constant
        assert (ours.limits.torque, ours.limits.current) == (theirs.limits.torque, theirs.limits.current)
        principal = [np.linalg.eigvalsh(body.inertia_com) for body in (ours, theirs)]
        np.testing.assert_allclose(principal[0], principal[1], rtol=0, atol=2 * PRINTED)
    for q in np.random.default_rng(3).uniform(-2.7, 2.7, (5, 6)):
        np.testing.assert_allclose(aw.mass_matrix(made, q), aw.mass_matrix(published, q), rtol=0, atol=6 * PRINTED)


def test_where_the_two_differ() -> None:
    """The published model repeats PB22's friction for PB21; position limits are the modules' own but for joint 3."""
    made, published = build_model(aw.modules.assemble("lwa4p-tool")), aw.load("lwa4p")
    for k, (ours, theirs) in enumerate(zip(made.bodies, published.bodies, strict=True)):
        assert ours.friction is not None
        assert theirs.friction is not None
        same = (ours.friction.viscous, ours.friction.coulomb_positive) == (
            theirs.friction.viscous,
            theirs.friction.coulomb_positive,
        )
        assert same == (k >= 2)
    assert (made.bodies[0].friction.viscous, made.bodies[1].friction.coulomb_positive) == (15.68, 5.10)  # type: ignore[union-attr]
    assert made.bodies[2].limits.position[1] == pytest.approx(np.deg2rad(155.5))
    assert made.bodies[0].limits.position == (-2.9671, 2.9671)


def test_the_evidence_that_tensors_are_about_the_frame(library: ModuleLibrary) -> None:
    mass, com, given = tensor(library, "PB21", 1)
    published = np.array([[0.0153118, 0, 0], [0, 0.0115774, -0.0057564], [0, -0.0057564, 0.0097334]])
    moved = about_com(mass, com, given, "frame")
    np.testing.assert_allclose(moved, published, rtol=0, atol=PRINTED)
    mass, com, given = tensor(library, "L1")
    assert given[1, 2] == pytest.approx(-mass * com[1] * com[2], rel=1e-4)
    wrong = library.module("L1").bodies[0].replace(inertia_about="com")
    document = library.model_copy(
        update={
            "modules": tuple(
                m if m.name != "L1" else m.model_copy(update={"bodies": (wrong,)}) for m in library.modules
            )
        }
    )
    read_as_com = assemble(aw_assembly("base", "PB21", "L1"), [document])
    assert "yz = 0.003742 is -m c_y c_z" in read_as_com.remarks[0]


def aw_assembly(*modules: str) -> Assembly:
    tables = [{"module": name, **({"on": f"{below}.out"} if below else {})} for below, name in zip([None, *modules], modules, strict=False)]  # fmt: skip  # noqa: E501
    return Assembly(name="arm", source="definition", libraries=("improv",), modules=tuple(tables))  # type: ignore[arg-type]


def test_impossible_modules_are_refused_by_name(library: ModuleLibrary) -> None:
    with pytest.raises(DescriptionError, match="triangle inequality") as caught:
        assemble(aw_assembly("base", "PB21", "L5"), [library])
    assert caught.value.place == "module 'L5' body 'body'"


@pytest.mark.parametrize("name", ["L4", "L6", "L10"])
def test_some_tensors_can_only_be_about_the_centre_of_mass(library: ModuleLibrary, name: str) -> None:
    mass, com, given = tensor(library, name)
    assert library.module(name).bodies[0].inertia_about == "com"
    assert impossible(mass, com, given, "com") is None
    assert "about the centre of mass it would be possible" in (impossible(mass, com, given, "frame") or "")


def test_l5_is_impossible_about_either_point(library: ModuleLibrary) -> None:
    mass, com, given = tensor(library, "L5")
    assert impossible(mass, com, given, "com")
    assert impossible(mass, com, given, "frame")
