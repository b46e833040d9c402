"""A refused step names the joint, the effect and the key that its fastest mode comes from."""

from __future__ import annotations

import re

import numpy as np
import pytest

from actuators.drives import one_joint
from armwright.errors import ScenarioError
from armwright.simulation.plant.step_limits import StepLimit
from simulation.plants import (
    BRAKE,
    COULOMB,
    CYLINDER,
    ELASTIC,
    LUGRE,
    MOTOR,
    RK3,
    STOPS,
    SUPPLY,
    THERMAL,
    chain,
    pendulum,
)

SMOOTH = {"viscous_n_m_s_per_rad": 0.8, "smoothing_rad_per_s": 1e-4}
RANGE = {"position_rad": [-1.0, 1.0]}
STEEP_TABLE = {"positions_rad": [-2.0, 0.5, 0.501, 2.0], "torques_n_m": [250.0, 250.0, -250.0, -250.0]}
EFFICIENCIES = {"torque_n_m": [5.0, 20.0], "rows": [{"driving": [0.5, 0.6]}]}
SIGMOID = {
    "law": "sigmoid",
    "sigmoid_amplitude_n_m": 5.0,
    "sigmoid_slope_s_per_rad": 1e4,
    "sigmoid_shift_rad_per_s": 0.1,
}
FALLING = {
    "coulomb_positive_n_m": 2.0,
    "coulomb_negative_n_m": 2.0,
    "stribeck_torque_n_m": 30.0,
    "stribeck_speed_rad_per_s": 1e-3,
}
JOINTS = {  # key that is named, effect, the joint's record
    "dry friction": ("friction.smoothing_rad_per_s", {"friction": {**COULOMB, "smoothing_rad_per_s": 1e-4}}),
    "falling friction": ("friction.stribeck_speed_rad_per_s", {"friction": FALLING}),
    "viscous friction": ("friction.viscous_n_m_s_per_rad", {"friction": {**COULOMB, "viscous_n_m_s_per_rad": 1e4}}),
    "sigmoid friction": ("friction.sigmoid_slope_s_per_rad", {"friction": SIGMOID}),
    "bristle damping": (
        "friction.bristle_damping_n_m_s_per_rad",
        {"friction": {**LUGRE, "bristle_stiffness_n_m_per_rad": 1e5, "bristle_damping_n_m_s_per_rad": 5e3}},
    ),
    "gear loss": ("friction.smoothing_rad_per_s", {"friction": SMOOTH, "motor": {**MOTOR, "gear_efficiency": 0.5}}),
    "gear loss by a table": (
        "friction.smoothing_rad_per_s",
        {"friction": SMOOTH, "motor": {**MOTOR, "gear_efficiency_table": EFFICIENCIES}},
    ),
    "winding": ("motor.resistance_ohm", {"motor": {**MOTOR, "resistance_ohm": 1e-3}}),
    "cogging": (
        "motor.cogging.amplitude_n_m",
        {"motor": {**MOTOR, "cogging": {"amplitude_n_m": 1.0, "periods": 200, "phase_rad": 0.0}}},
    ),
    "motor's heat": (
        "motor.thermal.winding_capacity_j_per_k",
        {"motor": {**MOTOR, "thermal": {**THERMAL, "winding_capacity_j_per_k": 1e-5}}},
    ),
    "spring of the elastic gear": (
        "elasticity.stiffness_n_m_per_rad",
        {"elasticity": {**ELASTIC, "stiffness_n_m_per_rad": 1e7}},
    ),
    "damper of the elastic gear": (
        "elasticity.damping_n_m_s_per_rad",
        {"elasticity": {**ELASTIC, "damping_n_m_s_per_rad": 1e5}},
    ),
    "spring of the end stop": (
        "stops.stiffness_n_m_per_rad",
        {"stops": {**STOPS, "stiffness_n_m_per_rad": 1e8}, "limits": RANGE},
    ),
    "damper of the end stop": (
        "stops.damping_n_m_s_per_rad",
        {"stops": {**STOPS, "damping_n_m_s_per_rad": 1e5}, "limits": RANGE},
    ),
    "spring of the brake": ("brake.stiffness_n_m_per_rad", {"brake": {**BRAKE, "stiffness_n_m_per_rad": 1e8}}),
    "damper of the brake": ("brake.damping_n_m_s_per_rad", {"brake": {**BRAKE, "damping_n_m_s_per_rad": 1e5}}),
    "spring": ("spring.stiffness_n_m_per_rad", {"spring": {"stiffness_n_m_per_rad": 1e7, "rest_rad": 0.0}}),
    "table of a spring": ("spring.torques_n_m", {"spring": {**STEEP_TABLE, "outside": "constant"}}),
}
WORDS = {"falling friction": "dry friction", "gear loss by a table": "gear loss", "table of a spring": "spring"}


