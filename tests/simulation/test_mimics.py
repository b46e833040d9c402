"""Simulations with joints that mimic others: states are those of the coordinates, and power balances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.description.database import parse
from armwright.dynamics import forward_arm
from armwright.model import build_model
from armwright.simulation.plant.plant import Plant
from physics.arms import arm, gradient, gripper
from simulation.energies import energy_rates, stored_energy


def elastic_gripper():
    """`gripper` with a gear that gives way, current dynamics and a bristle in its driven joints."""
    robot = gripper()
    left = next(joint for joint in robot["joints"] if joint["name"] == "left")
    left["motor"] |= {"inductance_h": 1e-3}
    left["elasticity"] = {"stiffness_n_per_m": 5e3, "damping_n_s_per_m": 20.0}
    return build_model(parse(robot, "gripper"))


def test_a_run_is_forward_dynamics_integrated():
    """0.1 s under a constant voltage against SciPy on the plain forward dynamics."""
    model = arm("gripper")
    u, q0 = np.array([3.0, -2.0, 4.0, 1.0, 2.0]), np.array([0.2, 0.1, -0.3, 0.4, 0.02])
    run = aw.simulate(aw.Scenario(model, command=u, duration=0.1, start=q0, solver=aw.Solver(step=1e-4)))
    assert list(run.joint.values) == model.names

    def slope(_, x):
        return np.concatenate([x[5:], forward_arm(model, x[:5], x[5:], u)])

    there = solve_ivp(slope, (0.0, 0.1), np.concatenate([q0, np.zeros(5)]), rtol=1e-10, atol=1e-12)
    end = run.isel(time=-1)
    np.testing.assert_allclose(end.q.values, there.y[:5, -1], rtol=0, atol=1e-7)
    np.testing.assert_allclose(end.qd.values, there.y[5:, -1], rtol=0, atol=1e-5)


def test_a_controller_drives_the_coordinates():
    """Computed torque brings all five to a pose, and the fingers with them."""
    model = arm("gripper").replace(efficiency=None)
    goal = np.array([0.1, 0.02, -0.1, 0.1, 0.01])
    law = aw.ComputedTorque(kp=400.0, kd=40.0)
    run = aw.simulate(
        aw.Scenario(
            model,
            duration=1.5,
            loop=aw.Loop(controller=law, reference=goal, period=1e-3),
            recording=aw.Recording(every=100),
        )
    )
    assert np.abs(run.q.values[-1] - goal).max() < 1e-2


@pytest.mark.parametrize("elastic", [False, True])
def test_power_balances(elastic):
    """electrical = heat + friction + d/dt stored, friction of the followers included."""
    model = elastic_gripper() if elastic else arm("gripper")
    plant = Plant.of(model)
    rng = np.random.default_rng(5)
    for _ in range(3):
        x = plant.initial(0.3 * rng.normal(size=5), 0.3 * rng.normal(size=5))
        x = x + 1e-3 * rng.normal(size=plant.size)
        u = 3.0 * rng.normal(size=5)
        rates = energy_rates(plant, x, u)
        (slope,) = gradient("stored", lambda x: stored_energy(plant, x), x)
        change = slope @ plant.derivative(x, u)
        terms = [rates["electrical"], rates["heat"], rates["friction"], change]
        balance = rates["heat"] + rates["friction"] + change
        assert rates["electrical"] == pytest.approx(balance, abs=1e-9 * np.abs(terms).max())
