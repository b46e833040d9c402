"""Errors of a calibration and their derivatives: what was measured in each pose less what the corrected arm predicts.

point:       B⁻¹ T(q, δ) p − measured          pose: log(R Rᵀ_measured) and the point's error
distance:    |T p − a| − measured              fixed point:  T p − s
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.identification.geometry.chain import ChainMotion, Factor, moved
from armwright.identification.geometry.measurements import Measured

POSITION, ROTATION, DISTANCE = "position", "rotation", "distance"
TINY = 1e-12  # [m] of a distance, below which its direction is not known


@dataclass(frozen=True, eq=False)
class Target:
    """A measured quantity with the chain that predicts it.

    Attributes:
        measured: the quantity.   factors: from the measuring frame, or the base, to the frame that carries it; the same list
            for all quantities of that frame.   tool: from there to the point or frame.
        ends: (k, 3) parameters of the points that do not move, by number of the point; () without one.
        fixed: (k, 3) [m] where these points are for parameters of 0.
    """

    measured: Measured
    factors: Sequence[Factor]
    tool: Sequence[Factor]
    ends: np.ndarray
    fixed: np.ndarray

    def rows(
        self, q: np.ndarray, values: np.ndarray, ends: np.ndarray, carrier: ChainMotion
    ) -> list[tuple[str, np.ndarray, np.ndarray]]:
        """Predictions and derivatives by group: "position" (poses, 3), "rotation" (poses, 3, 3), "distance" (poses, 1).

        Args:
            q: (poses, joints).   values: (p,).   ends: (poses,) number of the point that does not move.
            carrier: motion of the frame that carries it.
        """
        end = moved(self.tool, q, values, carrier)
        at, jacobian = end.placement[:, :3, 3], end.shifting
        if self.measured.kind == "pose":
            return [(POSITION, at, jacobian), (ROTATION, end.placement[:, :3, :3], end.turning)]
        if self.measured.kind == "point":
            return [(POSITION, at, jacobian)]
        between, jacobian = at - self._fixed_at(values, ends), jacobian.copy()
        if self.ends.size:
            for axis in range(3):
                jacobian[np.arange(len(q)), axis, self.ends[ends, axis]] -= 1.0
        if self.measured.kind == "fixed point":
            return [(POSITION, between, jacobian)]
        distance = np.maximum(np.linalg.norm(between, axis=1, keepdims=True), TINY)
        along = np.einsum("na,nap->np", between / distance, jacobian)[:, None, :]
        return [(DISTANCE, distance, along)]

    def _fixed_at(self, values: np.ndarray, ends: np.ndarray) -> np.ndarray:
        fixed = self.fixed + values[self.ends] if self.ends.size else self.fixed
        return fixed[ends]

    def ends_of(self, rows: np.ndarray) -> np.ndarray:
        """(rows,) number of the fixed point of some of its poses, from 0."""
        if self.measured.kind != "fixed point":
            return np.zeros(len(rows), dtype=int)
        labels = np.unique(self.measured.values[self.measured.seen, 0])
        return np.searchsorted(labels, self.measured.values[rows, 0])


@dataclass(frozen=True, eq=False)
class Rows:
    """Errors of all quantities in all poses.

    Attributes:
        errors: (rows,).   jacobian: (rows, p).   pose: (rows,) number.   group: (rows,) "position" and others.
    """

    errors: np.ndarray
    jacobian: np.ndarray
    pose: np.ndarray
    group: np.ndarray


def errors_at(targets: Sequence[Target], q: np.ndarray, values: np.ndarray) -> Rows:
    """Predicted less measured, of all that was measured.

    Args:
        targets: the quantities.   q: (poses, joints) [rad | m].   values: (p,) of all parameters.
    """
    carriers = _carriers(targets, q, values)
    found = [_of_target(each, q, values, carriers[id(each.factors)]) for each in targets]
    errors, jacobian, pose, group = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Rows(errors, jacobian, pose, group)


def sensitivities(targets: Sequence[Target], q: np.ndarray, values: np.ndarray) -> Rows:
    """Derivatives of what could be measured at any positions q (poses, joints), errors 0."""
    carriers, found = _carriers(targets, q, values), []
    for target in targets:
        ends = np.arange(len(q)) % max(len(target.ends), 1)  # each of the fixed points in turn
        for group, _, jacobian in target.rows(q, values, ends, carriers[id(target.factors)]):
            pose = np.repeat(np.arange(len(q)), jacobian.shape[1])
            found.append((jacobian.reshape(len(pose), len(values)), pose, np.full(len(pose), group)))
    jacobian, pose, group = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Rows(np.zeros(len(pose)), jacobian, pose, group)


def _carriers(targets: Sequence[Target], q: np.ndarray, values: np.ndarray) -> dict[int, ChainMotion]:
    """Motions of the frames that carry the quantities, each once."""
    chains = {id(target.factors): target.factors for target in targets}
    return {key: moved(factors, q, values) for key, factors in chains.items()}


def _of_target(target: Target, q: np.ndarray, values: np.ndarray, carrier: ChainMotion) -> tuple[np.ndarray, ...]:
    seen = np.flatnonzero(target.measured.seen)
    measured, errors, jacobians, poses, groups = target.measured.values[seen], [], [], [], []
    for group, predicted, jacobian in target.rows(q[seen], values, target.ends_of(seen), carrier.only(seen)):
        if group == ROTATION:
            error = rotation_vectors(predicted @ rotations(measured[:, 3:]).transpose(0, 2, 1))
        elif target.measured.kind == "fixed point":
            error = predicted
        else:
            error = predicted - measured[:, : predicted.shape[1]]
        errors.append(error.ravel())
        jacobians.append(jacobian.reshape(error.size, len(values)))
        poses.append(np.repeat(seen, error.shape[1]))
        groups.append(np.full(error.size, group))
    return tuple(map(np.concatenate, (errors, jacobians, poses, groups)))


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """(k, 3, 3) of quaternions (k, 4), w first; any length is taken as 1."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(quaternions[:, [1, 2, 3, 0]]).as_matrix()


def rotation_vectors(turns: np.ndarray) -> np.ndarray:
    """(k, 3) axis times angle [rad] of rotations (k, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(turns).as_rotvec()
