"""Robots written for other tools: URDF with its drive file, MJCF with springs and actuators, ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.description.database import parse, read_toml
from armwright.description.robot import RobotDescription
from armwright.description.urdf import read_urdf
from armwright.errors import ModelError
from armwright.export.actuator_fit import STEP, ActuatorFit, _fitted
from armwright.export.drive_file import drive_file
from armwright.export.mjcf import MujocoActuators, mjcf_text, write_mjcf
from armwright.export.servo_actuators import FITTED, ServoActuator, servo_actuators, spreads
from armwright.export.urdf import write_urdf
from description.urdf_files import INERTIAL, one_joint, written as urdf_file
from features.cases import ARMS, LOADED, arms
from frozen.numbers import Case
from frozen.texts import rounded, texts
from physics.arms import OWN, description
from reference.random_trees import random_description
from simulation.plants import (
    BRAKE,
    COGGING,
    COULOMB,
    CYLINDER,
    ELASTIC,
    LINE,
    LUGRE,
    MOTOR,
    SUPPLY,
    TABLE as SPRING_TABLE,
    THERMAL,
)
from simulation.test_servo import PLAIN, VOLTS, pendulum

EXAMPLES = Path(__file__).parents[3] / "examples"
BUILTIN = ("two-link", "puma560", "lwa4p", "panda", "so101", "koch", "xarm7", "widowx250")
TENSOR = {"xx": 0.02, "xy": 1e-3, "xz": -2e-3, "yy": 0.03, "yz": 5e-4, "zz": 0.04}
DRIVEN = {"motor": MOTOR, "friction": COULOMB}


def robot(name: str) -> RobotDescription:
    """A built-in arm, one of the tests' own, or one of the examples."""
    path = EXAMPLES / f"{name}.toml"
    if path.exists():
        return read_toml(path)
    return description(name) if name in OWN else aw.load(name).record


def written(record: Callable[[], RobotDescription], folder: Path, **options: Any) -> dict[str, Any]:
    """URDF, drive file and MJCF of an arm, and what each cannot hold."""
    arm, losses = record(), {}
    for name, write in (("arm.urdf", partial(write_urdf, **options)), ("arm.xml", write_mjcf)):
        try:
            losses[name] = [rounded(each) for each in write(arm, folder / name)]
        except ModelError as error:  # no such joint
            losses[name] = [rounded(str(error))]
    return {"losses": losses, **texts(folder)}


def linked(*joints: dict[str, Any], links: tuple[dict[str, Any], ...] = (), **keys: Any) -> RobotDescription:
    """A chain of joints with all that a record may say of them."""
    rows = []
    bodies = [{"mass_kg": 1.5, "com_m": [0.1, 0.02, -0.03], "inertia_kg_m2": TENSOR, **each} for each in links]
    bodies += [{"mass_kg": 0.7, "com_m": [0.0, 0.1, 0.0], "inertia_kg_m2": TENSOR}] * (len(joints) - len(links))
    for k, joint in enumerate(joints):
        place = {"name": f"j{k}", "type": "revolute", "parent": f"l{k - 1}" if k else "base", "child": f"l{k}"}
        moves = joint.get("type") != "fixed"
        if not {"dh", "modified_dh"} & {*joint}:
            place |= {"frame": {"xyz_m": [0.1, 0.0, 0.3], "rpy_rad": [0.1, -0.2, 0.4]}} | (
                {"axis": [0.0, 3.0, 4.0]} if moves else {}
            )
        rows.append({**place, **({"command": "torque"} if moves and "mimic" not in joint else {}), **joint})
    named = [{"name": f"l{k}", **body} for k, body in enumerate(bodies)]
    return parse({"name": "linked", "source": "definition", "joints": rows, "links": named, **keys}, "linked")


def pictured() -> RobotDescription:
    """Links behind Denavit-Hartenberg rows with a picture of every shape."""
    shapes = (
        {"shape": "box", "size_m": [0.1, 0.2, 0.3]},
        {"shape": "sphere", "radius_m": 0.05},
        {"shape": "cylinder", "radius_m": 0.04, "length_m": 0.3},
        {"shape": "ellipsoid", "semi_axes_m": [0.1, 0.2, 0.05]},
        {"shape": "box", "size_m": [0.01, 0.02, 0.03]},
    )
    visuals = [
        {"solid": each, "xyz_m": [0.1 * k, -0.2, 0.05], "rpy_rad": [0.3, 0.1 * k, -0.5], "hole": k == 4}
        | ({"colour": [0.2, 0.4, 0.1 * k]} if k % 2 else {})
        for k, each in enumerate(shapes)
    ]
    row = {"a_m": 0.4, "alpha_rad": -0.7}
    turning, sliding = row | {"r_m": 0.3, "offset_rad": 0.2}, row | {"theta_rad": 0.2, "offset_m": 0.3}
    return linked({"dh": turning}, {"modified_dh": sliding, "type": "prismatic"}, links=({"visuals": visuals},) * 2)


