"""Datasets and the files they are saved in: units, round trips, whole files or none."""

import builtins
import importlib.util
import itertools
import os
import stat
import subprocess
import sys

import numpy as np
import pandas
import pytest
import xarray as xr

from armwright.errors import ABSENT, OutputError, RunError
from armwright.model.joint_signals import joint_units
from armwright.results.recording import ENDINGS, make_dataset, run_units, save, wide
from armwright.results.run_file import load_run
from raises_at import raises_at
from simulation.runs import invented, mixed_arm

NEEDS_A_USER = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write everywhere"
)


@pytest.fixture
def arm(tmp_path):
    return mixed_arm(tmp_path)


@pytest.fixture
def folder(tmp_path):
    """An empty folder."""
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


def test_units_and_names(arm):
    run = invented(arm)
    assert dict(run.sizes) == {"time": 41, "joint": 3}
    assert run.attrs["robot"] == "lathe"
    assert list(run["joint"].values) == ["turn", "slide", "hinge"]
    assert list(run["kind"].values) == ["revolute", "prismatic", "revolute"]
    assert list(run["command"].values) == ["voltage", "torque", "current"]
    units = {name: run[name].attrs["units"] for name in ("time", "q", "qd", "qdd", "u", "tau", "voltage", "current")}
    assert units == {
        "time": "s",
        "q": "rad | m",
        "qd": "rad/s | m/s",
        "qdd": "rad/s² | m/s²",
        "u": "V | N | A",
        "tau": "N m | N",
        "voltage": "V",
        "current": "A",
    }
    assert all(variable.attrs["long_name"] for variable in run.variables.values())
    assert run_units(run, "u") == joint_units(arm, "u") == ["V", "N", "A"]
    assert run_units(run, "q") == joint_units(arm, "q") == ["rad", "m", "rad"]
    # of sensors and controllers: only the attribute says what they are
    measured = run.rename(q="q_measured", u="u_issued")
    assert run_units(measured, "q_measured") == ["rad", "m", "rad"]
    assert run_units(measured, "u_issued") == ["V", "N", "A"]
    assert "q_measured_slide [m]" in wide(measured)


def test_what_no_motor_constant_tells_is_nan_or_left_out(arm):
    run = invented(arm)
    assert np.isfinite(run["voltage"].sel(joint="turn")).all()
    assert np.isnan(run["voltage"].sel(joint=["slide", "hinge"])).all()
    assert np.isnan(run["current"].sel(joint="slide")).all()
    assert np.isfinite(run["current"].sel(joint=["turn", "hinge"])).all()
    q = np.zeros((2, 3))
    assert "voltage" not in make_dataset(arm, np.arange(2.0), q, q, q)


def test_voltage_is_left_out_where_no_joint_has_constants():
    import armwright as aw

    arm = aw.load("two-link")
    q = np.zeros((2, 2))
    run = make_dataset(arm, np.arange(2.0), q, q, q, voltage=np.full((2, 2), np.nan), current=np.full((2, 2), np.nan))
    assert "voltage" not in run
    assert "current" not in run


@pytest.mark.parametrize("lanes", [None, 3])
def test_netcdf_round_trip(arm, folder, lanes):
    run = invented(arm, lanes)
    save(run, folder / "run.nc")
    assert load_run(folder / "run.nc").identical(run)
    assert [entry.name for entry in folder.iterdir()] == ["run.nc"]


@pytest.mark.parametrize("lanes", [None, 3])
@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_wide_files(arm, folder, lanes, ending):
    if ending == ".parquet":
        pytest.importorskip("pyarrow")
    run = invented(arm, lanes)
    path = folder / f"run{ending}"
    save(run, path)
    frame = pandas.read_csv(path) if ending == ".csv" else pandas.read_parquet(path)
    heads = ["lane"] * bool(lanes) + ["t [s]", "q_turn [rad]", "q_slide [m]", "q_hinge [rad]", "qd_turn [rad/s]"]
    assert list(frame.columns)[: len(heads)] == heads
    assert {"u_turn [V]", "u_slide [N]", "u_hinge [A]", "tau_slide [N]", "qdd_slide [m/s²]"} <= set(frame.columns)
    assert len(frame) == 41 * (lanes or 1)
    q = run["q"].sel(joint="slide")
    for lane in range(lanes or 1):
        rows = frame[frame["lane"] == lane] if lanes else frame
        np.testing.assert_allclose(rows["t [s]"], run["time"], rtol=1e-15)
        np.testing.assert_allclose(rows["q_slide [m]"], q.isel(lane=lane) if lanes else q, rtol=1e-15)
    assert frame["voltage_slide [V]"].isna().all()


