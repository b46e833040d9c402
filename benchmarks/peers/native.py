"""Peers' own C and C++ in loops over states: compiled once for this processor, into build/benchmarks."""

from __future__ import annotations

import ctypes
import hashlib
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

BUILD = Path(__file__).parents[2] / "build" / "benchmarks"
FLAGS = ("-O3", "-march=native", "-DNDEBUG", "-w", "-fPIC", "-shared", "-fvisibility=hidden")

Results = np.ndarray | tuple[np.ndarray, ...]


class NoLoop(Exception):
    """Why a loop in C or C++ cannot be had here."""


def library(source: Path, compilers: Sequence[str], flags: Sequence[str], version: str, build: bool) -> Path:
    """A source file as a shared library.

    Args:
        source: one file.   compilers: names to look for.   flags: more of them, libraries among them.
        version: of the peer; with the processor and the source it decides whether there is one already.
        build: whether to compile what is not there.

    Raises:
        NoLoop: no compiler, an error of it, or (without `build`) nothing compiled yet.
    """
    compiler = next(filter(None, map(shutil.which, compilers)), None)
    if compiler is None:
        raise NoLoop(f"no {' or '.join(compilers)}")
    command = [compiler, *FLAGS, str(source), *flags]
    key = hashlib.sha256("\n".join([*command, version, _processor(), source.read_text()]).encode()).hexdigest()
    path = BUILD / f"{source.stem}-{key[:16]}.so"
    if path.exists():
        return path
    if not build:
        raise NoLoop("not compiled yet; a run without --quick does it")
    print(f"compiling {source.name}, once …", file=sys.stderr, flush=True)
    BUILD.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    made = subprocess.run([*command, "-o", str(part)], capture_output=True, text=True)
    if made.returncode != 0:
        faults = [line for line in made.stderr.splitlines() if "error" in line]
        raise NoLoop(f"{Path(compiler).name} failed: {faults[0] if faults else made.stderr[-200:]}")
    part.rename(path)
    return path


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    """Of a C-contiguous array."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def aligned(like: np.ndarray) -> np.ndarray:
    """An array of the same shape, all NaN, that begins at a cache line."""
    room = np.full(like.size + 8, np.nan)
    start = -room.ctypes.data // 8 % 8
    return room[start : start + like.size].reshape(like.shape)


def call(code: ctypes.CDLL, name: str, before: Sequence[ctypes.c_void_p], arrays: Sequence[np.ndarray], out: Results):
    """`name(*before, count, *arrays, *out)` over all states; returns `out`."""
    results = out if isinstance(out, tuple) else (out,)
    count = ctypes.c_long(len(arrays[0]))
    getattr(code, name)(*before, count, *map(pointer, (*arrays, *results)))
    return out


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return "\n".join(line for line in lines[:30] if line.startswith(("model", "flags"))) or platform.processor()
