"""The header of an exported C library: how to compile it, and every function with its equation, arrays, units and stack.

Comments are ASCII, whatever a robot's file or an equation has in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from armwright.errors import ModelError
from armwright.export.c_arithmetic import FAULTS
from armwright.export.c_function import CFunction
from armwright.kernels.c_syntax import identifier, parameters, port_names
from armwright.model import Model

WIDTH = 100  # of a function's first line, above which its parameters stand below each other

LONGEST_NAME = 200  # of an export: with an ending such as _selftest.c it is the name of a file, of at most 255 bytes

#: [bytes] What the functions that a kernel's function calls, and registers that are saved, take of the stack.
CALLS = 128
_BYTES = {"double": 8, "float": 4}
_ACCURACY = {
    "double": "Double precision: the bits of Armwright's compiled kernels, where fma() rounds once.",
    "float": "Single precision: the bits of Armwright's compiled float32 kernels, where fmaf() rounds once.",
}
_CORES = {
    "double": "-mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard",
    "float": "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard",
}


def export_name(text: str) -> str:
    """The C identifier, made from a name, that the files and functions of an export begin with.

    Raises:
        ModelError: it is longer than a file's name can be.
    """
    word = identifier(text)
    if len(word) > LONGEST_NAME:
        what = f"has {len(word)} characters, and is the beginning of the files' names"
        raise ModelError(what, place="name", value=word, expected=f"at most {LONGEST_NAME} characters")
    return word


def header(
    arm: Model, functions: Sequence[CFunction], real: str, waiting: Mapping[str, int], notes: Sequence[str] = ()
) -> str:
    """The header's text.

    Args:
        arm, functions: that are written.   real: type.   waiting: number of values on the stack while a function runs, by its
            name.   notes: about the arm.
    """
    name = functions[0].library
    guard = f"{name.upper()}_H"
    parts = [
        comment([*_top(arm, name, real), *(["", *map("Note: {}".format, notes)] if notes else [])]),
        f"#ifndef {guard}\n#define {guard}",
        f"#define {_macro(name)} {arm.n}",
        '#ifdef __cplusplus\nextern "C" {\n#endif',
        f"{_on_arithmetic()}\nint {name}_arithmetic(void);",
        *(f"{_documented(arm, f, stack(waiting[f.name], real))}\n{prototype(f, real)};" for f in functions),
        "#ifdef __cplusplus\n}\n#endif",
        "#endif",
    ]
    return "\n\n".join(parts) + "\n"


def stack(waiting: int, real: str) -> int:
    """Approximate stack of a function [bytes], from the number of values on it."""
    return -(-(waiting * _BYTES[real] + CALLS) // 8) * 8


def prototype(function: CFunction, real: str) -> str:
    """The function's first line, its arrays' sizes in numbers of joints; long ones over several lines."""
    sizes = [" * ".join(_sizes(function, k)) or "1" for k in range(len(function.form.arguments))]
    line = f"void {function.name}({parameters(function.program, real, sizes)})"
    return line if len(line) <= WIDTH else line.replace("(", "(\n    ", 1).replace(", ", ",\n    ")


def _top(arm: Model, name: str, real: str) -> list[str]:
    title = arm.description.title if arm.description is not None else ""
    files = f"{name}.c {name}_selftest.c"
    return [
        f"{arm.name}: {title}" if title else arm.name,
        "",
        "Made by Armwright from the robot's file; do not edit, make it again.",
        "",
        _ACCURACY[real],
        "Matrices are row-major, results are written only. Arrays may overlap. Functions keep no state, allocate nothing",
        "and do not recurse: any number may run at a time.",
        "",
        "Compile with -ffp-contract=off and, where the processor has it in hardware, fused multiply-add:",
        f"  gcc -std=c99 -O2 -mfma -ffp-contract=off {files} -o selftest -lm",
        f"  clang -std=c99 -O2 -mfma -ffp-contract=off {files} -o selftest -lm",
        f"  arm-none-eabi-gcc -std=c99 -O2 {_CORES[real]} -ffp-contract=off -c {name}.c",
        "-mfma is for x86 only. Without such an instruction fma() is right but slow. Never compile with -ffast-math or parts",
        "of it: most are refused. Compile the self-test once with the options of your firmware: it prints a line a function,",
        "and ends with 0 if all are met, to the bit.",
        "",
        "What is said of the stack is an estimate: compilers were seen to take from a half to two and a half times as much.",
        "gcc -fstack-usage tells.",
        "",
        "Joints, in the order of every array over joints:",
        *(
            f"  [{k}] {body.joint} ({body.kind.name}, {body.kind.units.position})"
            for k, body in enumerate(arm.coordinates)
        ),
    ]


def _on_arithmetic() -> str:
    first = "0 if the C file was compiled by the rules of IEEE 754, on which its bits rest; else what breaks them:"
    return comment([first, "", *(f"  {value}  {meaning}" for value, meaning in enumerate(FAULTS))])


def _documented(arm: Model, function: CFunction, stack: int) -> str:
    """The equation, what is fixed, and every array with shape, unit and what the docstring says of it."""
    form, names = function.form, port_names(function.program)
    doc = form.signature.function.__doc__ or ""
    fixed = [f"Here {argument.name} = 0." for argument in form.left_out]
    fixed += [f"Here {option} = {value!r}." for option, value in form.options]
    if "frame" in form.signature.options and "frame" not in dict(form.options):
        fixed.append(f"Here frame = {arm.tip!r}, the arm's tip.")
    shapes = [f"({', '.join(_sizes(function, k))})" for k in range(len(function.form.arguments))]
    wide, long = max(map(len, names)), max(map(len, shapes))
    rows = []
    for k, (name, shape, argument) in enumerate(zip(names, shapes, function.form.arguments, strict=True)):
        side = "out" if k >= len(function.program.inputs) else "in"
        rows.append(f"  {side:3}  {name:{wide}}  {shape:{long}}  [{argument.unit}]")
        if text := described(doc, argument.name):
            rows.append(f"       {'':{wide}}  {text}")
    return comment([*_equation(doc), *fixed, "", *rows, "", f"Stack: about {stack} bytes."])


def _equation(doc: str) -> list[str]:
    """The docstring's first paragraph, and those before its arguments that have an equation."""
    first, *rest = (part for part in doc.split("Args:")[0].split("\n\n"))
    lines = [line.strip() for part in (first, *(part for part in rest if " = " in part)) for line in part.split("\n")]
    return [line for line in lines if line]


