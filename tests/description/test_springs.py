"""Springs in robot files: read, written again, varied, refused with place and key, and doubted where they look like a mistake."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.description.paths import unit_at
from armwright.description.springs import LinearSpringRecord
from armwright.description.writer import to_toml
from armwright.errors import DescriptionError, ModelError
from armwright.export.urdf import write_urdf
from armwright.model import build_model
from armwright.model.vary import Varied
from armwright.validation import validated
from description.reports import check_report
from description.test_drive_effects import record
from physics.arms import arm, sprung
from raises_at import raises_at

LINE = {"stiffness_n_m_per_rad": 30.0, "rest_rad": 0.2, "preload_n_m": 1.0}
TABLE = {"positions_rad": [-1.0, 0.0, 2.0], "torques_n_m": [3.0, 0.0, -1.0], "outside": "constant"}
GAS = {"name": "gas", "link_a": "base", "anchor_a_m": [0.3, 0.0, 0.1], "link_b": "rod", "anchor_b_m": [0.2, 0.0, 0.05],
       "force_n": 300.0, "length_m": 0.2, "stiffness_n_per_m": 500.0}  # fmt: skip


def without(table, *keys):
    return {key: value for key, value in table.items() if key not in keys}


def test_a_description_with_springs_is_written_and_read(tmp_path):
    """Back to the same bytes, as a table of its own for each."""
    text = to_toml(parse(sprung(), "sprung"))
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    assert to_toml(aw.load(tmp_path / "arm.toml").record) == text
    assert text.count("[joints.spring]") == 4
    assert text.count("[[cylinders]]") == 3


def test_a_urdf_has_them_in_its_drive_file(tmp_path):
    """Anchors in link frames that the URDF has moved, too: those of classic Denavit-Hartenberg parameters."""
    puma = aw.load("puma560").record.model_dump(exclude_none=True)
    ends = {"link_a": "link1", "anchor_a_m": [0.2, 0.3, 0.0], "link_b": "link2", "anchor_b_m": [-0.3, 0.1, 0.0]}
    puma["cylinders"] = [{**GAS, **ends, "source": "estimate"}]
    for robot in (aw.RobotDescription(**puma), parse(sprung(), "sprung")):
        losses = write_urdf(robot, tmp_path / "arm.urdf")
        assert any(
            "forces between two links: cylinder" in loss and "(kept in arm.drive.toml)" in loss for loss in losses
        )
        ours, back = build_model(robot, on_impossible="warn"), aw.load(tmp_path / "arm.urdf", on_impossible="warn")
        q = np.random.default_rng(0).normal(size=ours.n)
        np.testing.assert_allclose(aw.spring_torques(back, q), aw.spring_torques(ours, q), rtol=1e-12, atol=1e-12)


REFUSALS = [  # robot, joint, place, and some of what the error says
    ({}, {"spring": {}}, "joint 'hinge' spring", "stiffness_n_m_per_rad and rest_rad, or a table"),
    ({}, {"spring": {**LINE, **TABLE}}, "joint 'hinge' spring", "stiffness_n_m_per_rad and rest_rad, or a table"),
    ({}, {"spring": without(LINE, "rest_rad")}, "joint 'hinge' spring.stiffness_n_m_per_rad", "needs rest_rad beside it"),
    ({}, {"spring": without(TABLE, "outside")}, "joint 'hinge' spring.positions_rad", "needs outside"),
    ({}, {"spring": {**TABLE, "torques_n_m": [1.0, 2.0]}}, "joint 'hinge' spring.torques_n_m", "3 numbers, as in positions_rad"),
    ({}, {"spring": {**TABLE, "positions_rad": [0.0, 0.0, 1.0]}}, "joint 'hinge' spring.positions_rad", "above the"),
    ({}, {"spring": {**TABLE, "outside": "refused"}}, "joint 'hinge' spring.outside", "constant"),
    ({}, {"spring": {"stiffness_n_per_m": 3.0, "rest_m": 0.0}}, "joint 'hinge' spring.stiffness_n_per_m", "unknown key"),
    ({}, {"spring": {**LINE, "stiffness_n_m_per_rad": -1.0}}, "joint 'hinge' spring.stiffness_n_m_per_rad", "0 or more"),
    ({"cylinders": [{**GAS, "link_b": "base"}]}, {}, "cylinder 'gas' link_b", "a link that does"),
    ({"cylinders": [{**GAS, "link_b": "arm"}]}, {}, "cylinder 'gas' link_b", "rod"),
    ({"cylinders": [{**GAS, "name": "rod"}]}, {}, "cylinders name", "a joint, link or frame has this name"),
    ({"cylinders": [GAS, GAS]}, {}, "name", "two cylinders have this name"),
    ({"cylinders": [{**GAS, "length_m": 0.0}]}, {}, "cylinder 'gas' length_m", "a number above 0"),
    ({"cylinders": [without(GAS, "force_n")]}, {}, "cylinder 'gas' force_n", "missing"),
]  # fmt: skip


@pytest.mark.parametrize(("robot", "joint", "place", "words"), REFUSALS)
def test_refusals(robot, joint, place, words):
    with pytest.raises(DescriptionError) as refused:
        parse(record(robot, **joint), "one")
    check_report(refused.value, place, words)


ON_AXIS = {**GAS, "anchor_a_m": [0.1, 0.2, 0.0], "anchor_b_m": [0.0, -0.1, 0.0]}  # the second on the hinge, along y


@pytest.mark.parametrize("ends", [{}, {"anchor_a_m": [0.0, 0.0, 0.0], "anchor_b_m": [0.0, 0.0, 0.0]}])
def test_a_cylinder_that_no_joint_stretches_is_refused(ends):
    robot = parse(record({"cylinders": [{**ON_AXIS, **ends}]}), "one")
    with pytest.raises(DescriptionError) as refused:
        build_model(robot)
    check_report(refused.value, "cylinder 'gas'", "no joint changes its length")


def test_variants_leave_cylinders_out_that_nothing_stretches_any_more():
    """From the base to a place on the elbow's axis, which the shoulder alone moves."""
    robot = aw.load("two-link").record
    ends = {
        "link_b": robot.links[1].name,
        "anchor_a_m": [0.3, 0.0, 0.5],
        "anchor_b_m": [0.0, 0.0, 0.1],
        "length_m": 0.6,
    }
    robot = aw.RobotDescription(
        **{**robot.model_dump(exclude_none=True), "cylinders": [{**GAS, **ends, "source": "estimate"}]}
    )
    whole = build_model(robot)
    assert whole.with_locked({"shoulder": 0.3}).cylinders == ()
    assert len(whole.with_locked({"elbow": 0.3}).cylinders) == 1


