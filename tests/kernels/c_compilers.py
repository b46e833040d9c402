"""The C compilers of this machine, and shared libraries made with them."""

from __future__ import annotations

import ctypes
import platform
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror")
FMA = ("-mfma",) if platform.machine() in ("x86_64", "AMD64") else ()
#: How the C text is said to have the kernels' bits.
BITS = ("-std=c99", "-O2", *FMA, "-ffp-contract=off")
CORTEX_M7 = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")


def compiler(name: str) -> str:
    """The path of a compiler; skips the test where it is not installed."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def build(command: Sequence[str | Path]) -> None:
    """Runs a compiler, which must have nothing to say."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    assert not done.stderr, done.stderr[-4000:]


def batch_function(name: str, sizes: Sequence[int], inputs: int, real: str = "double") -> str:
    """`void name_batch(count, in0, …, out0, …)`: C text that calls a function of arrays for every row of larger ones."""
    arrays = [f"{'const ' * (k < inputs)}{real} *a{k}" for k in range(len(sizes))]
    rows = [f"a{k} + {size} * k" for k, size in enumerate(sizes)]
    return (
        f"void {name}_batch(long count, {', '.join(arrays)});\n"
        f"void {name}_batch(long count, {', '.join(arrays)})\n"
        f"{{\n    long k;\n    for (k = 0; k < count; k++) {{\n        {name}({', '.join(rows)});\n    }}\n}}\n"
    )


def run_batch(library: ctypes.CDLL, name: str, inputs: Sequence[np.ndarray], shapes: Sequence[tuple[int, ...]]):
    """Outputs of a batch function for inputs (count, *shape): one array each, (count, *shape)."""
    count = len(inputs[0])
    given = [np.ascontiguousarray(array) for array in inputs]
    outputs = [np.empty((count, *shape), dtype=given[0].dtype) for shape in shapes]
    function = getattr(library, f"{name}_batch")
    function.restype = None
    function(ctypes.c_long(count), *(ctypes.c_void_p(array.ctypes.data) for array in (*given, *outputs)))
    return outputs
