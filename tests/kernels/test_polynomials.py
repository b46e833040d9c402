"""The inlined elementary functions: within 2 ulp, the worst cases of range reduction and C's specials included."""

import functools

import mpmath
import numpy as np
import pytest
from llvmlite import binding

from armwright.kernels import polynomials
from armwright.kernels.llvm_machine import LlvmMachine
from armwright.kernels.lowering import lower
from kernels.harness import EXTENDED, ArrayFunction, same_bits, ulp_error

N = 200_000
INF, NAN, PI, TINY = np.inf, np.nan, np.pi, 5e-324
extended = pytest.mark.skipif(not EXTENDED, reason="needs long doubles of 64 bits to measure ulps")


@functools.cache
def compiled(name: str, width: int = 8) -> ArrayFunction:
    if name == "SINCOS":
        return ArrayFunction(polynomials.sincos, 1, width)
    return ArrayFunction(lambda m, *v: lower(m, name, *v), 2 if name in ("ATAN2", "HYPOT") else 1, width)


def uniform(low, high, seed=0):
    return np.random.default_rng(seed).uniform(low, high, N)


def magnitudes(low, high, seed=0):
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], N) * np.exp(rng.uniform(low, high, N))


def subnormals(seed=0):
    return np.random.default_rng(seed).integers(1, 2**52, N).view(float)


TRUTH = {
    "SIN": (np.sin, [uniform(-(2.0**20), 2.0**20), uniform(-8, 8), magnitudes(-740, 13.8), uniform(2**20, 1e9)]),
    "COS": (np.cos, [uniform(-(2.0**20), 2.0**20), uniform(-8, 8), magnitudes(-740, 13.8), uniform(2**20, 1e9)]),
    "TAN": (np.tan, [uniform(-(2.0**20), 2.0**20), uniform(-8, 8), magnitudes(-740, 13.8), uniform(2**20, 1e9)]),
    "EXP": (np.exp, [uniform(-746, 710), uniform(-746, -708), uniform(-2, 2), magnitudes(-740, 0)]),
    "EXPM1": (np.expm1, [uniform(-60, 710), uniform(-2, 2), uniform(-0.01, 0.01), magnitudes(-740, 0)]),
    "LOG": (np.log, [np.abs(magnitudes(-708, 709)), uniform(0.5, 2), uniform(0.999, 1.001), subnormals()]),
    "TANH": (np.tanh, [uniform(-23, 23), uniform(-1, 1), uniform(-0.2, 0.2), magnitudes(-740, 0)]),
    "ATAN": (np.arctan, [uniform(-23, 23), uniform(-1, 1), uniform(1, 2.5), magnitudes(-740, 709)]),
}
PAIRS = [
    (uniform(-1, 1, 1), uniform(-1, 1, 2)),
    (magnitudes(-700, 700, 3), magnitudes(-700, 700, 4)),
    (uniform(-1, 1, 5), uniform(-1, 1, 5) * uniform(0.9, 1.1, 6)),
    (subnormals(7), subnormals(8)),
]


@pytest.mark.sample(3)
@extended
@pytest.mark.parametrize("name", TRUTH)
def test_two_ulp_over_dense_random_arguments(name):
    function, samples = TRUTH[name]
    for x in samples:
        with np.errstate(all="ignore"):
            error = ulp_error(compiled(name)(x), function(x.astype(np.longdouble)))
        assert error.max() <= 2.0, x[error.argmax()]


@extended
@pytest.mark.parametrize(("name", "function"), [("ATAN2", np.arctan2), ("HYPOT", np.hypot)])
def test_two_ulp_over_pairs(name, function):
    for x, y in PAIRS:
        with np.errstate(all="ignore"):
            error = ulp_error(compiled(name)(x, y), function(x.astype(np.longdouble), y.astype(np.longdouble)))
        assert error.max() <= 2.0, (x[error.argmax()], y[error.argmax()])


