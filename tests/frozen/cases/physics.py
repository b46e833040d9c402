"""Dynamics of one arm for each feature, its drives, variants of models, and what the tables of parameters say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.actuators import holding_command
from armwright.actuators.drive import DriveOutput, demanded_drive, in_command_units, limited_drive
from armwright.actuators.friction import friction_torques, link_friction
from armwright.actuators.motor import drive_torque
from armwright.dynamics import holding_torques
from armwright.dynamics.gears import gear_losses
from armwright.dynamics.one_frame import link_mass_matrix, link_slopes, mass_matrix_pays, slopes_pay
from armwright.kinematics.aim import Aim, turning_rows, yaw_row
from armwright.kinematics.reach import reach
from armwright.model import Model, build_model
from armwright.model.cylinder_lengths import implausible_lengths
from armwright.model.parametric_model import parameters_of, structure
from armwright.model.simplify import simplified
from armwright.model.vary import Varied
from features.cases import ARMS, arms, base, together
from reference.random_trees import random_description

WRENCH = np.array([3.0, -2.0, 5.0, 0.4, -0.3, 0.2])
STATES = 3  # of each arm; one is at rest
OF_STATES = {  # (arm, q, qd, qdd, tau) → numbers
    "inverse": lambda arm, q, qd, qdd, tau: aw.inverse_dynamics(arm, q, qd, qdd),
    "inverse with a wrench": lambda arm, q, qd, qdd, tau: aw.inverse_dynamics(arm, q, qd, qdd, WRENCH),
    "bias": lambda arm, q, qd, qdd, tau: aw.bias_torques(arm, q, qd, WRENCH),
    "gravity": lambda arm, q, qd, qdd, tau: aw.gravity_torques(arm, q),
    "holding": lambda arm, q, qd, qdd, tau: holding_torques(arm, q),
    "springs": lambda arm, q, qd, qdd, tau: aw.spring_torques(arm, q),
    "mass": lambda arm, q, qd, qdd, tau: aw.mass_matrix(arm, q),
    "in one frame": lambda arm, q, qd, qdd, tau: in_one_frame(arm, q, qd, qdd),
    "Coriolis": lambda arm, q, qd, qdd, tau: aw.coriolis_matrix(arm, q, qd),
    "energies": lambda arm, q, qd, qdd, tau: [*aw.energy(arm, q, qd), aw.kinetic_energy(arm, q, qd)],
    "centre of mass": lambda arm, q, qd, qdd, tau: aw.centre_of_mass(arm, q),
    "regressor": lambda arm, q, qd, qdd, tau: aw.regressor(arm, q, qd, qdd),
    "regressor of drives": lambda arm, q, qd, qdd, tau: aw.regressor_drive(arm, qd, qdd),
    "operational inertia": lambda arm, q, qd, qdd, tau: aw.operational_inertia(arm, q)[:2, :2],
    "forward": lambda arm, q, qd, qdd, tau: aw.forward_dynamics(arm, q, qd, tau, WRENCH),
    "composite bodies": lambda arm, q, qd, qdd, tau: aw.composite_body(arm, q, qd, tau),
    "articulated bodies": lambda arm, q, qd, qdd, tau: aw.articulated_body(arm, q, qd, tau),
    "forward arm": lambda arm, q, qd, qdd, tau: aw.forward_arm(arm, q, qd, tau),
    "friction": lambda arm, q, qd, qdd, tau: np.concatenate([friction_torques(arm, qd), link_friction(arm, qd)]),
    "currents": lambda arm, q, qd, qdd, tau: aw.motor_current(arm, tau),
    "voltages": lambda arm, q, qd, qdd, tau: aw.motor_voltage(arm, qd, tau),
    "torques of voltages": lambda arm, q, qd, qdd, tau: aw.motor_torque(arm, qd, tau),
    "torques of commands": lambda arm, q, qd, qdd, tau: drive_torque(arm, qd, tau),
    "limited": lambda arm, q, qd, qdd, tau: of_drive(limited_drive(arm, qd, 10.0 * tau)),
    "demanded": lambda arm, q, qd, qdd, tau: of_drive(demanded_drive(arm, qd, 10.0 * tau)),
    "commands": lambda arm, q, qd, qdd, tau: in_command_units(arm, demanded_drive(arm, qd, tau)),
    "holding commands": lambda arm, q, qd, qdd, tau: holding_command(arm, tau, q),
    "pose": lambda arm, q, qd, qdd, tau: aw.forward_kinematics(arm, q),
    "Jacobian": lambda arm, q, qd, qdd, tau: aw.jacobian(arm, q),
    "its derivative": lambda arm, q, qd, qdd, tau: aw.jacobian_dot_qd(arm, q, qd),
}


def of_drive(output: DriveOutput) -> np.ndarray:
    """All that a drive gives."""
    return np.concatenate([np.ravel(each) for each in vars(output).values() if each is not None]).astype(float)


def in_one_frame(arm: Model, *state: np.ndarray) -> np.ndarray:
    """Mass matrix and slopes as long arms compute them; joints that follow others are not theirs."""
    if len(arm.bodies) != arm.n:
        return np.zeros(0)
    return np.concatenate([np.ravel(each) for each in (link_mass_matrix(arm, state[0]), *link_slopes(arm, *state))])


def states(n: int) -> Iterator[tuple[np.ndarray, ...]]:
    """Positions, speeds, accelerations and torques that no joint shares."""
    for k in range(STATES):
        wave = np.sin(1.0 + 1.7 * np.arange(n) + 2.3 * k)
        yield 0.6 * wave, k * np.cos(wave + k), 3.0 * np.sin(5.0 * wave), 8.0 * np.cos(3.0 * wave)


def answered(function: Callable[..., Any], *values: Any) -> Any:
    """What it answers; where it refuses, what it says of that."""
    try:
        return function(*values)
    except aw.ArmwrightError as error:
        return f"{error.place}; {error.expected}"[:100]


def dynamics_of(arm: Model) -> dict[str, Any]:
    """All functions of states."""
    found = {}
    for name, function in OF_STATES.items():
        each = [answered(function, arm, *state) for state in states(arm.n)]
        found[name] = each[0] if isinstance(each[0], str) else np.array(each, float)
    losses = [loss.lines for loss in gear_losses(arm, np.full(arm.n, 0.3)) if loss is not None]
    return {**found, "gears": np.array([number for lines in losses for line in lines for number in line], float)}


def numbers_of(arm: Model) -> dict[str, Any]:
    """Its parameters and those of its simplified form, where a kernel takes them as inputs."""
    plain = simplified(arm)
    return {
        "inertia": arm.inertial_parameters,
        "drives": answered(lambda: arm.drive_parameters),
        "simplified": [each for values in parameters_of(plain) for each in np.ravel(values)],
        "form": repr(structure(plain)),
        "pays": [mass_matrix_pays(plain), slopes_pay(plain)],
        "table": "\n".join(f"{row.name} {row.value:.9g} {row.unit} {row.bounds}" for row in arm.parameters),
        "lengths": "\n".join(map(str, implausible_lengths(arm))),
        "reach": reach(arm),
    }


def varied(names: tuple[str, ...], values: list[list[float]]) -> dict[str, Any]:
    """Names of varied parameters, the dynamics with some values, and what is refused."""
    table = Varied(arms("cylinders")[0], names)
    found = [table.model(np.array(row)) for row in values]
    refused = [answered(table.check, np.array([[*row[:-1], -row[-1]]])) for row in values]
    return {"names": ", ".join(table.names), "refused": refused, "of": [dynamics_of(arm)["inverse"] for arm in found]}


def aims() -> dict[str, Any]:
    """Rows of the turns that count, for each word."""
    turn = aw.forward_kinematics("puma560", [0.1, -0.5, 0.3, 0.2, 0.7, -0.4])[:3, :3]
    words = [
        "axis",
        "axis x",
        "pitch",
        "pitch y",
        "base xy",
        "tool z",
        "base z",
        "tool yz",
        "position",
        "pose",
        "yaw",
        "roll x",
    ]
    found: dict[str, Any] = {"yaw": yaw_row(turn[:, 0])}
    for word in words:
        aim = answered(Aim.of, word)
        found[word] = aim if isinstance(aim, str) else [str(aim), aim.counted, turning_rows(aim, turn)]
    return found


VARIANTS = {
    "with a payload in a frame": lambda: aw.load("puma560").with_payload(
        2.0, [0.0, 0.1, 0.05], np.diag([0.02, 0.03, 0.04])
    ),
    "with locked joints": lambda: aw.load("panda").with_locked({"joint3": 0.4, "joint7": -0.2}),
    "a part of the chain": lambda: aw.load("puma560").subchain("link2", "link5"),
    "with values": lambda: base().with_values({"rod1.mass_kg": 3.0, "joint0.motor.gear_ratio": 60.0}),
    "with another gravity": lambda: base().replace(gravity=[1.0, 2.0, -3.0]),
    "locked with what follows it": lambda: arms("mimic joints")[0].with_locked({"joint1": 0.3}),
    "locked beside a cylinder": lambda: arms("cylinders")[0].with_locked({"joint0": 0.3}),
    "a part with a cylinder": lambda: arms("cylinders")[0].subchain("rod0", "rod1"),
    "with brakes": lambda: together(["brakes", "springs", "gear efficiency"]),
    "a tree": lambda: build_model(random_description(4, screws=True)),
    "another tree": lambda: build_model(random_description(9)),
}
DRIVES = ("gear efficiency", "efficiency table", "heat", "supply", "current loop", "inductance")
BUILT = ("cmu-dd", "puma560", "panda", "lwa4p", "so101", "two-link")


def _features() -> dict[str, Any]:
    return {
        f"{feature}, {command}": partial(_feature, feature, command)
        for feature in (*ARMS, "payload", "locked joints")
        for command in ("voltage", "torque", "current")
        if command == "voltage" or feature in DRIVES
    }


def _feature(feature: str, command: str, folder: Path) -> dict[str, Any]:
    arm = arms(feature, command)[0]
    return {**dynamics_of(arm), **numbers_of(arm)}


def _of(make: Callable[[], Model], folder: Path) -> dict[str, Any]:
    arm = make()
    return {**dynamics_of(arm), **numbers_of(arm), "remarks": list(getattr(arm.record, "notes", ()) or ())}


CASES = {
    **_features(),
    **{name: partial(_of, make) for name, make in VARIANTS.items()},
    **{name: partial(_of, partial(aw.load, name)) for name in BUILT},
    "aims": lambda folder: aims(),
    "varied cylinders": lambda folder: varied(
        ("balancer.stiffness_n_per_m", "rod1.mass_kg"), [[30.0, 1.5], [50.0, 2.5]]
    ),
}
