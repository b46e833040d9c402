"""Kernels on a GPU beside the same on this processor: ns per state of a million states. Without a GPU there are no rows.

    python benchmarks/run.py --chapters gpu --save FOLDER

It needs neither Pinocchio nor MuJoCo, but CuPy or PyTorch beside the extra `cuda`: results come from their memory pools.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from arms import random_states, timed_arm
from records import Record, Task, record
from timing import Check, Contestant, Entry, race, relative_error

import armwright as aw
from armwright.errors import ModelError

ARMS = ("puma560", "panda")
KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "forward_kinematics", "inverse_dynamics_derivatives")
FORMATS = {"float64": 1e-12, "float32": 1e-2}  # and how far a result may be from that of this processor
MANY, QUICK_MANY = 1_000_000, 10_000  # states


@cache
def library() -> Any:
    """CuPy or PyTorch, None without a GPU or without both; says why."""
    try:
        aw.compile(aw.load("two-link"), device="cuda")
    except ModelError as error:
        print(f"gpu: no rows: {error}", file=sys.stderr)
        return None
    for name in ("cupy", "torch"):
        if importlib.util.find_spec(name) is not None:
            return importlib.import_module(name)
    print("gpu: no rows: neither CuPy nor PyTorch is installed", file=sys.stderr)
    return None


def put(array: np.ndarray) -> Any:
    """A copy of an array on the GPU."""
    found = library()
    return found.asarray(array) if found.__name__ == "cupy" else found.as_tensor(array, device="cuda")


def get(array: Any) -> np.ndarray:
    """A copy of a GPU's array."""
    return array.get() if library().__name__ == "cupy" else array.cpu().numpy()


def wait() -> None:
    """Waits until everything that was started is done."""
    found = library()
    (found.cuda.Device() if found.__name__ == "cupy" else found.cuda).synchronize()


def tasks(quick: bool) -> list[Task]:
    """A race for every arm, kernel and format, where there is a GPU."""
    if library() is None:
        return []
    return [
        Task("gpu", f"{arm} {name} {dtype} gpu", partial(gpu_records, arm, name, dtype, quick))
        for arm in (ARMS[:1] if quick else ARMS)
        for dtype in FORMATS
        for name in (KERNELS[:1] if quick else KERNELS)
    ]


def gpu_records(arm: str, name: str, dtype: str, quick: bool, repetitions: int) -> list[Record]:
    """One row: one thread, all threads, the GPU with arrays that are there, the GPU with NumPy's, which are copied."""
    model, count = timed_arm(arm), QUICK_MANY if quick else MANY
    here, there = aw.compile(model, dtype=dtype), aw.compile(model, dtype=dtype, device="cuda")
    kernel, on_gpu = here.kernel(name), there.kernel(name)
    values = random_states(model, count)
    inputs = [values[port.name].astype(dtype) for port in kernel.program.inputs]
    device = [put(each) for each in inputs]
    expected = _parts(kernel(*inputs, threads=os.cpu_count() or 1))
    found = [get(part) for part in _parts(on_gpu(*device))]
    same = [float(np.mean(_bits(a) == _bits(b))) for a, b in zip(found, expected, strict=True)]
    check = _checked(expected, FORMATS[dtype])
    out = tuple(np.empty_like(part) for part in expected)

    def launched() -> Any:
        results = on_gpu(*device)
        wait()
        return results

    def on_cpu(threads: int) -> Callable[[], Any]:
        return lambda: kernel(*inputs, out=out if len(out) > 1 else out[0], threads=threads)

    contestants = {
        "one": Contestant("one thread", on_cpu(1), count, check),
        "threads": Contestant("all threads", on_cpu(os.cpu_count() or 1), count, check),
        "gpu": Contestant("GPU", launched, count, check),
        "copied": Contestant("GPU, NumPy's arrays", lambda: on_gpu(*inputs), count, check),
    }
    labels = {"arm": arm, "joints": model.n, "work": name, "form": dtype, "states": count}
    moved = sum(array.nbytes for array in (*inputs, *expected)) / count
    facts = {"same": min(same), "bytes": moved}
    entry = Entry(labels, contestants, {"one": "gpu", "threads": "gpu"}, facts=facts)
    return [record(row) for row in race([entry], repetitions)]


def _bits(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array).view(f"u{array.itemsize}")


def _parts(result: Any) -> tuple[Any, ...]:
    return result if isinstance(result, tuple) else (result,)


def _checked(truths: tuple[np.ndarray, ...], tolerance: float) -> Callable[[Any], Check]:
    """Compares a result with that of this processor."""

    def check(result: Any) -> Check:
        parts = [part if isinstance(part, np.ndarray) else get(part) for part in _parts(result)]
        errors = [relative_error(part, true, true.ndim - 1) for part, true in zip(parts, truths, strict=True)]
        return Check(float(np.max(errors)), tolerance)

    return check


def notes(quick: bool) -> dict[str, list[str]]:
    """Notes of the chapter for its reader."""
    return {
        "gpu": [
            f"wall time; {os.cpu_count()} threads; GPU: arrays of {library().__name__} in its memory, until all is computed",
            "copied: NumPy's arrays in and out, with memory on the GPU that is new for each call",
            "same bits: the least share of entries of an output that are equal to this processor's to the bit",
        ]
    }
