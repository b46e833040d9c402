"""Variants of an arm: payloads, held joints, parts, other values. Laws first: the dynamics are those of the whole arm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.description.database import parse
from armwright.description.writer import to_toml
from armwright.errors import DescriptionError, ModelError
from armwright.model import build_model
from physics.arms import NAMES, arm, random_state, workshop
from raises_at import raises_at
from reference.random_trees import random_description

TENSOR = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.025]])


def held(whole: aw.Model, part: aw.Model, positions: dict[str, float], q: np.ndarray) -> np.ndarray:
    """q of the whole arm from that of the part, (n,)."""
    left = dict(zip(part.names, q, strict=True))
    return np.array([positions[name] if name in positions else left[name] for name in whole.names])


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
@settings(max_examples=5, deadline=None)
def test_held_joints_leave_the_dynamics_of_the_others(name, data):
    """With q_k constant, M, bias and gravity are rows and columns of the whole arm's."""
    whole = arm(name)
    names = data.draw(st.lists(st.sampled_from(whole.names), min_size=1, max_size=whole.n - 1, unique=True))
    positions = {joint: data.draw(st.floats(-2, 2)) for joint in names}
    part = whole.with_locked(positions)
    assert part.names == [joint for joint in whole.names if joint not in positions]
    q, qd, qdd = random_state(part, 3)
    kept = [whole.names.index(joint) for joint in part.names]
    all_q = held(whole, part, positions, q)
    still = dict.fromkeys(positions, 0.0)
    all_qd, all_qdd = held(whole, part, still, qd), held(whole, part, still, qdd)
    np.testing.assert_allclose(aw.mass_matrix(part, q), aw.mass_matrix(whole, all_q)[np.ix_(kept, kept)], atol=1e-12)
    np.testing.assert_allclose(
        aw.inverse_dynamics(part, q, qd, qdd), aw.inverse_dynamics(whole, all_q, all_qd, all_qdd)[kept], atol=1e-9
    )
    for frame in whole.frames:
        np.testing.assert_allclose(
            aw.forward_kinematics(part, q, frame), aw.forward_kinematics(whole, all_q, frame), atol=1e-12
        )


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", NAMES)
def test_a_payload_is_a_wrench_of_its_own_weight_at_rest(name):
    """g(q) of the arm with a point mass is that of the bare arm and the weight at the point."""
    bare = arm(name)
    mass, com = 2.5, np.array([0.05, -0.02, 0.1])
    loaded = bare.with_payload(mass, com, np.zeros(3))
    assert loaded.tip == bare.tip
    q = random_state(bare, 1)[0]
    tip = aw.forward_kinematics(bare, q)
    force, arm_of_force = mass * bare.gravity, tip[:3, :3] @ com
    wrench = np.concatenate([force, np.cross(arm_of_force, force)])
    expected = aw.gravity_torques(bare, q) - aw.jacobian(bare, q).T @ wrench
    np.testing.assert_allclose(aw.gravity_torques(loaded, q), expected, atol=1e-9)
    np.testing.assert_allclose(aw.forward_kinematics(loaded, q), tip)


def test_a_payload_moves_as_a_body_does():
    """Its kinetic energy is that of a rigid body at the tip, whatever frame it is given in."""
    bare = arm("workshop")
    mass, com = 1.3, np.array([0.02, 0.04, -0.03])
    loaded = bare.with_payload(mass, com, TENSOR, frame="link5", name="tool_5")
    q, qd = random_state(bare, 2, rows=2)
    pose, twist = aw.forward_kinematics(bare, q, "link5"), aw.jacobian(bare, q, "link5") @ qd
    velocity = twist[:3] + np.cross(twist[3:], pose[:3, :3] @ com)
    spin = pose[:3, :3].T @ twist[3:]
    energy = 0.5 * mass * velocity @ velocity + 0.5 * spin @ TENSOR @ spin
    gained = aw.kinetic_energy(loaded, q, qd) - aw.kinetic_energy(bare, q, qd)
    assert gained == pytest.approx(energy, rel=1e-9)


def test_a_payload_can_be_varied_and_written_and_read_again():
    loaded = arm("puma560").replace(friction=None).with_payload(1.0, [0.0, 0.0, 0.05], [0.01, 0.01, 0.002])
    assert not any(body.friction for body in loaded.bodies)
    varied = aw.compile(loaded, vary=["payload.mass_kg"]).varied
    assert varied is not None
    heavier = varied.model(np.array([3.0]))
    assert sum(b.mass for b in heavier.bodies) == pytest.approx(sum(b.mass for b in loaded.bodies) + 2.0)
    assert not any(body.friction for body in heavier.bodies)
    record = loaded.description
    assert record is not None
    assert loaded.provenance("payload.mass_kg").kind == "definition"
    import tomllib

    again = build_model(parse(tomllib.loads(to_toml(record)), "again"))
    q = random_state(loaded, 1)[0]
    np.testing.assert_array_equal(aw.mass_matrix(again, q), aw.mass_matrix(loaded, q))