def sourced() -> RobotDescription:
    """Numbers with standard deviations, sources and dates, also those of cylinders and of a supply."""
    number = {"value": 0.6, "std": 0.1, "source": "estimate", "date": "2026-01-02"}
    friction = {"viscous_n_m_s_per_rad": number, "coulomb_positive_n_m": 0.5, "coulomb_negative_n_m": 0.7}
    limits = {
        "position_rad": {"value": [-1.0, 2.0], "std": [0.1, 0.2]},
        "torque_n_m": 9.0,
        "acceleration_rad_per_s2": 7.0,
    }
    joint = {"motor": {**MOTOR, "thermal": THERMAL, "cogging": COGGING}, "friction": friction, "limits": limits}
    more = {
        "brake": BRAKE,
        "elasticity": {**ELASTIC, "backlash_rad": 0.01, "error_rad": 1e-3, "error_phase_rad": 0.2},
        "spring": LINE,
    }
    return linked(
        joint, joint | more | {"source": "estimate"}, supply=SUPPLY, command="voltage", title="sourced",
        gravity_m_s2=[0.0, 0.5, -9.7],
    )  # fmt: skip


def sprung(**changes: Any) -> RobotDescription:
    """Springs of all kinds, and a cylinder between frames that are moved."""
    ends = {"link_a": "base", "link_b": "l1", "anchor_a_m": [0.1, 0.0, 0.2], "anchor_b_m": [0.0, 0.2, 0.1]}
    cylinder = {**CYLINDER, **ends, "force_n": 20.0, "length_m": 0.3, "stiffness_n_per_m": 40.0, **changes}
    row = {"r_m": 0.3, "offset_rad": 0.0, "a_m": 0.4, "alpha_rad": 1.2}
    preload = {"stiffness_n_m_per_rad": 0.0, "rest_rad": 0.0, "preload_n_m": 2.0}
    return linked(
        {"spring": LINE, **DRIVEN}, {"spring": SPRING_TABLE, "dh": row}, {"spring": preload},
        frames=[{"name": "hook", "link": "l1", "xyz_m": [0.0, 0.1, 0.0], "rpy_rad": [0.3, 0.0, 0.2]}],
        cylinders=[cylinder],
    )  # fmt: skip


def light() -> RobotDescription:
    """Links without mass, with the inertia of a line, and with one that nobody has; what is fixed behind one has mass."""
    nothing = dict.fromkeys(TENSOR, 0.0)
    return linked(
        {},
        {"type": "fixed"},
        {},
        {},
        {},
        links=(
            {"mass_kg": 0.0, "inertia_kg_m2": nothing},
            {},
            {"inertia_kg_m2": nothing | {"xx": 0.1, "yy": 0.1}},
            {"inertia_kg_m2": nothing | {"xx": 0.1, "yy": 0.1, "zz": 0.9}, "accept_impossible": "a test"},
            {"mass_kg": 0.0, "inertia_kg_m2": nothing},
        ),
    )


def limited() -> RobotDescription:
    """Each limit alone, none and all, of hinges and of a slide that has no end."""
    hinges = {
        "position_rad": [-1.0, 2.0],
        "velocity_rad_per_s": 3.0,
        "torque_n_m": 7.0,
        "acceleration_rad_per_s2": 11.0,
    }
    some = [{key: value} for key, value in hinges.items()]
    slide = {"type": "prismatic", "limits": {"force_n": 30.0}}
    return linked(*({"limits": each, "motor": MOTOR} for each in [*some, {}, hinges]), slide)