@pytest.mark.parametrize(
    ("name", "function", "x"),
    [
        ("SIN", mpmath.sin, uniform(-(2.0**20), 2.0**20)),
        ("COS", mpmath.cos, uniform(-(2.0**20), 2.0**20)),
        ("TAN", mpmath.tan, uniform(-(2.0**20), 2.0**20)),
        ("EXP", mpmath.exp, uniform(-745, 709)),
        ("EXPM1", mpmath.expm1, uniform(-2, 2)),
        ("LOG", mpmath.log, np.abs(magnitudes(-3, 3))),
        ("TANH", mpmath.tanh, uniform(-3, 3)),
        ("ATAN", mpmath.atan, uniform(-3, 3)),
        ("ERFINV", mpmath.erfinv, np.concatenate([uniform(-1, 1)[:100], 1.0 - np.exp(uniform(-36, -1)[:100])])),
    ],
)
def test_against_multiple_precision(name, function, x):
    """A thinner sample with an outside judge, on every platform."""
    x = x[:300]
    with mpmath.workdps(40):
        truth = [function(mpmath.mpf(float(v))) for v in x]
        error = [
            abs((mpmath.mpf(float(f)) - t) / mpmath.mpf(float(np.spacing(abs(float(t))))))
            for f, t in zip(compiled(name)(x), truth, strict=True)
        ]
    assert max(error) <= (4.0 if name == "ERFINV" else 2.0)