def described(doc: str, name: str) -> str:
    """Text of a docstring on an argument or a result beside its shape and unit; empty where it has several units.

    `tau: (n,) [N m | N] motor torque.   u: …` → "motor torque"
    """
    match = re.search(rf"(?:^|\s{{3,}}){name}: \([^)]*\)(.*?)(?=\.?\s{{3,}}\w+: |\n\s*\w+:\s|\Z)", doc, re.S | re.M)
    before, _, behind = " ".join(match[1].split() if match else ()).partition("[")
    return (before or ("" if "[" in behind else behind.partition("]")[2])).strip(" ,;.")


def _macro(name: str) -> str:
    return f"{name.upper()}_JOINTS"


def _sizes(function: CFunction, k: int) -> list[str]:
    """The sizes of an argument as C: `2n` is twice the number of joints, those that also count joints without a q are numbers."""
    port = (*function.program.inputs, *function.program.outputs)[k]
    return [
        _size(function.library, size, number)
        for size, number in zip(function.form.arguments[k].shape, port.shape, strict=True)
    ]


def _size(name: str, size: int | str, number: int) -> str:
    if isinstance(size, int) or not size.endswith("n"):
        return str(number)
    times = size.removesuffix("n")
    return f"{times} * {_macro(name)}" if times else _macro(name)


#: Words for signs that ASCII has not, and for what would end or begin a comment or a trigraph.
_WORDS = (
    {"τ": "tau", "θ": "theta", "ω": "omega", "η": "eta", "λ": "lambda", "Λ": "Lambda", "Γ": "Gamma", "π": "pi"}
    | {"Σ": "sum", "∂": "d", "Δ": "delta", "δ": "delta ", "Ṁ": "Mdot", "ẋ": "xdot", "v̇": "vdot", "ω̇": "omegadot"}
    | {"q̇": "qd", "q̈": "qdd", "J̇": "Jdot", "·": "*", "×": "x", "−": "-", "–": "-", "≤": "<=", "≥": ">="}
    | {"≈": "~", "→": "->", "…": "...", "√": "sqrt", "⁻": "^-", "¹": "1", "ᵀ": "^T", "²": "^2", "³": "^3"}
    | {"½": "1/2", "*/": "* /", "/*": "/ *", "??": "? ?"}
)


def comment(lines: Iterable[str]) -> str:
    """Lines as one comment."""
    return "\n".join(["/*", *(f" * {plain(line)}".rstrip() for line in lines), " */"])


def plain(line: str) -> str:
    """A line in ASCII for a comment: Greek letters by name, other characters by number."""
    line = "".join(c if c.isprintable() else " " for c in line)
    for mark in sorted(_WORDS, key=len, reverse=True):
        line = line.replace(mark, _WORDS[mark])
    line = line.encode("ascii", "backslashreplace").decode("ascii")
    return line.replace("*/", "* /").replace("??", "? ?")
