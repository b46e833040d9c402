"""The machine that prints C: a value is a name, a literal or an array entry; every operation is one statement.

The text says each IEEE operation by itself: a fused multiply-add is a call of fma(), and no product stands in the same
expression as a sum, so that a compiler which keeps to the standard has nothing to contract.
"""

# ruff: noqa: D102  What the operations do is said where they are declared, in `Machine`.

from __future__ import annotations

from collections.abc import Sequence

from armwright.kernels.c_syntax import NAME, Dialect, literal
from armwright.kernels.machine import Machine, Slow, Value
from armwright.program import Program

FUNCTIONS = ("fabs", "copysign", "sqrt", "floor", "ceil", "trunc", "rint")  # of <math.h>

# Operation: the letter that names of its results begin with (v real, p truth, i integer), and its expression.
EXPRESSIONS = {
    "add": ("v", "{} + {}"),
    "sub": ("v", "{} - {}"),
    "mul": ("v", "{} * {}"),
    "div": ("v", "{} / {}"),
    "lt": ("p", "{} < {}"),
    "le": ("p", "{} <= {}"),
    "eq": ("p", "{} == {}"),
    "ne": ("p", "{} != {}"),
    "both": ("p", "{} && {}"),
    "either": ("p", "{} || {}"),
    "inverse": ("p", "!{}"),
    "bits": ("i", "{prefix}bits_of({})"),
    "from_bits": ("v", "{prefix}from_bits({})"),
    "int_add": ("i", "{} + {}"),
    "int_sub": ("i", "{} - {}"),
    "int_and": ("i", "{} & {}"),
    "int_or": ("i", "{} | {}"),
    "int_xor": ("i", "{} ^ {}"),
    "int_eq": ("p", "{} == {}"),
    "shift_left": ("i", "{} << {}"),
    "shift_right": ("i", "{} >> {}"),
}


class CMachine(Machine):
    """Prints the body of one function. Identical operations are printed once; what is not used is not printed.

    `functions` are those of the file, text by name, whose names begin with `prefix`; the body may need one more of them.
    """

    def __init__(self, dialect: Dialect, prefix: str, functions: dict[str, str]):
        super().__init__(dialect.format)
        self.dialect, self.prefix, self.functions = dialect, prefix, functions
        self._lines: list[tuple[tuple[str, ...], str]] = []  # what a statement defines, and its text
        self._printed: dict[str, str] = {}
        self._fused: set[str] = set()  # results of fma, and of functions that may end in one
        # arguments and results of each function's last call
        self._called: dict[str, tuple[list[Value], list[Value]]] = {}
        self._count = 0
        self._suffix = self.format.suffix

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
        """The value, stored under a new name."""
        return self._real(value)

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
        """True if a compiler might see a fused multiply-add behind that value."""
        return value in self._fused

    def _marked(self, value: Value) -> Value:
        self._fused.add(value)
        return value

    def call_program(self, name: str, program: Program, arguments: Sequence[Value]) -> list[Value]:
        """All results of a program's function, through arrays.

        A call whose arguments differ from the last one's by nothing but that one's results is the next step of an iteration:
        it is left out where these are what they were before. A conditional program is left out where it is not needed.
        """
        real, values = self.dialect.real, iter(arguments)
        arrays, lines, results = [], [], []
        before, returned = self._called.get(name, ([], []))
        changed = [k for k, pair in enumerate(zip(arguments, before, strict=False)) if pair[0] != pair[1]]
        goes_on = bool(before) and all(arguments[k] in returned for k in changed)
        for port in program.inputs:
            arrays.append(self._fresh("v"))
            entries = ", ".join(next(values) for _ in range(port.size))
            lines.append(f"const {real} {arrays[-1]}[{port.size}] = {{{entries}}};")
        first = 0
        for port in program.outputs:
            arrays.append(self._fresh("v"))
            kept = f" = {{{', '.join(returned[first : first + port.size])}}}" if goes_on else ""
            kept = " = {0}" if program.conditional else kept
            lines.append(f"{real} {arrays[-1]}[{port.size}]{kept};")
            results += [f"{arrays[-1]}[{e}]" for e in range(port.size)]
            first += port.size
        call = f"{name}({', '.join(arrays)});"
        differs = " || ".join(f"{arguments[k]} != {before[k]}" for k in changed)
        differs = f"{arguments[0]} != 0" if program.conditional else differs
        lines.append(f"if ({differs}) {{\n    {call}\n}}" if goes_on or program.conditional else call)
        self._called[name] = list(arguments), results
        self._lines.append((tuple(arrays), "\n".join(lines)))
        self._fused.update(results)
        return results

    def _fresh(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"

    def _pure(self, letter: str, expression: str) -> Value:
        if expression not in self._printed:
            kind = {"v": self.dialect.real, "p": "int", "i": self.dialect.integer}[letter]
            name = self._printed[expression] = self._fresh(letter)
            self._lines.append(((name,), f"const {kind} {name} = {expression};"))
        return self._printed[expression]

    def _real(self, expression: str) -> Value:
        return self._pure("v", expression)

    def _function(self, name: str, *arguments: Value) -> Value:
        return self._real(f"{name}{self._suffix}({', '.join(arguments)})")

    def operate(self, name, *values):
        if name in FUNCTIONS:
            return self._function(name, *values)
        letter, expression = EXPRESSIONS[name]
        return self._pure(letter, expression.format(*values, prefix=self.prefix))

    # What C writes in another way than by an operator or a function.

    def constant(self, number: float) -> Value:
        return literal(number, self.dialect)

    def int_constant(self, number):
        return self.dialect.literal.format(number % (1 << self.format.bits))

    def fma(self, a, b, c):
        return self._marked(self._function("fma", a, b, c))

    def neg(self, a):
        if self.dialect.guarded and self.is_fused(a):
            return self._real(f"{self.prefix}negated({a})")
        return a[1:] if a.startswith("-") else f"-{a}"

    def select(self, p, a, b):
        return a if a == b else self._real(f"{p} ? {a} : {b}")

    def arithmetic_shift_right(self, i, count):
        if count == 0:
            return i
        ones = self.int_constant(((1 << count) - 1) << (self.format.bits - count))
        sign = self._pure("p", f"({i} >> {self.format.bits - 1}) != 0")
        return self._pure("i", f"({i} >> {count}) | ({sign} ? {ones} : {self.int_constant(0)})")

    def int_lt(self, i, j):
        # Integers are unsigned, as C defines their overflow: the top bit is flipped to compare signs.
        top = self.int_constant(1 << (self.format.bits - 1))
        return self._pure("p", f"({i} ^ {top}) < ({j} ^ {top})")

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
        name, real = f"{self.prefix}pow", self.dialect.real
        self.functions[name] = (
            f"{self.dialect.function}{real} {name}({real} a, {real} b)\n"
            f"{{\n    const volatile {real} exponent = b;\n    return pow{self._suffix}(a, exponent);\n}}"
        )
        return name
