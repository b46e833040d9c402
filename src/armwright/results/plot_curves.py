"""Description of a plot of runs: panels, curves, names, units, colours and notes, shared by all kinds of plot.

Still pictures (`plot`), pages (`plot_page`, `pictures.animate`) and the terminal (`pictures.terminal`) add nothing to it.
The colours are those of Okabe and Ito, which colour-blind readers can distinguish. [OkabeIto2008]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from armwright.entry import AnyRun, as_run
from armwright.errors import RunError, check_known
from armwright.joint_kinds import KINDS
from armwright.printable import printable
from armwright.results.aliases import PARTIAL, QUANTITIES, joint_names, variables
from armwright.results.recording import in_order, run_units

if TYPE_CHECKING:
    import xarray as xr

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
INK = COLOURS[-1]  # of what has no joint: lines that stand for a run or a reference; on dark pages it turns light
DASHES = ((), (3.7, 1.6), (1.0, 1.65), (6.4, 1.6, 1.0, 1.6))  # lengths of dashes and gaps [line widths]; (): solid
DOTTED = ((3.0, 2.0), (1.0, 1.2), (6.0, 1.5, 1.0, 1.5))  # of the references of the first run, of the second, …
PLACE = "place"  # coordinate of the joints that are drawn: the number of each in its arm
HUGE = 1e300  # larger values, of a diverging run, are not drawn: their sums and margins are infinite
FEW_LANES = 12  # more are drawn as their median and bands
BANDS = ((0.05, 0.95), (0.25, 0.75))  # quantiles: nine out of ten lanes, half of them
BAND_OPACITY = 0.16  # of each; they lie on each other
TITLES = {  # quantity → title for joints that have angles, for those that have lengths; the others have their long name
    "q": ("Joint angles", "Joint positions"),
    "qd": ("Joint velocities", "Joint velocities"),
    "qdd": ("Joint accelerations", "Joint accelerations"),
    "tau": ("Motor torques, joint side", "Motor forces, joint side"),  # of motors, referred to their joints
    "tau_link": ("Torques behind the gears, joint side", "Forces behind the gears, joint side"),
    "voltage": ("Motor voltages", "Motor voltages"),
    "current": ("Motor currents", "Motor currents"),
    "u": ("Drive commands", "Drive commands"),
}
SYMBOLS = {
    "q": "q", "qd": "q̇", "qdd": "q̈", "tau": "τ", "voltage": "V", "current": "i", "u": "u", "tau_link": "τ", "heat": "P",
    "friction_loss": "P", "electrical_power": "P", "winding_temperature": "T", "housing_temperature": "T",
}  # fmt: skip
COMMANDED = {"tau": "torque", "voltage": "voltage", "current": "current"}  # quantity → drive command that sets it
VARIANTS = ("_reference", "_measured", "_issued")  # endings of quantities that have the unit of another one


@dataclass(frozen=True)
class Style:
    """Look of a line: width in points, lengths of dashes and gaps in line widths."""

    colour: str
    dash: tuple[float, ...] = ()
    width: float = 1.6
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Curve:
    """Values of one joint over the times of one run.

    Attributes:
        joint: name.   run: number in `Plot.runs`.
        series: name among the curves of its joint: "before", "lanes", "reference of before", …; "" if alone.
        values: (k,) in the panel's unit.   bands: (low, high), each (k,), around the median of many lanes; the widest first.
    """

    joint: str
    run: int
    series: str
    style: Style
    values: np.ndarray
    bands: tuple[tuple[np.ndarray, np.ndarray], ...] = ()


@dataclass(frozen=True, eq=False)
class Panel:
    """One set of axes: a quantity of those joints that share its unit; stepped if values hold until the next row."""

    title: str
    symbol: str
    unit: str
    stepped: bool
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class LegendEntry:
    """Meaning of a colour or a dash: it stands for the curves whose attribute `group` (joint, run, series) is `value`."""

    name: str
    style: Style
    group: str
    value: str | int


@dataclass(frozen=True, eq=False)
class Plot:
    """Description of a plot.

    Attributes:
        title, note: above the panels; the note says what lanes are drawn as and which runs are partial.
        runs: names.   times: of each run, (k,) [s].
    """

    title: str
    note: str
    runs: tuple[str, ...]
    times: tuple[np.ndarray, ...]
    panels: tuple[Panel, ...]
    legend: tuple[LegendEntry, ...]


def describe(
    runs: AnyRun | Mapping[str, AnyRun] | Sequence[AnyRun],
    joints: str | Sequence[str] | None = None,
    quantities: str | Sequence[str] | None = None,
) -> Plot:
    """Description of the plot of one run, or of several beside each other.

    A colour is a joint, and it keeps that colour where only some joints are drawn; a dash pattern is a run. Where several
    runs of a single joint are drawn, a colour is a run.

    Args:
        runs: a run or its file; or name → run; or a list, whose runs are called "run 1", "run 2", …
        joints: names, or numbers from 1; None: all.
        quantities: variables of the run, or the session's names of them, drawn in this order; None: positions, velocities,
            torques and the drives' voltages or currents, with their references.
    Raises:
        RunError: no run, an unknown joint or quantity, runs of arms with different joints, nothing finite to draw.
    """
    joints, quantities = ([one] if isinstance(one, str) else one for one in (joints, quantities))
    quantities = variables(quantities)
    named = {
        name: _part(name or "run", in_order(as_run(run, name or "run")), joints, quantities)
        for name, run in _named(runs).items()
    }
    first, *others = named
    names = [str(joint) for joint in named[first]["joint"].values]  # as they are, to be compared; printable below
    for other in others:
        theirs = [str(joint) for joint in named[other]["joint"].values]
        if theirs != names:
            raise RunError(place=f"{other} joints", value=theirs, expected=f"those of {first}: {', '.join(names)}")
    shown = tuple(map(printable, named)), tuple(map(printable, names))
    drawing = _Drawing(shown[0], tuple(named.values()), shown[1])
    panels = drawing.panels(quantities)
    if not panels:
        what = ", ".join(quantities or ["any quantity"])
        raise RunError(f"no finite number of {what} to be drawn", place=", ".join(named) or "run")
    robots = ", ".join(dict.fromkeys(str(run.attrs.get("robot", "run")) for run in named.values()))
    title = printable(
        "   ·   ".join(filter(None, [robots, names[0] if drawing.by_run else "", "" if others else first]))
    )
    times = tuple(np.asarray(run["time"].values, dtype=float) for run in named.values())
    return Plot(title, printable(_note(named)), shown[0], times, panels, drawing.legend(panels))


def _named(runs: AnyRun | Mapping[str, AnyRun] | Sequence[AnyRun]) -> dict[str, AnyRun]:
    """Name → run, for each way in which runs can be passed; the name of a run passed alone is ""."""
    import xarray as xr

    if isinstance(runs, (list, tuple)):
        runs = {f"run {k}": run for k, run in enumerate(runs, 1)}
    if isinstance(runs, xr.Dataset) or not isinstance(runs, Mapping):  # a dataset is a mapping too
        return {"": runs}  # type: ignore[dict-item]
    if not runs:
        raise RunError("no runs", expected="at least one")
    return {str(name): run for name, run in runs.items()}


def _part(name: str, run: xr.Dataset, joints: Sequence[str] | None, quantities: Sequence[str] | None) -> xr.Dataset:
    """The run with those joints only; the coordinate PLACE says which of the arm's joints each is, and so its colour.

    Raises:
        RunError: it does not have one of the joints or quantities, or it has no rows.
    """
    names, known = [str(joint) for joint in run["joint"].values], _quantities_of(run)
    joints = names if joints is None else joint_names(joints, names) or names
    for joint in joints:
        check_known(RunError, joint, names, "no such joint", place=f"{name} joint")
    for quantity in quantities or ():
        if quantity not in known:
            names = [*known, *(alias for alias, variable in QUANTITIES.items() if variable in known)]
            raise RunError("no such quantity", place=f"{name} quantity", value=quantity, choices=names)
    if not known or not run.sizes["time"] or not names:
        raise RunError("holds no rows of any quantity", place=name, expected="a run")
    chosen = [k for k, joint in enumerate(names) if joint in joints]
    return run.isel(joint=chosen).assign_coords({PLACE: ("joint", chosen)})


def _quantities_of(run: xr.Dataset) -> list[str]:
    """Names of the variables that have a value for every joint at every time."""
    return [str(name) for name, variable in run.data_vars.items() if {"time", "joint"} <= set(variable.dims)]


def _usual(run: xr.Dataset) -> list[str]:
    """Positions, velocities, torques and what drives them; all quantities of a run that has none of these.

    Drives are drawn by their voltages; by voltages and currents, or currents alone, if not every motor's voltage is known;
    by their commands if torques are unknown too.
    """
    drives = [name for name in ("voltage", "current") if name in run]
    if drives and _is_known(run, drives[0]).all():
        drives = drives[:1]
    if not drives and "tau" not in run:
        drives = ["u"]
    usual = [name for name in ("q", "qd", "tau", *drives) if name in run and _is_known(run, name).any()]
    return usual or _quantities_of(run)


def _is_known(run: xr.Dataset, quantity: str) -> np.ndarray:
    """(n,) whether any value of the joint is finite."""
    values = run[quantity].transpose(..., "joint").values.reshape(-1, run.sizes["joint"])
    return np.asarray((np.abs(values) < HUGE).any(axis=0))


def _plain(quantity: str) -> str:
    """The quantity that a reference or a measurement is of: "q" of "q_measured"."""
    return next((quantity.removesuffix(ending) for ending in VARIANTS if quantity.endswith(ending)), quantity)


@dataclass(frozen=True, eq=False)
class _Drawing:
    """Runs of the same joints, with their names and those of the joints."""

    names: tuple[str, ...]
    runs: tuple[xr.Dataset, ...]
    joints: tuple[str, ...]

    @property
    def by_run(self) -> bool:
        """Several runs of a single joint, so that a colour is a run."""
        return len(self.joints) == 1 and len(self.runs) > 1

    def panels(self, quantities: Sequence[str] | None) -> tuple[Panel, ...]:
        """A panel for each quantity and unit with any finite value."""
        sharing: dict[tuple[str, str], list[tuple[int, int]]] = {}  # quantity, unit → joint and run of each curve
        for k, run in enumerate(self.runs):
            for quantity in quantities or _usual(run):
                units, known = run_units(run, _plain(quantity)), _is_known(run, quantity)
                for joint in np.flatnonzero(known):
                    sharing.setdefault((quantity, units[joint]), []).append((int(joint), k))
        return tuple(self._panel(*key, sorted(places), quantities is None) for key, places in sharing.items())

    def _panel(self, quantity: str, unit: str, places: list[tuple[int, int]], references: bool) -> Panel:
        curves = []
        for joint, k in places:
            curves += self._curves(quantity, joint, k)
            if references and f"{quantity}_reference" in self.runs[k]:
                curves += self._reference(f"{quantity}_reference", joint, k)
        joint, run = places[0][0], self.runs[places[0][1]]
        long_name = str(run[quantity].attrs.get("long_name", quantity))
        titles = TITLES.get(quantity) or 2 * (long_name[:1].upper() + long_name[1:],)
        commands = {str(self.runs[k]["command"].values[joint]) for joint, k in places}
        stepped = quantity in ("u", "u_issued") or commands == {COMMANDED.get(quantity)}
        linear = KINDS[str(run["kind"].values[joint])].units.linear
        symbol = SYMBOLS.get(_plain(quantity), quantity)
        return Panel(printable(titles[linear]), printable(symbol), printable(unit), stepped, tuple(curves))

    def _curves(self, quantity: str, joint: int, k: int) -> list[Curve]:
        lanes, style, name = self._lanes(quantity, joint, k), self._style(joint, k), self.joints[joint]
        if len(lanes) > FEW_LANES:
            middle, *edges = _quantiles(lanes, (0.5, *BANDS[0], *BANDS[1]))
            bands = tuple(zip(edges[::2], edges[1::2], strict=True))
            return [Curve(name, k, self._series("median", k), style, middle, bands)]
        if len(lanes) > 1:
            style = replace(style, width=0.8, opacity=0.7)
        return [
            Curve(name, k, self._series("lanes" if len(lanes) > 1 else "", k), style, curve_lanes)
            for curve_lanes in lanes
        ]

    def _reference(self, quantity: str, joint: int, k: int) -> list[Curve]:
        """The reference, if all lanes share it."""
        lanes = self._lanes(quantity, joint, k)
        shared = np.array_equal(lanes, np.broadcast_to(lanes[:1], lanes.shape), equal_nan=True)
        if not shared or not np.isfinite(lanes).any():
            return []
        style = self._dotted(self._style(joint, k).colour, k)
        return [Curve(self.joints[joint], k, self._series("reference", k), style, lanes[0])]

    def _lanes(self, quantity: str, joint: int, k: int) -> np.ndarray:
        """(lanes, rows) of one joint."""
        values = self.runs[k][quantity].values
        lanes = (values if values.ndim == 3 else values[None])[:, :, joint]
        return np.where(np.abs(lanes) < HUGE, lanes, np.nan)

    def _series(self, kind: str, k: int) -> str:
        if len(self.runs) == 1:
            return kind
        return f"{kind} of {self.names[k]}" if kind else self.names[k]

    def _style(self, joint: int, k: int) -> Style:
        """Look of a joint in run k: no two are alike up to 28 joints of one run, or 28 runs of one joint."""
        if self.by_run:
            return Style(COLOURS[k % len(COLOURS)], DASHES[k // len(COLOURS) % len(DASHES)])
        place = int(self.runs[0][PLACE].values[joint])
        return Style(COLOURS[place % len(COLOURS)], DASHES[(place // len(COLOURS) + k) % len(DASHES)])

    def legend(self, panels: Sequence[Panel]) -> tuple[LegendEntry, ...]:
        """Entries for the joints, then for the runs if there are several, then for their references."""
        entries = []
        if not self.by_run:
            entries += [LegendEntry(name, self._style(j, 0), "joint", name) for j, name in enumerate(self.joints)]
        styles = [
            self._style(0, k) if self.by_run else Style(INK, DASHES[k % len(DASHES)]) for k in range(len(self.runs))
        ]
        if len(styles) > 1:
            entries += [LegendEntry(name, styles[k], "run", k) for k, name in enumerate(self.names)]
        drawn = {curve.series for panel in panels for curve in panel.curves}
        for k, style in enumerate(styles):
            name = self._series("reference", k)
            if name in drawn:
                entries.append(LegendEntry(name, self._dotted(style.colour, k), "series", name))
        return tuple(entries)

    def _dotted(self, colour: str, k: int) -> Style:
        """Look of the references of run k."""
        return Style(colour, DOTTED[(k // len(COLOURS) if self.by_run else k) % len(DOTTED)], 0.9)


def _quantiles(lanes: np.ndarray, shares: Sequence[float]) -> np.ndarray:
    """Quantiles (s, k) over the finite values of lanes (l, k), linearly interpolated; NaN in rows where no lane has any."""
    ordered = np.sort(np.where(np.isfinite(lanes), lanes, np.nan), axis=0)  # NaN last
    last = np.maximum(np.isfinite(ordered).sum(axis=0) - 1, 0)
    place = np.asarray(shares)[:, None] * last
    below = np.floor(place).astype(int)
    low, high = (np.take_along_axis(ordered, rows, axis=0) for rows in (below, np.minimum(below + 1, last)))
    part = place - below
    return low * (1.0 - part) + high * part


def _note(runs: Mapping[str, xr.Dataset]) -> str:
    lanes = max(run.sizes.get("lane", 1) for run in runs.values())
    words = [f"{lanes} lanes"] if lanes > 1 else []
    if lanes > FEW_LANES:
        shares = " and ".join(f"{100 * (high - low):.0f} %" for low, high in reversed(BANDS))
        words = [f"{lanes} lanes: median and the bands that hold {shares} of them"]
    for name, run in runs.items():
        if PARTIAL in run.attrs:
            words.append(f"{f'{name}: ' * (len(runs) > 1)}partial run, {run.attrs[PARTIAL]}")
    return "; ".join(words)
