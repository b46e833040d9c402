"""What a run leaves: what was recorded, what follows from it, and what reducers came to, as one dataset."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.model import Model
from armwright.simulation.acting.landing import held_values
from armwright.simulation.acting.references import reference_notes
from armwright.simulation.compiled import USUAL
from armwright.simulation.groups import Reached
from armwright.simulation.integration.stepping import Account
from armwright.simulation.results.notes import limit_notes
from armwright.simulation.results.recording import bare_dataset, joint_units, make_dataset
from armwright.simulation.results.reducers import Ends, reducer
from armwright.simulation.sampling.law import measurement_of, reference_of

if TYPE_CHECKING:
    import xarray

    from armwright.simulation.scenario_run import ScenarioRun

MORE = {  # what else is recorded: whose unit it has, and what it is
    "q_measured": ("q", "measured position"),
    "qd_measured": ("qd", "measured velocity"),
    "q_reference": ("q", "reference position"),
    "qd_reference": ("qd", "reference velocity"),
    "u_issued": ("u", "command as it left the controller"),
    "tau_link": ("tau", "torque behind the gear, as a joint torque sensor reads it"),
    "heat": ("W", "heat in the motor's winding"),
    "friction_loss": ("W", "power that rubs and damps away"),
    "electrical_power": ("W", "electrical power into the drive"),
    "motor_q": ("rad", "position of the motor behind its elastic gear"),
    "motor_qd": ("rad/s", "velocity of the motor behind its elastic gear"),
    "bristle": ("q", "deflection of the bristles"),
    "brake": ("q", "how far the brake gave way"),
    "winding_temperature": ("°C", "temperature of the motor's winding"),
    "housing_temperature": ("°C", "temperature of the motor's housing"),
    "bus_voltage": ("V", "voltage of the supply's bus"),
}
WHOLE = ("bus_voltage",)  # of the whole arm, not of a joint


def run_dataset(
    run: ScenarioRun, record: np.ndarray | None, every: int, account: Account, held: np.ndarray, reached: Reached
) -> xarray.Dataset:
    """The dataset of a run.

    Args:
        run: what was run.   record: (rows, lanes in whole tiles, entries), None: nothing was recorded.
        every: ticks from row to row.   account: what the lanes tell.   held: (lanes, k) by the reducers.
        reached: which lanes came how far.
    """
    scenario, arm = run.scenario, run.arm
    attrs: dict[str, Any] = {"integrator": scenario.integrator, "step_s": scenario.integration_step}
    if run.law is not None:
        attrs["sample_period_s"] = run.period
        why = run.untraced
        attrs["controller"] = "compiled" if why is None else f"called in Python once a tick: {why}"
        attrs |= {name: values for name, values in run.ending.items() if values.size}
    notes = list(run.notes)
    if run.reference is not None:
        notes += reference_notes(arm, run.reference, np.arange(run.ticks + 1) * run.period)
    numbers = None if scenario.lanes is None else reached.lanes
    if record is None:
        dataset = bare_dataset(arm, attrs | {"notes": notes}, None if numbers is None else len(numbers))
    else:
        dataset = _recorded(run, record, every, reached, attrs, notes)
    if numbers is not None and reached.stopped:
        dataset = dataset.assign_coords(lane=("lane", numbers, dataset["lane"].attrs))
    if reached.ticks == run.ticks and run.reduction is not None:
        _reduced(run, dataset, account, held, reached.lanes)
    account.of_lanes(reached.lanes).tell(dataset, run.period, scenario.adaptivity, scenario.lanes is None)
    return dataset


def _recorded(
    run: ScenarioRun, record: np.ndarray, every: int, reached: Reached, attrs: dict[str, Any], notes: list[str]
) -> xarray.Dataset:
    """Rows of the lanes that came that far, with what follows from them."""
    scenario, arm, n = run.scenario, run.arm, run.arm.n

    def own(values: np.ndarray) -> np.ndarray:
        return values[reached.lanes] if reached.stopped and len(values) > 1 else values

    there = reached.rows(every, len(record))
    ticks = np.arange(len(record))[there] * every
    t, rows = ticks * run.period, own(record[there, : run.count].transpose(1, 0, 2))
    sizes = run.parts.recorded
    parts = dict(zip(sizes, np.split(rows, np.cumsum(list(sizes.values()))[:-1], axis=2), strict=True))
    x = parts["x"]
    acting = {name: own(held_values(held, ticks, run.period)) for name, held in run.held.items() if name != "r"}
    u = parts.get("u", acting.pop("u", np.full((1, 1, n), np.nan)))
    u = np.broadcast_to(u, (len(rows), len(t), n))
    outputs: dict[str, np.ndarray] = {}
    if scenario.record == "all":
        given = [x, u, *(acting[name] for name in run.parts.inputs)]
        given += [own(scenario.parameters)[:, None, :]] if scenario.varied is not None else []
        kernel = run.simulator.outputs
        assert kernel is not None
        outputs = dict(zip(run.simulator.names, kernel(*given, threads=os.cpu_count() or 1), strict=True))
    squeeze = (lambda v: v[0]) if scenario.lanes is None else (lambda v: v)
    q, qd = run.plant.part(x, "q"), run.plant.part(x, "qd")
    attrs["notes"] = [*notes, *limit_notes(arm, q, qd, u, outputs, t)]
    known = {name: squeeze(values) for name, values in outputs.items() if name in USUAL}
    dataset = make_dataset(arm, t, squeeze(q), squeeze(qd), squeeze(u), **known, attrs=attrs)
    extra = {name: values for name, values in outputs.items() if name not in USUAL}
    if "y" in parts:
        y, r = measurement_of(parts["y"], n), reference_of(parts["r"], n)
        extra |= {"q_measured": y.q, "qd_measured": y.qd, "q_reference": r.q, "qd_reference": r.qd}
        extra["u_issued"] = parts["u_issued"]
    for name, values in extra.items():
        add_output(dataset, arm, name, squeeze(values))
    return dataset


def add_output(dataset: xarray.Dataset, arm: Model, name: str, values: np.ndarray) -> None:
    """Adds what the plant tells beside the usual: (…, n) one a joint, or (…, 1) of the whole arm."""
    quantity, about = MORE[name]
    attributes = {"units": _unit(arm, quantity), "long_name": about}
    dims = dataset["q"].dims
    if name in WHOLE:
        dims, values = dims[:-1], values[..., 0]
    dataset[name] = (dims, values, attributes)


def _reduced(run: ScenarioRun, dataset: xarray.Dataset, account: Account, held: np.ndarray, lanes: np.ndarray) -> None:
    """Adds what the reducers came to, (lane, joint) or (joint,) each."""
    assert run.reduction is not None
    first = run.scenario.initial_state[:, : run.arm.n]
    held, first, final = (v if len(v) in (1, len(lanes)) else v[lanes] for v in (held, first, run.final))
    ends = Ends(held[:, -1:], run.period, first, final, account.frozen[lanes][:, None] >= 0.0)
    for name, values in run.reduction.results(held, ends).items():
        about = reducer(name)
        attributes = {"units": _unit(run.arm, about.unit), "long_name": about.about}
        single = run.scenario.lanes is None
        dataset[name] = (("joint",), values[0], attributes) if single else (("lane", "joint"), values, attributes)


def _unit(arm: Model, quantity: str) -> str:
    """The units of a quantity that occur, or a unit as it is."""
    if quantity in ("q", "qd", "qdd", "tau", "voltage", "current", "u"):
        return " | ".join(dict.fromkeys(joint_units(arm, quantity)))
    return quantity
