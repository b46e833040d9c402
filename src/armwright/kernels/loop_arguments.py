"""Arguments of a native loop: a table of 64-bit numbers and pointers. Running a loop from the cache needs no more than this."""

from __future__ import annotations

from armwright.kernels.stages import DelayStage, Exchange, RecordStage, RowsStage, Stage, TableStage, block_sizes

NUMBERS = ("tile0", "tile1", "tick0", "tick1", "last", "every", "h", "lane0", "seed", "origin", "substeps", "part")
REALS = ("h", "part")  # of them; part: of a segment that a substep is
POINTERS = ("queue", "tasks", "attempts", "ranks", "results")  # of numbers that all lanes share, and how many attempts
ROWS = ("tick", "offset", "values")  # of all lanes' schedules, one behind another


def argument_names(plan: tuple[Stage, ...]) -> list[str]:
    """Names of the 64-bit arguments in the native function's table, in order: numbers, then pointers."""
    names = [*NUMBERS, *(f"{block}.block" for block in block_sizes(plan))]
    for stage in plan:
        if isinstance(stage, TableStage):
            names.append(f"{stage.block}.table")
        elif isinstance(stage, RowsStage):
            names += [f"{stage.block}.rows.{part}" for part in ROWS]
        elif isinstance(stage, DelayStage):
            names.append(f"{stage.to}.ring")
        elif isinstance(stage, RecordStage):
            names += [f"{stage.name}.record", f"{stage.name}.stride"]
        elif isinstance(stage, Exchange):
            names += [f"{pointer}.shared" for pointer in POINTERS] + ["attempts.stride"]
    return names
