"""Placement of a node of an animated glTF file by the interpolation of the specification, as in any viewer."""

from __future__ import annotations

import numpy as np

from pictures.gltf_rules import Gltf


def pose_of(gltf: Gltf, animation: str, node: str, t: float) -> np.ndarray:
    """(4, 4) of a node in the scene at time t [s]."""
    moved = {}
    for channel in gltf.animation(animation)["channels"]:
        sampler = gltf.animation(animation)["samplers"][channel["sampler"]]
        times = np.array(gltf.arrays[sampler["input"]])[:, 0]
        values = np.array(gltf.arrays[sampler["output"]])
        target = channel["target"]
        moved[target["node"], target["path"]] = _at(times, values, t, target["path"] == "rotation")
    parents = {child: k for k, own in enumerate(gltf.json["nodes"]) for child in own.get("children", ())}
    k: int | None = gltf.node(node)
    pose = np.eye(4)
    while k is not None:
        own = gltf.json["nodes"][k]
        local = np.eye(4)
        local[:3, :3] = _rotation(moved.get((k, "rotation"), own.get("rotation", (0, 0, 0, 1))))
        local[:3, 3] = moved.get((k, "translation"), own.get("translation", (0, 0, 0)))
        pose = local @ pose
        k = parents.get(k)
    return pose


def _at(times: np.ndarray, values: np.ndarray, t: float, turn: bool) -> np.ndarray:
    if t <= times[0] or len(times) == 1:
        return values[0]
    if t >= times[-1]:
        return values[-1]
    k = int(np.searchsorted(times, t, side="right")) - 1
    s = (t - times[k]) / (times[k + 1] - times[k])
    a, b = values[k], values[k + 1]
    if not turn:
        return (1 - s) * a + s * b
    dot = float(a @ b)
    angle = np.arccos(min(abs(dot), 1.0))
    if angle < 1e-7:
        return (1 - s) * a + s * b
    sign = 1.0 if dot >= 0 else -1.0
    return (np.sin((1 - s) * angle) * a + sign * np.sin(s * angle) * b) / np.sin(angle)


def _rotation(quaternion) -> np.ndarray:
    x, y, z, w = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
