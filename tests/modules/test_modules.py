"""Modules put together: where things come to stand, what they weigh, and what is refused in one line."""

from __future__ import annotations

import copy
import sys
import tomllib
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml
from armwright.errors import DescriptionError
from armwright.model import Model, build_model
from armwright.modules.assemble import assemble
from armwright.modules.assembly import Assembly, assembly_names, library_names, read_modules
from armwright.modules.library import ModuleLibrary
from armwright.modules.statics import static_torques
from armwright.spatial import Placement, parallel_axes, rotation_z
from armwright.validation import validated
from modules.modules_of_tests import assembly, body, library, put
from physics.arms import arm
from raises_at import raises_at

TWO = (put("foot"), put("elbow", "foot.top"), put("elbow", "elbow.out", pi / 2, name="wrist"), put("hand", "wrist.out"))


def made(document: dict[str, Any], modules: dict[str, Any] | None = None) -> RobotDescription:
    toy = validated(ModuleLibrary, modules or library(), file="toy.modules.toml")
    return assemble(validated(Assembly, document, file="arm.assembly.toml"), [toy])


def toy_arm(document: dict[str, Any], modules: dict[str, Any] | None = None) -> Model:
    return build_model(made(document, modules))


def test_frames_come_where_connectors_meet() -> None:
    """Foot, elbow at 90 degrees, hand, followed by hand: T = face Rz(angle), since the modules' own faces are flipped."""
    arm = toy_arm(assembly(put("foot"), put("elbow", "foot.top", pi / 2), put("hand", "elbow.out", pi)))
    q = np.array([0.7])

    def shift(x: float, y: float, z: float) -> Placement:
        return Placement(np.eye(3), np.array([x, y, z]))

    def turn(rotation: np.ndarray) -> Placement:
        return Placement(rotation, np.zeros(3))

    from armwright.spatial import rotation_rpy, rotation_y

    stands = shift(0, 0, 0.2) @ turn(rotation_z(pi / 2)) @ shift(0, 0, 0.15) @ turn(rotation_y(0.7))
    upper = stands @ Placement(rotation_rpy(0.3, -0.2, 0.5), np.array([0.0, 0.02, 0.1]))
    hand = upper @ shift(0, 0, 0.2) @ turn(rotation_y(0.4)) @ turn(rotation_z(pi))
    np.testing.assert_allclose(aw.forward_kinematics(arm, q), (hand @ shift(0, 0, 0.1)).matrix(), atol=1e-12)
    assert arm.tip == "hand_grip"


def test_masses_add_up_where_their_modules_stand() -> None:
    """The moving body, from the modules' own numbers, once about the centre of mass and once about the frame."""
    arm = toy_arm(assembly(put("foot"), put("elbow", "foot.top"), put("hand", "elbow.out")))
    robot = arm.description
    assert robot is not None
    assert robot.total_mass == pytest.approx(2.0 + 1.0 + 0.8 + 0.4)
    moving = arm.bodies[0]
    tensor = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.0015], [-0.002, 0.0015, 0.025]])
    total, first, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    for name, mass, com, about in (
        ("elbow_upper", 0.8, (0.02, -0.03, 0.05), "frame"),
        ("hand", 0.4, (0, 0, 0.03), "com"),
    ):
        c = np.array(com)
        own = tensor - parallel_axes(mass, c) if about == "frame" else tensor
        if name == "elbow_upper":  # stands at the joint's child_frame
            from armwright.spatial import rotation_rpy

            placed = Placement(rotation_rpy(0.3, -0.2, 0.5), np.array([0.0, 0.02, 0.1]))
        else:
            placed = arm.frames["hand"].placement
            placed = moving.link_frame.inverse() @ placed
        at = placed.point(c)
        total, first = total + mass, first + mass * at
        inertia = inertia + placed.rotation @ own @ placed.rotation.T + parallel_axes(mass, at)
    parameters = moving.inertial_parameters
    np.testing.assert_allclose(parameters[:4], [total, *first], atol=1e-14)
    tensor = [inertia[0, 0], inertia[0, 1], inertia[0, 2], inertia[1, 1], inertia[1, 2], inertia[2, 2]]
    np.testing.assert_allclose(parameters[4:], tensor, atol=1e-14)


