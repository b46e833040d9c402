"""MuJoCo: the arm with its motors built there from the model's numbers, without contacts, stepped by its own integrators."""

# MuJoCo's names come from compiled modules without stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from mujoco import rollout
from scipy.spatial.transform import Rotation

from armwright.model import Model

# What this arm does not have costs MuJoCo nothing; its Euler takes damping explicitly, which is 8 % faster.
ABSENT = ("contact", "constraint", "limit", "frictionloss", "equality", "clampctrl", "sensor", "eulerdamp")


class MuJoCoArm:
    """An arm in MuJoCo with motors as actuators: force = n Kt/R u - (n Kt)(n Ke)/R q̇, and no limits.

    Args:
        arm: a chain driven by voltages, with nothing but viscous friction.
        integrator: "Euler" or "RK4".   step: [s].
    """

    name = f"MuJoCo {mujoco.__version__}"

    def __init__(self, arm: Model, integrator: str, step: float):
        self.model = mujoco.MjModel.from_xml_string(mjcf(arm, integrator, step))
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

    def trajectories(self, commands: np.ndarray, steps: int) -> np.ndarray:
        """(lanes, steps, 2n) states after every step: `mujoco.rollout`, one thread."""
        rest = np.zeros((len(commands), mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        held = np.broadcast_to(commands[:, None, :], (len(commands), steps, self.n))
        states, _ = rollout.rollout(self.model, self.data, rest, np.ascontiguousarray(held))
        return np.asarray(states)[:, :, 1 : 1 + 2 * self.n]


def mjcf(arm: Model, integrator: str, step: float) -> str:
    """The arm as MuJoCo's XML: no geometry, no contacts, no limits; every joint turns about (or slides along) its z axis."""
    root = ElementTree.Element("mujoco", model=arm.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false", balanceinertia="false")
    option = {"gravity": _text(arm.gravity), "timestep": repr(step), "integrator": integrator}
    ElementTree.SubElement(ElementTree.SubElement(root, "option", option), "flag", dict.fromkeys(ABSENT, "disable"))
    elements = [ElementTree.SubElement(root, "worldbody")]
    motors = ElementTree.SubElement(root, "actuator")
    for body in arm.bodies:
        drive, friction = body.drive, body.friction
        assert drive.command == "voltage", "MuJoCo's motor here takes volts"
        assert drive.efficiency in (None, 1.0), "MuJoCo has no gear loss"
        assert friction is not None
        assert friction.smoothing is None, "MuJoCo's own dry friction is another law: viscous only"
        x, y, z, w = Rotation.from_matrix(np.array(body.placement.rotation, dtype=float)).as_quat()
        pose = {"pos": _text(body.placement.position), "quat": _text((w, x, y, z))}
        element = ElementTree.SubElement(elements[body.parent + 1], "body", pose)
        elements.append(element)
        joint = {"name": body.joint, "type": "hinge" if body.kind == "revolute" else "slide", "axis": "0 0 1"}
        joint |= {"armature": repr(float(drive.armature)), "damping": repr(float(friction.viscous))}
        ElementTree.SubElement(element, "joint", joint)
        tensor = np.array(body.inertia_com, dtype=float)
        full = _text(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        mass = {"mass": repr(float(body.mass)), "pos": _text(body.com), "fullinertia": full}
        ElementTree.SubElement(element, "inertial", mass)
        gain = drive.gear_ratio * drive.torque_constant / drive.resistance  # n Kt/R [N m/V]
        bias = -gain * drive.gear_ratio * drive.back_emf_constant  # [N m s/rad]
        motor = {
            "joint": body.joint,
            "gainprm": repr(float(gain)),
            "biastype": "affine",
            "biasprm": _text((0, 0, bias)),
        }
        ElementTree.SubElement(motors, "general", motor)
    return ElementTree.tostring(root, encoding="unicode")


def _text(numbers: Any) -> str:
    return " ".join(repr(float(number)) for number in numbers)
