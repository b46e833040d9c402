"""TIAGo's motion-capture points, which are not part of this repository, and a calibration by Pinocchio and SciPy alone."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from identification.real_logs import DATA
from reference.example_robots import robot_files

TABLE = DATA / "tiago" / "mocap_hand_calibration.csv"
JOINTS = ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))]
FOLDS = 10
FILE = """
title = "TIAGo: motion capture of markers on its hand"
robot = "{robot}"
file.path = "{table}"
measuring_frame.name = "mocap"
[[joints]]
columns = ["torso_lift_joint"]
unit = "m"
[[joints]]
columns = ["arm_1_joint", "arm_2_joint", "arm_3_joint", "arm_4_joint", "arm_5_joint", "arm_6_joint", "arm_7_joint"]
"""
MARKER = """
[[measured]]
name = "marker{k}"
kind = "point"
columns = ["x{k}", "y{k}", "z{k}"]
frame = "arm_7_link"
"""


def urdf() -> Path:
    """TIAGo's file."""
    return robot_files()["tiago_description/robots/tiago.urdf"]


def tiago_file(folder: Path) -> Path:
    """The file of measurements, written into a folder: all four markers, of which two are one."""
    path = folder / "tiago.calibration.toml"
    path.write_text(FILE.format(robot=urdf(), table=TABLE) + "".join(MARKER.format(k=k) for k in range(1, 5)))
    return path


class TiagoChain:
    """Pinocchio's model: six corrections of each joint's placement, of the base in the motion capture, and three markers."""

    def __init__(self) -> None:
        import pinocchio as pin

        rows = np.genfromtxt(TABLE, delimiter=",", skip_header=1)
        self.points, self.q = rows[:, :9].reshape(-1, 3, 3), rows[:, 12:]
        model = pin.buildModelFromUrdf(str(urdf()))
        ids = [model.getJointId(name) for name in JOINTS]
        self.placements = [model.jointPlacements[k].homogeneous for k in ids]
        first, last = model.idx_qs[ids[0]], model.idx_qs[ids[-1]]
        self.limits = model.lowerPositionLimit[first : last + 1], model.upperPositionLimit[first : last + 1]
        self.exp6 = lambda v: pin.exp6(v).homogeneous

    def predicted(self, x: np.ndarray, q: np.ndarray) -> np.ndarray:
        """(poses, 3, 3) markers in the motion capture for x: base 6, markers 9, joints 8 × 6."""
        placed = np.tile(self.exp6(x[:6]), (len(q), 1, 1))
        for k, placement in enumerate(self.placements):
            motion = np.tile(np.eye(4), (len(q), 1, 1))
            if k == 0:
                motion[:, 2, 3] = q[:, 0]
            else:
                c, s = np.cos(q[:, k]), np.sin(q[:, k])
                motion[:, 0, 0], motion[:, 0, 1], motion[:, 1, 0], motion[:, 1, 1] = c, -s, s, c
            placed = placed @ (placement @ self.exp6(x[15 + 6 * k : 21 + 6 * k])) @ motion
        markers = np.c_[x[6:15].reshape(3, 3), np.ones(3)]
        return np.einsum("nij,mj->nmi", placed, markers)[..., :3]

    def fitted(self, x: np.ndarray, free: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """All parameters with those of `free` fitted to some poses, by SciPy's Levenberg-Marquardt."""

        def errors(z: np.ndarray) -> np.ndarray:
            every = x.copy()
            every[free] = z
            return (self.predicted(every, self.q[poses]) - self.points[poses]).ravel()

        every = x.copy()
        every[free] = least_squares(errors, x[free], method="lm", x_scale="jac").x
        return every

    @cached_property
    def start(self) -> np.ndarray:
        """Base and markers alone fitted."""
        return self.fitted(np.zeros(63), np.arange(15), np.arange(len(self.q)))

    @cached_property
    def identifiable(self) -> np.ndarray:
        """Numbers of parameters whose columns at random positions are independent of those before them."""
        q = np.random.default_rng(0).uniform(*self.limits, (100, len(JOINTS)))
        steps = 1e-6 * np.eye(63)
        columns = [
            (self.predicted(self.start + d, q) - self.predicted(self.start - d, q)).ravel() / 2e-6 for d in steps
        ]
        basis, kept = np.zeros((len(columns[0]), 0)), []
        for k, column in enumerate(columns):
            left = column / max(np.linalg.norm(column), 1e-9)
            for _ in range(2):
                left = left - basis @ (basis.T @ left)
            if np.linalg.norm(left) > 1e-4:
                basis = np.column_stack([basis, left / np.linalg.norm(left)])
                kept.append(k)
        return np.array(kept)

    @property
    def rank(self) -> int:
        """Number of identifiable parameters."""
        return len(self.identifiable)

    def held_out(self, folds: int) -> float:
        """RMS distance [m] of all markers in all poses from fits to the other parts."""
        squares, part = [], np.arange(len(self.q)) % folds
        for k in range(folds):
            x = self.fitted(self.start, self.identifiable, np.flatnonzero(part != k))
            out = part == k
            squares.append(((self.predicted(x, self.q[out]) - self.points[out]) ** 2).sum(axis=2).ravel())
        return float(np.sqrt(np.concatenate(squares).mean()))