@settings(max_examples=15, deadline=None)
@given(st.floats(-2.5, 2.5), st.sampled_from(["a", "b"]))
def test_a_module_put_on_the_other_way_round_moves_the_same(q: float, by: str) -> None:
    """Where its two faces stand to each other does not depend on which of them carries it."""
    document = library()
    document["modules"][0]["connectors"].append(
        {**document["modules"][0]["connectors"][1], "name": "ring", "kind": "ring", "gender": "n"}
    )
    arm = toy_arm(
        assembly(put("foot"), put("either", "foot.ring", by=by), tip=f"either.{'b' if by == 'a' else 'a'}"), document
    )
    pose = aw.forward_kinematics(arm, np.array([q]))
    back = toy_arm(assembly(put("foot"), put("either", "foot.ring", by="a"), tip="either.b"), document)
    meeting = np.diag([1.0, -1.0, -1.0, 1.0])
    face = np.eye(4)
    face[2, 3] = 0.2
    # face a to face b, from the carrier's side
    through = np.linalg.inv(face) @ aw.forward_kinematics(back, np.array([q]))
    expected = through if by == "a" else meeting @ np.linalg.inv(through) @ meeting
    np.testing.assert_allclose(np.linalg.inv(face) @ pose, expected, atol=1e-12)


def test_a_tree_branches_and_names_its_ends() -> None:
    document = library()
    two = {
        **document["modules"][0]["connectors"][1],
        "name": "side",
        "frame": {"xyz_m": [0.1, 0, 0], "rpy_rad": [0, pi / 2, 0]},
    }
    document["modules"][0]["connectors"].append(two)
    branches = assembly(put("foot"), put("elbow", "foot.top", name="left"), put("elbow", "foot.side", name="right"))
    robot = made(branches, document)
    assert robot.tip is None
    assert [frame.name for frame in robot.frames] == ["left_out", "right_out"]
    assert build_model(robot).n == 2
    assert made({**branches, "tip": "right.out"}, document).tip == "right_out"


def test_every_number_says_its_module_and_text_is_stable() -> None:
    robot = made(assembly(*TWO))
    assert "module elbow of toy" in robot.provenance("wrist_upper.mass_kg").text
    assert "module hand of toy" in robot.provenance("hand.com_m").text
    from armwright.description.database import parse

    text = to_toml(robot)
    again = parse(tomllib.loads(text), "again")
    assert again == robot
    assert to_toml(again) == text


def test_deviations_are_turned_along() -> None:
    """A standard deviation along one axis comes to lie along the axis that it is turned to."""
    document = library()
    elbow = document["modules"][1]
    elbow["bodies"][1] = body("upper", com=(0.1, 0.0, 0.0))
    elbow["bodies"][1]["com_m"] = {"value": [0.1, 0.0, 0.0], "std": [0.003, 0.001, 0.002], "source": "measurement"}
    elbow["bodies"][1]["inertia_kg_m2"]["xx"] = {"value": 0.02, "std": 0.004}
    elbow["joints"][0]["child_frame"] = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, pi / 2]}
    link = made(assembly(put("foot"), put("elbow", "foot.top")), document).link("elbow_upper")
    assert link.com_m.value == pytest.approx((0.0, 0.1, 0.0))
    assert link.com_m.std == pytest.approx((0.001, 0.003, 0.002))
    assert link.com_m.source == "measurement"
    assert (link.inertia_kg_m2.xx.std, link.inertia_kg_m2.yy.std) == (None, pytest.approx(0.004))


def test_limits_may_be_narrower() -> None:
    narrow = {"elbow_turn": {"position_rad": [-1.0, 2.0], "torque_n_m": 30}}
    arm = toy_arm(assembly(*TWO, limits=narrow))
    assert arm.bodies[0].limits.position == (-1.0, 2.0)
    assert (arm.bodies[0].limits.torque, arm.bodies[0].limits.velocity) == (30, 2.0)
    assert arm.bodies[0].limits.acceleration == 5.0


def changed(*path: Any, value: Any) -> dict[str, Any]:
    """The library with one value changed, or taken away (None)."""
    document: Any = library()
    at = document
    for key in path[:-1]:
        at = at[key]
    if value is None:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return document


