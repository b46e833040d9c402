"""Pinocchio: the arm built there from the model's numbers; its algorithms from Python, and in a C++ loop where that compiles."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from armwright.model import Model

SOURCE = Path(__file__).with_name("pinocchio_loop.cpp")
BUILD = Path(__file__).parents[2] / "build" / "benchmarks"
FLAGS = (
    "-std=c++17",
    "-O3",
    "-march=native",
    "-DNDEBUG",
    "-w",
    "-fPIC",
    "-shared",
    "-fvisibility=hidden",
    "-fno-gnu-unique",
)
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
        for i, body in enumerate(arm.bodies):
            assert body.parent == i - 1, "Pinocchio wants its joints depth-first; this takes chains only"
            kind = pin.JointModelRZ() if body.kind == "revolute" else pin.JointModelPZ()
            placement = pin.SE3(_floats(body.placement.rotation), _floats(body.placement.position))
            joint = self.model.addJoint(i, kind, placement, body.joint)
            inertia = pin.Inertia(float(body.mass), _floats(body.com), _floats(body.inertia_com))
            self.model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        self.model.armature = np.array([float(body.drive.armature) for body in arm.bodies])
        self.data = self.model.createData()
        self.pool = pin.ModelPool(self.model, 1)

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


Results = np.ndarray | tuple[np.ndarray, ...]


class PinocchioLoop:
    """Pinocchio's C++ in its own loop over states, one thread."""

    name = f"Pinocchio {pin.__version__} C++ -O3 -march=native"

    def __init__(self, arm: Model):
        self._code = ctypes.CDLL(str(compiled_loop(build=False)))
        self._code.arm_new.restype = ctypes.c_void_p
        bodies = arm.bodies
        numbers = (
            *(np.array(v, dtype=np.int64) for v in ([b.parent for b in bodies],)),
            np.array([b.kind == "revolute" for b in bodies], dtype=np.bool_),
            *(_floats([getattr(b.placement, part) for b in bodies]) for part in ("rotation", "position")),
            *(_floats([getattr(b, part) for b in bodies]) for part in ("mass", "com", "inertia_com")),
            _floats([b.drive.armature for b in bodies]),
            _floats(arm.gravity),
        )
        self._arm = ctypes.c_void_p(self._code.arm_new(ctypes.c_long(arm.n), *map(_pointer, numbers)))
        self._delete = self._code.arm_delete

    def __del__(self) -> None:
        if hasattr(self, "_delete"):
            self._delete(self._arm)

    def call(self, name: str, out: Results, *arrays: np.ndarray) -> Results:
        """One of the loop's algorithms over all states, into `out`."""
        count, results = ctypes.c_long(len(arrays[0])), out if isinstance(out, tuple) else (out,)
        getattr(self._code, name)(self._arm, count, *map(_pointer, (*arrays, *results)))
        return out


class NoLoop(Exception):
    """Why the C++ loop cannot be had here."""


@functools.cache
def compiled_loop(build: bool) -> Path:
    """The loop as a library, compiled once for this processor and these headers.

    Raises:
        NoLoop: no compiler, no headers, or (without `build`) it was not compiled yet.
    """
    compiler = shutil.which("g++") or shutil.which("clang++")
    headers = next(folder for folder in Path(str(pin.__file__)).parents if folder.name == "cmeel.prefix") / "include"
    eigen = next((folder for folder in EIGEN if Path(folder, "Eigen/Core").exists()), None)
    if compiler is None:
        raise NoLoop("no g++ or clang++")
    if eigen is None:
        raise NoLoop("no Eigen headers (Debian: libeigen3-dev)")
    command = [compiler, *FLAGS, *DEFINITIONS, "-isystem", str(headers), "-isystem", eigen, str(SOURCE)]
    key = hashlib.sha256("\n".join([*command, pin.__version__, _processor(), SOURCE.read_text()]).encode()).hexdigest()
    library = BUILD / f"pinocchio_loop-{key[:16]}.so"
    if library.exists():
        return library
    if not build:
        raise NoLoop("not compiled yet; a run without --quick does it")
    print("compiling Pinocchio's C++ loop, once: about a minute and a half …", file=sys.stderr, flush=True)
    BUILD.mkdir(parents=True, exist_ok=True)
    made = subprocess.run([*command, "-o", str(library.with_suffix(".part"))], capture_output=True, text=True)
    if made.returncode != 0:
        faults = [line for line in made.stderr.splitlines() if "error" in line]
        raise NoLoop(f"{Path(compiler).name} failed: {faults[0] if faults else made.stderr[-200:]}")
    library.with_suffix(".part").rename(library)
    return library


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return "\n".join(line for line in lines[:30] if line.startswith(("model", "flags"))) or platform.processor()


def _floats(values: object) -> np.ndarray:
    return np.ascontiguousarray(np.array(values, dtype=float))


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)
