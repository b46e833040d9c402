"""What a page draws of runs: panels with curves, named, with units, and the numbers themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from armwright.errors import RunError, nearest
from armwright.pictures.page import Numbers
from armwright.simulation.results.plot import BAND, COLOURS, FEW_LANES, HELD, panels
from armwright.simulation.results.plot import TITLES as RUN_TITLES
from armwright.simulation.results.recording import in_order, run_units
from armwright.simulation.results.spoken import PARTIAL, QUANTITIES, joint_names, variables

if TYPE_CHECKING:
    import xarray as xr

SYMBOLS = {
    "q": "q", "qd": "q̇", "qdd": "q̈", "tau": "τ", "voltage": "V", "current": "i", "u": "u", "tau_link": "τ", "heat": "P",
    "friction_loss": "P", "electrical_power": "P", "winding_temperature": "T", "housing_temperature": "T",
}  # fmt: skip
PLACE = "place"  # coordinate of a part of a run: which of the arm's joints each is, as its colour says
TITLES = RUN_TITLES | {"qdd": ("Joint accelerations", "Joint accelerations")}
EVEN = 1e-9  # of a step: times that are this near to steady ones are written as start and step


def selected(
    runs: Mapping[str, xr.Dataset], joints: Sequence[str] | None = None, quantities: Sequence[str] | None = None
) -> dict[str, xr.Dataset]:
    """The runs with those joints and quantities only, in their usual order.

    Args:
        runs: what each is called → the run.   joints: names, or numbers from 1; None: all.
        quantities: such as q, tau, as the run's variables or the session's are called; None: all.
    Returns:
        runs: what each is called → its part.
    Raises:
        RunError: no runs, no run, a joint or a quantity that it has not, runs of arms with different joints.
    """
    if not runs:
        raise RunError("no runs; expected at least one")
    found: dict[str, xr.Dataset] = {}
    wanted, quantities = joints, variables(quantities)
    for name, run in runs.items():
        run = in_order(run)
        own = [str(joint) for joint in run["joint"].values]
        joints = joint_names(wanted, own)
        for joint in joints or ():
            if joint not in own:
                raise RunError(f"{name}: no joint {joint!r}; {nearest(joint, own)}")
        known = quantities_of(run)
        for quantity in quantities or ():
            if quantity not in known:
                also = [*known, *(spoken for spoken, variable in QUANTITIES.items() if variable in known)]
                raise RunError(f"{name}: no quantity {quantity!r}; {nearest(quantity, also)}")
        if not known or not run.sizes["time"] or not own:
            raise RunError(f"{name}: holds no rows of any quantity; expected a run")
        if joints:
            run = run.isel(joint=[k for k, joint in enumerate(own) if joint in joints])
            run = run.assign_coords({PLACE: ("joint", [own.index(str(joint)) for joint in run["joint"].values])})
        kept = known if quantities is None else [quantity for quantity in known if quantity in quantities]
        found[name] = run[kept]
        first = next(iter(found))
        theirs = [str(joint) for joint in found[first]["joint"].values]
        ours = [str(joint) for joint in run["joint"].values]
        if ours != theirs:
            raise RunError(f"{name}: has joints {', '.join(ours)}; expected those of {first}: {', '.join(theirs)}")
    return found


def places(run: xr.Dataset) -> list[int]:
    """Which of its arm's joints, counted from 0, each joint of a run is, or of the part of a run that `selected` chose."""
    return [int(k) for k in run[PLACE].values] if PLACE in run.coords else list(range(run.sizes["joint"]))


def partial_note(runs: Mapping[str, xr.Dataset]) -> str:
    """Which of the runs were interrupted, in words; of one run without its name."""
    told = [(name, str(run.attrs[PARTIAL])) for name, run in runs.items() if PARTIAL in run.attrs]
    return "; ".join(f"{f'{name}: ' * (len(runs) > 1)}partial run, {how}" for name, how in told)


def quantities_of(run: xr.Dataset) -> list[str]:
    """Names of what a run has of every joint at every time."""
    return [str(name) for name, variable in run.data_vars.items() if {"time", "joint"} <= set(variable.dims)]


@dataclass(frozen=True, eq=False)
class Curve:
    """Values of one joint over the times of one run."""

    joint: int  # of the joints that are drawn
    run: int
    kind: Literal["line", "lane", "band", "reference"]  # a run alone, one of few lanes, the median of many, a reference
    values: np.ndarray  # (k,)
    low: np.ndarray | None = None  # (k,) of a band
    high: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class CurvePanel:
    """A quantity of those joints that share its unit."""

    title: str
    symbol: str
    unit: str
    held: bool  # drawn as steps: a command that is held
    curves: list[Curve] = field(default_factory=list)


def curve_panels(runs: Mapping[str, xr.Dataset], quantities: Sequence[str] | None = None) -> list[CurvePanel]:
    """Panels with their curves. A few lanes are a curve each, many their median and the band of nine out of ten.

    References of a controlled run are in the panel of what they are for, unless quantities are named.

    Args:
        runs: what each is called → the run, as `selected` returns them.
        quantities: what is drawn, in this order; None: positions, velocities, torques and what the drives were given.
    Raises:
        RunError: nothing finite to be drawn.
    """
    drawn: dict[tuple[str, str], CurvePanel] = {}
    for k, run in enumerate(runs.values()):
        for quantity in quantities or _usual(run):
            for unit, joints in _units(run, quantity).items():
                panel = drawn.setdefault((quantity, unit), _panel(run, quantity, unit, joints))
                for joint in joints:
                    panel.curves.extend(_curves(run, quantity, joint, k))
                    if quantities is None and f"{quantity}_reference" in run:
                        panel.curves.extend(_reference(run, f"{quantity}_reference", joint, k))
    panels = [panel for panel in drawn.values() if panel.curves]
    if not panels:
        raise RunError(
            f"{', '.join(runs)}: no finite number of {', '.join(quantities or ['any quantity'])} to be drawn"
        )
    return panels


