"""The abstract machine on which polynomials and lowerings are written once, for LLVM IR, C99 and CUDA C alike.

A value is opaque: one real, one integer of as many bits or one truth value for each lane. Reals are of the machine's
`format`, double unless said otherwise; they follow IEEE 754 to the letter, no operation is contracted, reassociated or
approximated; a fused multiply-add is `fma` and nothing else. Integers wrap around; all comparisons of integers are of
signed ones.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from typing import Any, TypeAlias

from armwright.kernels.format import DOUBLE, Format

Value: TypeAlias = Any

#: A call of libm that a rare lane needs: the C99 name and its arguments.
Slow: TypeAlias = tuple[str, tuple[Value, ...]]


class Machine(ABC):
    """The operations that a back end prints: most by one table, in `operate`. Those derived from others are at the end."""

    def __init__(self, format: Format = DOUBLE) -> None:
        self.format = format
        self.memo: dict[Hashable, Value] = {}  # what functions over the machine share, such as sin and cos of one value

    @abstractmethod
    def operate(self, name: str, *values: Value) -> Value:
        """Prints the operation of a method with that name; a count of shifts is an int."""

    # Reals.
    @abstractmethod
    def constant(self, number: float) -> Value:
        """The double `number` in every lane, to the bit; in another format, rounded once."""

    def add(self, a: Value, b: Value) -> Value:
        """a + b."""
        return self.operate("add", a, b)

    def sub(self, a: Value, b: Value) -> Value:
        """a - b."""
        return self.operate("sub", a, b)

    def mul(self, a: Value, b: Value) -> Value:
        """a b."""
        return self.operate("mul", a, b)

    def div(self, a: Value, b: Value) -> Value:
        """a / b."""
        return self.operate("div", a, b)

    def fma(self, a: Value, b: Value, c: Value) -> Value:
        """a b + c, rounded once."""
        return self.operate("fma", a, b, c)

    def neg(self, a: Value) -> Value:
        """a with the other sign bit, for NaN and zero too."""
        return self.operate("neg", a)

    def fabs(self, a: Value) -> Value:
        """a without its sign bit."""
        return self.operate("fabs", a)

    def copysign(self, a: Value, b: Value) -> Value:
        """a with the sign bit of b."""
        return self.operate("copysign", a, b)

    def sqrt(self, a: Value) -> Value:
        """The square root, correctly rounded."""
        return self.operate("sqrt", a)

    def floor(self, a: Value) -> Value:
        """Largest integer <= a."""
        return self.operate("floor", a)

    def ceil(self, a: Value) -> Value:
        """Smallest integer >= a."""
        return self.operate("ceil", a)

    def trunc(self, a: Value) -> Value:
        """Nearest integer towards zero."""
        return self.operate("trunc", a)

    def rint(self, a: Value) -> Value:
        """Nearest integer, ties to even."""
        return self.operate("rint", a)

    # Truth values.
    def lt(self, a: Value, b: Value) -> Value:
        """a < b, false with NaN."""
        return self.operate("lt", a, b)

    def le(self, a: Value, b: Value) -> Value:
        """a <= b, false with NaN."""
        return self.operate("le", a, b)

    def eq(self, a: Value, b: Value) -> Value:
        """a == b, false with NaN."""
        return self.operate("eq", a, b)

    def ne(self, a: Value, b: Value) -> Value:
        """a != b, true with NaN."""
        return self.operate("ne", a, b)

    def both(self, p: Value, q: Value) -> Value:
        """p and q."""
        return self.operate("both", p, q)

    def either(self, p: Value, q: Value) -> Value:
        """p or q."""
        return self.operate("either", p, q)

    def inverse(self, p: Value) -> Value:
        """not p."""
        return self.operate("inverse", p)

    def select(self, p: Value, a: Value, b: Value) -> Value:
        """The real a in lanes where p is true, else b."""
        return self.operate("select", p, a, b)

    # Integers.
    def bits(self, a: Value) -> Value:
        """The real a as an integer, bit by bit."""
        return self.operate("bits", a)

    def from_bits(self, i: Value) -> Value:
        """The integer i as a real, bit by bit."""
        return self.operate("from_bits", i)

    @abstractmethod
    def int_constant(self, number: int) -> Value:
        """The integer `number`, taken modulo 2^bits, in every lane."""

    def int_add(self, i: Value, j: Value) -> Value:
        """i + j modulo 2^bits."""
        return self.operate("int_add", i, j)

    def int_sub(self, i: Value, j: Value) -> Value:
        """i - j modulo 2^bits."""
        return self.operate("int_sub", i, j)

    def int_and(self, i: Value, j: Value) -> Value:
        """Bits that both have."""
        return self.operate("int_and", i, j)

    def int_or(self, i: Value, j: Value) -> Value:
        """Bits that one of them has."""
        return self.operate("int_or", i, j)

    def int_xor(self, i: Value, j: Value) -> Value:
        """Bits that exactly one of them has."""
        return self.operate("int_xor", i, j)

    def shift_left(self, i: Value, count: int) -> Value:
        """i shifted up by `count` bits, zeros following."""
        return self.operate("shift_left", i, count)

    def shift_right(self, i: Value, count: int) -> Value:
        """i shifted down by `count` bits, zeros following."""
        return self.operate("shift_right", i, count)

    def arithmetic_shift_right(self, i: Value, count: int) -> Value:
        """i shifted down by `count` bits, copies of the sign bit following (slow on AVX2: prefer `shift_right`)."""
        return self.operate("arithmetic_shift_right", i, count)

    def int_eq(self, i: Value, j: Value) -> Value:
        """i == j."""
        return self.operate("int_eq", i, j)

    def int_lt(self, i: Value, j: Value) -> Value:
        """i < j, signed."""
        return self.operate("int_lt", i, j)

    # Leaving the straight line.
    @abstractmethod
    def call(self, name: str, *arguments: Value) -> Value:
        """The libm function of that C99 name (of sinf for "sin" where reals are floats), lane by lane."""

    @abstractmethod
    def rarely(self, mask: Value, slow: Sequence[Slow], *fast: Value) -> tuple[Value, ...]:
        """`fast`, but from libm in the lanes where `mask` is true: slow[i] gives what takes the place of fast[i].

        The block that calls libm is entered only if some lane needs it. A lane that does not need it keeps its fast
        value all the same, so that its bits never depend on its neighbours.
        """

    # In terms of the above.
    def truth(self, p: Value) -> Value:
        """1.0 where p is true, else 0.0: a truth value as C computes with it."""
        return self.select(p, self.constant(1.0), self.constant(0.0))

    def is_true(self, a: Value) -> Value:
        """True where a real counts as true in C: not zero, NaN included."""
        return self.ne(a, self.constant(0.0))

    def flip_sign(self, a: Value, i: Value) -> Value:
        """a, negated where the top bit of the integer i is set."""
        sign = self.int_and(i, self.int_constant(1 << (self.format.bits - 1)))
        return self.from_bits(self.int_xor(self.bits(a), sign))
