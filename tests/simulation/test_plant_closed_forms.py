"""Cases whose solution is known: linear drives, heat, duty cycles, gaps, bristles, brakes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import armwright as aw
from armwright.actuators import holding_command
from armwright.simulation.plant.plant import Plant
from simulation.plants import BRAKE, ELASTIC, LUGRE, MOTOR, STOPS, SUPPLY, THERMAL, pendulum, steps

N, KT, R, J = 50.0, 0.06, 1.2, 2500 * 2e-4  # of MOTOR; J the rotor at the joint
LINK = 0.1 + 3.0 * 0.3**2  # inertia of the rod about its joint
VISCOUS = {"viscous_n_m_s_per_rad": 0.8}


def free(**joint):
    """A pendulum without gravity."""
    return Plant.of(pendulum(joint.pop("command", "voltage"), gravity=0.0, **joint))


def test_motor_with_inductance_and_load():
    """Linear in (q̇, i): the step response is a matrix exponential, found to 1e-9."""
    plant = free(motor={**MOTOR, "inductance_h": 1e-3}, friction=VISCOUS)
    a = np.array([[-0.8 / (J + LINK), N * KT / (J + LINK)], [-N * KT / 1e-3, -R / 1e-3]])
    b = np.array([0.0, 12.0 / 1e-3])
    end = -np.linalg.solve(a, b)
    expected = end + expm(a * 0.05) @ -end
    found = steps(plant, plant.initial([0.0], [0.0]), [12.0], 5e-6, 10_000)[-1]
    np.testing.assert_allclose(found[1:], expected, rtol=1e-9)


@pytest.mark.parametrize("h", [1e-4, 1e-2])
def test_blocked_motor(h):
    """i = V/R (1 - exp(-R t/L)) at any step, one far beyond L/R too."""
    plant = free(motor={**MOTOR, "inductance_h": 1e-3, "rotor_inertia_kg_m2": 1e12})
    found = steps(plant, plant.initial([0.0], [0.0]), [12.0], h, 5)[:, 2]
    np.testing.assert_allclose(found, 10.0 * (1.0 - np.exp(-R / 1e-3 * h * np.arange(6))), rtol=1e-12)


def test_current_controller_follows_at_its_bandwidth():
    """di/dt = 2π f (i* - i) while the voltage reaches, and at the voltage limit as L and R have it."""
    motor = {**MOTOR, "inductance_h": 1e-3, "current_loop_hz": 200.0, "rotor_inertia_kg_m2": 1e12}
    plant = free(command="current", motor=motor, limits={"voltage_v": 24.0})
    found = steps(plant, plant.initial([0.0], [0.0]), [5.0], 1e-3, 5)[:, 2]
    np.testing.assert_allclose(found, 5.0 * (1.0 - np.exp(-2 * np.pi * 200.0 * 1e-3 * np.arange(6))), rtol=1e-12)
    saturated = plant.derivative(np.array([0.0, 0.0, 0.0]), [30.0])[2]
    assert saturated == pytest.approx(24.0 / 1e-3)
    assert plant.outputs(np.array([0.0, 0.0, 0.0]), [30.0])["voltage"] == pytest.approx(24.0)


def test_two_masses():
    """Motor and link on a spring and damper: linear, found to 1e-9."""
    plant = free(command="torque", motor=MOTOR, elasticity=ELASTIC)
    k, d = 4e3, 6.0
    a = np.array(
        [[0, 0, 1, 0], [0, 0, 0, 1], [-k / LINK, k / LINK, -d / LINK, d / LINK], [k / J, -k / J, d / J, -d / J]]
    )
    augmented = np.zeros((5, 5))
    augmented[:4, :4], augmented[3, 4] = a, 7.0 / J
    expected = (expm(augmented * 0.1) @ [0.1, 0.1, 0.5, 0.5, 1.0])[:4]
    x = steps(plant, plant.initial([0.1], [0.5]), [7.0], 2e-5, 5000)[-1]
    np.testing.assert_allclose([x[0], x[2] / N, x[1], x[3] / N], expected, rtol=1e-9)


def test_temperatures_at_rest_and_on_their_way():
    """P = R i² of a held current:  T = ambient + P R_th (1 - exp(-t/τ)), and at last with R rising with T."""
    one = {key: value for key, value in THERMAL.items() if "housing" not in key and "coefficient" not in key}
    plant = free(command="current", motor={**MOTOR, "thermal": one, "rotor_inertia_kg_m2": 1e12})
    x = steps(plant, plant.initial([0.0], [0.0]), [4.0], 0.01, 1000)[-1]
    power, tau = R * 16.0, 8.0 * 1.5
    assert plant.part(x, "winding_temperature") == pytest.approx(
        25.0 + power * 1.5 * (1.0 - np.exp(-10.0 / tau)), rel=1e-9
    )
    plant = free(command="current", motor={**MOTOR, "thermal": THERMAL})
    rise = (1.5 + 3.0) * power  # T = 25 + rise (1 + α (T - 20))
    winding = (25.0 + rise * (1.0 - 0.0039 * 20.0)) / (1.0 - rise * 0.0039)
    heat = power * (1.0 + 0.0039 * (winding - 20.0))
    still = plant.derivative(np.array([0.0, 0.0, winding, 25.0 + 3.0 * heat]), [4.0])
    np.testing.assert_allclose(still[2:], 0.0, atol=1e-12)
    hot = plant.outputs(np.array([0.0, 0.0, winding, 25.0 + 3.0 * heat]), [4.0])
    assert hot["tau"][0] == pytest.approx(N * KT * 4.0 * (1.0 - 0.0011 * (5.0 + 3.0 * heat)))  # a hot motor is weaker
    assert hot["heat"][0] == pytest.approx(heat)


@pytest.mark.parametrize("volts", [6.0, 12.0, -18.0])
def test_a_coasting_bridge_runs_up_to_the_supply_at_any_duty(volts):
    """i = (V - D E)/R is 0 at E = V_s whatever D; a bridge that brakes stops at E = V."""
    for pwm, speed in (("coast", np.sign(volts) * 24.0 / (N * KT)), ("brake", volts / (N * KT))):
        plant = free(motor={**MOTOR, "pwm": pwm}, limits={"voltage_v": 24.0})
        out = plant.outputs(np.array([0.0, speed]), [volts])
        assert out["current"] == pytest.approx(0.0, abs=1e-12)
        assert out["electrical_power"] == pytest.approx(0.0, abs=1e-9)


def test_a_coasting_bridge_is_the_mean_of_on_and_off():
    """D of the time on with i = (V_s - E)/R, the rest off: means of current, heat and power."""
    plant = free(motor={**MOTOR, "pwm": "coast"}, limits={"voltage_v": 24.0, "current_a": 100.0})
    out = plant.outputs(np.array([0.0, 3.0]), [9.0])
    duty, on = 9.0 / 24.0, (24.0 - N * KT * 3.0) / R
    assert out["current"] == pytest.approx(duty * on)
    assert out["heat"] == pytest.approx(duty * R * on**2)
    assert out["electrical_power"] == pytest.approx(duty * 24.0 * on)


def test_a_coasting_bridge_switches_the_bus_also_where_its_own_limit_is_lower():
    """D = |V| / V_bus: a limit of 24 V on a bus at 40 V bounds V, and is not what the bridge puts on the motor while on."""
    limits = {"voltage_v": 24.0, "current_a": 100.0}
    plant = free(motor={**MOTOR, "pwm": "coast"}, limits=limits, robot={"supply": SUPPLY})
    x = plant.initial([0.0], [3.0])
    x[-1] = 40.0
    assert plant.part(x, "bus_voltage") == 40.0
    for u in (9.0, 30.0):
        out = plant.outputs(x, [u])
        duty, on = min(u, 24.0) / 40.0, (40.0 - N * KT * 3.0) / R
        assert out["current"] == pytest.approx(duty * on)
        assert out["heat"] == pytest.approx(duty * R * on**2)
        assert out["electrical_power"] == pytest.approx(duty * 40.0 * on)


@pytest.mark.parametrize("speed", [-6.0, 0.0, 5.0])
def test_a_coasting_bridge_keeps_its_current_limit(speed):
    plant = free(motor={**MOTOR, "pwm": "coast"}, limits={"voltage_v": 24.0, "current_a": 3.0})
    for u in (-24.0, -1.0, 2.0, 24.0):
        assert abs(plant.outputs(np.array([0.0, speed]), [u])["current"][0]) <= 3.0 * (1 + 1e-12)


@pytest.mark.parametrize("motor", [{}, {"inductance_h": 1e-3}, {"pwm": "coast"}])
def test_a_dead_zone_takes_its_width_from_every_command(motor):
    """V = u - sgn(u) width beyond the zone and 0 within, u clipped by the supply first; what is applied is the command."""
    plant = free(motor={**MOTOR, **motor, "dead_zone_v": 1.5}, limits={"voltage_v": 24.0})
    x = np.zeros(plant.size)
    for u, volts in ((0.0, 0.0), (1.4, 0.0), (-1.5, 0.0), (3.5, 2.0), (-10.0, -8.5), (30.0, 22.5)):
        assert plant.outputs(x, [u])["voltage"] == pytest.approx(volts)
        assert plant.applied(x, np.array([u])) == pytest.approx(np.clip(u, -24.0, 24.0))


def test_a_holding_command_leaves_the_dead_zone():
    model = pendulum(motor={**MOTOR, "dead_zone_v": 1.5})
    weight = aw.gravity_torques(model, [0.7])
    plant, hold = Plant.of(model), holding_command(model, weight)
    assert abs(hold[0]) == pytest.approx(abs(R * weight[0] / (N * KT)) + 1.5)
    assert plant.derivative(np.array([0.7, 0.0]), hold)[1] == pytest.approx(0.0, abs=1e-9)


def test_nothing_passes_a_gap():
    """From its middle the motor alone accelerates for √(gap J / tau); only then does the link move."""
    gap, torque = 0.01, 2.0
    plant = free(command="torque", motor=MOTOR, elasticity={**ELASTIC, "backlash_rad": gap})
    touch = np.sqrt(gap * J / torque)
    run = steps(plant, plant.initial([0.2], [0.0]), [torque], touch / 100.5, 130)
    assert (run[:101, 0] == 0.2).all()
    t = np.arange(101) * touch / 100.5
    np.testing.assert_allclose(run[:101, 2] / N - 0.2, 0.5 * torque / J * t**2, rtol=1e-9, atol=1e-15)
    assert run[-1, 0] > 0.2


def test_a_stop_holds_what_its_spring_holds():
    """At rest the joint stands tau/k beyond its limit, and is thrown back no faster than it came."""
    plant = free(command="torque", motor=MOTOR, friction=VISCOUS, stops=STOPS, limits={"position_rad": [-1.0, 0.4]})
    run = steps(plant, plant.initial([0.3], [1.0]), [10.0], 1e-3, 20_000)
    assert run[-1, 0] == pytest.approx(0.4 + 10.0 / 5e3, rel=1e-9)
    assert run[:, 1].min() > -1.5
    thrown = free(command="torque", motor=MOTOR, stops=STOPS, limits={"position_rad": [-1.0, 0.4]})
    back = steps(thrown, thrown.initial([0.3], [1.0]), [0.0], 1e-4, 3000)[-1]
    assert -1.0 < back[1] < -0.5


def test_bristles_break_away_at_the_static_level():
    """A torque that rises slowly moves nothing but the bristles until Stribeck's 3 N m."""
    plant = free(command="torque", motor=MOTOR, friction=LUGRE)
    torque = np.linspace(0.0, 3.5, 35_000)[:, None]
    run = steps(plant, plant.initial([0.0], [0.0]), torque, 1e-3, len(torque))
    breaks = torque[np.argmax(run[1:, 1] > 0.02), 0]
    assert breaks == pytest.approx(3.0, rel=0.03)
    assert run[np.searchsorted(torque[:, 0], 2.5), 0] < 5e-3