def turned() -> RobotDescription:
    """Motors against their joints' sense, friction on the motor's side, and axes of other lengths."""
    on_motor = {
        "side": "motor",
        "viscous_n_m_s_per_rad": 2e-4,
        "coulomb_positive_n_m": 0.03,
        "coulomb_negative_n_m": 0.01,
    }
    motor = {**MOTOR, "gear_ratio": -40.0}
    slide = {"type": "prismatic", "axis": [1e-3, 0.0, 2e-3], "friction": {"viscous_n_s_per_m": 4.0, "offset_n": 1.0}}
    return linked(
        {"motor": motor, "friction": on_motor, "limits": {"torque_n_m": 5.0}}, {"friction": LUGRE},
        {**slide, "frame": {"xyz_m": [0.0, 0.0, 0.1], "rpy_rad": [0.0, 0.0, 0.0]}},
        {"motor": {**MOTOR, "coupling": [{"joint": "j0", "ratio": 3.0}]}, "friction": on_motor},
        {"mimic": {"joint": "j0", "multiplier": -0.5, "offset_rad": 0.2}, "limits": {"torque_n_m": 2.0}},
    )  # fmt: skip


SPECIAL = {
    "pictures": pictured, "sources": sourced, "springs": sprung, "masses": light, "limits": limited, "senses": turned,
    "a cylinder that pushes": partial(sprung, force_n=-30.0, stiffness_n_per_m=80.0),
    "a cylinder that pulls at length 0": partial(sprung, force_n=-30.0, length_m=0.1),
    "a cylinder at rest at length 0": partial(sprung, force_n=-4.0, length_m=0.1),
    "a cylinder without stiffness": partial(sprung, stiffness_n_per_m=0.0),
}  # fmt: skip


def meshes(folder: Path) -> dict[str, Any]:
    """Pictures of meshes, beside the file and elsewhere, and what an MJCF says of them."""
    (folder / "in").mkdir()
    for name in ("in/a.stl", "b.stl"):
        (folder / name).write_text("")
    shapes = '<mesh filename="a.stl"/>', '<mesh filename="../b.stl" scale="1 2 3"/>'
    visuals = "".join(f"<visual><geometry>{shape}</geometry></visual>" for shape in shapes)
    record = read_urdf(urdf_file(folder / "in", one_joint(moved=INERTIAL + visuals), "in.urdf"))
    found = written(lambda: record, folder / "in")
    return {name: text.replace(folder.as_uri(), "") if isinstance(text, str) else text for name, text in found.items()}


# Actuators of servos.

CURRENT = PLAIN | {"output": "current", "output_limit": 1.5, "d": 2.0, "d_scale_s_per_rad": 0.01}
INTEGRAL = PLAIN | {
    "i": 3.0,
    "i_scale_per_rad_s": 0.2,
    "goal_speed_rad_per_s": 2.5,
    "period_s": 4e-3,
    "latency_periods": 2,
}
BY_LOAD = {name: value for name, value in LOADED.items() if name != "smoothing_rad_per_s"}
SERVOS = {
    "so101": lambda: aw.load("so101").record,
    "open-manipulator-x": lambda: aw.load("open-manipulator-x").record,
    "currents": lambda: pendulum(CURRENT, limits={"voltage_v": VOLTS, "current_a": 1.2}).record,
    "all gains": lambda: pendulum(INTEGRAL, ("hip", "knee"), limits={"voltage_v": VOLTS, "torque_n_m": 1.1}).record,
    "friction by load": lambda: pendulum(PLAIN, friction=BY_LOAD).record,
    "play": lambda: pendulum(PLAIN, elasticity={**ELASTIC, "backlash_rad": 0.02}).record,
}


def actuators(name: str, kind: str) -> dict[str, Any]:
    """MJCF with a servo's actuators, and what it cannot hold."""
    record = SERVOS[name]()
    text, losses = mjcf_text(record, MujocoActuators(kind, servo_actuators(record), STEP))
    return {"text": rounded(text), "losses": losses}


def played(kind: str = "position", scale: float = 1e-3) -> ActuatorFit:
    """A fit whose motions are given."""
    record = SERVOS["all gains"]()
    start, t = servo_actuators(record), np.arange(0.0, 0.2, 0.02)
    goal = 0.3 * np.sin(t[:, None] * [7.0, 5.0])
    simulated = 0.9 * goal + 0.01
    factors = np.linspace(0.8, 1.3, 5)
    found = {each: one.scaled(factors) for each, one in start.items()}
    away = scale * np.cos(t[:, None] * [9.0, 11.0])
    return ActuatorFit(
        record,
        kind,
        "motion.csv",
        found,
        spreads(record),
        t,
        goal,
        simulated,
        simulated + 3.0 * away,
        simulated + away,
        "3.4.0",
    )


