"""Program → LLVM module. One SIMD lane per state of the batch.

Every function in a module works on tiles of W states. Programs that others call are functions over *blocks*: each entry
one vector of W lanes, so nothing is transposed between them. What Python calls are *batch* functions over row-major arrays.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Set
from dataclasses import dataclass, field
from operator import attrgetter

from armwright.kernels.format import DOUBLE, FORMATS, Format
from armwright.kernels.llvm_machine import LlvmMachine
from armwright.kernels.lowering import walk, walk_instructions
from armwright.kernels.machine import Value
from armwright.kernels.target import last_cache
from armwright.kernels.tiles import load_tile, store_tile, store_tile_loop, stream_tile
from armwright.program import Instruction, Program
from armwright.program.cut import WHOLE, Piece, cut
from armwright.program.passes import optimised

WIDE = 256  # columns of an output that are stored in a loop rather than a line
CACHE_LINE = 64  # bytes; a guess that is too small or too large costs a little time
# Bytes of results that leave the cache anyway: from here on they are written past it, where rows have more than NARROW columns.
# Neighbours and the caller's own data take their part of a large cache.
STREAMED = min(max(last_cache() // 2, 4 << 20), 8 << 20)
NARROW = 32  # of fewer columns a detour by a tile in the cache costs more than it saves


@dataclass
class LlvmModule:
    """LLVM text in the making: functions, each printed once, and what they declare."""

    width: int
    format: Format = DOUBLE
    functions: dict[str, str] = field(default_factory=dict)
    declarations: set[str] = field(default_factory=set)
    definitions: dict[str, str] = field(default_factory=dict)
    _programs: dict[str, Program] = field(default_factory=dict)

    def machine(self) -> LlvmMachine:
        """A machine that prints a function of this module."""
        return LlvmMachine(self.width, self.declarations, self.definitions, format=self.format)

    def text(self) -> str:
        """The module."""
        return "\n\n".join([*sorted(self.declarations), *self.definitions.values(), *self.functions.values()])

    def add_block_function(self, program: Program, rows: Set[str] = frozenset()) -> str:
        """`void name(in0, …, out0, …)` over blocks, not inlined; returns its name.

        Inputs named in `rows` are one number an entry, the same for all lanes.
        """
        name = f"{program.name}.block"
        assert _are_equal(self._programs.setdefault(program.name, program), program), (
            f"two programs are named {program.name!r}"
        )
        if name not in self.functions:
            m = self.machine()
            inputs = [
                [(m.load_spread if p.name in rows else m.load)(f"%in{k}", e) for e in range(p.size)]
                for k, p in enumerate(program.inputs)
            ]
            outputs = self._computed(m, program, inputs)
            for k, values in enumerate(outputs):
                for entry, value in enumerate(values):
                    m.store(f"%out{k}", entry, value)
            self._define(name, program, m)
        return name

    def add_batch_function(self, program: Program) -> str:
        """`void <program>.batch(count, in0, step0, in1, step1, …, out0, …)` over row-major arrays; returns its name.

        A step is how many reals an input moves a tile: its size times W, or 0 for one tile that serves all. A tail of fewer
        than W states is computed in padded copies. Beside it `<program>.separate(count, in0, …, out0, …)` serves arrays that
        hold every state: it gives 1, or does nothing and gives 0 where an output lies over another array; and
        `<program>.bound(table)` takes the same arguments from a table in memory, without that test.
        """
        tile = f"{program.name}.tile"
        m = self.machine()
        inputs = [load_tile(m, f"%in{k}", port.size) for k, port in enumerate(program.inputs)]
        instructions = optimised(program.instructions)
        if len(instructions) <= WHOLE:
            for k, values in enumerate(walk(m, program, inputs, self.caller(m), instructions=instructions)):
                store_tile(m, f"%out{k}", values)
        else:
            instructions, places = _computed_once(program, instructions)
            blocks = self._in_pieces(m, program, instructions, inputs, batched=True)
            for k, (block, port) in enumerate(zip(blocks, program.outputs, strict=True)):
                if port.size <= WIDE or self.width == 1:
                    store_tile(m, f"%out{k}", [m.load(block, entry) for entry in places[k]])
                else:
                    name = self._store_function(f"{program.name}.{port.name}", places[k])
                    m.lines.append(f"  call void @{name}(ptr %out{k}, ptr {block})")
        self._define(tile, program, m)
        self._define_batch(program, tile)
        self._define_separate(program)
        self._define_bound(program)
        self.declarations.add("declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)")
        return f"{program.name}.batch"

    def _define_batch(self, program: Program, tile: str) -> None:
        """Full tiles in place; then the tail: its rows copied into a padded tile (filled up with its first row) and back.

        Results that leave the cache are put together tile by tile in the pads and written past the cache: memory is then not read
        before it is written. Not inlined into what calls it: three more copies of it would take a sixth of the time to compile,
        and gain nothing.
        """
        w, real, bytes_ = self.width, self.format.real, self.format.bytes
        m = LlvmMachine(1, format=self.format)
        sizes, split = _port_sizes(program), len(program.inputs)
        steps = [f"%step{k}" for k in range(split)] + [str(port.size * w) for port in program.outputs]
        pads = [m.emit(f"alloca [{size * w} x {real}], align 64") for size in sizes.values()]
        full, rest = m.emit(f"udiv i64 %count, {w}"), m.emit(f"urem i64 %count, {w}")

        def rows(tile_number: Value) -> list[Value]:
            offsets = [m.emit(f"mul i64 {tile_number}, {step}") for step in steps]
            return [m.emit(f"getelementptr {real}, ptr {p}, i64 {o}") for p, o in zip(sizes, offsets, strict=True)]

        def compute(pointers: list[Value]) -> None:
            m.lines.append(f"  call void @{tile}({', '.join(f'ptr {pointer}' for pointer in pointers)})")

        def copy(target: Value, source: Value, length: Value) -> None:
            m.lines.append(f"  call void @llvm.memcpy.p0.p0.i64(ptr {target}, ptr {source}, i64 {length}, i1 false)")

        with m.where(m.emit(f"icmp ne i64 {full}, 0"), "full", "tail"):
            outputs = [*sizes][split:]
            written = bytes_ * sum(sizes[port] for port in outputs)
            if w > 1 and written > bytes_ * NARROW:
                usual = m.emit(f"icmp ult i64 %count, {STREAMED // written}")
                for port in outputs:  # an array of odd bytes, which NumPy allows, reaches no aligned place
                    odd = m.emit(f"urem i64 {m.emit(f'ptrtoint ptr {port} to i64')}, {bytes_}")
                    usual = m.emit(f"or i1 {usual}, {m.emit(f'icmp ne i64 {odd}, 0')}")
                m.branch(usual, "direct", "past")
                m.begin("past")
                with m.repeat("streams", full) as number:
                    places = rows(number)
                    compute([*places[:split], *pads[split:]])
                    for port, place, pad in zip(outputs, places[split:], pads[split:], strict=True):
                        m.lines.append(f"  call void @{self._stream_function(sizes[port])}(ptr {place}, ptr {pad})")
                m.lines.append("  fence seq_cst")  # such stores come in any order; other threads must see them all
                m.jump("tail")
                m.begin("direct")
            with m.repeat("tiles", full) as number:
                compute(rows(number))
        with m.where(m.emit(f"icmp ne i64 {rest}, 0"), "pad", "done"):
            last = rows(full)
            lengths = [m.emit(f"mul i64 {rest}, {bytes_ * size}") for size in sizes.values()]
            for k in range(split):
                copy(pads[k], last[k], lengths[k])
            with m.repeat("fill", m.emit(f"sub i64 {w}, {rest}")) as number:
                row = m.emit(f"add i64 {rest}, {number}")
                for pad, size in zip(pads[:split], sizes.values(), strict=False):
                    place = m.emit(f"getelementptr {real}, ptr {pad}, i64 {m.emit(f'mul i64 {row}, {size}')}")
                    copy(place, pad, str(bytes_ * size))
            compute(pads)
            for k in range(split, len(sizes)):
                copy(last[k], pads[k], lengths[k])
        inputs = [f"ptr %in{k}, i64 %step{k}" for k in range(split)]
        parameters = ["i64 %count", *inputs, *(f"ptr {port}" for port in [*sizes][split:])]
        self._export(f"void @{program.name}.batch({', '.join(parameters)}) noinline", m, "void")

    def _define_separate(self, program: Program) -> None:
        """Each output against all other arrays, in a loop: a line for every pair took a third of the time to compile."""
        m, sizes = LlvmMachine(1), _port_sizes(program)
        count = len(sizes)
        firsts, ends = (m.emit(f"alloca [{count} x i64]") for _ in range(2))
        for k, (port, size) in enumerate(sizes.items()):
            first = m.emit(f"ptrtoint ptr {port} to i64")
            end = m.emit(f"add i64 {first}, {m.emit(f'mul i64 %count, {self.format.bytes * size}')}")
            for table, value in ((firsts, first), (ends, end)):
                m.lines.append(f"  store i64 {value}, ptr {m.emit(f'getelementptr i64, ptr {table}, i64 {k}')}")

        def of(table: Value, k: Value) -> Value:
            return m.emit(f"load i64, ptr {m.emit(f'getelementptr i64, ptr {table}, i64 {k}')}")

        if count > 1:
            with m.repeat("outputs", len(program.outputs)) as number:
                k = m.emit(f"add i64 {number}, {len(program.inputs)}")
                with m.repeat("others", count - 1) as further:
                    distance = m.emit(f"add i64 {further}, 1")
                    other = m.emit(f"urem i64 {m.emit(f'add i64 {k}, {distance}')}, {count}")
                    before = m.emit(f"icmp ult i64 {of(firsts, k)}, {of(ends, other)}")
                    behind = m.emit(f"icmp ult i64 {of(firsts, other)}, {of(ends, k)}")
                    m.branch(m.emit(f"and i1 {before}, {behind}"), "over", "apart")
                    m.begin("apart")
        m.jump("run")
        m.begin("over")
        m.lines.append("  ret i32 0")
        m.begin("run")
        m.lines.append(self._batch_call(program, [*sizes]))
        parameters = ["i64 %count", *(f"ptr {port}" for port in sizes)]
        self._export(f"i32 @{program.name}.separate({', '.join(parameters)})", m, "i32 1")

    def _define_bound(self, program: Program) -> None:
        m = LlvmMachine(1)
        m.lines.append("  %count = load i64, ptr %table")
        places = [m.emit(f"getelementptr i64, ptr %table, i64 {k}") for k in range(1, 1 + len(_port_sizes(program)))]
        m.lines.append(self._batch_call(program, [m.emit(f"load ptr, ptr {place}") for place in places]))
        self._export(f"void @{program.name}.bound(ptr %table)", m, "void")

    def _batch_call(self, program: Program, pointers: list[str]) -> str:
        """The batch function over `%count` states, for arrays that hold every one of them."""
        arguments = ["i64 %count"]
        for k, pointer in enumerate(pointers):
            arguments.append(f"ptr {pointer}")
            if k < len(program.inputs):
                arguments.append(f"i64 {program.inputs[k].size * self.width}")
        return f"  call void @{program.name}.batch({', '.join(arguments)})"

    def _export(self, head: str, m: LlvmMachine, result: str) -> None:
        """A function that Python can call."""
        name = head[head.index("@") + 1 : head.index("(")]
        self.functions[name] = "\n".join([f"define {head} nounwind {{", "entry:", *m.lines, f"  ret {result}", "}"])

    def _computed(self, m: LlvmMachine, program: Program, inputs: list[list[Value]]) -> list[list[Value]]:
        """A program's outputs: in one block, or, where it is long, in functions of a few thousand instructions each."""
        instructions = optimised(program.instructions)
        if len(instructions) <= WHOLE:
            return walk(m, program, inputs, self.caller(m), instructions=instructions)
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
        blocks = ", ".join(f"ptr {p}" for p in (*ports[0], *ports[1], m.reserve(max(parts.slots, 1))))
        ahead, share = self._fetches(program) if batched else [], len(parts.pieces)
        for k, piece in enumerate(parts.pieces):
            name = f"{program.name}.piece{k}"
            if name not in self.functions:
                self._add_piece(name, program, piece)
            m.lines.append(f"  call void @{name}({blocks})")
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

    def _store_function(self, owner: str, places: list[int]) -> str:
        """`void name(out, block)`: W rows of many columns from their places in a block, in a loop."""
        if places == [*range(len(places))]:
            return self._of_tile(f"store.{len(places)}", lambda m: store_tile_loop(m, len(places)))
        table = f"@{owner}.places"
        numbers = ", ".join(f"i64 {place}" for place in places)
        self.definitions[table] = f"{table} = internal constant [{len(places)} x i64] [{numbers}]"
        return self._of_tile(f"{owner}.store", lambda m: store_tile_loop(m, len(places), table))

    def _stream_function(self, columns: int) -> str:
        """`void name(out, block)`: a finished tile past the caches."""
        return self._of_tile(f"stream.{columns}", lambda m: stream_tile(m, columns))

    def _of_tile(self, name: str, body: Callable[[LlvmMachine], None]) -> str:
        if name not in self.functions:
            m = self.machine()
            body(m)
            head = f"define internal void @{name}(ptr noalias %out, ptr noalias readonly %block) noinline nounwind {{\nentry:"
            self.functions[name] = "\n".join([head, *m.lines, "  ret void", "}"])
        return name

    def _add_piece(self, name: str, program: Program, piece: Piece) -> None:
        """`void name(in0, …, out0, …, work)` over blocks: one piece, what crosses its ends waiting in `work`."""
        m = self.machine()
        values = {value: m.load("%work", slot) for value, slot in piece.loads.items()}

        def read(port: int, entry: int) -> Value:
            return m.load(f"%in{port}", entry)

        def write(port: int, entry: int, value: Value) -> None:
            m.store(f"%out{port}", entry, value)

        walk_instructions(m, piece.instructions, values, read, write, self.caller(m))
        for value, slot in piece.stores.items():
            m.store("%work", slot, values[value])
        self._define(name, program, m, "ptr noalias %work")

    def caller(self, m: LlvmMachine):
        """Printer of calls of block functions for the walk: arguments and results go through the stack.

        A call whose arguments differ from the last one's by nothing but that one's results is the next step of an iteration.
        It is left out where these are what they were before in every lane: the results are then the same as well. A conditional
        program is left out where no lane needs it; its results are then 0, and not used.
        """
        last: dict[str, tuple[list[Value], list[str], list[str], list[Value]]] = {}

        def call(program: Program, arguments: list[Value]) -> list[Value]:
            name = self.add_block_function(program)
            if program.conditional:
                return self._called_where_needed(m, name, program, arguments)
            before, pointers, results, returned = last.get(name, ([], [], [], []))
            places = [(k, entry) for k, port in enumerate(program.inputs) for entry in range(port.size)]
            changed = [k for k, pair in enumerate(zip(arguments, before, strict=False)) if pair[0] != pair[1]]
            goes_on = bool(before) and all(arguments[k] in returned for k in changed)
            step, done = m.fresh("step"), m.fresh("rest")
            if goes_on:
                same = [m.int_eq(m.bits(arguments[k]), m.bits(before[k])) for k in changed]
                m.branch(m.any(m.inverse(functools.reduce(m.both, same))), step, done)
                m.label(step)
            elif not before:  # later calls set what has changed in the same places
                changed = list(range(len(places)))
                pointers = [m.reserve(port.size) for port in program.inputs]
                results = [m.reserve(port.size) for port in program.outputs]
            for k in changed:
                port, entry = places[k]
                m.store(pointers[port], entry, arguments[k])
            m.lines.append(f"  call void @{name}({', '.join(f'ptr {p}' for p in [*pointers, *results])})")
            if goes_on:
                m.jump(done)
                m.label(done)
            loaded = [m.load(p, e) for p, port in zip(results, program.outputs, strict=True) for e in range(port.size)]
            last[name] = arguments, pointers, results, loaded
            return loaded

        return call

    def _called_where_needed(self, m: LlvmMachine, name: str, program: Program, arguments: list[Value]) -> list[Value]:
        """A call behind a branch: results of a conditional program, 0 where no lane needs it."""
        inputs, results = ([m.reserve(port.size) for port in ports] for ports in (program.inputs, program.outputs))
        places = [(p, e) for p, port in zip(results, program.outputs, strict=True) for e in range(port.size)]
        zero, needed = m.constant(0.0), m.any(m.is_true(arguments[0]))
        step, skip, done = m.fresh("step"), m.fresh("skip"), m.fresh("done")
        m.branch(needed, step, skip)
        m.label(step)
        given = iter(arguments)
        for pointer, port in zip(inputs, program.inputs, strict=True):
            for entry in range(port.size):
                m.store(pointer, entry, next(given))
        m.lines.append(f"  call void @{name}({', '.join(f'ptr {p}' for p in [*inputs, *results])})")
        m.jump(done)
        m.label(skip)
        for pointer, entry in places:
            m.store(pointer, entry, zero)
        m.jump(done)
        m.label(done)
        return [m.load(pointer, entry) for pointer, entry in places]

    def _define(self, name: str, program: Program, m: LlvmMachine, *extra_parameters: str) -> None:
        parameters = [f"ptr noalias readonly %in{k}" for k in range(len(program.inputs))]
        parameters += [f"ptr noalias %out{k}" for k in range(len(program.outputs))]
        parameters += extra_parameters
        # alignstack: LLVM does not align the stack for spilled vectors by itself, and split ones cost up to half the speed
        head = f"define internal void @{name}({', '.join(parameters)}) noinline nounwind alignstack({min(m.bytes, 64)})"
        head += " {\nentry:"
        self.functions[name] = "\n".join([head, *m.lines, "  ret void", "}"])


