"""The arms that the laws are tested on: every built-in one, and one that has all that the built-in ones lack."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np

from armwright.description import RobotDescription, builtin_names, read_description
from armwright.description.database import parse
from armwright.model import Model, build_model
from armwright.program import interpret, trace

NAMES = [*builtin_names(), "workshop"]


@functools.cache
def description(name: str) -> RobotDescription:
    """The description of a built-in arm or of `workshop`."""
    return parse(workshop(), "workshop") if name == "workshop" else read_description(name)


@functools.cache
def arm(name: str) -> Model:
    """The model of a built-in arm or of `workshop`, with friction, rotors and gear loss."""
    return build_model(description(name))


def random_state(model: Model, seed: int, rows: int = 3) -> np.ndarray:
    """(rows, n) numbers of order 1: q, qd, qdd or torques."""
    return np.random.default_rng(seed).normal(size=(rows, model.n))


def gradient(name: str, function: Callable[..., Any], *arguments: np.ndarray) -> list[np.ndarray]:
    """The derivatives of a traced function by each of its arguments, (*shape of the result, entries of the argument)."""
    program = trace(name, function, {f"x{k}": a.shape for k, a in enumerate(arguments)})
    symbols = [casadi.SX.sym(f"x{k}", a.size) for k, a in enumerate(arguments)]
    (result,) = program.graph.call(symbols)
    derivative = casadi.Function("derivative", symbols, [casadi.jacobian(result, symbol) for symbol in symbols])
    shape = program.outputs[0].shape
    return [
        np.array(d).reshape(*shape, a.size) for d, a in zip(derivative.call(list(arguments)), arguments, strict=True)
    ]


def traced(name: str, function: Callable[..., Any], *arguments: np.ndarray) -> np.ndarray:
    """The function's result through trace and interpreter."""
    return interpret(trace(name, function, {f"x{k}": a.shape for k, a in enumerate(arguments)}), *arguments)


def workshop() -> dict[str, Any]:
    """A lossy arm of two branches: a slide, a motor against its joint's sense, every friction law and side, a fixed tool."""
    viscous = {"viscous_n_m_s_per_rad": 0.8}
    coulomb = {"coulomb_positive_n_m": 0.7, "coulomb_negative_n_m": 1.1, "smoothing_rad_per_s": 0.05}
    stribeck = {"stribeck_torque_n_m": 1.6, "stribeck_speed_rad_per_s": 0.4}
    sigmoid = {"sigmoid_amplitude_n_m": 0.9, "sigmoid_slope_s_per_rad": 6.0, "sigmoid_shift_rad_per_s": 0.03}
    on_motor = {
        "side": "motor",
        "viscous_n_m_s_per_rad": 2e-4,
        "coulomb_positive_n_m": 0.01,
        "coulomb_negative_n_m": 0.02,
    }
    sliding = {"viscous_n_s_per_m": 12.0, "coulomb_positive_n": 4.0, "coulomb_negative_n": 3.0, "offset_n": 0.5}

    def motor(ratio: float, efficiency: float | None = None) -> dict[str, Any]:
        loss = {} if efficiency is None else {"gear_efficiency": efficiency}
        constants = {"torque_constant_n_m_per_a": 0.05, "resistance_ohm": 1.5, "rotor_inertia_kg_m2": 2e-5}
        return {"gear_ratio": ratio, **constants, **loss}

    def joint(
        number: int, parent: str, kind: str, friction: dict[str, Any] | None, drive: dict[str, Any]
    ) -> dict[str, Any]:
        place = {"name": f"joint{number}", "parent": parent, "child": f"link{number}", "type": kind}
        frame = {"xyz_m": [0.1, -0.05, 0.25], "rpy_rad": [0.4 * number, -0.3, 0.7]}
        own = {} if friction is None else {"friction": friction}
        return {**place, "frame": frame, "axis": [0.3, -1.0, 0.5 * number], "motor": drive, **own}

    def link(name: str, mass: float) -> dict[str, Any]:
        tensor = {"xx": 0.02 * mass, "xy": 0.001, "xz": -0.002, "yy": 0.03 * mass, "yz": 0.001, "zz": 0.025 * mass}
        return {"name": name, "mass_kg": mass, "com_m": [0.05, 0.02, 0.1], "inertia_kg_m2": tensor}

    fixed = {"name": "mount", "type": "fixed", "parent": "link3", "child": "hand"}
    return {
        "name": "workshop",
        "source": "definition",
        "command": "voltage",
        "gravity_m_s2": [1.0, -2.0, -9.0],
        "tip": "tool",
        "joints": [
            joint(1, "base", "revolute", {**coulomb, **viscous, **stribeck}, motor(80.0, 0.7)),
            joint(2, "link1", "prismatic", {**sliding, "smoothing_m_per_s": 0.02}, motor(-300.0, 0.6)),
            joint(3, "link2", "revolute", {"law": "sigmoid", **sigmoid, **viscous}, motor(-50.0)),
            joint(4, "link1", "revolute", {**on_motor, "smoothing_rad_per_s": 2.0}, motor(-40.0, 0.85)),
            joint(5, "link4", "revolute", None, motor(20.0)),
            {**fixed, "frame": {"xyz_m": [0.0, 0.0, 0.2], "rpy_rad": [0.1, 0.2, 0.3]}},
        ],
        "links": [*(link(f"link{k}", 6.0 - k) for k in range(1, 6)), link("hand", 0.8)],
        "frames": [{"name": "tool", "link": "hand", "xyz_m": [0.02, 0.03, 0.15], "rpy_rad": [0.5, -0.4, 0.2]}],
    }
