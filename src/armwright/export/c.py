"""An arm as a C library: one header, one C99 file, and a program that tests them against the float reference.

In double the functions have the bits of the compiled kernels; in float each is the same program rounded to 24 bits, with
libm's functions of float (sinf, cosf …).
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from armwright.errors import ModelError, OutputError, nearest
from armwright.export.c_comment import comment
from armwright.export.c_selftest import CFunction, selftest
from armwright.kernels.c import REALS, c_text
from armwright.kernels.c_machine import Unit, identifier, parameters, port_names
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model
from armwright.simulation.output import whole_file

WIDTH = 100  # of a function's first line, above which its parameters stand below each other


def write_c(arm: Model, functions: Sequence[str], folder: str | Path, real: str = "double") -> list[Path]:
    """Writes `NAME.h`, `NAME.c` and `NAME_selftest.c` for an arm, NAME a C identifier made from the arm's name.

    All three are written or none; files of those names that are there already are replaced.

    Args:
        arm: the model.   functions: names of kernels, such as "inverse_dynamics".
        folder: where to; it is made where there is none.   real: "double" or "float".
    Returns:
        paths: the header, the C file, the self-test.
    Raises:
        ModelError: an unknown function, or one that needs what the arm lacks, such as a motor constant or a tip.
        OutputError: the folder or a file cannot be written.
    """
    texts = c_library(arm, functions, real)
    with _folder(Path(folder)) as place, ExitStack() as files:
        for name, text in texts.items():
            files.enter_context(whole_file(place / name)).write_text(text, encoding="ascii", newline="\n")
    return [Path(folder) / name for name in texts]


def c_library(arm: Model, functions: Sequence[str], real: str = "double") -> dict[str, str]:
    """The texts that `write_c` writes, by file name: header, C file, self-test.

    Raises:
        ModelError: an unknown function, or one that needs what the arm lacks.
    """
    if real not in REALS:
        raise ModelError(f"real = {real!r}: {nearest(real, REALS)}")
    name = identifier(arm.name)
    chosen = [_function(arm, each, name) for each in _known(functions)]
    return {
        f"{name}.h": _header(arm, name, chosen, real),
        f"{name}.c": _source(name, chosen, real),
        f"{name}_selftest.c": selftest(arm, name, chosen, real),
    }


def _known(functions: Sequence[str]) -> list[str]:
    wanted = list(dict.fromkeys(functions))
    unknown = [name for name in wanted if name not in SIGNATURES]
    if unknown or not wanted:
        what = f"no function {unknown[0]!r}" if unknown else "no function is named"
        raise ModelError(f"{what}; there is {', '.join(SIGNATURES)}")
    return wanted


def _function(arm: Model, name: str, prefix: str) -> CFunction:
    signature = SIGNATURES[name]
    program = trace_kernel(arm, signature)
    return CFunction(signature, program, f"{prefix}_{name}")


@contextmanager
def _folder(folder: Path) -> Iterator[Path]:
    """A folder to write in; where the block fails, one that was made for it is taken away again."""
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made or is no folder: {error.strerror}") from error
    try:
        yield folder
    except BaseException:
        if made:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def _macro(name: str) -> str:
    return f"{name.upper()}_JOINTS"


def _prototype(name: str, function: CFunction, real: str) -> str:
    sizes = []
    for argument in function.arguments:
        dims = [_size(name, size) for size in argument.shape]
        sizes.append(" * ".join(dims) if dims else "1")
    line = f"void {function.name}({parameters(function.program, real, sizes)})"
    return line if len(line) <= WIDTH else line.replace("(", "(\n    ", 1).replace(", ", ",\n    ")


def _documented(name: str, function: CFunction) -> str:
    """The equation, and every array with shape and unit."""
    equation = (function.signature.function.__doc__ or "").split("\n\n")[0].split("\n")
    names = port_names(function.program)
    shapes = [f"({', '.join(_size(name, size) for size in a.shape)})" for a in function.arguments]
    wide, long = max(map(len, names)), max(map(len, shapes))
    rows = [
        f"  {each:{wide}}  {shape:{long}}  [{argument.unit}]{'  result' * (k >= len(function.program.inputs))}"
        for k, (each, shape, argument) in enumerate(zip(names, shapes, function.arguments, strict=True))
    ]
    return comment([*(line.strip() for line in equation), "", *rows])


def _size(name: str, size: int | str) -> str:
    """A size of the table as C: `10n` is ten times the number of joints."""
    if isinstance(size, int):
        return str(size)
    times = size.removesuffix("n")
    return f"{times} * {_macro(name)}" if times else _macro(name)


def _header(arm: Model, name: str, functions: Sequence[CFunction], real: str) -> str:
    title = arm.description.title if arm.description is not None else ""
    accuracy = (
        "Double precision: the bits of Armwright's compiled kernels, where fma() rounds once."
        if real == "double"
        else "Single precision: the same operations rounded to 24 bits, with sinf, cosf ... of <math.h>."
    )
    top = [
        f"{arm.name}: {title}" if title else arm.name,
        "",
        "Made by Armwright from the robot's file; do not edit, make it again.",
        "",
        accuracy,
        "Matrices are row-major. Arrays may overlap. Functions keep no state: any number may run at a time.",
        "",
        "Joints, in the order of every array over joints:",
        *(f"  [{k}] {body.joint} ({body.kind})" for k, body in enumerate(arm.bodies)),
    ]
    guard = f"{name.upper()}_H"
    parts = [
        comment(top),
        f"#ifndef {guard}\n#define {guard}",
        f"#define {_macro(name)} {arm.n}",
        '#ifdef __cplusplus\nextern "C" {\n#endif',
        *(f"{_documented(name, each)}\n{_prototype(name, each, real)};" for each in functions),
        "#ifdef __cplusplus\n}\n#endif",
        "#endif",
    ]
    return "\n\n".join(parts) + "\n"


def _source(name: str, functions: Sequence[CFunction], real: str) -> str:
    unit = Unit(REALS[real], f"{name}_")
    for each in functions:
        unit.add_function(each.program, each.name, _prototype(name, each, real))
    build = [
        "Build with  -std=c99 -O2 -ffp-contract=off  and a processor that has fused multiply-add in hardware",
        "(x86: -mfma; Cortex-M7: -mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard); without one fma() is right but slow.",
        "Never with -ffast-math.",
    ]
    own = f'"{name}.h"'
    return f"{comment(build)}\n\n{c_text(unit, [own])}"
