"""One fresh process of `rows_start.py`: does what its argument says and prints the seconds that it took as JSON.

python benchmarks/start.py import | first | compile KERNEL ARM
"""

from __future__ import annotations

import json
import sys
import time

LIBRARIES = ("numpy", "casadi", "llvmlite.binding", "pydantic")


def main(arguments: list[str]) -> int:
    what, *more = arguments
    results = {"import": import_only, "first": first_kernel, "compile": compile_kernel}[what](*more)
    print(json.dumps(results))
    return 0


def import_only() -> dict[str, object]:
    """`import armwright`, and that it brings no library with it."""
    start = time.perf_counter()
    import armwright

    return {"seconds": time.perf_counter() - start, "silent": "numpy" not in sys.modules, "is": armwright.__version__}


def first_kernel() -> dict[str, object]:
    """The first result of `puma560`'s inverse dynamics, after the libraries are imported one by one."""
    parts = imported()
    start = time.perf_counter()
    import numpy as np

    import armwright as aw

    arm = aw.load("puma560")
    loaded = time.perf_counter()
    ramp = np.linspace(-1.0, 1.0, arm.n)
    tau = aw.compile(arm).inverse_dynamics(ramp, ramp, ramp)
    end = time.perf_counter()
    return {**parts, "load": loaded - start, "kernel": end - loaded, "tau": tau.tolist()}


def compile_kernel(name: str, arm: str) -> dict[str, object]:
    """Tracing and compiling a kernel, and a result of it."""
    from arms import random_states, timed_arm
    from rows_kernels import WORKS

    import armwright as aw

    model = timed_arm(arm)
    dyn = aw.compile(model)
    start = time.perf_counter()
    kernel = dyn.kernel(name)
    seconds = time.perf_counter() - start
    states = random_states(model, 1)
    result = kernel(*(states[key][0] for key in WORKS[name].inputs))
    return {"seconds": seconds, "operations": len(kernel.program.instructions), "result": result.tolist()}


def imported() -> dict[str, float]:
    """Seconds of each library's import, one behind the other.

    Pydantic imports most of itself for the first record that somebody declares, and looks for plugins in every package
    that is installed: that is in its number.
    """
    import importlib

    parts = {}
    for library in LIBRARIES:
        start = time.perf_counter()
        module = importlib.import_module(library)
        if library == "pydantic":
            module.create_model("Probe", number=float)(number=1.0)
        parts[library.split(".")[0]] = time.perf_counter() - start
    return parts


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
