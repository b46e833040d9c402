"""What a controlled run leaves: what was recorded, what follows from it, and what reducers came to, as one dataset."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.model import Model
from armwright.simulation.groups import Reached
from armwright.simulation.law import measurement_of, reference_of
from armwright.simulation.recording import bare_dataset, joint_units, make_dataset
from armwright.simulation.reducers import Ends, reducer
from armwright.simulation.references import reference_notes
from armwright.simulation.stepping import Account

if TYPE_CHECKING:
    import xarray

    from armwright.simulation.controlled import ControlledRun

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
    "winding_temperature": ("°C", "temperature of the motor's winding"),
    "housing_temperature": ("°C", "temperature of the motor's housing"),
    "bus_voltage": ("V", "voltage of the supply's bus"),
}
WHOLE = ("bus_voltage",)  # of the whole arm, not of a joint
USUAL = ("qdd", "tau", "voltage", "current")  # what is recorded of every arm


def controlled_dataset(
    run: ControlledRun, record: np.ndarray | None, every: int, account: Account, held: np.ndarray, reached: Reached
) -> xarray.Dataset:
    """The dataset of a controlled run.

    Args:
        run: what was run.   record: (rows, lanes in whole tiles, entries), None: nothing was recorded.
        every: ticks from row to row.   account: what the lanes tell.   held: (lanes, k) by the reducers.
        reached: which lanes came how far.
    """
    scenario, arm = run.scenario, run.arm
    attrs = {
        "integrator": scenario.integrator,
        "step_s": scenario.integration_step,
        "sample_period_s": run.period,
        "controller": "compiled"
        if run.cycle.untraced is None
        else f"called in Python once a tick: {run.cycle.untraced}",
        "notes": reference_notes(arm, run.reference, run.t),
    }
    numbers = None if scenario.lanes is None else reached.lanes
    if record is None:
        dataset = bare_dataset(arm, attrs, None if numbers is None else len(numbers))
    else:
        dataset = _recorded(run, record, every, reached, attrs)
    if numbers is not None and reached.stopped:
        dataset = dataset.assign_coords(lane=("lane", numbers, dataset["lane"].attrs))
    if reached.ticks == run.ticks and held.size:
        _reduced(run, dataset, account, held, reached.lanes)
    account.of_lanes(reached.lanes).tell(dataset, run.period, scenario.adaptivity, scenario.lanes is None)
    return dataset


def _recorded(
    run: ControlledRun, record: np.ndarray, every: int, reached: Reached, attrs: dict[str, Any]
) -> xarray.Dataset:
    """Rows of the lanes that came that far, with what follows from them."""
    scenario, arm, n = run.scenario, run.arm, run.arm.n
    there = reached.rows(every, len(record))
    t, rows = run.t[::every][there], record[there, : run.count]
    rows = (rows[:, reached.lanes] if reached.stopped else rows).transpose(1, 0, 2)
    ends = np.cumsum(list(run.recorded.values()))[:-1]
    parts = dict(zip(run.recorded, np.split(rows, ends, axis=2), strict=True))
    x, more = parts["x"], {}
    if scenario.record == "all":
        parameters = scenario.parameters if len(scenario.parameters) == 1 else scenario.parameters[reached.lanes]
        wrench = [parts["wrench"]] if "wrench" in parts else []
        given = [x, parts["u"], *wrench, *([parameters[:, None, :]] if scenario.varied is not None else [])]
        assert run.outputs is not None
        more = dict(zip(run.output_names, run.outputs(*given, threads=os.cpu_count() or 1), strict=True))
    u = parts.get("u", np.full((len(rows), len(t), n), np.nan))
    q, qd = run.plant.part(x, "q"), run.plant.part(x, "qd")
    squeeze = (lambda v: v[0]) if scenario.lanes is None else (lambda v: v)
    known = {name: squeeze(more.pop(name)) for name in USUAL if name in more}
    dataset = make_dataset(arm, t, squeeze(q), squeeze(qd), squeeze(u), **known, attrs=attrs)
    extra = dict(more)
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


def _reduced(
    run: ControlledRun, dataset: xarray.Dataset, account: Account, held: np.ndarray, lanes: np.ndarray
) -> None:
    """Adds what the reducers came to, (lane, joint) or (joint,) each."""
    n = run.arm.n
    held = held if len(lanes) == len(held) else held[lanes]
    start = run.scenario.initial_state
    first = run.plant.part(run.plant.initial(start[:, :n], start[:, n:]), "q")
    first = first if len(lanes) == len(first) else first[lanes]
    ends = Ends(held[:, -1:], run.period, first, run.reference[-1, :n], account.frozen[lanes][:, None] >= 0.0)
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
