"""Zarr store of a sweep: one array for each result, chunked by lanes, with a status for each chunk.

The mark of a chunk is written after its data, so that a process that is killed at any moment leaves either a chunk that is done,
or one that is done again. The mark holds size and checksum of each of the chunk's files, with which they are compared before they
are believed, and a checksum of itself. All of them begin with what the store was made from and with the chunk's number, so that
a file or a mark of another store, or of another chunk, is damage too.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import as_path
from armwright.errors import OutputError, RunError, ScenarioError

if TYPE_CHECKING:
    import xarray as xr

MARKS = "chunk_mark"
LANED = "armwright_results"  # attribute with the names of the results by lane
EXPECTED = "a store of aw.sweeps.sweep, of this version"
OPEN, DONE, FAILED = 0, 1, 2
ABOUT = "armwright_sweep"  # attribute with what the store was made from, as JSON
DOCUMENT = "scenario"  # attribute with the scenario file and all that it names
FORM = 3  # 1 had no checksums; those of 2 said nothing of the store and the chunk
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

    @property
    def seal(self) -> bytes:
        """First part of the checksums of this store."""
        return json.dumps(vars(self), sort_keys=True).encode()

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

    def __init__(self, path: Path, verify: bool = True):
        """Args:
        path: of a store that there is.   verify: whether all files are read; else only the sizes of results are compared.

        Raises:
            RunError: no store of a sweep, or a damaged one.
        """
        zarr = import_zarr()
        self.path = path
        try:
            self.sizes = _sizes(path)
            self.group = zarr.open_group(path, mode="r+", use_consolidated=False)
            about = json.loads(str(self.group.attrs[ABOUT]))
            digest = about.pop("digest", None), _text_digest(about)
            if about.pop("form") != FORM:
                raise RunError("has no checksums, or others: made by another version", file=path, expected=EXPECTED)
            if digest[0] != digest[1] or about.pop("small") != _small_files(path, self.sizes):
                raise RunError("has damaged metadata", file=path, expected=EXPECTED)
            self.failures: dict[int, str] = {int(k): v for k, v in about.pop("failures").items()}
            self.about = About(**about)
            self.names = sorted(name for name in self.group.attrs[LANED])
            self.table = self._table()
        except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise RunError(f"cannot be read: {reason}", file=path, expected=EXPECTED) from None
        self.marks = self.table[:, 0].copy()
        self.failures = {k: v for k, v in self.failures.items() if k < len(self.marks) and self.marks[k] == FAILED}
        for chunk in np.flatnonzero(self.marks == DONE).tolist():
            if damage := self._damage(chunk, verify):
                self.marks[chunk], self.failures[chunk] = FAILED, damage

    def _table(self) -> np.ndarray:
        """(chunks, 2 + 2 names) mark, size and checksum of each file, and the row's own; 0, which is open, of damaged marks."""
        marks = self.group[MARKS]
        if marks.shape != (self.about.chunks, 2 + 2 * len(self.names)):
            raise ValueError(f"marks of shape {marks.shape}")
        try:
            table = np.asarray(marks[:])
        except (ValueError, RuntimeError):
            table = np.zeros(marks.shape, dtype=np.uint64)
            for chunk in range(len(table)):
                with contextlib.suppress(ValueError, RuntimeError):
                    table[chunk] = marks[chunk]
        for chunk in range(len(table)):
            if table[chunk, -1] != self._row_digest(chunk, table[chunk]):
                table[chunk] = OPEN
        return table

    def _row_digest(self, chunk: int, row: np.ndarray) -> int:
        """The checksum of a mark."""
        return _digest(self.about.seal, str(chunk).encode(), row[:-1].astype("<u8").tobytes())

    def _file(self, name: str, chunk: int) -> str:
        """Name of the file of a chunk of a result."""
        return "/".join([name, "c", str(chunk), *["0"] * (self.group[name].ndim - 1)])

    def _damage(self, chunk: int, verify: bool) -> str:
        """The first difference between the files of a chunk and its mark, in words; "" if there is none."""
        for name in self.names:
            file, size = self._file(name, chunk), self._marked(name, chunk)[0]
            if file not in self.sizes:
                return f"{file} is not there"
            if self.sizes[file] != size:
                return f"{file} has {self.sizes[file]} bytes, not {size}"
            if verify and not self.intact(name, chunk):
                return f"{file} is not as it was written"
        return ""

    def _marked(self, name: str, chunk: int) -> tuple[int, int]:
        """Size and checksum of the file of a chunk of a result, by its mark."""
        first = 1 + 2 * self.names.index(name)
        return int(self.table[chunk, first]), int(self.table[chunk, first + 1])

    def intact(self, name: str, chunk: int) -> bool:
        """True if the file of a chunk of a result is the one that was written.

        Raises:
            OSError: it cannot be read.
        """
        content = (self.path / self._file(name, chunk)).read_bytes()
        return self._marked(name, chunk) == self._checks(name, chunk, content)

    def _checks(self, name: str, chunk: int, content: bytes) -> tuple[int, int]:
        """Size and checksum of a file as they are written into a mark."""
        return len(content), _digest(self.about.seal, self._file(name, chunk).encode(), content)

    @classmethod
    def create(cls, path: Path, about: About, document: str, first: xr.Dataset) -> SweepStore:
        """A new store, created completely or not at all.

        Args:
            path: of the folder, where there is nothing.   about: what it is made from.   document: as of `LaneSource`.
            first: the run of the first lane, which says which results there are.
        Raises:
            OutputError: it cannot be written.
        """
        zarr = import_zarr()
        temporary = path.with_name(f".armwright-{secrets.token_hex(8)}.zarr")
        with as_output_error(path):
            try:
                rest = first.drop_dims("lane").drop_vars("lane", errors="ignore")
                rest.attrs = {k: v for k, v in first.attrs.items() if k != "scenario"} | {
                    DOCUMENT: document,
                    LANED: list(by_lane(first)),
                }
                texts = [name for name in rest.variables if rest[name].dtype.kind == "U"]
                # of any length, as Zarr 3 has them
                rest = rest.assign_coords({name: rest[name].astype(object) for name in texts})
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
                    shape=(about.chunks, 2 + 2 * len(by_lane(first))),
                    chunks=(1, 2 + 2 * len(by_lane(first))),
                    dtype="uint64",
                    fill_value=OPEN,
                    dimension_names=("chunk", "entry"),
                    compressors=[zarr.codecs.Crc32cCodec()],
                )
                group.attrs[ABOUT] = _as_text(about, {}, _small_files(temporary, _sizes(temporary)))
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
        with as_output_error(self.path), import_zarr().config.set({"array.write_empty_chunks": True}):
            for name, array in values.items():
                self.group[name][lanes.start : lanes.stop] = array
            files = [(name, (self.path / self._file(name, chunk)).read_bytes()) for name in self.names]
            self.table[chunk, 1:-1] = [number for file in files for number in self._checks(file[0], chunk, file[1])]
            self._mark(chunk, DONE)
            if self.failures.pop(chunk, None) is not None:
                self._write_about()

    def fail(self, chunk: int, reason: str) -> None:
        """Marks a chunk as failed, with the reason."""
        self.failures[chunk] = reason
        with as_output_error(self.path):
            self._mark(chunk, FAILED)
            self._write_about()

    def _write_about(self) -> None:
        self.group.attrs[ABOUT] = _as_text(self.about, self.failures, _small_files(self.path, _sizes(self.path)))

    def _mark(self, chunk: int, mark: int) -> None:
        self.table[chunk, 0] = mark
        self.table[chunk, -1] = self._row_digest(chunk, self.table[chunk])
        self.group[MARKS][chunk] = self.table[chunk]
        self.marks[chunk] = mark


