"""State of a loop: everything that it carries from one tick to the next, as one value."""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import expect
from armwright.errors import RunError, ScenarioError
from armwright.model import Model
from armwright.output import whole_file
from armwright.results.aliases import LOOP_END, LOOP_STATE
from armwright.results.run_schema import check_run
from armwright.simulation.plant.plant import Plant

if TYPE_CHECKING:
    import xarray

BRAKE = "brake "  # how the names of a brake's states begin
ENDING = ".npz"
MOST_TICKS = 2**53
LARGEST = 2**32  # [bytes] of an archive, unpacked
UNREADABLE = (  # exceptions of NumPy and of JSON on a damaged state
    *(ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, NotImplementedError),
    *(EOFError, MemoryError, zipfile.BadZipFile, zlib.error),
)


@dataclass(frozen=True, eq=False)
class LoopState:
    """State of all lanes of a loop between two ticks.

    Attributes:
        tick: that comes next.   period: [s] of a tick.   single: true for one lane without a lane axis.
        entries: names of the plant's states, such as "qd elbow", in the order of block "x".
        blocks: (lanes, entries) by name: plant, sensors, controller, commands on their way; read-only.
        rings: (lanes, length, entries) of delays by name.
        python: memory of a controller in Python, by lane, or by the first lane of those that are called at once.
        controller: name of the controller; "" without one.
        measured: true where the measurement of this tick is taken already, as in a loop that is commanded from outside.
    """

    tick: int
    period: float
    single: bool
    entries: tuple[str, ...]
    blocks: Mapping[str, np.ndarray]
    rings: Mapping[str, np.ndarray] = field(default_factory=dict)
    python: Mapping[int, Any] = field(default_factory=dict)
    controller: str = ""
    measured: bool = False

    def __post_init__(self) -> None:
        for name, kind in (("entries", Sequence), ("blocks", Mapping), ("rings", Mapping)):
            expect(getattr(self, name), kind, f"LoopState.{name}", "what `Simulation.state` returns", ScenarioError)
        object.__setattr__(self, "entries", tuple(self.entries))
        for name in ("blocks", "rings"):
            object.__setattr__(self, name, {key: _read_only(values) for key, values in getattr(self, name).items()})

    @property
    def time(self) -> float:
        """[s] of the tick that comes next."""
        return self.tick * self.period

    @property
    def lanes(self) -> int:
        """Number of lanes."""
        return len(self.blocks["x"])

    def of_lanes(self, lanes: np.ndarray) -> LoopState:
        """The state of some of the lanes, by number."""
        parts = ({name: values[lanes] for name, values in each.items()} for each in (self.blocks, self.rings))
        blocks, rings = parts
        python = {k: self.python[int(lane)] for k, lane in enumerate(lanes) if int(lane) in self.python}
        return replace(self, blocks=blocks, rings=rings, python=python)

    def at_tick(self, tick: int) -> LoopState:
        """The state before another tick, not yet measured: schedules and random numbers continue from there."""
        moved = {name: np.roll(ring, tick - self.tick, axis=1) for name, ring in self.rings.items()}  # slot k % length
        return replace(self, tick=tick, rings=moved, measured=False)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the state as a NumPy archive, `.npz`; whole or not at all.

        Raises:
            OutputError: it cannot be written there.   ScenarioError: a controller's memory that is no array of numbers.
        """
        arrays = {f"block {name}": values for name, values in self.blocks.items()}
        arrays |= {f"ring {name}": values for name, values in self.rings.items()}
        for lane, memory in self.python.items():
            array = np.asarray(memory)
            if array.dtype.kind not in "iuf":
                place = f"memory of controller {self.controller!r}"
                raise ScenarioError(place=place, value=memory, expected="an array of numbers")
            arrays[f"python {lane}"] = array
        about = self._about() | {"single": self.single, "measured": self.measured}
        room = io.BytesIO()
        np.savez(room, about=np.array(json.dumps(about)), **arrays)  # type: ignore[arg-type]
        with whole_file(Path(path), (ENDING,)) as temporary:
            temporary.write_bytes(room.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LoopState:
        """A state that `save` wrote.

        Raises:
            RunError: no such file, or another one.
        """
        try:
            _check_declared(path)
            with np.load(path, allow_pickle=False) as archive:
                about = json.loads(str(archive["about"]))
                arrays: dict[str, dict[str, np.ndarray]] = {"block": {}, "ring": {}, "python": {}}
                for name in archive.files:
                    kind, _, key = name.partition(" ")
                    if key:
                        arrays[kind][key] = archive[name]
            python = {int(lane): memory for lane, memory in arrays["python"].items()}
            state = cls(**about, blocks=arrays["block"], rings=arrays["ring"], python=python)
            state.check()
        except OSError as error:
            raise RunError(f"cannot be read: {error.strerror or error}", file=path) from None
        except UNREADABLE:
            raise RunError(file=path, expected="the state of a simulation, as LoopState.save writes it") from None
        return state

    def _about(self) -> dict[str, Any]:
        return {"tick": self.tick, "period": self.period, "entries": self.entries, "controller": self.controller}

    def check(self) -> None:
        """Refuses a state, read from a file, whose parts do not fit together.

        Raises:
            ValueError: says what does not fit.
        """
        if not isinstance(self.tick, int) or not 0 <= self.tick < MOST_TICKS:
            raise ValueError(f"tick {self.tick!r}")
        if not isinstance(self.period, float) or not 0.0 < self.period < np.inf:
            raise ValueError(f"period {self.period!r}")
        if not isinstance(self.controller, str) or not all(isinstance(name, str) for name in self.entries):
            raise ValueError("names that are no texts")
        widths = {"x": len(self.entries), "frozen": 1}
        for kind, parts, dims in (("block", self.blocks, 2), ("ring", self.rings, 3)):
            for name, values in parts.items():
                if values.dtype.kind != "f" or values.ndim != dims or len(values) != self.lanes or not self.lanes:
                    raise ValueError(f"{kind} {name!r} of {values.dtype} {values.shape}")
        for name, width in widths.items():
            if self.blocks[name].shape[1] != width:
                raise ValueError(f"block {name!r} of {self.blocks[name].shape}")
        if not np.isfinite(self.blocks["x"][self.blocks["frozen"][:, 0] < 0.0]).all():
            raise ValueError("positions and speeds that are not finite")

    def attach(self, run: xarray.Dataset) -> None:
        """Adds the state to the run that ended in it, from where another one may start.

        A run gets none if its controller remembers something else than numbers.
        """
        arrays = [("block", name, values) for name, values in self.blocks.items()]
        arrays += [("ring", name, values) for name, values in self.rings.items()]
        if self.python:
            memories = [np.asarray(memory) for memory in self.python.values()]
            if any(memory.dtype.kind not in "iuf" for memory in memories) or len(memories) != self.lanes:
                return
            arrays.append(("python", "", np.array(memories, dtype=float)))
        parts = [(kind, name, list(values.shape[1:])) for kind, name, values in arrays]
        rows = np.concatenate([values.reshape(self.lanes, -1) for _, _, values in arrays], axis=1)
        about = self._about() | {"parts": parts}
        dims = ("state_entry",) if self.single else ("lane", "state_entry")
        about = json.dumps(about)
        attributes: dict[str, Any] = {"long_name": "state of the loop at the end of the run", "layout": about}
        attributes[LOOP_END] = float(run["time"].values[-1])
        run[LOOP_STATE] = (dims, rows[0] if self.single else rows, attributes)

    @classmethod
    def of_run(cls, run: xarray.Dataset) -> LoopState | None:
        """The state in which a run ended; None of a run without one.

        Raises:
            ScenarioError: a state that cannot be read, or a run without its last row.
        """
        if LOOP_STATE not in run:
            return None
        try:
            times, end = np.atleast_1d(run["time"].values), run[LOOP_STATE].attrs[LOOP_END]
            if not times.size or times[-1] != end:
                what = f"part of a run, {f'to t = {times[-1]:g} s' if times.size else 'without rows'}"
                raise ScenarioError(what, place="start", expected=f"it with its end at t = {end:g} s")
            about = json.loads(run[LOOP_STATE].attrs["layout"])
            rows, parts = np.atleast_2d(run[LOOP_STATE].values), about.pop("parts")
            ends = np.cumsum([int(np.prod(shape)) for _, _, shape in parts])
            arrays: dict[str, dict[str, np.ndarray]] = {"block": {}, "ring": {}, "python": {}}
            for (kind, name, shape), values in zip(parts, np.split(rows, ends[:-1], axis=1), strict=True):
                arrays[kind][name] = values.reshape(len(rows), *shape)
            python = dict(enumerate(arrays["python"].get("", [])))
            single = "lane" not in run[LOOP_STATE].dims
            state = cls(**about, single=single, blocks=arrays["block"], rings=arrays["ring"], python=python)
            state.check()
            return state
        except UNREADABLE as error:
            raise ScenarioError(f"the run's {LOOP_STATE} cannot be read: {error}", place="start") from None


def state_to_continue(start: Any, arm: Model, period: float, field: str, *, brakes: bool) -> LoopState:
    """The state of a run or a loop, for another loop to go on from; brakes on one side alone begin unbent, or are left out.

    Args:
        start: a run, or a state.   arm: of the other loop.   period: [s] of its ticks.   field: of the scenario that says it.
        brakes: true where they take part.
    Raises:
        ScenarioError: no state, one of another plant or another period, or one of a lane that did not come to its end.
    """
    import xarray

    state = start
    if isinstance(start, xarray.Dataset):
        try:
            check_run(start)
        except RunError as error:
            raise ScenarioError.of(*error.problems).within("start") from None
        joints = [str(name) for name in np.atleast_1d(start["joint"].values)]
        if list(joints) != list(arm.names):
            expected = f"a run of {', '.join(arm.names)}"
            raise ScenarioError("of other joints", place="start", value=joints, expected=expected)
        state = LoopState.of_run(start)
        if state is None:
            expected = "a run, as simulate returns with Recording(what='all')"
            raise ScenarioError("a dataset without loop_state", place="start", expected=expected)
    if not isinstance(state, LoopState):
        raise ScenarioError(place="start", value=start, expected="a run, or the state of a Simulation")
    expected = Plant.of(arm, brakes=brakes).layout.entry_names(arm.names)
    strange = [name for name in set(state.entries) ^ set(expected) if not name.startswith(BRAKE)]
    if strange:
        what = f"a state {'without' if min(strange) in expected else 'with'} {min(strange)!r}"
        raise ScenarioError(what, place="start", expected=f"the {len(expected)} numbers of {arm.name} with its drives")
    if state.entries != expected:
        columns = dict(zip(state.entries, state.blocks["x"].T, strict=True))
        x = np.array([columns.get(name, np.zeros(state.lanes)) for name in expected]).T
        state = replace(state, entries=expected, blocks={**state.blocks, "x": x})
    if abs(state.period - period) > 1e-9 * period:
        what = f"the state to go on from has another, {state.period:g} s"
        expected = f"{field} = {state.period:g} s, or a run that starts from positions and speeds"
        raise ScenarioError(what, place=field, value=period, expected=expected)
    frozen = state.blocks["frozen"][:, 0] >= 0.0
    if frozen.any():
        lane = int(np.argmax(frozen))
        what = f"lane {lane} stopped at t = {state.blocks['frozen'][lane, 0] * state.period:g} s"
        raise ScenarioError(what, place="start", expected="lanes that came to their end")
    return state


def _check_declared(path: str | os.PathLike[str]) -> None:
    """Refuses an archive that unpacks to more than any state has.

    Raises:
        ValueError: it does.
    """
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > LARGEST:
            raise ValueError(f"more than {LARGEST} bytes")


def _read_only(values: np.ndarray) -> np.ndarray:
    """The array as one that cannot be written to."""
    view = np.asarray(values).view()
    view.flags.writeable = False
    return view
