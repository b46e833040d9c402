"""The same arm in Pinocchio and in MuJoCo, built from the description without any of our algorithms.

Both take positions, speeds and torques in *our* order of joints and give results in it: Pinocchio numbers its joints
depth-first (its CRBA is silently wrong otherwise), MuJoCo by the nesting of its XML.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from armwright.description.robot import FixedJoint, PrismaticJoint, RevoluteJoint, RobotDescription

STANDARD_GRAVITY = (0.0, 0.0, -9.80665)
Z = np.array([0.0, 0.0, 1.0])


def transform(rotation: Any, position: Any) -> np.ndarray:
    """(4, 4) from a SciPy rotation and a position."""
    t = np.eye(4)
    t[:3, :3], t[:3, 3] = rotation.as_matrix(), position
    return t


def about(axis: str, angle: Any, distance: Any = 0.0) -> np.ndarray:
    """Screw about and along x or z: the halves of a Denavit-Hartenberg row."""
    return transform(Rotation.from_euler(axis, float(angle)), float(distance) * np.eye(3)["xyz".index(axis)])


def frame_transform(frame: Any) -> np.ndarray:
    """xyz_m and rpy_rad, the fixed-axis angles of a URDF."""
    return transform(Rotation.from_euler("xyz", frame.rpy_rad.value), frame.xyz_m.value)


def joint_transforms(joint: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(before, axis, behind): the child's link frame stands at  before · motion(axis, q) · behind  in the parent's."""
    if joint.frame is not None:
        axis = Z if isinstance(joint, FixedJoint) else np.array(joint.axis.value) / np.linalg.norm(joint.axis.value)
        return frame_transform(joint.frame), axis, np.eye(4)
    row = joint.dh or joint.modified_dh
    if joint.type in ("revolute", "helical"):
        along_z = about("z", row.offset_rad, row.r_m)
    elif isinstance(joint, PrismaticJoint):
        along_z = about("z", row.theta_rad, row.offset_m)
    else:
        along_z = about("z", row.theta_rad, row.r_m)
    along_x = about("x", row.alpha_rad, row.a_m)
    if joint.dh is not None:
        return along_z, Z, along_x  # turning and sliding about z commute with what stands before them
    return along_x @ along_z, Z, np.eye(4)


def children(robot: RobotDescription, link: str) -> Iterator[Any]:
    """The joints that a link carries."""
    return (joint for joint in robot.joints if joint.parent == link)


def armature(joint: Any) -> float:
    """n² J_m, 0 without a motor."""
    motor = joint.motor
    return 0.0 if motor is None else float(motor.gear_ratio) ** 2 * float(motor.rotor_inertia_kg_m2)


def frame_of_tip(robot: RobotDescription) -> tuple[str, np.ndarray]:
    """The link that carries the tip and where it stands there; the last link where the description names none."""
    for frame in robot.frames:
        if frame.name == robot.tip:
            return frame.link, frame_transform(frame)
    parents = {joint.parent for joint in robot.joints}
    return robot.tip or next(link.name for link in robot.links if link.name not in parents), np.eye(4)


