"""Reducers: results of a run computed in the compiled loop, without storing the motion, for millions of lanes.

Each reducer updates some numbers a joint with every recorded row of its lane, k = 0, 1, …, and ends as one number a joint:

    rms_error         √( Σ (q - r)² / rows )              peak_error         max |q - r|
    peak_voltage      max |V|                             peak_current       max |i|
    peak_torque       max |tau|                           peak_temperature   max of the winding's
    energy            Σ P T, P the electrical power       saturation         share of rows in which the drive did less
    settling_time     when q came within the band about the last reference and stayed; a share of the step, 0.02
    overshoot         how far q went past the last reference, as a share of the step

A lane that diverges is followed until then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.program import Program, kept, trace
from armwright.scalar import Array, Scalar

CLIPPED = 1e-9  # of a command: less is no clipping
BAND = 0.02  # of the step, if a settling time says nothing else


@dataclass(frozen=True, eq=False)
class RunRow:
    """A recorded row for a reducer: arrays (n,); `first` is the initial position, `final` the last reference."""

    tick: Scalar
    q: Array
    r: Array
    u: Array
    first: Array
    final: Array
    outputs: Mapping[str, Array]  # of the plant
    applied: Array


@dataclass(frozen=True, eq=False)
class Ends:
    """End of a run: rows that each lane was followed (lanes, 1), the period [s], first and final position (lanes or 1, n)."""

    rows: np.ndarray
    period: float
    first: np.ndarray
    final: np.ndarray
    diverged: np.ndarray  # (lanes, 1)


@dataclass(frozen=True, eq=False)
class Reducer:
    """A result for each joint, updated row by row.

    Attributes:
        about: its meaning.   unit: a quantity of `joint_units`, or a unit.   needs: the plant's output that it uses.
        begin: initial values, each for all joints.
        follow: (memory, row) → memory, each (values, n).   end: (memory (lanes, values, n), ends) → (lanes, n).
    """

    about: str
    unit: str
    needs: str | None
    begin: tuple[float, ...]
    follow: Callable[[Array, RunRow], Sequence[Array]]
    end: Callable[[np.ndarray, Ends], np.ndarray]


def _peak(about: str, unit: str, needs: str | None, value: Callable[[RunRow], Array], least: float = 0.0) -> Reducer:
    return Reducer(
        about, unit, needs, (least,),
        lambda memory, row: [scalar.maximum(memory[0], value(row))], lambda memory, ends: memory[:, 0],
    )  # fmt: skip


def _peak_output(name: str, about: str, unit: str) -> Reducer:
    return _peak(about, unit, name, lambda row: scalar.abs(row.outputs[name]))


def _power(row: RunRow) -> Array:
    known = row.outputs
    return known["electrical_power"] if "electrical_power" in known else known["voltage"] * known["current"]


def _clipped(row: RunRow) -> Array:
    least = CLIPPED * scalar.maximum(scalar.abs(row.applied), scalar.abs(row.u))
    return scalar.less(least, scalar.abs(row.applied - row.u))


def _settling(band: float) -> Reducer:
    def follow(memory: Array, row: RunRow) -> Sequence[Array]:
        outside = scalar.less(band * scalar.abs(row.final - row.first), scalar.abs(row.q - row.final))
        return [scalar.where(outside, row.tick, memory[0])]

    def end(memory: np.ndarray, ends: Ends) -> np.ndarray:
        settled = (memory[:, 0] + 1.0 < ends.rows) & ~ends.diverged & (ends.final != ends.first)
        return np.where(settled, (memory[:, 0] + 1.0) * ends.period, np.nan)

    about = f"time from which the position stays within {100 * band:g} % of the step"
    return Reducer(about, "s", None, (-1.0,), follow, end)


def _past(row: RunRow) -> Array:
    return (row.q - row.final) * scalar.sign(row.final - row.first)


def _overshoot(memory: np.ndarray, ends: Ends) -> np.ndarray:
    step = np.abs(ends.final - ends.first)
    return np.divide(memory[:, 0], step, out=np.full(memory[:, 0].shape, np.nan), where=step > 0.0)


REDUCERS: dict[str, Reducer] = {
    "rms_error": Reducer(
        "root mean square of the tracking error", "q", None, (0.0,),
        lambda memory, row: [memory[0] + (row.q - row.r) * (row.q - row.r)],
        lambda memory, ends: np.sqrt(memory[:, 0] / ends.rows),
    ),
    "peak_error": _peak("largest tracking error", "q", None, lambda row: scalar.abs(row.q - row.r)),
    "peak_voltage": _peak_output("voltage", "largest motor voltage", "voltage"),
    "peak_current": _peak_output("current", "largest motor current", "current"),
    "peak_torque": _peak_output("tau", "largest motor torque", "tau"),
    "peak_temperature": _peak(
        "highest winding temperature", "°C", "winding_temperature", lambda row: row.outputs["winding_temperature"], -273.15
    ),
    "energy": Reducer(  # of every row but the last, which no period follows: its power waits for the next row
        "electrical energy into the motors", "J", "voltage", (0.0, 0.0),
        lambda memory, row: [memory[0] + memory[1], _power(row)],
        lambda memory, ends: ends.period * memory[:, 0],
    ),
    "saturation": Reducer(
        "share of the rows in which limits kept the drive from its command", "1", None, (0.0,),
        lambda memory, row: [memory[0] + _clipped(row)],
        lambda memory, ends: memory[:, 0] / ends.rows,
    ),
    "settling_time": _settling(BAND),
    "overshoot": Reducer(
        "overshoot, as a share of the step", "1", None, (0.0,),
        lambda memory, row: [scalar.maximum(memory[0], _past(row))], _overshoot,
    ),
}  # fmt: skip


def reducer(name: str) -> Reducer:
    """A reducer by its name: one of `REDUCERS`, or "settling_time:band=0.05".

    Raises:
        ScenarioError: an unknown name, or a band that is none; names the nearest ones.
    """
    if not isinstance(name, str):
        raise ScenarioError(place="reduce", value=name, expected="names, such as 'rms_error'")
    plain, colon, option = name.partition(":")
    if colon and plain == "settling_time" and option.startswith("band="):
        try:
            band = float(option.removeprefix("band="))
        except ValueError:
            band = np.nan
        if not 0.0 < band < 1.0:
            raise ScenarioError(place="reduce", value=name, expected="a band between 0 and 1, a share of the step")
        return _settling(band)
    if colon or name not in REDUCERS:
        raise ScenarioError("unknown", place="reduce", value=name, choices=REDUCERS)
    return REDUCERS[name]


@dataclass(frozen=True, eq=False)
class Reduction:
    """Several reducers side by side in one block: for each its values (values, n), then the number of rows.

    Attributes:
        reducers: by name.   n: joints.
    """

    reducers: dict[str, Reducer]
    n: int

    @classmethod
    def of(cls, names: Sequence[str], n: int) -> Reduction:
        """Those with the names."""
        return cls({name: reducer(name) for name in names}, n)

    @property
    def size(self) -> int:
        """Numbers a lane."""
        return self.n * sum(len(each.begin) for each in self.reducers.values()) + 1

    def begin(self) -> np.ndarray:
        """(size,) before the first row."""
        values = [np.full(self.n, value) for each in self.reducers.values() for value in each.begin]
        return np.concatenate([*values, [0.0]])

    def program(self, config: Any) -> Program:
        """One row as a program over blocks; config: a `LoopConfig` with a reference."""
        layout = tuple((signal.name, signal.shape) for signal in config.reference.layout)
        return kept(("reduce", config.structure, tuple(self.reducers), layout), lambda: self._program(config))

    def _program(self, config: Any) -> Program:
        n, state, layout = self.n, config.bare.size, config.reference.layout

        def follow(
            tick: Array,
            x: Array,
            u: Array,
            r: Array,
            frozen: Array,
            first: Array,
            final: Array,
            memory: Array,
            *rest: Array,
        ) -> Array:
            values = dict(zip(config.plant_blocks, rest, strict=True))
            plant = config.plant(values)
            inputs = config.plant_inputs(u, values)
            outputs = plant.outputs(x, inputs)
            row = RunRow(
                tick[0], plant.part(x, "q"), layout.part(r, "q"), u, first, final, outputs, plant.applied(x, inputs)
            )
            values, start = [], 0
            for each in self.reducers.values():
                stop = start + n * len(each.begin)
                values += list(each.follow(memory[start:stop].reshape(-1, n), row))
                start = stop
            following = np.concatenate([*values, [memory[-1] + 1.0]])
            alive = scalar.less(frozen[0], 0.0)
            return scalar.array([scalar.where(alive, new, old) for new, old in zip(following, memory, strict=True)])

        shapes = {
            "tick": (1,),
            "x": (state,),
            "u": (n,),
            "r": (layout.size,),
            "frozen": (1,),
            "q_first": (n,),
            "r_final": (n,),
        }
        return trace("reduce", follow, {**shapes, "reduced": (self.size,), **config.plant_blocks}, ("reduced_next",))

    def results(self, memory: np.ndarray, ends: Ends) -> dict[str, np.ndarray]:
        """By name (lanes, n), from the block at the end (lanes, size)."""
        values, start = {}, 0
        for name, each in self.reducers.items():
            stop = start + self.n * len(each.begin)
            values[name] = each.end(memory[:, start:stop].reshape(len(memory), -1, self.n), ends)
            start = stop
        return values


def check_known(reduction: Reduction, arm: Model, outputs: Mapping[str, Any]) -> None:
    """Refuses reducers of an output that the robot file gives for no joint.

    Args:
        reduction: that is asked for.   arm: the model.   outputs: of its plant, (n,) numbers.
    Raises:
        ScenarioError: names the reducer.
    """
    for name, each in reduction.reducers.items():
        if each.needs is not None and np.isnan(np.asarray(outputs.get(each.needs, np.nan), dtype=float)).all():
            what = f"the file of {arm.name} gives no joint's {each.needs.replace('_', ' ')}"
            raise ScenarioError(what, place="reduce", value=name)
