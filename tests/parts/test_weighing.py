"""Section → part → link: however a body is cut and wherever it stands, it is the same body; measurements override."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from armwright.errors import DescriptionError
from armwright.parts.mass_properties import weigh
from armwright.parts.records import PolarPattern
from armwright.solids.moments import Moments, total
from armwright.solids.shapes import Box
from armwright.spatial import Placement, rotation_rpy, rpy_angles
from parts.parts_arms import database, part, section

STEEL = 7850.0
angles = st.tuples(*[st.floats(-3.1, 3.1)] * 3)
places = st.tuples(*[st.floats(-2, 2)] * 3)
poses = st.builds(lambda p, a: Placement(rotation_rpy(*a), np.array(p)), places, angles)


def pose(placement: Placement) -> dict:
    """As a file has it."""
    return {"xyz_m": placement.position.tolist(), "rpy_rad": np.asarray(rpy_angles(placement.rotation)).tolist()}


def moments(*parts, **changes) -> Moments:
    """Of the one link."""
    (link,) = weigh(database(*parts, **changes))
    return link.moments


def same(one: Moments, two: Moments, size: float = 1.0) -> None:
    """To rounding, for a body of that reach."""
    np.testing.assert_allclose(one.matrix, two.matrix, atol=1e-12 * two.amount * size**2)


def cut(box: np.ndarray, cuts) -> list[np.ndarray]:
    """A box (2, 3) in pieces by planes: each (which piece, axis, where)."""
    pieces = [box]
    for which, axis, share in cuts:
        low, high = pieces.pop(which % len(pieces))
        plane = low[axis] + share * (high[axis] - low[axis])
        below, above = high.copy(), low.copy()
        below[axis], above[axis] = plane, plane
        pieces += [np.array([low, below]), np.array([above, high])]
    return pieces


@settings(max_examples=80)
@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(0, 2), st.floats(0.05, 0.95)), max_size=7),
    st.lists(st.integers(0, 2), min_size=8, max_size=8),
    poses, poses, poses,
)  # fmt: skip
def test_a_body_cut_in_any_way_is_the_same_link(cuts, owners, link_frame, whole_pose, part_pose):
    """A box cut by any planes, its pieces dealt out to parts, in any frames: the mass properties of the box."""
    box = np.array([[-0.2, -0.1, -0.3], [0.3, 0.2, 0.1]])
    whole = Box(shape="box", size_m=(box[1] - box[0]).tolist())
    middle = Placement(np.eye(3), box.mean(axis=0))
    wanted = (whole.moments() * STEEL).placed(link_frame @ whole_pose @ middle)
    parts: list[list] = [[], [], []]
    for k, (low, high) in enumerate(cut(box, cuts)):
        at = part_pose.inverse() @ whole_pose @ Placement(np.eye(3), (low + high) / 2)
        solid = {"shape": "box", "size_m": (high - low).tolist()}
        parts[owners[k]].append(section(f"piece {k}", solid=solid, **pose(at)))
    dealt = [part(*pieces, name=f"{k}", **pose(part_pose)) for k, pieces in enumerate(parts) if pieces]
    same(moments(*dealt, frame=pose(link_frame)), wanted, size=6.0)


@settings(max_examples=40)
@given(poses, st.floats(0.01, 0.2), st.floats(0.1, 0.9))
def test_holes_are_exact(at, radius, share):
    """A cylinder less a bore is a tube, two semi-cylinders are a cylinder, a cone less its tip a frustum."""
    size, bore, length = radius, share * radius, 0.3

    def round_(name, shape="cylinder", **dimensions):
        hole = dimensions.pop("hole", False)
        here = dimensions.pop("at", at)
        return section(name, solid={"shape": shape, **dimensions}, hole=hole, **pose(here))

    tube = round_("tube", "tube", outer_radius_m=size, inner_radius_m=bore, length_m=length)
    bored = [
        round_("full", radius_m=size, length_m=length),
        round_("bore", radius_m=bore, length_m=length, hole=True),
    ]
    same(moments(part(*bored)), moments(part(tube)), size=5.0)
    turned = at @ Placement(rotation_rpy(0.0, 0.0, np.pi), np.zeros(3))
    halves = [round_(f"{k}", "semi-cylinder", radius_m=size, length_m=length, at=p) for k, p in enumerate((at, turned))]
    same(moments(part(*halves)), moments(part(bored[0])), size=5.0)
    cone = round_("cone", "cone", bottom_radius_m=size, top_radius_m=0, length_m=length)
    tip = round_("tip", "cone", bottom_radius_m=bore, top_radius_m=0, length_m=share * length, hole=True,
                 at=at @ Placement(np.eye(3), np.array([0, 0, length * (1 - share) / 2])))  # fmt: skip
    frustum = round_("f", "cone", bottom_radius_m=size, top_radius_m=bore, length_m=length * (1 - share),
                     at=at @ Placement(np.eye(3), np.array([0, 0, -length * share / 2])))  # fmt: skip
    same(moments(part(cone, tip)), moments(part(frustum)), size=5.0)


def test_holes_in_one_of_several_materials():
    """Steel and copper side by side: the hole takes out what it names."""
    beside = section("b", material="copper", xyz_m=[0.0, 0.0, 0.2])
    hole = section("hole", hole=True, solid={"shape": "box", "size_m": [0.01, 0.1, 0.1]})
    whole = moments(part(section(), beside)).amount
    for material, density in (("steel", 7850.0), ("copper", 8960.0)):
        left = moments(part(section(), beside, {**hole, "material": material})).amount
        assert whole - left == pytest.approx(1e-4 * density, rel=2e-3)


def test_patterns():
    """Copies in a row and about an axis are the sections that one would write one by one."""
    row = section("row", count=3, pattern={"type": "linear", "step_m": [0.0, 0.5, 0.0]})
    singles = [section(f"{k}", xyz_m=[0.0, 0.5 * k, 0.0]) for k in range(3)]
    same(moments(part(row)), moments(part(*singles)))
    ring = section(
        "ring",
        xyz_m=[0.4, 0.0, 0.0],
        count=4,
        pattern={"type": "polar", "axis": [0, 0, 2], "through_m": [0.1, 0.0, 5.0]},
    )
    quarter = np.pi / 2
    spots = [([0.4, 0.0, 0.0], 0.0), ([0.1, 0.3, 0.0], quarter), ([-0.2, 0.0, 0.0], 0.0), ([0.1, -0.3, 0.0], quarter)]
    singles = [section(f"{k}", xyz_m=at, rpy_rad=[0.0, 0.0, turn]) for k, (at, turn) in enumerate(spots)]
    same(moments(part(ring)), moments(part(*singles)))
    polar = PolarPattern(type="polar", axis=[0, 1, 0], through_m=[0, 0, 0], step_rad=0.3)
    last = polar.copies(3)[2].rotation
    np.testing.assert_allclose(last, rotation_rpy(0.0, 0.6, 0.0), atol=1e-14)


BODY = moments(part(section()))


def test_weighed_mass_scales_everything():
    """The centre stays, mass and tensor keep their ratio."""
    weighed = moments(part(section(xyz_m=[0.1, 0.0, 0.0]), weighed_mass_kg=20.0))
    computed = moments(part(section(xyz_m=[0.1, 0.0, 0.0])))
    same(weighed, computed * (20.0 / computed.amount))


def test_measured_centre_shifts_the_part():
    """The tensor about the centre of mass is kept."""
    found = moments(part(section(), measured_com_m=[0.01, 0.02, 0.0]))
    np.testing.assert_allclose(found.centre, [0.01, 0.02, 0.0], atol=1e-15)
    np.testing.assert_allclose(found.tensor, BODY.tensor, atol=1e-14)


def test_measured_tensor_replaces_the_computed():
    tensor = {"xx": 0.09, "yy": 0.08, "zz": 0.04, "xy": 0.001, "xz": 0.0, "yz": 0.0}
    found = moments(part(section(), measured_inertia_kg_m2=tensor))
    np.testing.assert_allclose(found.tensor, [[0.09, 0.001, 0], [0.001, 0.08, 0], [0, 0, 0.04]], atol=1e-15)
    alone = moments(part(weighed_mass_kg=3.0, measured_com_m=[0.1, 0, 0], measured_inertia_kg_m2=tensor))
    assert alone.amount == 3.0
    np.testing.assert_allclose(alone.tensor, found.tensor, atol=1e-15)


@settings(max_examples=40)
@given(
    places, st.lists(places.filter(lambda a: np.linalg.norm(a) > 0.1), min_size=1, max_size=2), st.floats(0.95, 1.05)
)
def test_pendulums_are_believed(through, axes, share):
    """About the axes that were swung the moment is the measured one; right measurements change nothing."""
    if len(axes) == 2 and np.linalg.norm(np.cross(axes[0], axes[1])) < 0.05:
        axes = axes[:1]

    def about(body, axis):
        unit = np.array(axis) / np.linalg.norm(axis)
        return float(unit @ body.tensor_about(np.array(through)) @ unit)

    def swung(factor):
        return [
            {"axis": list(axis), "through_m": list(through), "inertia_kg_m2": about(BODY, axis) + (factor - 1) * 0.05}
            for axis in axes
        ]

    found = moments(part(section(), pendulums=swung(share)))
    for axis in axes:
        assert about(found, axis) == pytest.approx(about(BODY, axis) + (share - 1) * 0.05, rel=1e-9)
    same(moments(part(section(), pendulums=swung(1.0))), BODY, size=10.0)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([part(section(), section("hole", hole=True))], "take away more"),
        ([part(section(), section("hole", hole=True, density_kg_per_m3=1e5))], "section of"),
        ([part(section(material="copper"), section("hole", hole=True))], "steel, .*copper"),
        ([part(section(material="steel"), section("b", material="copper"), section("hole", hole=True, count=1))],
         "materials .*steel or"),
        ([part(section("hole", hole=True))], "has nothing to"),
        ([part(section(), pendulums=[{"axis": [0, 0, 1], "through_m": [1, 0, 0], "inertia_kg_m2": 1}])],
         "= 1.0: .*more than"),
        ([part(section(), pendulums=[{"axis": [0, 0, k], "through_m": [0, 0, 0], "inertia_kg_m2": 1} for k in (1, 2)])],
         "the same axes"),
        ([part(section(), measured_inertia_kg_m2={"xx": 1, "yy": 1, "zz": 3, "xy": 0, "xz": 0, "yz": 0})],
         "as it was"),
        ([part(section(solid={"shape": "sphere", "radius_m": 1e-200}))], "a volume of 0"),
        ([part(section(xyz_m=[1e200, 0, 0]))], "not a finite number"),
    ],
)  # fmt: skip
def test_parts_that_cannot_be(parts, message):
    with pytest.raises(DescriptionError, match=message) as caught:
        weigh(database(*parts))
    assert caught.value.place.startswith("link 'arm' part '10-01'")


def test_sums_are_whatever_order():
    """Moments add up."""
    bodies = [BODY.placed(Placement(rotation_rpy(k, 0.0, 0.0), np.array([k, 0.0, 1.0]))) for k in range(4)]
    same(total(bodies), total(bodies[::-1]), size=4.0)
