"""Program → LLVM module. One SIMD lane per state of the batch.

Every function in a module works on tiles of W states. Programs that others call are functions over *blocks*: each entry
one vector of W lanes, so nothing is transposed between them. What Python calls are *batch* functions over row-major arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from armwright.kernels.format import DOUBLE, FORMATS, Format
from armwright.kernels.llvm_machine import LlvmMachine
from armwright.kernels.lowering import walk, walk_instructions
from armwright.kernels.machine import Value
from armwright.kernels.tiles import load_tile, store_tile, store_tile_loop
from armwright.program import Instruction, Program
from armwright.program.cut import WHOLE, Piece, cut
from armwright.program.passes import optimised

WIDE = 256  # columns of an output that are stored in a loop rather than a line
CACHE_LINE = 64  # bytes; a guess that is too small or too large costs a little time


@dataclass
class Module:
    """LLVM text in the making: functions, each printed once, and what they declare."""

    width: int
    format: Format = DOUBLE
    functions: dict[str, str] = field(default_factory=dict)
    declarations: set[str] = field(default_factory=set)
    definitions: dict[str, str] = field(default_factory=dict)

    def machine(self) -> LlvmMachine:
        """A machine that prints a function of this module."""
        return LlvmMachine(self.width, self.declarations, self.definitions, format=self.format)

    def text(self) -> str:
        """The module."""
        return "\n\n".join([*sorted(self.declarations), *self.definitions.values(), *self.functions.values()])

    def add_block_function(self, program: Program) -> str:
        """`void name(in0, …, out0, …)` over blocks, not inlined; returns its name."""
        name = f"{program.name}.block"
        if name not in self.functions:
            m = self.machine()
            inputs = [[m.load(f"%in{k}", e) for e in range(p.size)] for k, p in enumerate(program.inputs)]
            outputs = self._computed(m, program, inputs)
            for k, values in enumerate(outputs):
                for entry, value in enumerate(values):
                    m.store(f"%out{k}", entry, value)
            self._define(name, program, m)
        return name

    def add_batch_function(self, program: Program) -> str:
        """`void name(count, inputs, strides, outputs)` over row-major arrays; returns its name.

        `inputs` and `outputs` point to one pointer a port; `strides` says by how many reals an input moves a tile: its
        size times W, or 0 for one tile that serves all. A tail of fewer than W states is computed in padded copies.
        Beside it `<program>.whole(count, in0, …, out0, …)` serves arrays that hold every state, `<program>.apart(…)` does so
        where no output shares memory with an input, and says whether, and `<program>.bound(table)` takes a table in memory.
        """
        tile = f"{program.name}.tile"
        m = self.machine()
        inputs = [load_tile(m, f"%in{k}", port.size) for k, port in enumerate(program.inputs)]
        instructions = optimised(program.instructions)
        if len(instructions) <= WHOLE:
            for k, values in enumerate(walk(m, program, inputs, self.caller(m))):
                store_tile(m, f"%out{k}", values)
        else:
            blocks = self._in_pieces(m, program, instructions, inputs, batched=True)
            for k, (block, port) in enumerate(zip(blocks, program.outputs, strict=True)):
                if port.size <= WIDE or self.width == 1:
                    store_tile(m, f"%out{k}", [m.load(block, entry) for entry in range(port.size)])
                else:
                    m.lines.append(f"  call void @{self._store_function(port.size)}(ptr %out{k}, ptr {block})")
        self._define(tile, program, m)
        name = f"{program.name}.batch"
        self.functions[name] = _batch_loop(name, tile, program, self.width, self.format)
        self.functions[f"{program.name}.whole"] = _whole(f"{program.name}.whole", name, program, self.width)
        self.functions[f"{program.name}.apart"] = _apart(program, self.format)
        self.functions[f"{program.name}.bound"] = _bound(program)
        self.declarations.add("declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)")
        return name

    def _computed(self, m: LlvmMachine, program: Program, inputs: list[list[Value]]) -> list[list[Value]]:
        """A program's outputs: in one block, or, where it is long, in functions of a few thousand instructions each."""
        instructions = optimised(program.instructions)
        if len(instructions) <= WHOLE:
            return walk(m, program, inputs, self.caller(m))
        blocks = self._in_pieces(m, program, instructions, inputs)
        return [
            [m.load(pointer, entry) for entry in range(port.size)]
            for pointer, port in zip(blocks, program.outputs, strict=True)
        ]

    def _in_pieces(
        self,
        m: LlvmMachine,
        program: Program,
        instructions: list[Instruction],
        inputs: list[list[Value]],
        batched: bool = False,
    ) -> list[str]:
        """Calls of the pieces of a long program, tile by tile of a batch or alone; comes back with the blocks of its outputs."""
        ports = [[m.reserve(port.size) for port in side] for side in (program.inputs, program.outputs)]
        for pointer, values in zip(ports[0], inputs, strict=True):
            for entry, value in enumerate(values):
                m.store(pointer, entry, value)
        parts = cut(instructions)
        given = ", ".join(f"ptr {p}" for p in (*ports[0], *ports[1], m.reserve(max(parts.slots, 1))))
        ahead, share = self._fetches(program) if batched else [], len(parts.pieces)
        for k, piece in enumerate(parts.pieces):
            name = f"{program.name}.piece{k}"
            if name not in self.functions:
                self._add_piece(name, program, piece)
            m.lines.append(f"  call void @{name}({given})")
            m.lines += ahead[k * len(ahead) // share : (k + 1) * len(ahead) // share]
        return ports[1]

    def _fetches(self, program: Program) -> list[str]:
        """Prefetches of what the next tile reads and writes, to be spread over the work on this one.

        Rows of a hundred joints leave the cache; a burst of a tile's loads waits for memory, a few at a time do not.
        """
        self.declarations.add("declare void @llvm.prefetch.p0(ptr, i32, i32, i32)")
        lines = []
        for side, writes, ports in (("in", 0, program.inputs), ("out", 1, program.outputs)):
            for k, port in enumerate(ports):
                tile = port.size * self.width * self.format.bytes
                for offset in range(tile, 2 * tile, CACHE_LINE) if port.size <= WIDE else ():
                    name = f"%{side}{k}.next{offset}"
                    lines.append(
                        f"  {name} = getelementptr i8, ptr %{side}{k}, i64 {offset}\n"
                        f"  call void @llvm.prefetch.p0(ptr {name}, i32 {writes}, i32 2, i32 1)"
                    )
        return lines

    def _store_function(self, columns: int) -> str:
        """`void name(out, block)`: W rows of many columns from a block, in a loop."""
        name = f"store.{columns}"
        if name not in self.functions:
            m = self.machine()
            store_tile_loop(m, columns)
            head = f"define internal void @{name}(ptr noalias %out, ptr noalias readonly %block) noinline nounwind {{\nentry:"
            self.functions[name] = "\n".join([head, *m.lines, "  ret void", "}"])
        return name

    def _add_piece(self, name: str, program: Program, piece: Piece) -> None:
        """`void name(in0, …, out0, …, work)` over blocks: one piece, what crosses its ends waiting in `work`."""
        m = self.machine()
        values = {value: m.load("%work", slot) for value, slot in piece.taken.items()}

        def read(port: int, entry: int) -> Value:
            return m.load(f"%in{port}", entry)

        def write(port: int, entry: int, value: Value) -> None:
            m.store(f"%out{port}", entry, value)

        walk_instructions(m, piece.instructions, values, read, write, self.caller(m))
        for value, slot in piece.left.items():
            m.store("%work", slot, values[value])
        self._define(name, program, m, "ptr noalias %work")

    def caller(self, m: LlvmMachine):
        """How the walk prints a call of a block function: arguments and results through the stack."""

        def call(program: Program, arguments: list[Value]) -> list[Value]:
            name = self.add_block_function(program)
            pointers, given = [], iter(arguments)
            for port in program.inputs:
                pointer = m.reserve(port.size)
                for entry in range(port.size):
                    m.store(pointer, entry, next(given))
                pointers.append(pointer)
            results = [m.reserve(port.size) for port in program.outputs]
            m.lines.append(f"  call void @{name}({', '.join(f'ptr {p}' for p in [*pointers, *results])})")
            return [m.load(p, e) for p, port in zip(results, program.outputs, strict=True) for e in range(port.size)]

        return call

    def _define(self, name: str, program: Program, m: LlvmMachine, *more: str) -> None:
        parameters = [f"ptr noalias readonly %in{k}" for k in range(len(program.inputs))]
        parameters += [f"ptr noalias %out{k}" for k in range(len(program.outputs))]
        parameters += more
        # alignstack: LLVM does not align the stack for spilled vectors by itself, and split ones cost up to half the speed
        head = f"define internal void @{name}({', '.join(parameters)}) noinline nounwind alignstack({min(m.bytes, 64)})"
        head += " {\nentry:"
        self.functions[name] = "\n".join([head, *m.lines, "  ret void", "}"])


def _batch_loop(name: str, tile: str, program: Program, w: int, format: Format) -> str:
    """Full tiles in place; then the tail: its rows copied into a padded tile (filled up with its first row) and back.

    Not inlined into what calls it: three more copies of it would take a sixth of the time to compile, and gain nothing.
    """
    ins, outs = range(len(program.inputs)), range(len(program.outputs))
    real, bytes_ = format.real, format.bytes
    text = [f"define void @{name}(i64 %count, ptr %inputs, ptr %strides, ptr %outputs) noinline nounwind {{", "entry:"]
    for side, ports in (("in", program.inputs), ("out", program.outputs)):
        for k, port in enumerate(ports):
            text.append(f"  %{side}{k}.pad = alloca [{port.size * w} x {real}], align 64")
            text.append(f"  %{side}{k}.slot = getelementptr ptr, ptr %{side}puts, i64 {k}")
            text.append(f"  %{side}{k}.base = load ptr, ptr %{side}{k}.slot")
    for k in ins:
        text.append(f"  %in{k}.where = getelementptr i64, ptr %strides, i64 {k}")
        text.append(f"  %in{k}.stride = load i64, ptr %in{k}.where")
    text += [
        f"  %full = udiv i64 %count, {w}",
        f"  %rest = urem i64 %count, {w}",
        "  %any = icmp ne i64 %full, 0",
        "  br i1 %any, label %tiles, label %tail",
        "tiles:",
        "  %t = phi i64 [ 0, %entry ], [ %t.next, %tiles ]",
    ]

    def pointers(step: str, suffix: str) -> list[str]:
        lines = []
        for k in ins:
            lines.append(f"  %in{k}.offset{suffix} = mul i64 {step}, %in{k}.stride")
            lines.append(f"  %in{k}{suffix} = getelementptr {real}, ptr %in{k}.base, i64 %in{k}.offset{suffix}")
        for k in outs:
            lines.append(f"  %out{k}.offset{suffix} = mul i64 {step}, {program.outputs[k].size * w}")
            lines.append(f"  %out{k}{suffix} = getelementptr {real}, ptr %out{k}.base, i64 %out{k}.offset{suffix}")
        return lines

    every = [f"in{k}" for k in ins] + [f"out{k}" for k in outs]
    text += pointers("%t", ".t")
    text += [
        f"  call void @{tile}({', '.join(f'ptr %{port}.t' for port in every)})",
        "  %t.next = add i64 %t, 1",
        "  %more = icmp ult i64 %t.next, %full",
        "  br i1 %more, label %tiles, label %tail",
        "tail:",
        "  %left = icmp ne i64 %rest, 0",
        "  br i1 %left, label %pad, label %done",
        "pad:",
        *pointers("%full", ".p"),
    ]
    for k in ins:
        size = bytes_ * program.inputs[k].size
        text.append(f"  %in{k}.bytes = mul i64 %rest, {size}")
        text.append(f"  call void @llvm.memcpy.p0.p0.i64(ptr %in{k}.pad, ptr %in{k}.p, i64 %in{k}.bytes, i1 false)")
    text += ["  br label %fill", "fill:", "  %row = phi i64 [ %rest, %pad ], [ %row.next, %fill ]"]
    for k in ins:
        size = program.inputs[k].size
        text.append(f"  %in{k}.at = mul i64 %row, {size}")
        text.append(f"  %in{k}.row = getelementptr {real}, ptr %in{k}.pad, i64 %in{k}.at")
        text.append(
            f"  call void @llvm.memcpy.p0.p0.i64(ptr %in{k}.row, ptr %in{k}.pad, i64 {bytes_ * size}, i1 false)"
        )
    text += [
        "  %row.next = add i64 %row, 1",
        f"  %unfilled = icmp ult i64 %row.next, {w}",
        "  br i1 %unfilled, label %fill, label %compute",
        "compute:",
        f"  call void @{tile}({', '.join(f'ptr %{port}.pad' for port in every)})",
    ]
    for k in outs:
        text.append(f"  %out{k}.bytes = mul i64 %rest, {bytes_ * program.outputs[k].size}")
        text.append(f"  call void @llvm.memcpy.p0.p0.i64(ptr %out{k}.p, ptr %out{k}.pad, i64 %out{k}.bytes, i1 false)")
    return "\n".join([*text, "  br label %done", "done:", "  ret void", "}"])


def _bound(program: Program) -> str:
    """`void name(table)`: the whole function, its count and pointers read from a table of 64-bit numbers."""
    pointers = range(1, 1 + len(program.inputs) + len(program.outputs))
    text = [f"define void @{program.name}.bound(ptr %table) nounwind {{", "  %count = load i64, ptr %table"]
    for k in pointers:
        text += [f"  %at{k} = getelementptr i64, ptr %table, i64 {k}", f"  %p{k} = load ptr, ptr %at{k}"]
    text.append(f"  call void @{program.name}.whole(i64 %count, {', '.join(f'ptr %p{k}' for k in pointers)})")
    return "\n".join([*text, "  ret void", "}"])


def _whole(name: str, batch: str, program: Program, w: int) -> str:
    """`void name(count, in0, …, out0, …)`: the batch function for arrays that hold every state, without tables of pointers."""
    ports = [*((f"in{k}", "inputs", k) for k in range(len(program.inputs)))]
    ports += [*((f"out{k}", "outputs", k) for k in range(len(program.outputs)))]
    text = [f"define void @{name}({', '.join(['i64 %count', *(f'ptr %{port}' for port, _, _ in ports)])}) nounwind {{"]
    text.append(f"  %inputs = alloca [{len(program.inputs)} x ptr]")
    text.append(f"  %strides = alloca [{len(program.inputs)} x i64]")
    text.append(f"  %outputs = alloca [{len(program.outputs)} x ptr]")
    for port, table, k in ports:
        text.append(f"  %{port}.slot = getelementptr ptr, ptr %{table}, i64 {k}")
        text.append(f"  store ptr %{port}, ptr %{port}.slot")
    for k, port in enumerate(program.inputs):
        text.append(f"  %in{k}.step = getelementptr i64, ptr %strides, i64 {k}")
        text.append(f"  store i64 {port.size * w}, ptr %in{k}.step")
    text.append(f"  call void @{batch}(i64 %count, ptr %inputs, ptr %strides, ptr %outputs)")
    return "\n".join([*text, "  ret void", "}"])


def _apart(program: Program, format: Format) -> str:
    """`i32 name(count, in0, …, out0, …)`: the whole function and 1; nothing and 0 where an output lies over another array."""
    sizes = {f"in{k}": port.size for k, port in enumerate(program.inputs)}
    sizes |= {f"out{k}": port.size for k, port in enumerate(program.outputs)}
    given = ", ".join(["i64 %count", *(f"ptr %{port}" for port in sizes)])
    text = [f"define i32 @{program.name}.apart({given}) nounwind {{"]
    for port, size in sizes.items():
        text += [
            f"  %{port}.first = ptrtoint ptr %{port} to i64",
            f"  %{port}.bytes = mul i64 %count, {format.bytes * size}",
        ]
        text.append(f"  %{port}.end = add i64 %{port}.first, %{port}.bytes")
    last = "false"
    for k in range(len(program.outputs)):
        for other in [*(f"in{j}" for j in range(len(program.inputs))), *(f"out{j}" for j in range(k))]:
            text += [
                f"  %before{k}.{other} = icmp ult i64 %out{k}.first, %{other}.end",
                f"  %behind{k}.{other} = icmp ult i64 %{other}.first, %out{k}.end",
                f"  %over{k}.{other} = and i1 %before{k}.{other}, %behind{k}.{other}",
                f"  %any{k}.{other} = or i1 {last}, %over{k}.{other}",
            ]
            last = f"%any{k}.{other}"
    text += [f"  br i1 {last}, label %over, label %run", "over:", "  ret i32 0", "run:"]
    return "\n".join([*text, f"  call void @{program.name}.whole({given})", "  ret i32 1", "}"])


def batch_module(width: int, program: Program, dtype: str = DOUBLE.name) -> Module:
    """The module of a program's batch functions, `<program>.batch` and `<program>.whole`, over numbers of a format."""
    module = Module(width, FORMATS[dtype])
    module.add_batch_function(program)
    return module
