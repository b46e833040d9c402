"""Elementary functions over the abstract machine: straight lines of IEEE operations, the same bits in every back end.

Nothing branches; only `rarely` leaves the line, for arguments of sine, cosine and tangent beyond 2^20 (floats: 2^17). Every
function keeps 2 ulp and treats NaN, infinities, signed zeros and subnormals as C does. Docstrings tell the largest error that
was measured, for doubles | floats: of doubles over some ten million random arguments, against 64-bit mantissas of glibc's long
double; of floats over every 61st one (sine and cosine: every one; pairs: 150 million random ones), against doubles.

The numbers of each format are in `coefficients`.
"""

from collections.abc import Sequence

from armwright.kernels.coefficients import COEFFICIENTS, Coefficients
from armwright.kernels.machine import Machine, Value


def _numbers(m: Machine) -> Coefficients:
    return COEFFICIENTS[m.format]


def _round(m: Machine) -> float:
    """A number that rounds to an integer what is added to it: 1.5 2^52, in whose low bits the integer then stands."""
    return 1.5 * 2.0**m.format.mantissa


def horner(m: Machine, x: Value, coefficients: Sequence[float]) -> Value:
    """c[0] + c[1] x + c[2] x² + …, by fused multiply-adds from the highest power down."""
    value = m.constant(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = m.fma(value, x, m.constant(coefficient))
    return value


def sincos(m: Machine, x: Value) -> tuple[Value, Value]:
    """sin x and cos x, sharing one reduction x = n π/2 + r; asked for twice, computed once.

    Max error (measured) up to the limit: sin 1.52 | 1.55 ulp, cos 1.50 | 1.55 ulp; 1.00 ulp beside every k π/2 in double.
    sin(-x) is -sin(x) to the bit, for zero too.

    The first step of the reduction is exact: the result is a multiple of 2^-53 (2^-24) below 1. The second rounds, except where
    r is so small that it is exact as well, and there the third constant counts.
    """
    numbers = _numbers(m)
    if ("sincos", x) not in m.memo:
        shifted, n = _quarters(m, x)
        r = x
        for part in numbers.half_pi:
            r = m.fma(n, m.constant(-part), r)
        z = m.mul(r, r)
        # Adding 0 to z S(z), which is -0 where r is 0, makes sin(-0) = -0.
        sine = m.fma(r, m.fma(z, horner(m, z, numbers.sin), m.constant(0.0)), r)
        cosine = m.fma(z, horner(m, z, numbers.cos), m.constant(1.0))
        # n mod 4 = 0, 1, 2, 3 gives (s, c), (c, -s), (-s, -c), (-c, s): swapped where n is odd, and the signs are bit 1
        # of n and of n + 1.
        odd, sine_sign = _is_odd(m, shifted), m.shift_left(m.bits(shifted), m.format.bits - 2)
        cosine_sign = m.int_add(sine_sign, m.int_constant(1 << (m.format.bits - 2)))
        m.memo["sincos", x] = m.rarely(
            m.lt(m.constant(numbers.reduction_limit), m.fabs(x)),
            (("sin", (x,)), ("cos", (x,))),
            m.flip_sign(m.select(odd, cosine, sine), sine_sign),
            m.flip_sign(m.select(odd, sine, cosine), cosine_sign),
        )
    return m.memo["sincos", x]


def _quarters(m: Machine, x: Value) -> tuple[Value, Value]:
    """The integer n nearest to x 2/π, once in the low bits of a real and once as a real."""
    shifted = m.fma(x, m.constant(_numbers(m).two_over_pi), m.constant(_round(m)))
    return shifted, m.sub(shifted, m.constant(_round(m)))


def _is_odd(m: Machine, shifted: Value) -> Value:
    return m.inverse(m.int_eq(m.int_and(m.bits(shifted), m.int_constant(1)), m.int_constant(0)))


def sin(m: Machine, x: Value) -> Value:
    """sin x: see `sincos`."""
    return sincos(m, x)[0]


def cos(m: Machine, x: Value) -> Value:
    """cos x: see `sincos`."""
    return sincos(m, x)[1]


def tan(m: Machine, x: Value) -> Value:
    """tan x = sin r/cos r for even n, -cos r/sin r for odd n, x = n π/2 + r; libm beyond the limit.

    Max error (measured): 1.64 | 1.49 ulp; 0.51 ulp beside every k π/2 in double. A quotient collects the errors of
    four sums, so r, its sine and its cosine carry the tails of their last ones.
    """
    numbers = _numbers(m)
    size = m.fabs(x)
    shifted, n = _quarters(m, size)
    first = m.fma(n, m.constant(-numbers.half_pi[0]), size)  # exact
    step = m.mul(n, m.constant(-numbers.half_pi[1]))
    r, tail = _two_sum(m, first, step)
    tail = m.add(tail, m.fma(n, m.constant(-numbers.half_pi[1]), m.neg(step)))
    tail = m.fma(n, m.constant(-numbers.half_pi[2]), tail)

    one = m.constant(1.0)
    z = m.mul(r, r)
    sine = _fast_two_sum(m, r, m.fma(m.mul(r, z), horner(m, z, numbers.sin), tail))
    cosine = _fast_two_sum(m, one, m.fma(z, horner(m, z, numbers.cos), m.neg(m.mul(r, tail))))
    odd = _is_odd(m, shifted)
    top, top_tail, bottom, bottom_tail = (
        m.select(odd, a, b) for a, b in zip((*cosine, *sine), (*sine, *cosine), strict=True)
    )
    quotient = _corrected_quotient(m, top, top_tail, bottom, bottom_tail)
    sign = m.int_xor(m.shift_left(m.bits(shifted), m.format.bits - 1), m.bits(x))
    return m.rarely(m.lt(m.constant(numbers.reduction_limit), size), (("tan", (x,)),), m.flip_sign(quotient, sign))[0]


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
    """n and r with x = n ln 2 + r, |r| <= ln(2)/2, n a real; between them x less the upper part of n ln 2, exact."""
    numbers = _numbers(m)
    n = m.sub(m.fma(x, m.constant(numbers.log2_e), m.constant(_round(m))), m.constant(_round(m)))
    first = m.fma(n, m.constant(-numbers.ln_2[0]), x)
    return n, first, m.fma(n, m.constant(-numbers.ln_2[1]), first)


def _power_of_two(m: Machine, n: Value) -> Value:
    """2^n for an integer n held as a real, where it is a normal number."""
    biased = m.add(n, m.constant(_round(m) + m.format.exponent_bias))
    return m.from_bits(m.shift_left(m.bits(biased), m.format.mantissa))


def exp(m: Machine, x: Value) -> Value:
    """e^x = 2^n e^r. Max error (measured): 0.90 | 0.86 ulp, subnormal results included; 0 and inf beyond."""
    numbers = _numbers(m)
    n, _, r = _exp_reduced(m, _clamp(m, x, *numbers.exp_range))
    value = horner(m, r, (1.0, 1.0, *numbers.exp))
    # In two halves, since 2^n itself may overflow or be subnormal; only the last product rounds.
    half = m.sub(m.fma(n, m.constant(0.5), m.constant(_round(m))), m.constant(_round(m)))
    return m.mul(m.mul(value, _power_of_two(m, half)), _power_of_two(m, m.sub(n, half)))


def _expm1_reduced(m: Machine, x: Value) -> tuple[Value, Value]:
    """n and e^r - 1 for x = n ln 2 + r, with what the rounding of r lost."""
    numbers = _numbers(m)
    n, first, r = _exp_reduced(m, x)
    tail = m.fma(n, m.constant(-numbers.ln_2[1]), m.sub(first, r))
    return n, m.add(r, m.fma(m.mul(r, r), horner(m, r, numbers.exp), tail))


def expm1(m: Machine, x: Value) -> Value:
    """e^x - 1 = 2^n (e^r - 1) + (2^n - 1). Max error (measured): 1.60 | 1.39 ulp."""
    numbers = _numbers(m)
    n, reduced = _expm1_reduced(m, _clamp(m, x, numbers.expm1_least, numbers.exp_range[1]))
    # Half of it first: 2^n overflows for the largest results.
    power = _power_of_two(m, m.sub(n, m.constant(1.0)))
    half = m.fma(power, reduced, m.sub(power, m.constant(0.5)))
    # Where e^x - 1 rounds to x; this also keeps -0 and subnormals.
    tiny = m.lt(m.fabs(x), m.constant(2.0 ** -(m.format.mantissa + 2)))
    return m.select(tiny, x, m.add(half, half))


def log(m: Machine, x: Value) -> Value:
    """ln x = k ln 2 + ln(1 + f), √½ <= 1 + f < √2, with s = f/(2 + f). Max error (measured): 0.84 | 0.83 ulp.

    -inf at ±0, NaN below, inf at inf.
    """
    numbers = _numbers(m)
    form, sqrt_half = m.format, numbers.sqrt_half_bits
    subnormal = m.lt(x, m.constant(2.0 ** (1 - form.exponent_bias)))
    lift = form.mantissa + 2
    scaled = m.select(subnormal, m.mul(x, m.constant(2.0**lift)), x)
    # Exponent and fraction as seen from √½; the second highest bit, half of all exponents, keeps the difference positive.
    offset = m.int_add(m.bits(scaled), m.int_constant((1 << (form.bits - 2)) - sqrt_half))
    fraction = m.int_and(offset, m.int_constant((1 << form.mantissa) - 1))
    f = m.sub(m.from_bits(m.int_add(fraction, m.int_constant(sqrt_half))), m.constant(1.0))
    # A small integer in the low bits of 2^52 is 2^52 plus that integer.
    units = 2.0**form.mantissa
    exponent = m.from_bits(m.int_or(m.shift_right(offset, form.mantissa), m.bits(m.constant(units))))
    bias = units + form.exponent_bias + 1.0
    k = m.sub(exponent, m.select(subnormal, m.constant(bias + lift), m.constant(bias)))

    s = m.div(f, m.add(f, m.constant(2.0)))
    z = m.mul(s, s)
    remainder = m.mul(z, horner(m, z, numbers.log))
    half_square = m.mul(m.mul(f, m.constant(0.5)), f)
    # k ln 2 + f - (f²/2 - (s (f²/2 + R) + k ln2_low)), from the small terms to the large.
    small = m.fma(s, m.add(half_square, remainder), m.mul(k, m.constant(numbers.ln_2_exact[1])))
    value = m.fma(k, m.constant(numbers.ln_2_exact[0]), m.sub(f, m.sub(half_square, small)))

    value = m.select(m.lt(x, m.constant(float("inf"))), value, x)  # inf and NaN stay what they are
    below = m.select(m.eq(x, m.constant(0.0)), m.constant(float("-inf")), m.constant(float("nan")))
    return m.select(m.le(x, m.constant(0.0)), below, value)


def tanh(m: Machine, x: Value) -> Value:
    """tanh x = e / (e + 2), e = exp(2 |x|) - 1, with the sign of x. Max error (measured): 1.60 | 1.48 ulp.

    ±1 where the nearest number is that.
    """
    numbers = _numbers(m)
    size = m.fabs(x)
    n, reduced = _expm1_reduced(m, _clamp(m, m.add(size, size), None, 2.0 * numbers.tanh_limit))
    power = _power_of_two(m, n)
    e = m.fma(power, reduced, m.sub(power, m.constant(1.0)))
    quotient = _corrected_quotient(m, e, None, *_fast_two_sum(m, m.constant(2.0), e))
    return m.copysign(m.select(m.lt(m.constant(numbers.tanh_limit), size), m.constant(1.0), quotient), x)


def _angle(m: Machine, t: Value, swap: Value, left: Value | None, sign: Value) -> Value:
    """The angle with tangent t <= 1; π/2 minus it in lanes `swap`; then π minus that in lanes `left`; signed as `sign`.

    base + (±t ± t z A(z) + low), base and low the two parts of 0, π/2 or π: just two roundings are of its own size.
    """
    numbers = _numbers(m)
    zero, minus = m.constant(0.0), m.constant(-0.0)
    base, low, negative = zero, zero, m.bits(m.select(swap, minus, zero))
    if left is not None:
        base = m.select(left, m.constant(2.0 * numbers.half_pi[0]), zero)
        low = m.select(left, m.constant(2.0 * numbers.half_pi[1]), zero)
        negative = m.int_xor(negative, m.bits(m.select(left, minus, zero)))
    base = m.select(swap, m.constant(numbers.half_pi[0]), base)
    low = m.select(swap, m.constant(numbers.half_pi[1]), low)
    z = m.mul(t, t)
    t = m.from_bits(m.int_xor(m.bits(t), negative))
    rest = m.fma(m.mul(t, z), horner(m, z, numbers.atan), low)
    return m.copysign(m.add(base, m.add(t, rest)), sign)


def atan(m: Machine, x: Value) -> Value:
    """atan x, as π/2 - atan(1/|x|) where |x| > 1. Max error (measured): 1.31 | 1.15 ulp."""
    size = m.fabs(x)
    swap = m.lt(m.constant(1.0), size)
    t = m.select(swap, m.div(m.constant(1.0), size), size)
    return _angle(m, t, swap, None, x)


def atan2(m: Machine, y: Value, x: Value) -> Value:
    """The angle of the point (x, y), by t = min(|x|, |y|)/max(|x|, |y|). Max error (measured): 1.55 | 1.52 ulp.

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
    """√(a² + b²) = |larger| √(1 + (smaller/larger)²), no overflow on the way. Max error (measured): 1.99 | 1.98 ulp.

    inf where one of them is, whatever the other, as in C.
    """
    size_a, size_b = m.fabs(a), m.fabs(b)
    swap = m.lt(size_a, size_b)
    smaller, larger = m.select(swap, size_a, size_b), m.select(swap, size_b, size_a)
    t = m.select(m.eq(smaller, m.constant(0.0)), smaller, m.div(smaller, larger))  # not 0/0
    value = m.mul(larger, m.sqrt(m.fma(t, t, m.constant(1.0))))
    infinity = m.constant(float("inf"))
    return m.select(m.either(m.eq(size_a, infinity), m.eq(size_b, infinity)), infinity, value)
