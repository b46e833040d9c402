"""What carries physics in a compiled MJCF and has no place in an arm of ours: refused by name."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.errors import DescriptionError

SMALLEST_GEAR = 1e-6
LARGEST = 1e9  # SI; as for a URDF
SIZES = (
    *(
        "gravity",
        "qpos0",
        "body_pos",
        "body_ipos",
        "body_mass",
        "body_inertia",
        "jnt_pos",
        "jnt_range",
        "jnt_actfrcrange",
    ),
    *(
        "dof_armature",
        "dof_damping",
        "dof_frictionloss",
        "site_pos",
        "actuator_gear",
        "actuator_gainprm",
        "actuator_biasprm",
    ),
    *("actuator_ctrlrange", "actuator_forcerange"),
)


def check_offered(place: str, mujoco: Any, model: Any) -> None:
    """Refuses what the dynamics would lack: free and ball joints, springs, tendons, fluid, gravity compensation.

    Args:
        place: what errors call the file.   mujoco: the package.   model: its compiled MjModel.
    Raises:
        DescriptionError: names the first of them.
    """

    def name(kind: Any, i: int) -> str:
        return mujoco.mj_id2name(model, kind, i) or f"number {i}"

    kinds = mujoco.mjtObj
    for i, kind in enumerate(model.jnt_type):
        if int(kind) not in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)):
            told = "free" if int(kind) == int(mujoco.mjtJoint.mjJNT_FREE) else "ball"
            raise DescriptionError(
                f"{place}: joint {name(kinds.mjOBJ_JOINT, i)!r} is a {told} joint, which is not offered: expected hinge or slide"
            )
        if model.jnt_stiffness[i] != 0 or _any(model, "jnt_stiffnesspoly", i):
            raise DescriptionError(f"{place}: joint {name(kinds.mjOBJ_JOINT, i)!r} has a spring, which is not offered")
    for i in range(model.nv):
        if _any(model, "dof_dampingpoly", i):
            joint = name(kinds.mjOBJ_JOINT, int(model.dof_jntid[i]))
            raise DescriptionError(f"{place}: joint {joint!r} has damping of higher order, which is not offered")
    if model.ntendon:
        raise DescriptionError(
            f"{place}: tendon {name(kinds.mjOBJ_TENDON, 0)!r} couples bodies or joints, which is not offered"
        )
    for i in range(model.nbody):
        if model.body_gravcomp[i] != 0:
            raise DescriptionError(f"{place}: body {name(kinds.mjOBJ_BODY, i)!r} has gravcomp, which is not offered")
    if model.opt.density != 0 or model.opt.viscosity != 0 or np.any(model.opt.wind):
        raise DescriptionError(f"{place}: <option> has density, viscosity or wind, and fluids are not offered")
    joints = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    for i in range(model.nu):
        gear = abs(float(model.actuator_gear[i, 0]))
        if 0 < gear < SMALLEST_GEAR:
            actuator = name(kinds.mjOBJ_ACTUATOR, i)
            raise DescriptionError(
                f"{place}: actuator {actuator!r} has the gear {gear:g}: expected {SMALLEST_GEAR:g} or more"
            )
        actuator = name(kinds.mjOBJ_ACTUATOR, i)
        if int(model.actuator_trntype[i]) not in joints:
            raise DescriptionError(f"{place}: actuator {actuator!r} drives no joint: expected joint = …")
        if any(_any(model, key, i) for key in ("actuator_armature", "actuator_damping", "actuator_dampingpoly")):
            raise DescriptionError(
                f"{place}: actuator {actuator!r} has armature or damping: expected them in its joint"
            )


def check_sizes(place: str, model: Any) -> None:
    """Refuses numbers that are no robot's, with which the arithmetic would overflow.

    Raises:
        DescriptionError: names the array of MuJoCo's model, and the number.
    """
    for key in SIZES:
        numbers = np.asarray(getattr(model.opt if key == "gravity" else model, key), dtype=float)
        wrong = numbers[~(np.abs(numbers) <= LARGEST)]
        if wrong.size:
            raise DescriptionError(f"{place}: {key} holds {wrong[0]:g}: expected numbers of a robot, in SI units")


def _any(model: Any, key: str, i: int) -> bool:
    """Whether a field that not every version of MuJoCo has holds something for entry i."""
    return bool(np.any(getattr(model, key)[i])) if hasattr(model, key) else False