class Pinocchio:
    """The arm in Pinocchio."""

    tip_joint: int
    tip_placement: Any

    def __init__(self, robot: RobotDescription, names: list[str]):
        import pinocchio as pin

        self.pin, self.model = pin, pin.Model()
        gravity = robot.gravity_m_s2.value if robot.gravity_m_s2 is not None else STANDARD_GRAVITY
        self.model.gravity = pin.Motion(np.array(gravity), np.zeros(3))
        rotors: dict[int, float] = {}
        tip_link, tip_frame = frame_of_tip(robot)

        def grow(link: str, carrier: int, placed: Any) -> None:
            if link == tip_link:
                self.tip_joint, self.tip_placement = carrier, placed * pin.SE3(tip_frame)
            for joint in children(robot, link):
                before, axis, behind = (m if m.ndim == 1 else pin.SE3(m) for m in joint_transforms(joint))
                if isinstance(joint, FixedJoint):
                    at, frame = carrier, placed * before * behind
                else:
                    if joint.type == "helical":
                        moving = pin.JointModelHelicalUnaligned(axis, float(joint.pitch_m_per_rad))
                    elif joint.type == "revolute":
                        moving = pin.JointModelRevoluteUnaligned(axis)
                    else:
                        moving = pin.JointModelPrismaticUnaligned(axis)
                    at = self.model.addJoint(carrier, moving, placed * before, joint.name)
                    rotors[at], frame = armature(joint), behind
                body = robot.link(joint.child)
                com = np.array(body.com_m.value)
                self.model.appendBodyToJoint(
                    at, pin.Inertia(float(body.mass_kg), com, body.inertia_kg_m2.matrix()), frame
                )
                grow(joint.child, at, frame)

        grow(robot.base, 0, pin.SE3.Identity())
        self.model.armature = np.array([rotors[k] for k in range(1, self.model.njoints)])
        self.data = self.model.createData()
        ids = [self.model.getJointId(name) for name in names]
        self.tip = self.model.addFrame(pin.Frame("tip", self.tip_joint, 0, self.tip_placement, pin.FrameType.OP_FRAME))
        self.data = self.model.createData()
        self.order = np.array([self.model.joints[k].idx_v for k in ids])  # of each of our joints in Pinocchio's vectors

    def _theirs(self, ours: np.ndarray) -> np.ndarray:
        theirs = np.empty(len(ours))
        theirs[self.order] = ours
        return theirs

    def _pushes(self, q: np.ndarray, wrench: np.ndarray | None) -> Any:
        """The wrench at the tip, in base axes, as the force on every joint's body in that joint's frame."""
        forces = self.pin.StdVec_Force()
        forces.extend([self.pin.Force.Zero() for _ in range(self.model.njoints)])
        if wrench is not None:
            self.pin.framesForwardKinematics(self.model, self.data, self._theirs(q))
            at_tip = self.pin.SE3(np.eye(3), self.data.oMf[self.tip].translation)
            forces[self.tip_joint] = (self.data.oMi[self.tip_joint].inverse() * at_tip).act(self.pin.Force(wrench))
        return forces

    def inverse_dynamics(self, q, qd, qdd, wrench=None) -> np.ndarray:
        state = (self._theirs(v) for v in (q, qd, qdd))
        return self.pin.rnea(self.model, self.data, *state, self._pushes(q, wrench))[self.order]

    def forward_dynamics(self, q, qd, tau, wrench=None) -> np.ndarray:
        state = (self._theirs(v) for v in (q, qd, tau))
        return self.pin.aba(self.model, self.data, *state, self._pushes(q, wrench))[self.order]

    def mass_matrix(self, q) -> np.ndarray:
        n = self.model.nv
        upper = np.triu(self.pin.crba(self.model, self.data, self._theirs(q)).reshape(n, n))
        full = upper + np.triu(upper, 1).T
        return full[np.ix_(self.order, self.order)]

    def gravity_torques(self, q) -> np.ndarray:
        return self.pin.computeGeneralizedGravity(self.model, self.data, self._theirs(q))[self.order]

    def forward_kinematics(self, q) -> np.ndarray:
        self.pin.framesForwardKinematics(self.model, self.data, self._theirs(q))
        return self.data.oMf[self.tip].homogeneous

    def jacobian(self, q) -> np.ndarray:
        axes = self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        columns = self.pin.computeFrameJacobian(self.model, self.data, self._theirs(q), self.tip, axes)
        return columns.reshape(6, self.model.nv)[:, self.order]  # one joint comes back without its axis

    def _square(self, theirs: np.ndarray) -> np.ndarray:
        return theirs.reshape(self.model.nv, self.model.nv)[np.ix_(self.order, self.order)]

    def inverse_dynamics_derivatives(self, q, qd, qdd) -> tuple[np.ndarray, np.ndarray]:
        state = (self._theirs(v) for v in (q, qd, qdd))
        self.pin.computeRNEADerivatives(self.model, self.data, *state)
        return self._square(self.data.dtau_dq), self._square(self.data.dtau_dv)

    def forward_dynamics_derivatives(self, q, qd, tau) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        state = (self._theirs(v) for v in (q, qd, tau))
        self.pin.computeABADerivatives(self.model, self.data, *state)
        upper = np.triu(self.data.Minv.reshape(self.model.nv, self.model.nv))
        inverse = upper + np.triu(upper, 1).T
        return self._square(self.data.ddq_dq), self._square(self.data.ddq_dv), self._square(inverse)

    def jacobian_dot_qd(self, q, qd) -> np.ndarray:
        still = np.zeros(self.model.nv)
        self.pin.forwardKinematics(self.model, self.data, self._theirs(q), self._theirs(qd), still)
        self.pin.updateFramePlacements(self.model, self.data)
        axes = self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return self.pin.getFrameClassicalAcceleration(self.model, self.data, self.tip, axes).vector

    def centre_of_mass(self, q) -> np.ndarray:
        """Of the moving links: Pinocchio leaves out what stands on the base."""
        return self.pin.centerOfMass(self.model, self.data, self._theirs(q)).copy()


