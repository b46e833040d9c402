"""Checks of an MJCF: of the file before MuJoCo reads it, and of the compiled model before it becomes an arm of ours.

A file must not lead out of its folder nor grow without end; a model must have no physics that the arm would lack.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.mjcf.drives import constraints, masters
from armwright.description.mjcf.springs import check_tendons
from armwright.description.xml_tree import NUMBER, Element, read_xml
from armwright.errors import DescriptionError, Problem
from armwright.reading import real_path, refuse_other_entries

FOLDERS = ("meshdir", "texturedir", "assetdir")
LARGEST_COUNTS = {"count": 1000, "nrow": 8192, "ncol": 8192, "width": 8192, "height": 8192, "resolution": 8192}
SOFT = ("composite", "flexcomp", "flex", "skin", "plugin", "extension")
NOT_FINITE = ("nan", "inf", "infinity")  # MuJoCo lets some through, and leaves a log file in the working directory
MOST_FILES = 100
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
    *("dof_armature", "dof_damping", "dof_frictionloss", "site_pos"),
    *("actuator_gear", "actuator_gainprm", "actuator_biasprm", "actuator_ctrlrange", "actuator_forcerange"),
)
NOT_OFFERED = "not offered"


def check_file(path: Path) -> None:
    """Refuses an MJCF that names files outside its folder, that includes itself, or that would grow beyond a robot.

    Raises:
        DescriptionError: names file, line and element.
    """
    wrong: list[Problem] = []
    _check_included(path, path.resolve().parent, [], wrong)
    if wrong:
        raise DescriptionError.of(*wrong)


def _check_included(path: Path, folder: Path, within: list[Path], wrong: list[Problem]) -> None:
    root = read_xml(path)
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise root.error(expected="an MJCF, whose first element is <mujoco>")
    compilers = [element for element in root.children if element.tag == "compiler"]
    folders = [folder / element.attributes.get(name, "") for element in compilers for name in FOLDERS]
    _check_tree(root, folder, [*within, real_path(path)], [folder, *folders], wrong)


def _check_tree(element: Element, folder: Path, within: list[Path], folders: list[Path], wrong: list[Problem]) -> None:
    """Adds what is wrong with an element, those below it and the files that these include."""
    try:
        _check_element(element, folder, within, folders)
        if element.tag == "include":
            _check_included(folder / element.word("file"), folder, within, wrong)
    except DescriptionError as error:
        wrong += error.problems
    for child in element.children:
        _check_tree(child, folder, within, folders, wrong)


def _check_element(element: Element, folder: Path, within: list[Path], folders: list[Path]) -> None:
    if element.tag in SOFT:
        raise element.error(NOT_OFFERED, expected="rigid bodies")
    for name, most in LARGEST_COUNTS.items():
        for word in element.attributes.get(name, "").split():
            if not NUMBER.fullmatch(word) or float(word) > most:
                raise element.wrong(name, f"a number of {most} at most")
    for name, value in element.attributes.items():
        if name != "name" and any(word.lstrip("+-") in NOT_FINITE for word in value.lower().split()):
            raise element.wrong(name, "finite numbers")
    for name in (*FOLDERS, "file"):
        value = element.attributes.get(name)
        if value and ("\0" in value or not real_path(folder / value).is_relative_to(folder)):
            what, place = f"leads out of {str(folder)!r}", f"<{element.tag} {name}>"
            raise element.error(what, place=place, value=value, expected="a path below it")
        if value and name == "file":
            for start in folders:
                refuse_other_entries(start / value, "a file", DescriptionError)
    if element.tag == "include":
        inner = folder / element.word("file")
        if real_path(inner) in within or len(within) >= MOST_FILES:
            raise element.error("includes itself", value=inner.name, expected="files that end")


def check_model(file: Path, mujoco: Any, model: Any) -> None:
    """Refuses what the dynamics would lack: free and ball joints, springs that are no lines, tendons that are no springs,
    fluid, gravity compensation, constraints.

    Args:
        file: for errors.   mujoco: the package.   model: its compiled MjModel.
    Raises:
        DescriptionError: names all of them.
    """
    wrong: list[Problem] = []

    def refuse(kind: str, i: int, what: str, expected: str = "") -> None:
        name = mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i) or f"number {i}"
        wrong.append(Problem(what, f"{kind} {name!r}", expected=expected, file=str(file)))

    offered = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for i, kind in enumerate(model.jnt_type):
        if int(kind) not in offered:
            called = "free" if int(kind) == int(mujoco.mjtJoint.mjJNT_FREE) else "ball"
            refuse("joint", i, f"a {called} joint, which is {NOT_OFFERED}", "hinge or slide")
        if _any(model, "jnt_stiffnesspoly", i):
            refuse("joint", i, f"stiffness of higher order, which is {NOT_OFFERED}")
        if _any(model, "jnt_springyield", i):
            refuse("joint", i, f"a spring that yields, which is {NOT_OFFERED}")
    for i in range(model.nv):
        if _any(model, "dof_dampingpoly", i):
            refuse("joint", int(model.dof_jntid[i]), f"damping of higher order, which is {NOT_OFFERED}")
    check_tendons(mujoco, model, refuse)
    for i in range(model.nbody):
        if model.body_gravcomp[i] != 0:
            refuse("body", i, f"gravcomp, which is {NOT_OFFERED}")
    if model.opt.density != 0 or model.opt.viscosity != 0 or np.any(model.opt.wind):
        wrong.append(Problem(f"density, viscosity or wind: fluids are {NOT_OFFERED}", "<option>", file=str(file)))
    followers = masters(mujoco, model)
    for k in constraints(mujoco, model):
        if int(model.eq_type[k]) != int(mujoco.mjtEq.mjEQ_JOINT) or int(model.eq_obj2id[k]) < 0:
            refuse("equality", k, f"couples bodies or joints, which is {NOT_OFFERED}")
            continue
        if not model.eq_active0[k]:
            refuse("equality", k, f"not active, which is {NOT_OFFERED}")
        if followers[int(model.eq_obj1id[k])] != k:
            refuse("equality", k, "moves a joint that another one moves as well", "one for each joint")
        if model.eq_data[k][1] == 0.0 or np.any(model.eq_data[k][2:5]):
            polynomial = " ".join(f"{number:g}" for number in model.eq_data[k][:5])
            refuse("equality", k, f"polycoef = {polynomial}", "a line, a0 a1 0 0 0")
    joints = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    for i in range(model.nu):
        gear = abs(float(model.actuator_gear[i, 0]))
        if 0 < gear < SMALLEST_GEAR:
            refuse("actuator", i, f"the gear {gear:g}", f"{SMALLEST_GEAR:g} or more")
        if int(model.actuator_trntype[i]) not in joints:
            refuse("actuator", i, "drives no joint", "joint = …")
        if any(_any(model, key, i) for key in ("actuator_armature", "actuator_damping", "actuator_dampingpoly")):
            refuse("actuator", i, "armature or damping", "them in its joint")
        if int(model.actuator_trnid[i, 0]) in followers:
            refuse("actuator", i, "drives a joint that follows another", "it at the one that is followed")
    for key in SIZES:
        numbers = np.asarray(getattr(model.opt if key == "gravity" else model, key), dtype=float)
        beyond = numbers[~(np.abs(numbers) <= LARGEST)]
        if beyond.size:
            value, expected = float(beyond[0]), "numbers of a robot, in SI units"
            wrong.append(Problem(place=key, value=value, expected=expected, file=str(file)))
    if wrong:
        raise DescriptionError.of(*wrong)


def _any(model: Any, key: str, i: int) -> bool:
    """True if a field holds something for entry i; not every version of MuJoCo has all fields."""
    return bool(np.any(getattr(model, key)[i])) if hasattr(model, key) else False
