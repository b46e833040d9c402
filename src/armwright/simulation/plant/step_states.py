"""States about which a plant is linearised to find the largest step: where it is stiff, before a simulation gets there."""

from __future__ import annotations

import numpy as np

from armwright.friction_laws import LAWS
from armwright.model import Body, Model, TableSpring
from armwright.simulation.plant.plant import Plant

POSES = 16  # drawn over the joints' ranges, always the same ones
TOUCH = 0.6  # of the play: just beyond the half where flanks touch
DEEP = 1e-6  # [rad | m] into a stop
WARMING = 100.0  # [K] of motors whose friction rises with their temperature
STILL = 1e-3  # of a smoothing speed: just beside standstill, where friction may have another slope on either side


def linearisation_states(plant: Plant) -> np.ndarray:
    """(m, size) states to linearise at: poses over the joints' ranges, at speeds where friction is steep."""
    model, n = plant.model, plant.model.n
    low, high = np.array([body.sampled_range for body in model.coordinates]).T
    poses = low + (high - low) * np.random.default_rng(0).uniform(size=(POSES, n))
    poses[0] = np.clip(0.0, low, high)
    for joint, body in enumerate(model.coordinates):
        if isinstance(body.spring, TableSpring):
            poses[-1, joint] = _steepest_position(body.spring)
    speeds = np.array([_steep_speeds(body) for body in model.coordinates]).T
    if plant.size == 2 * n and not any(plant.contacts):
        return np.concatenate([np.hstack([poses, np.broadcast_to(speed, poses.shape)]) for speed in speeds])
    states = np.array([x for q in _with_stops(model, poses) for speed in speeds for x in _in_contact(plant, q, speed)])
    if model.supply is not None:  # just below the source's voltage, where its rectifier opens
        plant.part(states, "bus_voltage")[:] *= 1.0 - STILL
    return np.concatenate([states, _warm(plant, states)])


def _warm(plant: Plant, states: np.ndarray) -> np.ndarray:
    """The states with warm motors, where friction rises with their temperature."""
    rising = [
        getattr(body.friction, f"{of}_temperature_coefficient", None) or 0.0
        for body in plant.model.coordinates
        for of in ("viscous", "coulomb")
    ]
    if max(rising, default=0.0) <= 0.0:
        return states[:0]
    warm = states.copy()
    for name in ("winding_temperature", "housing_temperature"):
        if name in plant.layout:
            plant.part(warm, name)[:] += WARMING
    return warm


def _in_contact(plant: Plant, q: np.ndarray, speed: np.ndarray) -> list[np.ndarray]:
    """The plant's state there; where gears have play, with flanks in touch on either side as well."""
    x = plant.initial(q, speed)
    gaps = [0.0 if body.elasticity is None else body.elasticity.backlash or 0.0 for body in plant.model.coordinates]
    if not any(gaps):
        return [x]
    moved = np.zeros_like(x)
    plant.part(moved, "motor_q")[:] = [
        TOUCH * gaps[i] * body.drive.gear_ratio
        for i, body in enumerate(plant.model.coordinates)
        if body.elasticity is not None
    ]
    return [x, x + moved, x - moved]


def _with_stops(model: Model, poses: np.ndarray) -> list[np.ndarray]:
    """The poses, and where joints have stops one in each end of them all."""
    stopped = np.array([body.stops is not None for body in model.coordinates])
    if not stopped.any():
        return list(poses)
    ends = np.array([body.limits.position for body in model.coordinates]).T
    return [*poses, *(np.where(stopped, end + sign * DEEP, poses[0]) for end, sign in zip(ends, (-1, 1), strict=True))]


def _steepest_position(spring: TableSpring) -> float:
    """Middle [rad | m] of the piece of a table where it is steepest, which no drawn pose may meet."""
    at, torques = np.array(spring.positions, dtype=float), np.array(spring.torques, dtype=float)
    steepest = int(np.abs(np.diff(torques) / np.diff(at)).argmax())
    return float(0.5 * (at[steepest] + at[steepest + 1]))


def _steep_speeds(body: Body) -> list[float]:
    """Speeds [rad/s | m/s] at which a joint's friction and gear loss are steepest, always as many."""
    smoothing = [
        part.smoothing for part in (body.friction, body.drive) if part is not None and part.smoothing is not None
    ]
    if body.friction is not None and body.friction.sticks and body.friction.stribeck is not None:
        smoothing.append(body.friction.stribeck_speed)  # over which friction falls, and joints speed up
    s = float(min(smoothing)) if smoothing else 1e-3
    middle, width = (0.0, 1.0) if body.friction is None else LAWS[body.friction.law].steep(body.friction)
    about_rest = [sign * share * s for share in (STILL, 0.5, 2.0) for sign in (1.0, -1.0)]
    return [0.0, *about_rest, middle, middle + width, middle - width]
