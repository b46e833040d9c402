"""A compiled simulation loop: stages in native code, over the blocks of a group of lanes. Numbers are doubles, always."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from armwright.kernels.engine import Engine
from armwright.kernels.loop_arguments import NUMBERS, POINTERS, argument_names
from armwright.kernels.stages import (
    CURSOR,
    NEVER,
    DelayStage,
    Exchange,
    RecordStage,
    RowsStage,
    Stage,
    TableStage,
    block_sizes,
)
from armwright.kernels.target import Target

if TYPE_CHECKING:
    from armwright.kernels.llvm import LlvmModule

ENDLESS = 2**62  # a last tick that does not come


@dataclass(frozen=True, eq=False)
class Schedules:
    """Rows of all lanes' schedules, one behind another, and which are whose.

    Attributes:
        tick, offset: (rows,) when each holds: [s] after that tick.   values: (rows, entries).
        first, end: (lanes,) each lane's rows; lanes may share theirs.
    """

    tick: np.ndarray
    offset: np.ndarray
    values: np.ndarray
    first: np.ndarray
    end: np.ndarray


@dataclass(frozen=True, eq=False)
class Tasks:
    """Work items of the lanes of a searching loop.

    Attributes:
        queue: (2,) int64: the task that is taken next, and the one behind the last; the loop counts it up.
        tasks, attempts, results: in rows.   ranks: (tasks, ranked) numbers of rows of `attempts`, as floats.
    """

    queue: np.ndarray
    tasks: np.ndarray
    attempts: np.ndarray
    ranks: np.ndarray
    results: np.ndarray


@dataclass(frozen=True, eq=False)
class LoopArrays:
    """Arrays that a loop reads and writes beside the blocks of its lanes.

    Attributes:
        tables: (ticks, entries) by block.   schedules: by block.
        records: by name, (rows, tiles · W, entries) of the group, contiguous along the last two axes.
        tasks: of a loop that searches.
    """

    tables: Mapping[str, np.ndarray] = field(default_factory=dict)
    schedules: Mapping[str, Schedules] = field(default_factory=dict)
    records: Mapping[str, np.ndarray] = field(default_factory=dict)
    tasks: Tasks | None = None


NO_ARRAYS = LoopArrays()


@dataclass(eq=False)
class LaneGroup:
    """Memory of the loop for one group of lanes, in whole tiles of W; the last tile is filled up with lane 0.

    Attributes:
        count: lanes that are asked for.   first: place of the group's first lane among those that are run.
        offset: number of the first lane that is run; a lane's number decides its random draws.
        blocks: by name, (tiles, entries, W).   rings: of delays, (tiles, length, entries, W).
    """

    count: int
    width: int
    first: int = 0
    offset: int = 0
    blocks: dict[str, np.ndarray] = field(default_factory=dict)
    rings: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def tiles(self) -> int:
        """Tiles of W lanes."""
        return -(-self.count // self.width)

    def own(self, values: np.ndarray) -> np.ndarray:
        """This group's rows of values (lanes, …); the only one of those that are the same for all lanes."""
        return values if len(values) == 1 else values[self.first : self.first + self.count]

    def set(self, name: str, values: np.ndarray) -> None:
        """Fills a block from (lanes, entries) or (entries,)."""
        block = self.blocks[name]
        rows = np.broadcast_to(values, (self.count, block.shape[1]))
        block[...] = self._in_tiles(rows).transpose(0, 2, 1)

    def get(self, name: str) -> np.ndarray:
        """A block as (lanes, entries)."""
        block = self.blocks[name]
        return block.transpose(0, 2, 1).reshape(self.tiles * self.width, block.shape[1])[: self.count]

    def get_ring(self, name: str) -> np.ndarray:
        """A delay's ring as (lanes, length, entries)."""
        ring = self.rings[name]
        return ring.transpose(0, 3, 1, 2).reshape(self.tiles * self.width, *ring.shape[1:3])[: self.count]

    def set_ring(self, name: str, values: np.ndarray) -> None:
        """Fills a delay's ring from (lanes, length, entries)."""
        self.rings[name][...] = self._in_tiles(values).transpose(0, 2, 3, 1)

    def fill_ring(self, name: str, values: np.ndarray) -> None:
        """Fills every slot of a delay's ring from (lanes, entries): the values before the first tick."""
        length, entries = self.rings[name].shape[1:3]
        rows = np.broadcast_to(values, (self.count, entries))
        self.set_ring(name, np.broadcast_to(rows[:, None], (self.count, length, entries)))

    def _in_tiles(self, rows: np.ndarray) -> np.ndarray:
        """Rows (lanes, …) as (tiles, W, …), the last tile filled up with lane 0."""
        missing = self.tiles * self.width - self.count
        padded = np.concatenate([rows, np.broadcast_to(rows[:1], (missing, *rows.shape[1:]))])
        return padded.reshape(self.tiles, self.width, *rows.shape[1:])


def loop_module(width: int, *stages: Stage) -> LlvmModule:
    """The module of stages, as `loop_printer` prints it."""
    from armwright.kernels import loop_printer

    return loop_printer.loop_module(width, *stages)