def test_parquet_remembers_units_and_attributes(arm, folder):
    parquet = pytest.importorskip("pyarrow.parquet")
    save(invented(arm), folder / "run.parquet")
    schema = parquet.read_schema(folder / "run.parquet")
    assert schema.field("q_slide [m]").metadata == {b"unit": b"m"}
    assert b'"robot": "lathe"' in schema.metadata[b"armwright"]


def test_variables_without_joints_stay_out_of_wide_files(arm, folder):
    run = invented(arm, 3)
    run["diverged_at"] = ("lane", np.array([np.nan, 1.0, np.nan]))
    save(run, folder / "run.csv")
    assert not any("diverged" in head for head in pandas.read_csv(folder / "run.csv").columns)
    save(run, folder / "run.nc")
    assert load_run(folder / "run.nc").identical(run)


@pytest.mark.parametrize("name", ["run.NC", "run.CSV"])
def test_endings_in_capitals(arm, folder, name):
    save(invented(arm), folder / name)
    assert (folder / name).stat().st_size > 0


def refused(run, path):
    with pytest.raises(OutputError) as error:
        save(run, path)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{path}: ")
    return str(error.value)


def test_refused_destinations(arm, folder):
    run = invented(arm)
    assert "the ending '.xls' is not offered; expected .nc, .csv, .parquet, .mcap or .mat" in refused(
        run, folder / "run.xls"
    )
    assert "has no ending; expected .nc" in refused(run, folder / "run")
    assert "there is no folder" in refused(run, folder / "nowhere" / "run.nc")
    (folder / "folder.nc").mkdir()
    assert "is a folder" in refused(run, folder / "folder.nc")
    (folder / "file").write_text("")
    assert "there is no folder" in refused(run, folder / "file" / "run.nc")
    assert "File name too long" in refused(run, folder / f"{'long' * 100}.nc")
    assert {entry.name for entry in folder.iterdir()} == {"folder.nc", "file"}


@NEEDS_A_USER
def test_no_permission(arm, folder):
    folder.chmod(0o500)
    assert "no permission" in refused(invented(arm), folder / "run.nc")
    folder.chmod(0o700)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_not_replaced(arm, folder):
    os.mkfifo(folder / "run.csv")
    assert "no plain file" in refused(invented(arm), folder / "run.csv")
    assert stat.S_ISFIFO((folder / "run.csv").stat().st_mode)