ELBOW = ("modules", 1)
LIBRARIES = {
    "no inertia_about": (
        (*ELBOW, "bodies", 0, "inertia_about"),
        None,
        "module 'elbow' body 'lower' inertia_about: missing; there is no default",
    ),
    "joint without an axis": (
        (*ELBOW, "joints", 0, "axis"),
        None,
        "module 'elbow' joint 'turn' axis: missing; expected [x, y, z] beside frame",
    ),
    "axis of no length": ((*ELBOW, "joints", 0, "axis"), [0, 0, 0], "expected a direction, 3 numbers not all 0"),
    "NaN": (
        (*ELBOW, "bodies", 0, "mass_kg"),
        float("nan"),
        "module 'elbow' body 'lower' mass_kg = nan: expected a finite number",
    ),
    "closed chain": (
        (*ELBOW, "joints"),
        [library()["modules"][1]["joints"][0], {**library()["modules"][1]["joints"][0], "name": "again"}],
        "body 'upper' is moved by two joints: closed chains are not supported",
    ),
    "body on itself": (
        (*ELBOW, "joints", 0, "child"),
        "lower",
        "body 'lower' carries itself",
    ),
    "two roots": ((*ELBOW, "joints"), [], "bodies 'lower' and 'upper' both hang on no joint; expected one root"),
    "unknown body": ((*ELBOW, "joints", 0, "child"), "uper", "joint 'turn' child = 'uper': no body; did you mean upper"),
    "unknown body of a connector": ((*ELBOW, "connectors", 0, "body"), "lowr", "'in' body = 'lowr': did you mean lower"),
    "unknown ground": (("modules", 0, "ground"), "flor", "module 'foot' ground = 'flor': no connector; did you mean floor"),
    "unknown gender": ((*ELBOW, "connectors", 0, "gender"), "x", "connector 'in' gender = 'x': expected 'm', 'f' or 'n'"),
    "no steps": ((*ELBOW, "connectors", 0, "angle_steps"), 0, "connector 'in' angle_steps = 0"),
    "unknown key": ((*ELBOW, "bodies", 0, "mass"), 1, "module 'elbow' body 'lower' mass = 1: unknown key; did you mean mass_kg"),
    "unknown point": ((*ELBOW, "bodies", 0, "inertia_about"), "centre", "expected 'com' or 'frame'"),
    "DH in a module": (
        (*ELBOW, "joints", 0),
        {**{k: v for k, v in library()["modules"][1]["joints"][0].items() if k not in ("frame", "axis")},
         "dh": {"alpha_rad": 0, "r_m": 0, "a_m": 0, "offset_rad": 0}},
        "expected frame, not dh",
    ),
    "two modules of a name": ((*ELBOW, "name"), "foot", "name = 'foot': two modules have this name"),
    "two connectors of a name": ((*ELBOW, "connectors", 1, "name"), "in", "name = 'in': two connectors have this name"),
    "connector like a body": ((*ELBOW, "connectors", 1, "name"), "upper", "a body and a connector are both called 'upper'"),
    "no source": (("source",), None, "has no source"),
}  # fmt: skip


