"""The machine that prints C: a value is a name, a literal or an array entry; every operation is one statement.

C99 and CUDA C differ in a handful of words, which a `Dialect` holds. The text says each IEEE operation by itself: a fused
multiply-add is a call of fma(), and no product stands in the same expression as a sum, so that a compiler which keeps to
the standard has nothing to contract.
"""

# ruff: noqa: D102  What the operations do is said where they are declared, in `Machine`.

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armwright.kernels import lowering, polynomials
from armwright.kernels.machine import Machine, Slow, Value
from armwright.kernels.walk import walk
from armwright.program import Program

NAME = re.compile(r"\b[vpi]\d+\b")  # values of ours in a line of text: reals, truths, integers
KEYWORDS = frozenset(
    {  # of C and C++
        *("auto", "break", "case", "char", "class", "const", "continue", "default", "delete", "do", "double", "else"),
        *("enum", "extern", "float", "for", "goto", "if", "inline", "int", "long", "namespace", "new", "operator"),
        *("private", "public", "register", "restrict", "return", "short", "signed", "sizeof", "static", "struct"),
        *(
            "switch",
            "template",
            "this",
            "throw",
            "typedef",
            "union",
            "unsigned",
            "using",
            "virtual",
            "void",
            "volatile",
        ),
        *("while"),
    }
)

#: Operations whose polynomial is printed once, as a function; sine and cosine share one.
CALLED = ("EXP", "LOG", "TAN", "ATAN", "TANH", "ATAN2", "ERFINV", "EXPM1", "HYPOT")
#: Operations whose polynomials are made for doubles, so that floats take libm's functions of float.
_LIBM_FLOAT = ("SIN", "COS", "TAN", "EXP", "LOG", "ATAN", "ATAN2", "TANH", "EXPM1", "HYPOT")


@dataclass(frozen=True)
class Dialect:
    """Where C99 and CUDA C, double and float differ.

    Attributes:
        real: "double" or "float".   integer: the unsigned type of 64 bits.   literal: how a constant of it is written.
        function: what stands before a function of the file's own.   infinity, nan: as expressions.
        guarded: whether a fused sum is negated by a function of the unit. GCC (12 at least) makes -fma(a, b, c) one
            instruction, -(a b) - c, which gives +0 where the other gives -0.
    """

    real: str = "double"
    integer: str = "uint64_t"
    literal: str = "UINT64_C(0x{:016x})"
    function: str = "static "
    infinity: str = "INFINITY"
    nan: str = "NAN"
    guarded: bool = True


C_DOUBLE, C_FLOAT = Dialect(), Dialect(real="float", guarded=False)


def identifier(text: str) -> str:
    """A C identifier in the likeness of a name: `cmu-dd` → `cmu_dd`."""
    word = re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_")
    return f"arm_{word}".rstrip("_") if not word or word[0].isdigit() or word in KEYWORDS else word


def literal(value: float, dialect: Dialect) -> str:
    """A literal that reads back as that double (or as that float, rounded once)."""
    single = dialect.real == "float"
    if single:
        with np.errstate(over="ignore"):
            rounded = np.float32(value)
        text = str(rounded)
        value = float(rounded)
    else:
        text = repr(float(value))
    if math.isnan(value):
        return dialect.nan
    if math.isinf(value):
        return f"{'-' if value < 0 else ''}{dialect.infinity}"
    if value != 0.0 and abs(value) < np.finfo(np.float32 if single else float).tiny:
        text = float.hex(value)  # compilers warn of decimals that lose digits below the normal numbers
    elif not re.search(r"[.e]", text):
        text += ".0"
    return text + ("f" if single else "")


