"""The chain of joints to a frame, for inverse kinematics: pose errors, limits, and good starts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.ik.orientation import partial_turn, polar_angle
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.kinematics import forward_kinematics, jacobian
from armwright.kinematics.aim import POSE, Aim, turning_rows
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import Model
from armwright.program import trace
from armwright.scalar import Array, Scalar

TURN = 2.0 * np.pi  # [rad]
STRAIGHT = 1e-9  # sine of an angle that is taken for its sine
UPRIGHT = 1e-9  # of the first joint's axis along base z


@dataclass(frozen=True, eq=False)
class JointChain:
    """An arm's joints and one of its frames.

    Poses are tasks of 13 numbers: position (3), rotation (9, row by row) and the azimuth of the position about the first
    joint's axis: a start serves all poses that differ by a turn about it.

    Attributes:
        model: the arm.   frame: name of the frame; None: the tip.   weight: [m/rad], of angles in errors.
        aim: what of a pose counts.
        bounds: lowest and highest positions (n,) where they are not the model's: numbers or symbols.
    """

    model: Model
    frame: str | None
    weight: Scalar
    aim: Aim = POSE
    bounds: tuple[Array, Array] | None = None

    task_size = 13

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.n

    def of(self, task: Array) -> JointChain:
        """The chain that a task is for: this one."""
        return self

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """Lowest and highest positions (n,) [rad | m], ±inf where there are none."""
        if self.bounds is not None:
            return self.bounds
        low, high = np.array([body.limits.position for body in self.model.coordinates]).T
        return low, high

    @cached_property
    def turns_around(self) -> np.ndarray:
        """(n,) True for joints that only turn, reach every angle and move no other: descents need no limits there."""
        if self.bounds is not None:
            return np.zeros(self.n, dtype=bool)
        low, high = self.limits
        turns = np.array([not body.kind.slides for body in self.model.coordinates]) & (high - low >= TURN)
        mimics = self.model.mimics
        if mimics is None:
            return turns
        # turns of the others move their followers
        return turns & (np.bincount(mimics.coordinate, minlength=self.n) == 1)

    @cached_property
    def low(self) -> Array:
        """Limits that descents keep."""
        return np.where(self.turns_around, -np.inf, self.limits[0])

    @cached_property
    def high(self) -> Array:
        """Limits that descents keep."""
        return np.where(self.turns_around, np.inf, self.limits[1])

    @cached_property
    def base(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Axes and origin of the first joint where it is revolute and the chain begins with it; else None.

        Also None where other joints follow the first, where a turn about its axis changes what counts of a pose that turns
        along, and for an arm of symbols, whose starts are not turned.

        Raises:
            ModelError: a frame that no joint moves.
        """
        if self.bounds is not None:
            return None
        path = self.model.path(self.model.frame(self.frame).body)
        if not path:
            raise ModelError(
                "no joint moves it", place="frame", value=self.frame, expected="a frame of a link that moves"
            )
        mimics = self.model.mimics
        alone = mimics is None or (mimics.drivers[0] == 0 and mimics.coordinate.count(0) == 1)
        if path[0] != 0 or self.model.bodies[0].kind.slides or not alone:
            return None
        placed = body_placements(self.model, np.zeros(self.n))[0]
        axes = np.asarray(placed.rotation, dtype=float)
        vertical = np.abs(axes[:2, 2]).max() < UPRIGHT
        if (self.aim.base and self.aim.axis != 2) or (self._by_base and not vertical):
            return None
        return axes, np.asarray(placed.position, dtype=float)

    @property
    def _by_base(self) -> bool:
        """True for an aim that depends on the base's axes."""
        return self.aim.base or self.aim.kind in ("pitch", "yaw")

    def _directions(self, rotation: Array, target: Array) -> tuple[np.ndarray, np.ndarray]:
        """The direction (3,) in base axes that an axis aim turns, and the one that it must reach."""
        k = self.aim.axis
        return (rotation @ target[k], np.eye(3)[k]) if self.aim.base else (rotation[:, k], target[:, k])

    def error(self, q: Array, task: Array) -> tuple[np.ndarray, np.ndarray]:
        """The error e (k,) [m] of a pose and the slope of the pose by q, J (k, n): a step s leaves about e - J s."""
        pose, slope = forward_kinematics(self.model, q, self.frame), jacobian(self.model, q, self.frame)
        off = task[:3] - pose[:3, 3]
        if self.aim.kind == "position":
            return off, slope[:3]
        rotation, target = pose[:3, :3], task[3:12].reshape(3, 3)
        if self.aim.kind not in ("pose", "axis"):
            turn, rows = partial_turn(self.aim, rotation, target)
            angular = rows @ slope[3:] * self.weight
            return scalar.array([*off, *(turn * self.weight)]), scalar.array([*slope[:3], *angular])
        along = np.zeros(3)
        if self.aim.kind == "axis":
            start, along = self._directions(rotation, target)
            axis, cosine = _cross(start, along), start @ along
        else:
            products = [_cross(rotation[:, k], target[:, k]) for k in range(3)]
            cosines = [rotation[:, k] @ target[:, k] for k in range(3)]
            axis = (products[0] + products[1] + products[2]) * 0.5
            cosine = (cosines[0] + cosines[1] + cosines[2] - 1.0) * 0.5
        sine = scalar.sqrt(axis @ axis)
        ratio = scalar.atan2(sine, cosine) / scalar.maximum(sine, STRAIGHT)  # angle / sine
        factor = scalar.where(scalar.less(STRAIGHT, sine), ratio, 1.0) * self.weight
        weighted = slope[3:] * self.weight
        if self.aim.kind == "axis":  # a turn about the axis itself changes nothing
            weighted = weighted - scalar.array(
                [[along[i] * (along @ weighted[:, j]) for j in range(self.n)] for i in range(3)]
            )
        return scalar.array([*off, *(axis * factor)]), scalar.array([*slope[:3], *weighted])

    def slopes(self, q: Array) -> np.ndarray:
        """Jacobian (k, n) of what counts, angles times the weight [m]."""
        slope = jacobian(self.model, q, self.frame)
        if self.aim.kind == "position":
            return slope[:3]
        angular = slope[3:] * self.weight
        if self.aim.kind != "pose":
            angular = turning_rows(self.aim, forward_kinematics(self.model, q, self.frame)[:3, :3]) @ angular
        return scalar.array([*slope[:3], *angular])

    def within(self, q: Array) -> np.ndarray:
        """Positions moved into the limits."""
        ends = zip(q, self.low, self.high, strict=True)
        return scalar.array([x if unlimited(a) and unlimited(b) else scalar.clip(x, a, b) for x, a, b in ends])

    def wrapped(self, q: Array) -> np.ndarray:
        """Positions with whole turns taken off joints that reach every angle, until they are within their limits."""
        return scalar.array([self._turned(i, q[i]) if self.turns_around[i] else q[i] for i in range(self.n)])

    def nearest_turns(self, q: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Positions (k, n) with whole turns of the joints that reach every angle added, as near to others as limits allow."""
        low, high = self.limits
        turns = np.where(self.turns_around, np.round((near - q) / TURN), 0.0)
        with np.errstate(invalid="ignore"):
            turns = np.clip(turns, np.ceil((low - q) / TURN), np.floor((high - q) / TURN))
        return np.where(self.turns_around, q + TURN * turns, q)

    def _turned(self, joint: int, angle: Scalar) -> Scalar:
        low, high = max(self.limits[0][joint], -1e9), min(self.limits[1][joint], 1e9)
        middle = min(max(0.0, low + np.pi), high - np.pi)  # as near to 0 as the limits allow
        return angle - TURN * scalar.floor((angle - middle) / TURN + 0.5)

    def placed(self, pose: Array) -> tuple[np.ndarray, np.ndarray]:
        """The task (13,) of a pose (4, 4), and its features (12,): of the pose turned to azimuth 0, rotations times weight / √2.

        Distances of features are those of poses [m]. The azimuth is 0 where the first joint does not turn the frame.
        """
        position, rotation, angle = pose[:3, 3], pose[:3, :3], 0.0
        at, turned = position, rotation
        if self.base is not None:
            axes, origin = self.base
            x, y, z = axes.T @ (position - origin)
            angle = scalar.atan2(y, x)
            c, s = scalar.cos(angle), scalar.sin(angle)
            at, turned = scalar.array([c * x + s * y, c * y - s * x, z]), axes.T @ rotation
            turned = scalar.array([c * turned[0] + s * turned[1], c * turned[1] - s * turned[0], turned[2]])
        if self._by_base and self.base is not None:
            turned = self.base[0] @ turned
        scaled = self._turn_features(turned) * (self.weight / np.sqrt(2.0))
        return scalar.array([*position, *rotation.reshape(-1), angle]), scalar.array([*at, *scaled.reshape(-1)])

    def _turn_features(self, rotation: Array) -> np.ndarray:
        """(3, 3) numbers of a rotation; of two rotations that differ a little they are √2 times as far apart as what counts."""
        kind, k, factor = self.aim.kind, self.aim.axis, np.sqrt(2.0)
        if kind == "axis" and not self.aim.base:
            return rotation * np.where(np.arange(3) == k, factor, 0.0)
        if kind in ("pose", "position", "twist"):
            return rotation * np.full(3, float(kind != "position"))
        if kind == "axis":
            return scalar.array([factor * rotation[k], np.zeros(3), np.zeros(3)])
        x, y, _ = direction = rotation[:, k]
        if kind == "pitch":
            return scalar.array([[factor * polar_angle(direction), 0.0, 0.0], np.zeros(3), np.zeros(3)])
        scale = factor / scalar.maximum(scalar.sqrt(x * x + y * y), STRAIGHT)
        return scalar.array([[x * scale, y * scale, 0.0], np.zeros(3), np.zeros(3)])

    @cached_property
    def places(self) -> Kernel:
        """Compiled `placed` of poses (k, 4, 4)."""
        return Kernel(trace("placed", self.placed, {"pose": (4, 4)}, ("task", "features")), select_target())

    def tasks(self, poses: np.ndarray) -> np.ndarray:
        """(k, 13) tasks of poses (k, 4, 4)."""
        return self.places(poses)[0]

    def errors(self, q: Array, target: Array) -> tuple[Scalar, Scalar]:
        """Distance [m] and angle [rad] from the pose of the frame to its target (4, 4), to all digits where they are small."""
        pose = forward_kinematics(self.model, q, self.frame)
        off = pose[:3, 3] - target[:3, 3]
        distance = scalar.sqrt(off @ off)
        if self.aim.kind == "position":
            return distance, 0.0
        if self.aim.kind not in ("pose", "axis"):
            return distance, scalar.abs(partial_turn(self.aim, pose[:3, :3], target[:3, :3])[0][0])
        if self.aim.kind == "axis":
            start, end = self._directions(pose[:3, :3], target[:3, :3])
            turned, share = start - end, 0.25
        else:
            turned, share = (pose[:3, :3] - target[:3, :3]).reshape(-1), 0.125
        square = (turned @ turned) * share  # sin²(angle / 2)
        return distance, 2.0 * scalar.atan2(scalar.sqrt(square), scalar.sqrt(scalar.maximum(1.0 - square, 0.0)))

    @cached_property
    def judge(self) -> Kernel:
        """Compiled  q (k, n), poses (k, 4, 4) → distance (k,) [m], angle (k,) [rad], margin to the limits (k,)."""

        def judged(q: Array, target: Array) -> tuple[Scalar, Scalar, Scalar]:
            return *self.errors(q, target), self.margin(q)

        shapes = {"q": (self.n,), "target": (4, 4)}
        return Kernel(trace("errors", judged, shapes, ("position", "angle", "margin")), select_target())

    def margin(self, q: Array) -> Scalar:
        """Least distance to a limit as a share of that joint's range, 1/2 without limits; negative beyond one."""
        margin = 0.5
        for x, low, high in zip(q, *self.limits, strict=True):
            for side in (x - low, high - x):
                if np.isfinite(high - low) and high > low:
                    margin = scalar.minimum(margin, side * (1.0 / (high - low)))
                elif scalar.is_symbolic(side) or np.isfinite(side):  # of one limit only whether it is kept
                    margin = scalar.minimum(margin, scalar.where(scalar.less(side, 0.0), side, 0.5))
        return margin

    def start(self, task: Array, attempt: Array) -> np.ndarray:
        """Start of an attempt (n + 1: positions, azimuth) for a task, turned to the task's azimuth."""
        if self.base is None:
            return self.within(attempt[: self.n])
        angle = attempt[0] + (task[12] - attempt[self.n])
        angle = angle - TURN * scalar.floor(angle / TURN + 0.5)
        return self.within(scalar.array([angle, *attempt[1 : self.n]]))


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (k,) [rad] of the rotations from (k, 3, 3) to (k, 3, 3), to all digits where they are small."""
    half = np.linalg.norm(a - b, axis=(1, 2)) / np.sqrt(8.0)  # sin(angle / 2)
    return 2.0 * np.arcsin(np.minimum(half, 1.0))


def unlimited(bound: Scalar) -> bool:
    """True for a number that is no limit; a symbol is one."""
    return not scalar.is_symbolic(bound) and bool(np.isinf(bound))


def _cross(a: Array, b: Array) -> np.ndarray:
    return scalar.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
