"""Runtime test in every exported C file: IEEE 754 arithmetic, on which its bits rest.

A compiler shows only some of its unsafe options by macros, which `kernels.c` refuses. Others let it replace an expression by
one that only real numbers equal; an optimising compiler then finds both to have the same bits, and calls a function that it
must not call. The remaining options change bits when the code runs.
"""

from __future__ import annotations

import numpy as np

from armwright.kernels.c import REALS
from armwright.kernels.c_syntax import literal

#: Values of the function, in its order, and what they mean.
FAULTS = (
    "ok",
    "a product and a sum were contracted to one operation: compile with -ffp-contract=off",
    "subnormal numbers are flushed to zero: neither link with -ffast-math nor set such a mode of the processor",
    "fma() rounds twice: the functions are right, but have other bits than Armwright's kernels",
)
TWO_ROUNDINGS = FAULTS.index(FAULTS[-1])

# Both sides of a pair are equal for real numbers and differ for some floating-point numbers.
_UNSAFE = """\
#if defined(__GNUC__) && defined(__has_attribute)
#if __has_attribute(error)
extern void {name}_unsafe(void) __attribute__((error("an unsafe floating-point option, such as -fassociative-math, is on")));
#define {macro}_UNSAFE(truth) {{ const int known = truth; if (__builtin_constant_p(known)) {{ {name}_unsafe(); }} }}
#endif
#endif
#if !defined({macro}_UNSAFE)
#define {macro}_UNSAFE(truth)
#endif
int {name}_arithmetic(void)
{{
    const volatile {real} numbers[3] = {{{one}, {epsilon}, {least}}};
    const {real} last = numbers[1], x = numbers[0] + last, square = x * x, rounded = x + last;
    {macro}_UNSAFE({name}_bits_of((x + {one}) - {one}) == {name}_bits_of(x)) /* -fassociative-math */
    {macro}_UNSAFE({name}_bits_of(x + {zero}) == {name}_bits_of(x)) /* -fno-signed-zeros */
    {macro}_UNSAFE({name}_bits_of(x / {three}) == {name}_bits_of(x * {third})) /* -freciprocal-math */
    {macro}_UNSAFE(x != x) /* -fno-honor-nans */
    if (square - rounded != {zero}) {{
        return 1;
    }}
    if (!(numbers[2] * {half} > {zero})) {{
        return 2;
    }}
    return fma{suffix}(x, x, -rounded) > {zero} ? 0 : 3; /* x x = 1 + 2 e + e e, and 1 + 2 e when it is rounded */
}}"""


def arithmetic(name: str, real: str) -> str:
    """The text of `int NAME_arithmetic(void)`: returns 0, or the number of the violated IEEE 754 rule."""
    dialect = REALS[real]
    precision = np.finfo(dialect.format.dtype)
    numbers = {"zero": 0.0, "half": 0.5, "one": 1.0, "three": 3.0, "third": 1.0 / 3.0}
    numbers |= {"epsilon": float(precision.eps), "least": float(precision.tiny)}
    literals = {word: literal(number, dialect) for word, number in numbers.items()}
    return _UNSAFE.format(name=name, macro=name.upper(), real=real, suffix=dialect.format.suffix, **literals)
