"""Differences between two records, and their effect."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import DescriptionError
from physics.arms import FORMS, arm
from raises_at import raises_at


@pytest.mark.parametrize("name", [*FORMS, "so101"])
def test_an_arm_does_not_differ_from_itself(name):
    found = aw.robotfiles.diff(name, arm(name))
    assert not found
    assert found.effect is not None
    assert found.effect.poses.shape == (33, arm(name).n)
    assert not found.effect.gravity_change.any()
    assert not np.nan_to_num(found.effect.inertia_change).any()


def test_changed_numbers_are_listed_with_their_sources():
    old = arm("lwa4p")
    new = old.with_values({"link6.mass_kg": {"value": 2.0, "std": 0.1}, "joint2.friction.viscous_n_m_s_per_rad": 20.0})
    found = {change.path: change for change in aw.robotfiles.diff(old, new).changes}
    assert list(found) == ["joint2.friction.viscous_n_m_s_per_rad", "link6.mass_kg"]
    mass = found["link6.mass_kg"]
    assert (mass.before, mass.after, mass.std_before, mass.std_after) == (1.5, 2.0, None, 0.1)
    assert mass.source_before is not None
    assert mass.source_after is not None
    assert (mass.source_before.kind, mass.source_after.kind) == ("publication", "definition")


def test_a_source_alone_is_a_difference():
    old = arm("panda")
    same = old.with_values({"link1.mass_kg": old.description.link("link1").mass_kg.value}, "estimate")  # type: ignore[union-attr]
    (change,) = aw.robotfiles.diff(old, same).changes
    assert change.path == "link1.mass_kg"
    assert change.is_source_only


def test_whole_links_come_and_go():
    loaded = arm("panda").with_payload(1.0, [0, 0, 0.1], np.zeros(3))
    found = aw.robotfiles.diff("panda", loaded)
    assert [(c.path, c.before, c.after) for c in found.changes] == [
        ("payload_mount", None, "fixed joint"),
        ("payload", None, "link of 1 kg"),
    ]
    back = aw.robotfiles.diff(loaded, "panda")
    assert [(c.path, c.before, c.after) for c in back.changes] == [
        ("payload_mount", "fixed joint", None),
        ("payload", "link of 1 kg", None),
    ]


def test_the_consequence_is_that_of_the_dynamics():
    """A point mass at the tip: gravity changes by Jᵀ m g, the mass matrix by m Jᵀ J."""
    mass = 3.0
    bare = arm("puma560")
    effect = aw.robotfiles.diff(bare, bare.with_payload(mass, [0, 0, 0], np.zeros(3))).effect
    assert effect is not None
    assert effect.mass[1] - effect.mass[0] == pytest.approx(mass)
    for k, q in enumerate(effect.poses):
        linear = aw.jacobian(bare, q)[:3]
        np.testing.assert_allclose(
            effect.gravity[1, k] - effect.gravity[0, k], -linear.T @ bare.gravity * mass, atol=1e-9
        )
        np.testing.assert_allclose(
            effect.inertia[1, k] - effect.inertia[0, k], np.diag(mass * linear.T @ linear), atol=1e-9
        )
    biggest = np.abs(effect.gravity[1] - effect.gravity[0]).max(axis=0)
    np.testing.assert_allclose(np.abs(effect.gravity_change), biggest)


def test_sample_poses_stay_within_limits():
    found = aw.robotfiles.diff("panda", "panda").effect
    assert found is not None
    for body, positions in zip(arm("panda").bodies, found.poses[1:].T, strict=True):
        low, high = body.limits.position
        assert low <= positions.min() <= positions.max() <= high
    assert not found.poses[0].any()


def test_arms_without_a_common_joint():
    found = aw.robotfiles.diff("puma560", "panda")
    assert found.effect is None
    assert found.changes


def test_joints_in_another_order():
    record = arm("workshop").description
    assert record is not None
    turned = record.replace(joints=(*record.joints[:2], *record.joints[3:5], record.joints[2], *record.joints[5:]))
    (change,) = aw.robotfiles.diff(record, turned).changes
    assert (change.path, change.after) == ("order of the joints", "joint1, joint2, joint4, joint5, joint3")


def test_no_such_arm():
    with raises_at(DescriptionError, "robot", r"puma560\?", value="puma56"):
        aw.robotfiles.diff("puma56", "puma560")