@dataclass
class Unit:
    """C text in the making: functions of one file, each printed once, in an order in which none is used before it stands.

    Attributes:
        dialect: C99 or CUDA, double or float.   prefix: what names of the file's own functions begin with.
        functions: text by name.
    """

    dialect: Dialect = C_DOUBLE
    prefix: str = ""
    functions: dict[str, str] = field(default_factory=dict)

    def machine(self) -> CMachine:
        """A machine that prints the body of one function of this unit."""
        return CMachine(self)

    def uses(self, name: str) -> bool:
        """Whether a function of the unit calls the one that is so named after the prefix."""
        return any(f"{self.prefix}{name}(" in text for text in self.functions.values())

    def lower(self, m: Machine, operation: str, *values: Value) -> Value:
        """An operation of the table: what takes more than a line or two is a call of a function of the unit."""
        assert isinstance(m, CMachine)
        if self.dialect.real == "float":
            if operation in _LIBM_FLOAT:
                return m.call(operation.lower(), *values)
            if operation in CALLED:
                return m.apply(self._in_double(operation), *values)
        if operation in ("SIN", "COS"):
            if ("sincos", *values) not in m.memo:
                m.memo["sincos", *values] = m.pair(self._sincos(), *values)
            return m.memo["sincos", *values][operation == "COS"]
        if operation in CALLED:
            return m.apply(self._called(operation), *values)
        if operation == "FNMA" and m.is_fused(values[0]):
            values = (values[1], values[0], values[2])  # the other factor is negated at no cost
        return lowering.lower(m, operation, *values)

    def add_function(self, program: Program, name: str, head: str | None = None) -> str:
        """A program as `void name(in0, …, out0, …)` over arrays, which may overlap; returns the name.

        Results are stored when everything is computed. `head` is the function's first line, where the unit's own
        will not do.
        """
        ports = port_names(program)
        inputs = [[f"{ports[k]}[{e}]" for e in range(port.size)] for k, port in enumerate(program.inputs)]
        m = self.machine()
        outputs = walk(m, program, inputs, self._caller(m), self.lower)
        read = {entry for entries in inputs for entry in entries}
        names = ports[len(inputs) :]
        stores = [  # an input that is handed through might be overwritten by an output before it: it is copied first
            f"{names[k]}[{e}] = {m.copy(value) if value.lstrip('-') in read else value};"
            for k, values in enumerate(outputs)
            for e, value in enumerate(values)
        ]
        body = m.text(stores)
        unread = [f"(void){ports[k]};" for k in range(len(inputs)) if not re.search(rf"\b{ports[k]}\[", body)]
        lines = [head or f"{self.dialect.function}void {name}({parameters(program, self.dialect.real)})", "{"]
        lines += [f"    {line}" for line in unread]
        self.functions[name] = "\n".join([*lines, body, "}"])
        return name

    def _caller(self, m: CMachine) -> Callable[[Program, list[Value]], list[Value]]:
        def call(program: Program, arguments: list[Value]) -> list[Value]:
            name = f"{self.prefix}{identifier(program.name)}"
            if name not in self.functions:
                self.add_function(program, name)
            return m.call_program(name, program, arguments)

        return call

    def _sincos(self) -> str:
        name = f"{self.prefix}sincos"
        if name not in self.functions:
            real, m = self.dialect.real, self.machine()
            sine, cosine = polynomials.sincos(m, "x")
            body = m.text([f"*sine = {sine};", f"*cosine = {cosine};"])
            head = f"{self.dialect.function}void {name}({real} x, {real} *sine, {real} *cosine)"
            self.functions[name] = f"{head}\n{{\n{body}\n}}"
        return name

    def _in_double(self, operation: str) -> str:
        """An operation of one float that libm does not have: computed in double."""
        name = f"{self.prefix}{operation.lower()}f"
        if name not in self.functions:
            double = Unit(replace(self.dialect, real="double"), self.prefix)
            called = double._called(operation)
            head = f"{self.dialect.function}float {name}(float x)"
            self.functions |= double.functions
            self.functions[name] = f"{head}\n{{\n    return (float){called}((double)x);\n}}"
        return name

    def _called(self, operation: str) -> str:
        name = f"{self.prefix}{operation.lower()}"
        if name not in self.functions:
            real, m = self.dialect.real, self.machine()
            names = {"ATAN2": ("y", "x"), "HYPOT": ("a", "b")}.get(operation, ("x",))
            body = m.text([f"return {lowering.lower(m, operation, *names)};"])
            head = f"{self.dialect.function}{real} {name}({', '.join(f'{real} {each}' for each in names)})"
            self.functions[name] = f"{head}\n{{\n{body}\n}}"
        return name


def port_names(program: Program) -> list[str]:
    """C names of inputs and outputs, in this order: none twice, none a keyword or like a name of the machine's own."""
    names: list[str] = []
    for port in (*program.inputs, *program.outputs):
        name = identifier(port.name)
        if NAME.fullmatch(name):
            name += "_"
        while name in names:
            name += "_out"
        names.append(name)
    return names


