"""The dataset of a run: recorded rows, the signals that follow from them, and results of reducers."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.results.notes import limit_notes
from armwright.results.recording import bare_dataset, make_dataset
from armwright.results.reducers import Ends, reducer
from armwright.signals import Signal
from armwright.simulation.batch_runner import Finished
from armwright.simulation.inputs.input_schedule import values_at_ticks
from armwright.simulation.integrate.lane_status import LaneStatus
from armwright.simulation.loop.plant_programs import USUAL
from armwright.simulation.loop_runner import LoopRunner
from armwright.simulation.plant.state import BUS_VOLTAGE, SHOWN

if TYPE_CHECKING:
    import xarray


FURTHER = {  # what the plant tells beside the usual: whose unit it has, and what it is
    "tau_link": ("tau", "torque behind the gear, as a joint torque sensor reads it"),
    "heat": ("W", "heat in the motor's winding"),
    "friction_loss": ("W", "power that rubs and damps away"),
    "electrical_power": ("W", "electrical power into the drive"),
    **SHOWN,
    "bus_voltage": BUS_VOLTAGE,
}
UNSTORED = ("applied", "current", "qdd")  # measured or followed signals that other variables hold already
PART = 1 << 15  # states whose outputs are computed at once
MOTION = {"q": "position", "qd": "velocity"}
WHOLE = ("bus_voltage",)  # of the whole arm, not of a joint


@dataclass(frozen=True, eq=False)
class RecordedLanes:
    """Results of the compiled loop.

    Attributes:
        rows: (rows, lanes in whole tiles, entries); None: nothing was recorded.   every: ticks from row to row.
        ticks: of the whole run.   reached: which lanes came how far.   status: what became of them.   reduced: (lanes,
            k) by the reducers.
        origin: the tick of the first row.
    """

    rows: np.ndarray | None
    every: int
    ticks: int
    finished: Finished
    status: LaneStatus
    reduced: np.ndarray
    origin: int

    def last_row(self, simulation: LoopRunner) -> str:
        """The end of a single diverged run, in words: its state and the command."""
        if self.rows is None:
            return ""
        parts = _parts(simulation, self.rows[-1, 0])
        asked = parts.get("u_issued", np.zeros(0))
        wrong = "" if np.isfinite(asked).all() else f", where the controller commanded {_shown(asked)}"
        return f"last state q = {_shown(parts['x'][: simulation.arm.n])}{wrong}"


def _shown(values: np.ndarray) -> str:
    return np.array2string(values, precision=4, max_line_width=10**6)


def _parts(simulation: LoopRunner, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The recorded blocks by name from rows (…, entries)."""
    sizes = {name: layout.size for name, layout in simulation.config.recorded.items()}
    return dict(zip(sizes, np.split(rows, np.cumsum(list(sizes.values()))[:-1], axis=-1), strict=True))


def run_dataset(simulation: LoopRunner, recorded: RecordedLanes) -> xarray.Dataset:
    """The dataset of a run."""
    scenario, arm, finished = simulation.scenario, simulation.arm, recorded.finished
    attrs: dict[str, Any] = {"integrator": scenario.solver.rule, "step_s": simulation.step_length}
    if scenario.solver.rule == "auto":
        attrs["rule"] = "rk3" if simulation.rule == "auto" else simulation.rule
    if simulation.sampled:
        attrs["sample_period_s"] = simulation.period
        why = simulation.untraced
        attrs["controller"] = "compiled" if why is None else f"called in Python once a tick: {why}"
    notes = [*simulation.notes, *(() if simulation.reference is None else simulation.reference.notes)]
    numbers = None if scenario.lane_count is None else finished.lanes
    if recorded.rows is None:
        dataset = bare_dataset(arm, attrs | {"notes": notes}, None if numbers is None else len(numbers))
    else:
        dataset = _with_rows(simulation, recorded, recorded.rows, attrs, notes)
    if numbers is not None and (finished.stopped or scenario.first_lane):
        dataset = dataset.assign_coords(lane=("lane", numbers + scenario.first_lane, dataset["lane"].attrs))
    if finished.ticks == recorded.ticks and simulation.reduction is not None:
        _reduced(simulation, dataset, recorded)
    status = recorded.status.of_lanes(finished.lanes)
    single, entries = scenario.lane_count is None, simulation.state_entries
    status.add_to(dataset, simulation.period, scenario.solver.adaptivity, entries, single)
    return dataset


