"""Zarr store of a sweep: one array for each result, chunked by lanes, with a status for each chunk.

The mark of a chunk is written after its data, so that a process that is killed at any moment leaves either a chunk that is done,
or one that is done again. Every chunk of data ends in its CRC-32C, so that damage on the disk is found when it is read.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import OutputError, RunError, ScenarioError

if TYPE_CHECKING:
    import xarray as xr

MARKS = "chunk_mark"
OPEN, DONE, FAILED = 0, 1, 2
ABOUT = "armwright_sweep"  # attribute with what the store was made from, as JSON
DOCUMENT = "scenario"  # attribute with the scenario file and all that it names
FORM = 1
NAME_ALONE = "processor"  # a name, which changes no bit


@dataclass(frozen=True)
class About:
    """Origin of a store; a sweep is continued only if all fields agree.

    Attributes:
        scenario: checksum of the scenario.   lanes: of the whole sweep.   chunk: lanes in a chunk.
        rows: True where recorded rows are stored too.
        made_with: versions and the processor's features, on which the last bits depend.
    """

    scenario: str
    lanes: int
    chunk: int
    rows: bool
    made_with: dict[str, str]

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.lanes // self.chunk)

    def lanes_of(self, chunk: int) -> range:
        """The lanes of a chunk."""
        return range(chunk * self.chunk, min((chunk + 1) * self.chunk, self.lanes))

    def check(self, other: About, path: Path) -> None:
        """Refuses to continue another sweep's store.

        Args:
            other: that of the sweep that is asked for.   path: of the store.
        Raises:
            OutputError: another scenario, version, number of lanes, or processor; names the first that differs.
        """
        expected = "the sweep that it was begun with, or another store"
        if self.scenario != other.scenario:
            raise OutputError("holds a sweep of another scenario", file=path, expected=expected)
        for place in ("lanes", "rows"):
            old, new = getattr(self, place), getattr(other, place)
            if old != new:
                raise OutputError(f"holds a sweep with {place} = {old}", place=place, value=new, file=path)
        found = difference(self.made_with, other.made_with)
        if found:
            raise OutputError(f"holds a sweep made with {found}", file=path, expected=expected)


def difference(then: dict[str, str], now: dict[str, str]) -> str:
    """The first difference between two environments that may change bits, in words; "" if equal."""
    names = [name for name in {**then, **now} if name != NAME_ALONE and then.get(name) != now.get(name)]
    return f"{names[0]} {then.get(names[0])}, not {now.get(names[0])}" if names else ""


class SweepStore:
    """An open store.

    Attributes:
        path: the folder.   about: what it was made from.   marks: (chunks,) OPEN, DONE or FAILED.   failures: reasons by chunk.
    """

    def __init__(self, path: Path):
        """Args:
        path: of a store that there is.

        Raises:
            RunError: no store of a sweep, or a damaged one.
        """
        zarr = import_zarr()
        self.path = path
        try:
            self.group = zarr.open_group(path, mode="r+", use_consolidated=False)
            about = json.loads(str(self.group.attrs[ABOUT]))
            if about.pop("form") != FORM:
                raise RunError("was made by another version", file=path, expected="a sweep of this one")
            self.failures: dict[int, str] = {int(k): v for k, v in about.pop("failures").items()}
            self.about = About(**about)
            self.marks = np.asarray(self.group[MARKS][:])
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            reason = " ".join(str(error).split())
            raise RunError(f"cannot be read: {reason}", file=path, expected="a store of aw.sweep") from None
        if self.marks.shape != (self.about.chunks,):
            raise RunError(f"{self.marks.size} marks", file=path, expected=f"{self.about.chunks}, one for each chunk")

    @classmethod
    def create(cls, path: Path, about: About, document: str, first: xr.Dataset) -> SweepStore:
        """A new store, created completely or not at all.

        Args:
            path: of the folder, where there is nothing.   about: what it is made from.   document: as of `Source`.
            first: the run of the first lane, which says which results there are.
        Raises:
            OutputError: it cannot be written.
        """
        zarr = import_zarr()
        temporary = path.with_name(f".armwright-{secrets.token_hex(8)}.zarr")
        with as_output_error(path):
            try:
                rest = first.drop_dims("lane").drop_vars("lane", errors="ignore")
                rest.attrs = {k: v for k, v in first.attrs.items() if k != "scenario"} | {DOCUMENT: document}
                texts = [name for name in rest.variables if rest[name].dtype.kind == "U"]
                rest = rest.assign_coords(
                    {name: rest[name].astype(object) for name in texts}
                )  # of any length, as Zarr 3 has them
                rest.to_zarr(temporary, mode="w", consolidated=False, zarr_format=3)
                group = zarr.open_group(temporary, mode="r+", use_consolidated=False)
                for name, variable in by_lane(first).items():
                    dims, shape = tuple(map(str, variable.dims)), variable.shape
                    group.create_array(
                        name,
                        shape=(about.lanes, *shape[1:]),
                        chunks=(about.chunk, *shape[1:]),
                        dtype=variable.dtype,
                        fill_value=np.nan if variable.dtype.kind == "f" else 0,
                        dimension_names=dims,
                        attributes=dict(variable.attrs),
                        compressors=[zarr.codecs.ZstdCodec(level=1), zarr.codecs.Crc32cCodec()],
                    )
                group.create_array(
                    MARKS,
                    shape=(about.chunks,),
                    chunks=(1,),
                    dtype="uint8",
                    fill_value=OPEN,
                    dimension_names=("chunk",),
                )
                group.attrs[ABOUT] = _as_text(about, {})
                os.rename(temporary, path)  # refuses a store that another process made in the meantime
            finally:
                shutil.rmtree(temporary, ignore_errors=True)
        return cls(path)

    @property
    def missing(self) -> list[int]:
        """Chunks without results."""
        return np.flatnonzero(self.marks != DONE).tolist()

    @property
    def lanes_done(self) -> int:
        """Number of lanes with results."""
        return sum(len(self.about.lanes_of(chunk)) for chunk in np.flatnonzero(self.marks == DONE).tolist())

    def write(self, chunk: int, values: dict[str, np.ndarray]) -> None:
        """Stores the results of a chunk, then marks it as done.

        Args:
            chunk: its number.   values: (lanes of the chunk, …) by name.
        Raises:
            OutputError: they cannot be written; the chunk stays open.
        """
        lanes = self.about.lanes_of(chunk)
        with as_output_error(self.path):
            for name, array in values.items():
                self.group[name][lanes.start : lanes.stop] = array
            self._mark(chunk, DONE)
            if self.failures.pop(chunk, None) is not None:
                self.group.attrs[ABOUT] = _as_text(self.about, self.failures)

    def fail(self, chunk: int, reason: str) -> None:
        """Marks a chunk as failed, with the reason."""
        self.failures[chunk] = reason
        with as_output_error(self.path):
            self._mark(chunk, FAILED)
            self.group.attrs[ABOUT] = _as_text(self.about, self.failures)

    def _mark(self, chunk: int, mark: int) -> None:
        self.group[MARKS][chunk] = mark
        self.marks[chunk] = mark


def by_lane(run: xr.Dataset) -> dict[str, xr.Variable]:
    """Variables of a run with a row for each lane."""
    return {str(name): run[name].variable for name in run.data_vars if "lane" in run[name].dims}


def load_sweep(path: str | os.PathLike[str]) -> xr.Dataset:
    """Results of a sweep, read lazily from its store.

    Args:
        path: of the store that `sweep` wrote; the sweep may still be running.
    Returns:
        run: as of `simulate`, its arrays as Dask arrays. `finished` (lane,) is False of lanes whose
            chunk is missing or failed, whose results are NaN. Attributes: lanes, lanes_finished, failed_chunks.
    Raises:
        RunError: no store of a sweep, or a damaged one.
        ScenarioError: the extra `sweep` is not installed.
    """
    import_zarr()
    import xarray as xr

    path = Path(path)
    if not path.is_dir():
        raise RunError("no such folder", file=path, expected="a store of aw.sweep")
    store = SweepStore(path)
    about = store.about
    run = xr.open_zarr(path, consolidated=False, chunks={}).drop_vars(MARKS)
    finished = np.repeat(store.marks == DONE, about.chunk)[: about.lanes]
    names = [name for name in ("joint", "kind", "command", "event") if name in run.coords]
    texts = {name: (run[name].dims, np.array(run[name].values.tolist(), dtype=str)) for name in names}
    run = run.assign_coords(lane=("lane", np.arange(about.lanes), {"long_name": "lane"})).assign_coords(texts)
    if not finished.all():
        there = xr.DataArray(finished, dims="lane").chunk(lane=about.chunk)
        run = run.assign({name: run[name].where(there) for name in by_lane(run)})
    run["finished"] = ("lane", finished, {"long_name": "whether the lane's results are there"})
    run.attrs.pop(ABOUT)
    if not run.attrs.get(DOCUMENT):
        run.attrs.pop(DOCUMENT, None)
    run.attrs |= {"lanes": about.lanes, "lanes_finished": int(finished.sum())}
    if store.failures:
        run.attrs["failed_chunks"] = "\n".join(f"{k}: {why}" for k, why in sorted(store.failures.items()))
    return run


def import_zarr() -> Any:
    """The module zarr.

    Raises:
        ScenarioError: it is not installed.
    """
    try:
        import zarr
        import zarr.codecs
    except ImportError:
        raise ScenarioError("needs zarr, which is not installed", expected="pip install armwright[sweep]") from None
    return zarr


@contextlib.contextmanager
def as_output_error(path: Path) -> Iterator[None]:
    """Converts errors of the operating system into `OutputError`."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        what = f"cannot be written: {reason}; finished chunks are kept, and the same sweep goes on from there"
        raise OutputError(what, file=path) from error


def _as_text(about: About, failures: dict[int, str]) -> str:
    """The attribute ABOUT."""
    values = {"form": FORM, **vars(about), "failures": {str(k): v for k, v in sorted(failures.items())}}
    return json.dumps(values, sort_keys=True)
