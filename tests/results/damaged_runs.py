"""Damaged and foreign files in place of runs, by number, and what every function that opens a run makes of them.

python -m results.damaged_runs FOLDER FIRST LAST     prints a line "NUMBER OUTCOME" for each
"""

from __future__ import annotations

import faulthandler
import hashlib
import io
import json
import resource
import signal
import sys
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from rich.console import Console

import armwright as aw
from armwright.errors import ArmwrightError
from armwright.results.run_file import SEAL

MEMORY = 6 * 2**30  # [bytes] of address space, in which a file that declares too much is noticed
PATIENCE = 20  # [s] of the processor, for one file
ARM = "two-link"
SCENARIO = """robot = "two-link"
duration_s = 0.02
seed = 3
[loop]
period_s = 1e-3
[loop.controller]
kind = "joint_pid"
kp = [400, 200]
kd = [40, 20]
[loop.reference]
kind = "schedule"
file = "steps.csv"
[loop.timing]
preset = "one-tick"
command_delay_s = 1.5e-3
"""
LANES = '[lanes]\nkind = "list"\n[lanes.vary]\n"forearm.mass_kg" = { values = [1, 2, 3] }\n'
REDUCED = '[recording]\nwhat = "none"\nreduce = ["rms_error"]\n'
ANY = (Exception,)  # of HDF5, h5netcdf and xarray on what they cannot write or read
WORDS = ("", "\x1b[2Jx", "‮abc", "x" * 100_000, "nan", "$x^{$", "a\nb", "<script>", "🦾", "[red]x[/nope]")
NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 0.0, -1.0, 2.0**63)
VALUES = (None, True, -1, 1e400, 10**400, "", "x", [], {}, [[[]]], {"a": {"b": []}}, "../../etc/passwd")


@cache
def scenario(more: str, folder: Path) -> Any:
    """The scenario, with more tables."""
    (folder / "steps.csv").write_text("t,shoulder,elbow\n0,0,0\n0.01,0.1,-0.1\n")
    path = folder / "one.scenario.toml"
    path.write_text(SCENARIO + more)
    return aw.read_scenario(path)


@cache
def sound(kind: int, folder: Path) -> xr.Dataset:
    """A run without damage."""
    return aw.simulate(scenario(("", LANES, REDUCED + LANES)[kind], folder))


def damaged(number: int, folder: Path) -> Path:
    """The file of that number."""
    random = np.random.default_rng([number, 16])
    path = folder / "damaged.nc"
    path.unlink(missing_ok=True)
    run = sound(int(random.choice(3, p=[0.5, 0.4, 0.1])), folder).copy(deep=True)
    WAYS[number % len(WAYS)](run, random, path)
    if random.random() < 0.95 and WAYS[number % len(WAYS)] is in_dataset:  # as `save` would have written it
        data = path.read_bytes()
        path.write_bytes(data + SEAL + hashlib.sha256(data).hexdigest().encode())
    return path


def in_dataset(run: xr.Dataset, random: np.random.Generator, path: Path) -> None:
    """One to three damages of variables, dimensions and attributes."""
    for _ in range(int(random.integers(1, 4))):
        change = DATASET[random.integers(len(DATASET))]
        try:
            run = change(run, random)
        except ANY:  # not with this run: the next one
            continue
    try:
        run.to_netcdf(path, engine="h5netcdf")
    except ANY:  # a type that NetCDF cannot hold
        path.write_bytes(b"")


def _name(
    run: xr.Dataset, random: np.random.Generator, *, often: tuple[str, ...] = ("time", "q", "joint", "loop_state")
):
    names = [*run.variables, *(name for name in often if name in run.variables)]
    return names[random.integers(len(names))]


def _without(run, random):
    return run.drop_vars(_name(run, random))


def _renamed(run, random):
    return run.rename({_name(run, random): str(random.choice(["x", "q", "time", "kind", "lane", "diverged_at"]))})


def _assigned(run, name, values):
    new = {name: (run[name].dims, values)}
    return run.assign_coords(new) if name in run.coords else run.assign(new)