class NativeLoop:
    """Stages in native code."""

    def __init__(self, stages: tuple[Stage, ...], target: Target, *, runs: bool = True):
        """Compiles stages for a target; `runs` False: only their memory is wanted, and nothing is compiled."""
        self.stages, self.target = stages, target
        self.sizes = block_sizes(stages)
        self._names = argument_names(stages)
        self._run = Engine(target, loop_module, *stages).function("loop", ctypes.c_void_p) if runs else None

    def lanes(self, count: int, first: int = 0) -> LaneGroup:
        """Blocks of zeros for a group of lanes, none frozen."""
        lanes = LaneGroup(count, self.target.width, first)
        self.extend(lanes)
        return lanes

    def extend(self, lanes: LaneGroup) -> None:
        """Adds the blocks of this loop that the lanes do not have yet: two loops may take turns over the same lanes."""
        for name, entries in self.sizes.items():
            if name not in lanes.blocks:
                lanes.blocks[name] = _aligned((lanes.tiles, entries, lanes.width))
                if name == "frozen":
                    lanes.blocks[name].fill(-1.0)
        for stage in self.stages:
            if isinstance(stage, DelayStage) and stage.to not in lanes.rings:
                lanes.rings[stage.to] = _aligned((lanes.tiles, stage.length, stage.entries, lanes.width))

    def begin_rows(self, lanes: LaneGroup, name: str, schedules: Schedules, tick: int = 0) -> None:
        """Sets the cursors of a schedule stage to the first row of every lane that does not come before a tick.

        The block holds the row in force until then, if there is one.
        """
        group = slice(lanes.first, lanes.first + lanes.count)
        first, end = (
            np.broadcast_to(each, max(len(each), lanes.first + lanes.count))[group]
            for each in (schedules.first, schedules.end)
        )
        early = np.concatenate([[0], np.cumsum(schedules.tick < tick)])
        row = first + early[end] - early[first]  # rows of a lane are in the order of their times
        if (row > first).any():
            lanes.set(name, np.where((row > first)[:, None], schedules.values[np.maximum(row - 1, 0)], lanes.get(name)))
        none = row >= end
        at = np.minimum(row, len(schedules.tick) - 1)
        due = np.where(none, NEVER, schedules.tick[at])
        for part, values in zip(CURSOR, (due, schedules.offset[at], row, end), strict=True):
            lanes.set(f"{name}.{part}", values.reshape(-1, 1))

    def run(
        self,
        lanes: LaneGroup,
        h: float,
        ticks: tuple[int, int],
        arrays: LoopArrays = NO_ARRAYS,
        *,
        last: int = ENDLESS,
        every: int = ENDLESS,
        seed: int = 0,
        origin: int = 0,
        substeps: int = 1,
    ) -> None:
        """Takes the lanes through some ticks of h seconds; the GIL is released.

        Args:
            lanes: the group.   h: [s].   ticks: from the first of them up to, not including, the second.
            arrays: beside the lanes' blocks.
            last: in this tick and behind it nothing is integrated, nor anything done that comes behind in the stages.
            every: ticks from one recorded row to the next.   seed: of random draws.
            origin: the tick that tables and records begin with.
            substeps: equal steps of the plant between two changes, where it has a fixed step.
        """
        numbers = {
            "tile0": 0,
            "tile1": lanes.tiles,
            "tick0": ticks[0],
            "tick1": ticks[1],
            "last": last,
            "every": every,
            "h": _bits(h),
            "lane0": lanes.first + lanes.offset,
            "seed": seed,
            "origin": origin,
            "substeps": substeps,
            "part": _bits(1.0 / substeps),
        }
        arguments = [*(numbers[name] for name in NUMBERS), *self._pointers(lanes, arrays)]
        table = (ctypes.c_int64 * len(arguments))(*arguments)
        assert self._run is not None
        self._run(ctypes.addressof(table))

    def _pointers(self, lanes: LaneGroup, arrays: LoopArrays) -> Iterator[int]:
        """Addresses of the arrays, and strides, in the order of `argument_names`."""
        for name in self.sizes:
            yield lanes.blocks[name].ctypes.data
        for stage in self.stages:
            if isinstance(stage, TableStage):
                yield arrays.tables[stage.block].ctypes.data
            elif isinstance(stage, RowsStage):
                rows = arrays.schedules[stage.block]
                yield from (each.ctypes.data for each in (rows.tick, rows.offset, rows.values))
            elif isinstance(stage, DelayStage):
                yield lanes.rings[stage.to].ctypes.data
            elif isinstance(stage, RecordStage):
                record = arrays.records[stage.name]
                yield from (record.ctypes.data, record.strides[0] // 8)
            elif isinstance(stage, Exchange):
                assert arrays.tasks is not None
                yield from (getattr(arrays.tasks, name).ctypes.data for name in POINTERS)
                yield len(arrays.tasks.attempts)


def _bits(value: float) -> int:
    """The bits of a double as a whole number."""
    return struct.unpack("<q", struct.pack("<d", value))[0]


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros that begin at a multiple of a tile's vector."""
    align = shape[-1]
    size = int(np.prod(shape))
    room = np.zeros(size + align)
    start = -(room.ctypes.data // 8) % align
    return room[start : start + size].reshape(shape)
