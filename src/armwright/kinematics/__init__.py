"""Forward kinematics and Jacobians."""

from armwright.kinematics.axial_motion import AxialMotion
from armwright.kinematics.forward_kinematics import body_placements, forward_kinematics, frame_placement
from armwright.kinematics.jacobian import jacobian
from armwright.kinematics.jacobian_dot_qd import jacobian_dot_qd
from armwright.kinematics.joint_motion import JointMotion, joint_motions, origin_acceleration, turning

__all__ = [
    "AxialMotion",
    "JointMotion",
    "body_placements",
    "forward_kinematics",
    "frame_placement",
    "jacobian",
    "jacobian_dot_qd",
    "joint_motions",
    "origin_acceleration",
    "turning",
]
