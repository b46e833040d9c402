"""Stages on a GPU: the CUDA text, run on this processor by a fake driver, does what the compiled stages do, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from armwright import scalar
from armwright.errors import ProgramError
from armwright.kernels.cuda_device import Gpu
from armwright.kernels.cuda_loop import CudaLoop
from armwright.kernels.cuda_loop_printer import cuda_loop_source
from armwright.kernels.loop import LoopArrays, NativeLoop, Schedules
from armwright.kernels.stages import (
    Adapt,
    Call,
    DelayStage,
    DrawStage,
    Exchange,
    Integrate,
    RecordStage,
    RowsStage,
    Stage,
    TableStage,
)
from armwright.kernels.target import select_target
from armwright.program import trace
from kernels.fake_cuda import FakeCuda

LANES, TICKS, H = 70, 23, 0.01  # three warps, the last of them with 6 lanes


@pytest.fixture
def gpu(tmp_path, monkeypatch) -> FakeCuda:
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", str(tmp_path / "cache"))
    return FakeCuda(tmp_path).install(monkeypatch)


def stages(step: float = 1.0) -> tuple[Stage, ...]:
    """A pendulum with every stage of a simulation."""
    swing = trace(
        "step", lambda x, u, h: scalar.array([x[0] + h * x[1], x[1] + h * (u[0] - step * scalar.sin(x[0]))]),
        {"x": (2,), "u": (1,), "h": ()}, ("x_next",),
    )  # fmt: skip
    sense = trace("sense", lambda x, w: x[:1] + 1e-3 * w[:1], {"x": (2,), "w": (3,)}, ("y",))
    control = trace(
        "control", lambda y_old, r, m: (scalar.array([r[0] * r[1] - y_old[0]]), m + y_old),
        {"y_old": (1,), "r": (2,), "m": (1,)}, ("u", "m_next"),
    )  # fmt: skip
    also = trace("also", lambda a, v: scalar.array([a[0], v[0]]), {"u": (1,), "v": (1,)}, ("u_all",))
    return (
        DrawStage("w", 3, channel=4), Call(sense), DelayStage("y", "y_old", "lag", entries=1, length=4),
        TableStage("r", 2, spread=False), RowsStage("v", 1), Call(control), Call(also),
        RecordStage("run", ("x", "w", "y_old", "m", "u_all"), (2, 3, 1, 1, 2)), Integrate(swing),
    )  # fmt: skip


def ran(loop: NativeLoop, *parts: int) -> tuple[np.ndarray, ...]:
    """Rows of a run in some parts, and the blocks and the ring behind it."""
    lanes = loop.lanes(LANES, first=1000)
    random = np.random.default_rng(0)
    lanes.set("x", random.normal(size=(LANES, 2)))
    lanes.set("lag", (np.arange(LANES) % 4).reshape(-1, 1))
    lanes.fill_ring("y_old", random.normal(size=(LANES, 1)))
    first = 3 * np.arange(LANES)
    ticks, offsets = np.tile([0.0, 4.0, 9.0], LANES), np.tile([0.0, 0.0, 0.25 * H], LANES)
    skipped = np.zeros(1000, int)  # of the lanes before the group
    own = Schedules(
        ticks,
        offsets,
        random.normal(size=(3 * LANES, 1)),
        np.concatenate([skipped, first]),
        np.concatenate([skipped, first + 3]),
    )
    loop.begin_rows(lanes, "v", own)
    record = np.full((TICKS // 2 + 1, lanes.tiles * lanes.width, 9), np.nan)
    arrays = LoopArrays({"r": random.normal(size=(TICKS + 1, 2))}, {"v": own}, {"run": record})
    edges = (0, *parts, TICKS + 1)
    for k in range(len(edges) - 1):
        loop.run(lanes, H, (edges[k], edges[k + 1]), arrays, last=TICKS, every=2, seed=2**63 + 5, substeps=3)
    assert np.isfinite(record[:, :LANES]).all()
    return record[:, :LANES], *(lanes.get(name) for name in ("x", "m", "v", "frozen")), lanes.get_ring("y_old")


def test_every_stage_of_a_simulation_has_the_bits_of_the_cpu_s(gpu):
    expected = ran(NativeLoop(stages(), select_target()))
    for parts in ((), (1, 10, 11)):
        found = ran(CudaLoop(stages(), Gpu()), *parts)
        assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
    assert gpu.launches == [("loop", 1, 128, 0)] * 5
    assert gpu.compiled == ["sm_90"]  # the second loop's code was kept
    assert not np.array_equal(ran(CudaLoop(stages(1.01), Gpu()))[0], expected[0])  # other numbers, other code
    assert not gpu.memory


def test_what_has_no_cuda_text_is_refused():
    step = stages()[-1].step
    with pytest.raises(ProgramError, match="tangents"):
        cuda_loop_source(Integrate(step, landing=step))
    with pytest.raises(ProgramError, match="tangents"):
        cuda_loop_source(Exchange(2, 1, 3, 4, 2))
    with pytest.raises(ProgramError, match="looks for events"):
        cuda_loop_source(Adapt(step, 10, cross=step, halve=step, choose=step, note=step))
