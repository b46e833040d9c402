"""Payload of an arm at rest: torques at many poses at once, and the largest mass that the worst of them allows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from armwright import scalar
from armwright.actuators.springs import spring_torque
from armwright.dynamics import gravity_torques
from armwright.kinematics import forward_kinematics, jacobian
from armwright.model import Model
from armwright.model.parametric_model import Structure, parameter_shapes, parameters_of, parametric_model, structure
from armwright.program import Program, interpret, trace
from armwright.scalar import Array
from armwright.spatial import cross

SAMPLES = 256  # poses spread over the joints' ranges
BEST, AROUND, ROUNDS = 8, 16, 6  # the worst few, as many poses about each, with a spread that halves each round
SPREAD = 0.5  # [rad | m] of the first round
NO_LEVER = 1e-9  # [N m/kg | N/kg]: a joint that a payload loads by less is not loaded


@dataclass(frozen=True, eq=False)
class Holding:
    """The largest point mass at the tip that the torque limits hold at rest in every pose that was tried."""

    payload: float  # [kg]; infinite without torque limits, 0 where the arm cannot hold its own weight
    holds_itself: bool
    joint: str  # the one that reaches its limit first, "" where there is none
    q: np.ndarray  # (n,) [rad | m] the worst pose


def static_torques(model: Model, q: np.ndarray, com: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Torques that hold the arm at rest, joints' springs included, and what a payload adds a kilogram:  g + s,  -Jᵀ [g; R c × g].

    Args:
        model: the arm, with a tip.   q: (…, n) [rad | m].   com: (3,) [m] the payload's centre of mass in the tip's frame.
    Returns:
        gravity, load: (…, n) [N m | N] and [N m/kg | N/kg].
    Raises:
        ModelError: the arm branches and names no tip.
    """
    both = interpret(_torques(structure(model)), q, np.zeros(3) if com is None else com, *parameters_of(model))
    hold = both[..., 0, :]
    for i, body in model.outward():
        if body.spring is not None:
            hold[..., i] -= spring_torque(body.spring, q[..., i])
    return hold, both[..., 1, :]


@lru_cache(maxsize=64)
def _torques(form: Structure) -> Program:
    def torques(q: Array, com: Array, *values: Array) -> np.ndarray:
        arm = parametric_model(form, values)
        slope, pull = jacobian(arm, q), arm.gravity
        moment = cross(forward_kinematics(arm, q)[:3, :3] @ com, pull)
        return scalar.stack([gravity_torques(arm, q), -(slope[:3].T @ pull + slope[3:].T @ moment)])

    return trace("static_torques", torques, {"q": (len(form) - 1,), "com": (3,), **parameter_shapes(form)})


def holding(model: Model, seed: int = 0) -> Holding:
    """The payload at the worst pose:  min over poses and joints of  (L - sign(u) g) / |u|,  u the torque a kilogram adds.

    Poses are a scrambled Sobol set over the joints' ranges, then poses about the worst of them, closer each round. So the
    result is an upper bound: the payload at the worst pose of all can be a little smaller. Friction is left out.

    Args:
        model: the arm, with a tip.   seed: of the poses.
    Raises:
        ModelError: the arm branches and names no tip.
    """
    limits = np.array([body.limits.torque for body in model.bodies])
    low, high = ranges(model)
    random = np.random.default_rng(seed)
    poses = low + (high - low) * _sobol(SAMPLES, model.n, seed)
    payload, joint, unloaded = _payloads(model, poses, limits)
    holds, spread = bool(unloaded.all()), SPREAD
    for _ in range(ROUNDS):
        worst = np.argsort(payload)[:BEST]
        near = poses[worst, None, :] + spread * random.uniform(-1.0, 1.0, (BEST, AROUND, model.n))
        near = np.clip(near.reshape(-1, model.n), low, high)
        near_payload, near_joint, unloaded = _payloads(model, near, limits)
        pairs = (poses, near), (payload, near_payload), (joint, near_joint)
        poses, payload, joint = (np.concatenate([old[worst], new]) for old, new in pairs)
        holds, spread = holds and bool(unloaded.all()), spread / 2
    k = int(np.argmin(payload))
    limited = bool(np.isfinite(payload[k]))
    name = model.names[int(joint[k])] if limited else ""
    return Holding(max(float(payload[k]), 0.0) if holds else 0.0, holds, name, poses[k])


def ranges(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest joint positions (n,) to sample: the limits; a whole turn, or a metre, where there is none."""
    bounds = []
    for body in model.bodies:
        low, high = body.limits.position
        reach = body.kind.units.half_range
        bounds.append((low if np.isfinite(low) else -reach, high if np.isfinite(high) else reach))
    low, high = np.array(bounds).T
    return low, high


def _payloads(model: Model, poses: np.ndarray, limits: np.ndarray) -> tuple[Any, Any, Any]:
    """For each pose the payload [kg] that the weakest joint holds, that joint, and if the arm holds its own weight."""
    gravity, load = static_torques(model, poses)
    with np.errstate(divide="ignore", invalid="ignore"):
        each = (limits - np.sign(load) * gravity) / np.abs(load)
    each = np.where(np.abs(load) > NO_LEVER, each, np.inf)
    joint = np.argmin(each, axis=1)
    return each[np.arange(len(poses)), joint], joint, (np.abs(gravity) <= limits).all(axis=1)


def _sobol(count: int, size: int, seed: int) -> np.ndarray:
    from scipy.stats import qmc

    return qmc.Sobol(size, rng=np.random.default_rng(seed)).random(count)
