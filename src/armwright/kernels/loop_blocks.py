"""A simulation loop's blocks in LLVM IR: loaded and stored, given to programs, and filled from the rows of schedules."""

from __future__ import annotations

from armwright.kernels.llvm import LlvmModule
from armwright.kernels.llvm_machine import LlvmMachine
from armwright.kernels.loop_arguments import ROWS
from armwright.kernels.machine import Value
from armwright.kernels.stages import CURSOR, NEVER, NEXT, SINCE, RowsStage, Stage, block_sizes, unspread
from armwright.program import Program


class BlockPrinter:
    """Prints into one function of a module.

    Attributes:
        m: the machine that prints.   w: lanes of a tile.   sizes: entries of every block.   schedules: stages whose rows
            the integration stops at.   rows: tables' rows that are no blocks; `%"NAME.at"` is then one number an entry.
    """

    def __init__(self, module: LlvmModule, plan: tuple[Stage, ...]):
        self.module, self.plan, self.w = module, plan, module.width
        self.m: LlvmMachine = module.machine()
        self.sizes = block_sizes(plan)
        self.schedules = [stage for stage in plan if isinstance(stage, RowsStage)]
        self.rows = unspread(plan)

    def _out(self, line: str) -> None:
        self.m.lines.append(line)

    def _program(self, program: Program) -> None:
        """A program called on blocks."""
        name = self.module.add_block_function(program, self.rows)
        ports = ", ".join(f'ptr %"{port.name}.at"' for port in (*program.inputs, *program.outputs))
        self._out(f"  call void @{name}({ports})")

    def _replace_blocks(self, program: Program) -> None:
        """Copies the next values of blocks, which the program computed, into the blocks."""
        for port in program.outputs:
            if port.name.endswith(NEXT):
                self._copy(f'%"{port.name.removesuffix(NEXT)}.at"', port.name, port.size)

    def _copy(self, target: Value, block: str, entries: int) -> None:
        size = 8 * entries * self.w
        self._out(f'  call void @llvm.memcpy.p0.p0.i64(ptr {target}, ptr %"{block}.at", i64 {size}, i1 false)')

    def _load(self, block: str, entry: int = 0) -> Value:
        return self.m.load(f'%"{block}.at"', entry)

    def _store(self, block: str, entry: int, value: Value) -> None:
        self.m.store(f'%"{block}.at"', entry, value)

    def _set(self, where: Value, block: str, value: Value, entry: int = 0) -> None:
        """Sets an entry of a block in the lanes where that is true."""
        self._store(block, entry, self.m.select(where, value, self._load(block, entry)))

    def _set_all(self, where: Value, block: str, source: str) -> None:
        """A block's entries become those of another one in the lanes where that is true."""
        for k in range(self.sizes[block]):
            self._set(where, block, self._load(source, k), k)

    def _splat(self, value: Value) -> Value:
        return self.m.spread(value, "double", self.m.real)

    def _int_splat(self, value: Value) -> Value:
        return self.m.spread(value, "i64", self.m.integer)

    def _rows(self, rows: RowsStage, label: str) -> None:
        """Rows that are due now replace the block, where any lane has one in this tick."""
        m, block = self.m, rows.block
        due = m.any(m.eq(self._load(f"{block}.due_tick"), self._splat("%tick")))
        with m.where(due, f"{label}.take", f"{label}.none"):
            name = f"advance.{rows.entries}"
            self.module.functions[name] = _advance(name, self.w, rows.entries)
            blocks = [f"{each}.at" for each in (SINCE, block, *(f"{block}.{part}" for part in CURSOR))]
            pointers = [*blocks, *(f"{block}.rows.{part}" for part in ROWS)]
            arguments = ", ".join(f'ptr %"{pointer}"' for pointer in pointers)
            self._out(f'  call void @"{name}"(double %tick, {arguments})')


def at_lane(**blocks: str) -> str:
    """Places of lane %l in blocks of one entry, as %NAME.at."""
    return "\n".join(f"  %{name}.at = getelementptr double, ptr %{block}, i64 %l" for name, block in blocks.items())


def _advance(name: str, w: int, entries: int) -> str:
    """For each lane of a tile: while its next row is due at (tick, since), that row's values, and on to the next row."""
    return f"""define internal void @"{name}"(double %tick, ptr %since, ptr %values, ptr %due_tick, ptr %due_offset, ptr %cursor,
    ptr %end, ptr %row_tick, ptr %row_offset, ptr %row_values) noinline nounwind {{
entry:
  br label %lane
lane:
  %l = phi i64 [ 0, %entry ], [ %l.next, %next ]
{at_lane(tick="due_tick", offset="due_offset", cursor="cursor", end="end", since="since")}
  %now = load double, ptr %since.at, align 8
  %last = load double, ptr %end.at, align 8
  br label %check
check:
  %due = load double, ptr %tick.at, align 8
  %offset = load double, ptr %offset.at, align 8
  %this = fcmp oeq double %due, %tick
  %past = fcmp ole double %offset, %now
  %now.due = and i1 %this, %past
  br i1 %now.due, label %take, label %next
take:
  %row.number = load double, ptr %cursor.at, align 8
  %row = fptosi double %row.number to i64
  %row.first = mul i64 %row, {entries}
  br label %entry.copy
entry.copy:
  %e = phi i64 [ 0, %take ], [ %e.next, %entry.copy ]
  %from.index = add i64 %row.first, %e
  %from = getelementptr double, ptr %row_values, i64 %from.index
  %value = load double, ptr %from, align 8
  %to.first = mul i64 %e, {w}
  %to.index = add i64 %to.first, %l
  %to = getelementptr double, ptr %values, i64 %to.index
  store double %value, ptr %to, align 8
  %e.next = add i64 %e, 1
  %e.more = icmp ult i64 %e.next, {entries}
  br i1 %e.more, label %entry.copy, label %taken
taken:
  %row.following = fadd double %row.number, 1.0
  store double %row.following, ptr %cursor.at, align 8
  %is.more = fcmp olt double %row.following, %last
  br i1 %is.more, label %following, label %none
following:
  %row.next = add i64 %row, 1
  %f.tick.at = getelementptr double, ptr %row_tick, i64 %row.next
  %f.offset.at = getelementptr double, ptr %row_offset, i64 %row.next
  %f.tick = load double, ptr %f.tick.at, align 8
  %f.offset = load double, ptr %f.offset.at, align 8
  store double %f.tick, ptr %tick.at, align 8
  store double %f.offset, ptr %offset.at, align 8
  br label %check
none:
  store double {NEVER:e}, ptr %tick.at, align 8
  br label %check
next:
  %l.next = add i64 %l, 1
  %l.more = icmp ult i64 %l.next, {w}
  br i1 %l.more, label %lane, label %done
done:
  ret void
}}"""
