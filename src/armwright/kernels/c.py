"""Program → C99 or CUDA C: the functions of one file, with what they need before them. No allocation, no library but <math.h>.

The text is one sequence of IEEE operations, the one that LLVM is given too: it has the bits of the compiled
kernels of its format wherever fma() rounds once, floating point is not contracted and libm is the same (it is called for
angles beyond 2^20 rad, in float 2^17, and for the few operations that have no polynomial of ours). Programs become
functions, and so do long polynomials. C99 and CUDA C differ in a handful of words, which the unit's `Dialect` holds.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from armwright.kernels import polynomials
from armwright.kernels.c_machine import CMachine
from armwright.kernels.c_syntax import C_DOUBLE, C_FLOAT, Dialect, identifier, parameters, port_names
from armwright.kernels.format import DOUBLE
from armwright.kernels.lowering import lower, walk, walk_instructions
from armwright.kernels.machine import Machine, Value
from armwright.program import Program
from armwright.program.cut import WHOLE, Cut, Piece, cut
from armwright.program.liveness import most_alive
from armwright.program.passes import optimised

REALS: dict[str, Dialect] = {"double": C_DOUBLE, "float": C_FLOAT}

# What a compiler must not do, in its own words: GCC ignores the standard's pragma and contracts by default outside of
# its ISO modes, the others know it. GCC's pragma parses the options anew, and with them an -fassociative-math that the
# command line had disabled. Clang has no macro for parts of -ffast-math but one. x87 registers round twice.
_RULES = """\
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "-ffast-math and its parts break this code: it relies on the rules of IEEE 754"
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "-ffinite-math-only breaks this code: it handles infinities and NaN"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "compile with -msse2 -mfpmath=sse: x87 rounds twice"
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize ("fp-contract=off", "no-associative-math")
#else
#pragma STDC FP_CONTRACT OFF
#endif
"""

# GCC's -fsingle-precision-constant has no macro; the size of the array is then negative.
_DOUBLE_LITERALS = "typedef char literals_are_double[sizeof 1.0 == sizeof(double) ? 1 : -1];\n"

# A long program is cut into functions for the compiler's sake; put back into one they would take it minutes.
_NEVER_INLINED = """\
#if defined(__GNUC__)
#define NEVER_INLINED __attribute__((noinline))
#else
#define NEVER_INLINED
#endif
"""

# Through memcpy, which compilers make a move of a register; a pointer of another type would break the aliasing rules.
_BITS = {
    "bits_of": """\
static {integer} {prefix}bits_of({real} x)
{{
    {integer} i;
    memcpy(&i, &x, sizeof i);
    return i;
}}
""",
    "from_bits": """\
static {real} {prefix}from_bits({integer} i)
{{
    {real} x;
    memcpy(&x, &i, sizeof x);
    return x;
}}
""",
    # GCC makes one instruction of -fma(a, b, c) that gives +0 where this gives -0; other compilers keep it as it is.
    "negated": """\
