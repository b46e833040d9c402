"""The arms that the laws are tested on: every built-in one, and some that have all that the built-in ones lack."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np

from armwright.actuators.friction import by_loads, friction_torques, motor_friction
from armwright.description import RobotDescription, builtin_names, read_description
from armwright.description.database import parse
from armwright.dynamics import bias_torques
from armwright.model import Model, build_model
from armwright.program import interpret, trace

# The built-in arms that between them have every form of joint, drive and friction: studies that take long run on these alone.
FORMS = ("cmu-dd", "lwa4p", "panda", "puma560", "two-link")
OWN = ("workshop", "gripper", "sprung", "rough", "screws")
NAMES = [*builtin_names(), *OWN]
FREE = [name for name in NAMES if name != "gripper"]  # whose joints all move by themselves


@functools.cache
def description(name: str) -> RobotDescription:
    """The description of a built-in arm, or of one of `OWN`."""
    made = {"workshop": workshop, "gripper": gripper, "sprung": sprung, "rough": rough, "screws": screws}
    return parse(made[name](), name) if name in made else read_description(name)


@functools.cache
def arm(name: str) -> Model:
    """The model of an arm of `NAMES`, with friction, rotors and gear loss."""
    return build_model(description(name))


def has_friction_by_loads(model: Model) -> bool:
    """True for the arms of servos whose friction depends on the torques of motor and load."""
    return any(by_loads(body) for body in model.coordinates)


def friction_at(model: Model, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, wrench: Any = None) -> np.ndarray:
    """(n,) friction of a state, that by loads at its motors' torques, of motors that turn one joint each."""
    external = -bias_torques(model.replace(friction=None), q, qd, wrench)
    rows = zip(model.coordinates, qd, tau, external, strict=True)
    by_load = [motor_friction(body, w, (t, e)) - motor_friction(body, w) for body, w, t, e in rows]
    return friction_torques(model, qd) + by_load


def random_state(model: Model, seed: int, rows: int = 3) -> np.ndarray:
    """(rows, n) numbers of order 1: q, qd, qdd or torques."""
    return np.random.default_rng(seed).normal(size=(rows, model.n))


def all_positions(model: Model, q: np.ndarray) -> np.ndarray:
    """(N,) of all joints, those that follow others included: G q + o."""
    return q if model.mimics is None else projection(model) @ q + np.array(model.mimics.offset, dtype=float)


def projection(model: Model) -> np.ndarray:
    """G (N, n): how all joints' speeds follow from those of the coordinates."""
    if model.mimics is None:
        return np.eye(model.n)
    pairs = zip(model.mimics.coordinate, model.mimics.factor, strict=True)
    return np.array([factor * np.eye(model.n)[k] for k, factor in pairs])


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


def rough() -> dict[str, Any]:
    """`workshop` without smoothing speeds: friction and gear loss jump where joints turn back."""
    return {**without_smoothing(workshop()), "name": "rough"}


def without_smoothing(robot: dict[str, Any]) -> dict[str, Any]:
    """A robot's record, its smoothing speeds removed."""
    for joint in robot["joints"]:
        for key in ("smoothing_rad_per_s", "smoothing_m_per_s"):
            joint.get("friction", {}).pop(key, None)
    return robot


