"""URDF: what is read means what the format says, and what is not read is refused or told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.description.urdf import read_urdf
from armwright.errors import DescriptionError, ModelError
from description.reports import check_report
from description.urdf_files import AXIS, INERTIAL, LIMIT, joint, link, one_joint, robot, written
from raises_at import raises_at


def test_a_chain(tmp_path):
    """Frames, axes, masses and limits, each number where it belongs and with its source."""
    path = written(tmp_path, one_joint('<axis xyz="0 1 0"/>' + LIMIT))
    description = read_urdf(path)
    (one,) = description.joints
    assert (one.name, one.type, one.parent, one.child) == ("j1", "revolute", "base", "upper")
    assert one.frame.xyz_m.value == (0.2, 0.0, 0.0)
    assert one.frame.rpy_rad.value == (0.1, 0.0, 0.0)
    assert one.axis.value == (0.0, 1.0, 0.0)
    assert one.limits.position_rad.value == (-1.0, 1.0)
    assert (float(one.limits.torque_n_m), float(one.limits.velocity_rad_per_s)) == (10.0, 2.0)
    assert float(description.link("upper").mass_kg) == 1.5
    assert description.provenance("upper.mass_kg").kind == "import"
    assert "arm.urdf" in description.provenance("upper.mass_kg").text
    assert description.command == "torque"
    assert not description.remarks
    assert aw.load(path).names == ["j1"]


def test_the_inertial_frame_is_turned(tmp_path):
    """The tensor is in the axes of the inertial origin: R I Rᵀ in the link's, as SciPy turns it."""
    rpy = (0.3, -0.7, 1.1)
    turned = INERTIAL.replace('xyz="0.1 0 0"', 'xyz="0.1 0 0" rpy="0.3 -0.7 1.1"')
    tensor = read_urdf(written(tmp_path, one_joint(moved=turned))).link("upper").inertia_kg_m2.matrix()
    rotation = Rotation.from_euler("xyz", rpy).as_matrix()
    np.testing.assert_allclose(tensor, rotation @ np.diag([0.01, 0.02, 0.02]) @ rotation.T, rtol=0, atol=1e-16)


def test_a_base_with_mass_or_looks_stands_on_the_world(tmp_path):
    """So that nothing of it is lost; a base that is but a name is the base."""
    text = robot(link("pelvis"), link("upper"), joint("j1", "pelvis", "upper"))
    description = read_urdf(written(tmp_path, text))
    assert description.base == "world"
    assert [j.name for j in description.joints] == ["world_to_pelvis", "j1"]
    assert description.total_mass == 3.0
    assert read_urdf(written(tmp_path, one_joint())).base == "base"
    seen = robot(link("base", '<visual><geometry><sphere radius="0.1"/></geometry></visual>'), link("upper"),
                 joint("j1", "base", "upper"))  # fmt: skip
    description = read_urdf(written(tmp_path, seen))
    assert description.base == "world"
    assert description.remarks[0] == "link 'base': no inertia is stated: massless"


@pytest.mark.parametrize(("kind", "unit"), [("revolute", "rad"), ("prismatic", "m")])
def test_friction(tmp_path, kind, unit):
    """Damping is viscous, friction Coulomb's either way: it sticks, or is smoothed over the caller's speed."""
    path = written(tmp_path, one_joint(AXIS + LIMIT + '<dynamics damping="0.5" friction="0.25"/>', kind))
    for options, sticks in (({}, True), ({"smoothing": 0.01}, False)):
        arm = aw.load(path, tip="upper", **options)
        friction = arm.bodies[0].friction
        assert friction is not None
        assert (friction.viscous, friction.coulomb_positive, friction.coulomb_negative) == (0.5, 0.25, 0.25)
        assert (friction.sticks, friction.smoothing) == (sticks, options.get("smoothing"))
        assert not arm.warnings
    assert arm.provenance(f"j1.friction.smoothing_{unit}_per_s").kind == "estimate"


@pytest.mark.parametrize(
    "limit", ['<limit effort="0" velocity="0"/>', '<limit lower="-inf" upper="inf" effort="inf"/>']
)
def test_limits_that_say_nothing(tmp_path, limit):
    arm = aw.load(written(tmp_path, one_joint(AXIS + limit)))
    assert arm.bodies[0].limits.position == (-np.inf, np.inf)
    assert arm.bodies[0].limits.torque == np.inf
    assert any("read as unknown" in warning for warning in arm.warnings)


