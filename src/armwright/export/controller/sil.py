"""Software in the loop: an exported controller, compiled for this computer and run on the inputs of a simulation."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armwright.errors import ModelError
from armwright.export.controller.recording import ControllerRecording
from armwright.export.controller.selftest import input_rows, reader
from armwright.export.controller.stages import ControllerStages
from armwright.kernels.c import REALS
from armwright.kernels.target import select_target
from armwright.output import working_folder

COMPILERS = ("gcc", "clang", "cc")  # the first of these that is there
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
TIMEOUT = 600.0  # [s] that the compiler, or the program, may take


@dataclass(frozen=True, eq=False)
class SoftwareInTheLoop:
    """Commands of the compiled controller beside those of the simulation, on the same inputs.

    Attributes:
        compiler: that was used.   ticks: that were compared.   others: of them with a command of other bits.
        first: the first of these; None: all are equal.
        error: the largest difference of a command, in parts of that command's range in the simulation.
        commands: (ticks, n) of the compiled code.   status: (ticks,) status words.   seconds: that a step took on average.
    """

    compiler: str
    ticks: int
    others: int
    first: int | None
    error: float
    commands: np.ndarray
    status: np.ndarray
    seconds: float


def find_compiler() -> str | None:
    """Path of a C compiler on this computer; None if absent."""
    return next((path for path in map(shutil.which, COMPILERS) if path), None)


def flags_of_host() -> tuple[str, ...]:
    """Compiler options for exact bits and speed on this computer: with the instruction for fma() if available."""
    return (*FLAGS, *(("-mfma",) if "+fma" in select_target(None).features.split(",") else ()))


def software_in_the_loop(
    stages: ControllerStages,
    recording: ControllerRecording,
    folder: str | Path,
    real: str = "double",
) -> SoftwareInTheLoop:
    """Compiles the controller in a folder and compares its commands with recorded ones.

    Args:
        stages, recording: the controller, and what it saw and commanded in its simulation.   folder: with its C file.
        real: "double" or "float", as it was exported.
    Raises:
        ModelError: no compiler; it, or the program, ends with an error, which the message has.
    """
    compiler = find_compiler()
    if compiler is None:
        raise ModelError("there is none", place="compiler", expected=" or ".join(COMPILERS))
    dtype = REALS[real].format.dtype
    with working_folder({"reader.c": reader(stages, recording, real)}) as work:
        input_rows(stages, recording).astype(dtype).tofile(work / "inputs")
        options = [*flags_of_host(), f"-I{Path(folder)}"]
        files = [work / "reader.c", Path(folder) / f"{stages.name}.c"]
        run_program([compiler, *options, *map(str, files), "-o", str(work / "reader"), "-lm"])
        paths = [str(work / each) for each in ("reader", "inputs", "commands", "status")]
        seconds = float(run_program([*paths, "1"]))
        found = np.fromfile(work / "commands", dtype=dtype).reshape(recording.u.shape)
        status = np.fromfile(work / "status", dtype=np.uint32)
    expected = recording.u.astype(dtype)
    differs = (found.view(f"u{dtype.itemsize}") != expected.view(f"u{dtype.itemsize}")).any(axis=1)
    first = int(np.argmax(differs)) if differs.any() else None
    error = relative_error(found.astype(float), recording.u)
    counts = (recording.ticks, int(differs.sum()), first)
    return SoftwareInTheLoop(compiler, *counts, error, found.astype(float), status, seconds / recording.ticks)


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of commands (ticks, n), relative to their range in `expected`, or to the value of a constant one."""
    spans = np.ptp(expected, axis=0)
    spans = np.where(spans > 0.0, spans, np.maximum(np.abs(expected).max(axis=0), np.finfo(float).tiny))
    return float((np.abs(found - expected).max(axis=0) / spans).max())


def run_program(
    command: list[str], place: str = "", timeout: float = TIMEOUT, environment: dict[str, str] | None = None
) -> str:
    """Standard output of a program.

    Args:
        command: the program and its words.   place: what errors call it; default: its name.
        timeout: [s] that it may take.   environment: its variables; None: those of this process.
    Raises:
        ModelError: it ends with an error.
    """
    place = place or Path(command[0]).name
    try:
        done = subprocess.run(
            command, capture_output=True, encoding="utf-8", errors="replace", timeout=timeout, env=environment
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ModelError(str(error), place=place) from None
    if done.returncode != 0:
        lines = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        what = next((line for line in lines if "error" in line), lines[0] if lines else f"ends with {done.returncode}")
        raise ModelError(what, place=place)
    return done.stdout
