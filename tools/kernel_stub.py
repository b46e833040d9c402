"""Types of the kernels' methods for editors and type checkers: `src/armwright/kernels/kernel_methods.pyi`, from the table.

    python tools/kernel_stub.py

A test compares the file with what this would write.
"""

from __future__ import annotations

import sys
from pathlib import Path

from armwright.kernels.kernel_methods import KernelMethods
from armwright.kernels.signatures import PARAMETERS, SIGNATURES, Signature

PATH = Path(__file__).resolve().parents[1] / "src" / "armwright" / "kernels" / "kernel_methods.pyi"
WIDTH = 120  # of a line, as the formatter has it

HEAD = '''\
# Made by tools/kernel_stub.py from the table in signatures.py; do not edit.
"""KernelMethods: a method for every kernel of the table, with signature and docstring."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armwright.kernels.signatures import Signature

Real = TypeVar("Real", bound=np.floating)
OPTIONS: dict[str, str]

class KernelMethod:
    """A method that an arm may have as a native function, from its first use on."""

    function: Callable[..., Any]
    form: str
    def __init__(self, function: Callable[..., Any], form: str) -> None: ...
    def __get__(self, arm: Any, kind: Any = None) -> Callable[..., Any]: ...

def kernel_method(signature: Signature) -> KernelMethod:
    """The method of a row of the table."""

class KernelMethods(Generic[Real]):
    """Methods of `CompiledArm`, one for each kernel."""
'''


def stub() -> str:
    """Text of the file."""
    return HEAD + "".join(f"\n{method(signature)}" for signature in SIGNATURES.values())


def method(signature: Signature) -> str:
    """One method: arguments, results, docstring. `parameters` stands last, where no other call is hindered by it."""
    result = "NDArray[Real]"
    if len(signature.outputs) > 1:
        result = f"tuple[{', '.join([result] * len(signature.outputs))}]"
    arguments = [
        "self",
        *(f"{a.name}: ArrayLike" for a in signature.inputs),
        *(f"{name}: ArrayLike | None = None" for name in (*(a.name for a in signature.optional), PARAMETERS)),
        "*",
        *(f"{name}: str | None = None" for name in signature.options),
        f"out: {result} | None = None",
    ]
    in_one = f"        {', '.join(arguments)}"
    rows = [in_one] if len(in_one) <= WIDTH else [f"        {each}," for each in arguments]
    lines = [f"    def {signature.name}(", *rows, f"    ) -> {result}:"]
    text = getattr(KernelMethods, signature.name).__doc__
    first, *others = text.replace("\\", "\\\\").split("\n")
    lines.append(f'        """{first}')
    lines += [f"        {line}" if line else "" for line in others]
    return "\n".join([*lines, '        """', ""])


def main() -> int:
    """Writes the file."""
    PATH.write_text(stub(), encoding="utf-8")
    print(PATH)
    return 0


if __name__ == "__main__":
    sys.exit(main())