def parameters(program: Program, real: str, sizes: Sequence[str] | None = None) -> str:
    """The parameter list of a program's function; `sizes` are what stands in the brackets of every array."""
    names, ports = port_names(program), (*program.inputs, *program.outputs)
    sizes = [str(port.size) for port in ports] if sizes is None else sizes
    const = ["const "] * len(program.inputs) + [""] * len(program.outputs)
    return ", ".join(f"{c}{real} {name}[{size}]" for c, name, size in zip(const, names, sizes, strict=True))


class CMachine(Machine):
    """Prints the body of one function. Identical operations are printed once; what is not used is not printed."""

    def __init__(self, unit: Unit):
        super().__init__()
        self.unit, self.dialect = unit, unit.dialect
        self._lines: list[tuple[tuple[str, ...], str]] = []  # what a statement defines, and its text
        self._printed: dict[str, str] = {}
        self._fused: set[str] = set()  # results of fma, and of functions that may end in one
        self._count = 0
        self._suffix = "f" if self.dialect.real == "float" else ""

    # Printing.

    def text(self, end: Sequence[str]) -> str:
        """The body that ends with those statements, without what neither they nor anything before them needs."""
        used = {name for line in end for name in NAME.findall(line)}
        kept = list(reversed(end))
        for defined, line in reversed(self._lines):
            if not defined or not used.isdisjoint(defined):
                used.update(NAME.findall(line))
                kept.append(line)
        return "\n".join(f"    {part}" for line in reversed(kept) for part in line.split("\n"))

    def copy(self, value: Value) -> Value:
        """The value under a name of its own."""
        return self._pure("v", self.dialect.real, value)

    def pair(self, name: str, *arguments: Value) -> tuple[Value, Value]:
        """Both results of a function `name(…, *first, *second)`."""
        first, second = self._fresh("v"), self._fresh("v")
        call = f"{name}({', '.join([*arguments, f'&{first}', f'&{second}'])});"
        self._lines.append(((first, second), f"{self.dialect.real} {first}, {second};\n{call}"))
        return first, second

    def apply(self, name: str, *arguments: Value) -> Value:
        """The result of a function of the unit."""
        return self._marked(self._real(f"{name}({', '.join(arguments)})"))

    def is_fused(self, value: Value) -> bool:
        """Whether a compiler might see a fused multiply-add behind that value."""
        return value in self._fused

    def _marked(self, value: Value) -> Value:
        self._fused.add(value)
        return value

    def call_program(self, name: str, program: Program, arguments: Sequence[Value]) -> list[Value]:
        """All results of a program's function, through arrays."""
        real, given = self.dialect.real, iter(arguments)
        arrays, lines, results = [], [], []
        for port in program.inputs:
            arrays.append(self._fresh("v"))
            entries = ", ".join(next(given) for _ in range(port.size))
            lines.append(f"const {real} {arrays[-1]}[{port.size}] = {{{entries}}};")
        for port in program.outputs:
            arrays.append(self._fresh("v"))
            lines.append(f"{real} {arrays[-1]}[{port.size}];")
            results += [f"{arrays[-1]}[{e}]" for e in range(port.size)]
        lines.append(f"{name}({', '.join(arrays)});")
        self._lines.append((tuple(arrays), "\n".join(lines)))
        self._fused.update(results)
        return results

    def _fresh(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"

    def _pure(self, letter: str, kind: str, expression: str) -> Value:
        if expression not in self._printed:
            name = self._printed[expression] = self._fresh(letter)
            self._lines.append(((name,), f"const {kind} {name} = {expression};"))
        return self._printed[expression]

    def _real(self, expression: str) -> Value:
        return self._pure("v", self.dialect.real, expression)

    def _truth(self, expression: str) -> Value:
        return self._pure("p", "int", expression)

    def _integer(self, expression: str) -> Value:
        return self._pure("i", self.dialect.integer, expression)

    def _function(self, name: str, *arguments: Value) -> Value:
        return self._real(f"{name}{self._suffix}({', '.join(arguments)})")

    # Reals.

    def constant(self, number: float) -> Value:
        return literal(number, self.dialect)

    def add(self, a, b):
        return self._real(f"{a} + {b}")

    def sub(self, a, b):
        return self._real(f"{a} - {b}")

    def mul(self, a, b):
        return self._real(f"{a} * {b}")

    def div(self, a, b):
        return self._real(f"{a} / {b}")

    def fma(self, a, b, c):
        return self._marked(self._function("fma", a, b, c))

    def neg(self, a):
        if self.dialect.guarded and self.is_fused(a):
            return self._real(f"{self.unit.prefix}negated({a})")
        return a[1:] if a.startswith("-") else f"-{a}"

    def fabs(self, a):
        return self._function("fabs", a)

    def copysign(self, a, b):
        return self._function("copysign", a, b)

    def sqrt(self, a):
        return self._function("sqrt", a)

    def floor(self, a):
        return self._function("floor", a)

    def ceil(self, a):
        return self._function("ceil", a)

    def trunc(self, a):
        return self._function("trunc", a)

    def rint(self, a):
        return self._function("rint", a)

    # Truth values.

    def lt(self, a, b):
        return self._truth(f"{a} < {b}")

    def le(self, a, b):
        return self._truth(f"{a} <= {b}")

    def eq(self, a, b):
        return self._truth(f"{a} == {b}")

    def ne(self, a, b):
        return self._truth(f"{a} != {b}")

    def both(self, p, q):
        return self._truth(f"{p} && {q}")

    def either(self, p, q):
        return self._truth(f"{p} || {q}")

    def inverse(self, p):
        return self._truth(f"!{p}")

    def select(self, p, a, b):
        return a if a == b else self._real(f"{p} ? {a} : {b}")

    # Integers: unsigned ones, whose arithmetic C defines; signs are compared with the top bit flipped.

    def bits(self, a):
        return self._integer(f"{self.unit.prefix}bits_of({a})")

    def from_bits(self, i):
        return self._real(f"{self.unit.prefix}from_bits({i})")

    def int_constant(self, number):
        return self.dialect.literal.format(number % (1 << 64))

    def int_add(self, i, j):
        return self._integer(f"{i} + {j}")

    def int_sub(self, i, j):
        return self._integer(f"{i} - {j}")

    def int_and(self, i, j):
        return self._integer(f"{i} & {j}")

    def int_or(self, i, j):
        return self._integer(f"{i} | {j}")

    def int_xor(self, i, j):
        return self._integer(f"{i} ^ {j}")

    def shift_left(self, i, count):
        return self._integer(f"{i} << {count}")

    def shift_right(self, i, count):
        return self._integer(f"{i} >> {count}")

    def arithmetic_shift_right(self, i, count):
        if count == 0:
            return i
        ones = self.int_constant(((1 << count) - 1) << (64 - count))
        sign = self._truth(f"({i} >> 63) != 0")
        return self._integer(f"({i} >> {count}) | ({sign} ? {ones} : {self.int_constant(0)})")

    def int_eq(self, i, j):
        return self._truth(f"{i} == {j}")

    def int_lt(self, i, j):
        top = self.int_constant(1 << 63)
        return self._truth(f"({i} ^ {top}) < ({j} ^ {top})")

    # Leaving the straight line.

    def call(self, name, *arguments):
        if name == "pow":
            return self.apply(self._pow(), *arguments)
        return self._function(name, *arguments)

    def rarely(self, mask, slow: Sequence[Slow], *fast):
        assert len(slow) == len(fast)
        results = []
        for (name, arguments), value in zip(slow, fast, strict=True):
            result = self._fresh("v")
            call = f"{name}{self._suffix}({', '.join(arguments)})"
            block = f"{self.dialect.real} {result} = {value};\nif ({mask}) {{\n    {result} = {call};\n}}"
            self._lines.append(((result,), block))
            results.append(result)
        return tuple(results)

    def _pow(self) -> str:
        """libm's pow through a function in which its exponent is no constant: compilers put x x in place of pow(x, 2)."""
        name, real = f"{self.unit.prefix}pow", self.dialect.real
        self.unit.functions[name] = (
            f"{self.dialect.function}{real} {name}({real} a, {real} b)\n"
            f"{{\n    const volatile {real} exponent = b;\n    return pow{self._suffix}(a, exponent);\n}}"
        )
        return name
