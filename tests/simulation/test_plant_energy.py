"""Power balance: what comes in is heat, friction and work, or is stored; energies integrated by the same stages."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.simulation.plant import Plant
from simulation.plants import COULOMB, ELASTIC, MANY, MOTOR, STOPS, SUPPLY, pendulum, with_energies


def missing(arm, u, h, duration=0.1, q=0.3, qd=0.5):
    """The energy that the balance lacks, as a share of the largest that went any way."""
    plant = Plant.of(arm)
    x = plant.initial(np.full(arm.n, q), np.full(arm.n, qd))
    last, went = with_energies(plant, x, u, h, round(duration / h))
    stored = float(plant.stored_energy(last)) - float(plant.stored_energy(x))
    lack = went["electrical"] - went["heat"] - went["friction"] - went["mechanical"] - stored
    return abs(lack) / max(abs(value) for value in went.values())


@pytest.mark.parametrize("name", [name for name in MANY if name != "supply"])
def test_power_balances(name):
    assert missing(MANY[name], [12.0, 8.0][: MANY[name].n], 1e-4) < 1e-6


def test_power_balances_when_a_motor_feeds_the_bus():
    """Driven backwards, the bus rises until the chopper burns what comes."""
    arm = pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": SUPPLY})
    assert missing(arm, [-8.0], 1e-4, qd=9.0) < 1e-6


@pytest.mark.parametrize("what", ["stops", "backlash"])
def test_where_contacts_switch_it_shrinks_with_the_step(what):
    arm = {
        "stops": pendulum(motor=MOTOR, friction=COULOMB, stops=STOPS, limits={"position_rad": [-1.0, 0.35]}),
        "backlash": pendulum(motor=MOTOR, friction=COULOMB, elasticity={**ELASTIC, "backlash_rad": 0.002}),
    }[what]
    lacks = [missing(arm, [2.0], 1e-3 / 2**k, duration=0.2, qd=0.8) for k in range(5)]
    assert lacks[-1] < 1e-6
    assert -np.polyfit(range(5), np.log2(lacks), 1)[0] > 1.8  # a force that bends within a step leaves order 2


def test_under_a_sampled_controller_it_shrinks_with_the_order():
    """Quantised encoder and converter under a limit of voltage: the drive jumps at ticks, the balance is lacking by h³.

    The loop's own commands are played back to the plant with its energies as further states, which comes to the loop's own end.
    """
    arm = pendulum(
        motor={**MOTOR, "inductance_h": 2e-3}, friction={"viscous_n_m_s_per_rad": 0.8}, limits={"voltage_v": 20.0}
    )
    plant, period, ticks, lacks = Plant.of(arm), 4e-3, 40, []
    for substeps in (8, 16, 32):
        run = aw.simulate(
            aw.Scenario(
                arm, controller=aw.JointPID(kp=60.0, kd=2.0), reference=[0.5], sample_period=period, substeps=substeps,
                duration=ticks * period, sensors=aw.Sensors(counts=64, velocity="difference"),
                shaping=aw.Shaping(resolution=0.5), timing=aw.Timing("one-tick"), initial_command=[0.0],
            )
        )  # fmt: skip
        assert np.ptp(run.u_issued.values) > 20.0
        x = plant.initial([0.0], [0.0])
        commands = run.u.values[:-1].repeat(substeps, axis=0)
        last, went = with_energies(plant, x, commands, period / substeps, ticks * substeps)
        np.testing.assert_allclose(last[:2], [run.q.values[-1, 0], run.qd.values[-1, 0]], rtol=1e-9)
        stored = float(plant.stored_energy(last)) - float(plant.stored_energy(x))
        lack = went["electrical"] - went["heat"] - went["friction"] - went["mechanical"] - stored
        lacks.append(abs(lack) / max(abs(value) for value in went.values()))
    assert lacks[-1] < 1e-6
    assert np.log2(lacks[1] / lacks[2]) > 2.5


def test_powers_of_a_wrench():
    """The arm that is pushed does negative work on its environment."""
    plant = Plant.of(MANY["plain"])
    x, wrench = plant.initial([0.0], [2.0]), np.array([0.0, 0.0, -5.0, 0.0, 0.0, 0.0])
    assert plant.energy_rates(x, [0.0], wrench)["mechanical"] == pytest.approx(0.0)  # the tip is the joint's own frame
    turned = np.array([0.0, 0.0, 0.0, 0.0, 3.0, 0.0])
    assert plant.energy_rates(x, [0.0], turned)["mechanical"] == pytest.approx(-6.0)
