"""Arm as glTF, moving or in one pose: a node for each body, a channel for each joint, time in seconds.  [Khronos2021]

trimesh reads such files and writes scenes, but no animations, so this writer is our own.

    scene ─ NAME (turned so that gravity points down) ─ base ─┬─ meshes that do not move
                                                              └─ joint1 ─┬─ its body's mesh
                                                                         └─ joint2 ─ … ─ tip, an empty node

A body's frame has its joint's axis as z, so a turning joint's node only turns and a sliding one's only slides: rotation is
R Rz(q + offset), translation p + R z q, with R and p of the body's placement in its parent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armwright.model import BASE, Body, Model
from armwright.pictures.body_shapes import Shape, body_shapes, rod_shape
from armwright.pictures.glb_container import Arrays, container
from armwright.pictures.keyframes import keyframes
from armwright.pictures.moving_cylinders import CylinderPart, cylinder_parts, part_keyframes
from armwright.pictures.posed_arm import upright
from armwright.spatial import rotation_quaternion

TOLERANCE = 5e-6  # [m] at the tip, of the error of interpolation between keyframes
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # glTF's y is up


def animated_arm(
    arm: Model, t: np.ndarray, motions: Mapping[str, np.ndarray], about: Mapping[str, Any] | None = None
) -> bytes:
    """Binary glTF file with the arm moving as in `motions`; without animation it is at the start of the first one.

    Args:
        arm: the arm.   t: (k,) [s] strictly increasing; the animation's time starts at 0.
        motions: name of an animation → (k, n) [rad | m] joint positions.   about: facts about the file, stored as `extras`.
    Returns:
        glb: the file's bytes.
    Raises:
        RunError: a visual's mesh that is missing or cannot be read.
    """
    if arm.mimics is not None:
        motions = {name: arm.mimics.positions(q.T).T for name, q in motions.items()}
    everywhere = np.vstack(list(motions.values()))
    travel = {k: (float(q.min()), float(q.max())) for k, q in enumerate(everywhere.T)}
    names = ["base", *(body.joint for body in arm.bodies)]
    return arm_glb(arm, everywhere[0], body_shapes(arm, travel)[0], names, t - t[0], motions, about)


def arm_glb(
    arm: Model,
    q: np.ndarray,
    shapes: Mapping[int, list[Shape]],
    names: Sequence[str],
    t: np.ndarray | None = None,
    motions: Mapping[str, np.ndarray] | None = None,
    about: Mapping[str, Any] | None = None,
) -> bytes:
    """Binary glTF file of an arm in the pose q, moving or not.

    Args:
        arm: the arm.   q: (bodies,) [rad | m].   shapes: of the bodies.   names: of the nodes: the base's, then the bodies'.
        t: (k,) [s] from 0.   motions: name of an animation → (k, bodies) [rad | m].   about: stored as `extras`.
    """
    arrays = Arrays()
    materials: list[dict[str, Any]] = []
    root = arm.name + "_" * (arm.name in names)  # names of nodes differ
    nodes: list[dict[str, Any]] = [
        {"name": root, "rotation": np.roll(rotation_quaternion(Y_UP @ upright(arm)), -1).tolist(), "children": [1]},
        {"name": names[0], "children": []},
    ]
    for name, body, position in zip(names[1:], arm.bodies, q, strict=True):
        turn, slide = _rotation(body, np.array([position]))[0], _translation(body, np.array([position]))[0]
        nodes.append({"name": name, "rotation": turn.tolist(), "translation": slide.tolist()})
    for k, body in enumerate(arm.bodies):
        nodes[node_of(body.parent)].setdefault("children", []).append(node_of(k))
    meshes: list[dict[str, Any]] = []
    for body, parts in shapes.items():
        nodes[node_of(body)]["mesh"] = len(meshes)
        name = "base" if body == BASE else arm.bodies[body].link
        meshes.append({"name": name, "primitives": [_primitive(shape, arrays, materials) for shape in parts]})
    _add_tip(arm, nodes)
    cylinders: dict[int, tuple[int, CylinderPart]] = {}
    if motions is not None:
        for number, part in cylinder_parts(arm, np.vstack(list(motions.values()))):
            nodes[1]["children"].append(len(nodes))
            cylinders[len(nodes)] = number, part
            nodes.append({"name": part.name, "mesh": len(meshes), **_posed(arm, number, part, q)})
            meshes.append({"name": part.name, "primitives": [_primitive(rod_shape(part), arrays, materials)]})
    if not nodes[1]["children"]:
        del nodes[1]["children"]
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "Armwright", **({"extras": dict(about)} if about else {})},
        "scene": 0,
        "scenes": [{"name": arm.name, "nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
    }
    if t is not None and motions is not None:
        document["animations"] = [_animation(arm, name, t, q, arrays, cylinders) for name, q in motions.items()]
    return container(document, arrays)


def node_of(body: int) -> int:
    """Index of a body's node: the base is 1, joints follow in the order of q."""
    return body + 2 if body != BASE else 1


