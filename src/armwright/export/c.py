"""An arm as a C library: one header, one C99 file, and a program that tests them against the float reference.

The functions have the bits of the compiled kernels: in double of the usual ones, in float of those of
`aw.compile(arm, dtype="float32")`.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from armwright.errors import ModelError, OutputError, check_known
from armwright.export.c_arithmetic import arithmetic
from armwright.export.c_function import WRITTEN, c_functions, parse_form
from armwright.export.c_header import comment, export_name, header, prototype
from armwright.export.c_selftest import selftest
from armwright.kernels.c import REALS, Unit, c_text
from armwright.kernels.compiled import KERNELS
from armwright.kernels.signatures import SIGNATURES
from armwright.model import Model
from armwright.output import whole_file

SUPPORT = KERNELS.named("export c")


def write_c(arm: Model, functions: Sequence[str], folder: str | Path, real: str = "double") -> list[Path]:
    """Writes `NAME.h`, `NAME.c` and `NAME_selftest.c` for an arm, NAME a C identifier made from the arm's name.

    All three are written or none; files of those names that are there already are replaced.

    Args:
        arm: the model.
        functions: kernels by name, with optional inputs as in "inverse_dynamics+wrench" and options as in
            "forward_kinematics:frame=tool"; in C `NAME_inverse_dynamics_wrench`, `NAME_forward_kinematics_tool`.
        folder: created if it does not exist.   real: "double" or "float".
    Returns:
        paths: the header, the C file, the self-test.
    Raises:
        ModelError: an unknown function, input, option or frame, two functions that C would call alike, or one that needs
            what the arm lacks, such as a motor constant or a tip. A name of more than 200 characters.
        OutputError: the folder or a file cannot be written.
    """
    texts = c_library(arm, functions, real)
    with files_to_write(Path(folder), texts):
        pass
    return [Path(folder) / name for name in texts]


def c_library(arm: Model, functions: Sequence[str], real: str = "double") -> dict[str, str]:
    """The texts that `write_c` writes, by file name: header, C file, self-test.

    Raises:
        ModelError: as `write_c`.
    """
    check_known(ModelError, real, REALS, place="real")
    if not functions:
        raise ModelError("none is named", place="functions", expected=f"{WRITTEN}, NAME one of {', '.join(SIGNATURES)}")
    name = export_name(arm.name)
    chosen = c_functions(arm, name, [parse_form(text) for text in functions])
    unit = Unit(REALS[real], f"{name}_")
    for each in chosen:
        unit.add_function(each.program, each.name, prototype(each, real))
    unit.functions[f"{name}_arithmetic"] = arithmetic(name, real)
    top = comment([f"{name}.c: see {name}.h, which also says how this is compiled."])
    own_header = f'"{name}.h"'
    return {
        f"{name}.h": header(arm, chosen, real, unit.waiting, SUPPORT.notes(arm)),
        f"{name}.c": f"{top}\n\n{c_text(unit, [own_header])}",
        f"{name}_selftest.c": selftest(arm, name, chosen, real),
    }


@contextmanager
def files_to_write(folder: Path, texts: Mapping[str, str | bytes]) -> Iterator[Path]:
    """A folder with files of these texts, as by `folder_to_write`: all of them or, if the block fails, none.

    Args:
        folder: created if it does not exist.   texts: by the files' names.
    Raises:
        OutputError: the folder or a file cannot be written.
    """
    with folder_to_write(folder), ExitStack() as files:
        for name, text in texts.items():
            temporary = files.enter_context(whole_file(folder / name, follow_link=False))
            temporary.write_bytes(text if isinstance(text, bytes) else text.encode())
        yield folder


@contextmanager
def folder_to_write(folder: Path) -> Iterator[Path]:
    """A folder for output; if the block fails, a newly created folder is removed."""
    created = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be created, or is no folder: {error.strerror}", file=folder) from error
    try:
        yield folder
    except BaseException:
        if created:
            shutil.rmtree(folder, ignore_errors=True)
        raise
