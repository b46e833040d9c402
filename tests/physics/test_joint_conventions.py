"""One arm, told in classic DH, in modified DH and in explicit frames about any axis: the same mechanics.

The tellings are made here with 4 x 4 matrices, so they share nothing with how `model` reads them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armwright.description import RobotDescription
from armwright.description.database import parse
from armwright.description.robot import FixedJoint, PrismaticJoint
from armwright.dynamics import gravity_torques, inverse_dynamics, mass_matrix, potential_energy
from armwright.kinematics import forward_kinematics, jacobian
from armwright.model import Model, build_model
from physics.arms import description, random_state
from reference.peers import about, frame_of_tip, frame_transform, joint_transforms, transform
from reference.random_trees import random_body, random_description, random_rotation

WRENCH = np.array([3.0, -4.0, 5.0, 0.6, -0.7, 0.8])


def written(t: np.ndarray) -> dict[str, Any]:
    """A 4 x 4 transform as xyz_m and rpy_rad; yaw first and the others from what it leaves, exact at gimbal lock too."""
    yaw = np.arctan2(t[1, 0], t[0, 0])
    left = Rotation.from_euler("z", -yaw).as_matrix() @ t[:3, :3]
    pitch, roll = np.arctan2(-left[2, 0], left[0, 0]), np.arctan2(-left[1, 2], left[1, 1])
    return {"xyz_m": t[:3, 3].tolist(), "rpy_rad": [roll, pitch, yaw]}


def moved_body(link: Any, t: np.ndarray) -> dict[str, Any]:
    """A link's mass properties, told in the frame in which its own stands at t."""
    tensor = t[:3, :3] @ link.inertia_kg_m2.matrix() @ t[:3, :3].T
    com = t[:3, :3] @ np.array(link.com_m.value) + t[:3, 3]
    entries = {f"{'xyz'[i]}{'xyz'[j]}": tensor[i, j] for i in range(3) for j in range(i, 3)}
    excuse = {} if link.accept_impossible is None else {"accept_impossible": link.accept_impossible}
    return {
        "name": link.name,
        "mass_kg": float(link.mass_kg),
        "com_m": com.tolist(),
        "inertia_kg_m2": entries,
        **excuse,
    }


def retold(
    robot: RobotDescription, joints: list[dict[str, Any]], links: list[dict[str, Any]], tip: Any
) -> RobotDescription:
    """The robot with other joints and links, and its tip as a named frame."""
    head = {"name": robot.name, "source": "definition", "command": "torque", "tip": "the-tip", "base": robot.base}
    if robot.gravity_m_s2 is not None:
        head["gravity_m_s2"] = list(robot.gravity_m_s2.value)
    return parse(head | {"joints": joints, "links": links, "frames": [tip]}, f"{robot.name} retold")


def in_explicit_frames(robot: RobotDescription, seed: int) -> RobotDescription:
    """Every joint in an explicit frame, turned at random about its origin, its axis wherever z came to lie in it."""
    rng = np.random.default_rng(seed)
    behind = {robot.base: np.eye(4)}  # where a link's frame stands in its new frame
    joints, links = [], []
    for joint in robot.joints:
        before, axis, after = joint_transforms(joint)
        turn = random_rotation(rng)
        placed = behind[joint.parent] @ before @ transform(Rotation.from_matrix(turn), np.zeros(3))
        behind[joint.child] = transform(Rotation.from_matrix(turn.T), np.zeros(3)) @ after
        row = {
            "name": joint.name,
            "type": joint.type,
            "parent": joint.parent,
            "child": joint.child,
            "frame": written(placed),
        }
        joints.append(row if isinstance(joint, FixedJoint) else {**row, "axis": (2.5 * turn.T @ axis).tolist()})
        links.append(moved_body(robot.link(joint.child), behind[joint.child]))
    link, tip = frame_of_tip(robot)
    return retold(robot, joints, links, {"name": "the-tip", "link": link, **written(behind[link] @ tip)})


