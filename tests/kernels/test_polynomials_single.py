"""The elementary functions of floats: within 2 ulp, the worst cases of range reduction and C's specials included."""

import functools

import mpmath
import numpy as np
import pytest

from armwright.kernels import polynomials
from armwright.kernels.coefficients import COEFFICIENTS
from armwright.kernels.format import SINGLE
from armwright.kernels.lowering import lower
from kernels.harness import ArrayFunction, same_bits, ulp_error

INF, NAN, PI = np.inf, np.nan, np.pi
LEAST, MOST = 1e-45, 3.4028235e38  # subnormal, finite
NUMBERS = COEFFICIENTS[SINGLE]


@functools.cache
def compiled(name: str, width: int = 16) -> ArrayFunction:
    if name == "SINCOS":
        return ArrayFunction(polynomials.sincos, 1, width, format=SINGLE)
    arity = 2 if name in ("ATAN2", "HYPOT") else 1
    return ArrayFunction(lambda m, *v: lower(m, name, *v), arity, width, format=SINGLE)


def every(step: int, *, negative: bool = False) -> np.ndarray:
    """Every so many-th float from 0 to infinity, of all exponents, subnormal ones too."""
    bits = np.arange(step // 2, 0x7F800000, step, dtype=np.uint32)
    return np.concatenate([bits, bits | np.uint32(1 << 31)] if negative else [bits]).view(np.float32)


FUNCTIONS = {
    "SIN": np.sin,
    "COS": np.cos,
    "TAN": np.tan,
    "EXP": np.exp,
    "EXPM1": np.expm1,
    "LOG": np.log,
    "TANH": np.tanh,
    "ATAN": np.arctan,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_two_ulp_over_floats_of_all_magnitudes(name):
    x = every(3001, negative=True)
    with np.errstate(all="ignore"):
        error = ulp_error(compiled(name)(x), FUNCTIONS[name](x.astype(float)))
    assert error.max() <= 2.0, x[error.argmax()]


@pytest.mark.parametrize(("name", "function"), [("ATAN2", np.arctan2), ("HYPOT", np.hypot)])
def test_two_ulp_over_pairs(name, function):
    rng = np.random.default_rng(0)
    x = rng.permutation(every(10007, negative=True))
    y = rng.permutation(x)
    near = rng.uniform(-8.0, 8.0, x.size)
    with np.errstate(all="ignore"):
        for other in (y, (x * near).astype(np.float32)):
            truth = function(x.astype(float), other.astype(float))
            error = ulp_error(compiled(name)(x, other), truth)
            assert error.max() <= 2.0, (x[error.argmax()], other[error.argmax()])


@pytest.mark.parametrize("name", ["SIN", "COS", "TAN"])
def test_beside_every_multiple_of_half_pi(name):
    """The five floats about every k π/2 up to 2^17, and about odd multiples of π/4, where the reduction turns over."""
    k = np.arange(1, int(2.0**18 / (PI / 2)) + 1)
    about = (k * (PI / 4)).astype(np.float32)
    for x in (about, np.nextafter(about, np.float32(0)), np.nextafter(about, np.float32(INF))):
        for each in (x, np.nextafter(x, np.float32(0)), np.nextafter(x, np.float32(INF))):
            each = each[each <= NUMBERS.reduction_limit]
            assert ulp_error(compiled(name)(each), FUNCTIONS[name](each.astype(float))).max() <= 2.0


@pytest.mark.parametrize(
    ("name", "function", "range_"),
    [
        ("SIN", mpmath.sin, (-(2.0**17), 2.0**17)),
        ("COS", mpmath.cos, (-(2.0**17), 2.0**17)),
        ("TAN", mpmath.tan, (-(2.0**17), 2.0**17)),
        ("EXP", mpmath.exp, (-87.0, 88.0)),
        ("EXPM1", mpmath.expm1, (-2.0, 2.0)),
        ("LOG", mpmath.log, (1e-3, 20.0)),
        ("TANH", mpmath.tanh, (-3.0, 3.0)),
        ("ATAN", mpmath.atan, (-3.0, 3.0)),
        ("ERFINV", mpmath.erfinv, (-1.0, 1.0)),
    ],
)
def test_against_multiple_precision(name, function, range_):
    """A thinner sample with an outside judge, on every platform."""
    x = np.random.default_rng(0).uniform(*range_, 200).astype(np.float32)
    with mpmath.workdps(40):
        truth = [function(mpmath.mpf(float(v))) for v in x]
        error = [
            abs((mpmath.mpf(float(f)) - t) / mpmath.mpf(float(np.spacing(np.float32(abs(float(t)))))))
            for f, t in zip(compiled(name)(x), truth, strict=True)
        ]
    assert max(error) <= (4.0 if name == "ERFINV" else 2.0)


def polynomial(coefficients, z):
    return sum(mpmath.mpf(c) * z**k for k, c in enumerate(coefficients))


@pytest.mark.parametrize(
    ("name", "approximation", "function", "interval", "bits"),
    [
        ("sin", lambda c, r: r + r**3 * polynomial(c, r * r), mpmath.sin, (0.0, 0.792), 27.8),
        ("cos", lambda c, r: 1 + r * r * polynomial(c, r * r), mpmath.cos, (0.0, 0.792), 32.7),
        (
            "log",
            lambda c, s: 2 * s + s**3 * polynomial(c, s * s),
            lambda s: mpmath.log((1 + s) / (1 - s)),
            (0, 0.17157),
            30.0,
        ),
        ("exp", lambda c, r: r + r * r * polynomial(c, r), mpmath.expm1, (-0.3466, 0.3466), 28.0),
        ("atan", lambda c, t: t + t**3 * polynomial(c, t * t), mpmath.atan, (0.0, 1.0), 30.0),
    ],
)
def test_the_coefficients_are_as_good_as_is_said(name, approximation, function, interval, bits):
    """The relative error of each polynomial, its coefficients the floats that they become."""
    coefficients = [SINGLE.rounded(c) for c in getattr(NUMBERS, name)]
    with mpmath.workdps(30):
        for x in np.linspace(*interval, 500):
            if abs(x) > 1e-9:
                x = mpmath.mpf(float(x))
                assert abs(approximation(coefficients, x) / function(x) - 1) <= mpmath.mpf(2) ** -bits


def test_the_constants_in_parts_are_what_they_stand_for():
    """Each part a float; the parts of π/2 all positive, their sum good to 72 bits; the exact product of ln 2."""
    for parts in (NUMBERS.half_pi, NUMBERS.ln_2, NUMBERS.ln_2_exact):
        for part in parts:
            assert float(np.float32(part)) == pytest.approx(part, rel=2.0**-24)
    assert all(part > 0.0 for part in NUMBERS.half_pi)
    with mpmath.workdps(40):
        rest = mpmath.pi / 2 - sum(mpmath.mpf(SINGLE.rounded(part)) for part in NUMBERS.half_pi)
        assert abs(rest) < mpmath.mpf(2) ** -71
        for parts in (NUMBERS.ln_2, NUMBERS.ln_2_exact):
            assert abs(mpmath.log(2) - sum(mpmath.mpf(SINGLE.rounded(p)) for p in parts)) < mpmath.mpf(2) ** -42
    upper = np.float32(NUMBERS.ln_2_exact[0])
    assert all(float(np.float32(k) * upper) == k * float(upper) for k in range(-150, 129))


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("SIN", [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (LEAST, LEAST), (-LEAST, -LEAST)]),
        ("COS", [(0.0, 1.0), (-0.0, 1.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (LEAST, 1.0)]),
        ("TAN", [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (LEAST, LEAST), (-LEAST, -LEAST)]),
        ("EXP", [(0.0, 1.0), (-0.0, 1.0), (INF, INF), (-INF, 0.0), (NAN, NAN), (88.73, INF), (MOST, INF)]),
        ("EXP", [(-104.0, 0.0), (-MOST, 0.0), (-103.0, LEAST), (1.0, np.e), (LEAST, 1.0), (88.72, 3.3931806e38)]),
        ("EXPM1", [(0.0, 0.0), (-0.0, -0.0), (INF, INF), (-INF, -1.0), (NAN, NAN), (LEAST, LEAST), (-LEAST, -LEAST)]),
        ("EXPM1", [(89.0, INF), (-18.0, -1.0), (-MOST, -1.0)]),
        ("LOG", [(0.0, -INF), (-0.0, -INF), (INF, INF), (-INF, NAN), (NAN, NAN), (-LEAST, NAN), (-1.0, NAN)]),
        ("LOG", [(1.0, 0.0), (LEAST, -103.27893), (MOST, 88.72284)]),
        ("TANH", [(0.0, 0.0), (-0.0, -0.0), (INF, 1.0), (-INF, -1.0), (NAN, NAN), (LEAST, LEAST), (-MOST, -1.0)]),
        ("TANH", [(9.5, 1.0), (10.5, 1.0)]),
        ("ATAN", [(0.0, 0.0), (-0.0, -0.0), (INF, PI / 2), (-INF, -PI / 2), (NAN, NAN), (LEAST, LEAST)]),
        ("ERFINV", [(0.0, 0.0), (-0.0, -0.0), (1.0, INF), (-1.0, -INF), (1.5, NAN), (NAN, NAN), (INF, NAN)]),
    ],
)
def test_specials(name, table):
    x, expected = np.array(table, dtype=np.float32).T.copy()
    assert same_bits(compiled(name)(x), expected).all(), compiled(name)(x)


@pytest.mark.parametrize("name", ["ATAN2", "HYPOT"])
def test_specials_of_two_arguments_are_those_of_c(name):
    special = np.array([v for a in (0.0, LEAST, 1.0, 1e38, INF) for v in (a, -a)] + [NAN], dtype=np.float32)
    x, y = (a.ravel() for a in np.meshgrid(special, special))
    reference = np.arctan2 if name == "ATAN2" else np.hypot
    found, expected = compiled(name)(x, y), reference(x, y)
    with np.errstate(all="ignore"):
        close = np.abs(found - expected) <= 2.0 * np.spacing(np.abs(expected))
    assert (same_bits(found, expected) | close & (np.signbit(found) == np.signbit(expected))).all()


def test_sine_is_odd_and_cosine_even_to_the_bit():
    x = every(5003)
    x = x[x <= NUMBERS.reduction_limit]
    s, c = compiled("SINCOS")(x)
    minus_s, minus_c = compiled("SINCOS")(-x)
    assert np.array_equal(s, -minus_s)
    assert np.array_equal(c, minus_c)


@pytest.mark.parametrize("width", [4, 8, 16])
def test_bits_do_not_depend_on_the_neighbours(width):
    """A lane beyond 2^17 sends its tile through libm; the others must not notice."""
    x = np.random.default_rng(0).uniform(-10, 10, 800).astype(np.float32)
    alone = compiled("SINCOS", width)(x)
    for lane in range(width):
        mixed = x.copy()
        mixed[lane::width] = [1e10, NAN, INF, -3e6][lane % 4]
        rest = np.arange(x.size) % width != lane
        for found, expected in zip(compiled("SINCOS", width)(mixed), alone, strict=True):
            assert np.array_equal(found[rest], expected[rest])