def _retyped(run, random):
    name = _name(run, random)
    kinds: list[Callable[[np.ndarray], np.ndarray]] = [
        lambda v: v.astype(np.int32), lambda v: v.astype(str), lambda v: v.astype("S8"), lambda v: v.astype(complex),
        lambda v: v.astype(bool), lambda v: v.astype(np.float32), lambda v: v.astype("datetime64[ns]"),
        lambda v: np.full(v.shape, "x"), lambda v: np.full(v.shape, np.nan),
    ]  # fmt: skip
    values = kinds[random.integers(len(kinds))](run[name].values)
    return (
        run.assign_coords({name: (run[name].dims, values)})
        if name in run.coords
        else run.assign({name: (run[name].dims, values)})
    )


def _changed_numbers(run, random):
    name = _name(run, random)
    values = np.array(run[name].values)
    flat = values.reshape(-1)
    count = 1 if random.random() < 0.5 else flat.size
    flat[random.choice(flat.size, count, replace=False)] = NUMBERS[random.integers(len(NUMBERS))]
    return (
        run.assign_coords({name: (run[name].dims, values)})
        if name in run.coords
        else run.assign({name: (run[name].dims, values)})
    )


def _shuffled(run, random):
    dim = [*run.dims, "time"][random.integers(len(run.dims) + 1)]
    order = random.permutation(run.sizes[dim]) if random.random() < 0.6 else np.zeros(run.sizes[dim], dtype=int)
    name = dim if random.random() < 0.5 and dim in run.coords else None
    return run.isel({dim: order}) if name is None else run.assign_coords({name: (dim, run[name].values[order])})


def _other_dimensions(run, random):
    name = _name(run, random)
    variable = run[name]
    others = [
        lambda v: v.variable.isel({v.dims[0]: 0}), lambda v: v.variable.expand_dims("case"), lambda v: v.variable.transpose(),
        lambda v: xr.Variable(("a", "b")[: v.ndim], v.values), lambda v: v.variable.isel({v.dims[-1]: slice(0)}),
    ]  # fmt: skip
    changed = others[random.integers(len(others))](variable)
    bare = run.drop_vars(name)
    return bare.assign({name: changed}) if random.random() < 0.5 else bare.assign_coords({name: changed})


def _part(run, random):
    dim = list(run.dims)[random.integers(len(run.dims))]
    return run.isel({dim: [0, slice(0), slice(1), -1][random.integers(4)]}, drop=bool(random.random() < 0.3))


def _other_attribute(run, random):
    name = _name(run, random) if random.random() < 0.5 else None
    attributes = run.attrs if name is None else run[name].attrs
    keys = [
        *attributes,
        "units",
        "scale_factor",
        "add_offset",
        "_FillValue",
        "coordinates",
        "armwright_session",
        "partial",
        "dtype",
    ]
    values = [
        *WORDS,
        np.float64(np.nan),
        np.arange(3.0),
        np.int8(1),
        np.bytes_(b"\xff\xfe"),
        ["a", "b"],
        "seconds since 2000-01-01",
    ]
    attributes[keys[random.integers(len(keys))]] = values[random.integers(len(values))]
    if random.random() < 0.2:
        attributes.pop(keys[random.integers(len(attributes))], None)
    return run


def _other_words(run, random):
    name = ["joint", "kind", "command"][random.integers(3)]
    values = run[name].values.astype(object)
    values[random.integers(len(values))] = WORDS[random.integers(len(WORDS))]
    return run.assign_coords({name: ("joint", values.astype(str))})


def _other_json(run, random):
    places = [(run.attrs, "scenario"), (run.attrs, "made_with")]
    places += 2 * [(run["loop_state"].attrs, "layout")] if "loop_state" in run else []
    attributes, key = places[random.integers(len(places))]
    document = json.loads(attributes[key])
    holders: list[tuple[Any, Any]] = []

    def walk(value: Any) -> None:
        for k, inner in (
            value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        ):
            holders.append((value, k))
            walk(inner)

    walk(document)
    for _ in range(int(random.integers(1, 3))):
        holder, k = holders[random.integers(len(holders))]
        holder[k] = VALUES[random.integers(len(VALUES))]
    text = json.dumps(document)
    attributes[key] = text if random.random() < 0.9 else text[: random.integers(len(text))]
    return run


