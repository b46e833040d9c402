"""The words in which a simulation loop is printed: blocks loaded and stored, programs called, numbers spread over lanes."""

from __future__ import annotations

from armwright.kernels.llvm import Module
from armwright.kernels.llvm_machine import LlvmMachine
from armwright.kernels.machine import Value
from armwright.kernels.stages import Rows, Stage, block_sizes
from armwright.program import Program


class LoopWords:
    """Prints into one function of a module.

    Attributes:
        m: the machine that prints.   w: lanes of a tile.   sizes: entries of every block.   landed: schedules that are landed on.
    """

    def __init__(self, module: Module, plan: tuple[Stage, ...]):
        self.module, self.plan, self.w = module, plan, module.width
        self.m: LlvmMachine = module.machine()
        self.sizes = block_sizes(plan)
        self.landed = [stage for stage in plan if isinstance(stage, Rows)]

    def _out(self, line: str) -> None:
        self.m.lines.append(line)

    def _program(self, program: Program) -> None:
        """A program called on blocks."""
        name = self.module.add_block_function(program)
        ports = ", ".join(f'ptr %"{port.name}.at"' for port in (*program.inputs, *program.outputs))
        self._out(f"  call void @{name}({ports})")

    def _place(self, block: str, entry: int) -> Value:
        return self.m.emit(f'getelementptr {self.m.real}, ptr %"{block}.at", i64 {entry}')

    def _load(self, block: str, entry: int) -> Value:
        return self.m.emit(f"load {self.m.real}, ptr {self._place(block, entry)}, align {8 * self.w}")

    def _store(self, block: str, entry: int, value: Value) -> None:
        self._out(f"  store {self.m.real} {value}, ptr {self._place(block, entry)}, align {8 * self.w}")

    def _copied(self, to: str, source: str, entries: int) -> None:
        size = 8 * entries * self.w
        self._out(f'  call void @llvm.memcpy.p0.p0.i64(ptr %"{to}.at", ptr %"{source}.at", i64 {size}, i1 false)')

    def _splat(self, value: Value) -> Value:
        return self._spread(value, "double", self.m.real)

    def _int_splat(self, value: Value) -> Value:
        return self._spread(value, "i64", self.m.integer)

    def _spread(self, value: Value, scalar: str, vector: str) -> Value:
        if self.w == 1:
            return value
        first = self.m.emit(f"insertelement {vector} poison, {scalar} {value}, i32 0")
        return self.m.emit(f"shufflevector {vector} {first}, {vector} poison, <{self.w} x i32> zeroinitializer")

    def _int(self, number: int) -> Value:
        return str(number) if self.w == 1 else f"splat (i64 {number})"

    def _any(self, condition: Value) -> Value:
        if self.w == 1:
            return condition
        self.module.declarations.add(f"declare i1 @llvm.vector.reduce.or.v{self.w}i1({self.m.mask})")
        return self.m.emit(f"call i1 @llvm.vector.reduce.or.v{self.w}i1({self.m.mask} {condition})")
