"""Drives of an MJCF: gears and limits of actuators (servo gains are a controller's), and joints that follow others."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Any

from armwright.joint_kinds import JointUnits


@dataclass
class Actuation:
    """Drive of one joint."""

    gear: float = 1.0
    torque: float = inf  # [N m | N], either way
    remarks: list[str] = field(default_factory=list)


def actuations(mujoco: Any, model: Any) -> dict[int, Actuation]:
    """By joint. A motor's force is gear · gain · ctrl; a servo's is limited by its force range alone."""
    by_joint: dict[int, Actuation] = {}
    for i in range(model.nu):
        joint = int(model.actuator_trnid[i, 0])
        if joint in by_joint:
            by_joint[joint].remarks.append("has several actuators: their gears and limits are not used")
            by_joint[joint].gear, by_joint[joint].torque = 1.0, inf
            continue
        actuation = by_joint[joint] = Actuation(gear=float(model.actuator_gear[i, 0]) or 1.0)
        bounds = []
        if model.actuator_forcelimited[i]:
            bounds.append(model.actuator_forcerange[i])
        plain = (
            int(model.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_FIXED)
            and int(model.actuator_biastype[i]) == int(mujoco.mjtBias.mjBIAS_NONE)
            and int(model.actuator_dyntype[i]) == int(mujoco.mjtDyn.mjDYN_NONE)
        )
        if plain and model.actuator_ctrllimited[i]:
            bounds.append(model.actuator_ctrlrange[i] * model.actuator_gainprm[i, 0])
        if not plain:
            gains = " ".join(f"{gain:g}" for gain in (*model.actuator_gainprm[i, :1], *model.actuator_biasprm[i, 1:3]))
            actuation.remarks.append(f"its servo or activation (gains {gains}) is a controller's and not used")
        delay = float(model.actuator_delay[i]) if hasattr(model, "actuator_delay") else 0.0
        if delay:
            actuation.remarks.append(f"its delay of {delay:g} s is not used: a scenario states delays")
        for low, high in bounds:
            if low != -high:
                actuation.remarks.append(
                    f"its force range {low:g} … {high:g} is not even; the smaller holds either way"
                )
            limit = min(abs(low), abs(high)) * abs(actuation.gear)
            actuation.torque = min(actuation.torque, limit or inf)
    return by_joint


def constraints(mujoco: Any, model: Any) -> range:
    """Numbers of the equality constraints that act; none if the file's <flag> switches them off."""
    off = int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    return range(0 if off else model.neq)


def masters(mujoco: Any, model: Any) -> dict[int, int]:
    """By joint that follows another: the number of the equality constraint that says so."""
    line = int(mujoco.mjtEq.mjEQ_JOINT)
    return {int(model.eq_obj1id[k]): k for k in constraints(mujoco, model) if int(model.eq_type[k]) == line}


def mimic_record(model: Any, k: int, master: str, units: JointUnits) -> dict[str, Any]:
    """`mimic` of the joint that constraint k moves: our q are MuJoCo's, whose line goes through the reference positions."""
    at = [float(model.qpos0[model.jnt_qposadr[int(joint)]]) for joint in (model.eq_obj1id[k], model.eq_obj2id[k])]
    constant, slope = map(float, model.eq_data[k][:2])
    return {"joint": master, "multiplier": slope, units.key("offset", "position"): at[0] + constant - slope * at[1]}
