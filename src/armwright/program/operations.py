"""The table of operations: one row for every scalar (SX) operation of the installed CasADi, and our three fused ones.

A traced function is a list of these operations, by name; every back end (NumPy, LLVM, C, CUDA) is tested against this
table. The column `numpy` *defines* an operation on float arrays, `ulp` says how close back ends stay to it.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np


@dataclass(frozen=True)
class Operation:
    """One operation on doubles.

    Attributes:
        name: CasADi's name without `OP_`.
        arity: number of arguments; for structural rows the number of values they read.
        numpy: the meaning on float arrays (comparisons give 1.0 or 0.0); None where the row is structural, that is,
            moves values instead of computing one.
        ulp: 0 where the IEEE result is exact and the same in every back end (the payload of a NaN excepted), otherwise
            the largest distance that back ends keep from the correctly rounded value [ulp].
        doc: one line of meaning.
    """

    name: str
    arity: int
    numpy: Callable[..., np.ndarray] | None
    ulp: float
    doc: str

    @property
    def structural(self) -> bool:
        """True if the row moves values instead of computing one."""
        return self.numpy is None


def _truth(relation):
    """The relation as C computes with it: 1.0 where it holds, 0.0 where it does not."""
    return lambda *values: np.where(relation(*values), 1.0, 0.0)


def _identity(a, *_):
    return np.array(a, dtype=float)


def _sign(a):
    return np.where(np.less(a, 0.0), -1.0, np.where(np.greater(a, 0.0), 1.0, a))


def _minimum(a, b):
    return np.where(np.less(a, b) | np.isnan(a), a, b)


def _maximum(a, b):
    return np.where(np.greater(a, b) | np.isnan(a), a, b)


def _if_else_zero(condition, a):
    return np.where(np.not_equal(condition, 0.0), a, 0.0)


def _erf(a):
    from scipy import special  # slow to import, and nothing else here needs it

    return special.erf(a)


def _erfinv(a):
    from scipy import special

    return np.copysign(special.erfinv(a), a)  # SciPy's loses the sign of -0


@functools.partial(np.vectorize, otypes=[float])
def _remainder(a, b):
    if math.isnan(a) or math.isnan(b) or math.isinf(a) or b == 0.0:
        return math.nan  # where math.remainder raises
    return math.remainder(a, b)


@functools.partial(np.vectorize, otypes=[float])
def _fma(a, b, c):
    a, b, c = float(a), float(b), float(c)
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        # A product of finite numbers must not overflow to an infinity that then meets c = ±inf.
        finite_product = math.isfinite(a) and math.isfinite(b)
        return c if finite_product else a * b + c
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    if exact == 0:
        return 0.0 if a != 0.0 and b != 0.0 else a * b + c  # IEEE 754 section 6.3: the sign of an exact zero
    try:
        return float(exact)
    except OverflowError:
        return math.inf if exact > 0 else -math.inf


#: What every libm that we run on keeps; glibc is within 2.
_LIBM = 4.0

_ROWS = (
    Operation("ASSIGN", 1, _identity, 0.0, "a"),
    Operation("ADD", 2, np.add, 0.0, "a + b"),
    Operation("SUB", 2, np.subtract, 0.0, "a - b"),
    Operation("MUL", 2, np.multiply, 0.0, "a b"),
    Operation("DIV", 2, np.divide, 0.0, "a / b"),
    Operation("NEG", 1, np.negative, 0.0, "-a"),
    Operation("EXP", 1, np.exp, 2.0, "e to the a"),
    Operation("LOG", 1, np.log, 2.0, "natural logarithm; -inf at 0, NaN below"),
    Operation("POW", 2, np.power, _LIBM, "a to the b"),
    Operation("CONSTPOW", 2, np.power, _LIBM, "a to the b, b the same in every lane"),
    Operation("SQRT", 1, np.sqrt, 0.0, "square root; NaN below 0"),
    Operation("SQ", 1, np.square, 0.0, "a a"),
    Operation("TWICE", 1, lambda a: np.add(a, a), 0.0, "a + a"),
    Operation("SIN", 1, np.sin, 2.0, "sine, 2 ulp for |a| <= 2^20, libm beyond"),
    Operation("COS", 1, np.cos, 2.0, "cosine, 2 ulp for |a| <= 2^20, libm beyond"),
    Operation("TAN", 1, np.tan, 2.0, "tangent, 2 ulp for |a| <= 2^20, libm beyond"),
    Operation("ASIN", 1, np.arcsin, _LIBM, "inverse sine"),
    Operation("ACOS", 1, np.arccos, _LIBM, "inverse cosine"),
    Operation("ATAN", 1, np.arctan, 2.0, "inverse tangent"),
    Operation("LT", 2, _truth(np.less), 0.0, "a < b; false with NaN"),
    Operation("LE", 2, _truth(np.less_equal), 0.0, "a <= b; false with NaN"),
    Operation("EQ", 2, _truth(np.equal), 0.0, "a == b; false with NaN"),
    Operation("NE", 2, _truth(np.not_equal), 0.0, "a != b; true with NaN"),
    Operation("NOT", 1, _truth(lambda a: np.equal(a, 0.0)), 0.0, "1 where a is zero; NaN counts as true, as in C"),
    Operation("AND", 2, _truth(lambda a, b: np.not_equal(a, 0.0) & np.not_equal(b, 0.0)), 0.0, "both are not zero"),
    Operation("OR", 2, _truth(lambda a, b: np.not_equal(a, 0.0) | np.not_equal(b, 0.0)), 0.0, "one is not zero"),
    Operation("FLOOR", 1, np.floor, 0.0, "largest integer <= a"),
    Operation("CEIL", 1, np.ceil, 0.0, "smallest integer >= a"),
    Operation("FMOD", 2, np.fmod, 0.0, "a - b trunc(a / b), exact, with the sign of a (C fmod)"),
    Operation("FABS", 1, np.abs, 0.0, "|a|"),
    Operation("SIGN", 1, _sign, 0.0, "-1 or 1; a itself where a is ±0 or NaN"),
    Operation("COPYSIGN", 2, np.copysign, 0.0, "|a| with the sign bit of b"),
    Operation("IF_ELSE_ZERO", 2, _if_else_zero, 0.0, "b where a is not zero (NaN is not), else 0 whatever b is"),
    Operation("ERF", 1, _erf, _LIBM, "error function"),
    Operation("FMIN", 2, _minimum, 0.0, "a if a < b or a is NaN, else b: NaN propagates; of two equal zeros, b"),
    Operation("FMAX", 2, _maximum, 0.0, "a if a > b or a is NaN, else b: NaN propagates; of two equal zeros, b"),
    Operation("INV", 1, lambda a: np.divide(1.0, a), 0.0, "1 / a"),
    Operation("SINH", 1, np.sinh, _LIBM, "hyperbolic sine"),
    Operation("COSH", 1, np.cosh, _LIBM, "hyperbolic cosine"),
    Operation("TANH", 1, np.tanh, 2.0, "hyperbolic tangent"),
    Operation("ASINH", 1, np.arcsinh, _LIBM, "inverse hyperbolic sine"),
    Operation("ACOSH", 1, np.arccosh, _LIBM, "inverse hyperbolic cosine"),
    Operation("ATANH", 1, np.arctanh, _LIBM, "inverse hyperbolic tangent"),
    Operation("ATAN2", 2, np.arctan2, 2.0, "angle of the point (b, a), all quadrants and signed zeros as in C"),
    Operation("CONST", 0, None, 0.0, "a number of the program"),
    Operation("INPUT", 0, None, 0.0, "one scalar of one input"),
    Operation("OUTPUT", 1, None, 0.0, "store into one scalar of one output"),
    Operation("PARAMETER", 0, None, 0.0, "a free symbol, which a complete program does not have"),
    Operation("CALL", 0, None, 0.0, "call of another program; as many arguments and results as that one has"),
    Operation("ERFINV", 1, _erfinv, _LIBM, "inverse error function; ±inf at ±1, NaN outside"),
    Operation("PRINTME", 2, _identity, 0.0, "a (printing is not compiled)"),
    Operation("LIFT", 2, _identity, 0.0, "a (b is an initial guess for lifted Newton methods)"),
    Operation("LOG1P", 1, np.log1p, _LIBM, "log(1 + a)"),
    Operation("EXPM1", 1, np.expm1, 2.0, "exp(a) - 1"),
    Operation("HYPOT", 2, np.hypot, 2.0, "sqrt(a a + b b) without overflow on the way"),
    Operation("REMAINDER", 2, _remainder, 0.0, "a - b n, n the integer nearest a / b, ties to even (C remainder)"),
    Operation("FMA", 3, _fma, 0.0, "a b + c, rounded once"),
    Operation("FMS", 3, lambda a, b, c: _fma(a, b, np.negative(c)), 0.0, "a b - c, rounded once"),
    Operation("FNMA", 3, lambda a, b, c: _fma(np.negative(a), b, c), 0.0, "c - a b, rounded once"),
)

#: Our additional rows: from the pass `fused_products`, never from CasADi.
FUSED = ("FMA", "FMS", "FNMA")

OPERATIONS: dict[str, Operation] = {row.name: row for row in _ROWS}


@functools.cache
def _codes() -> dict[int, Operation]:
    import casadi

    return {getattr(casadi, f"OP_{name}"): row for name, row in OPERATIONS.items() if name not in FUSED}


def by_code(code: int) -> Operation:
    """The row of CasADi's operation number `code`; `KeyError` for a matrix (MX) operation, which has none."""
    return _codes()[code]
