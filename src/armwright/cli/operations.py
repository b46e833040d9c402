"""`armwright info --operations`: how many operations each kernel takes, and what every simplifying step saves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from armwright.cli.tables import table

if TYPE_CHECKING:
    from armwright.model import Model

PRODUCTS, SUMS = ("MUL", "SQ"), ("ADD", "SUB", "TWICE")


def operation_table(arm: Model) -> Any:
    """A row a kernel: products and sums as told, after each step on the arm; then all operations before and after the passes."""
    from rich.console import Group
    from rich.text import Text

    from armwright.errors import ModelError
    from armwright.kernels.signatures import SIGNATURES, trace_kernel
    from armwright.model.simplify import STEPS
    from armwright.program.passes import optimised

    columns = ["kernel", "products, sums as told", *(step.__name__.replace("_", " ") for step in STEPS)]
    columns += ["sin, cos", "operations", "after the passes"]
    rows, lacking = [], []
    for name, signature in SIGNATURES.items():
        try:
            programs, model = [trace_kernel(arm, signature, steps=())], arm
        except ModelError as error:
            lacking.append(str(error).removeprefix(f"{arm.name}: "))
            continue
        for step in STEPS:
            model = step(model) if step in signature.steps else model
            programs.append(trace_kernel(model, signature, steps=()))
        counts = [program.operation_counts() for program in programs]
        told = [f"{sum(c[o] for o in PRODUCTS)}, {sum(c[o] for o in SUMS)}" for c in counts]
        last = programs[-1].instructions
        left = [i for i in optimised(last) if i.operation not in ("INPUT", "OUTPUT", "CONST")]
        trigonometry = f"{counts[-1]['SIN']}, {counts[-1]['COS']}"
        rows.append([name, *told, trigonometry, str(sum(counts[-1].values())), str(len(left))])
    counted = table(f"{arm.name}: operations a state", columns, rows)
    return Group(*(part for part in (counted, *(Text(line, style="dim") for line in lacking)) if part is not None))
