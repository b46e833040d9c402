"""Files of an arm in one pose: binary glTF, and a page with a slider for every joint, which can follow a program."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import RunError
from armwright.model import Model
from armwright.pictures.arm_glb import arm_glb, node_of, still_place
from armwright.pictures.body_shapes import body_shapes
from armwright.pictures.posed_arm import PosedArm
from armwright.results.plot_page import PAGES as PLOT_PAGES, embedded, packed, page

PAGES = Path(__file__).parent / "pages"
SCRIPTS = (PLOT_PAGES / "unpack.js", *(PAGES / name for name in ("gltf.js", "stage.js", "pose.js")))
STYLES = (PLOT_PAGES / "page.css", PAGES / "player.css", PAGES / "pose.css")


def write_glb(posed: PosedArm, path: Path) -> None:
    """Writes a binary glTF file with a node for every body, named after its link, below the node of its parent."""
    path.write_bytes(arm_glb(posed.arm, posed.q, posed.shapes, _names(posed.arm)))


def write_html(posed: PosedArm, path: Path) -> None:
    """Writes an offline page: sliders move the joints, and the end effector's pose is shown."""
    path.write_text(pose_page(posed), encoding="utf-8", newline="\n")


def pose_page(posed: PosedArm, live: int | None = None) -> str:
    """HTML page with a slider for every joint.

    Args:
        posed: the arm.   live: number of the page at the program that serves it, which it then follows; None: of a file.
    """
    arm, q = posed.arm, posed.q
    joints, own = _joints(arm, q), q if arm.mimics is None else q[list(arm.mimics.drivers)]
    mimics = arm.mimics
    ends = np.array([[joint["low"], joint["high"]] for joint in joints]).T
    moved = ends if mimics is None else np.array([mimics.positions(end) for end in ends])
    travel = {k: (float(moved[:, k].min()), float(moved[:, k].max())) for k in range(len(arm.bodies))}
    try:
        shapes = body_shapes(arm, travel)[0]
    except RunError:  # a mesh that cannot be read, of which `posed` has the note
        shapes = body_shapes(replace(arm, description=None), travel)[0]
    bodies = [
        {
            "node": node_of(k), "turns": body.kind.turns, "way": float(body.kind.motion(1.0)[1]), "offset": float(body.offset),
            **still_place(body),
            "joint": k if mimics is None else mimics.coordinate[k],
            "factor": 1.0 if mimics is None else float(mimics.factor[k]),
            "shift": 0.0 if mimics is None else float(mimics.offset[k]),
        }
        for k, body in enumerate(arm.bodies)
    ]  # fmt: skip
    for joint, position in zip(joints, own, strict=True):
        joint["start"] = float(position)
    legs = [
        {"nodes": [node_of(body) for body in each.bodies], "ends": [np.asarray(end, dtype=float).tolist() for end in each.ends]}
        for each in arm.cylinders
    ]  # fmt: skip
    about = {"joints": joints, "bodies": bodies, "legs": legs, "live": live}
    data = {"joints": embedded(about), "arm": packed(arm_glb(arm, q, shapes, _names(arm)))}
    title = "" if arm.description is None or not arm.description.title else arm.description.title
    words = {"title": arm.name, "heading": arm.name, "subtitle": title, "tip": arm.tip or ""}
    scripts = SCRIPTS if live is None else (*SCRIPTS, PAGES / "live.js")
    return page(PAGES / "pose.html", scripts, STYLES, words, **data)


def _joints(arm: Model, q: np.ndarray) -> list[dict[str, Any]]:
    """Name and range of every slider; the range holds the pose q too."""
    drivers = range(len(arm.bodies)) if arm.mimics is None else arm.mimics.drivers
    found = []
    for k in drivers:
        body, position = arm.bodies[k], float(q[k])
        low, high = (float(limit) for limit in body.limits.position)
        bounded, half = isfinite(low) and isfinite(high), body.kind.units.half_range
        low, high = (low if isfinite(low) else -half), (high if isfinite(high) else half)
        range_ = {"low": min(low, position), "high": max(high, position), "open": not bounded}
        found.append({"name": body.joint, "angle": not body.kind.units.linear, **range_})
    return found


def _names(arm: Model) -> list[str]:
    """Names of the nodes: links, the base's first."""
    base = "base" if arm.description is None else arm.description.base
    return [base, *(body.link for body in arm.bodies)]
