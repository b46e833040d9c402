"""Row-major arrays in and out of registers: W states of k entries become k vectors of W lanes, by in-register transposes.

Columns go in chunks of c = 4 or 2 (of floats 8 too): a vector is put together from c entries of W/c rows (an insert from
memory, which costs little), and log2 c rounds of shuffles inside blocks of c finish the transpose. For doubles on AVX-512 that
is 2 shuffles a column, where a full 8 × 8 transpose takes 3 on the one port that can.
"""

from __future__ import annotations

from collections.abc import Iterator

from armwright.kernels.llvm_machine import LlvmMachine
from armwright.kernels.machine import Value

CHUNK = 32  # bytes of a row that are read or written at once


def load_tile(m: LlvmMachine, pointer: str, columns: int) -> list[Value]:
    """One vector a column, from W rows of `columns` reals at `pointer`."""
    if m.width == 1 or columns == 1:
        return [
            m.emit(f"load {m.real}, ptr {_at(m, pointer, k * m.width)}, align {m.format.bytes}") for k in range(columns)
        ]
    loaded: dict[int, Value] = {}
    for start, c in _chunks(columns, m):
        load = f"load <{c} x {m.format.real}>, ptr {{}}, align {m.format.bytes}"
        vectors = []
        for row in range(c):
            places = [_at(m, pointer, r * columns + start) for r in range(row, m.width, c)]
            vectors.append(_joined(m, [m.emit(load.format(place)) for place in places], c))
        for k, vector in enumerate(_transposed(m, vectors, c)):
            loaded.setdefault(start + k, vector)
    return [loaded[k] for k in range(columns)]


def store_tile(m: LlvmMachine, pointer: str, values: list[Value]) -> None:
    """W rows of reals at `pointer`, from one vector a column."""
    columns = len(values)
    if m.width == 1 or columns == 1:
        for k, value in enumerate(values):
            m.lines.append(f"  store {m.real} {value}, ptr {_at(m, pointer, k * m.width)}, align {m.format.bytes}")
        return
    for start, c in _chunks(columns, m):
        for row, vector in _rows(m, values[start : start + c]):
            _store_row(m, vector, c, pointer, row * columns + start)


