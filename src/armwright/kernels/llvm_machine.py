"""The machine that prints LLVM IR: a value is a <width x double> (or float), one lane for each state; for width 1, a double."""

# ruff: noqa: D102  What the operations do is said where they are declared, in `Machine`.

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from armwright.kernels.format import DOUBLE, Format
from armwright.kernels.machine import Machine, Slow, Value

INTRINSICS = ("fma", "fabs", "copysign", "sqrt", "floor", "ceil", "trunc", "rint")
INSTRUCTIONS = {
    "add": "fadd {real} {}, {}",
    "sub": "fsub {real} {}, {}",
    "mul": "fmul {real} {}, {}",
    "div": "fdiv {real} {}, {}",
    "neg": "fneg {real} {}",
    "lt": "fcmp olt {real} {}, {}",
    "le": "fcmp ole {real} {}, {}",
    "eq": "fcmp oeq {real} {}, {}",
    "ne": "fcmp une {real} {}, {}",
    "both": "and {mask} {}, {}",
    "either": "or {mask} {}, {}",
    "select": "select {mask} {}, {real} {}, {real} {}",
    "bits": "bitcast {real} {} to {integer}",
    "from_bits": "bitcast {integer} {} to {real}",
    "int_add": "add {integer} {}, {}",
    "int_sub": "sub {integer} {}, {}",
    "int_and": "and {integer} {}, {}",
    "int_or": "or {integer} {}, {}",
    "int_xor": "xor {integer} {}, {}",
    "int_eq": "icmp eq {integer} {}, {}",
    "int_lt": "icmp slt {integer} {}, {}",
    "shift_left": "shl {integer} {}, {}",
    "shift_right": "lshr {integer} {}, {}",
    "arithmetic_shift_right": "ashr {integer} {}, {}",
}