def test_two_payloads_need_two_names():
    once = arm("panda").with_payload(1.0, [0, 0, 0.1], np.zeros(3))
    with raises_at(DescriptionError, "with_payload(name='payload')"):
        once.with_payload(1.0, [0, 0, 0.1], np.zeros(3))
    twice = once.with_payload({"value": 0.5, "std": 0.01}, [0, 0, 0], TENSOR, name="camera", source="measurement")
    assert twice.provenance("camera.mass_kg").kind == "measurement"
    assert twice.description is not None
    assert twice.description.link("camera").mass_kg.std == 0.01


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ((-1.0, [0, 0, 0], TENSOR), r"\.mass = -1.0"),
        ((1.0, [0, 0], TENSOR), r"\.com = .*: expected 3 numbers, not 2"),
        ((1.0, [0, 0, 0], np.eye(2)), "expected a symmetric"),
        ((1.0, [0, 0, 0], [[1, 1, 0], [0, 1, 0], [0, 0, 1]]), "expected a symmetric"),
        ((1.0, [0, 0, 0], [1.0, 0.1, 0.1]), "link 'payload' inertia_kg_m2: an impossible"),
        ((1.0, [0, 0, 0], TENSOR, "flang"), r"\.frame = 'flang': unknown; .*flange"),
    ],
)
def test_a_payload_that_cannot_be(wrong, message):
    with pytest.raises(DescriptionError, match=message):
        arm("panda").with_payload(*wrong)


@pytest.mark.sample(3)
@pytest.mark.parametrize("seed", [3, 4, 5, 7, 8, 18])
def test_subchains_of_trees(seed):
    """Inverse kinematics aside, a subchain moves its tip as the whole arm moves it with respect to the new base."""
    whole = build_model(random_description(seed))
    for tip in whole.frames:
        steps = whole.path(whole.frames[tip].body)
        if len(steps) < 3:
            continue
        base = whole.bodies[steps[0]].link
        part = whole.subchain(base, tip)
        q = random_state(part, seed)[0]
        all_q = np.zeros(whole.n)
        all_q[[whole.names.index(name) for name in part.names]] = q
        expected = np.linalg.inv(aw.forward_kinematics(whole, all_q, base)) @ aw.forward_kinematics(whole, all_q, tip)
        np.testing.assert_allclose(aw.forward_kinematics(part, q), expected, atol=1e-12)
        turned = aw.forward_kinematics(whole, all_q, base)[:3, :3]
        np.testing.assert_allclose(turned @ part.gravity, whole.gravity, atol=1e-12)


@pytest.mark.parametrize("name", ["cmu-dd", "puma560", "lwa4p", "panda"])
def test_subchain_of_a_chain_has_the_dynamics_behind_the_held_joints(name):
    """From link 2 outward, joints 1 and 2 at 0: the rows of the whole arm, base standing."""
    whole = arm(name).replace(friction=None)
    link, rest = whole.bodies[1].link, whole.names[2:]
    part = whole.subchain(link, whole.tip)
    assert part.names == rest
    assert not part.warnings or not any("left out" in warning for warning in part.warnings)
    q, qd, qdd = random_state(part, 5)
    zeros = np.zeros(2)
    expected = aw.inverse_dynamics(whole, *(np.concatenate([zeros, x]) for x in (q, qd, qdd)))[2:]
    np.testing.assert_allclose(aw.inverse_dynamics(part, q, qd, qdd), expected, atol=1e-9)


def test_subchain_between_frames_and_what_it_leaves_out():
    whole = arm("workshop")
    part = whole.subchain("base", "tool")
    assert part.names == ["joint1", "joint2", "joint3"]
    assert any("left out the links behind joint4: 2 links of 3 kg" in warning for warning in part.warnings)
    kept = whole.with_locked({"joint4": 0.3, "joint5": -0.2}).subchain("base", "tool")
    q = random_state(part, 1)[0]
    np.testing.assert_allclose(
        aw.mass_matrix(kept, q), aw.mass_matrix(whole, np.array([*q, 0.3, -0.2]))[:3, :3], atol=1e-12
    )
    gravity = np.array([0.0, 1.0, -9.0])
    from_tool = whole.replace(gravity=gravity).subchain("link1", "tool")
    turned = aw.forward_kinematics(whole, np.zeros(5), "link1")[:3, :3]
    np.testing.assert_allclose(turned @ from_tool.gravity, gravity, atol=1e-12)


def test_a_frame_as_the_new_base():
    data = workshop()
    data["frames"].append({"name": "bench", "link": "base", "xyz_m": [0.3, 0.1, -0.8], "rpy_rad": [0.1, 0.5, -2.0]})
    data["frames"].append({"name": "side", "link": "link1", "xyz_m": [0.0, 0.1, 0.1], "rpy_rad": [1.1, 0.5, -2.0]})
    whole = build_model(parse(data, "workshop"))
    for base, count in (("bench", 0), ("side", 1)):
        part = whole.subchain(base, "tool")
        q = random_state(part, 1)[0]
        all_q = np.array([*np.zeros(count), *q, *np.zeros(2)])
        expected = np.linalg.inv(aw.forward_kinematics(whole, all_q, base)) @ aw.forward_kinematics(whole, all_q)
        np.testing.assert_allclose(aw.forward_kinematics(part, q), expected, atol=1e-12)


