"""Pinocchio: the arm built there from the model's numbers; its algorithms from Python, and in a C++ loop where that compiles."""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from peers.chain import joint_places
from peers.native import NoLoop, Results, call, library, pointer

from armwright.model import Model

SOURCE = Path(__file__).with_name("pinocchio_loop.cpp")
FLAGS = ("-std=c++17", "-fno-gnu-unique")
DEFINITIONS = (  # those of Pinocchio's own CMake target
    *("-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS"),
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)
EIGEN = ("/usr/include/eigen3", "/usr/local/include/eigen3", "/opt/homebrew/include/eigen3")


class PinocchioArm:
    """An arm in Pinocchio's Python package: joints turn about their z axes, friction is none, rotors are armature."""

    name = f"Pinocchio {pin.__version__}"

    def __init__(self, arm: Model):
        self.model = pin.Model()
        self.model.gravity = pin.Motion(np.array(arm.gravity, dtype=float), np.zeros(3))
        for i, (body, place) in enumerate(zip(arm.bodies, joint_places(arm), strict=True)):
            kind = pin.JointModelRZ() if body.kind.name == "revolute" else pin.JointModelPZ()
            joint = self.model.addJoint(i, kind, pin.SE3(*place), body.joint)
            inertia = pin.Inertia(float(body.mass), _floats(body.com), _floats(body.inertia_com))
            self.model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        self.model.armature = np.array([float(body.drive.armature) for body in arm.bodies])
        self.data = self.model.createData()

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        return np.array([pin.rnea(self.model, self.data, *state) for state in zip(q, qd, qdd, strict=True)])

    def forward_dynamics(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
        return np.array([pin.aba(self.model, self.data, *state) for state in zip(q, qd, tau, strict=True)])

    def inverse_dynamics_derivatives(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, ...]:
        rows = []
        for state in zip(q, qd, qdd, strict=True):
            pin.computeRNEADerivatives(self.model, self.data, *state)
            rows.append([self.data.dtau_dq.copy(), self.data.dtau_dv.copy(), symmetric(self.data.M)])
        return tuple(np.array(part) for part in zip(*rows, strict=True))

    def forward_dynamics_derivatives(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, ...]:
        rows = []
        for state in zip(q, qd, tau, strict=True):
            pin.computeABADerivatives(self.model, self.data, *state)
            rows.append([self.data.ddq_dq.copy(), self.data.ddq_dv.copy(), symmetric(self.data.Minv)])
        return tuple(np.array(part) for part in zip(*rows, strict=True))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        upper = np.triu(np.array([pin.crba(self.model, self.data, state) for state in q]))
        return upper + np.triu(upper, 1).swapaxes(1, 2)


def symmetric(matrix: np.ndarray) -> np.ndarray:
    """A matrix of which Pinocchio fills the upper half."""
    return np.triu(matrix) + np.triu(matrix, 1).T


class PinocchioLoop:
    """Pinocchio's C++ in its own loop over states, one thread."""

    name = f"Pinocchio {pin.__version__} C++ -O3 -march=native"

    def __init__(self, arm: Model):
        self._code = ctypes.CDLL(str(compiled_loop(build=False)))
        self._code.arm_new.restype = ctypes.c_void_p
        bodies, places = arm.bodies, joint_places(arm)
        numbers = (
            np.array([b.parent for b in bodies], dtype=np.int64),
            np.array([b.kind.name == "revolute" for b in bodies], dtype=np.bool_),
            *(_floats([place[part] for place in places]) for part in (0, 1)),
            *(_floats([getattr(b, part) for b in bodies]) for part in ("mass", "com", "inertia_com")),
            _floats([b.drive.armature for b in bodies]),
            _floats(arm.gravity),
        )
        self._arm = ctypes.c_void_p(self._code.arm_new(ctypes.c_long(arm.n), *map(pointer, numbers)))
        self._delete = self._code.arm_delete

    def __del__(self) -> None:
        if hasattr(self, "_delete"):
            self._delete(self._arm)

    def call(self, name: str, out: Results, *arrays: np.ndarray) -> Results:
        """One of the loop's algorithms over all states, into `out`."""
        return call(self._code, name, (self._arm,), arrays, out)


@functools.cache
def compiled_loop(build: bool) -> Path:
    """The loop as a library, compiled once for this processor and these headers: a minute and a half.

    Raises:
        NoLoop: no compiler, no headers, or (without `build`) it was not compiled yet.
    """
    headers = next(folder for folder in Path(str(pin.__file__)).parents if folder.name == "cmeel.prefix") / "include"
    eigen = next((folder for folder in EIGEN if Path(folder, "Eigen/Core").exists()), None)
    if eigen is None:
        raise NoLoop("no Eigen headers (Debian: libeigen3-dev)")
    flags = (*FLAGS, *DEFINITIONS, "-isystem", str(headers), "-isystem", eigen)
    return library(SOURCE, ("g++", "clang++"), flags, pin.__version__, build)


def _floats(values: object) -> np.ndarray:
    return np.ascontiguousarray(np.array(values, dtype=float))
