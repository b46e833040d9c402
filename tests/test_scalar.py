"""The arithmetic: a Symbol lives in arrays, refuses to be a number, and floats keep their NaN."""

from __future__ import annotations

import inspect
import math
import operator

import casadi
import numpy as np
import pytest
from hypothesis import given, strategies as st

from armwright import scalar
from armwright.errors import ArmwrightError, SymbolError
from armwright.program import interpret, trace
from armwright.scalar import Symbol

NAN = math.nan


def symbols(*names: str) -> np.ndarray:
    """An array of fresh symbols."""
    return scalar.array([Symbol.named(name) for name in names])


def evaluate(function, *arguments) -> np.ndarray:
    """A function of arrays through trace and CasADi's interpreter."""
    arrays = [np.asarray(a, dtype=float) for a in arguments]
    return interpret(trace("f", function, {f"x{k}": a.shape for k, a in enumerate(arrays)}), *arrays)


def test_symbols_in_arrays():
    """NumPy's products, sums and slices over symbols are the float ones of the values."""
    rng = np.random.default_rng(0)
    a, b, v = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)

    def mixed(a, b, v):
        product = (a @ b.T - 2.0 * b) @ v + np.float64(0.5) * a[0] / v - (1 - v) * v**2
        return scalar.stack([product, -v, abs(a[1]) * scalar.sin(v), np.ones(3) * v])

    assert a.dtype == float
    np.testing.assert_allclose(evaluate(mixed, a, b, v), mixed(a, b, v), rtol=1e-14, atol=1e-14)


def test_symbols_entries_stay_symbols():
    """A filled array holds Symbols, whose zeros fold away; a bare SX never enters."""
    x, y = symbols("x", "y")
    filled = scalar.zeros(2, 2)
    filled[0, 1] = x * y
    assert isinstance(filled[0, 1], Symbol)
    product = filled @ symbols("u", "v")
    assert str(product[0].sx) == "((x*y)*v)"
    assert not any(isinstance(entry, casadi.SX) for entry in product)
    assert scalar.is_symbolic(filled)
    assert not scalar.is_symbolic(np.zeros(3), 1.0)


def test_array_is_float_without_symbols():
    """`array`, `stack` and `zeros` give floats back where nothing is symbolic."""
    assert scalar.array([[1, 2.5], [0, 1]]).dtype == float
    assert scalar.array(scalar.zeros(2)).dtype == float
    assert scalar.stack([np.ones(2), [1, 2]], axis=1).dtype == float
    assert scalar.array([1.0, Symbol.named("x")]).dtype == object


def test_float_array_refuses_a_symbol():
    """Putting a symbol where only floats fit is an error at once, not a NaN later; `math` is refused too."""
    x = Symbol.named("x")
    with pytest.raises(SymbolError, match=r"armwright.scalar functions"):
        np.zeros(2)[0] = x
    with pytest.raises(SymbolError, match=r"math"):
        math.sin(x)
    with pytest.raises(SymbolError):
        np.array([x, 1.0], dtype=float)
    with pytest.raises(SymbolError):
        symbols("x", "y").astype(float)
    assert issubclass(SymbolError, ArmwrightError)


@pytest.mark.parametrize(
    ("branch", "instead"),
    [
        (lambda x: 1.0 if x else 2.0, "scalar.where"),
        (lambda x: x < 1.0, "scalar.less"),
        (lambda x: x > 1.0, "scalar.less"),
        (lambda x: x >= 1.0, "scalar.less"),
        (lambda x: x == 1.0, "scalar.equal"),
        (lambda x: x != 1.0, "scalar.equal"),
        (lambda x: max(x, 1.0), "scalar.less"),
        (lambda x: bool(x), "scalar.where"),
    ],
)
def test_branch_names_file_line_and_what_to_use(branch, instead):
    """A branch on a symbol says where it stands and which function does it."""
    with pytest.raises(SymbolError) as caught:
        branch(Symbol.named("x"))
    line = inspect.getsourcelines(branch)[1]
    assert str(caught.value).startswith(f"{__file__}:{line}: ")
    assert instead in str(caught.value)
    assert "\n" not in str(caught.value)


UNARY = {
    **dict.fromkeys(
        ("sin", "cos", "tan", "exp", "tanh", "abs", "sign", "floor", "ceil", "round"), (-2.5, -0.3, 0.0, 0.7, 4.2)
    ),
    "sqrt": (0.0, 0.3, 4.0),
    "log": (0.1, 1.0, 7.0),
}
BINARY = ("atan2", "hypot", "fmod", "minimum", "maximum", "less", "less_equal", "equal")
PAIRS = np.array([(-2.0, 1.5), (3.7, -1.1), (0.4, 0.4), (-1.0, -1.0), (5.0, 2.0)]).T