class MuJoCo:
    """The arm in MuJoCo, through its XML."""

    def __init__(self, robot: RobotDescription, names: list[str]):
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot))
        self.data = mujoco.MjData(self.model)
        self.order = np.array([self.model.joint(name).dofadr[0] for name in names])

    def _set(self, q, qd=None) -> None:
        self.data.qpos[self.order] = q
        self.data.qvel[self.order] = 0.0 if qd is None else qd
        self.data.qfrc_applied[:] = 0.0

    def inverse_dynamics(self, q, qd, qdd) -> np.ndarray:
        self._set(q, qd)
        self.data.qacc[self.order] = qdd
        self.mujoco.mj_inverse(self.model, self.data)
        return self.data.qfrc_inverse[self.order].copy()

    def forward_dynamics(self, q, qd, tau) -> np.ndarray:
        self._set(q, qd)
        self.data.qfrc_applied[self.order] = tau
        self.mujoco.mj_forward(self.model, self.data)
        return self.data.qacc[self.order].copy()

    def mass_matrix(self, q) -> np.ndarray:
        """Column by column through `mj_mulM`, whose meaning no version of MuJoCo has changed."""
        self._set(q)
        self.mujoco.mj_forward(self.model, self.data)
        columns = np.empty((self.model.nv, self.model.nv))
        for k, unit in enumerate(np.eye(self.model.nv)):
            self.mujoco.mj_mulM(self.model, self.data, columns[k], unit)
        return columns[np.ix_(self.order, self.order)]

    def forward_kinematics(self, q) -> np.ndarray:
        self._set(q)
        self.mujoco.mj_forward(self.model, self.data)
        site = self.data.site("tip")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = site.xmat.reshape(3, 3), site.xpos
        return pose

    def jacobian(self, q) -> np.ndarray:
        self._set(q)
        self.mujoco.mj_forward(self.model, self.data)
        both = np.zeros((6, self.model.nv))
        self.mujoco.mj_jacSite(self.model, self.data, both[:3], both[3:], self.model.site("tip").id)
        return both[:, self.order]


def mjcf(robot: RobotDescription) -> str:
    """The arm as MuJoCo's XML: no geometry, no contacts, no limits; a fixed joint is a body without a joint."""
    root = ElementTree.Element("mujoco", model=robot.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false", balanceinertia="false")
    gravity = robot.gravity_m_s2.value if robot.gravity_m_s2 is not None else STANDARD_GRAVITY
    ElementTree.SubElement(root, "option", gravity=_text(gravity))
    tip_link, tip_frame = frame_of_tip(robot)

    def grow(link: str, element: ElementTree.Element, placed: np.ndarray) -> None:
        """`placed`: the link's frame in the frame of the MuJoCo body that carries it."""
        if link == tip_link:
            ElementTree.SubElement(element, "site", name="tip", **_pose(placed @ tip_frame))
        for joint in children(robot, link):
            before, axis, behind = joint_transforms(joint)
            body = ElementTree.SubElement(element, "body", name=joint.child, **_pose(placed @ before))
            if not isinstance(joint, FixedJoint):
                kind = "hinge" if isinstance(joint, RevoluteJoint) else "slide"
                turn = {"axis": _text(axis), "armature": repr(armature(joint))}
                ElementTree.SubElement(body, "joint", name=joint.name, type=kind, **turn)
            own = robot.link(joint.child)
            centre = behind @ transform(Rotation.identity(), own.com_m.value)
            rotated = behind[:3, :3] @ own.inertia_kg_m2.matrix() @ behind[:3, :3].T
            full = [rotated[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
            mass = repr(float(own.mass_kg))
            ElementTree.SubElement(body, "inertial", pos=_text(centre[:3, 3]), mass=mass, fullinertia=_text(full))
            grow(joint.child, body, behind)

    grow(robot.base, ElementTree.SubElement(root, "worldbody"), np.eye(4))
    return ElementTree.tostring(root, encoding="unicode")


def _text(numbers: Any) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _pose(t: np.ndarray) -> dict[str, str]:
    x, y, z, w = Rotation.from_matrix(t[:3, :3]).as_quat()
    return {"pos": _text(t[:3, 3]), "quat": _text((w, x, y, z))}
