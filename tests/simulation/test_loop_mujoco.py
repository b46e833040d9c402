"""MuJoCo's `dcmotor` under the same sampled controller: a pendulum, and `two-link` with motors, through the whole loop.

MuJoCo's arm is stepped by its RK4 between the ticks of a PD law written out here; ours is one compiled run. Its delays are whole
steps of its own, so that 1.5 periods are whole numbers of them; they switch within its RK4, and cost it its order, as activations
(currents, bristles) do. Its bristles begin straight, as ours do at rest.
"""

from __future__ import annotations

import tomllib
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.description.database import parse
from armwright.model import Model, build_model
from simulation.plants import MOTOR, ON_MOTOR, pendulum

mujoco = pytest.importorskip("mujoco")

PERIOD, TICKS, KP, KD = 4e-3, 40, 60.0, 2.0  # [s], 1, [V/rad], [V s/rad]
LIMITS = {"pendulum": 8.0, "two-link": 20.0}  # [N m], which these motions ask more than at times
VISCOUS = {"viscous_n_m_s_per_rad": 0.8}
# keys of each joint, delay in periods, the order of MuJoCo's error
CASES: dict[str, tuple[dict[str, Any], float, int]] = {
    "plain": ({}, 0.0, 4),
    "resistance": ({"motor": {**MOTOR, "resistance_ohm": 4.0}}, 0.0, 4),
    "back-EMF": ({"motor": {**MOTOR, "torque_constant_n_m_per_a": 0.15}}, 0.0, 4),
    "gear": ({"motor": {**MOTOR, "gear_ratio": -30.0}}, 0.0, 4),
    "inductance": ({"motor": {**MOTOR, "inductance_h": 1e-3}}, 0.0, 1),
    "lugre": ({"friction": ON_MOTOR}, 0.0, 1),
    "saturation": ({}, 0.0, 0),
    "delay": ({}, 2.0, 1),
    "a delay of 1.5 periods": ({}, 1.5, 1),
    "all": ({"motor": {**MOTOR, "inductance_h": 1e-3}, "friction": ON_MOTOR}, 1.5, 1),
}


def swing(t, n):
    """Reference positions and speeds of the joints."""
    turn = 5.0 + np.arange(n)
    return scalar.array([0.5 * scalar.sin(w * t) for w in turn]), scalar.array(
        [0.5 * w * scalar.cos(w * t) for w in turn]
    )


def driven(name: str, own: dict[str, Any]) -> Model:
    """The arm with these drives at all its joints."""
    joint = {"command": "voltage", "motor": MOTOR, "friction": VISCOUS, **own}
    if name == "pendulum":
        return pendulum(**joint)
    record = tomllib.loads(files("armwright.robots").joinpath(f"{name}.toml").read_text(encoding="utf-8"))
    return build_model(parse({**record, "joints": [each | joint for each in record["joints"]]}, name))


def mjcf(arm: Model, h: float, delay: float) -> str:
    """The record's chain in MuJoCo's words; `delay` [s]."""

    def text(quantity: Any) -> str:
        return " ".join(repr(float(value)) for value in quantity.value)

    bodies, motors = "", ""
    described: Any = arm.description
    for joint, link in reversed(list(zip(described.joints, described.links, strict=True))):
        ratio, rotor = joint.motor.gear_ratio.value, joint.motor.rotor_inertia_kg_m2.value
        damping = joint.friction.viscous_n_m_s_per_rad.value * (ratio**2 if joint.friction.side == "motor" else 1.0)
        tensor = link.inertia_kg_m2
        bodies = (
            f'<body pos="{text(joint.frame.xyz_m)}"><joint name="{joint.name}" type="hinge" axis="{text(joint.axis)}" '
            f'damping="{damping!r}" armature="{ratio**2 * rotor!r}"/><inertial pos="{text(link.com_m)}" '
            f'mass="{link.mass_kg.value}" diaginertia="{tensor.xx.value} {tensor.yy.value} {tensor.zz.value}"/>{bodies}</body>'
        )
        motors = f'<dcmotor joint="{joint.name}" gear="{ratio}" {_constants(joint, h, delay)}/>' + motors
    return (
        f'<mujoco><option timestep="{h!r}" integrator="RK4" gravity="{text(described.gravity_m_s2)}"/>'
        f'<compiler angle="radian"/><worldbody>{bodies}</worldbody><actuator>{motors}</actuator></mujoco>'
    )


