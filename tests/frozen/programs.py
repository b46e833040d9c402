"""Digests of programs: their operations and constants in order, without the names of ports and functions."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from armwright.errors import ModelError
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model
from armwright.program import Program
from armwright.program.passes import optimised

DIGITS = 16  # hexadecimal, of a digest


def digest(program: Program) -> str:
    """Digest of the operations that a machine gets to print, those of called programs included."""
    parts: dict[int, str] = {}  # CALLs repeat: their program is read once

    def called(callee: Program) -> str:
        if id(callee) not in parts:
            parts[id(callee)] = digest(callee)
        return parts[id(callee)]

    lines = [str([port.shape for port in (*program.inputs, *program.outputs)])]
    for i in optimised(program.instructions):
        constant = "" if i.constant is None else float(i.constant).hex()
        callee = "" if i.callee is None else called(i.callee)
        lines.append(f"{i.operation} {i.results} {i.arguments} {i.place} {constant} {callee}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:DIGITS]


def kernel_digests(arm: Model) -> dict[str, str]:
    """Digest of every kernel that an arm has, by name; those with all optional inputs stand behind them."""
    return dict(_digests(arm))


def _digests(arm: Model) -> Iterator[tuple[str, str]]:
    for name, signature in SIGNATURES.items():
        optional = tuple(argument.name for argument in signature.optional)
        for given in ((), optional) if optional else ((),):
            try:
                yield " + ".join((name, *given)), digest(trace_kernel(arm, signature, given))
            except ModelError:  # motor constants or a tip that the arm does not have
                yield name, "refused"
