"""Forward kinematics and Jacobians."""

from armwright.kinematics.forward_kinematics import body_placements, forward_kinematics, frame_placement
from armwright.kinematics.jacobian import jacobian
from armwright.kinematics.joint_motion import JointMotion, joint_motions

__all__ = ["JointMotion", "body_placements", "forward_kinematics", "frame_placement", "jacobian", "joint_motions"]
