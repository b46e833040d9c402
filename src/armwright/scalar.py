"""One call for floats, arrays and traced symbols: the arithmetic that all physics in Armwright is written in.

A `Symbol` is one scalar of a computation that is being traced; arrays of them have `dtype=object`. With floats these
functions are NumPy's; with Symbols they record the operation. Physics calls `scalar.sin(x)`, never `math.sin` or
`np.where`, so the same lines are the readable reference and the source of the compiled kernels.

NaN goes through every function, `clip`, `minimum` and `maximum` included: a limit never hides a diverged value.
"""

from __future__ import annotations

import math
import numbers
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from armwright.errors import SymbolError

Scalar = Any  # float | Symbol
Array = Any  # np.ndarray of float or of object, or a scalar


class Symbol:
    """One scalar of a traced computation: a thin wrapper of one CasADi SX scalar that behaves inside NumPy arrays.

    A bare SX must never enter an array: `np.zeros(3)[0] = sx` silently gives NaN and `array * sx` becomes a matrix.
    """

    __slots__ = ("sx",)

    def __init__(self, sx: Any):
        self.sx = sx

    @classmethod
    def named(cls, name: str) -> Symbol:
        """A fresh symbol of that name."""
        return cls(casadi.SX.sym(name))

    def __repr__(self) -> str:
        return f"Symbol({self.sx})"

    # Operators return NotImplemented for arrays, so that NumPy maps them over the elements.

    # Most operands of a recursion along an arm are 0 or 1. What CasADi makes of these is known without asking it.

    def __add__(self, other):
        return _sum(self, _as_symbol(other))

    def __radd__(self, other):
        return _sum(_as_symbol(other), self)

    def __sub__(self, other):
        other = _as_symbol(other)
        return self if other is ZERO else _binary(casadi.OP_SUB, self, other)

    def __rsub__(self, other):
        return _binary(casadi.OP_SUB, _as_symbol(other), self)

    def __mul__(self, other):
        return _product(self, _as_symbol(other))

    def __rmul__(self, other):
        return _product(_as_symbol(other), self)

    def __truediv__(self, other):
        return _binary(casadi.OP_DIV, self, _as_symbol(other))

    def __rtruediv__(self, other):
        return _binary(casadi.OP_DIV, _as_symbol(other), self)

    def __pow__(self, other):
        return _binary(casadi.OP_POW, self, _as_symbol(other))

    def __neg__(self):
        return Symbol(-self.sx)

    def __pos__(self):
        return self

    def __abs__(self):
        return Symbol(casadi.fabs(self.sx))

    def __float__(self):
        raise _misuse("a float array or math.* cannot hold", "armwright.scalar functions and object arrays")

    def __bool__(self):
        raise _misuse("a branch on", "scalar.where(condition, a, b)")

    def __lt__(self, other):
        raise _misuse("a comparison of", "scalar.less(a, b)")

    __le__ = __gt__ = __ge__ = __lt__

    def __eq__(self, other):
        raise _misuse("a comparison of", "scalar.equal(a, b)")

    __ne__ = __eq__
    __hash__ = None  # type: ignore[assignment]


ZERO, ONE = Symbol(casadi.SX(0.0)), Symbol(casadi.SX(1.0))
MOST_CONSTANTS = 10_000  # that are remembered: those of a few arms
_constants: dict[float, Symbol] = {}


def _as_symbol(value: Any) -> Any:
    """A number as a symbol; NotImplemented for what is none. CasADi has one zero, so -0 is `ZERO` too."""
    if type(value) is Symbol:
        return value
    if not isinstance(value, (float, int, np.floating, np.integer)):
        return NotImplemented
    number = float(value)
    known = _constants.get(number)
    if known is None:
        if len(_constants) >= MOST_CONSTANTS:
            _constants.clear()
        known = ZERO if number == 0.0 else ONE if number == 1.0 else Symbol(casadi.SX(number))
        _constants[number] = known
    return known


def _sum(a: Any, b: Any) -> Any:
    if a is ZERO or b is NotImplemented:
        return b
    return a if b is ZERO or a is NotImplemented else _binary(casadi.OP_ADD, a, b)


