"""A simulation loop on a GPU: `NativeLoop` with the stages in CUDA C, one thread a lane. Numbers are doubles, always."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

from armwright.kernels.cuda import THREADS, WARP
from armwright.kernels.cuda_device import DeviceArray, Gpu
from armwright.kernels.cuda_loop_printer import INTEGERS, LOOP, REALS, cuda_loop_source, pointers_of
from armwright.kernels.loop import ENDLESS, NO_ARRAYS, LaneGroup, LoopArrays, NativeLoop
from armwright.kernels.loop_arguments import ROWS
from armwright.kernels.stages import DelayStage, RecordStage, RowsStage, Stage, TableStage
from armwright.kernels.target import Target

MOST_RECORDED = 1 << 28  # [bytes] of rows that wait on the GPU: a launch takes as many ticks as give so many


class CudaLoop(NativeLoop):
    """Stages on a GPU. The blocks of its lanes are in the memory of the CPU between two runs, in tiles of a warp's 32 lanes."""

    def __init__(self, stages: tuple[Stage, ...], gpu: Gpu):
        """Compiles stages for a GPU.

        Raises:
            ProgramError: a stage that has no CUDA C.
            ModelError: NVRTC is not installed, or makes no code for this GPU.
        """
        super().__init__(stages, Target("cuda", "", WARP), runs=False)
        self._gpu, self._function = gpu, gpu.function(LOOP, cuda_loop_source, *stages)

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
        """Takes the lanes through some ticks of h seconds, and waits for the GPU; arguments as of `NativeLoop.run`."""
        kept = {"": self._gpu.put(np.concatenate([lanes.blocks[name] for name in self.sizes], axis=1))}
        kept |= {name: self._gpu.put(ring) for name, ring in lanes.rings.items()}
        schedules = {
            (name, part): self._gpu.put(getattr(rows, part)) for name, rows in arrays.schedules.items() for part in ROWS
        }
        numbers = {
            "last": last, "every": every, "h_tick": float(h), "lane0": lanes.first + lanes.offset, "seed": seed,
            "origin": origin, "substeps": substeps, "part": 1.0 / substeps,
        }  # fmt: skip
        count = lanes.tiles * WARP
        for tick0, tick1 in self._launches(ticks, every, count):
            numbers |= {"tick0": tick0, "tick1": tick1}
            rows = slice(-((origin - tick0) // every), (tick1 - 1 - origin) // every + 1)
            records: dict[str, DeviceArray] = {}
            parameters: list[Any] = [*(numbers[name] for name in (*INTEGERS, *REALS)), _at(kept[""])]
            inputs = []  # which must outlive the launch
            for stage, part in pointers_of(self.stages):
                if isinstance(stage, RecordStage) and part == "record":
                    shape = (max(0, rows.stop - rows.start), sum(stage.entries), count)
                    array = records[stage.name] = self._gpu.array(shape, np.dtype(float))
                elif isinstance(stage, RecordStage):
                    parameters.append(rows.start)
                    continue
                elif isinstance(stage, TableStage):
                    array = self._gpu.put(arrays.tables[stage.block][tick0 - origin : tick1 - origin])
                elif isinstance(stage, RowsStage):
                    array = schedules[stage.block, part]
                else:
                    assert isinstance(stage, DelayStage)
                    array = kept[stage.to]
                inputs.append(array)
                parameters.append(_at(array))
            self._function(count, THREADS, parameters, 0)
            self._gpu.wait()
            for name, record in records.items():
                arrays.records[name][rows] = record.numpy().transpose(0, 2, 1)
        first, values = 0, kept.pop("").numpy()
        for name, size in self.sizes.items():
            lanes.blocks[name][...] = values[:, first : first + size]
            first += size
        for name, ring in kept.items():
            lanes.rings[name][...] = ring.numpy()

    def _launches(self, ticks: tuple[int, int], every: int, count: int) -> Iterator[tuple[int, int]]:
        """Ticks of each launch, so that few rows wait on the GPU."""
        entries = sum(sum(stage.entries) for stage in self.stages if isinstance(stage, RecordStage))
        rows = max(1, MOST_RECORDED // (8 * max(1, entries) * count))
        size = max(1, min(rows * every, ticks[1] - ticks[0]))
        return ((first, min(first + size, ticks[1])) for first in range(*ticks, size))


def _at(array: DeviceArray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.address)