def test_continuous_and_fixed(tmp_path):
    """A continuous joint has no range; a fixed one carries its child's mass with its parent, exactly."""
    text = robot(
        link("base", ""), link("upper"), link("tool"),
        joint("j1", "base", "upper", AXIS, "continuous"), joint("j2", "upper", "tool", "", "fixed"),
    )  # fmt: skip
    arm = aw.load(written(tmp_path, text))
    assert arm.names == ["j1"]
    assert arm.bodies[0].mass == 3.0
    assert {"upper", "tool"} <= set(arm.frames)
    turn = Rotation.from_euler("x", 0.1).as_matrix()
    com = 0.5 * (np.array([0.1, 0, 0]) + np.array([0.2, 0, 0]) + turn @ [0.1, 0, 0])
    np.testing.assert_allclose(arm.bodies[0].link_frame.inverse().point(arm.bodies[0].com), com, atol=1e-16)


def test_harmless_tags_are_counted(tmp_path):
    more = (
        '<gazebo/><gazebo reference="upper"><material>x</material></gazebo><sensor name="s"/>'
        '<transmission name="t"><joint name="j1"/><actuator name="m"/></transmission>'
    )
    description = read_urdf(
        written(tmp_path, one_joint(AXIS + LIMIT + '<safety_controller k_velocity="1"/>', more=more))
    )
    assert description.notes is not None
    for note in ("gazebo (2)", "sensor (1)", "joint/safety_controller (1)", "base fixed"):
        assert note in description.notes
    assert not description.remarks


@pytest.mark.parametrize(
    ("more", "begins"),
    [
        (
            '<transmission name="t"><joint name="j1"/><actuator name="m"><motorInertia>1e-5</motorInertia></actuator>'
            "</transmission>",
            "transmission 't': <motorInertia> is not used",
        ),
        (
            '<transmission name="t"><joint name="j9"/><actuator name="m"/></transmission>',
            "transmission 't': its joint 'j9' does not exist, and it is not used",
        ),
        (
            '<gazebo reference="upper"><inertial><mass value="3"/></inertial></gazebo>',
            "element 'upper': <gazebo> <inertial> is Gazebo's own and not used",
        ),
        ("and so on", "robot 'arm': text between its elements is not read: 'and so on'"),
    ],
)
def test_nothing_is_dropped_in_silence(tmp_path, more, begins):
    (remark,) = read_urdf(written(tmp_path, one_joint(more=more))).remarks
    assert remark.startswith(begins)


def test_tags_of_a_transmission_may_be_ignored(tmp_path):
    more = '<transmission name="t"><foo/><joint name="j1"/><actuator name="m"/></transmission>'
    description = read_urdf(written(tmp_path, one_joint(more=more)), ignore=["foo"])
    assert "transmission/foo (1)" in (description.notes or "")


def test_names(tmp_path):
    """Names stay as the file has them, but for brackets and quotation marks; what is renamed is told."""
    description = read_urdf(written(tmp_path, one_joint().replace('"upper"', '"link_1.0 tip"')))
    assert description.joints[0].child == "link_1.0 tip"
    description = read_urdf(written(tmp_path, one_joint().replace('"upper"', '"link_1.0[2]"')))
    assert description.joints[0].child == "link_1.0_2_"
    assert description.notes is not None
    assert "link_1.0[2] → link_1.0_2_" in description.notes
    text = robot(link("base", ""), link("a[b"), link("a_b"), joint("j1", "base", "a[b"), joint("j2", "a[b", "a_b"))
    with pytest.raises(DescriptionError) as refused:
        read_urdf(written(tmp_path, text))
    check_report(refused.value, "link 'a_b'", "this and 'a[b' (line 3) would both be called 'a_b'")
    assert refused.value.file.endswith("arm.urdf:4")


