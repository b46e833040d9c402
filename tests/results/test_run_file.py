"""Files of runs: what opens them opens nothing else, and what is no run is refused in one line, whoever opens it."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import armwright as aw
from armwright import terminal
from armwright.errors import ArmwrightError, RunError, ScenarioError
from armwright.pictures.terminal import show_runs
from armwright.results.run_file import SEAL, SEAL_LENGTH
from cli.test_bad_input import refused
from raises_at import raises_at
from results import damaged_runs

FILES = 16  # two of each way of damage
TESTS = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of three lanes."""
    return damaged_runs.sound(1, tmp_path_factory.mktemp("sound"))


def written(run, path, *, sealed=False):
    """The run as another program writes it; sealed: as a forger makes it look like ours."""
    run.to_netcdf(path, engine="h5netcdf")
    if sealed:
        seal(path)
    return path


def seal(path):
    data = path.read_bytes()
    path.write_bytes(data + SEAL + hashlib.sha256(data).hexdigest().encode())


@pytest.mark.study
def test_damaged_and_foreign_files_are_refused_in_one_line(tmp_path):
    """Or accepted where the damage does no harm; by every function, in a process of limited memory that may crash."""
    outcomes, first = {}, 0
    while first < FILES:
        command = [sys.executable, "-m", "results.damaged_runs", str(tmp_path), str(first), str(FILES)]
        path = os.pathsep.join([str(TESTS), str(TESTS.parent / "src")])
        done = subprocess.run(
            command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}, check=False
        )
        lines = [line.partition(" ") for line in done.stdout.splitlines()]
        outcomes |= {int(number): what or done.stderr[-500:] for number, _, what in lines}
        first = int(lines[-1][0]) + 1 if lines else FILES
    assert len(outcomes) == FILES, done.stderr[-2000:]
    assert {n: what for n, what in outcomes.items() if what not in ("accepted", "refused")} == {}
    assert 0.5 < sum(what == "refused" for what in outcomes.values()) / FILES < 1.0


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda run: run.drop_vars("kind"), "no coordinate 'kind'"),
        (
            lambda run: run.assign_coords(time=run.time.values[::-1]),
            r"time\[1\] = .*: behind 0.02; .*increasing values",
        ),
        (lambda run: run.assign_coords(time=np.full(21, np.nan)), r"time\[0\] = nan: .*finite number"),
        (lambda run: run.assign(q=run.q.astype(str)), "q: <U.* values; .*real numbers"),
        (lambda run: run.assign(q=run.q.isel(joint=0)), "q: along lane, time; "),
        (lambda run: run.assign_coords(joint=["a", "a"]), "joint = 'a': occurs twice"),
        (
            lambda run: run.assign_coords(kind=("joint", ["ball", "revolute"])),
            "kind = 'ball'",
        ),
        (lambda run: run.assign_attrs(notes=5), "attribute notes = 5: .*text"),
        (lambda run: run.assign_attrs(step_s="x"), "attribute step_s = 'x': .*finite number"),
        (
            lambda run: xr.Dataset({"air": ("lat", np.zeros(3))}),
            "no coordinate 'joint'; ",
        ),
    ],
)
def test_every_function_names_what_is_wrong(tmp_path, run, change, said):
    bad, arm = change(run), aw.load("two-link")
    path = written(bad, tmp_path / "run.nc", sealed=True)
    for use in (
        lambda: aw.load_run(path),
        lambda: aw.reproduce(path),
        lambda: aw.plot(bad, tmp_path / "run.html"),
        lambda: aw.animate(bad, arm, tmp_path / "run.glb", lane=0),
        lambda: aw.statistics(bad),
        lambda: aw.save(bad, tmp_path / "again.nc"),
        lambda: aw.Scenario(arm, 0.01, command=[0, 0], start=bad),
    ):
        with pytest.raises((RunError, ScenarioError), match=said):
            use()
    for command in (("plot", path), ("animate", path, "-o", tmp_path / "run.glb"), ("reproduce", path)):
        assert "run.nc" in refused(command)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.nc"]


HARD = {
    "formula": lambda run: run.assign_attrs(robot="$x^{$"),
    "control": lambda run: run.assign_coords(joint=["a\x1b[2J\0\ud800", "b"]),
    "nan": lambda run: run.assign(q=run.q * np.nan),
    "large": lambda run: run.assign(q=run.q * 0.0 + 1e308),
    "fast": lambda run: run.assign(q=run.q * 1e12),
    "late": lambda run: run.assign_coords(time=np.linspace(-1.0, 1.0, 21) * 1.7e308),
    "whole": lambda run: run.assign(q=run.q.astype(int)),
    "one row": lambda run: run.isel(time=[0]),
    "no row": lambda run: run.isel(time=slice(0)),
    "no joint": lambda run: run.isel(joint=slice(0)),
    "no lane": lambda run: run.isel(lane=slice(0)),
    "lane": lambda run: run.assign_coords(lane=[0.5, -1.0, 2.0]),
}


