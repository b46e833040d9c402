"""MuJoCo's `dcmotor`: the same drives by a peer. Its rules are of lower order, so its error is seen to shrink towards us.

Its cogging and LuGre are in motor angle, σ2 is joint damping, K is √(Kt Ke), saturation clamps the force before the gear, and
the winding's temperature is told as its rise above the ambient.
"""

from __future__ import annotations

import numpy as np
import pytest

from armwright.simulation.plant.plant import Plant
from simulation.plants import COGGING, MOTOR, ON_MOTOR, chain, pendulum, steps

mujoco = pytest.importorskip("mujoco")

VISCOUS = {"viscous_n_m_s_per_rad": 0.8}
BRISTLE = 'lugre="0.8 0.002 0.04 0.06 5.0"'  # ON_MOTOR's
WARM = {
    "ambient_c": 25.0,
    "reference_c": 20.0,
    "resistance_temperature_coefficient_per_k": 0.004,
    "winding_capacity_j_per_k": 2.0,
    "winding_resistance_k_per_w": 1.5,
}
EFFECTS = {  # keys of motor, friction and limits; MuJoCo's; the order of its RK4, 1 with activations, 0 where a limit switches
    "plain": ({}, VISCOUS, {}, "", 4),
    "cogging": ({"cogging": COGGING}, VISCOUS, {}, 'cogging="0.01 7 0.3"', 4),
    "inductance": ({"inductance_h": 1e-3}, VISCOUS, {}, 'inductance="1e-3 0"', 1),
    "lugre": ({}, ON_MOTOR, {}, BRISTLE, 1),
    "both": ({"inductance_h": 1e-3}, ON_MOTOR, {}, f'inductance="1e-3 0" {BRISTLE}', 1),
    "thermal": ({"thermal": WARM}, VISCOUS, {}, 'thermal="1.5 2 0 0.004 20 25"', 1),
    "saturation": ({}, VISCOUS, {"torque_n_m": 20.0}, 'saturation="0.4 0 0"', 0),
}
BODY = '<joint name="j{k}" type="hinge" axis="0 1 0" damping="0.8" armature="0.5"/>' + (
    '<inertial pos="0.3 0 0" mass="3" diaginertia="0.01 0.1 0.1"/>'
)
MOTORS = '<dcmotor joint="j{k}" gear="50" motorconst="0.06" resistance="1.2" {extra}/>'


def theirs(h, duration, extra, u):
    """Positions and speeds that MuJoCo comes to, joints from 0.3 rad at 0.5 rad/s."""
    bodies = ""
    for k in reversed(range(len(u))):
        bodies = f'<body pos="{0.6 if k else 0} 0 0">{BODY.format(k=k)}{bodies}</body>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{h}" integrator="RK4" gravity="0 0 -9.81"><flag contact="disable"/></option>'
        f"<worldbody>{bodies}</worldbody><actuator>"
        + "".join(MOTORS.format(k=k, extra=extra) for k in range(len(u)))
        + "</actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.3, 0.5, u
    for _ in range(round(duration / h)):
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])


@pytest.mark.sample(9)
@pytest.mark.parametrize("u", [[12.0], [12.0, -7.0]], ids=["pendulum", "two links"])
@pytest.mark.parametrize("name", EFFECTS)
def test_parity(name, u):
    """Their error against our fine run shrinks by their order with half the step, down to a thousandth of the motion."""
    motor, friction, limits, extra, order = EFFECTS[name]
    joint = {"command": "voltage", "motor": {**MOTOR, **motor}, "friction": friction, "limits": limits}
    arm = pendulum(**joint) if len(u) == 1 else chain([joint, joint])
    plant, n, duration = Plant.of(arm), len(u), 0.1
    x = plant.initial(np.full(n, 0.3), np.full(n, 0.5))
    if "bristle" in plant.layout:
        plant.part(x, "bristle")[:] = 0.0  # as MuJoCo begins
    ours = steps(plant, x, u, 1e-5, 10_000)[-1][: 2 * n]
    errors = [np.abs(theirs(h, duration, extra, u) - ours).max() for h in (1e-3, 5e-4, 2.5e-4)]
    assert errors[-1] < {0: 1e-5, 1: 1e-3, 4: 1e-7}[order]
    if order and errors[2] > 1e-10:
        assert np.log2(errors[1] / errors[2]) == pytest.approx(order, abs=0.35)
    assert np.abs(steps(plant, x, u, 5e-4, 200)[-1][: 2 * n] - ours).max() < 2e-4
