"""The simulation loop in native code: the few instructions that a trace cannot hold, around a traced step.

The step is a program  step(x, u, h) → x⁺. Around it, for every lane by itself:

- *schedule cursor*: rows (tick, offset, u) replace u at tick·h + offset, and the step lands on them exactly;
- *finite check*: a lane whose state leaves the finite numbers is frozen at its last finite state, with the tick it happened;
- *record*: x after every `every`-th tick.

In NumPy, for one lane:

    for k in range(first, last):
        t = 0.0
        while t < h:
            while (due_tick, due_offset) <= (k, t):  u, due = next row
            edge = due_offset if due_tick == k else h
            new = step(x, u, edge - t)
            if frozen < 0:  x, frozen = (new, frozen) if isfinite(new).all() else (x, k)
            t = edge
        if (k + 1) % every == 0:  record[(k + 1) // every] = x

Tiles of W lanes are outermost and ticks inside; lanes that have nothing to do in a segment keep their state by a select,
so a lane's bits do not depend on its neighbours.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from armwright.kernels.llvm import Engine, Module, Target
from armwright.kernels.tiles import store_tile
from armwright.program import Program

POINTER, INTEGER = ctypes.c_void_p, ctypes.c_int64
NEVER = 2.0**62  # a tick that does not come


@dataclass
class LaneState:
    """Everything the loop reads and writes, for whole tiles of lanes; arrays (tiles, entries, W) unless said otherwise."""

    x: np.ndarray  # states
    u: np.ndarray  # commands that hold now
    due_tick: np.ndarray  # (tiles, W) when the next row of the lane's schedule comes: tick …
    due_offset: np.ndarray  # … and [s] after it
    cursor: np.ndarray  # (tiles, W) int64, that row
    end: np.ndarray  # (tiles, W) int64, the row behind the lane's last
    frozen: np.ndarray  # (tiles, W) tick at which the lane left the finite numbers, or -1
    row_tick: np.ndarray  # (rows,) of all schedules
    row_offset: np.ndarray  # (rows,) [s]
    row_u: np.ndarray  # (rows, nu)
    record: np.ndarray  # (ticks // every + 1, tiles W, nx), row 0 is the initial state


class Loop:
    """A compiled loop around a step program."""

    def __init__(self, step: Program, target: Target):
        self.step, self.target = step, target
        types = (INTEGER, INTEGER, INTEGER, INTEGER, INTEGER, ctypes.c_double, INTEGER, *[POINTER] * 11)
        self._run = Engine(target, _module, step).function("loop", *types)

    def run(self, lanes: LaneState, h: float, tiles: tuple[int, int], ticks: tuple[int, int], every: int) -> None:
        """Takes the lanes of some tiles through some ticks of h seconds; the GIL is released."""
        arrays = (
            *(lanes.x, lanes.u, lanes.due_tick, lanes.due_offset, lanes.cursor, lanes.end, lanes.frozen),
            *(lanes.row_tick, lanes.row_offset, lanes.row_u, lanes.record),
        )
        stride = lanes.record.shape[1] * lanes.record.shape[2]
        self._run(*tiles, *ticks, every, h, stride, *(a.ctypes.data for a in arrays))


def _module(width: int, step: Program) -> Module:
    module = Module(width)
    function = module.add_block_function(step)
    nx, nu = step.inputs[0].size, step.inputs[1].size
    module.functions["advance"] = _advance(width, nu)
    module.functions["loop"] = _loop(module, function, nx, nu)
    module.declarations.add("declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)")
    return module


def _advance(w: int, nu: int) -> str:
    """For each lane of a tile: while its next row is due at (tick, t), that row's u, and on to the next row."""
    return f"""define internal void @advance(double %tick, ptr %t, ptr %u, ptr %due_tick, ptr %due_offset, ptr %cursor, ptr %end,
    ptr %row_tick, ptr %row_offset, ptr %row_u) noinline nounwind {{
entry:
  br label %lane
lane:
  %l = phi i64 [ 0, %entry ], [ %l.next, %next ]
  %tick.at = getelementptr double, ptr %due_tick, i64 %l
  %offset.at = getelementptr double, ptr %due_offset, i64 %l
  %cursor.at = getelementptr i64, ptr %cursor, i64 %l
  %end.at = getelementptr i64, ptr %end, i64 %l
  %t.at = getelementptr double, ptr %t, i64 %l
  %now = load double, ptr %t.at, align 8
  %last = load i64, ptr %end.at, align 8
  br label %check
check:
  %due = load double, ptr %tick.at, align 8
  %offset = load double, ptr %offset.at, align 8
  %this = fcmp oeq double %due, %tick
  %past = fcmp ole double %offset, %now
  %now.due = and i1 %this, %past
  br i1 %now.due, label %take, label %next
take:
  %row = load i64, ptr %cursor.at, align 8
  %row.first = mul i64 %row, {nu}
  br label %entry.copy
entry.copy:
  %e = phi i64 [ 0, %take ], [ %e.next, %entry.copy ]
  %from.index = add i64 %row.first, %e
  %from = getelementptr double, ptr %row_u, i64 %from.index
  %value = load double, ptr %from, align 8
  %to.first = mul i64 %e, {w}
  %to.index = add i64 %to.first, %l
  %to = getelementptr double, ptr %u, i64 %to.index
  store double %value, ptr %to, align 8
  %e.next = add i64 %e, 1
  %e.more = icmp ult i64 %e.next, {nu}
  br i1 %e.more, label %entry.copy, label %taken
taken:
  %row.next = add i64 %row, 1
  store i64 %row.next, ptr %cursor.at, align 8
  %is.more = icmp ult i64 %row.next, %last
  br i1 %is.more, label %following, label %none
following:
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


def _loop(module: Module, step: str, nx: int, nu: int) -> str:
    w = module.width
    m = module.machine()
    vector, mask, wide = m.double, m.mask, 8 * w
    out = m.lines.append

    def entry(pointer: str, index: int) -> str:
        return m.emit(f"getelementptr {vector}, ptr {pointer}, i64 {index}")

    def splat(value: str) -> str:
        if w == 1:
            return value
        first = m.emit(f"insertelement {vector} poison, double {value}, i32 0")
        return m.emit(f"shufflevector {vector} {first}, {vector} poison, <{w} x i32> zeroinitializer")

    def any_lane(condition: str) -> str:
        if w == 1:
            return condition
        module.declarations.add(f"declare i1 @llvm.vector.reduce.or.v{w}i1({mask})")
        return m.emit(f"call i1 @llvm.vector.reduce.or.v{w}i1({mask} {condition})")

    def of_tile(name: str, entries: int) -> None:
        out(f"  %{name}.offset = mul i64 %tile, {entries * w}")
        out(f"  %{name}.tile = getelementptr double, ptr %{name}, i64 %{name}.offset")

    def copied(to: str, source: str, entries: int) -> None:
        out(f"  call void @llvm.memcpy.p0.p0.i64(ptr {to}, ptr {source}, i64 {entries * wide}, i1 false)")

    for name, entries in (("xa", nx), ("xb", nx), ("ua", nu), ("ha", 1), ("ta", 1)):
        out(f"  %{name} = alloca [{entries} x {vector}], align {wide}")
    h = splat("%h")
    out("  %some = icmp slt i64 %tile0, %tile1")
    out("  br i1 %some, label %tiles, label %done")
    m.begin("tiles")
    out("  %tile = phi i64 [ %tile0, %entry ], [ %tile.next, %tile.end ]")
    for name, entries in (
        ("x", nx),
        ("u", nu),
        *((name, 1) for name in ("due_tick", "due_offset", "cursor", "end", "frozen")),
    ):
        of_tile(name, entries)
    out(f"  %record.offset = mul i64 %tile, {nx * w}")
    out("  %record.tile = getelementptr double, ptr %record, i64 %record.offset")
    copied("%xa", "%x.tile", nx)
    copied("%ua", "%u.tile", nu)
    out("  br label %ticks")
    m.begin("ticks")
    out("  %k = phi i64 [ %tick0, %tiles ], [ %k.next, %tick.end ]")
    out("  %tick = sitofp i64 %k to double")
    out(f"  store {vector} zeroinitializer, ptr %ta, align {wide}")
    ticks = splat("%tick")
    due = m.emit(f"load {vector}, ptr %due_tick.tile, align 8")
    out(f"  br i1 {any_lane(m.emit(f'fcmp oeq {vector} {due}, {ticks}'))}, label %rows, label %segment")
    m.begin("rows")
    pointers = "ptr %ua, ptr %due_tick.tile, ptr %due_offset.tile, ptr %cursor.tile, ptr %end.tile"
    out(f"  call void @advance(double %tick, ptr %ta, {pointers}, ptr %row_tick, ptr %row_offset, ptr %row_u)")
    out("  br label %segment")
    m.begin("segment")
    t = m.emit(f"load {vector}, ptr %ta, align {wide}")
    due = m.emit(f"load {vector}, ptr %due_tick.tile, align 8")
    offset = m.emit(f"load {vector}, ptr %due_offset.tile, align 8")
    here = m.emit(f"fcmp oeq {vector} {due}, {ticks}")
    edge = m.emit(f"select {mask} {here}, {vector} {offset}, {vector} {h}")
    length = m.emit(f"fsub {vector} {edge}, {t}")
    out(f"  store {vector} {length}, ptr %ha, align {wide}")
    out(f"  call void @{step}(ptr %xa, ptr %ua, ptr %ha, ptr %xb)")
    moving = m.emit(f"fcmp olt {vector} {t}, {h}")
    frozen = m.emit(f"load {vector}, ptr %frozen.tile, align 8")
    alive = m.emit(f"and {mask} {moving}, {m.emit(f'fcmp olt {vector} {frozen}, {m.constant(0.0)}')}")
    new = [m.emit(f"load {vector}, ptr {entry('%xb', k)}, align {wide}") for k in range(nx)]
    poison = m.constant(0.0)
    for value in new:  # 0·x is NaN where x is not finite, and NaN stays
        poison = m.fma(value, m.constant(0.0), poison)
    finite = m.eq(poison, m.constant(0.0))
    good = m.both(alive, finite)
    bad = m.both(alive, m.inverse(finite))
    out(f"  store {vector} {m.select(bad, ticks, frozen)}, ptr %frozen.tile, align 8")
    for k, value in enumerate(new):
        place = entry("%xa", k)
        old = m.emit(f"load {vector}, ptr {place}, align {wide}")
        out(f"  store {vector} {m.select(good, value, old)}, ptr {place}, align {wide}")
    out(f"  store {vector} {edge}, ptr %ta, align {wide}")
    out(f"  br i1 {any_lane(m.lt(edge, h))}, label %rows, label %tick.full")
    m.begin("tick.full")
    out("  %k.next = add i64 %k, 1")
    out("  %phase = urem i64 %k.next, %every")
    out("  %is.row = icmp eq i64 %phase, 0")
    out("  br i1 %is.row, label %write, label %tick.end")
    m.begin("write")
    out("  %row = udiv i64 %k.next, %every")
    out("  %row.offset = mul i64 %row, %record_stride")
    out("  %row.at = getelementptr double, ptr %record.tile, i64 %row.offset")
    store_tile(m, "%row.at", [m.emit(f"load {vector}, ptr {entry('%xa', k)}, align {wide}") for k in range(nx)])
    out("  br label %tick.end")
    m.begin("tick.end")
    out("  %more.ticks = icmp slt i64 %k.next, %tick1")
    out("  br i1 %more.ticks, label %ticks, label %tile.end")
    m.begin("tile.end")
    copied("%x.tile", "%xa", nx)
    copied("%u.tile", "%ua", nu)
    out("  %tile.next = add i64 %tile, 1")
    out("  %more.tiles = icmp slt i64 %tile.next, %tile1")
    out("  br i1 %more.tiles, label %tiles, label %done")
    m.begin("done")
    names = ("x", "u", "due_tick", "due_offset", "cursor", "end", "frozen", "row_tick", "row_offset", "row_u", "record")
    head = (
        "define void @loop(i64 %tile0, i64 %tile1, i64 %tick0, i64 %tick1, i64 %every, double %h, i64 %record_stride, "
    )
    head += ", ".join(f"ptr %{name}" for name in names) + ") nounwind {\nentry:"
    return "\n".join([head, *m.lines, "  ret void", "}"])
