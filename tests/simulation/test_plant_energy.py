"""Power balance: what comes in is heat, friction and work, or is stored; energies integrated by the same stages."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from simulation.energies import Balance, energy_rates
from simulation.plants import COULOMB, ELASTIC, LINE, LUGRE, MANY, MOTOR, SUPPLY, chain, pendulum

ORDERS = {"rk3": 3, "rk4": 4}
VISCOUS = {"viscous_n_m_s_per_rad": 0.8}
SOFT = {"stiffness_n_m_per_rad": 2e3, "damping_n_m_s_per_rad": 10.0}
WOUND = {**MOTOR, "inductance_h": 2e-3}
PLAY = {**ELASTIC, "backlash_rad": 0.01}
ROUNDING = 3e-13  # of a balance: no order is seen below


def joint(low, high, **more):
    """One with stops, and more."""
    own = {"command": "voltage", "motor": MOTOR, "friction": VISCOUS, "stops": SOFT, **more}
    return {**own, "limits": {"position_rad": [low, high]}}


STICKING = {"motor": WOUND, "friction": LUGRE}
SWITCHING = {  # arm, q, q̇, u, duration
    "a stop hit several times": (
        pendulum(
            gravity=0.0, motor={**MOTOR, "rotor_inertia_kg_m2": 2e-5}, friction={"viscous_n_m_s_per_rad": 0.1},
            stops={**SOFT, "damping_n_m_s_per_rad": 3.0}, limits={"position_rad": [-0.2, 0.35]},
        ), [0.3], [1.5], [3.0], 0.8,
    ),
    "an arm with stops": (chain([joint(-0.3, 0.35), joint(-0.5, 0.32)]), [0.3, 0.3], [0.8, 0.5], [6.0, 4.0], 0.4),
    "play": (pendulum(motor=MOTOR, friction=VISCOUS, elasticity=PLAY), [0.3], [0.8], [2.0], 0.2),
    "play and stops": (chain([joint(-1.0, 0.35, elasticity=PLAY)]), [0.3], [0.8], [2.0], 0.2),
    "other Coulomb levels either way": (chain([joint(-1.0, 0.35, friction=COULOMB)]), [0.3], [0.8], [2.0], 0.2),
    "bristles and inductance": (chain([joint(-1.0, 0.35, **STICKING)]), [0.3], [0.8], [6.0], 0.2),
    "an arm with all that": (
        chain([joint(-0.3, 0.35, **STICKING), joint(-0.5, 0.32, **STICKING, elasticity=PLAY)]),
        [0.3, 0.3], [0.8, 0.5], [6.0, 4.0], 0.1,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", [name for name in MANY if name != "supply"])
def test_power_balances(name):
    n = MANY[name].n
    assert Balance(MANY[name]).lack([0.3] * n, [0.5] * n, [12.0, 8.0][:n], 1e-4, 0.1) < 1e-6


def test_power_balances_when_a_motor_feeds_the_bus():
    """Driven backwards, the bus rises until the chopper burns what comes."""
    arm = pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": SUPPLY})
    assert Balance(arm).lack([0.3], [9.0], [-8.0], 1e-4, 0.1) < 1e-6


@pytest.mark.parametrize("rule", ORDERS)
@pytest.mark.parametrize("name", SWITCHING)
def test_where_contacts_switch_it_shrinks_with_the_order(name, rule):
    """Steps end where stops and flanks begin and end to touch: each halving divides what is lacking by 2^order."""
    arm, q, qd, u, duration = SWITCHING[name]
    balance = Balance(arm, rule)
    lacks = np.array([balance.lack(q, qd, u, 1e-3 / 2**k, duration) for k in range(6)])
    seen = lacks[lacks > ROUNDING]
    assert lacks[1] < 2e-5
    assert lacks[-1] < 1e-8
    assert len(seen) >= 4
    assert -np.polyfit(range(len(seen)), np.log2(seen), 1)[0] > ORDERS[rule] - 0.3


def test_without_landing_it_does_not():
    """A force that jumps within a step leaves order 2 at best: what the tests above would say if nothing were landed on."""
    arm, q, qd, u, duration = SWITCHING["play and stops"]
    balance = Balance(arm, "rk4", landing=False)
    lacks = [balance.lack(q, qd, u, 1e-3 / 2**k, duration) for k in range(6)]
    assert -np.polyfit(range(6), np.log2(lacks), 1)[0] < 2.5


@pytest.mark.parametrize("name", ["a stop hit several times", "play and stops", "bristles and inductance"])
def test_it_shrinks_with_the_tolerance(name):
    """rk45, whose ticks of 20 ms hold several contacts: what is lacking goes with rtol."""
    arm, q, qd, u, duration = SWITCHING[name]
    tolerances = [1e-5, 1e-7, 1e-9]
    lacks = [Balance(arm, tolerance=rtol).lack(q, qd, u, 2e-2, duration) for rtol in tolerances]
    assert all(lack < 10.0 * rtol for lack, rtol in zip(lacks, tolerances, strict=True))
    assert np.polyfit(np.log10(tolerances), np.log10(lacks), 1)[0] > 0.8


def test_under_a_sampled_controller_it_shrinks_with_the_order():
    """Quantised encoder and converter under a limit of voltage: the drive jumps at ticks, the balance is lacking by h³.

    The loop's own commands are played back to the plant with its energies as further states, which comes to the loop's own end.
    """
    arm = pendulum(motor=WOUND, friction=VISCOUS, limits={"voltage_v": 20.0})
    balance, period, ticks, lacks = Balance(arm), 4e-3, 40, []
    for substeps in (8, 16, 32):
        run = aw.simulate(
            aw.Scenario(
                arm, duration=ticks * period,
                loop=aw.Loop(controller=aw.JointPID(kp=60.0, kd=2.0), reference=[0.5], period=period,
                    sensors=aw.Sensors(counts=64, velocity="difference"), command_filter=aw.CommandFilter(resolution=0.5),
                        timing=aw.Timing("one-tick"), initial_command=[0.0]),
                solver=aw.Solver(substeps=substeps),
            )
        )  # fmt: skip
        assert np.ptp(run.u_issued.values) > 20.0
        begun = balance.plant.initial([0.0], [0.0])
        last, went = balance.moved(begun, run.u.values[:-1], period / substeps, substeps)
        np.testing.assert_allclose(last[:2], [run.q.values[-1, 0], run.qd.values[-1, 0]], rtol=1e-9)
        lacks.append(balance.lacking(begun, last, went))
    assert lacks[-1] < 1e-6
    assert np.log2(lacks[1] / lacks[2]) > 2.5


def test_powers_of_a_wrench():
    """The arm that is pushed does negative work on its environment."""
    plant = Plant.of(MANY["plain"])
    x, u = plant.initial([0.0], [2.0]), np.zeros(1)
    pushed = energy_rates(plant, x, PlantInputs(u, np.array([0.0, 0.0, -5.0, 0.0, 0.0, 0.0])))
    assert pushed["mechanical"] == pytest.approx(0.0)  # the tip is the joint's own frame
    turned = energy_rates(plant, x, PlantInputs(u, np.array([0.0, 0.0, 0.0, 0.0, 3.0, 0.0])))
    assert turned["mechanical"] == pytest.approx(-6.0)


def test_a_drive_holds_an_arm_against_its_springs():
    """The command before the first tick is that of g + s, as a controller's gravity term is, and with both nothing moves."""
    arm = pendulum(motor=MOTOR, spring=LINE)
    loop = aw.Loop(
        controller=aw.JointPID(kp=0.0, gravity=True), reference=[0.4], period=1e-3, timing=aw.Timing("one-tick")
    )
    run = aw.simulate(aw.Scenario(arm, start=aw.Start(q=[0.4]), duration=0.02, loop=loop))
    assert np.abs(run.q.values - 0.4).max() < 1e-12
    assert np.abs(aw.spring_torques(arm, [0.4])).min() > 1.0