def test_mimic_held_at_its_offset(tmp_path):
    """`mimic = "fixed"` holds the joint where it stands while its master is at 0."""
    follow = AXIS + LIMIT + '<mimic joint="j1" multiplier="2" offset="0.3"/>'
    text = robot(link("base", ""), link("upper"), link("tool"), joint("j1", "base", "upper"),
                 joint("j2", "upper", "tool", follow))  # fmt: skip
    path = written(tmp_path, text)
    fixed, free, coupled = (aw.load(path, mimic=how) for how in ("fixed", "independent", "coupled"))
    assert (fixed.n, free.n, coupled.n) == (1, 2, 1)
    pose = aw.forward_kinematics(free, np.array([0.7, 2 * 0.7 + 0.3]), "tool")
    np.testing.assert_allclose(aw.forward_kinematics(coupled, np.array([0.7]), "tool"), pose, atol=1e-15)
    q = np.array([0.7])
    pose = aw.forward_kinematics(free, np.array([0.7, 0.3]), "tool")
    np.testing.assert_allclose(aw.forward_kinematics(fixed, q, "tool"), pose, atol=1e-15)
    assert all(any("mimics another joint" in warning for warning in arm.warnings) for arm in (fixed, free))


@pytest.mark.parametrize(
    ("follow", "line", "place", "words"),
    [
        ('joint="j3"', ":6", "joint 'j2' <mimic joint>", "j1"),
        ('joint="j2"', "", "joint 'j2' mimic", "a chain that ends at a driven joint"),
        ('joint="j1" multiplier="0"', ":6", "joint 'j2' <mimic multiplier>", "another number, or mimic ="),
        ('joint="j1" multiplier="x"', ":6", "<mimic multiplier>", "a finite number"),
    ],
)
def test_mimics_of_nothing_are_refused(tmp_path, follow, line, place, words):
    text = robot(link("base", ""), link("upper"), link("tool"), joint("j1", "base", "upper"),
                 joint("j2", "upper", "tool", f"{AXIS}{LIMIT}<mimic {follow}/>"))  # fmt: skip
    with pytest.raises(DescriptionError) as refused:
        aw.load(written(tmp_path, text))
    check_report(refused.value, place, words)
    assert refused.value.file == f"{tmp_path / 'arm.urdf'}{line}"


