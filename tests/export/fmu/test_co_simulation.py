"""FMUs for co-simulation in FMPy give the bits of `aw.simulate`: plants, controllers, both together, and both connected."""

from dataclasses import replace

import numpy as np
import pytest
from export.controllers import CONTROLLERS

import armwright as aw

pytest.importorskip("fmpy", reason="the extra fmu and fmpy are not installed")
from export.fmu.fmus import Instance  # noqa: E402

ARMS = ("two-link", "puma560", "lwa4p", "cmu-dd", "panda")


def commanded(arm, ticks, seed=0, **scenario):
    """A scenario of random commands, each held for a tick of 1 ms."""
    rows = np.random.default_rng(seed).normal(scale=2.0, size=(ticks, arm.n))
    return aw.Scenario(
        arm, duration=1e-3 * ticks, command=aw.Schedule(np.arange(ticks) * 1e-3, rows, arm.names), **scenario
    )


def states(path, run, ticks, period, **inputs):
    """States (ticks + 1, size) of a plant FMU under a run's commands and further inputs (ticks, entries), by prefix."""
    fmu = Instance(path)
    fmu.begin()
    given = {"u": run.u.values, **inputs}
    names = {prefix: fmu.names(prefix, "input") for prefix in given}
    x = fmu.names("x", "output")
    rows = [fmu.get(*x)]
    for k in range(ticks):
        for prefix, values in given.items():
            for name, value in zip(names[prefix], values[k], strict=True):
                fmu.set(name, value)
        fmu.step(k * period, period)
        rows.append(fmu.get(*x))
    assert fmu.messages == []
    fmu.close()
    return np.array(rows)


@pytest.mark.parametrize(
    ("name", "version"), [*((name, "3.0") for name in ARMS), ("two-link", "2.0"), ("puma560", "2.0")]
)
def test_a_plant_moves_as_simulated(name, version, tmp_path):
    arm = aw.load(name)
    scenario = commanded(arm, 100)
    run = aw.simulate(scenario)
    exported = aw.export_fmu(scenario, tmp_path / "plant.fmu", platforms=["host"], version=version)
    x = states(exported.path, run, 100, 1e-3)
    np.testing.assert_array_equal(x[:, : arm.n], run.q.values)
    np.testing.assert_array_equal(x[:, arm.n : 2 * arm.n], run.qd.values)
