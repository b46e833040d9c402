"""Sweeps: the bits of one run whatever the chunks, resumption after kills, and refusals."""

import contextlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import ArmwrightError, OutputError, RunError, ScenarioError
from armwright.scenarios.file import parse_scenario
from armwright.sweeps.store import _text_digest
from raises_at import raises_at

distributed = pytest.importorskip("distributed", reason="the extra sweep is not installed")
zarr = pytest.importorskip("zarr", reason="the extra sweep is not installed")

LANES = 500  # no multiple of the chunks that are tried, nor of a tile
SCENARIO = """
robot = "two-link"
duration_s = 0.05
seed = 5

[solver]
integrator = "rk4"

[loop]
period_s = 1e-3
controller = { kind = "joint_pid", kp = 60.0, kd = 4.0 }
reference = { kind = "step", start = [0.0, 0.0], goal = [0.5, 0.2] }
timing = { jitter_s = 2e-4, measurement_loss = 0.05 }

[recording]
reduce = ["rms_error", "overshoot"]

[lanes]
kind = "draws"
count = 3
seed = 7
vary = { "forearm.mass_kg" = { normal = [1.0, 0.1] }, "start.q[0]" = { uniform = [-1.0, 1.0] } }
"""


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Two workers in this process: a cluster that starts at once."""
    with distributed.Client(
        processes=False, n_workers=2, threads_per_worker=1, dashboard_address=":0", set_as_default=False
    ) as client:
        yield client


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "arm.scenario.toml"
    path.write_text(SCENARIO)
    return path


def python_scenario(**changes: Any) -> aw.Scenario:
    arm = aw.load("two-link")
    given = {
        "duration": 0.05,
        "loop": aw.Loop(aw.JointPID(60.0, kd=4.0), aw.trajectories.Step([0.0, 0.0], [0.5, 0.2]), 1e-3),
        "start": aw.Start(aw.Draw.uniform([-1.0, -1.0], [1.0, 1.0])),
        "solver": aw.Solver("rk4"),
        "recording": aw.Recording(reduce=["rms_error", "overshoot"]),
        "lanes": 1,
    }
    return aw.Scenario(arm, **{**given, **changes})


def assert_same(stored: xr.Dataset, run: xr.Dataset) -> None:
    """Every result of a lane has the same bits; at least the reducers are there."""
    names = [name for name in stored.data_vars if "lane" in stored[name].dims and name != "finished"]
    assert {"rms_error", "overshoot", "diverged_at"} <= set(names)
    for name in names:
        np.testing.assert_array_equal(stored[name].values, run[name].values, err_msg=str(name))


@pytest.fixture(scope="module")
def whole() -> xr.Dataset:
    """All lanes of the file's scenario in one run."""
    from armwright.scenarios.files import FolderFiles

    parsed = parse_scenario(SCENARIO, "test", FolderFiles(Path()), range(LANES))
    return aw.simulate(parsed)


@pytest.mark.study
@pytest.mark.parametrize("chunk", [7 * 13, LANES])
def test_a_file_in_chunks_has_the_bits_of_one_run(
    chunk: int, file: Path, tmp_path: Path, client: Any, whole: xr.Dataset
) -> None:
    done = aw.sweeps.sweep(file, tmp_path / "runs.zarr", lanes=LANES, chunk=chunk, client=client)
    assert (done.done, done.kept, done.failed) == (LANES, 0, {})
    stored = done.load()
    assert stored["finished"].values.all()
    assert stored["joint"].values.tolist() == ["shoulder", "elbow"]
    assert_same(stored, whole)


@pytest.mark.study
def test_the_example_is_swept(tmp_path: Path, client: Any) -> None:
    example = Path(__file__).parents[2] / "examples" / "robust.scenario.toml"
    stored = aw.sweeps.sweep(example, tmp_path / "runs.zarr", lanes=40, chunk=20, client=client).load()
    assert (stored["rms_error"].values < 0.1).all()
    assert {"peak_error", "peak_torque", "saturation"} <= set(stored.data_vars)


def test_draws_of_a_file_do_not_depend_on_the_count(file: Path, whole: xr.Dataset) -> None:
    few = aw.simulate(aw.read_scenario(file))
    np.testing.assert_array_equal(few["rms_error"].values, whole["rms_error"].values[:3])


