"""The self-test of an exported C library: a program that compares it with vectors from the float reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright.export.c_function import CFunction
from armwright.export.c_header import comment
from armwright.kernels.c import REALS
from armwright.kernels.c_syntax import literal, port_names
from armwright.model import Model
from armwright.program import interpret

STATES = 5  # test vectors a function

#: Roundings that the tolerance of a test vector allows for, in units of the type's epsilon. Some hundreds of operations
#: stand between an input and a result; up to 8 were measured on the built-in arms.
ROUNDINGS = 64
_EPSILON = {"double": float(np.finfo(np.float64).eps), "float": float(np.finfo(np.float32).eps)}


def _vectors(
    arm: Model, function: CFunction, real: str
) -> list[tuple[list[np.ndarray], list[np.ndarray], list[float]]]:
    """(inputs, what the float reference gives, tolerance) of some random states.

    A tolerance is the larger of ROUNDINGS epsilons of the result and what a change of the inputs by as many epsilons
    does to it: a solution of equations loses as many digits as their condition number has.
    """
    random = np.random.default_rng(0)
    kind = np.float32 if real == "float" else np.float64
    part = ROUNDINGS * _EPSILON[real]

    def lost(result: np.ndarray) -> float:
        """Factor by which an error may be larger, from the condition of the inverted matrix."""
        return float(np.linalg.cond(result)) if function.form.signature.inverted else 1.0

    vectors = []
    for _ in range(STATES):
        inputs = [random.normal(size=port.shape).astype(kind).astype(float) for port in function.program.inputs]
        expected = list(function.form.evaluate(arm, *inputs))
        nudged = [np.stack([x * (1.0 + part * random.choice([-1.0, 1.0], x.shape)) for _ in range(8)]) for x in inputs]
        moved = interpret(function.program, *nudged)
        tolerances = [
            max(part * lost(e) * float(np.abs(e).max(initial=0.0)), part, float(np.abs(m - e).max(initial=0.0)))
            for e, m in zip(expected, moved if isinstance(moved, tuple) else (moved,), strict=True)
        ]
        vectors.append((inputs, expected, tolerances))
    return vectors


def _values(array: Any, real: str) -> str:
    return ", ".join(literal(float(value), REALS[real]) for value in np.ravel(array)) or "0"


def selftest(arm: Model, name: str, functions: Sequence[CFunction], real: str) -> str:
    """The program's text. It prints a line a function, and ends with 0 if all vectors are met, else with 1."""
    calls = [f"    failed += test_{each.short_name}();" for each in functions]
    parts = [
        comment(
            [
                f"Self-test of {name}.c: vectors from Armwright's float reference. Ends with 0 if all are met, else with 1."
            ]
        ),
        f'#include <math.h>\n#include <stdio.h>\n\n#include "{name}.h"',
        _CHECK.format(real=real, cast="(double)" if real == "float" else "", f="f" if real == "float" else ""),
        *(_test(arm, each, real) for each in functions),
        "\n".join(
            [
                *("int main(void)", "{", "    int failed = 0;", *calls),
                f'    printf("{name}: %s\\n", failed == 0 ? "ok" : "FAILED");',
                *("    return failed == 0 ? 0 : 1;", "}"),
            ]
        ),
    ]
    return "\n\n".join(parts) + "\n"


_CHECK = """\
/* The largest error, in units of its tolerance; infinite where a value is not finite. */
static {real} error_of(const {real} *found, const {real} *expected, int count, {real} tolerance)
{{
    {real} largest = 0.0{f};
    int k;
    for (k = 0; k < count; k++) {{
        const {real} error = fabs{f}(found[k] - expected[k]) / tolerance;
        if (!(error <= largest)) {{
            largest = error < INFINITY ? error : INFINITY;
        }}
    }}
    return largest;
}}

static int told(const char *name, {real} error)
{{
    const int good = error <= 1.0{f};
    printf("%-32s error %.3f of the tolerance: %s\\n", name, {cast}error, good ? "ok" : "FAILED");
    return good ? 0 : 1;
}}"""


def _test(arm: Model, function: CFunction, real: str) -> str:
    vectors = _vectors(arm, function, real)
    ports, names = (*function.program.inputs, *function.program.outputs), port_names(function.program)
    split = len(function.program.inputs)

    def table(kind: str, name: str, rows: Sequence[str], size: int) -> list[str]:
        lines = [f"    static const {kind} {name}[{STATES}][{size}] = {{"]
        return [*lines, *(f"        {{{row}}}," for row in rows), "    };"]

    lines = [f"static int test_{function.short_name}(void)", "{"]
    for k, port in enumerate(ports):
        rows = [_values((row[0] + row[1])[k], real) for row in vectors]
        lines += table(real, names[k] if k < split else f"{names[k]}_expected", rows, max(port.size, 1))
    tolerances = [_values(row[2], real) for row in vectors]
    lines += table(real, "tolerance", tolerances, len(ports) - split)
    lines += [f"    {real} {names[k]}[{max(ports[k].size, 1)}];" for k in range(split, len(ports))]
    lines += [
        f"    {real} worst = 0.0{'f' if real == 'float' else ''};",
        "    int k;",
        f"    for (k = 0; k < {STATES}; k++) {{",
    ]
    lines.append(f"        {real} error;")
    arrays = [f"{name}[k]" if k < split else name for k, name in enumerate(names)]
    lines.append(f"        {function.name}({', '.join(arrays)});")
    for k in range(split, len(ports)):
        wanted = f"{names[k]}, {names[k]}_expected[k], {ports[k].size}, tolerance[k][{k - split}]"
        lines += [f"        error = error_of({wanted});", "        worst = error > worst ? error : worst;"]
    return "\n".join([*lines, "    }", f'    return told("{function.short_name}", worst);', "}"])