def refusal(arm, command=0.0, step=1.0) -> ScenarioError:
    """The refusal of a step at a command."""
    with pytest.raises(ScenarioError) as refused:
        StepLimit(arm).check_step("rk3", RK3, step, np.full((1, arm.n), command))
    return refused.value


@pytest.mark.parametrize("effect", JOINTS)
def test_joint_effect_and_key_are_named(effect):
    """Of the second of two joints, which alone is fast; both have a motor and friction of their own."""
    key, record = JOINTS[effect]
    calm = {"command": "voltage", "motor": MOTOR, "friction": {**COULOMB, "smoothing_rad_per_s": 10.0}}
    error = refusal(chain([calm, {**calm, **record}]), command=20.0)
    name = WORDS.get(effect, effect)
    assert f" s, that of the {name} of joint 'joint1' ({key}): rk3" in error.what
    assert ("friction then sticks" in error.expected) == ("smoothing" in key)


def test_a_smaller_step_is_named_first():
    """It is taken, and one ten times as large is refused again."""
    arm = pendulum(motor=MOTOR, friction={**COULOMB, "smoothing_rad_per_s": 1e-4})
    step = float(refusal(arm).expected.split()[0])
    StepLimit(arm).check_step("rk3", RK3, step, np.zeros((1, 1)))
    refusal(arm, step=10.0 * step)


def test_the_remedy_helps():
    """Without the smoothing speed the step of the arm without dry friction is accepted."""
    friction = {key: value for key, value in COULOMB.items() if not key.startswith("smoothing")}
    sticking, free = (
        pendulum(motor=MOTOR, friction=friction),
        pendulum(motor=MOTOR, friction={"viscous_n_m_s_per_rad": 0.8}),
    )
    u = np.zeros(1)
    assert StepLimit(sticking).largest_step(RK3, u) == StepLimit(free).largest_step(RK3, u)


def test_what_belongs_to_no_joint():
    """The bus under load, a cylinder, and the swing of an arm under its weight."""
    bus = pendulum(
        motor=MOTOR, friction=COULOMB, robot={"supply": {**SUPPLY, "source_resistance_ohm": 4.0, "capacitance_f": 1e-6}}
    )
    assert "that of the bus that drives load (supply.capacitance_f): rk3" in refusal(bus, 60.0).what
    cylinder = {**CYLINDER, "link_b": "rod0", "stiffness_n_per_m": 1e8}
    assert (
        "the spring of cylinder 'balancer' (stiffness_n_per_m)"
        in refusal(pendulum("torque", robot={"cylinders": [cylinder]})).what
    )
    assert "the arm's swing under its weight (gravity_m_s2)" in refusal(pendulum("torque")).what


def test_of_two_joints_that_are_equally_fast_one_is_named():
    """Neither of two motors that heat alike allows a larger step without its own heat."""
    hot = {"motor": {**MOTOR, "thermal": {**THERMAL, "winding_capacity_j_per_k": 1e-5}}}
    error = refusal(chain([{"command": "voltage", **hot}] * 2), command=20.0)
    assert re.search(r"the motor's heat of joint 'joint[01]' \(motor.thermal.winding_capacity_j_per_k\)", error.what)


def test_keys_of_slides_and_motors():
    """A slide's friction is in m/s, its motor's in rad/s."""
    levels = {"coulomb_positive_n": 3.0, "coulomb_negative_n": 1.0, "smoothing_m_per_s": 1e-5}
    assert "(friction.smoothing_m_per_s)" in refusal(one_joint(levels, type="prismatic")).what
    of_motor = {"side": "motor", "coulomb_positive_n_m": 0.1, "coulomb_negative_n_m": 0.1, "smoothing_rad_per_s": 1e-3}
    motor = {"gear_ratio": 100.0, "rotor_inertia_kg_m2": 1e-5}
    assert "(friction.smoothing_rad_per_s)" in refusal(one_joint(of_motor, motor, type="prismatic")).what


def test_friction_that_rises_with_temperature_counts_warm():
    """Motors 100 K warmer: the level is twice as high, and the step half as large."""
    friction = {**COULOMB, "viscous_n_m_s_per_rad": 0.0, "smoothing_rad_per_s": 1e-4}
    thermal = {**THERMAL, "ambient_c": 20.0}
    cold, warm = (
        StepLimit(pendulum("torque", motor={**MOTOR, "thermal": thermal}, friction={**friction, **more})).largest_step(
            RK3, np.zeros(1)
        )
        for more in ({}, {"coulomb_temperature_coefficient_per_k": 0.01})
    )
    assert warm == pytest.approx(0.5 * cold, rel=0.01)