def _product(a: Any, b: Any) -> Any:
    if a is NotImplemented or b is NotImplemented:
        return NotImplemented
    if a is ZERO or b is ZERO:
        return ZERO
    return b if a is ONE else a if b is ONE else _binary(casadi.OP_MUL, a, b)


def _binary(operation: int, a: Any, b: Any) -> Any:
    """SX.binary, because CasADi's own operators try every type they know before they add: seven times as slow."""
    if a is NotImplemented or b is NotImplemented:
        return NotImplemented
    return Symbol(casadi.SX.binary(operation, a.sx, b.sx))


def _misuse(use: str, instead: str) -> SymbolError:
    """The error of a symbol used as a number, at the line that did so."""
    frame = sys._getframe(2)
    file = f"{frame.f_code.co_filename}:{frame.f_lineno}"
    return SymbolError(f"{use} a traced symbol, whose value is not known yet", file=file, expected=instead)


for _name, _function in {  # methods that NumPy's functions call on the elements of an object array
    **{name: getattr(casadi, name) for name in ("sin", "cos", "tan", "sqrt", "exp", "log", "tanh", "floor", "ceil")},
    "arctan2": casadi.atan2,
    "hypot": casadi.hypot,
    "fmod": casadi.fmod,
}.items():
    setattr(Symbol, _name, lambda self, *other, _f=_function: _lift(_f, self, *other))


def _lift(function: Callable[..., Any], *values: Scalar) -> Symbol:
    return Symbol(function(*(v.sx if isinstance(v, Symbol) else float(v) for v in values)))


def is_symbolic(*values: Array) -> bool:
    """True if any of the values is a Symbol or an array that holds one."""
    return any(
        isinstance(v, Symbol)
        or (isinstance(v, np.ndarray) and v.dtype == object and any(isinstance(entry, Symbol) for entry in v.flat))
        for v in values
    )


def _of_libm(number: Callable[..., Any], libm: Callable[..., float], count: int = 1) -> Callable[..., Any]:
    """NumPy's function of `count` values, computed by the C library's: NumPy's own has other last bits with AVX-512.

    What is computed here becomes constants of programs and models, whose bits are the same on every processor.
    """

    def one(*values: Any) -> float:
        try:
            return libm(*values)
        except (OverflowError, ValueError):  # beyond the function's range, where NumPy says inf or NaN
            with np.errstate(all="ignore"):
                return number(*values)

    every = np.frompyfunc(one, count, 1)
    return lambda *values: np.asarray(every(*values), dtype=float)[()]


def _elementwise(number: Callable[..., Any], symbol: Callable[..., Any], name: str, doc: str) -> Callable[..., Any]:
    """A function of one or more values that is `number` (NumPy) on floats and records `symbol` (CasADi) on Symbols."""

    def one(*values: Scalar) -> Scalar:
        if any(isinstance(v, Symbol) for v in values):
            return _lift(symbol, *values)
        return number(*(float(v) for v in values))

    lifted = {count: np.frompyfunc(one, count, 1) for count in (1, 2, 3)}

    def function(*values: Array) -> Array:
        if not any(isinstance(v, Symbol) or (isinstance(v, np.ndarray) and v.dtype == object) for v in values):
            return number(*values)
        return lifted[len(values)](*values)

    function.__name__ = function.__qualname__ = name
    function.__doc__ = doc
    return function


