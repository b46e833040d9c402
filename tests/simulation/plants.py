"""Arms with drives for the tests of the plant, and runs of them in a graph interpreter: no code of our compilers."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from armwright.description.database import parse
from armwright.model import Model, build_model
from armwright.program import trace
from armwright.simulation.integrate.integrators import INTEGRATORS, Integrator
from armwright.simulation.integrate.stepping import speed_pairs
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant

RK3 = INTEGRATORS["rk3"]
MOTOR = {
    "gear_ratio": 50.0,
    "rotor_inertia_kg_m2": 2e-4,
    "torque_constant_n_m_per_a": 0.06,
    "resistance_ohm": 1.2,
}
COULOMB = {
    "viscous_n_m_s_per_rad": 0.8,
    "coulomb_positive_n_m": 2.0,
    "coulomb_negative_n_m": 2.4,
    "smoothing_rad_per_s": 0.05,
}
LUGRE = {
    "law": "lugre",
    **COULOMB,
    "stribeck_torque_n_m": 3.0,
    "stribeck_speed_rad_per_s": 0.1,
    "bristle_stiffness_n_m_per_rad": 2e3,
    "bristle_damping_n_m_s_per_rad": 5.0,
}
THERMAL = {
    "ambient_c": 25.0,
    "reference_c": 20.0,
    "winding_capacity_j_per_k": 8.0,
    "winding_resistance_k_per_w": 1.5,
    "housing_capacity_j_per_k": 200.0,
    "housing_resistance_k_per_w": 3.0,
    "resistance_temperature_coefficient_per_k": 0.0039,
    "magnet_temperature_coefficient_per_k": -0.0011,
}
ELASTIC = {"stiffness_n_m_per_rad": 4e3, "damping_n_m_s_per_rad": 6.0}
HARMONIC = {**ELASTIC, "cubic_n_m_per_rad3": 1e6, "error_rad": 2e-4, "error_phase_rad": 0.2}
COGGING = {"amplitude_n_m": 0.01, "periods": 7, "phase_rad": 0.3}
ON_MOTOR = {  # LuGre of the motor, in its own radians
    "law": "lugre",
    "side": "motor",
    "viscous_n_m_s_per_rad": 3.2e-4,
    "smoothing_rad_per_s": 1.0,
    "coulomb_positive_n_m": 0.04,
    "coulomb_negative_n_m": 0.04,
    "stribeck_torque_n_m": 0.06,
    "stribeck_speed_rad_per_s": 5.0,
    "bristle_stiffness_n_m_per_rad": 0.8,
    "bristle_damping_n_m_s_per_rad": 2e-3,
}
LINE = {"stiffness_n_m_per_rad": 12.0, "rest_rad": -0.4, "preload_n_m": 3.0}
TABLE = {"positions_rad": [-1.0, 0.2, 0.33, 2.0], "torques_n_m": [9.0, 4.0, -2.0, -3.0], "outside": "linear"}
CYLINDER = {
    "name": "balancer",
    "link_a": "base",
    "anchor_a_m": [0.1, 0.05, 0.3],
    "link_b": "rod1",
    "anchor_b_m": [0.2, 0.0, 0.1],
    "force_n": 120.0,
    "length_m": 0.8,
    "stiffness_n_per_m": 400.0,
}
STOPS = {"stiffness_n_m_per_rad": 5e3, "damping_n_m_s_per_rad": 20.0}
BRAKE = {
    "holding_torque_n_m": 30.0,
    "stiffness_n_m_per_rad": 1e4,
    "damping_n_m_s_per_rad": 20.0,
    "release_time_s": 0.02,
}
SUPPLY = {
    "voltage_v": 48.0,
    "source_resistance_ohm": 0.4,
    "capacitance_f": 5e-3,
    "chopper_voltage_v": 52.0,
    "chopper_band_v": 2.0,
    "chopper_resistance_ohm": 5.0,
}


def pendulum(
    command: str = "voltage", gravity: float = 9.81, robot: dict[str, Any] | None = None, **joint: Any
) -> Model:
    """A rod that swings about y; keys of its joint, and of the robot."""
    return chain([{"command": command, **joint}], gravity, robot)


def chain(joints: list[dict[str, Any]], gravity: float = 9.81, robot: dict[str, Any] | None = None) -> Model:
    """Rods one behind the other that all turn about y."""
    links, hinges = [], []
    for k, own in enumerate(joints):
        frame = {"xyz_m": [0.6 if k else 0.0, 0, 0], "rpy_rad": [0, 0, 0]}
        hinge = {"name": f"joint{k}", "type": "revolute", "parent": f"rod{k - 1}" if k else "base", "child": f"rod{k}"}
        hinges.append({**hinge, "frame": frame, "axis": [0, 1, 0], **own})
        tensor = {"xx": 0.01, "xy": 0, "xz": 0, "yy": 0.1, "yz": 0, "zz": 0.1}
        links.append({"name": f"rod{k}", "mass_kg": 3.0, "com_m": [0.3, 0, 0], "inertia_kg_m2": tensor})
    record = {
        "name": "chain",
        "source": "definition",
        "gravity_m_s2": [0, 0, -gravity],
        "joints": hinges,
        "links": links,
    }
    return build_model(parse({**record, **(robot or {})}, "chain"))


def steps(plant: Plant, x0: Any, u: Any, h: float, count: int, brake: Any = None, rule: Integrator = RK3) -> np.ndarray:
    """The states (count + 1, size) of so many steps; u (n,), or (count, n) that changes."""
    rule = rule.paired(speed_pairs(plant.layout))
    sizes = {"x": (plant.size,), "u": (plant.model.n,)} | ({} if brake is None else {"brake": (len(brake),)})
    program = trace(
        "step", lambda x, u, *b: plant.step(rule, x, PlantInputs(u, brake=b[0] if b else None), h), sizes, ("x_next",)
    )
    given = [np.asarray(value, dtype=float) for value in ([u] if brake is None else [u, brake])]
    held = [value.T if value.ndim == 2 else np.tile(value.reshape(-1, 1), count) for value in given]
    states = program.graph.mapaccum("run", count)(np.asarray(x0, dtype=float), *held)
    return np.vstack([np.asarray(x0, dtype=float), np.asarray(states).T])


def exact(plant: Plant, x0: Any, u: Any, duration: float) -> np.ndarray:
    """State after a duration, by SciPy's DOP853 at two tolerances, whose results must agree to 1e-10.

    A bristle bends by a millimetre. An absolute tolerance of 1e-12 leaves 1e-9 of it open, as much as the errors that
    the tests judge, and the order in which a processor adds then decides the verdict. Hence tolerances relative to the
    state alone, and the second run: if both agree, neither depends on its tolerance.
    """
    graph = trace("xd", lambda x, u: plant.derivative(x, u), {"x": (plant.size,), "u": (plant.model.n,)}).graph

    def solved(rtol: float, atol: float) -> np.ndarray:
        moving = lambda t, x: np.asarray(graph(x, u)).ravel()  # noqa: E731
        return solve_ivp(moving, (0.0, duration), x0, "DOP853", rtol=rtol, atol=atol).y[:, -1]

    state, coarser = solved(3e-14, 1e-17), solved(1e-12, 1e-16)
    assert np.max(np.abs(state - coarser) / magnitudes(state)) < 1e-10
    return state


def magnitudes(x: np.ndarray) -> np.ndarray:
    """Magnitude of each state, by which its error is divided; at least 1e-3, the bending of a bristle [rad]."""
    return np.maximum(np.abs(x), 1e-3)


MANY = {  # an arm for each effect, and one that has them all
    "plain": pendulum(motor=MOTOR, friction=COULOMB),
    "inductance": pendulum(motor={**MOTOR, "inductance_h": 1e-3}, friction=COULOMB),
    "current loop": pendulum(
        "torque", motor={**MOTOR, "inductance_h": 1e-3, "current_loop_hz": 300.0}, friction=COULOMB
    ),
    "thermal": pendulum(motor={**MOTOR, "thermal": THERMAL}, friction={**COULOMB, "viscous_fall_k": 30.0}),
    "cogging": pendulum(motor={**MOTOR, "cogging": COGGING}, friction=COULOMB),
    "dead zone": pendulum(motor={**MOTOR, "dead_zone_v": 1.5}, friction=COULOMB),
    "coast": pendulum(motor={**MOTOR, "pwm": "coast"}, friction=COULOMB, limits={"voltage_v": 24.0}),
    "lugre": pendulum(motor=MOTOR, friction=LUGRE),
    "load": pendulum(motor={**MOTOR, "gear_efficiency": 0.8}, friction={**COULOMB, "load_coefficient": 0.05}),
    "elastic": pendulum(motor=MOTOR, friction=COULOMB, elasticity=ELASTIC),
    "harmonic": pendulum(motor=MOTOR, friction=ON_MOTOR, elasticity=HARMONIC),
    "supply": pendulum(motor=MOTOR, friction=COULOMB, robot={"supply": SUPPLY}),
    "springs": chain(
        [
            {"command": "voltage", "motor": MOTOR, "friction": COULOMB, "spring": TABLE},
            {"command": "voltage", "motor": MOTOR, "friction": COULOMB, "elasticity": ELASTIC, "spring": LINE},
        ],
        robot={"cylinders": [CYLINDER]},
    ),
    "all": chain(
        [
            {
                "command": "voltage",
                "friction": LUGRE,
                "elasticity": ELASTIC,
                "motor": {**MOTOR, "inductance_h": 1e-3, "thermal": THERMAL, "cogging": COGGING},
            },
            {
                "command": "voltage",
                "friction": ON_MOTOR,
                "motor": {**MOTOR, "coupling": [{"joint": "joint0", "ratio": 10.0}]},
            },
        ],
        robot={"supply": SUPPLY},
    ),
}