def _with_rows(
    simulation: LoopRunner, recorded: RecordedLanes, record: np.ndarray, attrs: dict[str, Any], notes: list[str]
) -> xarray.Dataset:
    """Rows of the lanes that came that far, with what follows from them."""
    scenario, arm, n, finished = simulation.scenario, simulation.arm, simulation.arm.n, recorded.finished

    def own(values: np.ndarray) -> np.ndarray:
        return values[finished.lanes] if finished.stopped and len(values) > 1 else values

    there = finished.rows(recorded.every, len(record))
    ticks = recorded.origin + np.arange(len(record))[there] * recorded.every
    t, rows = ticks * simulation.period, own(record[there, : simulation.count].transpose(1, 0, 2))
    parts = _parts(simulation, rows)
    x = parts["x"]
    needed = simulation.inputs if scenario.recording.what == "all" else {"u"} & set(simulation.inputs)
    acting = {name: own(values_at_ticks(simulation.inputs[name], ticks, simulation.period)) for name in needed}
    u = parts.get("u", acting.pop("u", np.full((1, 1, n), np.nan)))
    u = np.broadcast_to(u, (len(rows), len(t), n))
    outputs: dict[str, np.ndarray] = {}
    if scenario.recording.what == "all":
        arguments = [x, u, *(acting[name] for name in simulation.config.inputs)]
        arguments += [own(scenario.parameters)[:, None, :]] if scenario.varied is not None else []
        kernel = simulation.loop.outputs
        assert kernel is not None
        outputs = dict(zip(simulation.loop.names, _in_parts(kernel, arguments, (len(rows), len(t))), strict=True))
    squeeze = (lambda v: v[0]) if scenario.lane_count is None else (lambda v: v)
    q, qd = simulation.plant.part(x, "q"), simulation.plant.part(x, "qd")
    attrs["notes"] = [*notes, *limit_notes(arm, q, qd, u, outputs, t)]
    known = {name: squeeze(values) for name, values in outputs.items() if name in USUAL}
    dataset = make_dataset(arm, t, squeeze(q), squeeze(qd), squeeze(u), **known, attrs=attrs)
    dims = tuple(str(dim) for dim in dataset["q"].dims[:-1])
    further = {name: squeeze(values) for name, values in outputs.items() if name not in USUAL}
    variables = {name: _output(arm, name, values, dims) for name, values in further.items()}
    labels: dict[str, Any] = {}
    if "y" in parts:
        for name, signal, values in _signals(simulation, parts):
            variables[name], labels = _signal(name, signal, squeeze(values), dims, labels)
    dataset = dataset.assign(variables) if variables else dataset  # at once: xarray compares coordinates each time
    return dataset.assign_coords(labels) if labels else dataset


def _in_parts(kernel: Any, arguments: list[np.ndarray], lead: tuple[int, int]) -> list[np.ndarray]:
    """Outputs (lanes, rows, …) of a kernel, some lanes after the others: what is laid out anew for it stays in the cache."""
    lanes, rows = lead
    found = [np.empty((*lead, *port.shape), kernel.dtype) for port in kernel.program.outputs]
    size = max(1, PART // max(1, rows))
    for first in range(0, lanes, size):
        part = slice(first, first + size)
        own = [np.ascontiguousarray(each[part] if len(each) > 1 else each) for each in arguments]
        kernel(*own, out=tuple(each[part] for each in found), threads=os.cpu_count() or 1)
    return found


def _signals(simulation: LoopRunner, parts: Mapping[str, np.ndarray]) -> Iterator[tuple[str, Signal, np.ndarray]]:
    """Name, signal and values of what was measured, what was to be followed, and the commands as they left the controller."""
    config, loop = simulation.config, simulation.scenario.loop
    noisy = loop is not None and loop.joint_sensors.noisy_current  # else it is the run's current
    for block, ending in (("y", "measured"), ("r", "reference")):
        for signal in config.recorded[block]:
            if signal.name not in UNSTORED or (noisy and (block, signal.name) == ("y", "current")):
                values = config.recorded[block].part(parts[block], signal.name)
                about = signal.about if block == "y" or signal.joints is None else f"reference {MOTION[signal.name]}"
                yield f"{signal.name}_{ending}", replace(signal, about=about), values
    yield (
        "u_issued",
        replace(config.recorded["u_issued"]["u"], about="command as it left the controller"),
        parts["u_issued"],
    )


def _signal(
    name: str, signal: Signal, values: np.ndarray, dims: tuple[str, ...], labels: dict[str, Any]
) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """A signal's values (…, *shape) as a variable, and the labels of its entries beside those there are.

    Its dimension is joint, or one of its own.
    """
    attributes = {"units": signal.unit, "long_name": signal.about or name}
    if signal.joints is not None:
        return ((*dims, "joint"), values, attributes), labels
    own = [f"{name}_entry" if k + 1 == len(signal.shape) else f"{name}_entry_{k}" for k in range(len(signal.shape))]
    if signal.labels is not None and own:
        labels = {**labels, own[-1]: list(signal.labels)}
    return ((*dims, *own), values, attributes), labels


def _output(arm: Model, name: str, values: np.ndarray, dims: tuple[str, ...]) -> tuple[Any, ...]:
    """A further signal of the plant as a variable: (…, n) one per joint, or (…, 1) of the whole arm."""
    quantity, about = FURTHER[name]
    attributes = {"units": _unit(arm, quantity), "long_name": about}
    return (dims, values[..., 0], attributes) if name in WHOLE else ((*dims, "joint"), values, attributes)


def _reduced(simulation: LoopRunner, dataset: xarray.Dataset, recorded: RecordedLanes) -> None:
    """Adds what the reducers came to, (lane, joint) or (joint,) each."""
    assert simulation.reduction is not None
    assert simulation.reference is not None
    assert simulation.reference.final is not None
    lanes, scenario = recorded.finished.lanes, simulation.scenario
    first, final = scenario.initial_state[:, : simulation.arm.n], simulation.reference.final
    reduced, first, final = (v if len(v) in (1, len(lanes)) else v[lanes] for v in (recorded.reduced, first, final))
    stopped = recorded.status.frozen[lanes][:, None] >= 0.0
    ends = Ends(reduced[:, -1:], simulation.period, first, final, stopped)
    for name, values in simulation.reduction.results(reduced, ends).items():
        about = reducer(name)
        attributes = {"units": _unit(simulation.arm, about.unit), "long_name": about.about}
        single = scenario.lane_count is None
        dataset[name] = (("joint",), values[0], attributes) if single else (("lane", "joint"), values, attributes)


def _unit(arm: Model, quantity: str) -> str:
    """The units of a quantity that occur, or a unit as it is."""
    if quantity in ("q", "qd", "qdd", "tau", "voltage", "current", "u"):
        return " | ".join(dict.fromkeys(joint_units(arm, quantity)))
    return quantity
