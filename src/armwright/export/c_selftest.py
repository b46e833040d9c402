"""Self-test of an exported C library: a program that compares it with the float reference and the compiled kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.export.c_arithmetic import FAULTS, TWO_ROUNDINGS
from armwright.export.c_function import CFunction
from armwright.export.c_header import comment
from armwright.kernels.c import REALS
from armwright.kernels.c_syntax import literal, port_names
from armwright.kernels.compiled import CompiledArm
from armwright.kernels.lowering import BITS_OF_LIBM
from armwright.model import Model
from armwright.program import interpret

STATES = 5  # test vectors a function, with a tolerance
EDGES = 3  # further ones of zeros of both signs and ones, of which only the bits are compared

#: Roundings that the tolerance of a test vector allows for, in units of the type's epsilon. Some hundreds of operations
#: stand between an input and a result; up to 8 were measured on the built-in arms.
ROUNDINGS = 64
_EPSILON = {"double": float(np.finfo(np.float64).eps), "float": float(np.finfo(np.float32).eps)}


@dataclass(frozen=True)
class Vectors:
    """Test vectors of one function: for each port an array with a row for each state.

    Attributes:
        inputs: STATES random states, then EDGES.   exact: results of the compiled kernel for all of them, or None where its bits
            are those of libm.
        reference: results of the float reference for the first STATES.   tolerances: (STATES, outputs) of those.
    """

    inputs: list[np.ndarray]
    exact: list[np.ndarray] | None
    reference: list[np.ndarray]
    tolerances: np.ndarray


def _vectors(arm: Model, function: CFunction, real: str, compiled: CompiledArm) -> Vectors:
    """Test vectors of a function."""
    random = np.random.default_rng(0)
    form, ports = function.form, function.program.inputs
    drawn = [random.normal(size=(STATES, *port.shape)).astype(compiled.dtype).astype(float) for port in ports]
    states = [[array[k] for array in drawn] for k in range(STATES)]
    reference = [form.evaluate(arm, *state) for state in states]
    tolerances = [
        _tolerances(function, state, expected, real, random) for state, expected in zip(states, reference, strict=True)
    ]
    edges = [random.choice([0.0, -0.0, 1.0, -1.0], (EDGES, *port.shape)) for port in ports]
    inputs = [np.concatenate(pair) for pair in zip(drawn, edges, strict=True)]
    exact = None
    if BITS_OF_LIBM.isdisjoint(function.program.operation_counts()):
        kernel = compiled.kernel(form.signature.name, *(a.name for a in form.optional), **dict(form.options))
        results = kernel(*(array.astype(compiled.dtype) for array in inputs))
        exact = list(results) if isinstance(results, tuple) else [results]
    return Vectors(inputs, exact, [np.stack(each) for each in zip(*reference, strict=True)], np.array(tolerances))


def _tolerances(
    function: CFunction,
    inputs: list[np.ndarray],
    expected: tuple[np.ndarray, ...],
    real: str,
    random: np.random.Generator,
) -> list[float]:
    """The larger of ROUNDINGS epsilons of each result and what a change of the inputs by as many epsilons does to it.

    A solution of equations loses as many digits as their condition number has.
    """
    part = ROUNDINGS * _EPSILON[real]
    nudged = [np.stack([x * (1.0 + part * random.choice([-1.0, 1.0], x.shape)) for _ in range(8)]) for x in inputs]
    moved = interpret(function.program, *nudged)
    tolerances = []
    for e, m in zip(expected, moved if isinstance(moved, tuple) else (moved,), strict=True):
        lost = float(np.linalg.cond(e)) if function.form.signature.inverted else 1.0
        rounded = part * lost * float(np.abs(e).max(initial=0.0))
        tolerances.append(max(rounded, part, float(np.abs(m - e).max(initial=0.0))))
    return tolerances


def selftest(arm: Model, name: str, functions: Sequence[CFunction], real: str) -> str:
    """The program's text. It prints a line on the arithmetic and one for each function; exit code 0 if all pass, else 1."""
    compiled = CompiledArm(arm, dtype=REALS[real].format.name)
    calls = [f"    failed += test_{each.short_name}(bits);" for each in functions]
    about = f"Self-test of {name}.c: vectors from Armwright's float reference, and the bits of its compiled kernels."
    faults = ",\n".join(f'        "{fault}"' for fault in FAULTS)
    parts = [
        comment([about, "Ends with 0 if all are met, else with 1."]),
        f'#include <math.h>\n#include <stdio.h>\n#include <string.h>\n\n#include "{name}.h"',
        _CHECK.format(
            real=real,
            cast="(double)" if real == "float" else "",
            f="f" if real == "float" else "",
            infinity=REALS[real].infinity,
        ),
        *(_test(arm, each, real, compiled) for each in functions),
        _MAIN.format(name=name, faults=faults, two_roundings=TWO_ROUNDINGS, calls="\n".join(calls)),
    ]
    return "\n\n".join(parts) + "\n"


