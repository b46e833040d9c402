"""A measurement between ticks is of one instant: state, commands, wrench, payload and brakes that act there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.model.joint_signals import joint_signal
from armwright.signals import Signal
from simulation.plants import MOTOR, pendulum

PERIOD, TICKS = 4e-3, 30
COMMAND_DELAY, CHANGES = 0.3 * PERIOD, 0.4 * PERIOD  # of commands, and of what else acts, behind each tick
DELAYS = {"after both": 0.45 * PERIOD, "between": 0.65 * PERIOD, "before both": 0.85 * PERIOD}
CONSTANT, RESISTANCE = 50.0 * 0.06, 1.2
INERTIA = 3.0 * 0.3**2 + 0.1 + 50.0**2 * 2e-4  # [kg m²] of rod and rotor about the joint
VISCOUS, FIRST = 0.8, 2.0  # [N m s/rad], and the command before the first tick [V]
SOLVERS = {"rk3": aw.Solver(), "rk45": aw.Solver("rk45"), "cvodes": aw.Solver("cvodes")}


@dataclass(frozen=True)
class Witness:
    """Speed, motor voltage and torque, acceleration, and the moment about the joint, all at once."""

    def signals(self, arm):
        seen = [joint_signal(arm, f"w_{name}", name, name) for name in ("qd", "qdd", "tau", "current")]
        return (*seen, Signal("w_volts", "V", (1,)), Signal("w_moment", "N m", (1,)))

    def measure(self, plant, s, w):
        outputs = plant.outputs
        return {
            "w_qd": plant.qd, "w_qdd": outputs["qdd"], "w_tau": outputs["tau"], "w_volts": outputs["voltage"],
            "w_current": plant.current, "w_moment": plant.wrench[4:5],
        }, s  # fmt: skip


def command(t):
    return 9.0 * scalar.sin(90.0 * t) + 4.0 * scalar.cos(31.0 * t)


def moment(t):
    return 6.0 * np.cos(70.0 * t)


def scenario(delay, solver=SOLVERS["rk3"]):
    arm = pendulum(gravity=0.0, motor=MOTOR, friction={"viscous_n_m_s_per_rad": VISCOUS})
    times = np.concatenate([[0.0], np.arange(TICKS) * PERIOD + CHANGES])
    wrench = np.zeros((len(times), 6))
    wrench[:, 4] = moment(times)
    loop = aw.Loop(
        controller=lambda t, r, y: scalar.array([command(t)]), period=PERIOD, sensors=[aw.Sensors(), Witness()],
        timing=aw.Timing(command_delay=COMMAND_DELAY, measurement_delay=delay), initial_command=[FIRST],
    )  # fmt: skip
    inputs = aw.Inputs(wrench=aw.Schedule(times, wrench, ("fx", "fy", "fz", "mx", "my", "mz")))
    return aw.Scenario(arm, TICKS * PERIOD, loop=loop, inputs=inputs, solver=solver)


def measured(run, name):
    return run[f"{name}_measured"].values[..., 0]


@pytest.mark.sample(3)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("when", DELAYS)
def test_measured_values_belong_together(when, solver):
    """The voltage is that of the command then in force, and torque and acceleration follow from it at the measured speed."""
    run = aw.simulate(scenario(DELAYS[when], SOLVERS[solver]))
    qd, qdd, tau, volts, turned = (measured(run, f"w_{name}") for name in ("qd", "qdd", "tau", "volts", "moment"))
    at = np.arange(1, TICKS + 1) - DELAYS[when] / PERIOD  # in ticks, when rows 1, … were measured
    issued = np.floor(at - COMMAND_DELAY / PERIOD)
    np.testing.assert_allclose(volts[1:], np.where(issued < 0, FIRST, command(issued * PERIOD)), atol=1e-12)
    changed = np.floor(at - CHANGES / PERIOD)
    np.testing.assert_allclose(turned[1:], moment(np.where(changed < 0, 0.0, changed * PERIOD + CHANGES)), atol=1e-12)
    np.testing.assert_allclose(tau, CONSTANT * (volts - CONSTANT * qd) / RESISTANCE, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(measured(run, "w_current"), tau / CONSTANT, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(INERTIA * qdd, tau + turned - VISCOUS * qd, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(measured(run, "qd"), qd)


def test_lanes_measure_as_they_do_alone():
    """One that is measured at ticks, beside others that are measured between them: to the bit."""
    delays = [0.0, *DELAYS.values()]
    together = aw.simulate(scenario(aw.Batch(np.array(delays))))
    for lane, delay in enumerate(delays):
        alone = aw.simulate(scenario(delay))
        for name in ("q", "w_qdd_measured", "w_tau_measured", "w_moment_measured", "w_current_measured"):
            np.testing.assert_array_equal(together[name].values[lane], alone[name].values)


def test_a_run_goes_on_with_what_was_seen():
    """A loop that stops between the sampling of the plant and the tick measures next what it would have measured."""
    whole, simulation = aw.simulate(scenario(DELAYS["between"])), aw.simulation.Simulation(scenario(DELAYS["between"]))
    simulation.run(10 * PERIOD)
    rest = simulation.run((TICKS - 10) * PERIOD)
    for name in ("q", "w_qdd_measured", "w_moment_measured"):
        np.testing.assert_array_equal(rest[name].values, whole[name].values[10:])
