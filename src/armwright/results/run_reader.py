"""Reading of untrusted NetCDF files: checked before their data are read, and copied by a separate process.

HDF5 ends its process (double free, endless loop) on some damaged files. `read_unsealed` therefore lets another Python open such a
file, which writes what it could read as a new file; this process opens only that. This module is the other process's
program too, and imports nothing of Armwright.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

MOST_VARIABLES = 10_000
MOST_TEXTS = 100_000  # entries of a variable of texts; each may be as long as the file
COMPRESSION = 1100  # times that a file may grow: deflate packs no number of zeros more tightly than 1 : 1032
SMALL = 2**24  # [bytes] that any file may declare
PROCESSOR_TIME, SPEED = 8.0, 1e7  # [s] to begin with, and [bytes/s] of the file
PATIENCE = 8.0  # times that, on a busy machine, or where processor time cannot be limited
GOOD, BAD = b"good\n", b"bad\n"  # what the other process begins its answer with
UNREADABLE = (  # exceptions of HDF5, h5netcdf and xarray on a damaged file
    *(OSError, ValueError, LookupError, TypeError, AttributeError, RuntimeError, ArithmeticError),
    *(AssertionError, NotImplementedError, MemoryError),
)


def read_unsealed(path: Path) -> tuple[bytes, str]:
    """The file's variables and attributes as a new NetCDF file; or nothing, and the reason why they cannot be read."""
    patience = PATIENCE * _processor_time(path)
    try:
        answer = _of_another_process(path, patience)
    except subprocess.TimeoutExpired:
        return b"", f"not read after {patience:.0f} s"
    if answer.startswith(GOOD):
        return answer.removeprefix(GOOD), ""
    if answer.startswith(BAD):
        return b"", answer.removeprefix(BAD).decode("utf-8", "replace")
    return b"", "HDF5, which reads it, breaks down"


def _of_another_process(path: Path, patience: float) -> bytes:
    """Output of this module, run as a separate program within a time [s]; empty or partial if the process breaks down."""
    program = [sys.executable, "-P", __file__, os.fspath(path.absolute())]
    done = subprocess.run(program, capture_output=True, timeout=patience, check=False, stdin=subprocess.DEVNULL)
    return done.stdout


def undeclared(path: Path) -> str:
    """The reason for refusing a file: data in other files, or more data than its size allows; "" if it may be read."""
    import h5py

    most = COMPRESSION * path.stat().st_size + SMALL
    with h5py.File(path, "r") as file:
        if len(file) > MOST_VARIABLES:
            return f"{len(file)} variables, expected at most {MOST_VARIABLES}"
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                return f"{name} is a link to elsewhere"
            variable = file[name]
            if not isinstance(variable, h5py.Dataset):
                continue  # groups are not read
            if variable.is_virtual or variable.external:
                return f"{name} lies in another file"
            size = variable.size or 0
            most -= size * variable.dtype.itemsize
            if most < 0 or (variable.dtype.kind not in "fiub" and size > MOST_TEXTS):
                shape = " × ".join(map(str, variable.shape))
                return f"{name} declares {shape} values, more than the file can hold"
    return ""


def first_line(error: BaseException) -> str:
    """The first line of an exception's text, or its type."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _processor_time(path: Path) -> float:
    """[s] that reading a file may take."""
    return PROCESSOR_TIME + path.stat().st_size / SPEED


def copy_or_reason(path: Path) -> bytes:
    """The copy of a file, or the reason for its absence. From now on this process may take a limited time."""
    if sys.platform != "win32":
        import resource

        seconds = int(_processor_time(path))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    try:
        reason = undeclared(path)
        if reason:
            return BAD + reason.encode("utf-8", "replace")
        import xarray as xr  # which takes a second, and not for a file that is refused before

        copy = xr.load_dataset(path, engine="h5netcdf", decode_cf=False)
        return GOOD + bytes(copy.to_netcdf(engine="h5netcdf", format="NETCDF4"))
    except UNREADABLE as error:
        return BAD + first_line(error).encode("utf-8", "replace")


if __name__ == "__main__":
    sys.stdout.buffer.write(copy_or_reason(Path(sys.argv[1])))
