"""Logs of simulated runs: what `read_log` finds in them is what was simulated."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import LogError
from raises_at import raises_at


def simulated(name="lwa4p", sensors=None, lanes=False):
    arm = aw.load(name)
    law = aw.Cascade(2.0, 20.0) if not lanes else aw.Cascade(aw.Batch([2.0, 3.0]), 20.0)
    reference = aw.trajectories.Quintic(np.zeros(arm.n), 0.1 * np.ones(arm.n), 0.2)
    loop = aw.Loop(law, reference, 2e-3, sensors or aw.Sensors())
    scenario = aw.Scenario(arm, 0.3, loop=loop)
    return arm, aw.simulate(scenario)


@pytest.mark.sample(1)
@pytest.mark.parametrize("ending", ["csv", "nc", "parquet"])
def test_a_run_is_read_back_as_a_log(ending, tmp_path):
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    arm, run = simulated(sensors=aw.Sensors(counts=4096, current_noise=0.01))
    aw.save(run, tmp_path / f"run.{ending}")
    aw.identification.write_log(run, tmp_path / f"run.{ending}", tmp_path / "arm.log.toml", arm)
    log = aw.identification.read_log(tmp_path / "arm.log.toml")
    assert log.arm.names == arm.names
    assert log.errors == ()
    blocks = list(log.blocks())
    for signal, measured in (("q", run.q_measured), ("current", run.current_measured)):
        rows = np.concatenate([block.values[signal] for block in blocks])
        np.testing.assert_array_equal(rows, measured.values)


def test_a_second_run_is_held_out_and_a_run_of_the_same_name_replaced(tmp_path):
    arm, run = simulated()
    for name in ("a", "b"):
        aw.save(run, tmp_path / f"{name}.csv")
    path = aw.identification.write_log(run, tmp_path / "a.csv", tmp_path / "arm.log.toml", arm)
    for _ in range(2):
        aw.identification.write_log(run, tmp_path / "b.csv", path, arm, hold_out=True)
    assert [(each.name, each.use) for each in aw.identification.read_log(path).runs] == [
        ("a", "fit"),
        ("b", "hold-out"),
    ]
    text = path.read_text()
    with raises_at(LogError, "robot", "log of others"):
        aw.identification.write_log(run, tmp_path / "b.csv", path, aw.load("puma560"))
    assert path.read_text() == text


def test_torque_drives_have_torques_and_no_currents(tmp_path):
    arm, run = simulated("two-link")
    aw.save(run, tmp_path / "run.csv")
    text = aw.identification.write_log(run, tmp_path / "run.csv", tmp_path / "arm.log.toml", arm).read_text()
    assert 'quantity = "torque"' in text
    assert "held = true" in text


def heavier(arm):
    return arm.with_payload(1.0, [0, 0, 0], [0, 0, 0])


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (lambda run, arm, path: (run, path / "run.mat", path / "x.log.toml", arm), r"rows.*\.csv, \.nc, \.parquet"),
        (lambda run, arm, path: (run, path.parent / "run.csv", path / "x.log.toml", arm), "not below"),
        (lambda run, arm, path: (run, path / "run.csv", path / "x.log.toml", heavier(arm)), "neither"),
        (lambda _, arm, path: (simulated(lanes=True)[1], path / "run.csv", path / "x.log.toml", arm), "2 lanes"),
    ],
)  # fmt: skip
def test_refused(arguments, said, tmp_path):
    arm, run = simulated()
    with pytest.raises(LogError, match=said):
        aw.identification.write_log(*arguments(run, arm, tmp_path))
    assert list(tmp_path.iterdir()) == []
