"""Springs of an MJCF: stiffness of joints, and spatial tendons that are straight springs between two sites."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armwright.joint_kinds import JointUnits


def springs_are_off(mujoco: Any, model: Any) -> bool:
    """True if the file's <flag> switches springs off, as older versions do together with dampers."""
    bits = mujoco.mjtDisableBit
    flag = getattr(bits, "mjDSBL_SPRING", None) or bits.mjDSBL_PASSIVE
    return bool(model.opt.disableflags & int(flag))


def joint_spring(mujoco: Any, model: Any, k: int, units: JointUnits) -> dict[str, Any]:
    """`spring` of joint k; empty without one. Our q are MuJoCo's, so that its spring reference is our rest."""
    stiffness = float(np.ravel(model.jnt_stiffness[k])[0])
    if not stiffness or springs_are_off(mujoco, model):
        return {}
    rest = float(model.qpos_spring[model.jnt_qposadr[k]])
    return {"spring": {units.key("stiffness", "stiffness"): stiffness, units.key("rest", "position"): rest}}


def sites_of(model: Any, i: int) -> list[int]:
    """Sites that tendon i goes through, in their order."""
    first = int(model.tendon_adr[i])
    return [int(site) for site in model.wrap_objid[first : first + int(model.tendon_num[i])]]


TENDON_PHYSICS = (
    *("damping", "dampingpoly", "stiffnesspoly", "springyield"),
    *("frictionloss", "armature", "limited", "actfrclimited"),
)


def check_tendons(mujoco: Any, model: Any, refuse: Callable[..., None]) -> None:
    """Refuses tendons that are more than a straight spring between two sites.

    Raises:
        DescriptionError: by `refuse`.
    """
    only = "a spatial tendon between two sites with stiffness and one springlength"
    for i in range(model.ntendon):
        first = int(model.tendon_adr[i])
        kinds = [int(kind) for kind in model.wrap_type[first : first + int(model.tendon_num[i])]]
        if kinds != [int(mujoco.mjtWrap.mjWRAP_SITE)] * 2:
            refuse("tendon", i, "couples bodies or joints, which is not offered", only)
        low, high = model.tendon_lengthspring[i]
        if low != high:
            refuse("tendon", i, f"slack between {low:g} and {high:g} m, which is not offered", only)
        for key in TENDON_PHYSICS:
            if np.any(getattr(model, f"tendon_{key}", np.zeros(model.ntendon + 1))[i]):
                refuse("tendon", i, f"{key}, which is not offered", only)


def cylinder(model: Any, i: int, name: str, frames: list[dict[str, Any]]) -> dict[str, Any]:
    """Tendon i as a cylinder between the frames of its sites:  force 0 at its spring length."""
    a, b = (frames[site] for site in sites_of(model, i))
    ends = {"link_a": a["link"], "anchor_a_m": a["xyz_m"], "link_b": b["link"], "anchor_b_m": b["xyz_m"]}
    stiffness, rest = float(np.ravel(model.tendon_stiffness[i])[0]), float(model.tendon_lengthspring[i][0])
    force, length = (0.0, rest) if rest > 0.0 else (-stiffness, 1.0)  # what rests at length 0 pulls with k ℓ
    return {"name": name, **ends, "force_n": force, "length_m": length, "stiffness_n_per_m": stiffness}
