"""Which tags of a URDF are read and which are known to be harmless to the dynamics of the arm. All others are refused."""

from __future__ import annotations

READ: dict[str, tuple[str, ...]] = {
    "robot": ("link", "joint", "transmission", "material", "gazebo"),
    "link": ("inertial", "visual", "gravity", "kinematic", "origin"),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
    "visual": ("origin", "geometry", "material"),
}

HARMLESS: dict[str, tuple[str, ...]] = {
    "robot": (
        *("sensor", "ros2_control", "plugin", "controller", "rviz", "verbose"),
        *("group", "group_state", "end_effector", "virtual_joint", "passive_joint", "disable_collisions"),  # SRDF
        *("collision_filter", "self_collide", "drake:collision_filter_group"),
    ),
    "link": (
        *("collision", "collision_checking", "self_filter", "verbose", "sensor"),
        *("contact", "surface", "selfCollide", "self_collide"),  # the touch of an environment, which is not here
    ),
    "joint": ("safety_controller", "calibration", "hardwareInterface", "verbose"),  # of controllers
    "visual": ("verbose", "texture", "name"),
}

TRANSMISSION_HARMLESS = (
    *("type", "hardwareInterface", "hardware_interface", "robotNamespace", "role", "plugin", "param", "verbose"),
    *("command_interface", "state_interface", "simulated_actuated_joint", "pulsesPerRevolution", "offset"),
    "ignoreTransmissionAbsoluteEncoder",  # which encoder a controller reads
)

TRANSMISSION_PHYSICS = (  # of other programs; where it counts, the drive file says it
    *("motorInertia", "motor_inertia", "rotorInertia", "rotor_inertia", "motorScale", "motor_scale"),
    *("motorTorqueConstant", "motor_torque_constant", "torque_constant", "efficiency", "damping", "friction"),
    *("saturationLower", "saturationUpper", "deadBandLower", "deadBandUpper"),  # of PAL's virtual joints
    *("leftActuator", "rightActuator", "rollJoint", "flexJoint", "gap_joint", "passive_joint", "screw_joint"),  # PR2's
    *("compensator", "use_simulated_gripper_joint", "thread_pitch"),
)

GAZEBO_ELEMENTS = ("inertial", "joint", "link", "model")  # bodies and joints that only Gazebo has

GAZEBO_PHYSICS = {  # what would change the dynamics in Gazebo, and the values that do not
    "turnGravityOff": ("0", "false", ""),
    "gravity": ("1", "true", ""),
    "springStiffness": ("0", "0.0", ""),
    "springReference": ("0", "0.0", ""),
    "dampingFactor": ("0", "0.0", ""),
}

DYNAMICS_ELSEWHERE = ("D", "K", "mu_coulomb", "mu_viscous")  # vendors' own simulation; contradict damping and friction
LIMITS_ELSEWHERE = ("acceleration", "deceleration", "jerk", "current", "command_effort", "gear_velocity")
