"""From a program to the abstract machine: every instruction in order, every operation of the table by its lowering.

LLVM, C and CUDA share it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from armwright.kernels import polynomials
from armwright.kernels.machine import Machine, Value
from armwright.program import Instruction, Program
from armwright.program.passes import optimised

Call = Callable[[Program, list[Value]], list[Value]]
Lower = Callable[..., Value]

# The start of erfinv: erf⁻¹(x)/x with w = -log(1 - x²), in powers of w - 2.5 below 5 and of √w - 4 above. Interpolation
# at Chebyshev nodes (mpmath, 60 digits), of w in [0, 5] within 1.6e-7 and of √w in [√5, 6.01] within 2.5e-7.
_ERFINV_CENTRE = (
    1.501409351,
    0.2466407663,
    -0.004177346517,
    -0.001253758885,
    0.0002183129798,
    -4.380346714e-06,
    -3.454779514e-06,
    3.42224709e-07,
    2.260597774e-08,
)
_ERFINV_TAIL = (
    3.839784102,
    1.009495093,
    0.001253064525,
    -0.0008798359962,
    0.0003456429739,
    -0.0001014198844,
    2.260330531e-05,
    -4.037316763e-05,
    3.859455235e-05,
    -9.472593527e-06,
    -2.210252389e-06,
    8.958644987e-07,
)


def lower(machine: Machine, name: str, *values: Value) -> Value:
    """Print the operation `name` of the table on `values`.

    Raises:
        KeyError: for a structural row (constants, inputs, outputs, calls), which is the walker's own work.
    """
    return _LOWERINGS[name](machine, *values)


def _method(name: str) -> Callable[..., Value]:
    return lambda m, *values: getattr(m, name)(*values)


def _libm(name: str) -> Callable[..., Value]:
    return lambda m, *values: m.call(name, *values)


def _minimum(m: Machine, a: Value, b: Value) -> Value:
    return m.select(m.ne(a, a), a, m.select(m.lt(a, b), a, b))


def _maximum(m: Machine, a: Value, b: Value) -> Value:
    return m.select(m.ne(a, a), a, m.select(m.lt(b, a), a, b))


def _sign(m: Machine, a: Value) -> Value:
    zero = m.constant(0.0)
    return m.select(m.ne(a, a), a, m.select(m.eq(a, zero), a, m.copysign(m.constant(1.0), a)))


def erfinv(m: Machine, x: Value) -> Value:
    """The y with erf y = x: a polynomial good to 2.5e-7, then a step of Halley's. Max error (measured): 1.52 ulp, of floats 1.70.

    With e = (erf y - x)/(2 exp(-y²)/√π) the step is y - e/(1 + y e); it is cubic, so that the errors of libm's erf and
    erfc are what stays. Beyond ½ the residual is 1 - |x|, exact there, minus erfc |y|, which does not cancel.
    """
    one, half = m.constant(1.0), m.constant(0.5)
    size = m.fabs(x)
    w = m.neg(polynomials.log(m, m.mul(m.sub(one, size), m.add(one, size))))
    centre = polynomials.horner(m, m.sub(w, m.constant(2.5)), _ERFINV_CENTRE)
    tail = polynomials.horner(m, m.sub(m.sqrt(w), m.constant(4.0)), _ERFINV_TAIL)
    y = m.mul(size, m.select(m.lt(w, m.constant(5.0)), centre, tail))
    near_one = m.sub(m.sub(one, size), m.call("erfc", y))
    residual = m.select(m.lt(half, size), near_one, m.sub(m.call("erf", y), size))
    slope = m.mul(m.constant(2.0 / math.sqrt(math.pi)), polynomials.exp(m, m.neg(m.mul(y, y))))
    e = m.div(residual, slope)
    y = m.sub(y, m.div(e, m.fma(y, e, one)))
    y = m.select(m.eq(size, one), m.constant(math.inf), y)
    return m.copysign(m.select(m.le(size, one), y, m.constant(math.nan)), x)


def _truth(name: str) -> Callable[..., Value]:
    return lambda m, *values: m.truth(getattr(m, name)(*values))


_OF_LIBM = (*("pow", "asin", "acos", "sinh", "cosh", "asinh", "acosh", "atanh"), *("erf", "fmod", "log1p", "remainder"))
#: Operations that call libm for every argument, so that their bits are those of the platform's libm.
BITS_OF_LIBM = frozenset({*(name.upper() for name in _OF_LIBM), "CONSTPOW", "ERFINV"})

_LOWERINGS: dict[str, Callable[..., Value]] = {
    **{name.upper(): _method(name) for name in ("add", "sub", "mul", "div", "neg", "sqrt", "floor", "ceil", "fabs")},
    **{name.upper(): _method(name) for name in ("copysign", "fma")},
    **{name.upper(): _truth(name) for name in ("lt", "le", "eq", "ne")},
    **{name.upper(): getattr(polynomials, name) for name in ("exp", "log", "sin", "cos", "tan", "tanh")},
    **{name.upper(): getattr(polynomials, name) for name in ("atan", "atan2", "expm1", "hypot")},
    **{name.upper(): _libm(name) for name in _OF_LIBM},
    "ASSIGN": lambda m, a: a,
    "CONSTPOW": _libm("pow"),
    "SQ": lambda m, a: m.mul(a, a),
    "TWICE": lambda m, a: m.add(a, a),
    "INV": lambda m, a: m.div(m.constant(1.0), a),
    "NOT": lambda m, a: m.truth(m.eq(a, m.constant(0.0))),
    "AND": lambda m, a, b: m.truth(m.both(m.is_true(a), m.is_true(b))),
    "OR": lambda m, a, b: m.truth(m.either(m.is_true(a), m.is_true(b))),
    "IF_ELSE_ZERO": lambda m, condition, a: m.select(m.is_true(condition), a, m.constant(0.0)),
    "SIGN": _sign,
    "FMIN": _minimum,
    "FMAX": _maximum,
    "ERFINV": erfinv,
    "PRINTME": lambda m, a, _: a,
    "LIFT": lambda m, a, _: a,
    "FMS": lambda m, a, b, c: m.fma(a, b, m.neg(c)),
    "FNMA": lambda m, a, b, c: m.fma(m.neg(a), b, c),
}


def walk(
    machine: Machine,
    program: Program,
    inputs: Sequence[Sequence[Value]],
    call: Call | None = None,
    lower: Lower = lower,
    instructions: Sequence[Instruction] | None = None,
) -> list[list[Value]]:
    """Prints a program's operations.

    Args:
        machine: prints them.   program: what is printed.   inputs: the machine's values of every entry of every input.
        call: prints a call of another program, flat arguments to flat results; needed where the program makes one.
        lower: prints an operation of the table on values, (machine, name, *values) to a value; C prints calls for some.
        instructions: the program's after the passes, where the caller has them already.
    Returns:
        outputs: the machine's values of every entry of every output.
    """
    outputs: list[list[Value]] = [[machine.constant(0.0)] * port.size for port in program.outputs]

    def write(port: int, entry: int, value: Value) -> None:
        outputs[port][entry] = value

    passed = optimised(program.instructions) if instructions is None else instructions
    walk_instructions(machine, passed, {}, lambda p, e: inputs[p][e], write, call, lower)
    return outputs


def walk_instructions(
    machine: Machine,
    instructions: Sequence[Instruction],
    values: dict[int, Value],
    read: Callable[[int, int], Value],
    write: Callable[[int, int, Value], None],
    call: Call | None = None,
    lower: Lower = lower,
) -> None:
    """Prints instructions; `values` maps each result to the machine's value, and is extended in place.

    Args:
        machine: prints them.   instructions: after the passes.   values: the machine's, by the program's.
        read: gives the value of an input's entry (port, entry).   write: takes that of an output's.
        call, lower: as in `walk`.
    """
    for i in instructions:
        arguments = [values[a] for a in i.arguments]
        if i.operation == "INPUT":
            values[i.results[0]] = read(*i.place)  # type: ignore[misc]
        elif i.operation == "OUTPUT":
            write(*i.place, arguments[0])  # type: ignore[misc]
        elif i.operation == "CONST":
            values[i.results[0]] = machine.constant(i.constant)  # type: ignore[arg-type]
        elif i.callee is not None:
            assert call is not None
            values.update(zip(i.results, call(i.callee, arguments), strict=True))
        else:
            values[i.results[0]] = lower(machine, i.operation, *arguments)
