"""MuJoCo: the arm with its motors built there from the model's numbers, without contacts, stepped by its own integrators."""

# MuJoCo's names come from compiled modules without stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from mujoco import rollout
from peers.chain import joint_places
from peers.native import Results, call, library
from scipy.spatial.transform import Rotation

from armwright.model import Body, Model

SOURCE = Path(__file__).with_name("mujoco_loop.c")

# What this arm does not have costs MuJoCo nothing; its Euler takes damping explicitly, which is 8 % faster.
ABSENT = ("contact", "constraint", "limit", "frictionloss", "equality", "clampctrl", "sensor", "eulerdamp")

ANY_MASS = {
    "mass": "1",
    "pos": "0.1 0.2 0.3",
    "fullinertia": "1 1.1 1.2 0.01 0.02 0.03",
}  # off every axis: no short cut


class MuJoCoArm:
    """An arm in MuJoCo with motors as actuators: force = n Kt/R u - (n Kt)(n Ke)/R q̇, and no limits.

    Args:
        arm: a chain driven by voltages or currents, with nothing but viscous friction.
        integrator: "Euler" or "RK4".   step: [s].
        dry: whether joints also have the dry friction of the record, as MuJoCo's constraint of that name.
    """

    name = f"MuJoCo {mujoco.__version__}"

    def __init__(self, arm: Model, integrator: str, step: float, *, dry: bool = False):
        possible = all(
            np.linalg.eigvalsh(np.array(b.inertia_com, dtype=float))[0] > 0 and b.mass > 0 for b in arm.bodies
        )
        self.model = mujoco.MjModel.from_xml_string(mjcf(arm, integrator, step, own_masses=possible, dry=dry))
        if not possible:
            put_masses(self.model, arm)
        self.data = mujoco.MjData(self.model)
        self.n = arm.n

    def final_states(self, commands: np.ndarray, steps: int) -> np.ndarray:
        """(lanes, 2n) positions and speeds after some steps from rest at 0, u held: `mj_step` in MuJoCo's own C++ loop."""
        states = np.empty((len(commands), 2 * self.n))
        for state, u in zip(states, commands, strict=True):
            mujoco.mj_resetData(self.model, self.data)
            self.data.ctrl[:] = u
            mujoco.mj_step(self.model, self.data, steps)
            state[: self.n], state[self.n :] = self.data.qpos, self.data.qvel
        return states

    def trajectories(self, commands: np.ndarray, steps: int, start: np.ndarray | float = 0.0) -> np.ndarray:
        """(lanes, steps, 2n) states after every step: `mujoco.rollout`, one thread; commands (lanes, n) or (lanes, steps, n).

        The arm begins at rest, at positions `start` (n,).
        """
        rest = np.zeros((len(commands), mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        rest[:, 1 : 1 + self.n] = start
        held = commands if commands.ndim == 3 else np.broadcast_to(commands[:, None, :], (len(commands), steps, self.n))
        states, _ = rollout.rollout(self.model, self.data, rest, np.ascontiguousarray(held))
        return np.asarray(states)[:, :, 1 : 1 + 2 * self.n]


class MuJoCoLoop:
    """MuJoCo's stages of inverse dynamics, mass matrix and forward dynamics in a C loop over states, one thread.

    Args:
        arm: a chain without friction and gear loss.
    """

    name = f"MuJoCo {mujoco.__version__}, its C functions"

    def __init__(self, arm: Model):
        self._code = ctypes.CDLL(str(compiled_loop(build=False)))
        self._model = model = mujoco.MjModel.from_xml_string(mjcf(arm, "Euler", 1e-3, motors=False, own_masses=False))
        put_masses(model, arm)
        self._data = mujoco.MjData(model)
        self._places = ctypes.c_void_p(self._model._address), ctypes.c_void_p(self._data._address)

    def call(self, name: str, out: Results, *arrays: np.ndarray) -> Results:
        """One of the loop's algorithms over all states, into `out`."""
        return call(self._code, name, self._places, arrays, out)


def put_masses(model: Any, arm: Model) -> None:
    """The arm's own masses in MuJoCo's compiled model: whatever was published, possible or not."""
    for k, body in enumerate(arm.bodies, start=1):
        moments, axes = np.linalg.eigh(np.array(body.inertia_com, dtype=float))
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        model.body_mass[k], model.body_ipos[k] = body.mass, body.com
        model.body_inertia[k], model.body_iquat[k] = moments, _quaternion(axes)
    mujoco.mj_setConst(model, mujoco.MjData(model))


@functools.cache
def compiled_loop(build: bool) -> Path:
    """The loop as a library, linked to the wheel's MuJoCo.

    Raises:
        NoLoop: no compiler, or (without `build`) it was not compiled yet.
    """
    home = Path(mujoco.__file__).parent
    shared = sorted(home.glob("libmujoco*"))[0]
    flags = ("-isystem", str(home / "include"), f"-L{home}", f"-Wl,-rpath,{home}", f"-l:{shared.name}")
    return library(SOURCE, ("gcc", "clang"), flags, mujoco.__version__, build)


def mjcf(
    arm: Model, integrator: str, step: float, motors: bool = True, own_masses: bool = True, *, dry: bool = False
) -> str:
    """The arm as MuJoCo's XML: no geometry, no contacts, no limits; every joint turns about (or slides along) its z axis.

    Args:
        arm: a chain.   integrator: "Euler" or "RK4".   step: [s].
        motors: whether it has them, and viscous friction; without, rotors are still armature.
        own_masses: whether bodies have their own, which MuJoCo reads only where a body can have them; else masses that stand
            for others.
    """
    root = ElementTree.Element("mujoco", model=arm.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false", balanceinertia="false")
    option = {"gravity": _text(arm.gravity), "timestep": repr(step), "integrator": integrator}
    absent = set(ABSENT) - ({"constraint", "frictionloss"} if dry else set())
    ElementTree.SubElement(ElementTree.SubElement(root, "option", option), "flag", dict.fromkeys(absent, "disable"))
    element = ElementTree.SubElement(root, "worldbody")
    actuators = ElementTree.SubElement(root, "actuator")
    for body, (rotation, position) in zip(arm.bodies, joint_places(arm), strict=True):
        element = ElementTree.SubElement(element, "body", pos=_text(position), quat=_text(_quaternion(rotation)))
        joint = {"name": body.joint, "type": "hinge" if body.kind.name == "revolute" else "slide", "axis": "0 0 1"}
        joint["armature"] = repr(float(body.drive.armature))
        if motors:
            joint["damping"] = _damping(body, dry)
            joint |= {"frictionloss": repr(float(body.friction.coulomb_positive))} if dry and body.friction else {}
            ElementTree.SubElement(actuators, "general", _motor(body))
        ElementTree.SubElement(element, "joint", joint)
        ElementTree.SubElement(element, "inertial", _mass(body) if own_masses else ANY_MASS)
    return ElementTree.tostring(root, encoding="unicode")


def _mass(body: Body) -> dict[str, str]:
    tensor = np.array(body.inertia_com, dtype=float)
    full = _text(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    return {"mass": repr(float(body.mass)), "pos": _text(body.com), "fullinertia": full}


def _damping(body: Body, dry: bool) -> str:
    if body.friction is None:
        return "0"
    assert dry or not body.friction.is_dry, "MuJoCo's own dry friction is another law: viscous only"
    return repr(float(body.friction.viscous))


def _motor(body: Body) -> dict[str, str]:
    drive = body.drive
    assert drive.command in ("voltage", "current"), "MuJoCo's motor here takes volts or amperes"
    assert drive.efficiency in (None, 1.0), "MuJoCo has no gear loss"
    if drive.command == "current":
        return {"joint": body.joint, "gainprm": repr(float(drive.gear_ratio * drive.torque_constant))}  # n Kt [N m/A]
    gain = drive.gear_ratio * drive.torque_constant / drive.resistance  # n Kt/R [N m/V]
    bias = -gain * drive.gear_ratio * drive.back_emf_constant  # [N m s/rad]
    force = {"gainprm": repr(float(gain)), "biastype": "affine", "biasprm": _text((0, 0, bias))}
    return {"joint": body.joint, **force}


def _quaternion(rotation: np.ndarray) -> tuple[float, ...]:
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return w, x, y, z


def _text(numbers: Any) -> str:
    return " ".join(repr(float(number)) for number in numbers)