sin = _elementwise(np.sin, casadi.sin, "sin", "Sine of an angle [rad].")
cos = _elementwise(np.cos, casadi.cos, "cos", "Cosine of an angle [rad].")
tan = _elementwise(_of_libm(np.tan, math.tan), casadi.tan, "tan", "Tangent of an angle [rad].")
sqrt = _elementwise(np.sqrt, casadi.sqrt, "sqrt", "Square root.")
exp = _elementwise(_of_libm(np.exp, math.exp), casadi.exp, "exp", "Exponential.")
log = _elementwise(_of_libm(np.log, math.log), casadi.log, "log", "Natural logarithm.")
tanh = _elementwise(np.tanh, casadi.tanh, "tanh", "Hyperbolic tangent.")
atan2 = _elementwise(
    _of_libm(np.arctan2, math.atan2, 2),
    casadi.atan2,
    "atan2",
    "Angle [rad] of the point (x, y), called as atan2(y, x).",
)
hypot = _elementwise(np.hypot, casadi.hypot, "hypot", "√(x² + y²).")
abs = _elementwise(np.abs, casadi.fabs, "abs", "Absolute value.")
sign = _elementwise(np.sign, casadi.sign, "sign", "−1, 0 or 1 with the sign of the value.")
floor = _elementwise(np.floor, casadi.floor, "floor", "Largest whole number not above the value.")
ceil = _elementwise(np.ceil, casadi.ceil, "ceil", "Smallest whole number not below the value.")
fmod = _elementwise(np.fmod, casadi.fmod, "fmod", "Remainder with the sign of the dividend.")
minimum = _elementwise(np.minimum, casadi.fmin, "minimum", "The smaller of two values; NaN if either is.")
maximum = _elementwise(np.maximum, casadi.fmax, "maximum", "The larger of two values; NaN if either is.")
less = _elementwise(lambda a, b: np.less(a, b) * 1.0, casadi.lt, "less", "1.0 where a < b, else 0.0.")
less_equal = _elementwise(lambda a, b: np.less_equal(a, b) * 1.0, casadi.le, "less_equal", "1.0 where a ≤ b, else 0.0.")
equal = _elementwise(lambda a, b: np.equal(a, b) * 1.0, casadi.eq, "equal", "1.0 where a = b, else 0.0.")
where = _elementwise(
    lambda condition, a, b: np.where(condition, a, b),
    casadi.if_else,
    "where",
    "a where the condition is not 0, else b; both are computed.",
)


def round(value: Array) -> Array:
    """Nearest whole number, halves upward (unlike NumPy's halves to even: CasADi has no such operation)."""
    return floor(value + 0.5)


def clip(value: Array, lowest: Array, highest: Array) -> Array:
    """The value limited to an interval; NaN stays NaN."""
    return minimum(maximum(value, lowest), highest)


def array(nested: Any) -> np.ndarray:
    """An array of floats where all entries are numbers, of objects where one is a Symbol. Shape from the nesting."""
    entries = np.array(nested, dtype=object)
    if any(isinstance(entry, Symbol) for entry in entries.flat):
        return entries
    return entries.astype(float)


def real_numbers(value: Any, dtype: Any = float) -> np.ndarray:
    """An array of numbers of one type from a user's number, array, or lists of numbers.

    Args:
        value: real numbers of any type.   dtype: NumPy's type of the result.
    Raises:
        ValueError: text, dates, complex numbers, other objects, a masked entry, rows of unequal length, a number beyond the
            range of floats.
    """
    if has_masked_entries(value):
        raise ValueError("masked entries")  # NumPy would take what lies under the mask
    try:
        entries = np.asarray(value)
    except (TypeError, RecursionError):  # a list in a list in a list, or one that holds itself
        raise ValueError("lists too deep") from None
    if entries.dtype.kind not in "fiub":
        raise ValueError(
            "a whole number beyond the largest float" if _holds_whole(entries) else f"of type {entries.dtype}"
        )
    with np.errstate(over="ignore"):  # of NumPy's longer floats: infinite
        return entries.astype(dtype, copy=False)


def numbers_or_nan(value: Any) -> np.ndarray:
    """An array as of `real_numbers`; of what is none a NaN without axes, which a check of shape and numbers refuses."""
    try:
        return real_numbers(value)
    except ValueError:
        return np.full((), np.nan)


def has_masked_entries(value: Any) -> bool:
    """True for a masked array that hides an entry, and for a list of such."""
    if "numpy.ma" not in sys.modules:  # nobody has made one; its import would take as long as compiling a small kernel
        return False
    parts = value if isinstance(value, (list, tuple)) else [value]
    return any(np.ma.isMaskedArray(part) and bool(np.ma.getmaskarray(part).any()) for part in parts)


def real_number(value: Any) -> float | None:
    """A number of any type as a float; None if the value is no real number, or beyond the range of floats."""
    if isinstance(value, (bool, np.bool_, np.timedelta64)) or not isinstance(value, numbers.Real):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def _holds_whole(entries: np.ndarray) -> bool:
    """True for an array of Python's whole numbers, which NumPy leaves as they are when they have too many digits."""
    return entries.dtype == object and entries.size > 0 and all(type(entry) is int for entry in entries.flat)