def plot_data(runs: Mapping[str, xr.Dataset], quantities: Sequence[str] | None = None) -> tuple[dict[str, Any], str]:
    """What `Charts` of pages/charts.js draws, and its numbers.

    Args:
        runs, quantities: as `curve_panels`.
    Returns:
        plot: joints, colours, runs with their times, panels with their curves; arrays as places in the numbers.
        numbers: as `Numbers.text`.
    Raises:
        RunError: nothing finite to be drawn.
    """
    numbers = Numbers()

    def told(curve: Curve) -> dict[str, Any]:
        arrays = {"values": curve.values, "low": curve.low, "high": curve.high}
        places = {name: numbers.add(own) for name, own in arrays.items() if own is not None}
        return {"joint": curve.joint, "run": curve.run, "kind": curve.kind, **places}

    plot = {
        "joints": [str(joint) for joint in next(iter(runs.values()))["joint"].values],
        "places": places(next(iter(runs.values()))),
        "colours": list(COLOURS),
        "runs": [{"name": name, "time": _time(run["time"].values, numbers)} for name, run in runs.items()],
        "panels": [
            {"title": panel.title, "symbol": panel.symbol, "unit": panel.unit, "held": panel.held}
            | {"series": [told(curve) for curve in panel.curves]}
            for panel in curve_panels(runs, quantities)
        ],
    }
    return plot, numbers.text()


def _usual(run: xr.Dataset) -> list[str]:
    """What the static picture draws too; where a run has none of it, all that it has."""
    return list(dict.fromkeys(panel.quantity for panel in panels(run))) or quantities_of(run)


def _plain(quantity: str) -> str:
    """What a reference or a measurement is of."""
    return quantity.removesuffix("_reference").removesuffix("_measured").removesuffix("_issued")


def _units(run: xr.Dataset, quantity: str) -> dict[str, list[int]]:
    """Unit → the joints that have it, of those whose values are known."""
    units = run_units(run, _plain(quantity))
    values = run[quantity].values.reshape(-1, len(units))
    known = np.asarray(np.isfinite(values).any(axis=0))
    return {unit: [k for k, own in enumerate(units) if own == unit and known[k]] for unit in dict.fromkeys(units)}


def _panel(run: xr.Dataset, quantity: str, unit: str, joints: list[int]) -> CurvePanel:
    linear = "prismatic" in [str(run["kind"].values[k]) for k in joints]
    long_name = str(run[quantity].attrs.get("long_name", quantity))
    title = TITLES[quantity][1 if linear else 0] if quantity in TITLES else long_name[:1].upper() + long_name[1:]
    commands = [str(command) for command in run["command"].values]
    held = quantity in ("u", "u_issued") or (quantity in HELD and all(commands[k] == HELD[quantity] for k in joints))
    return CurvePanel(title, SYMBOLS.get(_plain(quantity), quantity), unit, held)


def _curves(run: xr.Dataset, quantity: str, joint: int, k: int) -> list[Curve]:
    lanes = _lanes(run, quantity, joint)
    if len(lanes) <= FEW_LANES:
        return [Curve(joint, k, "lane" if len(lanes) > 1 else "line", own) for own in lanes]
    known = np.isfinite(lanes).any(axis=0)  # a row that no lane knows has no quantile
    bands = np.full((3, lanes.shape[1]), np.nan)
    finite = np.where(np.isfinite(lanes), lanes, np.nan)[:, known]
    bands[:, known] = np.nanquantile(finite, (BAND[0], 0.5, BAND[1]), axis=0)
    return [Curve(joint, k, "band", bands[1], bands[0], bands[2])]


def _reference(run: xr.Dataset, name: str, joint: int, k: int) -> list[Curve]:
    """The reference that all lanes share; where each has its own, none is drawn."""
    lanes = _lanes(run, name, joint)
    shared = np.array_equal(lanes, np.broadcast_to(lanes[:1], lanes.shape), equal_nan=True)
    return [Curve(joint, k, "reference", lanes[0])] if shared and np.isfinite(lanes).any() else []


def _lanes(run: xr.Dataset, name: str, joint: int) -> np.ndarray:
    """(lanes, k)."""
    values = run[name].values
    return (values if values.ndim == 3 else values[None])[:, :, joint]


def _time(t: np.ndarray, numbers: Numbers) -> dict[str, Any]:
    """Steady times as start, step and count; others as sums of two single precision numbers."""
    t = np.asarray(t, dtype=float)
    if len(t) > 1:
        step = (t[-1] - t[0]) / (len(t) - 1)
        if np.abs(t - (t[0] + step * np.arange(len(t)))).max() <= EVEN * step + 1e-14 * np.abs(t).max():
            return {"start": float(t[0]), "step": float(step), "count": len(t)}
    high = t.astype(np.float32)
    return {"high": numbers.add(high), "low": numbers.add(t - high)}