def gripper() -> dict[str, Any]:
    """`workshop` with a hand of three fingers that one slide moves, in a chain of mimics, and a joint that levels another.

    Slides follow slides, turns follow slides and turns, forward and backward, with offsets, friction and rotors of their own.
    """
    robot = workshop()
    smooth = {"coulomb_positive_n_m": 0.2, "coulomb_negative_n_m": 0.3, "smoothing_rad_per_s": 0.1}
    carried = {"gear_ratio": -30.0, "rotor_inertia_kg_m2": 1e-5}

    def finger(name: str, parent: str, kind: str, at: list[float], **more: Any) -> dict[str, Any]:
        frame = {"xyz_m": at, "rpy_rad": [0.3, 10.0 * at[0], -0.2]}
        place = {"name": name, "parent": parent, "child": f"{name}_link", "type": kind}
        return {**place, "frame": frame, "axis": [0.2, 1.0, -0.4], **more}

    sliding = {"friction": {"viscous_n_s_per_m": 9.0, "coulomb_positive_n": 2.0, "coulomb_negative_n": 1.0}}
    sliding["friction"]["smoothing_m_per_s"] = 0.01
    drive = {"gear_ratio": 400.0, "gear_efficiency": 0.8, "rotor_inertia_kg_m2": 1e-6}
    drive |= {"torque_constant_n_m_per_a": 0.02, "resistance_ohm": 3.0}
    fingers = [
        finger("thumb_tip", "thumb_link", "revolute", [0.03, 0.0, 0.04],
               mimic={"joint": "thumb", "multiplier": 0.7, "offset_rad": -0.4}, friction=smooth),
        finger("left", "hand", "prismatic", [0.05, 0.0, 0.1], motor=drive, **sliding),
        finger("right", "hand", "prismatic", [-0.05, 0.01, 0.1],
               mimic={"joint": "left", "multiplier": -1.0, "offset_m": 0.01}, **sliding),
        finger("thumb", "hand", "revolute", [0.0, 0.04, 0.08],
               mimic={"joint": "left", "multiplier": 6.0, "offset_rad": 0.3}, friction=smooth, motor=carried),
    ]  # fmt: skip
    levelling = robot["joints"][4]
    levelling["mimic"] = {"joint": "joint4", "multiplier": -1.5, "offset_rad": 0.2}
    levelling["motor"] = carried
    tensor = {"xx": 1e-3, "xy": 1e-4, "xz": 0.0, "yy": 1.2e-3, "yz": -1e-4, "zz": 8e-4}
    links = [
        {"name": f"{finger['name']}_link", "mass_kg": 0.4, "com_m": [0.01, 0.0, 0.05], "inertia_kg_m2": tensor}
        for finger in fingers
    ]
    return {**robot, "name": "gripper", "joints": [*robot["joints"], *fingers], "links": [*robot["links"], *links]}


def sprung() -> dict[str, Any]:
    """`workshop` with springs by line and by table, at turns and at the slide, and cylinders to the base and across branches."""
    robot = workshop()
    springs = {
        "joint1": {"stiffness_n_m_per_rad": 9.0, "rest_rad": 0.4, "preload_n_m": -3.0},
        "joint2": {"positions_m": [-0.8, -0.1, 0.3, 0.9], "forces_n": [30.0, 12.0, -8.0, -9.0], "outside": "linear"},
        "joint4": {"positions_rad": [-1.0, 0.0, 0.6], "torques_n_m": [5.0, -1.0, 2.0], "outside": "constant"},
        "joint5": {"stiffness_n_m_per_rad": 4.0, "rest_rad": -0.2},
    }
    for joint in robot["joints"]:
        if joint["name"] in springs:
            joint["spring"] = springs[joint["name"]]
    ends = [  # where anchors meet in few poses, those of `balancer` and `long` in none
        ("balancer", "base", [0.3, -0.2, 0.9], "link1", [0.1, 0.5, 0.0], -80.0, 0.9, 240.0),
        ("across", "link3", [0.0, 0.1, 0.4], "link5", [0.2, 0.0, -0.5], 25.0, 0.5, 60.0),
        ("long", "hand", [0.0, 0.0, 0.3], "base", [-1.0, 0.5, 1.5], 12.0, 2.0, 0.0),
    ]
    keys = ("name", "link_a", "anchor_a_m", "link_b", "anchor_b_m", "force_n", "length_m", "stiffness_n_per_m")
    return {**robot, "name": "sprung", "cylinders": [dict(zip(keys, row, strict=True)) for row in ends]}


def screws() -> dict[str, Any]:
    """`sprung` with screws of either hand in place of two of its turns, one before the tip."""
    robot = sprung()
    for number, pitch in ((3, 0.08), (5, -0.03)):
        robot["joints"][number - 1] |= {"type": "helical", "pitch_m_per_rad": pitch}
    return {**robot, "name": "screws"}