static {real} {prefix}negated({real} x)
{{
#if defined(__GNUC__) && !defined(__clang__)
    {integer} i;
    memcpy(&i, &x, sizeof i);
    i ^= {sign};
    memcpy(&x, &i, sizeof x);
    return x;
#else
    return -x;
#endif
}}
""",
}


#: Operations whose polynomial is printed once, as a function; sine and cosine share one.
CALLED = ("EXP", "LOG", "TAN", "ATAN", "TANH", "ATAN2", "ERFINV", "EXPM1", "HYPOT")


@dataclass
class Unit:
    """C text in the making: functions of one file, each printed once, in an order in which none is used before it stands.

    Attributes:
        dialect: C99 or CUDA, double or float.   prefix: what names of the file's own functions begin with.
        functions: text by name.   waiting: by the name of a program's function, how many numbers wait on the stack while
            it runs, as its text has it; a compiler spills fewer or more.
    """

    dialect: Dialect = C_DOUBLE
    prefix: str = ""
    functions: dict[str, str] = field(default_factory=dict)
    waiting: dict[str, int] = field(default_factory=dict)

    def machine(self) -> CMachine:
        """A machine that prints the body of one function of this unit."""
        return CMachine(self.dialect, self.prefix, self.functions)

    def uses(self, name: str) -> bool:
        """True if a function of the unit calls the one of that name, after the prefix."""
        return any(f"{self.prefix}{name}(" in text for text in self.functions.values())

    def lower(self, m: Machine, operation: str, *values: Value) -> Value:
        """An operation of the table: what takes more than a line or two is a call of a function of the unit."""
        assert isinstance(m, CMachine)
        if operation in ("SIN", "COS"):
            if ("sincos", *values) not in m.memo:
                m.memo["sincos", *values] = m.pair(self._sincos(), *values)
            return m.memo["sincos", *values][operation == "COS"]
        if operation in CALLED:
            return m.apply(self._called(operation), *values)
        if operation == "FNMA" and m.is_fused(values[0]):
            values = (values[1], values[0], values[2])  # the other factor is negated at no cost
        return lower(m, operation, *values)

    def add_function(self, program: Program, name: str, head: str | None = None) -> str:
        """A program as `void name(in0, …, out0, …)` over arrays, which may overlap; returns the name.

        A long program becomes functions of a few hundred operations each, which this one calls. `head` is its first
        line, where the unit's own will not do.
        """
        instructions = optimised(program.instructions)
        if len(instructions) <= WHOLE:
            lines, self.waiting[name] = self._whole(program), most_alive(instructions)
        else:
            parts = cut(instructions)
            lines, self.waiting[name] = self._in_pieces(program, name, parts), _waiting(program, parts)
        head = head or f"{self.dialect.function}void {name}({parameters(program, self.dialect.real)})"
        self.functions[name] = "\n".join([head, "{", *lines, "}"])
        return name

    def _whole(self, program: Program) -> list[str]:
        """A body in one. Results are stored when everything is computed."""
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
        unread = [f"    (void){ports[k]};" for k in range(len(inputs)) if inputs[k] and not _mentions(body, ports[k])]
        return [*unread, body]

    def _in_pieces(self, program: Program, name: str, parts: Cut) -> list[str]:
        """A body of calls. Pieces read copies of the inputs, as an output may lie over an input that is read later."""
        ports, real = port_names(program), self.dialect.real
        sizes = {port: each.size for port, each in zip(ports, program.inputs, strict=False) if each.size}
        work = _unlike("work", ports)
        copies = {port: _unlike(f"copy_of_{port}", [*ports, work]) for port in sizes}
        calls, used = [], set()
        for k, piece in enumerate(parts.pieces):
            function = f"{self.prefix}piece{k}_of_{name.removeprefix(self.prefix)}"
            arrays = self._add_piece(program, function, piece, work)
            calls.append(f"{function}({', '.join(copies.get(array, array) for array in arrays)});")
            used.update(arrays)
        lines = [f"{real} {copies[port]}[{size}];" for port, size in sizes.items() if port in used]
        lines.append(f"{real} {work}[{max(parts.slots, 1)}];")
        lines += [f"memcpy({copies[p]}, {p}, sizeof {copies[p]});" if p in used else f"(void){p};" for p in sizes]
        return [f"    {line}" for line in [*lines, *calls]]

    def _add_piece(self, program: Program, function: str, piece: Piece, work: str) -> list[str]:
        """`void function(…, work)` of the arrays that a piece uses; returns their names.

        What crosses the piece's ends waits in `work`, and is read before anything is stored there.
        """
        ports = port_names(program)
        inputs, outputs = ports[: len(program.inputs)], ports[len(program.inputs) :]
        values = {value: f"{work}[{slot}]" for value, slot in piece.loads.items()}
        m, waiting, stores = self.machine(), set(values.values()), []

        def store(place: str, value: Value) -> None:
            stores.append(f"{place} = {m.copy(value) if value.lstrip('-') in waiting else value};")

        walk_instructions(
            m,
            piece.instructions,
            values,
            lambda port, entry: f"{inputs[port]}[{entry}]",
            lambda port, entry, value: store(f"{outputs[port]}[{entry}]", value),
            self._caller(m),
            self.lower,
        )
        for value, slot in piece.stores.items():
            store(f"{work}[{slot}]", values[value])
        body = m.text(stores)
        used = [array for array in (*ports, work) if _mentions(body, array)]
        heads = [f"{'const ' * (array in inputs)}{self.dialect.real} *{array}" for array in used]
        self.functions[function] = f"{self.dialect.never_inlined}void {function}({', '.join(heads)})\n{{\n{body}\n}}"
        return used

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

    def _called(self, operation: str) -> str:
        name = f"{self.prefix}{operation.lower()}"
        if name not in self.functions:
            real, m = self.dialect.real, self.machine()
            names = {"ATAN2": ("y", "x"), "HYPOT": ("a", "b")}.get(operation, ("x",))
            body = m.text([f"return {lower(m, operation, *names)};"])
            head = f"{self.dialect.function}{real} {name}({', '.join(f'{real} {each}' for each in names)})"
            self.functions[name] = f"{head}\n{{\n{body}\n}}"
        return name


def _mentions(body: str, array: str) -> bool:
    return re.search(rf"\b{array}\[", body) is not None


def _waiting(program: Program, parts: Cut) -> int:
    """Numbers on the stack of a program in pieces: the inputs' copies, the slots, and those of the largest piece."""
    inside = max(most_alive(piece.instructions, piece.stores) for piece in parts.pieces)
    return sum(port.size for port in program.inputs) + parts.slots + inside


def _unlike(name: str, others: Sequence[str]) -> str:
    """A name that none of the others is: it gets underscores behind it until it differs."""
    while name in others:
        name += "_"
    return name


def c_text(unit: Unit, include: Iterable[str] = ()) -> str:
    """The C99 file of a unit: what it includes, the rules for the compiler, its functions."""
    dialect = unit.dialect
    words = {
        "real": dialect.real,
        "integer": dialect.integer,
        "sign": dialect.literal.format(1 << (dialect.format.bits - 1)),
    }
    helpers = [text.format(prefix=unit.prefix, **words) for name, text in _BITS.items() if unit.uses(name)]
    functions = list(unit.functions.values())
    no_inline = [_NEVER_INLINED] if any(text.startswith(dialect.never_inlined) for text in functions) else []
    headers = [*include, "<float.h>", "<math.h>"]
    headers += ["<stdint.h>"] * bool(helpers) + ["<string.h>"] * bool(helpers or no_inline)
    includes = "".join(f"#include {name}\n" for name in headers)
    literals = [_DOUBLE_LITERALS] * (dialect.format is DOUBLE)
    return "\n".join([includes, _RULES, *literals, *no_inline, *helpers, *(f"{text}\n" for text in functions)])


def c_source(program: Program, real: str = "double") -> str:
    """One program as a C99 file whose one function has its name: `void name(const real in0[…], …, real out0[…], …)`.

    Args:
        program: what is printed.   real: "double" or "float".
    Returns:
        text: the file. Arrays are row-major and may overlap.
    """
    name = identifier(program.name)
    unit = Unit(REALS[real], f"{name}_")
    unit.add_function(program, name, f"void {name}({parameters(program, real)})")
    return c_text(unit)