def in_modified_dh(robot: RobotDescription) -> RobotDescription:
    """A classic chain in modified DH: the screw along x of a row moves to the next row, frames onto the joints."""
    joints, links, x = [], [], {"alpha_rad": 0.0, "a_m": 0.0}
    for joint in robot.joints:
        row = joint.dh
        along_z = {
            key: float(getattr(row, key)) for key in ("r_m", "offset_rad", "theta_rad", "offset_m") if hasattr(row, key)
        }
        place = {"name": joint.name, "type": joint.type, "parent": joint.parent, "child": joint.child}
        joints.append({**place, "modified_dh": x | along_z})
        x = {"alpha_rad": float(row.alpha_rad), "a_m": float(row.a_m)}
        links.append(moved_body(robot.link(joint.child), about("x", row.alpha_rad, row.a_m)))
    last, tip = frame_of_tip(robot)
    assert last == robot.joints[-1].child
    behind = about("x", x["alpha_rad"], x["a_m"]) @ tip
    return retold(robot, joints, links, {"name": "the-tip", "link": last, **written(behind)})


def stanford() -> RobotDescription:
    """Stanford's arm in classic DH: its third joint slides; after [Paul1981], with bodies made up."""
    rng = np.random.default_rng(3)
    right = np.pi / 2
    rows = [(-right, 0.412, 0.0), (right, 0.154, 0.0), None, (-right, 0.0, 0.0), (right, 0.0, 0.0), (0.3, 0.263, 0.05)]
    joints = []
    for k, row in enumerate(rows):
        place = {"name": f"joint{k}", "parent": f"link{k - 1}" if k else "base", "child": f"link{k}"}
        if row is None:
            dh = {"alpha_rad": 0.2, "theta_rad": -right, "a_m": 0.07, "offset_m": 0.4}
            joints.append({**place, "type": "prismatic", "dh": dh})
        else:
            dh = dict(zip(("alpha_rad", "r_m", "a_m"), row, strict=True)) | {"offset_rad": 0.1 * k}
            joints.append({**place, "type": "revolute", "dh": dh})
    links = [{"name": f"link{k}", **random_body(rng)} for k in range(6)]
    head = {"name": "stanford", "source": "definition", "command": "torque"}
    return parse(head | {"joints": joints, "links": links}, "stanford")


def links_only(robot: RobotDescription) -> Model:
    """Without what the retold arms leave out."""
    return build_model(robot).replace(friction=None, rotors=None, efficiency=None)


def assert_same_mechanics(one: Model, other: Model, seed: int) -> None:
    """Inverse dynamics under a wrench, M, g, pose and Jacobian."""
    assert one.names == other.names
    q, qd, qdd = random_state(one, seed)
    for function, arguments in (
        (inverse_dynamics, (q, qd, qdd, WRENCH)),
        (mass_matrix, (q,)),
        (gravity_torques, (q,)),
        (forward_kinematics, (q,)),
        (jacobian, (q,)),
    ):
        a, b = function(one, *arguments), function(other, *arguments)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * max(1.0, np.abs(b).max()), err_msg=function.__name__)


CLASSIC = {"lwa4p": lambda: description("lwa4p"), "puma560": lambda: description("puma560"), "stanford": stanford}


@pytest.mark.parametrize("name", CLASSIC)
@pytest.mark.parametrize("seed", range(3))
def test_classic_dh_is_modified_dh(name, seed):
    """The same chain in both Denavit-Hartenberg conventions, a sliding joint included. [Craig1986]"""
    classic = CLASSIC[name]()
    assert all(joint.dh is not None for joint in classic.joints)
    assert_same_mechanics(links_only(classic), links_only(in_modified_dh(classic)), seed)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", [*CLASSIC, "panda", "cmu-dd", "two-link", "workshop"])
@pytest.mark.parametrize("seed", range(3))
def test_any_convention_is_explicit_frames(name, seed):
    """Classic DH, modified DH and explicit frames, retold in frames turned at random about axes that point anywhere."""
    robot = CLASSIC[name]() if name in CLASSIC else description(name)
    assert_same_mechanics(links_only(robot), links_only(in_explicit_frames(robot, seed)), seed)


@pytest.mark.parametrize("seed", range(3))
def test_modified_dh_slides_as_explicit_frames(seed):
    """A prismatic joint of a modified row (θ fixed, r = q + offset) retold in explicit frames."""
    modified = in_modified_dh(stanford())
    assert any(isinstance(joint, PrismaticJoint) and joint.modified_dh is not None for joint in modified.joints)
    assert_same_mechanics(links_only(modified), links_only(in_explicit_frames(modified, seed)), seed)


