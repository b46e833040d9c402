"""A simulation loop as a CUDA kernel: each thread takes one lane through the ticks.

The stages are those of `c_loop`, whose blocks are members of a struct that every thread has for itself. Blocks come from global
memory when a launch begins and go back there when it ends. There, warps of 32 lanes lie one behind another, and in each the lanes
stand side by side, so that neighbouring threads touch neighbouring numbers; so do rings of delays, and what is recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armwright.errors import ProgramError
from armwright.kernels.c import Unit
from armwright.kernels.c_loop import COUNTER, ClockWords, LoopText
from armwright.kernels.c_syntax import C_DOUBLE, identifier, literal
from armwright.kernels.cuda import CUDA, THREADS, WARP, cuda_text
from armwright.kernels.loop_arguments import ROWS
from armwright.kernels.stages import (
    CURSOR,
    NEVER,
    SINCE,
    Adapt,
    DelayStage,
    Integrate,
    RecordStage,
    RowsStage,
    Stage,
    TableStage,
    unspread,
)
from armwright.program import Program

LOOP = "loop"  # the kernel's name
LANE = "Lane"  # the struct's
#: Parameters behind the number of lanes: integers, then doubles; `origin` is the tick that records begin with.
INTEGERS = ("tick0", "tick1", "last", "every", "lane0", "seed", "origin", "substeps")
REALS = ("h_tick", "part")
CLOCK = ClockWords(
    "h_tick", "part", "substeps", "(unsigned long long)seed", "(unsigned long long)lane0 + (unsigned long long)lane"
)
RECORDED = ("record", "first")  # of a record: its numbers, and the first of the rows


def cuda_loop_source(*stages: Stage) -> str:
    """The kernel `loop(count, *INTEGERS, *REALS, state, …)` of stages; `pointers_of` says what stands behind `state`.

    Args:
        stages: of a tick.
    Returns:
        text: a file for NVRTC or nvcc with --fmad=false. The state is (warps, entries of all blocks, 32), in the order of
            `block_sizes`, tables (ticks from `tick0` on, entries), rows of schedules as in `Schedules`, rings
            (warps, length, entries, 32), records (rows from `first` on, entries, count).
    Raises:
        ProgramError: a stage that has no CUDA C: a search, an integration that looks for events or carries tangents.
    """
    return _Printer(stages).text()


def pointers_of(stages: tuple[Stage, ...]) -> list[tuple[Stage, str]]:
    """The kernel's parameters behind `state`, each with its stage: tables, schedules, rings, records; integers of the last."""
    found: list[tuple[Stage, str]] = []
    for stage in stages:
        if isinstance(stage, TableStage):
            found.append((stage, "table"))
        elif isinstance(stage, RowsStage):
            found += [(stage, part) for part in ROWS]
        elif isinstance(stage, DelayStage):
            found.append((stage, "ring"))
        elif isinstance(stage, RecordStage):
            found += [(stage, part) for part in RECORDED]
    return found


