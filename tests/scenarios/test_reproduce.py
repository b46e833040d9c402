"""Runs done again: parts of them, other shapes and coordinates, and what cannot be done again."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import Interrupted, RunError
from raises_at import raises_at

TEXT = 'robot = "two-link"\nduration_s = 0.02\nsolver.step_s = 1e-3\n'
DRIVEN = TEXT + "[commands]\nconstant = [20, 5]\n"


def saved(folder, run):
    aw.save(run, folder / "run.nc")
    return folder / "run.nc"


def scenario(folder, text=DRIVEN):
    (folder / "one.scenario.toml").write_text(text, encoding="utf-8")
    return aw.read_scenario(folder / "one.scenario.toml")


def test_a_changed_scenario_is_no_longer_the_files(tmp_path):
    changed = dataclasses.replace(scenario(tmp_path), duration=0.01)
    run = aw.simulate(changed)
    assert "scenario" not in run.attrs
    with pytest.raises(RunError, match="no scenario"):
        aw.reproduce(saved(tmp_path, run))


def test_shapes_and_coordinates_are_compared(tmp_path):
    run = aw.simulate(scenario(tmp_path))
    short = aw.reproduce(saved(tmp_path, run.isel(time=slice(11))))
    assert not short.same
    assert "q: shape (11, 2) then, (21, 2) now" in short.reshaped
    assert short.differences == {}
    late = aw.reproduce(saved(tmp_path, run.assign_coords(time=("time", 2.0 * run.time.values, run.time.attrs))))
    assert not late.same
    assert late.differences == {"time": pytest.approx(0.02)}


def test_what_a_run_was_made_with_must_be_readable(tmp_path):
    run = aw.simulate(scenario(tmp_path))
    run.attrs["made_with"] = "zzz"
    with raises_at(RunError, "made_with", value="zzz"):
        aw.reproduce(saved(tmp_path, run))


def test_nothing_is_left_behind(tmp_path, monkeypatch):
    names = ",".join(aw.load("two-link").names)
    (tmp_path / "u.csv").write_text(f"t,{names}\n0,20,5\n0.01,0,0\n")
    path = saved(tmp_path, aw.simulate(scenario(tmp_path, TEXT + '[commands]\nschedule = "u.csv"\n')))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    assert aw.reproduce(path).same
    assert list(Path(tmp_path / "temporary").iterdir()) == []


@pytest.mark.sample(1)
@pytest.mark.parametrize("lanes", [1, 2000])
def test_of_a_stopped_run_what_there_is_comes_again(tmp_path, lanes):
    text = DRIVEN.replace("duration_s = 0.02", "duration_s = 0.5")
    if lanes > 1:
        text += '[lanes]\nkind = "grid"\n[lanes.vary]\n"start.q[0]" = { start = 0, stop = 1, count = 2000 }\n'

    def stop(done, of):
        if (0.5 * of if lanes > 1 else 0) < done < of:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as stopped:
        aw.simulate(scenario(tmp_path, text), progress=stop, threads=1)
    path = saved(tmp_path, stopped.value.run)
    again = aw.reproduce(path)
    assert again.part.startswith("stopped by Ctrl-C after")
    assert again.same
    run = stopped.value.run
    run["q"] = run["q"] + 1e-9
    changed = aw.reproduce(saved(tmp_path, run))
    np.testing.assert_allclose(list(changed.differences.values()), 1e-9, rtol=1e-5)