DATASET = (
    _without, _renamed, _retyped, _retyped, _changed_numbers, _changed_numbers, _shuffled, _other_dimensions, _part,
    _other_attribute, _other_attribute, _other_words, _other_json, _other_json,
)  # fmt: skip


def in_hdf5(run: xr.Dataset, random: np.random.Generator, path: Path) -> None:
    """Damages that HDF5 allows and NetCDF does not: absurd sizes, data in other files, links, groups."""
    run.to_netcdf(path, engine="h5netcdf")
    secret = path.with_name("secret.bin")
    secret.write_bytes(b"secret" * 1000)
    with h5py.File(path, "r+") as file:
        names = [name for name in file if isinstance(file[name], h5py.Dataset)]
        name = names[random.integers(len(names))]
        old = file[name]
        shape, attributes = old.shape, dict(old.attrs)
        keep = random.random() < 0.5
        del file[name]
        way = random.integers(9)
        if way == 0:
            file.create_dataset(name, (10**6, 10**6), chunks=(100, 100), dtype=float, fillvalue=1.0)
        elif way == 1:
            file.create_dataset(
                name, (2**40,), chunks=(1000,), dtype=[float, h5py.string_dtype(), "i1"][random.integers(3)]
            )
        elif way == 2:
            file.create_dataset(name, (600,), dtype=float, external=[(str(secret), 0, 4800)])
        elif way == 3:
            file[name] = h5py.ExternalLink(str(secret), "/x")
        elif way == 4:
            file[name] = h5py.SoftLink(f"/{name}" if random.random() < 0.5 else f"/{names[0]}")
        elif way == 5:
            layout = h5py.VirtualLayout((10,), float)
            layout[:] = h5py.VirtualSource(str(secret), "x", (10,))
            file.create_virtual_dataset(name, layout)
        elif way == 6:
            file.create_group(name).create_group("inner")
        elif way == 7:
            kinds = (
                [("a", "f8"), ("b", "i4")],
                h5py.opaque_dtype(np.dtype("V8")),
                h5py.ref_dtype,
                h5py.vlen_dtype(float),
                "f2",
                ">u8",
            )
            file.create_dataset(name, shape or (1,), dtype=kinds[random.integers(len(kinds))])
        elif way == 8:
            file.create_dataset(name, (), dtype=float)
        if keep and isinstance(file.get(name, getlink=True), h5py.HardLink):
            for key, value in attributes.items():
                file[name].attrs[key] = value


def in_bytes(run: xr.Dataset, random: np.random.Generator, path: Path) -> None:
    """Bytes cut off, flipped, or swapped for others; mostly of a file that `save` wrote."""
    if random.random() < 0.7:
        aw.save(run, path)
    else:
        run.to_netcdf(path, engine="h5netcdf")
    data = bytearray(path.read_bytes())
    if random.random() < 0.3:
        data = data[: random.integers(len(data))]
    else:
        structure = 0.5 if random.random() < 0.5 else 1.0  # headers stand in front
        for _ in range(int(random.choice([1, 2, 8, 64]))):
            at = random.integers(int(len(data) * structure))
            data[at] = random.choice([0, 255, data[at] ^ 1, data[at] ^ 128, random.integers(256)])
    path.write_bytes(data)


def foreign(run: xr.Dataset, random: np.random.Generator, path: Path) -> None:
    """Files of other programs."""
    way = random.integers(9)
    if way == 0:
        xr.Dataset({"air": (("lat", "lon"), random.normal(size=(3, 4)))}, {"lat": [1, 2, 3]}).to_netcdf(
            path, engine="h5netcdf"
        )
    elif way == 1:
        times = np.array(["2000-01-01", "2000-01-02"], dtype="datetime64[ns]")
        xr.Dataset({"q": (("time", "joint"), np.zeros((2, 2)))}, {"time": times, "joint": [1, 2]}).to_netcdf(
            path, engine="h5netcdf"
        )
    elif way == 2:
        with h5py.File(path, "w") as file:
            file["a/b/q"], file["q"] = np.arange(3), np.arange(4)
    elif way == 3:
        run.isel(joint=0).to_netcdf(path, engine="h5netcdf", group="deep")
    elif way == 4:
        path.write_bytes(
            [b"", b"CDF\x01" + bytes(100), b"{}", b"PK\x03\x04" + bytes(50), bytes(4096)][random.integers(5)]
        )
    elif way == 5:
        np.savez(path.with_suffix(".npz"), q=np.zeros(3))
        path.with_suffix(".npz").rename(path)
    elif way == 6:
        xr.Dataset({"time": ("time", np.arange(3.0)), "joint": ("joint", ["a", "b"])}).to_netcdf(
            path, engine="h5netcdf"
        )
    elif way == 7:
        xr.Dataset(
            attrs={"armwright_session": str(random.choice(["", "{}", "[]", '{"form": 2}', "x" * 1000]))}
        ).to_netcdf(path, engine="h5netcdf")
    else:
        names = dict.fromkeys(("q", "qd", "tau"), (("time", "joint"), np.zeros((3, 2))))
        xr.Dataset(names, {"time": [0.0, 1.0, 2.0], "joint": ["a", "b"]}).to_netcdf(path, engine="h5netcdf")