@pytest.mark.parametrize("name", UNARY)
def test_one_call_for_floats_arrays_and_symbols(name):
    """A float, an array, an array of objects and a trace give the same."""
    function, values = getattr(scalar, name), np.array(UNARY[name])
    whole = function(values)
    np.testing.assert_array_equal(whole, [float(function(float(v))) for v in values])
    np.testing.assert_array_equal(whole, function(values.astype(object)).astype(float))
    # 4 ulp: NumPy's functions, which differ from processor to processor, and libm's may each be 2 off.
    np.testing.assert_allclose(evaluate(function, values), whole, rtol=1e-15)


@pytest.mark.parametrize("name", BINARY)
def test_two_values(name):
    """The same for functions of two values, of a symbol with a float and a float with a symbol."""
    function, (a, b) = getattr(scalar, name), PAIRS
    whole = function(a, b)
    np.testing.assert_allclose(evaluate(function, a, b), whole, rtol=1e-15)
    np.testing.assert_allclose(evaluate(lambda x: function(x, b), a), whole, rtol=1e-15)
    np.testing.assert_allclose(evaluate(lambda y: function(a, y), b), whole, rtol=1e-15)


def test_where():
    """a where the condition is not 0, else b, for numbers, arrays and symbols."""
    condition, a, b = np.array([0.0, 1.0, 2.0]), np.array([1.0, 2.0, 3.0]), np.array([-1.0, -2.0, -3.0])
    np.testing.assert_array_equal(scalar.where(condition, a, b), [-1.0, 2.0, 3.0])
    np.testing.assert_array_equal(evaluate(scalar.where, condition, a, b), [-1.0, 2.0, 3.0])
    np.testing.assert_array_equal(evaluate(lambda c: scalar.where(c, 5.0, 6.0), condition), [6.0, 5.0, 5.0])


def test_round_halves_upward():
    """Unlike NumPy, as the docstring says."""
    np.testing.assert_array_equal(scalar.round(np.array([-1.5, -0.5, 0.5, 1.5, 2.5])), [-1.0, 0.0, 1.0, 2.0, 3.0])


def test_nan_goes_through_limits():
    """A limit never hides a diverged value."""
    for result in (
        scalar.clip(NAN, -1.0, 1.0),
        scalar.minimum(NAN, 1.0),
        scalar.minimum(1.0, NAN),
        scalar.maximum(NAN, 1.0),
        scalar.maximum(1.0, NAN),
        scalar.clip(np.array([NAN]), -1.0, 1.0)[0],
        scalar.clip(np.array([NAN], dtype=object), -1.0, 1.0)[0],
        scalar.sqrt(NAN),
        scalar.abs(NAN),
    ):
        assert math.isnan(result)


@given(st.floats(-10, 10))
def test_clip(value):
    """Held between the limits, otherwise itself."""
    clipped = scalar.clip(value, -1.0, 2.0)
    assert clipped == min(max(value, -1.0), 2.0)


