"""Drives that draw more than their supply can give: the bus falls to 0 V and stays there, and every joule is found again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.actuators.supply import bus
from armwright.errors import DivergenceError
from armwright.model import Supply
from armwright.simulation.plant.plant import Plant
from simulation.energies import Balance
from simulation.plants import MOTOR, pendulum

WEAK = {"voltage_v": 48.0, "source_resistance_ohm": 4.0, "capacitance_f": 2e-3}  # 12 A at most
WOUND = {**MOTOR, "inductance_h": 2e-3}
VISCOUS = 0.8  # [N m s/rad]
INERTIA = 3.0 * 0.3**2 + 0.1 + 50.0**2 * 2e-4  # [kg m²] of rod and rotor about the joint
REVERSED, U, DURATION = (
    -8.0,
    48.0,
    0.3,
)  # [rad/s], [V], [s]: full voltage forwards while the motor still turns backwards


def reversing(motor=WOUND, command="voltage", supply=WEAK, limits=None):
    return pendulum(
        command, 0.0, {"supply": supply}, motor=motor, friction={"viscous_n_m_s_per_rad": VISCOUS}, limits=limits or {}
    )


def reference() -> tuple[np.ndarray, list[float]]:
    """(q, q̇, i, V) at the end, and times at which the bus empties and fills: two circuits, one with the diodes conducting."""
    constant, r, l, rs, c = 50.0 * 0.06, 1.2, 2e-3, 4.0, 2e-3

    def circuit(empty):
        def slope(_, x):
            _, qd, i, volts = x
            charging = 0.0 if empty else ((48.0 - volts) / rs - i) / c
            return [qd, (constant * i - VISCOUS * qd) / INERTIA, (volts - r * i - constant * qd) / l, charging]

        return slope

    empties, fills = (lambda t, x: x[3]), (lambda t, x: x[2] - 48.0 / rs)
    empties.terminal = fills.terminal = True  # type: ignore[attr-defined]
    empties.direction = fills.direction = -1  # type: ignore[attr-defined]
    x, t, empty, times = np.array([0.0, REVERSED, 0.0, 48.0]), 0.0, False, []
    while t < DURATION:
        event = fills if empty else empties
        part = solve_ivp(circuit(empty), (t, DURATION), x, "DOP853", events=event, rtol=1e-12, atol=1e-12)
        x, t = part.y[:, -1], part.t[-1]
        if part.status == 1:
            empty, x[3] = not empty, 0.0
            times.append(t)
    return x, times


def run_of(arm, solver):
    return aw.simulate(
        aw.Scenario(arm, duration=DURATION, command=[U], start=aw.Start([0.0], [REVERSED]), solver=solver)
    )


SOLVERS = {
    "rk3": (aw.Solver("rk3", step=1e-4), 2e-5),
    "rk4": (aw.Solver("rk4", step=1e-4), 2e-5),
    "semi_implicit_euler": (aw.Solver("semi_implicit_euler", step=1e-4), 2e-2),
    "rk45": (aw.Solver("rk45", rtol=1e-9, atol=1e-9), 1e-7),
    "rodas3": (aw.Solver("rodas3"), 1e-5),
    "cvodes": (aw.Solver("cvodes"), 1e-7),
}


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", SOLVERS)
def test_motion_and_bus_are_those_of_two_circuits(name):
    """Diodes that take over at 0 V and let go where the source gives more than the motor draws, located by SciPy."""
    end, times = reference()
    assert len(times) == 2
    assert times[1] - times[0] > 0.02
    solver, error = SOLVERS[name]
    run = run_of(reversing(), solver)
    went = np.array([run[signal].values[-1].item() for signal in ("q", "qd", "current", "bus_voltage")])
    np.testing.assert_allclose(went, end, rtol=error)
    bus_voltage = run.bus_voltage.values
    assert bus_voltage.min() == 0.0
    resting = run.time.values[bus_voltage == 0.0]
    np.testing.assert_allclose([resting[0], resting[-1]], times, atol=1.5e-3 if run.time.values[1] > 5e-4 else 2e-4)


MOTORS = {
    "inductance": reversing(),
    "none": reversing(MOTOR),
    "current loop": reversing({**WOUND, "current_loop_hz": 300.0}, "current", limits={"current_a": 60.0}),
    "coast": reversing({**MOTOR, "pwm": "coast"}),
}


@pytest.mark.parametrize("name", MOTORS)
def test_energy_balances_on_an_empty_bus(name):
    """What is lacking is that of a step that passes 0 V, and goes with its square."""
    balance, u = Balance(MOTORS[name]), [60.0]
    begun = balance.plant.initial([0.0], [REVERSED])
    volts, x = [], begun
    for _ in range(30):
        x, _ = balance.moved(x, np.array([u]), 1e-4, 50)
        volts.append(float(x[-1]))
    assert min(volts) == 0.0
    assert volts[-1] > 1.0  # it fills again
    lacks = [balance.lack([0.0], [REVERSED], u, h, 0.15) for h in (1e-3, 1e-4, 1e-5)]
    assert lacks[0] < 5e-3
    assert lacks[1] < 2e-4
    assert lacks[2] < 2e-6


def test_diodes_keep_the_bus_at_0():
    supply = Supply(48.0, 4.0, 2e-3)
    switched = 48e-9  # [V], the voltage of an empty bus in quotients
    assert bus(supply, 0.0, 30.0 * switched).speed == 0.0  # 30 A drawn, 12 A given
    assert bus(supply, 0.0, 5.0 * switched).speed == pytest.approx((12.0 - 5.0) / 2e-3)
    assert bus(supply, -3.0, 30.0 * switched).speed == 0.0
    empty = bus(supply, 0.0, 30.0 * switched)
    assert (empty.source, empty.loss) == (48.0 * 12.0, 48.0 * 12.0)  # all in the source's own resistance


def test_a_drive_without_constants_diverges_where_the_bus_is_empty():
    """It takes its power at any voltage: 500 W of a source that gives 144 W at most have no solution."""
    arm = reversing({"gear_ratio": 50.0, "rotor_inertia_kg_m2": 2e-4}, "torque")
    scenario = aw.Scenario(arm, duration=0.1, command=[50.0], start=aw.Start([0.0], [10.0]))
    with pytest.raises(DivergenceError):
        aw.simulate(scenario)
    braking = aw.simulate(aw.Scenario(arm, duration=0.1, command=[-20.0], start=aw.Start([0.0], [10.0])))
    assert braking.bus_voltage.values[-1] > 48.0


def test_a_plant_below_0_volts_is_one_at_0():
    """As between the stages of a rule."""
    plant = Plant.of(reversing())
    x = plant.initial([0.0], [REVERSED])
    place = plant.layout.place("bus_voltage").start
    x[place] = 0.0
    below = x.copy()
    below[place] = -2.0
    np.testing.assert_array_equal(plant.derivative(below, [U]), plant.derivative(x, [U]))