def store_tile_loop(m: LlvmMachine, columns: int, table: str | None = None) -> None:
    """`store_tile` as a loop, for tiles of many columns that wait in a block: from `%block` to `%out`, in the machine's function.

    The table, in memory, has the place of every column in the block; by default they stand in order. A straight line of
    thousands of shuffles takes compilers minutes.
    """
    c = 4 if m.width >= 4 else 2
    chunks = -(-columns // c)
    with m.repeat("chunk", chunks) as k:
        even = m.emit(f"mul i64 {k}, {c}")
        over = m.emit(f"icmp ugt i64 {even}, {columns - c}")
        start = m.emit(f"select i1 {over}, i64 {columns - c}, i64 {even}")  # the last chunk may overlap the one before
        values = []
        for column in range(c):
            entry = m.emit(f"add i64 {start}, {column}")
            if table is not None:
                entry = m.emit(f"load i64, ptr {m.emit(f'getelementptr i64, ptr {table}, i64 {entry}')}")
            place = m.emit(f"getelementptr {m.real}, ptr %block, i64 {entry}")
            values.append(m.emit(f"load {m.real}, ptr {place}, align {m.bytes}"))
        for row, vector in _rows(m, values):
            _store_row(m, vector, c, "%out", m.emit(f"add i64 {start}, {row * columns}"))


def stream_tile(m: LlvmMachine, columns: int) -> None:
    """A finished tile to where it belongs, past the caches: from `%block`, aligned, to `%out`, in the machine's function.

    Whole vectors at aligned places; the ends, where `%out` begins between two, in the usual way.
    """
    w, real, kind = m.width, m.format.bytes, m.format.real
    over = m.emit(f"urem i64 {m.emit('ptrtoint ptr %out to i64')}, {m.bytes}")
    head = m.emit(f"urem i64 {m.emit(f'sub i64 {m.bytes}, {over}')}, {m.bytes}")
    first = m.emit(f"udiv i64 {head}, {real}")
    vectors = m.emit(f"udiv i64 {m.emit(f'sub i64 {columns * w}, {first}')}, {w}")
    with m.repeat("vector", vectors) as k:
        at = m.emit(f"add i64 {first}, {m.emit(f'mul i64 {k}, {w}')}")
        source, sink = (m.emit(f"getelementptr {kind}, ptr {pointer}, i64 {at}") for pointer in ("%block", "%out"))
        value = m.emit(f"load {m.real}, ptr {source}, align {real}")
        m.lines.append(f"  store {m.real} {value}, ptr {sink}, align {m.bytes}, !nontemporal !{{i32 1}}")
    m.branch(m.emit(f"icmp eq i64 {head}, 0"), "whole", "ends")
    m.begin("ends")
    end = m.emit(f"sub i64 {columns * w * real}, {m.emit(f'sub i64 {m.bytes}, {head}')}")
    for offset, length in (("0", head), (end, m.emit(f"sub i64 {m.bytes}, {head}"))):
        source, sink = (m.emit(f"getelementptr i8, ptr {pointer}, i64 {offset}") for pointer in ("%block", "%out"))
        m.lines.append(f"  call void @llvm.memcpy.p0.p0.i64(ptr {sink}, ptr {source}, i64 {length}, i1 false)")
    m.jump("whole")
    m.begin("whole")


def _chunks(columns: int, m: LlvmMachine) -> Iterator[tuple[int, int]]:
    """Starts and sizes of chunks that cover the columns; the last overlaps the one before where the number is odd."""
    start, most = 0, min(columns, m.width, CHUNK // m.format.bytes)
    while start < columns:
        left = columns - start
        c = next(c for c in (8, 4, 2) if c <= most and left >= c - 1)
        start = min(start, columns - c)
        yield start, c
        start += c


def _at(m: LlvmMachine, pointer: str, offset: Value) -> Value:
    return pointer if offset == 0 else m.emit(f"getelementptr {m.format.real}, ptr {pointer}, i64 {offset}")


def _joined(m: LlvmMachine, parts: list[Value], size: int) -> Value:
    """Parts of `size` reals side by side in one vector."""
    while len(parts) > 1:
        lanes = _lanes(range(2 * size))
        kind = f"<{size} x {m.format.real}>"
        parts = [
            m.emit(f"shufflevector {kind} {a}, {kind} {b}, <{2 * size} x i32> <{lanes}>")
            for a, b in zip(parts[::2], parts[1::2], strict=True)
        ]
        size *= 2
    return parts[0]


def _store_row(m: LlvmMachine, row: Value, size: int, pointer: str, offset: Value) -> None:
    m.lines.append(f"  store <{size} x {m.format.real}> {row}, ptr {_at(m, pointer, offset)}, align {m.format.bytes}")


def _rows(m: LlvmMachine, columns: list[Value]) -> Iterator[tuple[int, Value]]:
    """W rows of c reals from c columns, each with its number.

    Where a register holds two rows, the last round of the transpose takes the c lanes of each at once: LLVM would fold a round
    over all lanes and what takes c of them only in passes that cost a quarter of the time to compile. Where it holds more, it
    makes fewer instructions of the whole transpose.
    """
    w, c = m.width, len(columns)
    places = [range(first, first + c) for first in range(0, w, c)]
    if w > 2 * c:
        turned = _transposed(m, columns, c)
        parts = [[_taken(m, each, lanes) for each in turned] for lanes in places]
    else:
        turned = _transposed(m, columns, c // 2)
        parts = [_swapped(m, turned, c // 2, lanes) for lanes in places]
    for row in range(c):
        for part, rows in enumerate(parts):
            yield part * c + row, rows[row]


def _taken(m: LlvmMachine, value: Value, kept: range) -> Value:
    """Some lanes of a vector."""
    return m.emit(f"shufflevector {m.real} {value}, {m.real} poison, <{len(kept)} x i32> <{_lanes(kept)}>")


def _transposed(m: LlvmMachine, rows: list[Value], size: int) -> list[Value]:
    """Vectors, transposed inside each block of `size` lanes."""
    s = 1
    while s < size:
        rows = _swapped(m, rows, s, range(m.width))
        s *= 2
    return rows


def _swapped(m: LlvmMachine, rows: list[Value], s: int, kept: range) -> list[Value]:
    """One round of a transpose, of which some lanes are kept: it swaps the off-diagonal blocks of size s in pairs."""
    w, rows = m.width, list(rows)
    low = _lanes(w + k - s if k & s else k for k in kept)
    high = _lanes(w + k if k & s else k + s for k in kept)
    for i in range(len(rows)):
        if not i & s:
            a, b = rows[i], rows[i + s]
            rows[i], rows[i + s] = (
                m.emit(f"shufflevector {m.real} {a}, {m.real} {b}, <{len(kept)} x i32> <{lanes}>")
                for lanes in (low, high)
            )
    return rows


def _lanes(numbers) -> str:
    return ", ".join(f"i32 {k}" for k in numbers)