def _add_tip(arm: Model, nodes: list[dict[str, Any]]) -> None:
    if arm.tip is None:
        return
    tip = arm.frame()
    turn = np.roll(rotation_quaternion(tip.placement.rotation), -1)  # w x y z → x y z w
    position = np.asarray(tip.placement.position, dtype=float)
    nodes[node_of(tip.body)].setdefault("children", []).append(len(nodes))
    nodes.append({"name": f"tip {arm.tip}", "rotation": turn.tolist(), "translation": position.tolist()})


def _primitive(shape: Shape, arrays: Arrays, materials: list[dict[str, Any]]) -> dict[str, Any]:
    colour = [*(_linear(v) for v in shape.colour), 1.0]
    surface = {"baseColorFactor": colour, "metallicFactor": 0.1, "roughnessFactor": 0.55}
    material = {"pbrMetallicRoughness": surface, "doubleSided": True}
    if material not in materials:
        materials.append(material)
    vertices = {"POSITION": arrays.vertices(shape.positions, bounds=True), "NORMAL": arrays.vertices(shape.normals)}
    return {"attributes": vertices, "indices": arrays.triangles(shape.triangles), "material": materials.index(material)}


def _linear(value: float) -> float:
    """Linear light of a colour's sRGB value, as glTF has it.  [IEC1999]"""
    return round(value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4, 6)


def _posed(arm: Model, number: int, part: CylinderPart, q: np.ndarray) -> dict[str, Any]:
    """Place of a cylinder's piece in one pose q (bodies,)."""
    _, places, turns = part_keyframes(arm, number, part, np.zeros(1), q[None])
    return {"rotation": turns[0].tolist(), "translation": places[0].tolist()}


def _animation(
    arm: Model,
    name: str,
    t: np.ndarray,
    q: np.ndarray,
    arrays: Arrays,
    cylinders: Mapping[int, tuple[int, CylinderPart]],
) -> dict[str, Any]:
    channels: list[dict[str, Any]] = []
    samplers: list[dict[str, Any]] = []

    def add(node: int, path: str, times: int, values: np.ndarray) -> None:
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        # LINEAR is along the great circle for rotations
        samplers.append({"input": times, "output": arrays.samples(values), "interpolation": "LINEAR"})

    lengths = [body.placement.position for body in arm.bodies]
    reach = max(sum(float(np.linalg.norm(np.asarray(length, dtype=float))) for length in lengths), 0.1)
    if arm.tip is not None:
        reach += float(np.linalg.norm(np.asarray(arm.frame().placement.position, dtype=float)))
    reach += sum(float(np.ptp(body.kind.motion(q[:, k])[1])) for k, body in enumerate(arm.bodies) if body.kind.slides)
    for k, body in enumerate(arm.bodies):
        turns = body.kind.turns
        times, positions = keyframes(t, q[:, k], TOLERANCE / (len(arm.bodies) * (reach if turns else 1.0)), turns)
        keys = arrays.samples(times, bounds=True)
        if turns:
            add(node_of(k), "rotation", keys, _rotation(body, positions))
        if body.kind.slides:
            add(node_of(k), "translation", keys, _translation(body, positions))
    for node, (number, part) in cylinders.items():
        times, places, turned = part_keyframes(arm, number, part, t, q)
        keys = arrays.samples(times, bounds=True)
        add(node, "rotation", keys, turned)
        add(node, "translation", keys, places)
    return {"name": name, "channels": channels, "samplers": samplers}


def still_place(body: Body) -> dict[str, list[float]]:
    """Placement of a body at q = -offset: quaternion x, y, z, w, position [m] and the axis of its joint in the parent."""
    rotation = np.asarray(body.placement.rotation, dtype=float)
    turn = np.roll(rotation_quaternion(body.placement.rotation), -1)
    position = np.asarray(body.placement.position, dtype=float)
    return {"turn": turn.tolist(), "at": position.tolist(), "axis": rotation[:, 2].tolist()}


def _rotation(body: Body, q: np.ndarray) -> np.ndarray:
    """(k, 4) quaternions x, y, z, w of R Rz(q + offset), which turn steadily with q: no jumps of sign."""
    w, x, y, z = rotation_quaternion(body.placement.rotation)
    half = 0.5 * (q + float(body.offset)) if body.kind.turns else np.zeros_like(q)
    c, s = np.cos(half), np.sin(half)
    return np.column_stack([x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s])


def _translation(body: Body, q: np.ndarray) -> np.ndarray:
    """(k, 3) [m] origins of the body's frame in its parent's."""
    way = body.kind.motion(q)[1] if body.kind.slides else np.zeros_like(q)
    return np.asarray(body.placement.position, dtype=float) + np.multiply.outer(
        way, np.asarray(body.placement.rotation, dtype=float)[:, 2]
    )