class LlvmMachine(Machine):
    """Prints the body of one function, line by line, into `lines`.

    Values are names or literals; identical operations are printed once. After the body is printed, the module needs
    the text of `declarations` and `definitions` as well: pass the same two containers to every machine of a module.
    Other emitters add lines (loads, stores, tiles) with `emit`, and `begin` basic blocks.
    """

    def __init__(
        self,
        width: int,
        declarations: set[str] | None = None,
        definitions: dict[str, str] | None = None,
        block: str = "entry",
        format: Format = DOUBLE,
    ):
        super().__init__(format)
        self.width = width
        self.lines: list[str] = []
        self.declarations: set[str] = set() if declarations is None else declarations
        self.definitions: dict[str, str] = {} if definitions is None else definitions
        self.block = block  # label of the basic block that lines go into, as a phi needs it
        self.real, self.integer, self.mask = (self._vector(s) for s in (format.real, format.integer, "i1"))
        self._suffix = f"f{format.bits}" if width == 1 else f"v{width}f{format.bits}"
        self._count = 0
        self._printed: dict[str, str] = {}

    # Printing.

    def _vector(self, scalar: str) -> str:
        return scalar if self.width == 1 else f"<{self.width} x {scalar}>"

    def _splat(self, scalar: str) -> str:
        return scalar.split()[1] if self.width == 1 else f"splat ({scalar})"

    def fresh(self, stem: str = "v") -> str:
        """A name that this function does not have yet, without its % sign."""
        self._count += 1
        return f"{stem}{self._count}"

    def emit(self, instruction: str) -> Value:
        """Print `%name = instruction` and return the name. For what always gives anew: loads, phis."""
        name = f"%{self.fresh()}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def begin(self, label: str) -> None:
        """Start the walker's own basic block. What was computed before is no longer taken for available."""
        self.label(label)
        self._printed.clear()
        self.memo.clear()

    def jump(self, label: str) -> None:
        """End a basic block by going on to that one."""
        self.lines.append(f"  br label %{label}")

    def branch(self, condition: Value, then: str, otherwise: str) -> None:
        """End a basic block by going on to one of two; the condition is one bit."""
        self.lines.append(f"  br i1 {condition}, label %{then}, label %{otherwise}")

    @contextmanager
    def where(self, condition: Value, then: str, behind: str) -> Iterator[None]:
        """A body, begun at `then`, that runs where a condition of one bit is true; lines go on at `behind`."""
        self.branch(condition, then, behind)
        self.begin(then)
        yield
        self.jump(behind)
        self.begin(behind)

    @contextmanager
    def repeat(self, label: str, times: int | Value) -> Iterator[Value]:
        """A loop that begins at `label` and runs its body so often; gives the counter. Its lines go on at `label.done`."""
        counter, before = f"%{label}.count", self.block
        self.jump(label)
        self.begin(label)
        place = len(self.lines)
        yield counter
        following = self.emit(f"add i64 {counter}, 1")
        again = self.emit(f"icmp ult i64 {following}, {times}")
        # Only now is it known from which basic block the loop comes back.
        self.lines.insert(place, f"  {counter} = phi i64 [ 0, %{before} ], [ {following}, %{self.block} ]")
        self.branch(again, label, f"{label}.done")
        self.begin(f"{label}.done")

    def entry(self, pointer: str, entry: int) -> Value:
        """Pointer to an entry of a block: one vector of lanes."""
        return self.emit(f"getelementptr {self.real}, ptr {pointer}, i64 {entry}")

    def load(self, pointer: str, entry: int) -> Value:
        """An entry of a block."""
        return self.emit(f"load {self.real}, ptr {self.entry(pointer, entry)}, align {self.bytes}")

    def load_spread(self, pointer: str, entry: int) -> Value:
        """An entry of a row of single numbers, in every lane."""
        kind = self.format.real
        place = f"getelementptr {kind}, ptr {pointer}, i64 {entry}"
        number = self.emit(f"load {kind}, ptr {self.emit(place)}, align {self.format.bytes}")
        return self.spread(number, kind, self.real)

    def store(self, pointer: str, entry: int, value: Value) -> None:
        """Sets an entry of a block."""
        place = self.entry(pointer, entry)
        self.lines.append(f"  store {self.real} {value}, ptr {place}, align {self.bytes}")

    def reserve(self, entries: int) -> str:
        """A new block on the stack."""
        return self.emit(f"alloca [{entries} x {self.real}], align {self.bytes}")

    def spread(self, value: Value, scalar: str, vector: str) -> Value:
        """One number, an LLVM scalar, in every lane."""
        if self.width == 1:
            return value
        first = self.emit(f"insertelement {vector} poison, {scalar} {value}, i32 0")
        return self.emit(f"shufflevector {vector} {first}, {vector} poison, <{self.width} x i32> zeroinitializer")

    @property
    def bytes(self) -> int:
        """Of one vector of lanes."""
        return self.format.bytes * self.width

    def label(self, label: str) -> None:
        """Start a basic block before which everything is still available."""
        self.lines.append(f"{label}:")
        self.block = label

    def _pure(self, instruction: str) -> Value:
        if instruction not in self._printed:
            self._printed[instruction] = self.emit(instruction)
        return self._printed[instruction]

    def _intrinsic(self, name: str, *arguments: Value) -> Value:
        types = ", ".join([self.real] * len(arguments))
        self.declarations.add(f"declare {self.real} @llvm.{name}.{self._suffix}({types})")
        typed = ", ".join(f"{self.real} {argument}" for argument in arguments)
        return self._pure(f"call {self.real} @llvm.{name}.{self._suffix}({typed})")

    def operate(self, name, *values):
        if name in INTRINSICS:
            return self._intrinsic(name, *values)
        operands = [self.int_constant(v) if isinstance(v, int) else v for v in values]
        return self._pure(INSTRUCTIONS[name].format(*operands, real=self.real, integer=self.integer, mask=self.mask))

    def constant(self, number: float) -> Value:
        (bits,) = struct.unpack("<Q", struct.pack("<d", self.format.rounded(number)))  # LLVM writes floats as doubles
        return self._splat(f"{self.format.real} 0x{bits:016X}")

    def int_constant(self, number):
        half = 1 << (self.format.bits - 1)
        return self._splat(f"{self.format.integer} {(number + half) % (2 * half) - half}")

    def inverse(self, p):
        return self._pure(f"xor {self.mask} {p}, {self._splat('i1 true')}")

    # Leaving the straight line.

    def call(self, name, *arguments):
        typed = ", ".join(f"{self.real} {argument}" for argument in arguments)
        return self._pure(f"call {self.real} @{self._lanes(name, len(arguments))}({typed})")

    def rarely(self, mask, slow: Sequence[Slow], *fast):
        assert len(slow) == len(fast)
        wide, join = self.fresh("rare"), self.fresh("join")
        some, usual = self.any(mask), self.block
        self.branch(some, wide, join)
        self.label(wide)
        printed = dict(self._printed)  # what is printed in this block is not available after it
        rare = [
            self.select(mask, self.call(name, *arguments), value)
            for (name, arguments), value in zip(slow, fast, strict=True)
        ]
        self._printed = printed
        self.jump(join)
        self.label(join)
        return tuple(
            self.emit(f"phi {self.real} [ {usual_value}, %{usual} ], [ {rare_value}, %{wide} ]")
            for usual_value, rare_value in zip(fast, rare, strict=True)
        )

    def any(self, mask: Value) -> Value:
        """One bit: whether a truth value holds in any lane."""
        if self.width == 1:
            return mask
        name = f"llvm.vector.reduce.or.v{self.width}i1"
        self.declarations.add(f"declare i1 @{name}({self.mask})")
        return self._pure(f"call i1 @{name}({self.mask} {mask})")

    def _lanes(self, name: str, arity: int) -> str:
        """The function that maps libm's `name` over the lanes: not inlined, or hundreds of them would swell a program.

        The calls are `nobuiltin`: LLVM must not put its own idea of a libm function (pow(x, 2) = x x) in its place.
        """
        real, name = self.format.real, f"{name}{self.format.suffix}"
        lanes = f"{name}.lanes{self.width}"
        scalars = ", ".join([real] * arity)
        self.declarations.add(f"declare {real} @{name}({scalars}) nounwind willreturn memory(none)")
        lines = [
            f"define internal {self.real} @{lanes}({', '.join(f'{self.real} %a{k}' for k in range(arity))}) "
            "noinline cold nounwind willreturn memory(none) {"
        ]
        result = "poison"
        for lane in range(self.width):
            typed = [f"%a{k}" for k in range(arity)]
            if self.width > 1:
                typed = [f"%a{k}.{lane}" for k in range(arity)]
                lines += [f"  %a{k}.{lane} = extractelement {self.real} %a{k}, i32 {lane}" for k in range(arity)]
            lines.append(f"  %r{lane} = call {real} @{name}({', '.join(f'{real} {a}' for a in typed)}) nobuiltin")
            if self.width > 1:
                lines.append(f"  %s{lane} = insertelement {self.real} {result}, {real} %r{lane}, i32 {lane}")
                result = f"%s{lane}"
            else:
                result = f"%r{lane}"
        self.definitions[lanes] = "\n".join([*lines, f"  ret {self.real} {result}", "}"])
        return lanes