class _Printer(LoopText):
    """Prints one loop."""

    def __init__(self, stages: tuple[Stage, ...]):
        for stage in stages:
            further = getattr(stage, "landing", None) is not None or getattr(stage, "grazing", None) is not None
            if further or not hasattr(self, f"_{_kind(stage)}"):
                expected = "a simulation"
                raise ProgramError("carries tangents, or searches", place="loop on a GPU", expected=expected)
        super().__init__(Unit(CUDA, f"{LOOP}_"), stages, LANE, CLOCK)
        self.rings = {}  # they stay in global memory
        self._stages, self._unspread = stages, unspread(stages)
        self._schedules = [stage for stage in stages if isinstance(stage, RowsStage)]

    def text(self) -> str:
        """The file."""
        body = self.statements(self._stages)
        integers, reals = (
            ", ".join(f"{kind} {name}" for name in names)
            for kind, names in (("long long", INTEGERS), ("double", REALS))
        )
        arrays = []
        for stage, part in pointers_of(self._stages):
            kind = "const double *" if isinstance(stage, (TableStage, RowsStage)) else "double *"
            arrays.append(f"{'long long ' if part == RECORDED[1] else kind}{_name(stage, part)}")
        begun = {"tick": "(double)k", SINCE: "0.0"}
        numbers = "".join(f" (void){name};" for name in (*INTEGERS[2:], *REALS))
        lines = [
            f'extern "C" __global__ void __launch_bounds__({THREADS}) {LOOP}(long long count, {integers}, {reals},',
            f"    {', '.join(['double *state', *arrays])})",
            "{",
            "    const long long lane = (long long)blockIdx.x * blockDim.x + threadIdx.x;",
            "    if (lane >= count) {",
            "        return;",
            "    }",
            f"   {numbers}",
            f"    {LANE} memory;",
            f"    {LANE} *const l = &memory;",
            f"    double *const own = state + lane / {WARP} * {WARP * sum(self.sizes.values())} + lane % {WARP};",
            *self._moves("l->{name}[e] = own[({first} + e) * {warp}];"),
            "    for (long long k = tick0; k < tick1; k++) {",
            f"        l->{COUNTER} = (unsigned long long)k;",
            *(f"        l->{name}[0] = {value};" for name, value in begun.items() if name in self.sizes),
            *(f"        {line}" for line in body),
            "    }",
            *self._moves("own[({first} + e) * {warp}] = l->{name}[e];"),
            "}",
        ]
        members = [f"    {line}" for line in self.members({})]
        return cuda_text(self.unit, lines, [f"struct {LANE} {{", *members, "};", ""])

    def _moves(self, statement: str) -> list[str]:
        """A statement for each entry of every block."""
        lines, first = [], 0
        for name, size in self.sizes.items():
            lines.append(f"    for (int e = 0; e < {size}; e++) {{")
            lines += [f"        {statement.format(name=identifier(name), first=first, warp=WARP)}", "    }"]
            first += size
        return lines

    def call(self, program: Program, places: Mapping[str, str] | None = None) -> str:
        """The statement that calls a program on blocks, and on rows of tables where they lie."""
        rows = {port.name: f"{identifier(port.name)}_row" for port in program.inputs if port.name in self._unspread}
        return super().call(program, rows | dict(places or {}))

    # Stages.

    def _table(self, stage: TableStage) -> list[str]:
        row = f"{identifier(stage.block)}_row"
        lines = [f"const double *const {row} = {_name(stage, 'table')} + (k - tick0) * {stage.entries};"]
        if stage.spread:
            lines.append(f"memcpy(l->{identifier(stage.block)}, {row}, sizeof l->{identifier(stage.block)});")
        return lines

    def _rows(self, stage: RowsStage) -> list[str]:
        """Rows that are due now replace the block."""
        block, (due, offset, row, end) = identifier(stage.block), _cursor(stage)
        ticks, offsets, values = (_name(stage, part) for part in ROWS)
        return [
            f"while ({due} == (double)k && {offset} <= l->{SINCE}[0]) {{",
            f"    const long long row = (long long){row};",
            f"    for (int e = 0; e < {stage.entries}; e++) {{",
            f"        l->{block}[e] = {values}[row * {stage.entries} + e];",
            "    }",
            f"    {row} += 1.0;",
            f"    if ({row} < {end}) {{",
            f"        {due} = {ticks}[row + 1];",
            f"        {offset} = {offsets}[row + 1];",
            "    } else {",
            f"        {due} = {literal(NEVER, C_DOUBLE)};",
            "    }",
            "}",
        ]

    def _record(self, stage: RecordStage) -> list[str]:
        record, first = (_name(stage, part) for part in RECORDED)
        lines = ["if ((k - origin) % every == 0) {"]
        lines.append(
            f"    double *const row = {record} + ((k - origin) / every - {first}) * {sum(stage.entries)} * count + lane;"
        )
        column = 0
        for block, entries in zip(stage.blocks, stage.entries, strict=True):
            if entries:
                lines.append(f"    for (int e = 0; e < {entries}; e++) {{")
                lines += [f"        row[({column} + e) * count] = l->{identifier(block)}[e];", "    }"]
            column += entries
        return [*lines, "}"]

    def _delay(self, stage: DelayStage) -> list[str]:
        block, to = identifier(stage.block), identifier(stage.to)
        row = stage.entries * WARP
        return [
            "{",
            f"    double *const ring = {_name(stage, 'ring')} + lane / {WARP} * {stage.length * row} + lane % {WARP};",
            f"    const long long slot = k % {stage.length}, back = slot - (long long)l->{identifier(stage.by)}[0];",
            f"    const long long old = back < 0 ? back + {stage.length} : back;",
            f"    for (int e = 0; e < {stage.entries}; e++) {{",
            f"        ring[slot * {row} + e * {WARP}] = l->{block}[e];",
            "    }",
            f"    for (int e = 0; e < {stage.entries}; e++) {{",
            f"        l->{to}[e] = ring[old * {row} + e * {WARP}];",
            "    }",
            "}",
        ]

    def _segments(self, stage: Integrate | Adapt, inner: Sequence[str]) -> list[str]:
        return ["if (k >= last) {", "    continue;", "}", *super()._segments(stage, inner)]

    def _due_rows(self) -> list[str]:
        return [line for stage in self._schedules for line in self._rows(stage)]

    def _next_rows(self) -> list[str]:
        rows = [_cursor(stage)[:2] for stage in self._schedules]
        return [f"edge = ({due} == (double)k && {offset} < edge) ? {offset} : edge;" for due, offset in rows]


def _kind(stage: Stage) -> str:
    return type(stage).__name__.removesuffix("Stage").lower()


def _name(stage: Stage, part: str) -> str:
    """A parameter of the kernel."""
    block = stage.to if isinstance(stage, DelayStage) else stage.name if isinstance(stage, RecordStage) else stage.block  # type: ignore[union-attr]
    return f"{identifier(block)}_{part}"


def _cursor(stage: RowsStage) -> list[str]:
    """Members of the struct: tick and offset of a lane's next row, its number, and the one behind the lane's last."""
    return [f"l->{identifier(f'{stage.block}.{part}')}[0]" for part in CURSOR]