def test_a_python_scenario_with_draws_and_batches(tmp_path: Path, client: Any) -> None:
    masses = aw.Batch(np.linspace(0.8, 1.2, LANES))
    scenario = python_scenario(vary={"forearm.mass_kg": masses}, lanes=LANES)
    done = aw.sweeps.sweep(scenario, tmp_path / "runs.zarr", lanes=LANES, chunk=123, client=client)
    assert_same(done.load(), aw.simulate(scenario))
    with pytest.raises(ScenarioError, match="lane"):
        aw.sweeps.sweep(scenario, tmp_path / "more.zarr", lanes=LANES + 1, client=client)


def test_rows_are_stored_where_they_are_asked_for(tmp_path: Path, client: Any) -> None:
    scenario = python_scenario(recording=aw.Recording(every=10, what="state", reduce=["rms_error", "overshoot"]))
    done = aw.sweeps.sweep(scenario, tmp_path / "runs.zarr", lanes=20, chunk=7, rows=True, client=client)
    run = aw.simulate(replace(scenario, lanes=20))
    assert done.load()["q"].shape == (20, 6, 2)
    np.testing.assert_array_equal(done.load()["q"].values, run["q"].values)
    assert_same(done.load(), run)


def test_resumption_does_only_what_is_missing(file: Path, tmp_path: Path, client: Any, whole: xr.Dataset) -> None:
    """Killed between a chunk's data and its mark: the mark is not there, and the data may be half written."""
    path = tmp_path / "runs.zarr"
    aw.sweeps.sweep(file, path, lanes=LANES, chunk=100, client=client)
    (path / "chunk_mark" / "c" / "1" / "0").unlink()
    (path / "chunk_mark" / "c" / "3" / "0").unlink()
    (path / "rms_error" / "c" / "1" / "0").write_bytes(b"half")
    (path / "overshoot" / "c" / "3" / "0").unlink()
    half = aw.sweeps.load_sweep(path)
    assert half.attrs["lanes_finished"] == 300
    assert not half["finished"].values[100:200].any()
    assert np.isnan(half["steps_tried" if "steps_tried" in half else "overshoot"].values[300:400]).all()
    done = aw.sweeps.sweep(file, path, lanes=LANES, client=client)  # the store keeps its chunks of 100
    assert (done.done, done.kept, done.chunk) == (200, 300, 100)
    assert_same(done.load(), whole)
    assert aw.sweeps.sweep(file, path, lanes=LANES, client=client).done == 0


def test_damage_is_found_when_it_is_read(file: Path, tmp_path: Path, client: Any) -> None:
    path = tmp_path / "runs.zarr"
    aw.sweeps.sweep(file, path, lanes=20, chunk=10, client=client)
    part = path / "rms_error" / "c" / "1" / "0"
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    assert aw.sweeps.load_sweep(path, verify=True)["finished"].values.tolist() == [True] * 10 + [False] * 10
    unread = aw.sweeps.load_sweep(path)  # the size is right, so nothing is known yet
    assert unread["finished"].values.all()
    assert np.isfinite(unread["rms_error"][:10].values).all()
    with raises_at(RunError, match="chunk 1 of rms_error", file=path):
        unread.compute()
    assert CliRunner().invoke(app, ["sweep", str(file), "--lanes", "20", "-o", str(path), "--verify"]).exit_code == 1
    before = aw.sweeps.sweep(file, tmp_path / "whole.zarr", lanes=20, chunk=10, client=client).load()
    assert aw.sweeps.sweep(file, path, lanes=20, client=client).done == 10
    assert_same(aw.sweeps.load_sweep(path, verify=True), before)
    part.unlink()
    assert aw.sweeps.load_sweep(path).attrs["failed_chunks"] == "1: rms_error/c/1/0 is not there"
    assert aw.sweeps.sweep(file, path, lanes=20, client=client).done == 10
    assert_same(aw.sweeps.load_sweep(path, verify=True), before)