def zeros(*shape: int) -> np.ndarray:
    """Zeros to be filled with numbers or Symbols; hand the filled array to `array` before returning it."""
    filled = np.empty(shape, dtype=object)
    filled.fill(np.float64(0.0))  # not Python's 0.0, whose division by zero raises instead of giving inf
    return filled


def eye(size: int) -> np.ndarray:
    """The unit matrix, to be computed with (or filled, as `zeros`)."""
    unit = zeros(size, size)
    for k in range(size):
        unit[k, k] = np.float64(1.0)
    return unit


def stack(rows: Any, axis: int = 0) -> np.ndarray:
    """Rows (or columns, axis=1) put together into one array; `array` for pieces that are arrays themselves."""
    return array(np.stack([np.asarray(row, dtype=object) for row in rows], axis=axis))


def solve_symmetric(matrix: Array, right: Array) -> np.ndarray:
    """x with  matrix x = right  for a symmetric positive definite matrix, by L D Lᵀ without square roots or pivots.

    Args:
        matrix: (n, n), only the lower triangle is read.   right: (n,).
    Returns:
        x: (n,). Not finite where the matrix is singular.
    """
    return solve_factored(factor_symmetric(matrix), right)


@dataclass(frozen=True, eq=False)
class Factored:
    """A symmetric matrix as L D Lᵀ: `lower` (n, n) is L without its ones on the diagonal, `inverse` (n,) is D⁻¹."""

    lower: np.ndarray
    inverse: np.ndarray


def factor_symmetric(matrix: Array) -> Factored:
    """L D Lᵀ of a symmetric positive definite matrix without square roots or pivots: n divisions in all.

    Args:
        matrix: (n, n), only the lower triangle is read.
    Returns:
        factors: for `solve_factored`, `solve_lower` and `inverse_factored`. Not finite where the matrix is singular.
    """
    n = len(matrix)
    lower, scaled, inverse = zeros(n, n), zeros(n, n), zeros(n)  # `scaled` is L D
    for j in range(n):
        for k in range(j):
            scaled[j, k] = matrix[j, k] - _dot(scaled[j, :k], lower[k, :k])
            lower[j, k] = scaled[j, k] * inverse[k]
        inverse[j] = 1.0 / (matrix[j, j] - _dot(scaled[j, :j], lower[j, :j]))
    return Factored(array(lower), array(inverse))


def solve_lower(factors: Factored, right: Array) -> np.ndarray:
    """y with  L y = right,  right (n,) or (n, k)."""
    y = zeros(*np.shape(right))
    for j in range(len(y)):
        y[j] = right[j] - _dot(factors.lower[j, :j], y[:j])
    return array(y)


def solve_factored(factors: Factored, right: Array) -> np.ndarray:
    """x with  L D Lᵀ x = right,  right (n,) or (n, k): n² products for each column."""
    y = solve_lower(factors, right)
    x = zeros(*y.shape)
    for j in reversed(range(len(y))):
        x[j] = y[j] * factors.inverse[j] - _dot(factors.lower[j + 1 :, j], x[j + 1 :])
    return array(x)


def inverse_factored(factors: Factored) -> np.ndarray:
    """(L D Lᵀ)⁻¹ (n, n) from  X = L⁻¹  as  Xᵀ D⁻¹ X: about n³/3 products, since X is triangular and the result symmetric."""
    n = len(factors.lower)
    x, full = eye(n), zeros(n, n)
    for i in range(n):
        for j in range(i):
            x[i, j] = -(factors.lower[i, j] + _dot(factors.lower[i, j + 1 : i], x[j + 1 : i, j]))
    scaled = x * factors.inverse.reshape(n, 1)
    for i in range(n):
        for j in range(i + 1):
            full[i, j] = full[j, i] = x[i:, i] @ scaled[i:, j]
    return array(full)


