"""Loops with everything that goes wrong in them: saturation, lost samples, jitter, spikes, blows, noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import armwright as aw
from armwright import scalar
from simulation.fields import scenario_of
from simulation.plants import MOTOR, pendulum

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
POSITION, SPEED = (8, 5), (4, 1)  # of `three_rates`: ticks from one turn of a loop to the next, and its first tick


@dataclass(frozen=True)
class SpikedSensors(aw.Sensors):
    """Sensors of which one sample in a hundred has all positions wrong."""

    def draws(self, arm):
        return super().draws(arm) + 1

    def measure(self, plant, s, w):
        values, memory = super().measure(plant, s, w[:-1])
        spike = scalar.where(scalar.less(w[-1], 0.01), 0.05, 0.0)
        return {**values, "q": scalar.array(values["q"] + spike)}, memory


def swinging(arm, amplitude, seconds):
    """Every joint to and fro about a pose, each with its own period."""
    middle = 0.3 * np.arange(1, arm.n + 1) / arm.n

    def reference(t):
        return scalar.array(
            [m + amplitude * scalar.sin(2.0 * np.pi * t / (seconds * (1.0 + 0.37 * k))) for k, m in enumerate(middle)]
        )

    return reference


def blows(duration, newtons):
    """A wrench on the tip now and then."""
    times = np.arange(0.0, duration, max(duration / 20.0, 0.05))
    rows = (
        np.random.default_rng(1).normal(scale=newtons, size=(len(times), 6)) * (np.arange(len(times)) % 3 == 1)[:, None]
    )
    return aw.Inputs(wrench=aw.Schedule(times, rows, ("fx", "fy", "fz", "mx", "my", "mz")))


def cascade(ticks):
    """The modular arm's position, speed and current commands at 4 ms on its bus: the example without its lanes."""
    given = aw.read_scenario(EXAMPLES / "bus-4ms.scenario.toml")
    arm, loop = given.arm, given.loop
    assert loop is not None
    duration = 4e-3 * ticks
    loop = replace(
        loop,
        reference=swinging(arm, 0.3, 5.0),
        sensors=SpikedSensors(side="link", counts=360000, velocity="difference", position_noise=1e-4),
        command_filter=aw.CommandFilter(limit=[10.0, 10.0, 10.0, 10.0, 3.0, 3.0], rate=400.0, resolution=0.01),
        timing=aw.Timing("one-tick", measurement_loss=0.05, command_loss=0.02, jitter=1e-3),
    )
    return replace(given, vary={}, lanes=None, duration=duration, loop=loop, inputs=blows(duration, 20.0))


def voltage_loop(ticks):
    """Voltages for the Puma's motors at 1 kHz: PID behind a low-pass filter and a notch, friction compensated."""
    arm, duration = aw.load("puma560"), 1e-3 * ticks
    pid = aw.JointPID(
        kp=[400.0, 600.0, 300.0, 60.0, 60.0, 60.0],
        ki=100.0,
        kd=[20.0, 30.0, 15.0, 3.0, 3.0, 3.0],
        cutoff_hz=80.0,
        limit=[30.0] * 6,
        anti_windup="back-calculation",
        tracking_time=0.05,
        delay_ticks=1,
    )
    law = aw.Filtered(
        aw.FrictionCompensation(pid, dead_band=1e-3, rest_speed=1e-2), [aw.LowPass(200.0), aw.Notch(60.0, 20.0, 0.1)]
    )
    loop = aw.Loop(
        law,
        reference=swinging(arm, 0.3, 3.0),
        period=1e-3,
        sensors=SpikedSensors(counts=4096, current_noise=0.01),
        command_filter=aw.CommandFilter(limit=24.0, resolution=48.0 / 2**12),
        timing=aw.Timing("one-tick", measurement_loss=0.03, jitter=0.4e-3, clock_drift=50e-6),
    )
    return aw.Scenario(arm, duration=duration, loop=loop, inputs=blows(duration, 20.0), seed=3)


def computed_torque(ticks):
    """Computed torque for the direct-drive arm at 2 kHz, its reference held within limits."""
    arm, duration = aw.load("cmu-dd"), 0.5e-3 * ticks
    law = aw.trajectories.ReferenceFilter(
        aw.ComputedTorque(kp=100.0, kd=20.0, ki=50.0), velocity=2.0, acceleration=20.0, jerk=400.0
    )
    loop = aw.Loop(
        law,
        reference=swinging(arm, 0.3, 2.0),
        period=0.5e-3,
        sensors=SpikedSensors(counts=65536, velocity="observer", cutoff_hz=150.0),
        command_filter=aw.CommandFilter(limit=[70.0, 70.0, 70.0, 50.0, 22.0, 22.0], rate=1e5),
        timing=aw.Timing("ideal", command_delay=0.2e-3, jitter=0.2e-3, measurement_loss=0.05, command_loss=0.01),
    )
    return aw.Scenario(arm, duration=duration, loop=loop, inputs=blows(duration, 3.0), seed=5)


def three_rates(ticks):
    """Position, speed and current loops of a motor that swings, each at its own rate; at 1 kHz.

    Without integrators: those of float drift away from those of double where both are given recorded measurements.
    """
    model = pendulum(motor={**MOTOR, "inductance_h": 1e-3}, limits={"voltage_v": 48.0})
    law = aw.Cascade(
        position_kp=20.0, speed_kp=1.0, current_kp=1.0, voltage_limit=40.0, slack=1e-2,
        position_every=POSITION[0], position_phase=POSITION[1], speed_every=SPEED[0], speed_phase=SPEED[1],
    )  # fmt: skip
    return scenario_of(
        model, controller=law, reference=lambda t: scalar.array([0.3 * scalar.sin(2.0 * t)]), period=1e-3, substeps=4,
        duration=1e-3 * ticks, integrator="rk3",
    )  # fmt: skip


CONTROLLERS = {"cascade": cascade, "voltage_loop": voltage_loop, "computed_torque": computed_torque}
