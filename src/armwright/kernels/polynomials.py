"""Elementary functions over the abstract machine: straight lines of IEEE operations, the same bits in every back end.

Nothing branches; only `rarely` leaves the line, for arguments of sine, cosine and tangent beyond 2^20. Every function
keeps 2 ulp (each docstring says what was measured) and treats NaN, infinities, signed zeros and subnormals as C does.
Maxima are over some ten million random arguments, against 64-bit mantissas of glibc's long double.

Sources. Coefficients of sin, cos and log: the minimax sets of Sun's fdlibm (k_sin.c, k_cos.c, e_log.c). Coefficients of
exp and atan: interpolation at the Chebyshev nodes, computed with mpmath at 60 digits, as the constants' comments say.
"""

from collections.abc import Sequence

from armwright.kernels.machine import Machine, Value

# π/2 to 160 bits. The second part is rounded down, so that the third is positive too: with 0 times each of them
# subtracted, -0 stays -0.
_HALF_PI = (1.5707963267948966, 6.123233995736765e-17, 1.082856673921914e-32)
_TWO_OVER_PI = 0.6366197723675814
_LOG2_E = 1.4426950408889634
# ln 2 to twice the precision; for the logarithm in a form whose upper part times an exponent (11 bits) is exact.
_LN_2 = (0.6931471805599453, 2.3190468138462996e-17)
_LN_2_EXACT = (6.93147180369123816490e-01, 1.90821492927058770002e-10)

#: Up to here the three-constant reduction of sine and cosine holds; libm beyond.
REDUCTION_LIMIT = 2.0**20

# Adding 1.5 2^52 rounds to an integer, which then stands in the low bits of the sum.
_ROUND = 1.5 * 2.0**52

# sin r = r + r³ S(r²) and cos r = 1 - r²/2 + r⁴ C(r²) for |r| <= π/4, within 2^-58.
_SIN = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COS = (
    -0.5,
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
# log((1 + s)/(1 - s)) = 2 s + s R(s²), R(z) = z (L1 + z (L2 + …)), for |s| <= 3 - 2 √2, within 2^-58.
_LOG = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)
# (exp r - 1 - r)/r² at 11 Chebyshev nodes of |r| <= 1.0001 ln(2)/2; exp within 2^-61, exp - 1 within 2^-59.
_EXP = (
    0.5,
    0.1666666666666667,
    0.04166666666666667,
    0.008333333333326136,
    0.0013888888888883748,
    0.00019841269874820627,
    2.4801587325547743e-05,
    2.7557255400206422e-06,
    2.75572736431103e-07,
    2.5105217004720745e-08,
    2.0914686968086876e-09,
)
# (atan(√z)/√z - 1)/z at 22 Chebyshev nodes of [0, 1]; atan within 2^-55, most of it the rounding of the coefficients.
_ATAN = (
    -0.3333333333333333,
    0.1999999999999992,
    -0.14285714285701234,
    0.11111111110268297,
    -0.0909090906193528,
    0.07692307078827029,
    -0.06666657934573768,
    0.05882264416776449,
    -0.052624922290256754,
    0.04758080083637821,
    -0.043306538430670664,
    0.03938687540798632,
    -0.035271331066871296,
    0.030330719265790507,
    -0.024191345810140718,
    0.01718398172211335,
    -0.010412153260359241,
    0.005140912856746939,
    -0.0019612554271685326,
    0.0005376839297396244,
    -9.371186345052626e-05,
    7.767624330289919e-06,
)

_ONE_BITS = 0x3FF0000000000000
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD


def horner(m: Machine, x: Value, coefficients: Sequence[float]) -> Value:
    """c[0] + c[1] x + c[2] x² + …, by fused multiply-adds from the highest power down."""
    value = m.constant(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = m.fma(value, x, m.constant(coefficient))
    return value


def sincos(m: Machine, x: Value) -> tuple[Value, Value]:
    """sin x and cos x, sharing one reduction x = n π/2 + r; asked for twice, computed once.

    Max error (measured) for |x| <= 2^20: sin 1.52 ulp, cos 1.50 ulp; 1.00 ulp beside every k π/2. libm beyond.
    sin(-x) is -sin(x) to the bit, for zero too.

    The first step of the reduction is exact: the result is a multiple of 2^-53 below 1. The second rounds, except where
    r is so small that it is exact as well, and there the third constant counts: r is always good to half an ulp.
    """
    if ("sincos", x) not in m.memo:
        shifted, n = _quarters(m, x)
        r = x
        for part in _HALF_PI:
            r = m.fma(n, m.constant(-part), r)
        z = m.mul(r, r)
        # Adding 0 to z S(z), which is -0 where r is 0, makes sin(-0) = -0.
        sine = m.fma(r, m.fma(z, horner(m, z, _SIN), m.constant(0.0)), r)
        cosine = m.fma(z, horner(m, z, _COS), m.constant(1.0))
        # n mod 4 = 0, 1, 2, 3 gives (s, c), (c, -s), (-s, -c), (-c, s): swapped where n is odd, and the signs are bit 1
        # of n and of n + 1.
        odd, sine_sign = _is_odd(m, shifted), m.shift_left(m.bits(shifted), 62)
        cosine_sign = m.int_add(sine_sign, m.int_constant(1 << 62))
        m.memo["sincos", x] = m.rarely(
            m.lt(m.constant(REDUCTION_LIMIT), m.fabs(x)),
            (("sin", (x,)), ("cos", (x,))),
            m.flip_sign(m.select(odd, cosine, sine), sine_sign),
            m.flip_sign(m.select(odd, sine, cosine), cosine_sign),
        )
    return m.memo["sincos", x]


def _quarters(m: Machine, x: Value) -> tuple[Value, Value]:
    """The integer n nearest to x 2/π, once in the low bits of a double and once as a double."""
    shifted = m.fma(x, m.constant(_TWO_OVER_PI), m.constant(_ROUND))
    return shifted, m.sub(shifted, m.constant(_ROUND))


def _is_odd(m: Machine, shifted: Value) -> Value:
    return m.inverse(m.int_eq(m.int_and(m.bits(shifted), m.int_constant(1)), m.int_constant(0)))


def sin(m: Machine, x: Value) -> Value:
    """sin x: see `sincos`."""
    return sincos(m, x)[0]


def cos(m: Machine, x: Value) -> Value:
    """cos x: see `sincos`."""
    return sincos(m, x)[1]


def tan(m: Machine, x: Value) -> Value:
    """tan x = sin r/cos r for even n, -cos r/sin r for odd n, x = n π/2 + r; libm beyond 2^20.

    Max error (measured): 1.64 ulp; 0.51 ulp beside every k π/2. A quotient collects the errors of
    four sums, so r, its sine and its cosine carry the tails of their last ones.
    """
    size = m.fabs(x)
    shifted, n = _quarters(m, size)
    first = m.fma(n, m.constant(-_HALF_PI[0]), size)  # exact
    step = m.mul(n, m.constant(-_HALF_PI[1]))
    r, tail = _two_sum(m, first, step)
    tail = m.add(tail, m.fma(n, m.constant(-_HALF_PI[1]), m.neg(step)))
    tail = m.fma(n, m.constant(-_HALF_PI[2]), tail)

    one = m.constant(1.0)
    z = m.mul(r, r)
    sine = _fast_two_sum(m, r, m.fma(m.mul(r, z), horner(m, z, _SIN), tail))
    cosine = _fast_two_sum(m, one, m.fma(z, horner(m, z, _COS), m.neg(m.mul(r, tail))))
    odd = _is_odd(m, shifted)
    top, top_tail, bottom, bottom_tail = (
        m.select(odd, a, b) for a, b in zip((*cosine, *sine), (*sine, *cosine), strict=True)
    )
    quotient = _corrected_quotient(m, top, top_tail, bottom, bottom_tail)
    sign = m.int_xor(m.shift_left(m.bits(shifted), 63), m.bits(x))
    return m.rarely(m.lt(m.constant(REDUCTION_LIMIT), size), (("tan", (x,)),), m.flip_sign(quotient, sign))[0]


def _two_sum(m: Machine, a: Value, b: Value) -> tuple[Value, Value]:
    """a + b as the rounded sum and what it lacks, exactly. [Knuth1997]"""
    total = m.add(a, b)
    share = m.sub(total, a)
    return total, m.add(m.sub(a, m.sub(total, share)), m.sub(b, share))


def _fast_two_sum(m: Machine, a: Value, b: Value) -> tuple[Value, Value]:
    """The same for |a| >= |b|. [Dekker1971]"""
    total = m.add(a, b)
    return total, m.add(m.sub(a, total), b)


def _corrected_quotient(m: Machine, top: Value, top_tail: Value | None, bottom: Value, bottom_tail: Value) -> Value:
    """(top + top_tail)/(bottom + bottom_tail): a first quotient and one Newton step, at the price of one division."""
    inverse = m.div(m.constant(1.0), bottom)
    quotient = m.mul(top, inverse)
    minus = m.neg(quotient)
    residual = m.fma(minus, bottom, top)
    if top_tail is not None:
        residual = m.add(residual, top_tail)
    return m.fma(m.fma(minus, bottom_tail, residual), inverse, quotient)


def _clamp(m: Machine, x: Value, low: float | None, high: float) -> Value:
    """x within the limits, NaN passing through (one instruction a limit on x86)."""
    x = m.select(m.lt(m.constant(high), x), m.constant(high), x)
    return x if low is None else m.select(m.lt(x, m.constant(low)), m.constant(low), x)


def _exp_reduced(m: Machine, x: Value) -> tuple[Value, Value, Value]:
    """n and r with x = n ln 2 + r, |r| <= ln(2)/2, n a double; between them x less the upper part of n ln 2, exact."""
    n = m.sub(m.fma(x, m.constant(_LOG2_E), m.constant(_ROUND)), m.constant(_ROUND))
    first = m.fma(n, m.constant(-_LN_2[0]), x)
    return n, first, m.fma(n, m.constant(-_LN_2[1]), first)


def _power_of_two(m: Machine, n: Value) -> Value:
    """2^n for an integer -1023 < n < 1024 held as a double."""
    biased = m.add(n, m.constant(_ROUND + 1023.0))
    return m.from_bits(m.shift_left(m.bits(biased), 52))


def exp(m: Machine, x: Value) -> Value:
    """e^x = 2^n e^r. Max error (measured): 0.90 ulp, subnormal results included; 0 and inf beyond."""
    n, _, r = _exp_reduced(m, _clamp(m, x, -746.0, 710.0))
    value = horner(m, r, (1.0, 1.0, *_EXP))
    # In two halves, since 2^n itself may overflow or be subnormal; only the last product rounds.
    half = m.sub(m.fma(n, m.constant(0.5), m.constant(_ROUND)), m.constant(_ROUND))
    return m.mul(m.mul(value, _power_of_two(m, half)), _power_of_two(m, m.sub(n, half)))


def _expm1_reduced(m: Machine, x: Value) -> tuple[Value, Value]:
    """n and e^r - 1 for x = n ln 2 + r, with what the rounding of r lost."""
    n, first, r = _exp_reduced(m, x)
    tail = m.fma(n, m.constant(-_LN_2[1]), m.sub(first, r))
    return n, m.add(r, m.fma(m.mul(r, r), horner(m, r, _EXP), tail))


def expm1(m: Machine, x: Value) -> Value:
    """e^x - 1 = 2^n (e^r - 1) + (2^n - 1). Max error (measured): 1.60 ulp."""
    n, reduced = _expm1_reduced(m, _clamp(m, x, -50.0, 710.0))
    # Half of it first: 2^n overflows for the largest results.
    power = _power_of_two(m, m.sub(n, m.constant(1.0)))
    half = m.fma(power, reduced, m.sub(power, m.constant(0.5)))
    tiny = m.lt(m.fabs(x), m.constant(2.0**-54))  # where e^x - 1 rounds to x; also keeps -0 and subnormals
    return m.select(tiny, x, m.add(half, half))


def log(m: Machine, x: Value) -> Value:
    """ln x = k ln 2 + ln(1 + f), √½ <= 1 + f < √2, with s = f/(2 + f). Max error (measured): 0.84 ulp.

    -inf at ±0, NaN below, inf at inf.
    """
    subnormal = m.lt(x, m.constant(2.0**-1022))
    scaled = m.select(subnormal, m.mul(x, m.constant(2.0**54)), x)
    # Exponent and fraction as seen from √½; 2^62, a thousand exponents, keeps the difference positive.
    offset = m.int_add(m.bits(scaled), m.int_constant((1 << 62) - _SQRT_HALF_BITS))
    fraction = m.int_and(offset, m.int_constant((1 << 52) - 1))
    f = m.sub(m.from_bits(m.int_add(fraction, m.int_constant(_SQRT_HALF_BITS))), m.constant(1.0))
    # A small integer in the low bits of 2^52 is 2^52 plus that integer.
    exponent = m.from_bits(m.int_or(m.shift_right(offset, 52), m.bits(m.constant(2.0**52))))
    bias = 2.0**52 + 1024.0
    k = m.sub(exponent, m.select(subnormal, m.constant(bias + 54.0), m.constant(bias)))

    s = m.div(f, m.add(f, m.constant(2.0)))
    z = m.mul(s, s)
    remainder = m.mul(z, horner(m, z, _LOG))
    half_square = m.mul(m.mul(f, m.constant(0.5)), f)
    # k ln 2 + f - (f²/2 - (s (f²/2 + R) + k ln2_low)), from the small terms to the large.
    small = m.fma(s, m.add(half_square, remainder), m.mul(k, m.constant(_LN_2_EXACT[1])))
    value = m.fma(k, m.constant(_LN_2_EXACT[0]), m.sub(f, m.sub(half_square, small)))

    value = m.select(m.lt(x, m.constant(float("inf"))), value, x)  # inf and NaN stay what they are
    below = m.select(m.eq(x, m.constant(0.0)), m.constant(float("-inf")), m.constant(float("nan")))
    return m.select(m.le(x, m.constant(0.0)), below, value)


def tanh(m: Machine, x: Value) -> Value:
    """tanh x = e / (e + 2), e = exp(2 |x|) - 1, with the sign of x. Max error (measured): 1.60 ulp; ±1 beyond 22."""
    size = m.fabs(x)
    n, reduced = _expm1_reduced(m, _clamp(m, m.add(size, size), None, 44.0))
    power = _power_of_two(m, n)
    e = m.fma(power, reduced, m.sub(power, m.constant(1.0)))
    quotient = _corrected_quotient(m, e, None, *_fast_two_sum(m, m.constant(2.0), e))
    return m.copysign(m.select(m.lt(m.constant(22.0), size), m.constant(1.0), quotient), x)


def _angle(m: Machine, t: Value, swap: Value, left: Value | None, sign: Value) -> Value:
    """The angle with tangent t <= 1; π/2 minus it in lanes `swap`; then π minus that in lanes `left`; signed as `sign`.

    base + (±t ± t z A(z) + low), base and low the two parts of 0, π/2 or π: just two roundings are of its own size.
    """
    zero, minus = m.constant(0.0), m.constant(-0.0)
    base, low, negative = zero, zero, m.bits(m.select(swap, minus, zero))
    if left is not None:
        base = m.select(left, m.constant(2.0 * _HALF_PI[0]), zero)
        low = m.select(left, m.constant(2.0 * _HALF_PI[1]), zero)
        negative = m.int_xor(negative, m.bits(m.select(left, minus, zero)))
    base = m.select(swap, m.constant(_HALF_PI[0]), base)
    low = m.select(swap, m.constant(_HALF_PI[1]), low)
    z = m.mul(t, t)
    t = m.from_bits(m.int_xor(m.bits(t), negative))
    rest = m.fma(m.mul(t, z), horner(m, z, _ATAN), low)
    return m.copysign(m.add(base, m.add(t, rest)), sign)


def atan(m: Machine, x: Value) -> Value:
    """atan x, as π/2 - atan(1/|x|) where |x| > 1. Max error (measured): 1.31 ulp."""
    size = m.fabs(x)
    swap = m.lt(m.constant(1.0), size)
    t = m.select(swap, m.div(m.constant(1.0), size), size)
    return _angle(m, t, swap, None, x)


def atan2(m: Machine, y: Value, x: Value) -> Value:
    """The angle of the point (x, y), by t = min(|x|, |y|)/max(|x|, |y|). Max error (measured): 1.55 ulp.

    Signed zeros and infinities as in C: atan2(±0, -0) = ±π, atan2(±inf, -inf) = ±3π/4.
    """
    size_x, size_y = m.fabs(x), m.fabs(y)
    swap = m.lt(size_x, size_y)
    smaller, larger = m.select(swap, size_x, size_y), m.select(swap, size_y, size_x)
    # 0/0 and inf/inf would be NaN: at the origin t = 0, on the diagonals 1.
    same = m.select(m.eq(larger, m.constant(0.0)), m.constant(0.0), m.constant(1.0))
    t = m.select(m.eq(smaller, larger), same, m.div(smaller, larger))
    return _angle(m, t, swap, m.int_lt(m.bits(x), m.int_constant(0)), y)


def hypot(m: Machine, a: Value, b: Value) -> Value:
    """√(a² + b²) = |larger| √(1 + (smaller/larger)²), no overflow on the way. Max error (measured): 1.99 ulp.

    inf where one of them is, whatever the other, as in C.
    """
    size_a, size_b = m.fabs(a), m.fabs(b)
    swap = m.lt(size_a, size_b)
    smaller, larger = m.select(swap, size_a, size_b), m.select(swap, size_b, size_a)
    t = m.select(m.eq(smaller, m.constant(0.0)), smaller, m.div(smaller, larger))  # not 0/0
    value = m.mul(larger, m.sqrt(m.fma(t, t, m.constant(1.0))))
    infinity = m.constant(float("inf"))
    return m.select(m.either(m.eq(size_a, infinity), m.eq(size_b, infinity)), infinity, value)
