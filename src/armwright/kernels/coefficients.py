"""Coefficients of the elementary functions, one table for each number format; the algorithms are in `polynomials`.

Double. Sine, cosine and logarithm: the minimax sets of Sun's fdlibm (k_sin.c, k_cos.c, e_log.c). Exponential and arctangent:
interpolation at the Chebyshev nodes, computed with mpmath at 60 digits.

Single. Minimax sets by Remez's exchange on 1500 Chebyshev points (mpmath, 40 digits) for the relative error of the function,
not of the polynomial; the lowest coefficient is rounded to 24 bits, the exchange done again for the others, and so on up.
The bounds beside the tables are those of the rounded coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

from armwright.kernels.format import DOUBLE, SINGLE, Format


@dataclass(frozen=True)
class Coefficients:
    """Numbers of one format.

    Attributes:
        reduction_limit: up to here the reduction by three constants of sine, cosine and tangent holds; libm beyond.
        half_pi: π/2 in three parts, the later ones rounded down, so that all are positive: with 0 times each of them
            subtracted, -0 stays -0.
        two_over_pi, log2_e: 2/π and 1/ln 2.
        ln_2: in two parts.   ln_2_exact: the same, with an upper part whose product with any exponent is exact.
        sin: S in sin r = r + r³ S(r²).   cos: C in cos r = 1 + r² C(r²).   Both for |r| <= π/4 and what a rounded
            2/π adds to it at the limit.
        log: R in log((1 + s)/(1 - s)) = 2 s + s³ R(s²), |s| <= 3 - 2 √2.
        exp: (exp r - 1 - r)/r², |r| <= ln(2)/2.
        atan: A in atan t = t + t³ A(t²), |t| <= 1.
        sqrt_half_bits: √½, rounded up or down, as an integer.
        exp_range: beyond it exp x is 0 or infinite.   expm1_least: below it exp x - 1 is -1.
        tanh_limit: beyond it tanh x is ±1.
    """

    reduction_limit: float
    half_pi: tuple[float, float, float]
    two_over_pi: float
    log2_e: float
    ln_2: tuple[float, float]
    ln_2_exact: tuple[float, float]
    sin: tuple[float, ...]
    cos: tuple[float, ...]
    log: tuple[float, ...]
    exp: tuple[float, ...]
    atan: tuple[float, ...]
    sqrt_half_bits: int
    exp_range: tuple[float, float]
    expm1_least: float
    tanh_limit: float


_DOUBLE = Coefficients(
    reduction_limit=2.0**20,
    half_pi=(1.5707963267948966, 6.123233995736765e-17, 1.082856673921914e-32),
    two_over_pi=0.6366197723675814,
    log2_e=1.4426950408889634,
    ln_2=(0.6931471805599453, 2.3190468138462996e-17),
    ln_2_exact=(6.93147180369123816490e-01, 1.90821492927058770002e-10),
    sin=(  # within 2^-58
        -1.66666666666666324348e-01,
        8.33333333332248946124e-03,
        -1.98412698298579493134e-04,
        2.75573137070700676789e-06,
        -2.50507602534068634195e-08,
        1.58969099521155010221e-10,
    ),
    cos=(  # within 2^-58
        -0.5,
        4.16666666666666019037e-02,
        -1.38888888888741095749e-03,
        2.48015872894767294178e-05,
        -2.75573143513906633035e-07,
        2.08757232129817482790e-09,
        -1.13596475577881948265e-11,
    ),
    log=(  # within 2^-58
        6.666666666666735130e-01,
        3.999999999940941908e-01,
        2.857142874366239149e-01,
        2.222219843214978396e-01,
        1.818357216161805012e-01,
        1.531383769920937332e-01,
        1.479819860511658591e-01,
    ),
    exp=(  # at 11 Chebyshev nodes of |r| <= 1.0001 ln(2)/2; exp within 2^-61, exp - 1 within 2^-59
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
    ),
    atan=(  # (atan(√z)/√z - 1)/z at 22 Chebyshev nodes of [0, 1]; within 2^-55, most of it the coefficients' rounding
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
    ),
    sqrt_half_bits=0x3FE6A09E667F3BCD,
    exp_range=(-746.0, 710.0),
    expm1_least=-50.0,
    tanh_limit=22.0,
)

_SINGLE = Coefficients(
    reduction_limit=2.0**17,  # at 2^18 both roundings of r count, and 2.3 ulp come about
    half_pi=(1.570796251296997, 7.549789415861596e-08, 5.390302529957765e-15),
    two_over_pi=0.63661975,
    log2_e=1.442695,
    ln_2=(0.6931472, -1.9046542e-09),
    ln_2_exact=(0.693145751953125, 1.4286068e-06),
    sin=(-0.16666654, 0.008332106, -0.00019507883),  # |r| <= 0.792, within 2^-27.8
    cos=(-0.5, 0.041666646, -0.00138873, 2.443053e-05),  # |r| <= 0.792, within 2^-32.7
    log=(0.66666776, 0.3997758, 0.29870927),  # within 2^-30
    exp=(0.5, 0.16666636, 0.04166651, 0.00834151, 0.0013930543, 0.00015046223),  # exp - 1 within 2^-28
    atan=(  # within 2^-30
        -0.33333328,
        0.19999716,
        -0.14280343,
        0.11061233,
        -0.08821462,
        0.06763649,
        -0.044983257,
        0.022777617,
        -0.007425366,
        0.0011345253,
    ),
    sqrt_half_bits=0x3F3504F3,
    exp_range=(-104.0, 89.0),
    expm1_least=-20.0,
    tanh_limit=10.0,
)

COEFFICIENTS: dict[Format, Coefficients] = {DOUBLE: _DOUBLE, SINGLE: _SINGLE}
