"""Equality constraints of an MJCF: a joint that follows another along a line is one that mimics it; others are refused."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.errors import DescriptionError


def followed(mujoco: Any, model: Any) -> dict[int, int]:
    """By joint that follows another: the number of the constraint that says so."""
    line = int(mujoco.mjtEq.mjEQ_JOINT)
    return {int(model.eq_obj1id[k]): k for k in range(model.neq) if int(model.eq_type[k]) == line}


def check_equalities(place: str, mujoco: Any, model: Any) -> None:
    """Refuses what is no joint that follows another by  y - y0 = a0 + a1 (x - x0).

    Args:
        place: what errors call the file.   mujoco: the package.   model: its compiled MjModel.
    Raises:
        DescriptionError: another constraint, one that is bent, switched off or doubled, or an actuator on what follows.
    """
    follows = followed(mujoco, model)
    for k in range(model.neq):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, k) or f"number {k}"
        if int(model.eq_type[k]) != int(mujoco.mjtEq.mjEQ_JOINT) or int(model.eq_obj2id[k]) < 0:
            raise DescriptionError(f"{place}: equality {name!r} couples bodies or joints, which is not offered")
        if follows[int(model.eq_obj1id[k])] != k or not model.eq_active0[k]:
            what = "is not active" if not model.eq_active0[k] else "moves a joint that another one moves as well"
            raise DescriptionError(
                f"{place}: equality {name!r} {what}, which is not offered: expected one for each joint"
            )
        if model.eq_data[k][1] == 0.0 or np.any(model.eq_data[k][2:5]):
            told = " ".join(f"{number:g}" for number in model.eq_data[k][:5])
            raise DescriptionError(f"{place}: equality {name!r} has polycoef = {told}: expected a line, a0 a1 0 0 0")
    for i in range(model.nu):
        if int(model.actuator_trnid[i, 0]) in follows:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i) or f"number {i}"
            raise DescriptionError(
                f"{place}: actuator {name!r} drives a joint that follows another: expected it at the one that is followed"
            )


def mimic_record(model: Any, k: int, master: str, *, hinge: bool) -> dict[str, Any]:
    """`mimic` of the joint that constraint k moves: our q are MuJoCo's, whose line goes through the reference positions."""
    at = [float(model.qpos0[model.jnt_qposadr[int(joint)]]) for joint in (model.eq_obj1id[k], model.eq_obj2id[k])]
    constant, slope = map(float, model.eq_data[k][:2])
    return {
        "joint": master,
        "multiplier": slope,
        f"offset_{'rad' if hinge else 'm'}": at[0] + constant - slope * at[1],
    }