def test_values():
    changed = arm("lwa4p").replace(rotors=None).with_values({"link6.mass_kg": 2.0, "link6.com_m[2]": 0.1}, "estimate")
    record = changed.description
    assert record is not None
    assert float(record.link("link6").mass_kg) == 2.0
    assert np.array(record.link("link6").com_m)[2] == 0.1
    assert changed.provenance("link6.mass_kg").kind == "estimate"
    assert changed.provenance("link5.mass_kg").kind == "publication"
    assert all(body.drive.rotor_inertia == 0.0 for body in changed.bodies)
    assert arm("lwa4p").with_values({"gravity_m_s2": [0, 0, -1.62]}).gravity[2] == -1.62


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"link6.mass": 2.0}, "'link6.mass': no such number; .*link6.mass_kg"),
        ({"link6.mass_kg": -2.0}, r"-2\.0: .*0 or more"),
        ({"link6.mass_kg": "heavy"}, "expected a number"),
        ({"link6.com_m[3]": 0.0}, r"'link6.com_m\[3\]': no such entry"),
        ({"link6.mass_kg": 2.0, "link6.inertia_kg_m2.xx": 1e3}, "link 'link6' inertia_kg_m2: an impossible"),
        ({"joint1.limits.position_rad": [1.0, -1.0]}, "with_values: joint1.limits"),
        ({"joint1.friction.smoothing_rad_per_s": 0.0}, r"= 0\.0: .*no such key"),
    ],
)
def test_values_that_cannot_stand_there(values, message):
    with pytest.raises(DescriptionError, match=message):
        arm("lwa4p").with_values(values)


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ({"joint9": 0.0}, "joint = 'joint9': unknown; "),
        ({"joint1": float("nan")}, "expected a finite number"),
        ({"joint1": "up"}, "expected a finite number"),
        ({f"joint{k}": 0.0 for k in range(1, 8)}, "are locked"),
    ],
)
def test_joints_that_cannot_be_held(positions, message):
    with pytest.raises(DescriptionError, match=message):
        arm("panda").with_locked(positions)


@pytest.mark.parametrize(
    ("base", "tip", "message"),
    [
        ("link3", "link2", "on the base"),
        ("link3", "link3", "no joint moves"),
        ("lnk3", "flange", "'lnk3': unknown; .*link3"),
    ],
)
def test_subchains_that_are_none(base, tip, message):
    with pytest.raises(DescriptionError, match=message):
        arm("panda").subchain(base, tip)


def test_coupled_motors():
    """A held joint no longer turns the motors of others; one whose own motor others turn cannot be held alone."""
    data = workshop()
    data["joints"][4]["motor"]["coupling"] = [{"joint": "joint4", "ratio": 12.0}]
    whole = parse(data, "workshop")
    from armwright.model.variants import with_locked

    part = with_locked(whole, {"joint4": 0.1})
    assert part.joints[4].motor.coupling == ()  # type: ignore[union-attr]
    with raises_at(DescriptionError, "with_locked: joint 'joint5'", "'joint4'"):
        with_locked(whole, {"joint5": 0.1})
    assert len(with_locked(whole, {"joint5": 0.1, "joint4": 0.0}).joints) == 6


def test_an_impossible_arm_that_was_accepted_stays_so(tmp_path):
    """What was loaded with a warning can be varied; what was not is refused."""
    data = workshop()
    data["links"][0]["inertia_kg_m2"]["xx"] = 5.0
    loaded = build_model(parse(data, "workshop"), on_impossible="warn")
    assert any("impossible" in warning for warning in loaded.with_locked({"joint2": 0.1}).warnings)


def test_joints_that_mimic_others():
    """They are held with the joint that they follow, and stay with it in a subchain."""
    whole = arm("gripper")
    with raises_at(DescriptionError, "with_locked: joint 'right'", "'left'"):
        whole.with_locked({"right": 0.0})
    assert whole.with_locked({"left": 0.01}).names == ["joint1", "joint2", "joint3", "joint4"]
    assert len(whole.with_locked({"left": 0.01}).bodies) == 5
    with raises_at(DescriptionError, "subchain('base', 'right_link') joint 'right'", "'left'"):
        whole.subchain("base", "right_link")
    part = whole.with_locked({"left": 0.01}).subchain("base", "right_link")
    q = random_state(part, 1)[0]
    expected = aw.forward_kinematics(whole, np.array([*q, 0.0, 0.01]), "right_link")
    np.testing.assert_allclose(aw.forward_kinematics(part, q), expected, atol=1e-12)


def test_without_a_description_there_is_no_variant():
    import dataclasses

    with raises_at(ModelError, "arm", value="panda"):
        dataclasses.replace(arm("panda"), description=None).with_locked({"joint1": 0.0})