def _constants(joint: Any, h: float, delay: float) -> str:
    """Drive of a joint, in the motor's own angle."""
    motor, friction = joint.motor, joint.friction
    words = {"motorconst": motor.torque_constant_n_m_per_a.value, "resistance": motor.resistance_ohm.value}
    if motor.inductance_h is not None:
        words["inductance"] = f"{motor.inductance_h.value} 0"
    if friction.law == "lugre":
        names = ("bristle_stiffness_n_m_per_rad", "bristle_damping_n_m_s_per_rad", "coulomb_positive_n_m")
        names += ("stribeck_torque_n_m", "stribeck_speed_rad_per_s")
        words["lugre"] = " ".join(repr(getattr(friction, name).value) for name in names)
    if joint.limits.torque_n_m is not None:
        words["saturation"] = f"{joint.limits.torque_n_m.value / abs(motor.gear_ratio.value)} 0 0"
    if delay:
        words |= {"delay": repr(delay), "nsample": round(delay / h) + 1, "interp": "zoh"}
    return " ".join(f'{name}="{value}"' for name, value in words.items())


def theirs(arm: Model, steps: int, delay: float) -> np.ndarray:
    """(ticks + 1, 2n) positions and speeds at MuJoCo's ticks, so many steps in each."""
    model = mujoco.MjModel.from_xml_string(mjcf(arm, PERIOD / steps, delay))
    data, signs = mujoco.MjData(model), np.array([np.sign(body.drive.gear_ratio) for body in arm.bodies])
    rows = []
    for k in range(TICKS + 1):
        rows.append(np.concatenate([data.qpos, data.qvel]))
        q, qd = swing(k * PERIOD, arm.n)
        data.ctrl[:] = signs * (KP * (q - data.qpos) + KD * (qd - data.qvel))
        mujoco.mj_step(model, data, steps)
    return np.array(rows)


def ours(arm: Model, integrator: str, substeps: int, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """The same by our loop, and the motors' torques (ticks + 1, n)."""
    reference = np.array([np.concatenate(swing(k * PERIOD, arm.n)) for k in range(TICKS + 1)])
    run = aw.simulate(
        aw.Scenario(
            arm, duration=TICKS * PERIOD,
            loop=aw.Loop(controller=aw.JointPID(kp=KP, kd=KD), period=PERIOD, reference=np.concatenate([reference,
                np.zeros((TICKS + 1, arm.n))], axis=1), timing=aw.Timing(command_delay=delay), initial_command=np.zeros(arm.n)),
            solver=aw.Solver(substeps=substeps, integrator=integrator),
        )
    )  # fmt: skip
    assert run.attrs["controller"] == "compiled"
    return np.concatenate([run.q.values, run.qd.values], axis=1), run.tau.values


@pytest.mark.parametrize("name", ["pendulum", "two-link"])
@pytest.mark.parametrize("case", CASES)
@pytest.mark.sample(1)
def test_parity_through_the_loop(case, name):
    """Their error against our fine run shrinks by its order with half the step; without its first order, by the second."""
    own, periods, order = CASES[case]
    if case == "saturation":
        own = {"limits": {"torque_n_m": LIMITS[name]}}
    arm, delay = driven(name, own), periods * PERIOD
    fine, torques = ours(arm, "rk4", 32, delay)
    assert np.abs(fine).max() > 0.2
    found = [theirs(arm, steps, delay) for steps in (4, 8, 16)]
    errors = [np.abs(rows - fine).max() for rows in found]
    halved = np.abs(ours(arm, "rk3", 8, delay)[0] - fine).max()
    assert errors[2] < {0: 1e-5, 1: 3e-3, 4: 1e-9}[order]
    assert halved < 1e-4
    if order == 0:
        clipped = np.isclose(np.abs(torques), LIMITS[name])
        assert 0 < clipped.sum() < clipped.size
        assert errors[2] < 0.1 * errors[0]
    elif order == 1:
        assert np.log2(errors[1] / errors[2]) == pytest.approx(1.0, abs=0.06)
        left = [np.abs(2.0 * half - whole - fine).max() for whole, half in pairwise(found)]
        assert left[1] < 2e-4
        assert left[0] / left[1] > 3.5
        assert halved < 0.02 * errors[1]
    else:
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)
