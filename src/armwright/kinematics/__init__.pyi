"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.ik.goals import Goal as Goal
from armwright.ik.measures import Manipulability as Manipulability, manipulability as manipulability
from armwright.ik.solutions import PoseBranches as PoseBranches, PoseSolutions as PoseSolutions
from armwright.ik.solve import inverse_kinematics as inverse_kinematics
from armwright.ik.targets import pose_towards as pose_towards
from armwright.ik.workspace import workspace as workspace
from armwright.kinematics.forward_kinematics import forward_kinematics as forward_kinematics
from armwright.kinematics.jacobian import jacobian as jacobian
from armwright.kinematics.jacobian_dot_qd import jacobian_dot_qd as jacobian_dot_qd