def quarter_residual(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x - k π/2 in long doubles and k, k the nearest integer.

    π/2 is taken in pieces of 40 bits: their products with k < 2^20 are exact, and so are the differences until the
    residual has more than 64 bits.
    """
    k = np.rint(x / (PI / 2))
    residual = x.astype(np.longdouble)
    with mpmath.workdps(100):
        rest = mpmath.pi / 2
        for n in range(1, 7):
            piece = mpmath.floor(mpmath.ldexp(rest, 40 * n)) / mpmath.mpf(2) ** (40 * n)
            residual -= k.astype(np.longdouble) * np.longdouble(float(piece))
            rest -= piece
    return residual, k.astype(np.int64)


@pytest.mark.study
@extended
def test_sine_cosine_and_tangent_beside_every_multiple_of_half_pi():
    """The three doubles about every k π/2 up to 2^20, 667,544 of them: where a shorter reduction loses everything."""
    k = np.arange(1, int(2.0**20 / (PI / 2)) + 1)
    about = (k * np.longdouble(PI / 2) + k * np.longdouble(6.123233995736766e-17)).astype(float)
    for x in (about, -about, np.nextafter(about, 0.0), np.nextafter(about, INF)):
        r, k = quarter_residual(x)
        s, c = np.sin(r), np.cos(r)
        sine, cosine = compiled("SINCOS")(x)
        assert ulp_error(sine, np.choose(k & 3, [s, c, -s, -c])).max() <= 2.0
        assert ulp_error(cosine, np.choose(k & 3, [c, -s, -c, s])).max() <= 2.0
        assert ulp_error(compiled("TAN")(x), np.where(k & 1, -c / s, s / c)).max() <= 2.0


def test_sine_and_cosine_beside_multiples_of_half_pi_in_multiple_precision():
    """The same for some of them with an outside judge, on every platform; 2^20 itself and its neighbours too."""
    k = np.unique(np.geomspace(1, 2.0**20 / (PI / 2), 200).astype(int))
    with mpmath.workdps(60):
        about = np.array([float(int(n) * mpmath.pi / 2) for n in k] + [2.0**20, np.nextafter(2.0**20, 0)])
        for name, function in (("SIN", mpmath.sin), ("COS", mpmath.cos)):
            for x, found in zip(about, compiled(name)(about), strict=True):
                truth = function(mpmath.mpf(float(x)))
                assert abs(mpmath.mpf(float(found)) - truth) <= 2.0 * np.spacing(abs(float(truth))), (name, x)


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("SIN", [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (TINY, TINY), (-TINY, -TINY)]),
        ("COS", [(0.0, 1.0), (-0.0, 1.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (TINY, 1.0)]),
        ("TAN", [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (TINY, TINY), (-TINY, -TINY)]),
        (
            "EXP",
            [
                (0.0, 1.0),
                (-0.0, 1.0),
                (INF, INF),
                (-INF, 0.0),
                (NAN, NAN),
                (709.79, INF),
                (1e300, INF),
                (-745.2, 0.0),
                (-1e300, 0.0),
            ],
        ),
        ("EXP", [(-745.0, TINY), (1.0, np.e), (TINY, 1.0)]),
        (
            "EXPM1",
            [
                (0.0, 0.0),
                (-0.0, -0.0),
                (INF, INF),
                (-INF, -1.0),
                (NAN, NAN),
                (TINY, TINY),
                (-TINY, -TINY),
                (710.0, INF),
            ],
        ),
        (
            "LOG",
            [(0.0, -INF), (-0.0, -INF), (INF, INF), (-INF, NAN), (NAN, NAN), (-TINY, NAN), (-1.0, NAN), (1.0, 0.0)],
        ),
        ("LOG", [(TINY, -744.4400719213812), (np.finfo(float).max, 709.782712893384)]),
        (
            "TANH",
            [(0.0, 0.0), (-0.0, -0.0), (INF, 1.0), (-INF, -1.0), (NAN, NAN), (TINY, TINY), (20.0, 1.0), (-1e300, -1.0)],
        ),
        ("ATAN", [(0.0, 0.0), (-0.0, -0.0), (INF, PI / 2), (-INF, -PI / 2), (NAN, NAN), (TINY, TINY), (1.0, PI / 4)]),
        (
            "ERFINV",
            [(0.0, 0.0), (-0.0, -0.0), (1.0, INF), (-1.0, -INF), (1.5, NAN), (-1.5, NAN), (NAN, NAN), (INF, NAN)],
        ),
    ],
)
def test_specials(name, table):
    x, expected = np.array(table).T.copy()
    assert same_bits(compiled(name)(x), expected).all(), compiled(name)(x)


@pytest.mark.parametrize("name", ["ATAN2", "HYPOT"])
def test_specials_of_two_arguments_are_those_of_c(name):
    special = np.array([v for a in (0.0, TINY, 1.0, 1e300, INF) for v in (a, -a)] + [NAN])
    x, y = (a.ravel() for a in np.meshgrid(special, special))
    reference = np.arctan2 if name == "ATAN2" else np.hypot
    found, expected = compiled(name)(x, y), reference(x, y)
    with np.errstate(all="ignore"):
        close = np.abs(found - expected) <= 2.0 * np.spacing(np.abs(expected))
    assert (same_bits(found, expected) | close & (np.signbit(found) == np.signbit(expected))).all()


def test_sine_is_odd_and_cosine_even_to_the_bit():
    x = np.concatenate([uniform(-100, 100), magnitudes(-700, 13)])
    s, c = compiled("SINCOS")(x)
    minus_s, minus_c = compiled("SINCOS")(-x)
    assert np.array_equal(s, -minus_s)
    assert np.array_equal(c, minus_c)


@pytest.mark.parametrize("width", [2, 4, 8])
def test_bits_do_not_depend_on_the_neighbours(width):
    """A lane beyond 2^20 sends its tile through libm; the others must not notice."""
    x = uniform(-10, 10)[:800]
    alone = compiled("SINCOS", width)(x)
    for lane in range(width):
        mixed = x.copy()
        mixed[lane::width] = [1e10, NAN, INF, -3e6][lane % 4]
        rest = np.arange(x.size) % width != lane
        for found, expected in zip(compiled("SINCOS", width)(mixed), alone, strict=True):
            assert np.array_equal(found[rest], expected[rest])


def test_sine_and_cosine_share_one_reduction_and_one_slow_block():
    m = LlvmMachine(8)
    sine, cosine = lower(m, "SIN", "%x"), lower(m, "COS", "%x")
    printed = len(m.lines)
    assert lower(m, "SIN", "%x") == sine != cosine
    assert len(m.lines) == printed
    assert sum(line.startswith("  br i1") for line in m.lines) == 1


@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx512f"), reason="looks at AVX-512 instructions")
@pytest.mark.parametrize("name", ["SINCOS", "EXP", "LOG", "TANH", "ATAN2"])
def test_eight_lanes_stay_in_vector_registers(name):
    """No instruction on single doubles in the compiled loop."""
    loop = compiled(name).assembly.split("\nmapped:")[1].split("\n\tretq")[0]
    assert "zmm" in loop
    assert "vfmadd" in loop
    scalar = [line for line in loop.splitlines() if line.split()[:1] and line.split()[0].endswith("sd")]
    assert all("vbroadcastsd" in line for line in scalar), scalar