DOUBTS = [
    ({}, {"spring": TABLE, "limits": {"position_rad": [-1.5, 1.0]}}, "its table ends before the limits, -1.5 to 1 rad"),
    ({}, {"spring": {**LINE, "rest_rad": 90.0}}, "degrees for radians?"),
    ({"cylinders": [{**GAS, "length_m": 200.0}]}, {}, "millimetres for metres?"),
    ({"cylinders": [{**GAS, "length_m": 0.9}]}, {}, "another anchor or length?"),
    (
        {"cylinders": [{**GAS, "anchor_a_m": [0.2, 0.0, 0.05]}]},
        {},
        "its ends meet, and its force then has no direction",
    ),
    (
        {"cylinders": [{**GAS, "anchor_a_m": [0.0, 0.0, 0.3], "anchor_b_m": [0.3, 0.0, 0.0], "length_m": 0.4}]},
        {},
        "its ends meet",
    ),
    (
        {"cylinders": [{**GAS, "anchor_a_m": [0.0, 0.0, 0.3], "anchor_b_m": [0.302, 0.0, 0.0]}]},
        {},
        "come within 0.002 m of",
    ),
]


@pytest.mark.parametrize(("robot", "joint", "words"), DOUBTS)
def test_doubts(robot, joint, words):
    assert any(words in warning for warning in build_model(parse(record(robot, **joint), "one")).warnings)