@pytest.mark.parametrize(("path", "value", "message"), LIBRARIES.values(), ids=LIBRARIES)
def test_libraries_that_are_refused(path: tuple[Any, ...], value: Any, message: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        validated(ModuleLibrary, changed(*path, value=value), file="toy.modules.toml")
    text = str(caught.value)
    assert text.startswith("toy.modules.toml: ")
    assert message in text


ASSEMBLIES = {
    "unknown module": ((put("foot"), put("elbw", "foot.top")), {"place": "module", "value": "elbw"}),
    "unknown carrier": (
        (put("foot"), put("elbow", "feet.top")),
        {"place": "module 'elbow' on", "value": "feet.top", "what": "no such module"},
    ),
    "unknown connector": (
        (put("foot"), put("elbow", "foot.tip")),
        {"place": "connector of module 'foot'", "value": "tip", "choices": ("floor", "top")},
    ),
    "kind": (
        (put("foot"), put("elbow", "foot.top"), put("hand", "elbow.out"), put("bar", "hand.grip", by="in")),
        {"place": "module 'bar' by", "value": "in", "what": "does not fit 'hand.grip': kind is 'grip' and 'bolt'"},
    ),
    "gender": (
        (put("foot"), put("bar", "foot.top", by="out")),
        {"what": "does not fit 'foot.top': gender is 'm' and 'm'; expected m and f, or n and n"},
    ),
    "nothing fits": (
        (put("foot"), put("either", "foot.top")),
        {
            "place": "module 'either' on",
            "value": "foot.top",
            "what": "the module has no connector that fits: 'a': kind is 'bolt' and 'ring'; 'b': kind is 'bolt' and 'ring'",
        },
    ),
    "no step": (
        (put("foot"), put("elbow", "foot.top", 0.5)),
        {"place": "module 'elbow' angle_rad", "value": 0.5, "what": "no step of 'foot.top' and 'elbow.in'"},
    ),
    "half steps": (
        (put("foot"), put("hand", "foot.top", pi / 2)),
        {"value": pi / 2, "expected": "a multiple of 2π/2 = 3.141593 rad"},
    ),
    "no angle": (
        (put("foot"), put("elbow", "foot.top", None)),
        {"place": "module 'elbow' angle_rad", "what": "missing", "expected": "a multiple of 2π/4 rad"},
    ),
    "two roots": (
        (put("foot"), put("elbow")),
        {"what": "modules 'foot' and 'elbow' both stand on the ground", "expected": "on = ... for all but one"},
    ),
    "no root": ((put("elbow", "bar.out"), put("bar", "elbow.out")), {"what": "every module stands on another one"}),
    "ring beside the root": (
        (put("foot"), put("elbow", "bar.out"), put("bar", "elbow.out")),
        {"what": "modules 'elbow' and 'bar' carry each other: closed chains are not supported"},
    ),
    "taken": (
        (put("foot"), put("elbow", "foot.top"), put("bar", "foot.top")),
        {"place": "module 'bar' on", "value": "foot.top", "what": "carries 'elbow' already"},
    ),
    "taken from below": (
        (put("foot"), put("elbow", "foot.top"), put("bar", "elbow.in", by="out")),
        {"place": "module 'bar' on", "value": "elbow.in", "what": "carries 'foot.top' already"},
    ),
    "two of a name": (
        (put("foot"), put("elbow", "foot.top"), put("elbow", "elbow.out")),
        {"place": "module", "value": "elbow", "what": "two modules have this name"},
    ),
    "too many": (
        (put("foot"), put("elbow", "foot.top"), put("bar", "elbow.out"), put("bar", "bar.out", name="more")),
        {"value": "bar", "what": "is used 2 times, as bar, more", "expected": "at most 1, as many as are available"},
    ),
}


@pytest.mark.parametrize(("modules", "fields"), ASSEMBLIES.values(), ids=ASSEMBLIES)
def test_assemblies_that_are_refused(modules: tuple[dict[str, Any], ...], fields: dict[str, Any]) -> None:
    with pytest.raises(DescriptionError) as caught:
        toy_arm(assembly(*modules))
    assert {name: getattr(caught.value, name) for name in fields} == fields
    assert caught.value.file == "arm"


def test_an_arm_that_does_not_move_is_refused() -> None:
    with raises_at(DescriptionError, "arm", "joint that moves"):
        toy_arm(assembly(put("foot"), put("bar", "foot.top")))


def test_a_refusal_is_one_line() -> None:
    with pytest.raises(DescriptionError) as caught:
        toy_arm(assembly(put("foot"), put("elbw", "foot.top")))
    assert str(caught.value) == "arm: module = 'elbw': no such module; did you mean elbow?"


def test_sizes_must_be_equal() -> None:
    document = changed("modules", 2, "connectors", 0, "size", value="60")
    with pytest.raises(DescriptionError) as caught:
        made(assembly(put("foot"), put("bar", "foot.top")), document)
    assert (caught.value.place, caught.value.value) == ("module 'bar' on", "foot.top")
    assert "'in': size is '40' and '60'" in caught.value.what


@pytest.mark.parametrize(
    ("limits", "fields"),
    [
        ({"elbow_tur": {"torque_n_m": 1}}, {"place": "limits", "value": "elbow_tur", "what": "no such joint"}),
        (
            {"elbow_turn": {"torque_n_m": 100}},
            {"place": "limits.elbow_turn.torque_n_m", "value": 100.0, "expected": "it within the module's 60.0"},
        ),
        (
            {"elbow_turn": {"position_rad": [-4, 1]}},
            {"place": "limits.elbow_turn.position_rad", "expected": "it within the module's [-3.0, 3.0]"},
        ),
    ],
)
def test_limits_that_are_refused(limits: dict[str, Any], fields: dict[str, Any]) -> None:
    with pytest.raises(DescriptionError) as caught:
        made(assembly(*TWO, limits=limits))
    assert {name: getattr(caught.value, name) for name in fields} == fields


def test_unknown_limits_are_refused() -> None:
    with raises_at(DescriptionError, "limits.elbow_turn.torque", "torque_n_m", value=1):
        made(assembly(*TWO, limits={"elbow_turn": {"torque": 1}}))


def test_a_tensor_about_the_wrong_point_is_doubted() -> None:
    """Products that are -m c c and nothing else, in a tensor said to be about the centre of mass."""
    document = library()
    com = np.array([0.02, -0.1, 0.05])
    tensor = np.diag([0.004, 0.003, 0.002]) + parallel_axes(0.5, com)
    entries = {k: float(round(tensor[i, j], 6)) for k, i, j in (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))}  # fmt: skip  # noqa: E501
    document["modules"][2]["bodies"][0] |= {"com_m": com.tolist(), "inertia_kg_m2": entries}
    chain = assembly(put("foot"), put("elbow", "foot.top"), put("bar", "elbow.out"))
    remarks = made(chain, document).remarks
    assert len(remarks) == 1
    assert "module 'bar' body 'tube'" in remarks[0]
    assert 'inertia_about = "frame"?' in remarks[0]
    assert any("module 'bar'" in warning for warning in toy_arm(chain, document).warnings)
    document["modules"][2]["bodies"][0]["inertia_about"] = "frame"
    assert made(chain, document).remarks == ()


