"""Statistics over the lanes of a run: mean, spread and percentiles of all variables that have lanes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from armwright import scalar
from armwright.entry import AnyRun, as_run
from armwright.errors import RunError
from armwright.results.aliases import LOOP_STATE
from armwright.results.run_schema import check_run

if TYPE_CHECKING:
    import xarray as xr

NO_STATISTICS = ("diverged_at", "stalled_at", LOOP_STATE)
PERCENTILES = (5.0, 25.0, 50.0, 75.0, 95.0)
PIECE = 4_000_000  # numbers in one go


def statistics(run: AnyRun, percentiles: Sequence[float] = PERCENTILES) -> xr.Dataset:
    """Mean, standard deviation, least, most and percentiles over the lanes, of every variable that has them.

    Lanes that diverged or ran out of steps are left out, and counted in the attributes; so are unknown numbers (NaN).

    Args:
        run: what `simulate` returned, with lanes.   percentiles: (k,) within 0 and 100 [%].
    Returns:
        statistics: the variables with dimension `statistic` instead of `lane`: "mean", "std" (over the lanes, divided by their
            number less one), "min", "max", "p5", "p25", …; units as in the run.
    Raises:
        RunError: no run, one without lanes, no lane that reached its end, or percentiles outside of 0 to 100.
    Example:
        >>> torque = aw.Batch([[0.0, 0.0], [20.0, 5.0], [40.0, 10.0]])
        >>> run = aw.simulate(aw.Scenario("two-link", 0.2, command=torque))
        >>> aw.statistics(run).q.sel(statistic="mean").values[-1].round(3)
        array([-0.219,  0.373])
    """
    run = as_run(run)
    import xarray as xr

    check_run(run)
    if "lane" not in run.dims:
        raise RunError("statistics are over lanes", expected="a run of many lanes")
    try:
        shares = np.atleast_1d(scalar.real_numbers(percentiles))
    except ValueError:
        shares = np.full(1, np.nan)
    if shares.ndim != 1 or not np.all((shares >= 0.0) & (shares <= 100.0)):
        raise RunError(place="percentiles", value=percentiles, expected="numbers from 0 to 100")
    whole = np.ones(run.sizes["lane"], dtype=bool)
    for name in ("diverged_at", "stalled_at"):
        if name in run:
            whole &= np.isnan(run[name].values)
    if not whole.any():
        raise RunError(f"none of the {len(whole)} lanes reached its end", expected="at least one for statistics")
    names = ["mean", "std", "min", "max", *(f"p{share:g}" for share in shares)]
    variables = {}
    for name, variable in run.data_vars.items():
        if "lane" in variable.dims and variable.dtype.kind == "f" and name not in NO_STATISTICS:
            rest = [dim for dim in variable.dims if dim != "lane"]
            values = variable.transpose("lane", *rest).values[whole]
            variables[name] = (("statistic", *rest), _over_lanes(values, shares), variable.attrs)
    coordinates = {name: value for name, value in run.coords.items() if "lane" not in value.dims}
    lanes = {"lanes": int(whole.sum()), "lanes_left_out": int((~whole).sum())}
    about = ("statistic", names, {"long_name": "statistic over the lanes"})
    return xr.Dataset(variables, {**coordinates, "statistic": about}, {**run.attrs, **lanes})


def _over_lanes(values: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(statistics, …) from (lanes, …), some columns at a time."""
    shape = values.shape[1:]
    flat = values.reshape(len(values), -1)
    table = np.empty((4 + len(shares), flat.shape[1]))
    width = max(1, PIECE // len(values))
    for start in range(0, flat.shape[1], width):
        part = flat[:, start : start + width]
        with warnings.catch_warnings():  # a column of NaN stays NaN
            warnings.simplefilter("ignore", RuntimeWarning)
            spread = np.nanstd(part, axis=0, ddof=1) if len(part) > 1 else np.full(part.shape[1], np.nan)
            rows = [np.nanmean(part, axis=0), spread, np.nanmin(part, axis=0), np.nanmax(part, axis=0)]
            table[:, start : start + width] = [*rows, *np.nanpercentile(part, shares, axis=0)]
    return table.reshape(len(table), *shape)
