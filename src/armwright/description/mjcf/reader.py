"""MJCF → RobotDescription, through the tree that MuJoCo compiles."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.drive_file import DriveFile, add_drives, find_drive_file, free_key, read_drive_file
from armwright.description.friction import check_smoothing
from armwright.description.mjcf.checks import check_file, check_model
from armwright.description.mjcf.drives import Actuation, actuations, masters, mimic_record
from armwright.description.mjcf.springs import cylinder, joint_spring, springs_are_off
from armwright.description.paths import UNNAMEABLE
from armwright.description.robot import RobotDescription
from armwright.errors import DescriptionError, Findings, Problem
from armwright.joint_kinds import JointKind, Prismatic, Revolute
from armwright.spatial import TENSOR, Placement, roll_pitch_yaw
from armwright.validation import validated

SOURCE = "mjcf_file"
SMOOTHING = "smoothing_argument"
CHOSEN = "Chosen by whoever read the MJCF: the speed over which Coulomb friction changes its sign"
TIPS = ("tip", "attachment_site")  # sites that MuJoCo's own models call an arm's end


def read_mjcf(
    path: str | os.PathLike[str], *, drive: str | os.PathLike[str] | None = None, smoothing: float | None = None
) -> RobotDescription:
    """The description in a MuJoCo XML file: bodies, hinges and slides, armature, damping, springs, gears and limits.

    Armature becomes the rotor inertia  J = armature / n²  behind the actuator's gear n (1 without one). Sites become frames;
    a site called tip or attachment_site is the tip. Spatial tendons that are springs between two sites become cylinders.

    Args:
        path: the file.
        drive: the file of the drive train; by default NAME.drive.toml beside NAME.xml, where there is one.
        smoothing: speed [rad/s | m/s] over which frictionloss, which is Coulomb friction, changes its sign, an estimate of the
            caller's; by default it is not smoothed, and sticks in simulation.
    Returns:
        description: `remarks` tell what was left out or doubtful, `notes` what was ignored.
    Raises:
        DescriptionError: MuJoCo is not installed or refuses the file; free joints, other tendons, constraints other than
            joints that follow others, and whatever else would change the dynamics.
    """
    file = Path(path)
    check_smoothing(smoothing)
    check_file(file)
    beside = find_drive_file(file, drive)
    drives = None if beside is None else read_drive_file(beside)
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError:
        what = "MJCF is read through MuJoCo, which is not installed: pip install armwright[bench]"
        raise DescriptionError(what, file=file) from None
    with _warnings_of(mujoco) as warnings:
        try:
            model = mujoco.MjModel.from_xml_path(str(file))
        except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
            raise DescriptionError(f"MuJoCo refuses it: {' '.join(str(error).split())}", file=file) from None
    check_model(file, mujoco, model)
    return _Reader(file, mujoco, model, smoothing, warnings, beside, drives).description()


@contextmanager
def _warnings_of(mujoco: Any) -> Iterator[list[str]]:
    """MuJoCo's warnings as a list; it would write them to the terminal and to a log file in the working directory."""
    warnings: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: warnings.append(" ".join(str(text).split())))
    try:
        yield warnings
    finally:
        mujoco.set_mju_user_warning(before)