WAYS = (in_dataset, in_dataset, in_hdf5, in_dataset, in_bytes, in_dataset, in_bytes, foreign)


def uses(path: Path, number: int, folder: Path) -> dict[str, Callable[[], Any]]:
    """Functions that open a run, or take one that Python opened."""
    arm = aw.load(ARM)

    def opened() -> xr.Dataset:
        """The dataset as xarray has it, which no function of ours has looked at."""
        if WAYS[number % len(WAYS)] is not in_dataset:
            return sound(0, folder)  # on which HDF5 itself may break down
        try:
            return xr.load_dataset(path, engine="h5netcdf", decode_times=bool(number % 2))
        except ANY:  # not ours to judge
            return sound(0, folder)

    def shown(run: xr.Dataset) -> None:
        from armwright.pictures.terminal import show_runs

        show_runs(run, Console(file=io.StringIO(), width=120))

    def restored() -> None:
        from armwright.session import Session

        Session(ARM).run(f"restore {path}")

    run = opened()
    by_path: dict[str, Callable[[], Any]] = {"reproduce": lambda: aw.reproduce(path), "restore": restored}
    by_path["load_run"] = lambda: aw.load_run(path)
    if WAYS[number % len(WAYS)] is not in_dataset:  # all of them open the file in one place: one is enough
        name = [*by_path][number % 3]
        return {name: by_path[name]}
    return {
        **by_path,
        "terminal": lambda: shown(run),
        "plot": lambda: aw.plot(run, folder / ("plot.png" if number % 10 == 0 else "plot.html")),
        "animate": lambda: aw.animate(
            run, arm, folder / ("arm.html" if number % 2 else "arm.glb"), lane=None if "lane" not in run.dims else 0
        ),
        "statistics": lambda: aw.statistics(run),
        "save": lambda: aw.save(run, folder / ("saved.csv" if number % 2 else "saved.nc")),
        "start": lambda: aw.simulate(continued(run, folder)),
    }


def continued(run: xr.Dataset, folder: Path) -> aw.Scenario:
    """The scenario, gone on from a run."""
    first = scenario("", folder)
    return aw.Scenario(first.arm, 0.005, loop=first.loop, start=run)


def outcome(path: Path, number: int, folder: Path) -> str:
    """ "accepted", "refused", or the traceback's end and the function that it came from."""
    refused = False
    for name, use in uses(path, number, folder).items():
        try:
            use()
        except ArmwrightError as error:
            refused = True
            lines = str(error).splitlines()
            if len(lines) != len(error.problems) + (len(error.problems) > 1) or max(map(len, lines)) > 2000:
                return f"{name}: not a short line a problem: {str(error)[:300]!r}"
        except Exception as error:  # noqa: BLE001 - that there is none is what is tested
            return f"{name}: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return "refused" if refused else "accepted"


def main(folder: Path, first: int, last: int) -> None:
    """Prints the outcome of each number."""
    faulthandler.enable()
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for number in range(first, last):
        print(number, end=" ", flush=True)
        signal.setitimer(signal.ITIMER_PROF, PATIENCE)
        print(outcome(damaged(number, folder), number, folder), flush=True)
    signal.setitimer(signal.ITIMER_PROF, 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
