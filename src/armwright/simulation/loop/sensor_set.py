"""The sensors of a loop, measuring together: layout, memories and random numbers of all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.interfaces import Measurement, Sensor, called
from armwright.model import Model
from armwright.model.joint_signals import joint_signal
from armwright.parameters import LaneFields
from armwright.scalar import Array
from armwright.signals import Layout
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.view import PlantView


@dataclass(frozen=True, eq=False)
class SensorSet:
    """All sensors of a loop, measuring at once.

    Attributes:
        sensors: those of the joints first, of one lane.   lanes: the same with their fields that vary.   arm: the model.
        layout: of what they measure; `y` is this and, behind it, what the drives applied.
        draws: random numbers that each takes.   memories: entries that each remembers.
    """

    sensors: tuple[Sensor, ...]
    lanes: tuple[LaneFields, ...]
    arm: Model
    layout: Layout
    draws: tuple[int, ...]
    memories: tuple[int, ...]

    @classmethod
    def of(cls, plant: Plant, sensors: tuple[Sensor, ...], *, wrench: bool = False) -> SensorSet:
        """The sensors of a plant; wrench: true where one acts on its tip.

        Raises:
            ShapeError: two signals of one name; names it.
        """
        arm, n = plant.model, plant.model.n
        draws = tuple(_draws(sensor, arm) for sensor in sensors)
        lanes = tuple(LaneFields.of(sensor, "loop.sensors") for sensor in sensors)
        sensors = tuple(each.with_values(each.values[0]) for each in lanes)
        layout = Layout.of(signal for sensor in sensors for signal in sensor.signals(arm))
        inputs = PlantInputs(np.zeros(n), np.zeros(6) if wrench else None)
        view = PlantView(plant, plant.initial(np.zeros(n), np.zeros(n)), inputs, 1.0)
        return cls(sensors, lanes, arm, layout, draws, tuple(len(_memory(sensor, view)) for sensor in sensors))

    @property
    def values(self) -> np.ndarray:
        """(lanes or 1, k) values of the sensors' fields that vary, side by side."""
        rows = max(len(each.values) for each in self.lanes)
        columns = [np.broadcast_to(each.values, (rows, each.values.shape[1])) for each in self.lanes]
        return np.concatenate(columns, axis=1)

    def of_lane(self, c: Array) -> SensorSet:
        """The sensors of a lane, with its values c (k,)."""
        ends = np.cumsum([each.values.shape[1] for each in self.lanes])
        parts = zip(self.lanes, np.split(c, ends[:-1]), strict=True)
        return replace(self, sensors=tuple(each.with_values(part) for each, part in parts))

    @property
    def y(self) -> Layout:
        """Layout of what a controller sees."""
        return self.layout + Layout((joint_signal(self.arm, "applied", "u", "what the drives did"),))

    def memory(self, view: PlantView) -> np.ndarray:
        """Concatenated memories before the first tick."""
        parts = [_memory(sensor, view) for sensor in self.sensors]
        return scalar.array(np.concatenate(parts)) if parts else np.zeros(0)

    def measure(self, view: PlantView, memory: Array, w: Array) -> tuple[np.ndarray, np.ndarray]:
        """One measurement of all of them.

        Args:
            view: the plant.   memory: as they remember.   w: (draws,) uniform in (0, 1).
        Returns:
            values: as `layout`.   memory: for the next time.
        Raises:
            ScenarioError: a sensor that gives other signals than those it names, or remembers another number of values.
        """
        measured, following, at, draw = {}, [], 0, 0
        for sensor, size, taken in zip(self.sensors, self.memories, self.draws, strict=True):
            values, kept = sensor.measure(view, memory[at : at + size], w[draw : draw + taken])
            kept, at, draw = scalar.array(kept), at + size, draw + taken
            names = [signal.name for signal in sensor.signals(self.arm)]
            if sorted(values) != sorted(names) or kept.shape != (size,):
                what = f"measure returned {', '.join(values)} and a memory of shape {kept.shape}"
                expected = f"{', '.join(names)} and ({size},)"
                raise ScenarioError(what, place=f"loop.sensors {called(sensor)!r}", expected=expected)
            for name in names:
                shape = np.shape(values[name])
                if shape != self.layout[name].shape:
                    place, expected = f"loop.sensors {called(sensor)!r}", str(self.layout[name].shape)
                    raise ScenarioError(f"{name} has shape {shape}", place=place, expected=expected)
            measured |= values
            following.append(kept)
        kept = scalar.array(np.concatenate(following)) if following else np.zeros(0)
        return self.layout.vector(measured), kept

    def without_noise(self) -> SensorSet:
        """The sensors, each replaced by its `exact()` if it has that method."""
        exact = tuple(sensor.exact() if hasattr(sensor, "exact") else sensor for sensor in self.sensors)  # type: ignore[attr-defined]
        draws = tuple(_draws(sensor, self.arm) for sensor in exact)
        return replace(self, sensors=exact, draws=draws)


def _draws(sensor: Sensor, arm: Model) -> int:
    return int(sensor.draws(arm)) if hasattr(sensor, "draws") else 0  # type: ignore[attr-defined]


def _memory(sensor: Sensor, view: PlantView) -> np.ndarray:
    return scalar.array(np.ravel(sensor.init(view))) if hasattr(sensor, "init") else np.zeros(0)  # type: ignore[attr-defined]


def measurement_of(layout: Layout, y: Array) -> Measurement:
    """A measurement from vectors y (…, size) of a layout."""
    parts = layout.parts(y)
    joints = {name: parts.pop(name) for name in ("q", "qd", "current", "applied")}
    return Measurement(**joints, further=parts)