def test_visuals(tmp_path):
    """Shapes, colours by name or in place, and meshes on the search path; a missing one is told and not drawn."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.stl").write_text("no mesh, and nobody opens it")
    shapes = '<box size="1 2 3"/>', '<cylinder radius="0.1" length="2"/>', '<sphere radius="0.2"/>'
    meshes = '<mesh filename="meshes/a.stl" scale="0.001 0.001 0.001"/>', '<mesh filename="meshes/none.stl"/>'
    red = '<material name="red"/>'
    visuals = "".join(f"<visual><geometry>{shape}</geometry>{red}</visual>" for shape in (*shapes, *meshes))
    named = '<material name="red"><color rgba="1 0 0 1"/></material>'
    description = read_urdf(written(tmp_path, one_joint(moved=INERTIAL + visuals, more=named)))
    found = description.link("upper").visuals
    assert [visual.solid.shape for visual in found] == ["box", "cylinder", "sphere", "mesh"]
    assert {visual.colour for visual in found} == {(1.0, 0.0, 0.0)}
    assert found[3].solid.path == (tmp_path / "meshes" / "a.stl").resolve()
    assert any("not on the search path" in remark for remark in description.remarks)


REDUCTION = "<transmission name='t'><joint name='j1'/><actuator name='a'>{}</actuator></transmission>"
TREE = (link("base", ""), link("upper"), link("fore"))
REFUSALS = [  # file and line, place, and some of what the error says
    ("<robot name='x'>", "arm.urdf:1", "", "not XML: no element found"),
    ("<mujoco/>", "arm.urdf:1", "<mujoco>", "a URDF, whose first element is <robot>"),
    ("<robot><link name='a'/></robot>", "arm.urdf:1", "<robot> name", 'name="…"'),
    ("<robot name='x'/>", "arm.urdf:1", "robot 'x' <link>", "at least one"),
    ('<!DOCTYPE r [<!ENTITY a "b">]><robot name="x"/>', "arm.urdf:1", "", "declares a document type or entities"),
    ('<?xml version="1.0" encoding="klingon"?><robot name="x"/>', "arm.urdf", "",
     "not XML that can be read: unknown encoding: klingon"),
    (b'<robot name="\xff"/>', "arm.urdf:1", "", "not XML: not well-formed (invalid token)"),
    ("<a>" * 200, "arm.urdf:1", "<a>", "more than 100 elements within each other"),
    (robot("<xacro:property name='a' value='1'/>", link("a")), "arm.urdf:2", "<xacro:property>",
     "a tag of xacro, a program that writes URDF: run it first, xacro"),
    (robot("<loop_joint/>", link("a")), "arm.urdf:2", "<loop_joint>", "joint"),
    (one_joint(AXIS + LIMIT + "<dynamic damping='1'/>"), "arm.urdf:4", "<dynamic>", "dynamics"),
    (one_joint(AXIS + LIMIT + "<dynamics dampin='1'/>"), "arm.urdf:4", "<dynamics> dampin", "damping"),
    (one_joint(AXIS + LIMIT + "<dynamics damping='-1'/>"), "arm.urdf:4", "joint 'j1' damping", "a number of 0 or more"),
    (one_joint(LIMIT), "arm.urdf:4", "joint 'j1' <axis>", 'one, such as <axis xyz="0 0 1"/>'),
    (one_joint("<axis xyz='0 0 0'/>" + LIMIT), "arm.urdf:4", "joint 'j1' <axis xyz>", "a direction"),
    (one_joint("<axis xyz='0 0'/>" + LIMIT), "arm.urdf:4", "<axis xyz>", "3 finite numbers"),
    (one_joint("<axis xyz='0 0 nan'/>" + LIMIT), "arm.urdf:4", "<axis xyz>", "3 finite numbers"),
    (one_joint("<axis xyz='0 0 1_0'/>" + LIMIT), "arm.urdf:4", "<axis xyz>", "3 finite numbers"),
    (one_joint(AXIS + AXIS + LIMIT), "arm.urdf:4", "<axis>", "a second one in one <joint>"),
    (one_joint(AXIS + "<limit lower='1' upper='-1'/>"), "arm.urdf:4", "joint 'j1' lower", "a number below upper = -1"),
    (one_joint(AXIS + "<limit effort='-3'/>"), "arm.urdf:4", "joint 'j1' <limit effort>", "a number of 0 or more"),
    (one_joint(kind="planar"), "arm.urdf:4", "joint 'j1' type",
     "not offered: an arm's base is fixed, and its joints turn or slide"),
    (one_joint(kind="floating"), "arm.urdf:4", "joint 'j1' type",
     "not offered: an arm's base is fixed, and its joints turn or slide"),
    (one_joint(kind="revolut"), "arm.urdf:4", "joint 'j1' type", "revolute"),
    (one_joint(moved="<inertial><mass value='1'/></inertial>"), "arm.urdf:3", "link 'upper' <inertia>", "missing"),
    (one_joint(moved=INERTIAL.replace('"1.5"', '"-1"')), "arm.urdf:3", "link 'upper' mass", "a number of 0 or more"),
    (one_joint(moved=INERTIAL.replace('"1.5"', '"1e400"')), "arm.urdf:3", "<mass value>", "a finite number"),
    (one_joint(moved=INERTIAL.replace('"1.5"', '"1e200"')), "arm.urdf:3", "<mass>", "a number of a robot, in SI units"),
    (one_joint(moved=INERTIAL.replace('izz="0.02"', 'izz="-0.02"')), "arm.urdf:3", "link 'upper' inertia",
     "moments of inertia of 0 or more [kg m²] in link axes"),
    (one_joint(moved=INERTIAL.replace(' izz="0.02"', "")), "arm.urdf:3", "<inertia> izz", 'izz="…"'),
    (one_joint(moved="<origin xyz='1 0 0'/>" + INERTIAL), "arm.urdf:3", "link 'upper' <origin>", "means nothing in a link"),
    (one_joint(moved="<gravity>0</gravity>" + INERTIAL), "arm.urdf:3", "link 'upper' <gravity>", "1"),
    (robot(*TREE, joint("j1", "base", "upper")), "arm.urdf:4", "<link>", "2 links are no joint's child, base, fore"),
    (robot(*TREE[:2], joint("j1", "base", "uper")), "arm.urdf:4", "joint 'j1' child", "upper"),
    (robot(*TREE[:2], TREE[1], joint("j1", "base", "upper")), "arm.urdf:4", "link 'upper'",
     "a second one, the first is in line 3"),
    (robot(*TREE, joint("j1", "base", "upper"), joint("j1", "upper", "fore")), "arm.urdf:6", "joint 'j1'",
     "a second one, the first is in line 5"),
    (robot(*TREE, joint("j1", "base", "upper"), joint("j2", "upper", "fore"), joint("j3", "base", "fore")), "arm.urdf:7",
     "link 'fore'", "the child of two joints, 'j2' and 'j3': closed chains are not offered"),
    (robot(*TREE, joint("j1", "fore", "upper"), joint("j2", "upper", "fore")), "arm.urdf:3", "link 'upper'", "carries itself"),
    (robot(*TREE[:2], joint("j1", "upper", "base"), joint("j2", "base", "upper")), "arm.urdf:1", "<robot>",
     "every link is a joint's child"),
    (one_joint(moved=INERTIAL + "<visual/>"), "arm.urdf:3", "<visual> <geometry>", "missing"),
    (one_joint(moved=INERTIAL + "<visual><geometry><mesh filename='../../../etc/a.stl'/></geometry></visual>"), "arm.urdf:3",
     "<mesh>", "leads out of "),
    (one_joint(moved=INERTIAL + "<visual><geometry><mesh filename='http://x/a.stl'/></geometry></visual>"), "arm.urdf:3",
     "<mesh>", "nothing is fetched"),
    (one_joint(moved=INERTIAL + "<visual><geometry><box size='0 1 1'/></geometry></visual>"), "arm.urdf:3", "<box>",
     "sizes above 0"),
    (one_joint(more=REDUCTION.format("<mechanicalReduction>x</mechanicalReduction>")),
     "arm.urdf:5", "<mechanicalReduction>", "a number other than 0"),
    (one_joint(more=REDUCTION.format("<mechanicalReductio>5</mechanicalReductio>")),
     "arm.urdf:5", "<mechanicalReductio>", "mechanicalReduction"),
    (one_joint(more="<transmission name='t'><foo/><joint name='j1'/></transmission>"), "arm.urdf:5", "<foo>",
     "unknown in <transmission> of transmission 't', and could carry physics"),
    (one_joint(moved=INERTIAL.replace('"1.5"', '"${m}"')), "arm.urdf:3", "<mass value>",
     "an expression of xacro, a program that writes URDF: run it first,"),
    (one_joint(moved=INERTIAL + "<visual><geometry><mesh filename='$(find x)/a.stl'/></geometry></visual>"), "arm.urdf:3",
     "<mesh filename>", "an expression of xacro, a program that writes URDF: run it first,"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line", "place", "words"), REFUSALS)
def test_refusals(tmp_path, text, line, place, words):
    with pytest.raises(DescriptionError) as refused:
        read_urdf(written(tmp_path, text))
    check_report(refused.value, place, words)
    assert refused.value.file == str(tmp_path / line)


def test_the_sentence(tmp_path):
    """The nearest tag and the way out stand beside the file and line."""
    path = written(tmp_path, one_joint(AXIS + LIMIT + "<dynamic damping='1'/>"))
    with pytest.raises(DescriptionError) as refused:
        read_urdf(path)
    assert str(refused.value) == (
        f"{path}:4: <dynamic>: unknown in <joint>, and could carry physics; expected a tag that is read, or "
        "ignore = ['dynamic']; did you mean dynamics?"
    )


def test_a_tag_may_be_ignored_by_name(tmp_path):
    path = written(tmp_path, robot("<loop_joint/>", *TREE[:2], joint("j1", "base", "upper")))
    description = read_urdf(path, ignore=["loop_joint"])
    assert description.notes is not None
    assert "loop_joint (1)" in description.notes


@pytest.mark.parametrize(
    ("options", "place", "words"),
    [
        ({"mimic": "maybe"}, "mimic", "coupled"),
        ({"smoothing": 0.0}, "smoothing", "or none: friction then sticks"),
        ({"smoothing": "x"}, "smoothing", "a speed above 0"),
        ({"packages": ["/nowhere/at/all"]}, "packages", "no such folder"),
        ({"drive": "/nowhere/at/all.toml"}, "", "no such file"),
        ({"colour": 1}, "colour", "unknown option"),
        ({"ignore": ["nonsense"]}, "ignore", "there is no such tag that would be refused"),
        ({"ignore": ["inertial"]}, "ignore", "it is read, and cannot be left out"),
        ({"ignore": "loop_joint"}, "ignore", "a list of tags, ['loop_joint']"),
    ],
)
def test_options(tmp_path, options, place, words):
    with pytest.raises(DescriptionError) as refused:
        aw.load(written(tmp_path, one_joint()), **options)
    check_report(refused.value, place, words)
    with pytest.raises(DescriptionError) as refused:
        aw.load("two-link", **options)
    check_report(refused.value, next(iter(options)), "unknown option")


def test_files_that_are_none(tmp_path):
    with raises_at(DescriptionError, file=tmp_path / "none.urdf"):
        aw.load(tmp_path / "none.urdf")
    (tmp_path / "folder.urdf").mkdir()
    with raises_at(DescriptionError, file=tmp_path / "folder.urdf"):
        aw.load(tmp_path / "folder.urdf")
    with raises_at(DescriptionError, "<sdf>", r"\(<robot>\) .*\(<mujoco>\)"):
        aw.load(written(tmp_path, "<sdf/>", "a.xml"))
    assert aw.load(written(tmp_path, one_joint(), "a.xml")).names == ["j1"]


def test_an_impossible_inertia(tmp_path):
    """Refused with the link and by how much; the caller may load it."""
    path = written(tmp_path, one_joint(moved=INERTIAL.replace('ixx="0.01"', 'ixx="0.1"')))
    with raises_at(DescriptionError, "link 'upper' inertia_kg_m2", "xx = 0.1 > yy"):
        aw.load(path)
    assert any("impossible inertia" in warning for warning in aw.load(path, on_impossible="warn").warnings)


def test_the_tip_of_a_chain_is_told_and_may_be_named(tmp_path):
    text = robot(
        link("base", ""), link("upper"), link("hand"), joint("j1", "base", "upper"), joint("j2", "upper", "hand")
    )
    path = written(tmp_path, text)
    arm = aw.load(path)
    (warning,) = arm.warnings
    assert (arm.tip, "it is 'hand', the last link of the chain" in warning) == ("hand", True)
    named = aw.load(path, tip="upper")
    assert (named.tip, named.warnings) == ("upper", ())
    written(tmp_path, 'tip = "upper"', "arm.drive.toml")
    named = aw.load(path)
    assert (named.tip, named.warnings) == ("upper", ())
    with pytest.raises(DescriptionError) as refused:
        aw.load(path, tip="hnad")
    check_report(refused.value, "tip", "hand")
    assert aw.load("cmu-dd", tip="link3").tip == "link3"


def test_a_tree_needs_a_tip(tmp_path):
    text = robot(
        link("base", ""), link("left"), link("right"), joint("j1", "base", "left"), joint("j2", "base", "right")
    )
    arm = aw.load(written(tmp_path, text))
    assert (arm.tip, arm.warnings) == (None, ())
    with pytest.raises(ModelError, match="right"):
        aw.jacobian(arm, [0.0, 0.0])


@pytest.mark.parametrize(
    "name", ["package://ur/meshes/a.stl", "file:///home/else/ur/meshes/a.stl", "../ur/meshes/a.stl"]
)
def test_meshes_are_found_in_the_folder_that_the_caller_names(tmp_path, name):
    (tmp_path / "robot").mkdir()
    (tmp_path / "store" / "meshes").mkdir(parents=True)
    mesh = (tmp_path / "store" / "meshes" / "a.stl").resolve()
    mesh.write_bytes(b"solid a\nendsolid a\n")
    visual = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    path = written(tmp_path / "robot", one_joint(moved=INERTIAL + visual))
    arm = aw.load(path, meshes=tmp_path / "store")
    (found,) = arm.description.links[0].visuals
    assert found.solid.path == mesh
    with pytest.raises(DescriptionError) as refused:
        aw.load(path, meshes=tmp_path / "nowhere")
    check_report(refused.value, "meshes", "no such folder")