def test_good_springs_raise_none():
    good = record({"cylinders": [GAS]}, spring=TABLE, limits={"position_rad": [-1.0, 1.5]})
    assert build_model(parse(good, "one")).warnings == ()


NAMES = ["joint1.spring.preload_n_m", "joint4.spring.torques_n_m[1]", "joint2.spring.positions_m[2]", "across.length_m",
         "balancer.anchor_b_m", "long.force_n"]  # fmt: skip


def test_every_number_of_a_spring_may_vary():
    """The varied model is the arm whose record has those values, and units are those of the keys."""
    varied = Varied(arm("sprung"), NAMES)
    values = varied.nominal + 0.05
    other = arm("sprung").with_values(dict(zip(varied.names, values.tolist(), strict=True)))
    q = np.random.default_rng(4).normal(size=5)
    np.testing.assert_allclose(aw.spring_torques(varied.model(values), q), aw.spring_torques(other, q), rtol=1e-12)
    assert np.abs(aw.spring_torques(other, q) - aw.spring_torques(arm("sprung"), q)).min() > 0.0
    assert [unit_at(name) for name in NAMES] == ["N m", "N m", "m", "m", "m", "N"]
    compiled = aw.compile(arm("sprung"), vary=NAMES)
    batch = np.stack([varied.nominal, values])
    expected = [aw.spring_torques(arm("sprung"), q), aw.spring_torques(other, q)]
    np.testing.assert_allclose(compiled.spring_torques(q, parameters=batch), expected, rtol=0, atol=1e-12)


def test_positions_of_a_table_stay_in_order():
    varied = Varied(arm("sprung"), ["joint2.spring.positions_m[2]"])
    varied.check(np.array([[0.3], [0.8]]))
    with pytest.raises(ModelError) as refused:
        varied.check(np.array([[0.3], [0.9]]))
    assert refused.value.place == "parameters[1] joint2.spring.positions_m"
    assert "each above the one before" in refused.value.expected


CLOSE = ([-0.2, 0.0, 1e-160], [0.0, 0.0, 1.0], [-1e308, 1e308, -1e308], [1.0, 1.0 + 1e-12, 1e3])


@pytest.mark.parametrize("positions", CLOSE)
def test_points_that_rounding_brings_together_are_refused(positions):
    """The slope between them would be a division by zero."""
    with raises_at(DescriptionError, "positions_m", "above the"):
        validated(
            LinearSpringRecord,
            {"positions_m": positions, "forces_n": [1, 0, 2], "outside": "linear"},
            error=DescriptionError,
        )


def test_springs_that_were_taken_away_do_not_vary():
    for name in ("joint1.spring.rest_rad", "across.length_m"):
        with pytest.raises(ModelError, match="springs"):
            Varied(arm("sprung").replace(springs=None), [name])


def test_variants_keep_the_cylinders_whose_ends_still_move():
    whole = arm("sprung")
    held = whole.with_locked({"joint1": 0.3})
    assert [cylinder.name for cylinder in held.cylinders] == ["across", "long"]
    assert [body.spring is not None for body in held.bodies] == [True, False, True, True]
    part = whole.subchain("link1", "tool")
    assert part.cylinders == ()
    assert any("left out the cylinders balancer, across, long" in warning for warning in part.warnings)


def test_a_difference_names_the_spring():
    """Number by number, a cylinder that is gone as a whole, and what it does to the torques that hold the arm."""
    more = arm("sprung").with_values({"joint1.spring.preload_n_m": -5.0})
    difference = aw.robotfiles.diff(arm("sprung"), more)
    assert [change.path for change in difference.changes] == ["joint1.spring.preload_n_m"]
    assert difference.effect is not None
    assert difference.effect.gravity_change == pytest.approx([2.0, 0.0, 0.0, 0.0, 0.0])
    robot = arm("sprung").record
    less = aw.robotfiles.diff(robot, robot.replace(cylinders=robot.cylinders[1:]))
    assert [(change.path, change.before, change.after) for change in less.changes] == [
        ("balancer", "cylinder from base to link1", None)
    ]