@pytest.mark.sample(1)
@pytest.mark.filterwarnings("error:.*(overflow|invalid value|cast)")
@pytest.mark.parametrize("change", HARD.values(), ids=HARD)
def test_what_is_hard_to_draw_is_drawn_or_refused(tmp_path, run, change):
    bad, arm = change(run), aw.load("two-link")
    for use in (
        lambda: aw.plot(bad, tmp_path / "run.png"),
        lambda: aw.plot(bad, tmp_path / "run.html"),
        lambda: show_runs(bad, terminal.console(file=io.StringIO(), width=120)),
        lambda: aw.animate(bad, arm, tmp_path / "run.glb", lane=0),
        lambda: aw.statistics(bad),
    ):
        with contextlib.suppress(ArmwrightError):
            use()


@pytest.mark.study
def test_files_of_other_programs_are_read_if_they_are_runs(tmp_path, run):
    assert aw.load_run(written(run, tmp_path / "run.nc")).identical(run)


def test_a_saved_file_has_a_checksum_that_other_readers_pass_over(tmp_path, run):
    path = tmp_path / "run.nc"
    aw.save(run, path)
    assert path.read_bytes()[-SEAL_LENGTH:].startswith(SEAL)
    assert xr.load_dataset(path, engine="h5netcdf").identical(run)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with raises_at(RunError, match="checksum", file=path):
        aw.load_run(path)


@pytest.mark.study
def test_a_file_that_was_changed_by_another_program_is_read(tmp_path, run):
    path = tmp_path / "run.nc"
    aw.save(run, path)
    with h5py.File(path, "r+") as file:
        file["q"][0, 0, 0] = 7.0
    assert float(aw.load_run(path).q[0, 0, 0]) == 7.0


@pytest.mark.sample(1)
@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.parametrize("way", ["external", "link", "virtual", "huge", "texts"])
def test_data_elsewhere_and_absurd_sizes_are_refused_before_they_are_read(tmp_path, run, way, sealed):
    path, secret = written(run, tmp_path / "run.nc"), tmp_path / "secret"
    secret.write_bytes(b"secret!!" * 30)
    with h5py.File(path, "r+") as file:
        del file["heat"]
        if way == "external":
            file.create_dataset("heat", (30,), dtype=float, external=[(str(secret), 0, 240)])
        elif way == "link":
            file["heat"] = h5py.ExternalLink(str(secret), "/heat")
        elif way == "virtual":
            layout = h5py.VirtualLayout((30,), float)
            layout[:] = h5py.VirtualSource(str(secret), "heat", (30,))
            file.create_virtual_dataset("heat", layout)
        elif way == "huge":
            file.create_dataset("heat", (10**6, 10**6), chunks=(100, 100), dtype=float)
        else:
            file.create_dataset("heat", (10**6,), chunks=(1000,), dtype=h5py.string_dtype())
    if sealed:
        seal(path)
    with raises_at(RunError, match=": heat ", file=path):
        aw.load_run(path)


def test_pipes_and_folders_are_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.nc")
    for name, what in (
        ("pipe.nc", "no plain file"),
        (".", "a folder"),
        ("none.nc", "no such file"),
        ("x" * 300, "no such file"),
    ):
        with pytest.raises(RunError, match=what):
            aw.load_run(tmp_path / name)


@pytest.mark.sample(11)
@pytest.mark.parametrize("seed", range(40))
def test_damaged_states_are_refused(tmp_path, seed):
    random = np.random.default_rng(seed)
    simulation = aw.simulation.Simulation(aw.Scenario(aw.load("two-link"), 0.01, command=[1, 1]))
    simulation.state.save(tmp_path / "state.npz")
    data = bytearray((tmp_path / "state.npz").read_bytes())
    for at in random.integers(len(data), size=1 + seed % 4):
        data[at] = random.integers(256)
    (tmp_path / "state.npz").write_bytes(data[: random.integers(len(data))] if seed % 5 == 0 else data)
    with contextlib.suppress(ArmwrightError):
        state = aw.simulation.LoopState.load(tmp_path / "state.npz")
        aw.Scenario(aw.load("two-link"), 0.01, command=[1, 1], start=state)
