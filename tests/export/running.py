"""A short loop to export, and programs around its C."""

from __future__ import annotations

import subprocess

import armwright as aw
from export.controllers import swinging
from kernels.c_compilers import BITS, build, compiler
from physics.arms import arm


def pid_loop(model=None, **changes):
    """A scenario of a short loop."""
    model = model or arm("two-link")
    loop = {"controller": aw.JointPID(kp=20.0, kd=2.0, ki=5.0), "reference": swinging(model, 0.3, 1.0), "period": 1e-3}
    return aw.Scenario(model, duration=0.2, loop=aw.Loop(**{**loop, **changes}))


def run_c(folder, name, body, *flags):
    """The words that a program around an exported controller prints: `body` stands in main, behind `state`, `y`, `r` and `u`."""
    types = (
        f"static {name}_state state; static {name}_measurement y; static {name}_reference r; static {name}_command u;"
    )
    call = f"#define STEP {name}_step(&state, &{name}_default_parameters, &r, &y, &u)\n"
    heads = f'#include <math.h>\n#include <stdio.h>\n#include <string.h>\n#include "{name}.h"\n{call}'
    used = "(void)state, (void)y, (void)r, (void)u;"
    main = f"{heads}int main(void)\n{{\n    {types}\n    {used}\n{body}\n    return 0;\n}}\n"
    (folder / "main.c").write_text(main, encoding="ascii")
    build(
        [
            compiler("gcc"),
            *BITS,
            "-Wall",
            "-Werror",
            *flags,
            folder / f"{name}.c",
            folder / "main.c",
            "-o",
            folder / "main",
            "-lm",
        ]
    )
    done = subprocess.run([folder / "main"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()
