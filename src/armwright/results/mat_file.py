"""Runs as .mat of MATLAB, version 5 with compression: `load run.mat; plot(t, q)`.

| variable          | holds                                                                              |
|-------------------|------------------------------------------------------------------------------------|
| `t`               | times [s], a column                                                                |
| `joint`           | names, a cell array; `kind` and `command` of each joint beside it                  |
| `q`, `tau`, …     | times × joints, and × lanes                                                        |
| `units`           | a struct: of each variable its unit, or a cell array with that of each joint       |
| `long_names`      | a struct: of each variable what it is                                              |
| `about`           | a struct: attributes of the run                                                    |
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import OutputError

if TYPE_CHECKING:
    import xarray as xr

LONGEST = 63  # letters of a name in MATLAB
MOST = 2**31 - 1  # bytes of a variable in a file of version 5
KEYWORDS = frozenset(
    (
        *("break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function", "global", "if"),
        *("otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while"),
    )
)
OURS = ("t", "units", "long_names", "about")


def write_mat(run: xr.Dataset, path: Path, units: dict[str, list[str]]) -> None:
    """Writes a run as .mat; see the table of this file.

    Args:
        run: any.   path: of the file.   units: of each variable with joints.
    Raises:
        OutputError: a variable too large for the format.
    """
    from scipy.io import savemat

    order = [str(name) for name in run.variables if name != "time"]
    names = dict(zip(order, matlab_names(order, OURS), strict=True))
    variables: dict[str, Any] = {}
    for name in order:
        variable = run[name]
        behind = [dim for dim in variable.dims if dim in ("lane", "statistic")]
        values = variable.transpose(*(dim for dim in variable.dims if dim not in behind), *behind).values
        if values.nbytes > MOST:
            expected = f"{MOST} bytes or fewer; MATLAB reads .nc too, with ncread"
            raise OutputError(place=name, value=f"{values.nbytes} bytes", expected=expected, file=path)
        column = values[:, None] if values.ndim == 1 else values
        variables[names[name]] = column.astype(object) if values.dtype.kind in "OUS" else column
    if "time" in run.coords:
        variables["t"] = np.atleast_1d(run["time"].values)[:, None]
    texts = {n: np.array(units[n], dtype=object)[:, None] if n in units else str(run[n].attrs["units"])
            for n in order if n in units or "units" in run[n].attrs}  # fmt: skip
    variables["units"] = {"t": "s"} | {names[name]: unit for name, unit in texts.items()}
    variables["long_names"] = {names[n]: str(run[n].attrs["long_name"]) for n in order if "long_name" in run[n].attrs}
    keys = [str(key) for key in run.attrs]
    variables["about"] = dict(zip(matlab_names(keys), (_plain(value) for value in run.attrs.values()), strict=True))
    savemat(path, variables, appendmat=False, long_field_names=True, do_compression=True, oned_as="column")


def _plain(value: Any) -> Any:
    """An attribute as MATLAB has it: a number, an array of numbers, or a text."""
    return value if isinstance(value, (int, float, np.number)) or np.asarray(value).dtype.kind in "fiub" else str(value)


def matlab_names(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Names that MATLAB allows, one for each name and no two equal: `joint 1.q` becomes `joint_1_q`.

    Args:
        names: any texts.   taken: names that are in use.
    Returns:
        found: letters, digits and _ alone, a letter first, no keyword, 63 letters or fewer.
    """
    used, found = set(taken), []
    for name in names:
        word = re.sub(r"[^A-Za-z0-9_]", "_", name)[:LONGEST]
        if not word[:1].isalpha() or word in KEYWORDS:
            word = f"x_{word}"[:LONGEST]
        plain, number = word, 2
        while word in used:
            word = f"{plain[: LONGEST - len(str(number)) - 1]}_{number}"
            number += 1
        used.add(word)
        found.append(word)
    return found