def _computed_once(program: Program, instructions: list[Instruction]) -> tuple[list[Instruction], list[list[int]]]:
    """The instructions with one output for each value, and for every entry of every output the entry that has its value.

    Half of a symmetric matrix, and all zeros but one, need not wait until they are written.
    """
    places = [[*range(port.size)] for port in program.outputs]
    known: dict[tuple[int, int], int] = {}
    kept = []
    for i in instructions:
        if i.operation == "OUTPUT" and i.place is not None:
            port, entry = i.place
            places[port][entry] = known.setdefault((port, i.arguments[0]), entry)
            if places[port][entry] != entry:
                continue
        kept.append(i)
    return kept, places


def _port_sizes(program: Program) -> dict[str, int]:
    """Entries of every port, by the name of its pointer in the text: inputs first."""
    sizes = {f"%in{k}": port.size for k, port in enumerate(program.inputs)}
    return sizes | {f"%out{k}": port.size for k, port in enumerate(program.outputs)}


def batch_module(width: int, program: Program, dtype: str = DOUBLE.name) -> LlvmModule:
    """The module of a program's batch functions over numbers of a format."""
    module = LlvmModule(width, FORMATS[dtype])
    module.add_batch_function(program)
    return module


def _are_equal(one: Program, other: Program) -> bool:
    """True if two programs, which may come from two traces, have equal instructions."""
    parts = attrgetter("operation", "results", "arguments", "place")
    if one is other or len(one.instructions) != len(other.instructions):
        return one is other
    return all(
        parts(a) == parts(b)
        and repr(a.constant) == repr(b.constant)  # NaN is itself here
        and (a.callee is b.callee or (a.callee and b.callee and _are_equal(a.callee, b.callee)))
        for a, b in zip(one.instructions, other.instructions, strict=True)
    )
