"""Memory of an exported controller: its structs, the stack of a step, and its code with constants."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from armwright.errors import ModelError
from armwright.export.controller.sil import FLAGS, find_compiler, run_program
from armwright.output import working_folder

CROSS = "arm-none-eabi-gcc"  # the compiler that is asked first, for a Cortex-M7
CORTEX_M7 = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
STRUCTS = ("state", "parameters", "measurement", "reference", "command")
_FUNCTION = re.compile(r"^(?:static )?(?:\w+ )+(\w+)\([^;{]*\)\n\{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
_FRAME = re.compile(r":(\w+)[\w.]*\t(\d+)\t")  # "control.part.0" is of "control"


@dataclass(frozen=True)
class Footprint:
    """Memory of a controller, in bytes; functions of <math.h> come on top.

    Attributes:
        target: what it was compiled for.   state: of one controller.   structs: of parameters, inputs and commands.
        stack: of the deepest call.   flash: code and constants.
    """

    target: str
    state: int
    structs: int
    stack: int
    flash: int

    @property
    def ram(self) -> int:
        """Bytes of state, structs and stack."""
        return self.state + self.structs + self.stack

    def __str__(self) -> str:
        parts = f"state {self.state:,}, other structs {self.structs:,}, stack {self.stack:,}"
        return f"{self.ram:,} bytes of RAM ({parts}) and {self.flash:,} of flash, {self.target}"

    def check(self, ram: int | None, flash: int | None) -> None:
        """Refuses a controller that is too large.

        Raises:
            ModelError: more than so many bytes; says what takes them.
        """
        for place, limit, taken in (("ram", ram, self.ram), ("flash", flash, self.flash)):
            if limit is not None and taken > limit:
                raise ModelError(
                    f"does not fit: it takes {self}", place=place, value=limit, expected=f"{taken} or more"
                )


def footprint(name: str, code: Mapping[str, str]) -> Footprint:
    """Memory of header and C file {file: text} of a controller.

    Raises:
        ModelError: there is no compiler, or it ends with an error.
    """
    cross = shutil.which(CROSS)
    compiler = cross or find_compiler()
    if compiler is None:
        raise ModelError("needs a compiler", place="ram, flash", expected=f"{CROSS}, or one of this computer")
    target = f"{Path(compiler).name}, {'Cortex-M7' if cross else 'this computer: another one differs'}"
    probe = f'#include "{name}.h"\n' + "".join(
        f"char bytes_of_{kind}[sizeof({name}_{kind})] = {{1}};\n" for kind in STRUCTS
    )
    tools = {tool: str(Path(compiler).with_name(f"arm-none-eabi-{tool}")) if cross else tool for tool in ("nm", "size")}
    with working_folder({**code, "probe.c": probe}) as work:
        for file in (f"{name}.c", "probe.c"):
            options = [*FLAGS, *(CORTEX_M7 if cross else ()), "-fstack-usage", "-c"]
            run_program([compiler, *options, str(work / file), "-o", str(work / f"{file}.o")])
        shown = run_program([tools["nm"], "-S", "-t", "d", str(work / "probe.c.o")])
        sizes = {kind: int(size) for size, kind in re.findall(r"^\d+ (\d+) \w bytes_of_(\w+)$", shown, re.MULTILINE)}
        text, data = run_program([tools["size"], "-B", "-d", str(work / f"{name}.c.o")]).splitlines()[1].split()[:2]
        frames: dict[str, int] = {}
        for function, size in _FRAME.findall("\n".join(path.read_text(encoding="utf-8") for path in work.glob("*.su"))):
            frames[function] = max(int(size), frames.get(function, 0))
    stack = _deepest(code[f"{name}.c"], frames)
    return Footprint(target, sizes.pop("state"), sum(sizes.values()), stack, int(text) + int(data))


def _deepest(text: str, frames: Mapping[str, int]) -> int:
    """Bytes of the deepest chain of calls; a function that has no frame of its own stands in its caller's."""
    depths: dict[str, int] = {}
    for function, body in _FUNCTION.findall(text):  # nothing recurses: a function calls those before it
        called = (depths.get(each, 0) for each in set(re.findall(r"\b(\w+)\(", body)))
        depths[function] = frames.get(function, 0) + max(called, default=0)
    return max(depths.values(), default=0)