@pytest.mark.parametrize("way", ["dh", "modified_dh"])
def test_fixed_joints_by_dh(way):
    """A fixed joint of a DH row is the same pose and mass as its explicit frame."""
    rng = np.random.default_rng(8)
    row = {"alpha_rad": 0.4, "r_m": 0.2, "a_m": 0.1, "theta_rad": -0.7}
    turning = {"alpha_rad": 0.3, "r_m": 0.1, "a_m": 0.2, "offset_rad": 0.5}
    first = {"name": "a", "type": "revolute", "parent": "base", "child": "one", way: turning}
    second = {"name": "b", "type": "fixed", "parent": "one", "child": "two", way: row}
    links = [{"name": name, **random_body(rng)} for name in ("one", "two")]
    head = {"name": "fixed", "source": "definition", "command": "torque"}
    robot = parse(head | {"joints": [first, second], "links": links}, "fixed")
    assert_same_mechanics(links_only(robot), links_only(in_explicit_frames(robot, 0)), 0)


def pseudo(body: dict[str, Any]) -> np.ndarray:
    """(4, 4) [[Σ, m c], [m cᵀ, m]] about the frame's origin: additive, and T P Tᵀ in another frame."""
    e = body["inertia_kg_m2"]
    tensor = np.array([[e["xx"], e["xy"], e["xz"]], [e["xy"], e["yy"], e["yz"]], [e["xz"], e["yz"], e["zz"]]])
    c, m = np.array(body["com_m"]), body["mass_kg"]
    p = np.zeros((4, 4))
    p[:3, :3] = 0.5 * np.trace(tensor) * np.eye(3) - tensor + m * np.outer(c, c)
    p[:3, 3] = p[3, :3] = m * c
    p[3, 3] = m
    return p


def body_of(p: np.ndarray) -> dict[str, Any]:
    """Mass, centre and tensor of a pseudo-inertia."""
    m, c = p[3, 3], p[:3, 3] / p[3, 3]
    spread = p[:3, :3] - m * np.outer(c, c)
    tensor = np.trace(spread) * np.eye(3) - spread
    entries = {f"{'xyz'[i]}{'xyz'[j]}": tensor[i, j] for i in range(3) for j in range(i, 3)}
    return {"mass_kg": m, "com_m": c.tolist(), "inertia_kg_m2": entries}


def without_fixed_links(robot: RobotDescription) -> RobotDescription:
    """Every fixed link's mass put into the link that carries it by hand; those on the base left away."""
    at = {robot.base: (robot.base, np.eye(4))}  # link → the moving link that carries it, and where it stands there
    mass: dict[str, np.ndarray] = {}
    joints, waiting = [], list(robot.joints)
    while waiting:
        joint = next(joint for joint in waiting if joint.parent in at)
        waiting.remove(joint)
        carrier, placed = at[joint.parent]
        p = pseudo(
            robot.link(joint.child).model_dump(include={"name"}) | moved_body(robot.link(joint.child), np.eye(4))
        )
        frame = placed @ frame_transform(joint.frame)
        if isinstance(joint, FixedJoint):
            at[joint.child] = (carrier, frame)
            if carrier != robot.base:
                mass[carrier] = mass[carrier] + frame @ p @ frame.T
            continue
        at[joint.child] = (joint.child, np.eye(4))
        mass[joint.child] = p
        place = {"name": joint.name, "type": joint.type, "parent": carrier, "child": joint.child}
        joints.append({**place, "frame": written(frame), "axis": list(joint.axis.value)})
    link, tip = frame_of_tip(robot)
    carrier, placed = at[link]
    links = [{"name": name, **body_of(p)} for name, p in mass.items()]
    return retold(robot, joints, links, {"name": "the-tip", "link": carrier, **written(placed @ tip)})


@pytest.mark.parametrize("seed", [4, 7, 8, 10, 12, 14, 30, 53])
def test_fixed_links_are_part_of_what_carries_them(seed):
    """A tree with fixed links has the mechanics of one whose links were put together by hand."""
    robot = random_description(seed)
    assert any(isinstance(joint, FixedJoint) for joint in robot.joints)
    merged = without_fixed_links(robot)
    assert len(merged.joints) == links_only(robot).n
    one, other = links_only(robot), links_only(merged)
    assert_same_mechanics(one, other, seed)
    q = random_state(one, seed)[0]
    slope = potential_energy(one, q) - potential_energy(one, 0 * q)
    assert potential_energy(other, q) - potential_energy(other, 0 * q) == pytest.approx(slope, abs=1e-10)