def fit_values(fit: ActuatorFit, folder: Path) -> dict[str, Any]:
    """All that a fit says, and the files that it writes."""
    paths, losses = fit.write(folder / "fit.xml")
    said = {"files": [path.name for path in paths], "losses": losses, "poor": fit.poor, "height": fit.height}
    return {"fit": fit, "document": fit.document(), **said, **texts(folder)}


class Linear:
    """Plays goals with each joint's numbers as weights of its shapes, in place of MuJoCo."""

    def __init__(self, names: list[str]):
        self.names = names

    def play(self, each: dict[str, ServoActuator]) -> np.ndarray:
        """(k, n) positions."""
        t = np.linspace(0.0, 1.0, 40)
        shapes = np.array([np.sin((3.0 + k) * t) for k in range(len(FITTED))])
        rows = [[np.log1p(getattr(each[name], key)) for key in FITTED] for name in self.names]
        return (np.array(rows) @ shapes).T


def factors() -> np.ndarray:
    """Factors that take a linear player to what another one played."""
    start = {name: ServoActuator(*np.linspace(0.5 + k, 2.0, 13).tolist()) for k, name in enumerate(("hip", "knee"))}
    player = Linear(list(start))
    wanted = player.play({name: one.scaled([1.2, 0.7, 1.1, 0.9, 1.3]) for name, one in start.items()})
    return _fitted(player, start, wanted, player.play(start), lambda done, of: None)


# ROS 2.


def ros2(source: Callable[[], Any], folder: Path, **options: Any) -> dict[str, Any]:
    """Files of an arm for ROS 2, and what they cannot hold."""
    made = aw.export.export_ros2(source(), folder, **options)
    return {"names": [path.name for path in made.paths], "lost": list(made.lost), **texts(folder)}


def far() -> RobotDescription:
    """Names that YAML reads as values, ranges without 0, and numbers that it takes for texts."""
    limits = [
        {"position_rad": [0.5, 2.0], "velocity_rad_per_s": 1e-5, "torque_n_m": 7.0},
        {"position_rad": [-2.0, -0.5]},
        {"position_rad": [0.0, 1.0], "acceleration_rad_per_s2": 1e20},
        {},
    ]
    names = ("off", "joint 2", "Yes", "plain")
    return linked(*({"name": name, "limits": each} for name, each in zip(names, limits, strict=True)))


CASES = {
    **{
        f"{name} as URDF and MJCF": partial(written, partial(robot, name))
        for name in (*BUILTIN, *OWN, "scara", "hot-lift")
    },
    **{f"an arm with {name}": partial(written, lambda name=name: arms(name)[0].record) for name in ARMS},
    **{f"{name} of an arm": partial(written, record) for name, record in SPECIAL.items()},
    **{f"random tree {seed}": partial(written, partial(random_description, seed, screws=False)) for seed in range(6)},
    "meshes": meshes,
    "URDF without its drive file": partial(written, sourced, drive=False),
    **{
        f"drive file of {name}": lambda _, name=name: {"text": rounded(drive_file(robot(name)))}
        for name in ("panda", "so101")
    },
    **{f"actuators of {name}": lambda _, name=name: servo_actuators(SERVOS[name]()) for name in SERVOS},
    **{f"deviations of {name}": lambda _, name=name: spreads(SERVOS[name]()) for name in ("so101", "all gains")},
    **{
        f"{kind} of {name}": lambda _, name=name, kind=kind: actuators(name, kind)
        for name in SERVOS
        for kind in ("position", "dcmotor")
    },
    "a good fit of actuators": lambda folder: fit_values(played(), folder),
    "a poor fit of actuators": lambda folder: fit_values(played(scale=0.1), folder),
    "a poor fit of motors": lambda folder: fit_values(played("dcmotor", scale=0.1), folder),
    "factors of actuators": Case(lambda _: factors(), close=1e-3),
    "ROS 2 of puma560": partial(ros2, lambda: aw.load("puma560")),
    "ROS 2 of so101 by speed": partial(
        ros2, lambda: aw.load("so101").record, command="velocity", rate=250, hardware="a/Driver"
    ),
    "ROS 2 of xarm7 by effort": partial(ros2, lambda: aw.load("xarm7"), command="effort"),
    "ROS 2 of words": partial(ros2, far),
}