class _Reader:
    """One compiled model, being read."""

    def __init__(
        self,
        file: Path,
        mujoco: Any,
        model: Any,
        smoothing: float | None,
        warnings: list[str],
        drive_file: Path | None,
        drives: DriveFile | None,
    ):
        self.warnings, self.drive_file, self.drives = warnings, drive_file, drives
        self.source, self.chosen = free_key(SOURCE, drives), free_key(SMOOTHING, drives)
        self.file, self.mujoco, self.model, self.smoothing = file, mujoco, model, smoothing
        self.driven, self.following = actuations(mujoco, model), masters(mujoco, model)
        self.remarks = Findings()
        self.taken: set[str] = set()
        self.joints: list[dict[str, Any]] = []
        self.links: list[dict[str, Any]] = []
        self.inside: dict[int, Placement] = {0: Placement.identity()}  # of every body's frame in its link's

    def description(self) -> RobotDescription:
        model, kinds = self.model, self.mujoco.mjtObj
        self.bodies = {i: self._name(kinds.mjOBJ_BODY, i, "body") for i in range(model.nbody)}
        for i in range(1, model.nbody):
            self._add_body(i)
        frames = [self._frame(i) for i in range(model.nsite)]
        tips = [frame["name"] for frame in frames if frame["name"] in TIPS]
        off = bool(model.opt.disableflags & int(self.mujoco.mjtDisableBit.mjDSBL_GRAVITY))
        record = {
            "name": UNNAMEABLE.sub("_", self.file.stem).strip() or "robot",
            "notes": f"Read from {self.file.name} through MuJoCo {self.mujoco.__version__}. Contacts, geoms ({model.ngeom}), "
            f"sensors ({model.nsensor}) and keyframes ({model.nkey}) are no part of an arm and ignored.",
            "base": self.bodies[0],
            "command": "torque",
            "gravity_m_s2": [0.0, 0.0, 0.0] if off else model.opt.gravity.tolist(),
            "source": self.source,
            "sources": {
                self.source: {"kind": "import", "text": f"read from {self.file.name}, an MJCF, which names no sources"},
                **({} if self.smoothing is None else {self.chosen: {"kind": "estimate", "text": CHOSEN}}),
            },
            "joints": self.joints,
            "links": self.links,
            "frames": frames,
            "cylinders": self._cylinders(frames),
            **({"tip": tips[0]} if len(tips) == 1 else {}),
        }
        file = self.file if self.drives is None else f"{self.file} with its drive file"
        if self.drive_file is not None and self.drives is not None:
            ratios = {
                self._name(self.mujoco.mjtObj.mjOBJ_JOINT, k, "joint"): driven.gear for k, driven in self.driven.items()
            }
            add_drives(self.drive_file, self.drives, record, ratios)
        warnings = (f"MuJoCo warns: {warning}" for warning in self.warnings)
        return validated(
            RobotDescription, record | {"remarks": (*warnings, *map(str, self.remarks.problems()))}, file=file
        )

    def _name(self, kind: Any, i: int, word: str) -> str:
        """A body's, joint's or site's name, made where it has none; once each."""
        name = UNNAMEABLE.sub("_", self.mujoco.mj_id2name(self.model, kind, i) or "").strip() or f"{word}{i}"
        return name if kind == self.mujoco.mjtObj.mjOBJ_JOINT else self._free(name)

    def _free(self, name: str) -> str:
        """A name that no body or site has yet, taken from now on."""
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        return name

    def _add_body(self, i: int) -> None:
        """T = T_body · M1(q1) · M2(q2) …: a body with several joints hangs on links without mass in between."""
        model = self.model
        parent = int(model.body_parentid[i])
        at, carrier = self.inside[parent] @ _placement(model.body_pos[i], model.body_quat[i]), self.bodies[parent]
        first, count = int(model.body_jntadr[i]), int(model.body_jntnum[i])
        if not count:
            self._add_joint({"name": f"{self.bodies[i]}_fixed", "type": "fixed"}, carrier, self.bodies[i], at)
            self.inside[i] = Placement.identity()
        for k in range(first, first + count):
            last = k == first + count - 1
            link = self.bodies[i] if last else self._free(f"{self.bodies[i]}_{k - first + 1}")
            axis, reference = model.jnt_axis[k], float(model.qpos0[model.jnt_qposadr[k]])
            hinge = int(model.jnt_type[k]) == int(self.mujoco.mjtJoint.mjJNT_HINGE)
            kind = Revolute() if hinge else Prismatic()
            anchor = Placement(np.eye(3), model.jnt_pos[k] if hinge else np.zeros(3))
            self._add_joint(self._joint(k, kind), carrier, link, at @ anchor @ kind.placement(axis, -reference), axis)
            carrier, at = link, anchor.inverse()
            if last:
                self.inside[i] = at
            else:
                nothing = {"mass_kg": 0.0, "com_m": [0.0] * 3}
                self.links.append({"name": link, **nothing, "inertia_kg_m2": _tensor(np.zeros((3, 3)))})
        inertial = self.inside[i] @ _placement(model.body_ipos[i], model.body_iquat[i])
        tensor = inertial.rotation @ np.diag(model.body_inertia[i]) @ inertial.rotation.T
        mass = float(model.body_mass[i])
        mass_properties = {"mass_kg": mass, "com_m": inertial.position.tolist(), "inertia_kg_m2": _tensor(tensor)}
        self.links.append({"name": self.bodies[i], **mass_properties})

    def _add_joint(self, record: dict[str, Any], parent: str, child: str, at: Placement, axis: Any = None) -> None:
        frame = {"xyz_m": at.position.tolist(), "rpy_rad": list(roll_pitch_yaw(at.rotation))}
        along = {} if axis is None else {"axis": axis.tolist()}
        self.joints.append({**record, "parent": parent, "child": child, "frame": frame, **along})

    def _joint(self, k: int, kind: JointKind) -> dict[str, Any]:
        """Kind, drive, friction and limits."""
        model, dof = self.model, int(self.model.jnt_dofadr[k])
        name = self._name(self.mujoco.mjtObj.mjOBJ_JOINT, k, "joint")
        units = kind.units
        actuation = self.driven.get(k, Actuation())
        for remark in actuation.remarks:
            self.remarks.add("joint", name, Problem(remark))
        limits: dict[str, Any] = {}
        if model.jnt_limited[k]:
            limits[units.key("position", "position")] = model.jnt_range[k].tolist()
        torque = actuation.torque
        if model.jnt_actfrclimited[k]:
            torque = min(torque, float(np.abs(model.jnt_actfrcrange[k]).min()))
        if 0 < torque < inf:
            limits[units.key("torque", "torque")] = torque
        friction: dict[str, Any] = {}
        disabled = model.opt.disableflags
        damping, loss = float(np.ravel(model.dof_damping[dof])[0]), float(model.dof_frictionloss[dof])
        if damping and not disabled & int(getattr(self.mujoco.mjtDisableBit, "mjDSBL_DAMPER", 0)):
            friction[units.key("viscous", "damping")] = damping
        if loss and not disabled & int(self.mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS):
            friction |= {units.key(f"coulomb_{side}", "torque"): loss for side in ("positive", "negative")}
            if self.smoothing is not None:
                friction[units.key("smoothing", "speed")] = {"value": self.smoothing, "source": self.chosen}
        record: dict[str, Any] = {"name": name, "type": kind.name, "limits": limits}
        armature, gear = float(model.dof_armature[dof]), actuation.gear
        if armature or gear != 1.0:
            record["motor"] = {"gear_ratio": gear, "rotor_inertia_kg_m2": armature / (gear * gear)}
        if k in self.following:
            other = int(model.eq_obj2id[self.following[k]])
            master = self._name(self.mujoco.mjtObj.mjOBJ_JOINT, other, "joint")
            record["mimic"] = mimic_record(model, self.following[k], master, units)
            self.remarks.add("joint", name, Problem("follows another exactly, where MuJoCo's constraint gives way"))
        return record | joint_spring(self.mujoco, model, k, units) | ({"friction": friction} if friction else {})

    def _cylinders(self, frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Tendons that pull or push; those without stiffness only measure."""
        kind, model = self.mujoco.mjtObj.mjOBJ_TENDON, self.model
        live = (
            []
            if springs_are_off(self.mujoco, model)
            else [i for i in range(model.ntendon) if np.any(model.tendon_stiffness[i])]
        )
        return [cylinder(model, i, self._name(kind, i, "tendon"), frames) for i in live]

    def _frame(self, i: int) -> dict[str, Any]:
        body = int(self.model.site_bodyid[i])
        at = self.inside[body] @ _placement(self.model.site_pos[i], self.model.site_quat[i])
        name = self._name(self.mujoco.mjtObj.mjOBJ_SITE, i, "site")
        rpy = list(roll_pitch_yaw(at.rotation))
        return {"name": name, "link": self.bodies[body], "xyz_m": at.position.tolist(), "rpy_rad": rpy}


def _placement(position: np.ndarray, quaternion: np.ndarray) -> Placement:
    """From MuJoCo's position and unit quaternion (w, x, y, z)."""
    w, x, y, z = np.asarray(quaternion) / np.linalg.norm(quaternion)
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return Placement(np.array(rotation), np.array(position))


def _tensor(tensor: np.ndarray) -> dict[str, float]:
    both = 0.5 * (tensor + tensor.T)
    return {name: max(float(both[i, j]), 0.0) if i == j else float(both[i, j]) for name, (i, j) in TENSOR.items()}