def random_positive(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A symmetric positive definite matrix and a right side."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    return a @ a.T + 0.1 * np.eye(n), rng.normal(size=n)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 12])
@pytest.mark.parametrize("seed", range(3))
def test_solve_symmetric(n, seed):
    """matrix x = right, as NumPy solves it, on floats and traced; only the lower triangle is read."""
    matrix, right = random_positive(n, seed)
    expected = np.linalg.solve(matrix, right)
    atol = 1e-13 * np.linalg.cond(matrix) * np.abs(expected).max()
    np.testing.assert_allclose(scalar.solve_symmetric(matrix, right), expected, rtol=0, atol=atol)
    np.testing.assert_allclose(evaluate(scalar.solve_symmetric, matrix, right), expected, rtol=0, atol=atol)
    lower = np.tril(matrix) + np.triu(np.full((n, n), NAN), 1)
    np.testing.assert_allclose(scalar.solve_symmetric(lower, right), expected, rtol=0, atol=atol)


def test_singular_matrix_gives_nothing_finite():
    """No exception, so that one bad lane of many harms no other."""
    with np.errstate(all="ignore"):
        assert not np.isfinite(scalar.solve_symmetric(np.zeros((2, 2)), np.ones(2))).any()


@pytest.mark.parametrize("n", [1, 2, 3, 6, 12])
def test_factors_serve_many_right_sides(n):
    """One factorisation: x for several right sides, L⁻¹ and the whole inverse, symmetric to the bit; floats and traced."""
    matrix, _ = random_positive(n, 5)
    right = np.random.default_rng(n).normal(size=(n, 4))
    expected, inverse = np.linalg.solve(matrix, right), np.linalg.inv(matrix)
    atol = 1e-13 * np.linalg.cond(matrix)

    def solved(matrix, right):
        return scalar.solve_factored(scalar.factor_symmetric(matrix), right)

    def inverted(matrix):
        return scalar.inverse_factored(scalar.factor_symmetric(matrix))

    for run in (lambda f, *x: f(*x), evaluate):
        np.testing.assert_allclose(run(solved, matrix, right), expected, rtol=0, atol=atol * np.abs(expected).max())
        result = run(inverted, matrix)
        np.testing.assert_allclose(result, inverse, rtol=0, atol=atol * np.abs(inverse).max())
        np.testing.assert_array_equal(result, result.T)
    factors = scalar.factor_symmetric(matrix)
    lower = factors.lower + np.eye(n)
    np.testing.assert_allclose(lower @ np.diag(1.0 / factors.inverse) @ lower.T, matrix, rtol=0, atol=1e-13 * n * 10)
    np.testing.assert_allclose(lower @ scalar.solve_lower(factors, right), right, rtol=0, atol=atol)


@pytest.mark.parametrize("n", [1, 4, 9])
def test_sparse_factors_solve_what_numpy_solves(n):
    """Half of the entries are 0, of floats and in a trace; the elimination fills some of them."""
    rng = np.random.default_rng(n)
    matrix = np.where(rng.random((n, n)) < 0.5, rng.normal(size=(n, n)), 0.0) + n * np.eye(n)
    right = rng.normal(size=n)

    def solved(matrix, right):
        return scalar.solve_sparse(scalar.factor_sparse(matrix), right)

    expected = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(solved(matrix, right), expected, rtol=1e-12)
    np.testing.assert_allclose(evaluate(solved, matrix, right), expected, rtol=1e-12)
    with np.errstate(all="ignore"):
        assert not np.isfinite(solved(np.zeros((n, n)), right)).any()


def test_an_arrow_is_eliminated_from_its_point():
    """A full row and column in front, else a diagonal: taken first they would fill everything; work grows with n, not n³."""

    def arrow(entries, right):
        n = len(right)
        matrix = scalar.eye(n)
        for k in range(n):
            matrix[0, k] = matrix[k, 0] = entries[k]
        return scalar.solve_sparse(scalar.factor_sparse(entries[0] * scalar.array(matrix)), right)

    counts = [sum(trace("arrow", arrow, {"e": (n,), "r": (n,)}).operation_counts().values()) for n in (10, 20, 40)]
    assert counts[2] - counts[1] == 2 * (counts[1] - counts[0])


def test_jacobian():
    """Exact slopes of a function of any shape, on floats, and in a trace of what it also depends on."""

    def function(x, a):
        return scalar.array([[scalar.sin(x[0]) * x[1], a * x[0]], [scalar.exp(x[1]), 3.0]])

    x, a = np.array([0.3, -0.7]), np.array([2.0])
    expected = np.zeros((2, 2, 2))
    expected[0, 0] = np.cos(0.3) * -0.7, np.sin(0.3)
    expected[0, 1, 0], expected[1, 0, 1] = 2.0, np.exp(-0.7)

    def slope(x, a):
        return scalar.jacobian(lambda inner: function(inner, a[0]), x)

    for run in (lambda f, *x: f(*x), evaluate):
        np.testing.assert_allclose(run(slope, x, a), expected, rtol=0, atol=1e-15)
    assert slope(x, a).dtype == float


OPERATIONS = {
    "+": (operator.add, casadi.OP_ADD),
    "-": (operator.sub, casadi.OP_SUB),
    "*": (operator.mul, casadi.OP_MUL),
    "/": (operator.truediv, casadi.OP_DIV),
}
CONSTANTS = [0.0, -0.0, 1.0, -1.0, 2.5, np.nan, np.inf, -np.inf, 0, 1, True, np.float64(0.0), np.int64(3)]


@pytest.mark.parametrize("sign", OPERATIONS)
@pytest.mark.parametrize("constant", CONSTANTS, ids=repr)
def test_what_is_known_of_a_constant_is_what_casadi_makes_of_it(sign, constant):
    function, code = OPERATIONS[sign]
    x = Symbol.named("x")
    y = x * 0.0 + constant  # a symbol that is a constant
    for a, b in ((x, constant), (constant, x), (x, y), (y, x), (y, y), (y, constant), (constant, y)):
        plain = casadi.SX.binary(code, *(each.sx if isinstance(each, Symbol) else float(each) for each in (a, b)))
        made = function(a, b)
        assert isinstance(made, Symbol)
        assert str(made.sx) == str(plain)


def test_no_symbol_comes_of_what_is_no_number():
    x = Symbol.named("x")
    for thing in ("1", None, [1.0], 1j):
        for function, _ in OPERATIONS.values():
            with pytest.raises(TypeError):
                function(x, thing)
            with pytest.raises(TypeError):
                function(thing, x)


def test_remembered_constants_are_forgotten_before_they_fill_memory(monkeypatch):
    monkeypatch.setattr(scalar, "MOST_CONSTANTS", 4)
    x = Symbol.named("x")
    for k in range(20):
        assert str((x + (k + 0.5)).sx) == str(x.sx + (k + 0.5))
    assert len(scalar._constants) <= 4