@pytest.mark.parametrize(
    ("zz", "about", "message"),
    [
        (0.06, "com", "impossible: its principal moments"),
        (0.06, "frame", "and so they would about any other point"),
        (0.035, "frame", 'about the centre of mass it would be possible: did you mean inertia_about = "com"?'),
    ],
)
def test_impossible_bodies_are_named(zz: float, about: str, message: str) -> None:
    document = library()
    tensor = {"xx": 0.02, "xy": 0, "xz": 0, "yy": 0.02, "yz": 0, "zz": zz}
    document["modules"][2]["bodies"][0] |= {"com_m": [0, 0, 0.1], "inertia_kg_m2": tensor, "inertia_about": about}
    chain = assembly(put("foot"), put("elbow", "foot.top"), put("bar", "elbow.out"))
    with pytest.raises(DescriptionError) as caught:
        made(chain, document)
    assert message in caught.value.what
    assert caught.value.place == "module 'bar' body 'tube'"
    document["modules"][2]["bodies"][0]["accept_impossible"] = "as printed"
    assert "as printed" in toy_arm(chain, document).warnings[0]


KEYS = sorted(
    {"name", "modules", "bodies", "connectors", "joints", "frame", "axis", "on", "by", "mass_kg", "tip", "limits"}
)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.sampled_from(KEYS),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=8,
)


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    below = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, inner in below for place in places(inner, (*path, key)))]


@pytest.mark.study
@settings(max_examples=120, deadline=None)
@given(st.data())
def test_whatever_a_file_holds_it_is_read_or_refused(data: st.DataObject) -> None:
    """Anything at any place of either file: an arm, or one line of ours."""
    whole = assembly(*TWO, limits={"elbow_turn": {"torque_n_m": 5}})
    documents = {"library": library(), "assembly": copy.deepcopy(whole)}
    path = data.draw(st.sampled_from([place for place in places(documents) if len(place) > 1]))
    at: Any = documents
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = data.draw(VALUES)
    text, count = "", 0
    try:
        with np.errstate(all="ignore"):  # lengths of 1e200 m are read, and overflow
            build_model(made(documents["assembly"], documents["library"]), on_impossible="warn")
    except DescriptionError as error:
        text, count = str(error), len(error.problems)
    assert len(text.splitlines()) == count + (count > 1)


@pytest.mark.parametrize("name", ["", "improvv", "nowhere.modules.toml", 3])
def test_libraries_that_are_not_there(name: Any) -> None:
    with pytest.raises(DescriptionError):
        read_modules(name)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("imprv", "neither built in nor a file"),
        ("x" * 300, "neither built in nor a file"),
        ("../toy.modules.toml", "leads out of"),
        ("/etc/hostname", "leads out of"),
        ("link.modules.toml", "leads out of"),
        ("a\0b", "leads out of"),
    ],
)
def test_a_mistyped_library_of_an_assembly(name: str, what: str, tmp_path: Path) -> None:
    """Its names are paths below its own folder, or those of built-in libraries."""
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "toy.modules.toml").write_text("")
    if sys.platform != "win32":
        (folder / "link.modules.toml").symlink_to(tmp_path / "toy.modules.toml")
    document = {**assembly(put("foot")), "libraries": ["improv", name]}
    path = folder / "arm.assembly.toml"
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    with pytest.raises(DescriptionError) as error:
        aw.modules.assemble(path)
    assert (error.value.place, error.value.value, error.value.file) == ("libraries[1]", name, str(path))
    assert error.value.what.startswith(what)


def test_what_comes_with_armwright_can_be_read() -> None:
    assert library_names() == ["improv"]
    assert assembly_names() == ["lwa4p", "lwa4p-tool"]
    for name in assembly_names():
        assert build_model(aw.modules.assemble(name)).n == 6


def test_springs_at_joints_are_part_of_what_holds_the_arm():
    """g(q) + s(q), for all poses at once."""
    model = replace(arm("sprung"), cylinders=())
    q = np.random.default_rng(2).normal(size=(5, model.n))
    expected = [aw.gravity_torques(model, pose) + aw.spring_torques(model, pose) for pose in q]
    np.testing.assert_allclose(static_torques(model, q)[0], expected, rtol=0, atol=1e-12 * np.abs(expected).max())
