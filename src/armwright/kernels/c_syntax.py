"""Syntax of C: its dialects, names that are identifiers, numbers that read back to the bit, parameter lists."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.kernels.format import DOUBLE, SINGLE, Format
from armwright.program import Program

NAME = re.compile(r"\b[vpi]\d+\b")  # values of ours in a line of text: reals, truths, integers
KEYWORDS = frozenset(
    {  # of C and C++
        *("auto", "break", "case", "char", "class", "const", "continue", "default", "delete", "do", "double", "else"),
        *("enum", "extern", "float", "for", "goto", "if", "inline", "int", "long", "namespace", "new", "operator"),
        *("private", "public", "register", "restrict", "return", "short", "signed", "sizeof", "static", "struct"),
        *("switch", "template", "this", "throw", "typedef", "union", "unsigned", "using", "virtual", "void"),
        *("volatile", "while"),
    }
)


@dataclass(frozen=True)
class Dialect:
    """Differences between C99 and CUDA C, double and float.

    Attributes:
        format: of the reals.   integer: the unsigned type of as many bits.   literal: how a constant of it is written.
        function: what stands before a function of the file's own.   infinity, nan: as expressions.
        never_inlined: what stands before one that must not be put into the body of its caller.
        guarded: whether a fused sum is negated by a function of the unit. GCC (12 at least) makes -fma(a, b, c) one
            instruction, -(a b) - c, which gives +0 where the other gives -0.
    """

    format: Format = DOUBLE
    integer: str = "uint64_t"
    literal: str = "UINT64_C(0x{:016x})"
    function: str = "static "
    never_inlined: str = "static NEVER_INLINED "
    infinity: str = "(double)INFINITY"  # which is a float, and clang warns of a promotion
    nan: str = "(double)NAN"
    guarded: bool = True

    @property
    def real(self) -> str:
        """ "double" or "float"."""
        return self.format.real


C_DOUBLE = Dialect()
C_FLOAT = Dialect(SINGLE, "uint32_t", "UINT32_C(0x{:08x})", infinity="INFINITY", nan="NAN")


def identifier(text: str) -> str:
    """A C identifier in the likeness of a name: `cmu-dd` → `cmu_dd`."""
    word = re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_")
    return f"arm_{word}".rstrip("_") if not word or word[0].isdigit() or word in KEYWORDS else word


def literal(value: float, dialect: Dialect) -> str:
    """A literal that reads back as that double (or as that float, rounded once)."""
    single = dialect.format is SINGLE
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
    """The parameter list of a program's function; `sizes` are what stands in the brackets of every array.

    A port without entries is left out: C has no such arrays.
    """
    names, ports = port_names(program), (*program.inputs, *program.outputs)
    sizes = [str(port.size) for port in ports] if sizes is None else sizes
    const = ["const "] * len(program.inputs) + [""] * len(program.outputs)
    rows = zip(const, names, sizes, ports, strict=True)
    return ", ".join(f"{c}{real} {name}[{size}]" for c, name, size, port in rows if port.size)
