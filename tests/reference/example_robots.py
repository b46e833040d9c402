"""The robots of the `example-robot-data` wheel: where they are, and how each does in our hands and in Pinocchio's."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.urdf import read_urdf
from armwright.dynamics import inverse_dynamics
from armwright.errors import DescriptionError
from armwright.model import Model, build_model
from physics.arms import all_positions, projection

STATES = 2
PACKAGE = "cmeel.prefix/share/example-robot-data/robots"


@cache
def robot_files() -> dict[str, Path]:
    """By path within the wheel; none where it is not installed."""
    spec = importlib.util.find_spec("cmeel")  # what the wheel's files stand beside
    roots = [Path(place).parent / PACKAGE for place in (spec.submodule_search_locations or ())] if spec else []
    return {str(path.relative_to(root)): path for root in roots for path in sorted(root.rglob("*.urdf"))}


@dataclass(frozen=True)
class Verdict:
    """Result of one robot."""

    refused: str | None  # why it is refused as it stands; None: it is not
    mimic: bool  # whether it loads with mimic = "independent" only, as it mimics a joint that is not there
    impossible: bool  # whether it loads with on_impossible="warn" only
    arm: Model | None  # as it loads with both
    error: float | None  # of inverse dynamics against Pinocchio, relative to the largest entry; None: no Pinocchio


def examined(path: Path) -> Verdict:
    """Loads a robot as strictly as it goes, and compares it with Pinocchio."""
    refused, mimic, impossible = None, False, False
    try:
        build_model(read_urdf(path))
    except DescriptionError as error:
        refused = str(error)
    try:
        description = read_urdf(path)
    except DescriptionError as error:
        if "<mimic joint>" not in error.place:
            return Verdict(refused, False, False, None, None)
        mimic, description = True, read_urdf(path, mimic="independent")
    try:
        arm = build_model(description)
    except DescriptionError as error:
        if "impossible inertia" not in str(error):
            return Verdict(refused, mimic, False, None, None)
        impossible, arm = True, build_model(description, on_impossible="warn")
    return Verdict(refused, mimic, impossible, arm, against_pinocchio(path, arm))


def against_pinocchio(path: Path, arm: Model) -> float:
    """The largest difference of inverse dynamics, relative to the largest entry, over random states.

    Pinocchio's joints all move by themselves; where joints follow others, its torques are projected: G q + o in, Gᵀ tau out.
    """
    import pinocchio as pin

    model: Any = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    ours = arm.replace(friction=None, gravity=model.gravity.linear)
    numbers = {name: i for i, name in enumerate(model.names)}
    joints = [model.joints[numbers[name]] for name in arm.tree.names]
    assert model.nv == arm.tree.n
    g = projection(arm)
    rng, worst = np.random.default_rng(len(path.name)), 0.0
    for _ in range(STATES):
        q, qd, qdd = rng.normal(size=(3, arm.n))
        theirs = [pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)]
        for joint, *state in zip(joints, all_positions(arm, q), g @ qd, g @ qdd, strict=True):
            angle = [np.cos(state[0]), np.sin(state[0])] if joint.nq == 2 else [state[0]]
            theirs[0][joint.idx_q : joint.idx_q + joint.nq] = angle
            theirs[1][joint.idx_v], theirs[2][joint.idx_v] = state[1:]
        tau = g.T @ pin.rnea(model, data, *theirs)[[joint.idx_v for joint in joints]]
        worst = max(worst, float(np.abs(inverse_dynamics(ours, q, qd, qdd) - tau).max() / np.abs(tau).max()))
    return worst