_CHECK = """\
/* The largest error, in units of its tolerance; infinite where a value is not finite. */
static {real} error_of(const {real} *result, const {real} *expected, int count, {real} tolerance)
{{
    {real} largest = 0.0{f};
    int k;
    for (k = 0; k < count; k++) {{
        const {real} error = fabs{f}(result[k] - expected[k]) / tolerance;
        if (!(error <= largest)) {{
            largest = error < {infinity} ? error : {infinity};
        }}
    }}
    return largest;
}}

/* Number of results with other bits; one NaN is as good as another. */
static int other_bits(const {real} *result, const {real} *expected, int count)
{{
    int k, others = 0;
    for (k = 0; k < count; k++) {{
        others += memcmp(&result[k], &expected[k], sizeof result[k]) != 0 && !(isnan(result[k]) && isnan(expected[k]));
    }}
    return others;
}}

/* Prints a line and returns 1 for a failure; `others` is -1 where bits are not compared. */
static int report(const char *name, {real} error, int others)
{{
    const int good = error <= 1.0{f} && others <= 0;
    printf("%-32s error %.3f of the tolerance, ", name, {cast}error);
    if (others < 0) {{
        printf("bits not compared: ");
    }} else {{
        printf("%d results with other bits: ", others);
    }}
    printf("%s\\n", good ? "ok" : "FAILED");
    return good ? 0 : 1;
}}"""

_MAIN = """\
int main(void)
{{
    static const char *const faults[] = {{
{faults}}};
    const int fault = {name}_arithmetic(), bits = fault != {two_roundings};
    int failed = fault != 0 && bits;
    printf("%-32s %s%s\\n", "arithmetic", faults[fault], failed == 0 ? "" : ": FAILED");
{calls}
    printf("{name}: %s\\n", failed == 0 ? "ok" : "FAILED");
    return failed == 0 ? 0 : 1;
}}"""


def _test(arm: Model, function: CFunction, real: str, compiled: CompiledArm) -> str:
    """One function's test: its tables, then a loop over the states."""
    vectors = _vectors(arm, function, real, compiled)
    ports, names = (*function.program.inputs, *function.program.outputs), port_names(function.program)
    split = len(function.program.inputs)
    results = range(split, len(ports))
    lines = [f"static int test_{function.short_name}(int bits)", "{"]
    for k, rows in enumerate(vectors.inputs):
        lines += _table(real, names[k], rows)
    for k in results:
        lines += _table(real, f"{names[k]}_reference", vectors.reference[k - split])
        if vectors.exact is not None:
            lines += _table(real, f"{names[k]}_exact", vectors.exact[k - split])
    lines += _table(real, "tolerance", vectors.tolerances)
    lines += [f"    {real} {names[k]}[{max(ports[k].size, 1)}];" for k in results]
    lines += [f"    {real} error, worst = 0.0{'f' if real == 'float' else ''};", "    int k;"]
    lines.append(f"    int others = {-1 if vectors.exact is None else 0};")
    lines.append(f"    for (k = 0; k < {STATES + EDGES}; k++) {{")
    arrays = [f"{name}[k]" if k < split else name for k, name in enumerate(names)]
    lines.append(f"        {function.name}({', '.join(arrays)});")
    if vectors.exact is not None:
        lines += [f"        others += other_bits({names[k]}, {names[k]}_exact[k], {ports[k].size});" for k in results]
    lines.append(f"        if (k < {STATES}) {{")
    for k in results:
        wanted = f"{names[k]}, {names[k]}_reference[k], {ports[k].size}, tolerance[k][{k - split}]"
        lines += [f"            error = error_of({wanted});", "            worst = error > worst ? error : worst;"]
    end = f'    return report("{function.short_name}", worst, bits ? others : -1);'
    return "\n".join([*lines, "        }", "    }", end, "}"])


def _table(real: str, name: str, rows: Any) -> list[str]:
    """A constant array of arrays: one row a state."""
    texts = [", ".join(literal(float(value), REALS[real]) for value in np.ravel(row)) or "0" for row in rows]
    lines = [f"    static const {real} {name}[{len(texts)}][{max(np.size(rows[0]), 1)}] = {{"]
    return [*lines, *(f"        {{{text}}}," for text in texts), "    };"]