@dataclass(frozen=True, eq=False)
class SparseFactors:
    """A matrix as L U: the order in which it was eliminated, and the entries of both that are not 0, by row and column.

    Attributes:
        order: (n,) rows and columns.   lower: L without its ones on the diagonal, by column.   upper: U without its diagonal.
        inverse: (n,) of U's diagonal.
    """

    order: list[int]
    lower: list[dict[int, Scalar]]
    upper: list[dict[int, Scalar]]
    inverse: list[Scalar]


def factor_sparse(matrix: Array) -> SparseFactors:
    """L U of a matrix with pivots on its diagonal; entries that are known to be 0 cost nothing.  [Markowitz1957]

    The next pivot is always the one that takes the fewest products, (entries in its row - 1) (entries in its column - 1).

    Args:
        matrix: (n, n); the leading minors in that order are not 0.
    Returns:
        factors: for `solve_sparse`. Not finite where a pivot is 0.
    """
    n = len(matrix)
    rows = [{j: matrix[i, j] for j in range(n) if not _is_zero(matrix[i, j])} for i in range(n)]
    lower: list[dict[int, Scalar]] = [{} for _ in range(n)]
    inverse: list[Scalar] = [0.0] * n
    left, order = list(range(n)), []
    while left:
        counts = {j: sum(j in rows[i] for i in left) for j in left}
        pivot = min(left, key=lambda j: (len(rows[j].keys() & counts.keys()) - 1) * (counts[j] - 1))
        left.remove(pivot)
        order.append(pivot)
        diagonal = rows[pivot].pop(pivot, np.float64(0.0))
        inverse[pivot] = np.float64(1.0) / diagonal
        for i in left:
            if pivot in rows[i]:
                lower[pivot][i] = factor = rows[i].pop(pivot) * inverse[pivot]
                for j, entry in rows[pivot].items():
                    rows[i][j] = rows[i].get(j, 0.0) - factor * entry
    return SparseFactors(order, lower, rows, inverse)


def solve_sparse(factors: SparseFactors, right: Array) -> np.ndarray:
    """x (n,) with  L U x = right (n,)."""
    x = list(right)
    for pivot in factors.order:
        for i, factor in factors.lower[pivot].items():
            x[i] = x[i] - factor * x[pivot]
    for pivot in reversed(factors.order):
        for j, entry in factors.upper[pivot].items():
            x[pivot] = x[pivot] - entry * x[j]
        x[pivot] = x[pivot] * factors.inverse[pivot]
    return array(x)


def _is_zero(value: Scalar) -> bool:
    """True of the number 0, and of symbols that are it, such as h · 0."""
    return bool(value.sx.is_zero()) if isinstance(value, Symbol) else value == 0.0


def _dot(a: np.ndarray, b: np.ndarray) -> Scalar:
    return a @ b if len(a) else 0.0


def jacobian(function: Callable[[np.ndarray], Array], x: Array) -> np.ndarray:
    """∂f/∂x of a plain function by algorithmic differentiation, exact to rounding; on floats and in a trace.

    Forward or reverse mode, whichever takes fewer operations.  [GriewankWalther2008]

    Args:
        function: of one (n,) array, written with these functions; returns an array of any shape.
        x: (n,) where to differentiate.
    Returns:
        J: (*shape of f, n).
    """
    inner = np.array([Symbol.named(f"x{k}") for k in range(len(x))], dtype=object)
    value = np.asarray(function(inner), dtype=object)
    columns = [casadi.vertcat(*(_sx(entry) for entry in array.flat)) for array in (value, inner)]
    modes: list[Any] = [{"helper_options": {"ad_weight": weight}} for weight in (0.0, 1.0)]
    slopes = [casadi.jacobian(columns[0], columns[1], mode) for mode in modes]
    outer = casadi.vertcat(*(_sx(entry) for entry in np.asarray(x, dtype=object)))
    placed = min((casadi.cse(casadi.substitute(slope, columns[1], outer)) for slope in slopes), key=casadi.n_nodes)
    entries = zeros(value.size, len(x))
    for row, column, element in zip(*placed.sparsity().get_triplet(), placed.nonzeros(), strict=True):
        entries[row, column] = np.float64(element) if element.is_constant() else Symbol(element)
    return array(entries.reshape(*value.shape, len(x)))


def _sx(entry: Scalar) -> Any:
    return entry.sx if isinstance(entry, Symbol) else casadi.SX(float(entry))