def test_other_sweeps_are_refused(file: Path, tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "runs.zarr"
    aw.sweeps.sweep(file, path, lanes=20, client=client)
    with pytest.raises(OutputError, match=r"runs\.zarr: .*lanes = 20"):
        aw.sweeps.sweep(file, path, lanes=30, client=client)
    file.write_text(SCENARIO.replace("kp = 60.0", "kp = 61.0"))
    with pytest.raises(OutputError, match="another scenario"):
        aw.sweeps.sweep(file, path, lanes=20, client=client)
    file.write_text(SCENARIO)
    group = zarr.open_group(path, mode="r+")
    about = json.loads(str(group.attrs["armwright_sweep"]).replace('"numpy": "', '"numpy": "0.'))
    del about["digest"]
    group.attrs["armwright_sweep"] = json.dumps(about | {"digest": _text_digest(about)})
    with raises_at(OutputError, match=r"numpy 0\.", file=path):
        aw.sweeps.sweep(file, path, lanes=20, client=client)
    other = tmp_path / "other.zarr"
    other.mkdir()
    with raises_at(OutputError, file=other):
        aw.sweeps.sweep(file, other, lanes=20, client=client)
    with raises_at(RunError, file=tmp_path / "none.zarr"):
        aw.sweeps.load_sweep(tmp_path / "none.zarr")
    with raises_at(RunError, file=other):
        aw.sweeps.load_sweep(other)


def test_checksums_of_python_scenarios_tell_them_apart() -> None:
    from armwright.sweeps.source import source_of

    same = [source_of(python_scenario(lanes=lanes)).digest for lanes in (1, 2)]
    assert same[0] == same[1]
    others = [
        python_scenario(seed=1),
        python_scenario(duration=0.06),
        python_scenario(start=aw.Start(aw.Draw.uniform([-1.0, -1.0], [1.0, 1.1]))),
        python_scenario(vary={"forearm.mass_kg": 1.1}),
        replace(python_scenario(), arm=aw.load("two-link").replace(friction=None)),
    ]
    assert len({same[0], *(source_of(each).digest for each in others)}) == 1 + len(others)


@pytest.mark.parametrize(
    ("changes", "match"),
    [({"lanes": 0}, "lanes = 0"), ({"lanes": 2.5}, "lanes = 2.5"), ({"chunk": 0}, "chunk"), ({"client": 3}, "client")],
)
def test_bad_arguments(changes: dict[str, Any], match: str, file: Path, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=match):
        aw.sweeps.sweep(file, tmp_path / "runs.zarr", **{"lanes": 5, **changes})


def test_a_scenario_that_reduces_nothing(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"recording\.reduce"):
        aw.sweeps.sweep(python_scenario(recording=aw.Recording()), tmp_path / "runs.zarr", lanes=5)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_keeps_what_is_done(
    file: Path, tmp_path: Path, client: Any, whole: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    from armwright.sweeps.store import SweepStore

    path, mark, left = tmp_path / "runs.zarr", SweepStore._mark, [2]

    def full(store: SweepStore, chunk: int, value: int) -> None:
        if not left[0]:
            raise OSError(28, "No space left on device")
        left[0] -= 1
        mark(store, chunk, value)

    with monkeypatch.context() as patched:
        patched.setattr(SweepStore, "_mark", full)
        with raises_at(OutputError, match="No space left.*kept", file=path):
            aw.sweeps.sweep(file, path, lanes=LANES, chunk=100, client=client)
    done = aw.sweeps.sweep(file, path, lanes=LANES, client=client)
    assert done.kept == 200
    assert_same(done.load(), whole)


@pytest.mark.sample(1)
@pytest.mark.parametrize("most", [0, 6000])
def test_files_that_the_system_refuses_to_write(
    most: int, file: Path, tmp_path: Path, client: Any, whole: xr.Dataset
) -> None:
    """A limit on the size of files, which Zarr meets as it meets a full disk: in the first file, or in a chunk of results."""
    resource = pytest.importorskip("resource", reason="no limits on the size of files here")
    # compiles, and keeps what it compiled
    aw.sweeps.sweep(file, tmp_path / "first.zarr", lanes=2 * LANES, client=client)
    path, before = tmp_path / "runs.zarr", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        with raises_at(OutputError, match="[Ff]ile too large", file=path) as refused:
            aw.sweeps.sweep(file, path, lanes=2 * LANES, chunk=2 * LANES, client=client, progress=False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "\n" not in str(refused.value)
    assert path.exists() == (most > 0)
    assert not list(tmp_path.glob(".armwright-*"))
    done = aw.sweeps.sweep(file, path, lanes=2 * LANES, client=client)
    assert done.kept == 0
    assert_same(done.load().isel(lane=slice(LANES)), whole)


def test_a_chunk_that_fails_is_marked_and_tried_again(tmp_path: Path, client: Any) -> None:
    """One lane's mass is drawn below 0, which no simulation takes; the chunks without it are done."""
    vary = {"forearm.mass_kg": aw.Draw.normal(1.0, 0.4)}
    scenario = python_scenario(vary=vary)
    done = aw.sweeps.sweep(scenario, tmp_path / "runs.zarr", lanes=300, chunk=60, retries=1, client=client)
    assert 0 < len(done.failed) < 5
    assert all("mass" in reason for reason in done.failed.values())
    stored = done.load()
    assert stored.attrs["lanes_finished"] == 300 - 60 * len(done.failed) == done.done
    assert stored.attrs["failed_chunks"].count("\n") == len(done.failed) - 1
    again = aw.sweeps.sweep(scenario, tmp_path / "runs.zarr", lanes=300, retries=0, client=client)
    assert (again.done, set(again.failed)) == (0, set(done.failed))


@pytest.mark.study
def test_workers_that_are_killed(file: Path, tmp_path: Path) -> None:
    """SIGKILL for a worker in the middle of its chunk: another one simulates the chunk, and no bit differs."""
    if not hasattr(signal, "SIGKILL"):
        pytest.skip("no SIGKILL here")
    from armwright.sweeps.cluster import connected, local_cluster

    path = tmp_path / "runs.zarr"
    killed: list[int] = []
    with local_cluster(2) as cluster, connected(cluster.scheduler_address) as client:
        client.wait_for_workers(2, timeout=60)

        def kill(done: int, lanes: int) -> None:
            if not killed:
                busy = client.run(os.getpid)
                killed.append(next(iter(busy.values())))
                os.kill(killed[0], signal.SIGKILL)

        done = aw.sweeps.sweep(file, path, lanes=600, chunk=50, client=client, progress=kill)
    assert killed
    assert (done.done, done.failed) == (600, {})
    from armwright.scenarios.files import FolderFiles

    run = aw.simulate(parse_scenario(SCENARIO, "t", FolderFiles(Path()), range(600)))
    assert_same(done.load(), run)


def test_no_scheduler(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("armwright.sweeps.cluster.PATIENCE", 0.5)
    store = tmp_path / "runs.zarr"
    arguments = ["sweep", str(file), "--lanes", "20", "-o", str(store), "--scheduler", "tcp://127.0.0.1:9"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "error: --scheduler = 'tcp://127.0.0.1:9': cannot be reached" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize("address", ["nonsense", "tcp://host:99999", "http://host:8786", "host:0"])
def test_no_address_of_a_scheduler_is_refused_at_once(address: str, file: Path, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=f"scheduler = '{address}'"):
        aw.sweeps.sweep(file, tmp_path / "runs.zarr", lanes=5, client=address)
    assert not (tmp_path / "runs.zarr").exists()


def test_a_chunk_takes_seconds_by_default() -> None:
    """Long runs have small chunks, so that a kill costs little, and short runs large ones, whose preparation is a small part."""
    from armwright.sweeps.sweep import ENDLESS, ENOUGH, LEAST, MOST, _usual_chunk

    for duration, count in ((0.05, 1e7), (5.0, 1e6), (100.0, 1e6), (5.0, 200_000)):
        scenario = python_scenario(duration=duration)
        lanes = _usual_chunk(scenario, int(count), 2)
        work = lanes * scenario.ticks * scenario.arm.n
        assert LEAST <= lanes <= MOST
        assert lanes > 0.95 * MOST or 0.5 * ENOUGH <= work <= 1.01 * ENDLESS * ENOUGH


@pytest.mark.parametrize("threads", [1, 2, 3, 16])
def test_every_thread_has_as_many_chunks(threads: int) -> None:
    """So that none waits at the end for the others: with 9 chunks of which two threads do 5 and 4, one waits for a tenth."""
    from armwright.sweeps.sweep import _usual_chunk

    for count in (200_000, 800_000, 1_600_000):
        chunk = _usual_chunk(python_scenario(duration=1.0), count, threads)
        assert -(-count // chunk) % threads == 0
    assert _usual_chunk(python_scenario(duration=1.0), 5, threads) == 5


def test_the_command(file: Path, tmp_path: Path, client: Any) -> None:
    store = tmp_path / "runs.zarr"
    aw.sweeps.sweep(file, store, lanes=20, chunk=10, client=client)
    result = CliRunner().invoke(app, ["sweep", str(file), "--lanes", "2e1", "-o", str(store)])
    assert result.exit_code == 0, result.stderr
    assert "0 of 20 lanes, 20 were there" in result.stdout
    other = tmp_path / "other.scenario.toml"
    other.write_text(SCENARIO.replace("kp = 60.0", "kp = 61.0"))
    for arguments, message in (
        ([str(file), "--lanes", "21"], "lanes = 20"),
        ([str(file), "--lanes", "0"], "error: --lanes = 0"),
        ([str(file), "--lanes", "0.5"], "error: --lanes"),
        (["two-link", "--lanes", "5"], ".scenario.toml"),
        ([str(other), "--lanes", "20"], "runs.zarr: holds a sweep of another scenario"),
    ):
        result = CliRunner().invoke(app, ["sweep", *arguments, "-o", str(store)])
        assert result.exit_code == 2
        assert message in result.stderr
        assert len(result.stderr.splitlines()) == 1
    assert aw.sweeps.load_sweep(store).attrs["lanes_finished"] == 20


def test_the_command_on_a_full_disk(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(
        sys.modules["armwright.sweeps.sweep"],
        "connected",
        lambda _: contextlib.nullcontext(SimpleNamespace(nthreads=dict)),
    )
    monkeypatch.setattr("armwright.sweeps.store.SweepStore._file", full)
    monkeypatch.setattr(sys.modules["armwright.sweeps.sweep"], "_results", lambda *_: iter([(0, {})]))
    result = CliRunner().invoke(app, ["sweep", str(file), "--lanes", "20", "-o", str(tmp_path / "runs.zarr")])
    assert result.exit_code == 2
    assert "runs.zarr: cannot be written: No space left on device; finished chunks are kept" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, client: Any) -> Path:
    """A folder with the scenario, a finished store of five chunks, and an unfinished one."""
    folder = tmp_path_factory.mktemp("written")
    (folder / "arm.scenario.toml").write_text(SCENARIO)
    aw.sweeps.sweep(folder / "arm.scenario.toml", folder / "whole.zarr", lanes=100, chunk=20, client=client)
    shutil.copytree(folder / "whole.zarr", folder / "half.zarr")
    for chunk in "13":
        (folder / "half.zarr" / "chunk_mark" / "c" / chunk / "0").unlink()
        (folder / "half.zarr" / "rms_error" / "c" / chunk / "0").unlink()
    return folder


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", range(100))
def test_damage_is_made_good_or_named(seed: int, written: Path, tmp_path: Path, client: Any) -> None:
    rng, path = np.random.default_rng(seed), tmp_path / "runs.zarr"
    shutil.copytree(written / ("whole.zarr" if seed % 2 else "half.zarr"), path)
    file = rng.choice(sorted(each for each in path.rglob("*") if each.is_file()))
    content = file.read_bytes()
    match rng.choice(["delete", "truncate", "flip", "swap", "foreign"]):
        case "delete":
            file.unlink()
        case "truncate":
            file.write_bytes(content[: rng.integers(len(content))])
        case "flip":
            at = int(rng.integers(len(content)))
            file.write_bytes(content[:at] + bytes([content[at] ^ (1 << int(rng.integers(8)))]) + content[at + 1 :])
        case "swap":
            other = rng.choice(sorted(each for each in path.glob("*/c/*/0") if each != file))
            file.write_bytes(other.read_bytes())
            other.write_bytes(content)
        case _:
            file.write_bytes(rng.bytes(50))
    result = file.parent.name != path.name and file.relative_to(path).parts[0] in (
        "rms_error",
        "overshoot",
        "chunk_mark",
    )
    repaired = result and file.name != "zarr.json"  # what is damaged in a chunk is not refused
    with contextlib.nullcontext() if repaired else contextlib.suppress(ArmwrightError):
        aw.sweeps.sweep(written / "arm.scenario.toml", path, lanes=100, client=client, progress=False)
        stored = aw.sweeps.load_sweep(path, verify=True)
        assert stored["finished"].values.all()
        xr.testing.assert_identical(stored.compute(), aw.sweeps.load_sweep(written / "whole.zarr").compute())


@pytest.mark.sample(1)
@pytest.mark.parametrize("copied", ["chunk_mark/c/1/0", "rms_error/c/1/0 chunk_mark/c/1/0", "zarr.json"])
def test_a_copy_of_another_store_over_this_one_that_was_cut_off(
    copied: str, written: Path, tmp_path: Path, client: Any
) -> None:
    """Data and marks of a sweep with another seed, each right by itself: none of it is believed."""
    other = tmp_path / "other.scenario.toml"
    other.write_text(SCENARIO.replace("seed = 7", "seed = 8"))
    aw.sweeps.sweep(other, tmp_path / "other.zarr", lanes=100, chunk=20, client=client, progress=False)
    path = tmp_path / "runs.zarr"
    shutil.copytree(written / "whole.zarr", path)
    for name in copied.split():
        shutil.copy(tmp_path / "other.zarr" / name, path / name)
    seen = aw.sweeps.load_sweep(path)
    if copied == "zarr.json":
        assert not seen["finished"].values.any()
        with raises_at(OutputError, match="another scenario", file=path):
            aw.sweeps.sweep(written / "arm.scenario.toml", path, lanes=100, client=client, progress=False)
        return
    assert seen["finished"].values.tolist() == [True] * 20 + [False] * 20 + [True] * 60
    assert np.isnan(seen["rms_error"].values[20:40]).all()
    assert aw.sweeps.sweep(written / "arm.scenario.toml", path, lanes=100, client=client, progress=False).done == 20
    xr.testing.assert_identical(
        aw.sweeps.load_sweep(path).compute(), aw.sweeps.load_sweep(written / "whole.zarr").compute()
    )


@pytest.mark.sample(1)
@pytest.mark.parametrize("folder", ["chunk_mark", "rms_error"])
def test_chunks_that_were_exchanged(folder: str, written: Path, tmp_path: Path, client: Any) -> None:
    path = tmp_path / "runs.zarr"
    shutil.copytree(written / "whole.zarr", path)
    one, two = (next((path / folder / "c" / str(k)).rglob("0")) for k in (1, 3))
    first, second = one.read_bytes(), two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)
    expected = [True] * 20 + [False] * 20 + [True] * 20 + [False] * 20 + [True] * 20
    assert aw.sweeps.load_sweep(path, verify=True)["finished"].values.tolist() == expected
    assert aw.sweeps.sweep(written / "arm.scenario.toml", path, lanes=100, client=client, progress=False).done == 40
    xr.testing.assert_identical(
        aw.sweeps.load_sweep(path).compute(), aw.sweeps.load_sweep(written / "whole.zarr").compute()
    )


@pytest.mark.parametrize(
    ("old", "new"), [(r'"chunk\": 20', r'"chunk\": 10'), (r'"lanes\": 100', r'"lanes\": 900'), ("Planar", "Linear")]
)
def test_metadata_with_another_number(old: str, new: str, written: Path, tmp_path: Path, client: Any) -> None:
    path = tmp_path / "runs.zarr"
    shutil.copytree(written / "whole.zarr", path)
    text = (path / "zarr.json").read_text()
    assert old in text
    (path / "zarr.json").write_text(text.replace(old, new, 1))
    with raises_at(RunError, match="damaged", file=path):
        aw.sweeps.load_sweep(path)
    with raises_at(ArmwrightError, match="damaged", file=path):
        aw.sweeps.sweep(written / "arm.scenario.toml", path, lanes=100, client=client, progress=False)


def test_what_is_no_store_is_refused_in_one_line(written: Path, tmp_path: Path, client: Any) -> None:
    """Other stores, pipes, devices, a store of an earlier version, and names that no folder has."""
    for name in ("pipe", "old"):
        shutil.copytree(written / "whole.zarr", tmp_path / f"{name}.zarr")
    part = tmp_path / "pipe.zarr" / "rms_error" / "c" / "1" / "0"
    part.unlink()
    os.mkfifo(part)
    old = zarr.open_group(tmp_path / "old.zarr", mode="r+")
    old.attrs["armwright_sweep"] = str(old.attrs["armwright_sweep"]).replace('"form": 3', '"form": 1')
    zarr.create_group(tmp_path / "foreign.zarr")
    os.mkfifo(tmp_path / "alone.zarr")
    for path in (*tmp_path.iterdir(), Path("/dev/null"), tmp_path / f"{'a' * 300}.zarr"):
        for call in (
            aw.sweeps.load_sweep,
            lambda path: aw.sweeps.sweep(written / "arm.scenario.toml", path, lanes=100, client=client),
        ):
            with pytest.raises(ArmwrightError) as refused:
                call(path)
            assert "\n" not in str(refused.value)
