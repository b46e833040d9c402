"""Files of saved runs, written and opened only here.

`save` ends the file with a checksum, which other readers of HDF5 pass over. A file with a right checksum is as it was saved,
and is opened here; one with a wrong checksum was damaged; one without any (of another program, or changed by one) is read by
a process of its own, see `run_reader`. Whatever was read is checked by the schema of runs.
"""

from __future__ import annotations

import hashlib
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING

from armwright.entry import as_path
from armwright.errors import RunError
from armwright.results.run_reader import UNREADABLE, first_line, read_unsealed, undeclared
from armwright.results.run_schema import check_run

if TYPE_CHECKING:
    import xarray as xr

SEAL = b"armwright sha256 "  # before the checksum in hexadecimal, at the end of the file
SEAL_LENGTH = len(SEAL) + 64


def write_netcdf(run: xr.Dataset, path: Path) -> None:
    """Writes NetCDF, in memory first: on a full disk HDF5 itself would end the process with a segmentation fault."""
    data = bytes(run.to_netcdf(engine="h5netcdf", format="NETCDF4"))
    path.write_bytes(data + SEAL + hashlib.sha256(data).hexdigest().encode())


def load_run(path: str | os.PathLike[str]) -> xr.Dataset:
    """A run saved by `save` as NetCDF, completely in memory.

    Args:
        path: the file, ending in .nc.
    Returns:
        run: what `simulate` returned.
    Raises:
        RunError: no such file, one that is no NetCDF file, was damaged or names other files, or one whose variables are not
            those of a run: missing, of another type or shape, larger than the file can hold, times that do not increase.
    Example:
        >>> run = aw.simulate(aw.Scenario("two-link", 0.2, command=[0.0, 0.0]))
        >>> aw.save(run, "fall.nc")
        >>> dict(aw.load_run("fall.nc").sizes)
        {'time': 201, 'joint': 2, 'quantity': 2, 'state_entry': 50}
    """
    path = Path(as_path(path, "path", RunError))
    if not os.path.isfile(path):  # which is False of a name too long; Path.is_file raises
        what = "a folder" if os.path.isdir(path) else "no plain file" if os.path.exists(path) else "no such file"
        raise RunError(what, file=path, expected="a run saved as .nc")
    try:
        run = read_netcdf(path)
        check_run(run)
    except RunError as error:
        raise error.within(file=path) from None
    return run


def read_netcdf(path: Path) -> xr.Dataset:
    """The dataset in a NetCDF file, a run or not; only its own integrity is checked.

    Raises:
        RunError: not NetCDF, damaged, or with data in other files.
    """
    import xarray as xr

    try:
        source: Path | io.BytesIO = path
        if _is_sealed(path):
            reason = undeclared(path)
        else:
            copy, reason = read_unsealed(path)
            source = io.BytesIO(copy)
        if not reason:
            return xr.load_dataset(source, engine="h5netcdf", decode_times=False)
    except UNREADABLE as error:
        reason = first_line(error)
    raise RunError(f"cannot be read as a run: {reason}", expected="NetCDF 4")


def _is_sealed(path: Path) -> bool:
    """True if the file ends in its checksum, False if it has none.

    Raises:
        RunError: the checksum is another one's.
    """
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END) - SEAL_LENGTH
        file.seek(max(size, 0))
        seal = file.read()
        if not seal.startswith(SEAL):
            return False
        file.seek(0)
        digest, left = hashlib.sha256(), size
        while left > 0 and (part := file.read(min(left, 2**20))):
            digest.update(part)
            left -= len(part)
    if seal.removeprefix(SEAL).decode("ascii", "replace") != digest.hexdigest():
        raise RunError("does not have its checksum: it was damaged or changed", expected="a run as it was saved")
    return True
