"""Program → C99. The functions of one file, with what they need before them: no allocation, no library beyond <math.h>.

The text is one sequence of IEEE operations, the one that LLVM is given too: it has the bits of the compiled
kernels of its format wherever fma() rounds once, floating point is not contracted and libm is the same (it is called for
angles beyond 2^20 rad, in float 2^17, and for the few operations that have no polynomial of ours).
"""

from __future__ import annotations

from collections.abc import Iterable

from armwright.kernels.c_syntax import C_DOUBLE, C_FLOAT, Dialect, identifier, parameters
from armwright.kernels.c_unit import Unit
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

# A long program is cut into functions for the compiler's sake; put back into one they would take it minutes.
_APART = """\
#if defined(__GNUC__)
#define APART __attribute__((noinline))
#else
#define APART
#endif
"""

# Through memcpy, which compilers make a move of a register; a pointer of another type would break the aliasing rules.
_BITS = {
    "bits_of": """\
static {integer} {prefix}bits_of({real} x)
{{
    {integer} i;
    memcpy(&i, &x, sizeof i);
    return i;
}}
""",
    "from_bits": """\
static {real} {prefix}from_bits({integer} i)
{{
    {real} x;
    memcpy(&x, &i, sizeof x);
    return x;
}}
""",
    # GCC makes one instruction of -fma(a, b, c) that gives +0 where this gives -0; other compilers keep it as it is.
    "negated": """\
static {real} {prefix}negated({real} x)
{{
#if defined(__GNUC__) && !defined(__clang__)
    {integer} i;
    memcpy(&i, &x, sizeof i);
    i ^= {sign};
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
    dialect = unit.dialect
    words = {
        "real": dialect.real,
        "integer": dialect.integer,
        "sign": dialect.literal.format(1 << (dialect.format.bits - 1)),
    }
    helpers = [text.format(prefix=unit.prefix, **words) for name, text in _BITS.items() if unit.uses(name)]
    functions = list(unit.functions.values())
    apart = [_APART] if any(text.startswith(unit.dialect.apart) for text in functions) else []
    headers = [*include, "<float.h>", "<math.h>"]
    headers += ["<stdint.h>"] * bool(helpers) + ["<string.h>"] * bool(helpers or apart)
    includes = "".join(f"#include {name}\n" for name in headers)
    return "\n".join([includes, _RULES, *apart, *helpers, *(f"{text}\n" for text in functions)])


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
