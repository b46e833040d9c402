"""Program → C99. The functions of one file, with what they need before them: no allocation, no library beyond <math.h>.

The text is one sequence of IEEE operations, the one that LLVM is given too: in double it has the bits of the compiled
kernels wherever fma() rounds once, floating point is not contracted and libm is the same (it is called for angles beyond
2^20 rad, and for the few operations that have no polynomial of ours).
"""

from __future__ import annotations

from collections.abc import Iterable

from armwright.kernels.c_machine import C_DOUBLE, C_FLOAT, Dialect, Unit, identifier, parameters
from armwright.program import Program

REALS: dict[str, Dialect] = {"double": C_DOUBLE, "float": C_FLOAT}

# What a compiler must not do, in its own words: GCC ignores the standard's pragma and contracts by default outside of
# its ISO modes, the others know it. x87 registers round twice.
_RULES = """\
#if defined(__FAST_MATH__)
#error "-ffast-math breaks this code: it relies on the rules of IEEE 754"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "compile with -msse2 -mfpmath=sse: x87 rounds twice"
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif
"""

# Through memcpy, which compilers make a move of a register; a pointer of another type would break the aliasing rules.
_BITS = {
    "bits_of": """\
static uint64_t {prefix}bits_of(double x)
{{
    uint64_t i;
    memcpy(&i, &x, sizeof i);
    return i;
}}
""",
    "from_bits": """\
static double {prefix}from_bits(uint64_t i)
{{
    double x;
    memcpy(&x, &i, sizeof x);
    return x;
}}
""",
    # GCC makes one instruction of -fma(a, b, c) that gives +0 where this gives -0; other compilers keep it as it is.
    "negated": """\
static double {prefix}negated(double x)
{{
#if defined(__GNUC__) && !defined(__clang__)
    uint64_t i;
    memcpy(&i, &x, sizeof i);
    i ^= UINT64_C(0x8000000000000000);
    memcpy(&x, &i, sizeof x);
    return x;
#else
    return -x;
#endif
}}
""",
}


def c_text(unit: Unit, include: Iterable[str] = ()) -> str:
    """The C99 file of a unit: what it includes, the rules for the compiler, its functions."""
    helpers = [text.format(prefix=unit.prefix) for name, text in _BITS.items() if unit.uses(name)]
    headers = [*include, "<float.h>", "<math.h>", *(("<stdint.h>", "<string.h>") if helpers else ())]
    includes = "".join(f"#include {name}\n" for name in headers)
    return "\n".join([includes, _RULES, *helpers, *(f"{text}\n" for text in unit.functions.values())])


def c_source(program: Program, real: str = "double") -> str:
    """One program as a C99 file whose one function has its name: `void name(const real in0[…], …, real out0[…], …)`.

    Args:
        program: what is printed.   real: "double" or "float".
    Returns:
        text: the file. Arrays are row-major and may overlap.
    """
    name = identifier(program.name)
    unit = Unit(REALS[real], f"{name}_")
    unit.add_function(program, name, f"void {name}({parameters(program, real)})")
    return c_text(unit)