def test_presliding_loops_lose_energy():
    """Below break-away the joint gives way like a spring and comes back another way."""
    plant = free(command="torque", motor=MOTOR, friction=LUGRE)
    phase = np.linspace(0.0, 4 * np.pi, 20_001)
    torque = 2.0 * np.sin(phase)[:, None]
    run = steps(plant, plant.initial([0.0], [0.0]), torque[:-1], 1e-3, len(torque) - 1)
    second = slice(len(torque) // 2, None)
    lost = np.trapezoid(torque[second, 0], run[second, 0])  # ∮ tau dq
    assert lost > 0.05 * 2.0 * np.ptp(run[second, 0])
    assert np.ptp(run[second, 0]) < 0.02


@pytest.mark.parametrize(("speed", "sticks"), [(0.02, True), (1.0, False)])
def test_a_slow_pull_makes_stick_and_slip(speed, sticks):
    """A heavy motor pulls the link over a soft spring: it jerks at low speed, and slides at high speed."""
    soft = {"stiffness_n_m_per_rad": 20.0, "damping_n_m_s_per_rad": 0.2}
    plant = free(command="torque", motor={**MOTOR, "rotor_inertia_kg_m2": 1e6}, friction=LUGRE, elasticity=soft)
    x = plant.initial([0.0], [0.0])
    plant.part(x, "motor_qd")[:] = N * speed
    late = steps(plant, x, [0.0], 1e-3, 40_000)[20_000:, 1]
    assert (np.abs(late).min() < 0.01 * speed) == sticks
    assert (late.max() > 3.0 * speed) == sticks


def test_sliding_is_the_static_map():
    """Begun in steady sliding, the bristles neither bend nor straighten."""
    plant = free(command="torque", motor=MOTOR, friction=LUGRE)
    x = plant.initial([0.0], [-0.7])
    assert plant.derivative(x, [0.0])[2] == pytest.approx(0.0, abs=1e-15)
    level = 2.4 + 0.6 * np.exp(-((0.7 / 0.1) ** 2))
    assert plant.outputs(x, [0.0])["friction_loss"][0] == pytest.approx(0.7 * (level + 0.8 * 0.7))


def test_a_brake_holds_slips_and_lets_go():
    """12 N m put on at once are held without creeping, 40 N m slip, and when it is released its torque dies away."""
    arm = pendulum("torque", gravity=0.0, motor=MOTOR, brake=BRAKE)
    plant = Plant.of(arm, brakes=True)
    x = plant.initial([0.0], [0.0])
    held = steps(plant, x, [12.0], 1e-3, 20_000, brake=[1.0])
    assert 12.0 / 1e4 < held[-1, 0] < 60.0 / 1e4
    assert abs(held[-1, 0] - held[10_000, 0]) < 1e-12
    slipping = steps(plant, x, [40.0], 1e-3, 1000, brake=[1.0])[-1]
    assert slipping[1] == pytest.approx(10.0 / (J + LINK), rel=0.05)
    released = steps(plant, held[-1], [0.0], 1e-3, 200, brake=[0.0])
    assert released[-1, 2] == pytest.approx(0.0, abs=1e-6)


def test_the_bus_sags_by_its_source_resistance():
    """Drawing P = V (V_0 - V)/R_s; fed, it rises to where the chopper burns what comes."""
    plant = Plant.of(pendulum("torque", gravity=0.0, motor=MOTOR, robot={"supply": SUPPLY}))
    x = plant.initial([0.0], [2.0])
    drawn = plant.outputs(x, [10.0])["electrical_power"][0]
    volts = 24.0 + np.sqrt(24.0**2 - 0.4 * drawn)
    x[2] = volts
    assert plant.derivative(x, [10.0])[2] == pytest.approx(0.0, abs=1e-9)
    x[2] = 53.0  # the chopper half on, the rectifier shut
    fed = plant.outputs(x, [-10.0])["electrical_power"][0]
    assert plant.derivative(x, [-10.0])[2] == pytest.approx((-fed / 53.0 - 0.5 * 53.0 / 5.0) / 5e-3)
