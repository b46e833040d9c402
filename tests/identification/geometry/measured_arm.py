"""Arms with known mistakes in their geometry, and what a tracker would measure of them: plain NumPy, nothing of ours."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi
from pathlib import Path

import numpy as np

import armwright as aw
from identification.arm.tx40 import ORIGINS, tx40_urdf

LENGTH, ANGLE = 1e-3, 1e-3  # deviations of the mistakes [m], [rad]
AXES = "xyz"
SPHERE = np.array([[0.1, 0.0, 0.05], [-0.05, 0.1, 0.06], [-0.05, -0.08, 0.1]])  # markers [m] in the last link


def turn(axis: int, angle: float) -> np.ndarray:
    """(4, 4) turn about an axis."""
    matrix, (i, j) = np.eye(4), [(1, 2), (2, 0), (0, 1)][axis]
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def shift(*way: float) -> np.ndarray:
    """(4, 4) shift."""
    matrix = np.eye(4)
    matrix[:3, 3] = way
    return matrix


def rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """(4, 4) of angles about fixed axes."""
    return turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)


def joint_of_frame(k: int, q: float, mistakes: dict[str, float]) -> np.ndarray:
    """Joint k of the TX40, whose frame has six mistakes."""
    xyz, angles = ORIGINS[k]
    matrix = shift(*xyz) @ rpy(*angles)
    matrix = matrix @ shift(*(mistakes.get(f"joint{k + 1} shift {axis}", 0.0) for axis in AXES))
    matrix = (
        matrix @ turn(0, mistakes.get(f"joint{k + 1} tilt x", 0.0)) @ turn(1, mistakes.get(f"joint{k + 1} tilt y", 0.0))
    )
    return matrix @ turn(2, q + mistakes.get(f"joint{k + 1} zero", 0.0))


PUMA_JOINTS = ("waist", "shoulder", "elbow", "wrist_roll", "wrist_pitch", "flange_roll")
PUMA = ((pi / 2, 0, 0), (0, 0, 0.4318), (-pi / 2, 0.15005, 0.0203), (pi / 2, 0.4318, 0), (-pi / 2, 0, 0), (0, 0, 0))


def joint_of_row(k: int, q: float, mistakes: dict[str, float]) -> np.ndarray:
    """Joint k of the PUMA 560: Rz(θ) Tz(r) Tx(a) Rx(α) of [Corke1996]."""
    alpha, r, a = (
        number + mistakes.get(f"{PUMA_JOINTS[k]} {word}", 0.0)
        for number, word in zip(PUMA[k], ("alpha", "r", "a"), strict=True)
    )
    return turn(2, q + mistakes.get(f"{PUMA_JOINTS[k]} zero", 0.0)) @ shift(0, 0, r) @ shift(a, 0, 0) @ turn(0, alpha)


@dataclass(frozen=True)
class Truth:
    """A true arm and how it is measured.

    Attributes:
        kind: "frame" (TX40) or "row" (PUMA 560).   mistakes: by the names of corrections.   tracker: (4, 4) of it in the base.
        eccentricity: amplitude of cos q at each joint [rad].
    """

    kind: str
    mistakes: dict[str, float]
    tracker: np.ndarray
    eccentricity: dict[int, float] = field(default_factory=dict)

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(4, 4) of the last link in the base."""
        matrix, joint = np.eye(4), {"frame": joint_of_frame, "row": joint_of_row}[self.kind]
        for k, value in enumerate(q):
            matrix = matrix @ joint(k, value + self.eccentricity.get(k, 0.0) * np.cos(value), self.mistakes)
        return matrix

    def points(self, q: np.ndarray, places: np.ndarray = SPHERE) -> np.ndarray:
        """(points, 3) in the tracker's frame."""
        placed = np.linalg.inv(self.tracker) @ self.pose(q)
        return places @ placed[:3, :3].T + placed[:3, 3]


def truth(kind: str, seed: int, **more: object) -> Truth:
    """An arm with mistakes at all places of its record."""
    rng = np.random.default_rng([seed, 1])
    if kind == "frame":
        names = {f"joint{k} {w}": u for k in range(1, 7) for w, u in _frame_words().items()}
    else:
        words = {"alpha": ANGLE, "r": LENGTH, "a": LENGTH, "zero": ANGLE}
        names = {f"{joint} {w}": u for joint in PUMA_JOINTS for w, u in words.items()}
    mistakes = {name: float(size * rng.normal()) for name, size in names.items()}
    tracker = shift(*rng.uniform(-2, 2, 3)) @ rpy(*rng.uniform(-1, 1, 3))
    return Truth(kind, mistakes, tracker, **more)  # type: ignore[arg-type]


def _frame_words() -> dict[str, float]:
    shifts = {f"shift {axis}": LENGTH for axis in AXES}
    return shifts | {"tilt x": ANGLE, "tilt y": ANGLE, "zero": ANGLE}


def nominal(kind: str, folder: Path) -> aw.Model:
    """The arm as its record has it."""
    return aw.load(tx40_urdf(folder)) if kind == "frame" else aw.load("puma560", on_impossible="warn")


def measured(
    real: Truth,
    seed: int,
    poses: int = 40,
    *,
    noise: float = 1e-4,
    common: float = 0.0,
    wrong: int = 0,
    markers: int = 3,
) -> aw.identification.Measurements:
    """Points of a tracker.

    Args:
        real: the arm.   seed: of poses and noise.   poses: how many.   noise: of each coordinate [m].
        common: of all points of a pose [m].   wrong: poses in which something else was taken for the first marker.
    """
    rng = np.random.default_rng([seed, 2])
    q = rng.uniform(-2.5, 2.5, (poses, 6))
    points = np.array([real.points(each, SPHERE[:markers]) for each in q])
    points = points + rng.normal(0, noise, points.shape) + rng.normal(0, common, (poses, 1, 3))
    for row in rng.choice(poses, wrong, replace=False):
        points[row, 0] += rng.normal(0, 0.05, 3)
    given = [aw.identification.Measured(f"marker{k + 1}", "point", points[:, k]) for k in range(markers)]
    joints = PUMA_JOINTS if real.kind == "row" else [f"joint{k}" for k in range(1, 7)]
    return aw.identification.Measurements(joints, q, given)


def true_values(found: aw.identification.Calibration, real: Truth) -> dict[str, tuple[float, float, float]]:
    """Value, true value and deviation of each correction of the record: β = π_b + K π_d."""
    base = found.fit.setting.grouped
    parameters = np.array([real.mistakes.get(column.name, 0.0) for column in base.columns])
    pairs = zip(found.fit.setting.kept, found.estimate.values, base.of(parameters), found.estimate.std, strict=True)
    return {column.name: (float(v), float(t), float(s)) for column, v, t, s in pairs if column.joint}
