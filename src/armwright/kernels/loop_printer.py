"""The simulation loop as LLVM IR: tiles of W lanes outermost, ticks inside, the stages of a tick in order.

Lanes that have nothing to do in a segment keep their state by a select, so a lane's bits do not depend on its neighbours.
"""

from __future__ import annotations

from armwright.kernels import philox
from armwright.kernels.llvm import LlvmModule
from armwright.kernels.loop_arguments import NUMBERS, POINTERS, REALS, argument_names
from armwright.kernels.loop_exchange import BLOCKS, exchange
from armwright.kernels.loop_steps import StepPrinter
from armwright.kernels.machine import Value
from armwright.kernels.stages import SINCE, Call, DelayStage, DrawStage, Exchange, RecordStage, Stage, TableStage
from armwright.kernels.tiles import store_tile


def loop_module(width: int, *stages: Stage) -> LlvmModule:
    """The module of `void loop(table)`."""
    module = LlvmModule(width)
    module.functions["loop"] = _Printer(module, stages).text()
    module.declarations.add("declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)")
    return module


class _Printer(StepPrinter):
    """Prints one loop."""

    def text(self) -> str:
        """The function."""
        m = self.m
        names = argument_names(self.plan)
        for k, name in enumerate(names):
            place = m.emit(f"getelementptr i64, ptr %arguments, i64 {k}")
            kind = "double" if name in REALS else "i64" if name in NUMBERS or name.endswith(".stride") else "ptr"
            self._out(f'  %"{name}" = load {kind}, ptr {place}, align 8')
        self._out("  %some = icmp slt i64 %tile0, %tile1")
        m.branch("%some", "tiles", "done")
        m.begin("tiles")
        self._out("  %tile = phi i64 [ %tile0, %entry ], [ %tile.next, %tile.end ]")
        for block, entries in self.sizes.items():
            self._out(f'  %"{block}.offset" = mul i64 %tile, {entries * self.w}')
            self._out(f'  %"{block}.at" = getelementptr double, ptr %"{block}.block", i64 %"{block}.offset"')
        m.jump("ticks")
        m.begin("ticks")
        self._out("  %k = phi i64 [ %tick0, %tiles ], [ %k.next, %tick.end ]")
        self._out("  %tick = sitofp i64 %k to double")
        self._out("  %row = sub i64 %k, %origin")
        if "tick" in self.sizes:
            self._store("tick", 0, self._splat("%tick"))
        if SINCE in self.sizes:
            self._store(SINCE, 0, m.constant(0.0))
        for number, stage in enumerate(self.plan):
            getattr(self, f"_{type(stage).__name__.removesuffix('Stage').lower()}")(stage, f"s{number}")
        m.jump("tick.end")
        m.begin("tick.end")
        self._out("  %k.next = add i64 %k, 1")
        self._out("  %more.ticks = icmp slt i64 %k.next, %tick1")
        m.branch("%more.ticks", "ticks", "tile.end")
        m.begin("tile.end")
        self._out("  %tile.next = add i64 %tile, 1")
        self._out("  %more.tiles = icmp slt i64 %tile.next, %tile1")
        m.branch("%more.tiles", "tiles", "done")
        m.begin("done")
        align = min(8 * self.w, 64)
        head = f"define void @loop(ptr %arguments) nounwind alignstack({align}) {{\nentry:"
        return "\n".join([head, *m.lines, "  ret void", "}"])

    # Stages.

    def _call(self, stage: Call, label: str) -> None:
        self._program(stage.program)
        self._replace_blocks(stage.program)

    def _table(self, stage: TableStage, label: str) -> None:
        m = self.m
        first = m.emit(f"mul i64 %row, {stage.entries}")
        if not stage.spread:
            self._out(f'  %"{stage.block}.at" = getelementptr double, ptr %"{stage.block}.table", i64 {first}')
            return
        for entry in range(stage.entries):
            index = m.emit(f"add i64 {first}, {entry}")
            place = m.emit(f'getelementptr double, ptr %"{stage.block}.table", i64 {index}')
            self._store(stage.block, entry, self._splat(m.emit(f"load double, ptr {place}, align 8")))

    def _draw(self, stage: DrawStage, label: str) -> None:
        m, w = self.m, self.w
        shifted = m.emit(f"mul i64 %tile, {w}")
        first = m.emit(f"add i64 %lane0, {shifted}")
        lanes = self._int_splat(first)
        if w > 1:
            steps = ", ".join(f"i64 {k}" for k in range(w))
            lanes = m.emit(f"add {m.integer} {lanes}, <{steps}>")
        low = m.int_constant(philox.LOW)
        lane = m.emit(f"and {m.integer} {lanes}, {low}")
        k_low = self._int_splat(m.emit(f"and i64 %k, {philox.LOW}"))
        high = m.emit("lshr i64 %k, 32")
        high = m.emit(f"shl i64 {high}, 16")
        k_high = self._int_splat(m.emit(f"or i64 {high}, {stage.channel}"))
        key0 = self._int_splat(m.emit(f"and i64 %seed, {philox.LOW}"))
        key1 = self._int_splat(m.emit("lshr i64 %seed, 32"))
        for call in range(-(-stage.entries // 2)):
            c = self._philox([lane, k_low, k_high, m.int_constant(call)], key0, key1)
            for half in range(2):
                if 2 * call + half < stage.entries:
                    up = m.emit(f"shl {m.integer} {c[2 * half]}, {m.int_constant(20)}")
                    down = m.emit(f"lshr {m.integer} {c[2 * half + 1]}, {m.int_constant(12)}")
                    bits = m.emit(f"or {m.integer} {up}, {down}")
                    number = m.add(m.emit(f"uitofp {m.integer} {bits} to {m.real}"), m.constant(0.5))
                    self._store(stage.block, 2 * call + half, m.mul(number, m.constant(2.0**-52)))

    def _philox(self, c: list[Value], k0: Value, k1: Value) -> list[Value]:
        m = self.m

        def op(name: str, a: Value, b: Value) -> Value:
            return m.emit(f"{name} {m.integer} {a}, {b}")

        low, shift = m.int_constant(philox.LOW), m.int_constant(32)
        c0, c1, c2, c3 = c
        for _ in range(philox.ROUNDS):
            a, b = op("mul", m.int_constant(philox.M0), c0), op("mul", m.int_constant(philox.M1), c2)
            c0 = op("xor", op("xor", op("lshr", b, shift), c1), k0)
            c2 = op("xor", op("xor", op("lshr", a, shift), c3), k1)
            c1, c3 = op("and", b, low), op("and", a, low)
            k0 = op("and", op("add", k0, m.int_constant(philox.W0)), low)
            k1 = op("and", op("add", k1, m.int_constant(philox.W1)), low)
        return [c0, c1, c2, c3]

    def _delay(self, stage: DelayStage, label: str) -> None:
        """The newest into its slot of the ring, then for each lane the slot it asks for, lane by lane."""
        m, w, e, n = self.m, self.w, stage.entries, stage.length
        tile = m.emit(f"mul i64 %tile, {n * e * w}")
        ring = m.emit(f'getelementptr double, ptr %"{stage.to}.ring", i64 {tile}')
        slot = m.emit(f"urem i64 %k, {n}")
        place = m.emit(f"mul i64 {slot}, {e * w}")
        newest = m.emit(f"getelementptr double, ptr {ring}, i64 {place}")
        self._copy(newest, stage.block, e)
        with m.repeat(f"{label}.lane", w) as lane:
            by = m.emit(f'getelementptr double, ptr %"{stage.by}.at", i64 {lane}')
            whole = m.emit(f"fptosi double {m.emit(f'load double, ptr {by}, align 8')} to i64")
            back = m.emit(f"sub i64 {slot}, {whole}")
            wrapped = m.emit(f"add i64 {back}, {n}")
            negative = m.emit(f"icmp slt i64 {back}, 0")
            old = m.emit(f"select i1 {negative}, i64 {wrapped}, i64 {back}")
            first = m.emit(f"add i64 {m.emit(f'mul i64 {old}, {e * w}')}, {lane}")
            for entry in range(e):
                index = m.emit(f"add i64 {first}, {entry * w}")
                source = m.emit(f"getelementptr double, ptr {ring}, i64 {index}")
                to = m.emit(f'getelementptr double, ptr %"{stage.to}.at", i64 {m.emit(f"add i64 {lane}, {entry * w}")}')
                self._out(f"  store double {m.emit(f'load double, ptr {source}, align 8')}, ptr {to}, align 8")

    def _record(self, stage: RecordStage, label: str) -> None:
        m = self.m
        phase = m.emit("urem i64 %row, %every")
        due = m.emit(f"icmp eq i64 {phase}, 0")
        with m.where(due, f"{label}.write", f"{label}.end"):
            entries = [(block, entry) for block in stage.blocks for entry in range(self.sizes[block])]
            row = m.emit("udiv i64 %row, %every")
            offset = m.emit(f'mul i64 {row}, %"{stage.name}.stride"')
            tile = m.emit(f"mul i64 %tile, {len(entries) * self.w}")
            index = m.emit(f"add i64 {offset}, {tile}")
            place = m.emit(f'getelementptr double, ptr %"{stage.name}.record", i64 {index}')
            store_tile(m, place, [self._load(block, entry) for block, entry in entries])

    def _exchange(self, stage: Exchange, label: str) -> None:
        m = self.m
        some = m.any(m.lt(m.constant(0.0), self._load("over")))
        m.branch(some, f"{label}.take", f"{label}.end")
        m.begin(f"{label}.take")
        self.module.functions["exchange"] = exchange("exchange", self.w, stage)
        pointers = [*(f"{block}.at" for block in BLOCKS), *(f"{pointer}.shared" for pointer in POINTERS)]
        arguments = ", ".join(f'ptr %"{pointer}"' for pointer in pointers)
        busy = m.emit(f'call i64 @exchange({arguments}, i64 %"attempts.stride")')
        m.branch(m.emit(f"icmp eq i64 {busy}, 0"), "tile.end", f"{label}.end")
        m.begin(f"{label}.end")