class CheckedResult:
    """A result whose files are compared with their marks each time that they are read; NaN of lanes without results."""

    def __init__(self, store: SweepStore, name: str):
        self.store, self.name, self.array = store, name, store.group[name]
        self.shape, self.ndim = self.array.shape, self.array.ndim
        whole = not store.missing
        self.dtype = self.array.dtype if whole else np.result_type(self.array.dtype, np.float64)

    def __getitem__(self, key: Any) -> np.ndarray:
        """Values of lanes of one chunk.

        Raises:
            RunError: a file that is not as it was written.
        """
        store, key = self.store, key if isinstance(key, tuple) else (key,)
        for chunk in np.unique(np.arange(self.shape[0])[key[0]] // store.about.chunk).tolist():
            if store.marks[chunk] != DONE:
                return np.broadcast_to(np.array(np.nan, dtype=self.dtype), self.shape)[key]
            reason = "is not as it was written"
            try:
                intact = store.intact(self.name, chunk)
            except OSError as error:
                intact, reason = False, error.strerror or str(error)
            if not intact:
                expected = "the same sweep once more, which simulates these lanes again"
                raise RunError(f"chunk {chunk} of {self.name} {reason}", file=store.path, expected=expected)
        return np.asarray(self.array[key], dtype=self.dtype)

    def as_variable(self, variable: xr.Variable) -> xr.Variable:
        """A variable as a Dask array with names and units, in the store's chunks."""
        import dask.array as da
        import xarray as xr

        empty = np.zeros((0,) * self.ndim, dtype=self.dtype)
        return xr.Variable(
            variable.dims, da.from_array(self, self.array.chunks, name=False, meta=empty), variable.attrs
        )


def by_lane(run: xr.Dataset) -> dict[str, xr.Variable]:
    """Variables of a run with a row for each lane."""
    return {str(name): run[name].variable for name in run.data_vars if "lane" in run[name].dims}


def load_sweep(path: str | os.PathLike[str], *, verify: bool = False) -> xr.Dataset:
    """Results of a sweep, read lazily from its store.

    Args:
        path: of the store that `sweep` wrote; the sweep may still be running.
        verify: whether all files are read and compared with their checksums now; else their sizes are, and a file's checksum when
            it is read.
    Returns:
        run: as of `simulate`, its arrays as Dask arrays. `finished` (lane,) is False of lanes whose
            chunk is missing, damaged or failed, whose results are NaN. Attributes: lanes, lanes_finished, failed_chunks.
    Raises:
        RunError: no store of a sweep, or a damaged one; when values are computed, a file that is not as it was written.
        ScenarioError: the extra `sweep` is not installed.
    Example:
        >>> from distributed import Client
        >>> with Client(processes=False, dashboard_address=None) as client:
        ...     scenario = "examples/robust.scenario.toml"
        ...     done = aw.sweeps.sweep(scenario, "runs.zarr", lanes=4, client=client)
        >>> int(aw.sweeps.load_sweep("runs.zarr").finished.sum())
        4
    """
    import_zarr()
    import xarray as xr

    path = Path(as_path(path, "path", RunError))
    if not os.path.isdir(path):
        raise RunError("no such folder", file=path, expected="a store of aw.sweeps.sweep")
    store = SweepStore(path, verify)
    about = store.about
    run = xr.open_zarr(path, consolidated=False, chunks={}).drop_vars(MARKS)
    run = run.assign({name: CheckedResult(store, name).as_variable(run[name].variable) for name in store.names})
    finished = np.repeat(store.marks == DONE, about.chunk)[: about.lanes]
    names = [name for name in ("joint", "kind", "command", "event") if name in run.coords]
    texts = {name: (run[name].dims, np.array(run[name].values.tolist(), dtype=str)) for name in names}
    run = run.assign_coords(lane=("lane", np.arange(about.lanes), {"long_name": "lane"})).assign_coords(texts)
    run["finished"] = ("lane", finished, {"long_name": "whether the lane's results are there"})
    run.attrs.pop(ABOUT)
    run.attrs.pop(LANED)
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


def _sizes(path: Path) -> dict[str, int]:
    """Bytes of all files of a store by name.

    Raises:
        OSError: a pipe, a device, or what cannot be looked at.
    """
    sizes = {}
    for folder, _, names in os.walk(path):
        for name in names:
            file = Path(folder, name)
            if name.endswith(".partial"):  # of a write that was killed, or is under way
                continue
            if not file.is_file():
                raise OSError(f"{file.relative_to(path)} is no plain file")
            sizes[file.relative_to(path).as_posix()] = file.stat().st_size
    return sizes


def _digest(*parts: bytes) -> int:
    """The first 64 bits of the SHA-256 of the parts, each with its length before it."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return int.from_bytes(digest.digest()[:8], "little")


def _small_files(path: Path, sizes: dict[str, int]) -> str:
    """Checksum of what is written once: metadata, and arrays that no lane is in."""
    group = json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"]
    text = json.dumps({k: v for k, v in group.items() if k != ABOUT}, sort_keys=True)
    digest = hashlib.sha256(text.encode())
    for name in sorted(sizes):
        first, _, rest = name.partition("/")
        if rest == "zarr.json" or (rest and first not in {MARKS, *group[LANED]}):
            digest.update(name.encode() + (path / name).read_bytes())
    return digest.hexdigest()


def _as_text(about: About, failures: dict[int, str], small: str) -> str:
    """The attribute ABOUT."""
    values = {"form": FORM, "small": small, **vars(about), "failures": {str(k): v for k, v in sorted(failures.items())}}
    return json.dumps(values | {"digest": _text_digest(values)}, sort_keys=True)


def _text_digest(values: dict[str, Any]) -> int:
    """The checksum of what is written as text."""
    return _digest(json.dumps(values, sort_keys=True).encode())