def test_parquet_without_pyarrow(arm, folder, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pyarrow" else find(name))
    assert "pip install armwright[logs]" in refused(invented(arm), folder / "run.parquet")


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_failure_half_way_leaves_what_was_there(arm, folder, monkeypatch, ending):
    path = folder / f"run{ending}"
    path.write_bytes(b"before")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    assert "cannot be written: No space left on device" in refused(invented(arm), path)
    assert [entry.name for entry in folder.iterdir()] == [path.name]
    assert path.read_bytes() == b"before"


@pytest.mark.sample(1)
@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on file sizes")
@pytest.mark.parametrize("ending", ENDINGS)
def test_a_disk_that_fills_up(arm, folder, ending):
    """A real one: the process may write 20 kB a file, which the run exceeds."""
    save(invented(arm, 60), folder / "whole.nc")
    script = f"""
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from armwright.results.recording import save
from armwright.results.run_file import load_run
from armwright.errors import OutputError
run = load_run({str(folder / "whole.nc")!r})
import pandas, h5netcdf
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
try:
    save(run, {str(folder / ("run" + ending))!r})
except OutputError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "cannot be written" in done.stdout
    assert len(done.stdout.splitlines()) == 1
    assert [entry.name for entry in folder.iterdir()] == ["whole.nc"]


def test_an_interrupt_leaves_no_file(arm, folder, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(xr.Dataset, "to_netcdf", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save(invented(arm), folder / "run.nc")
    assert list(folder.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_behind_a_link_the_file_is_replaced(arm, folder):
    (folder / "real.nc").write_bytes(b"before")
    (folder / "link.nc").symlink_to("real.nc")
    save(invented(arm), folder / "link.nc")
    assert (folder / "link.nc").is_symlink()
    assert load_run(folder / "real.nc").sizes["time"] == 41


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_permissions_are_those_of_any_new_file(arm, folder):
    with builtins.open(folder / "other", "w"):
        pass
    save(invented(arm), folder / "run.csv")
    assert (folder / "run.csv").stat().st_mode == (folder / "other").stat().st_mode


def test_load_run_refuses(folder):
    path = folder / "run.nc"
    for file, what, expected in (
        (path, "no such file", "a run saved as .nc"),
        (folder, "a folder", "a run saved as .nc"),
    ):
        with pytest.raises(RunError) as error:
            load_run(file)
        assert (error.value.file, error.value.what, error.value.expected) == (str(file), what, expected)
    path.write_text("hello")
    with raises_at(RunError, file=path) as error:
        load_run(path)
    assert error.value.expected == "NetCDF 4"


def _columns(run):
    return {head: np.asarray(values).astype(str).tolist() for head, values in wide(run).items()}  # nan equals nan


@pytest.mark.parametrize("lanes", [None, 3])
def test_the_order_of_dimensions_does_not_matter(arm, lanes):
    """Transposed values keep their joint, time and lane."""
    run = invented(arm, lanes=lanes)
    for order in itertools.permutations(run.dims):
        assert _columns(run.transpose(*order)) == _columns(run)


@pytest.mark.parametrize("lanes", [None, 3])
@pytest.mark.parametrize(
    "part", [{"joint": 0}, {"time": -1}, {"time": -1, "joint": 1}, {"joint": [2, 0]}, {"time": [4]}]
)
@pytest.mark.parametrize("transposed", [False, True])
def test_parts_of_a_run_are_saved(arm, folder, lanes, part, transposed):
    """What was selected is what the table holds, a single joint or time included."""
    run = invented(arm, lanes=lanes)
    kept = {dim: [k] if isinstance(k, int) else k for dim, k in part.items()}
    expected = _columns(run.isel(kept))
    chosen = run.isel(part)
    assert _columns(chosen.transpose(*reversed(list(chosen.dims))) if transposed else chosen) == expected
    if "time" not in part and lanes is None:
        assert [head for head in expected if head.startswith("u_")] == [
            f"u_{run['joint'].values[k]} [{run_units(run, 'u')[k]}]" for k in kept["joint"]
        ]
    save(chosen, folder / "run.csv")
    assert pandas.read_csv(folder / "run.csv").columns.tolist() == list(expected)


def test_what_belongs_to_a_lane_is_no_column_of_a_part(arm):
    run = invented(arm, lanes=3)
    run["diverged_at"] = ("lane", np.full(3, np.nan))
    assert "diverged_at" not in "".join(_columns(run.isel(time=-1)))


@pytest.mark.parametrize(
    ("thing", "what", "value"),
    [
        (lambda run: None, "", None),
        (lambda run: run.mean("time"), "no coordinate 'time'", ABSENT),
        (lambda run: run.isel(joint=0, drop=True), "no coordinate 'joint'", ABSENT),
        (lambda run: run.expand_dims("case"), "along case, time, joint", ABSENT),
    ],
)
def test_what_is_no_run_is_refused(arm, folder, thing, what, value):
    from armwright.results.plot import plot

    for write, name in ((save, "run.csv"), (plot, "run.png")):
        with pytest.raises(RunError) as error:
            write(thing(invented(arm)), folder / name)
        assert (error.value.what, error.value.value) == (what, value)
        assert error.value.expected
    assert list(folder.iterdir()) == []
