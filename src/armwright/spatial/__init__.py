"""3-D algebra over any scalar: rotations, placements of frames, moving mass."""

from armwright.spatial.articulated_inertia import ArticulatedInertia, turned_vector
from armwright.spatial.frozen import Frozen
from armwright.spatial.inertia import (
    TENSOR,
    acceleration_tensor,
    displaced_inertia,
    inertia_about_origin,
    inertial_moment,
    parallel_axes,
    pseudo_inertia,
    second_moment,
)
from armwright.spatial.placement import Placement
from armwright.spatial.rotation import (
    cross,
    roll_pitch_yaw,
    rotated,
    rotation_quaternion,
    rotation_rpy,
    rotation_to_axis,
    rotation_x,
    rotation_y,
    rotation_z,
    rpy_angles,
    skew,
    snap,
)

__all__ = [
    "TENSOR",
    "ArticulatedInertia",
    "Frozen",
    "Placement",
    "acceleration_tensor",
    "cross",
    "displaced_inertia",
    "inertia_about_origin",
    "inertial_moment",
    "parallel_axes",
    "pseudo_inertia",
    "roll_pitch_yaw",
    "rotated",
    "rotation_quaternion",
    "rotation_rpy",
    "rotation_to_axis",
    "rotation_x",
    "rotation_y",
    "rotation_z",
    "rpy_angles",
    "second_moment",
    "skew",
    "snap",
    "turned_vector",
]
