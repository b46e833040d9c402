"""FMUs for co-simulation in FMPy give the bits of `aw.simulate`: plants, controllers, both together, and both connected."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from export.controllers import CONTROLLERS, three_rates
from export.fmu.fmus import Instance, this_platform

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


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("name", "version"), [*((name, "3.0") for name in ARMS), ("two-link", "2.0"), ("puma560", "2.0")]
)
def test_a_plant_moves_as_simulated(name, version, tmp_path):
    arm = aw.load(name)
    scenario = commanded(arm, 100)
    run = aw.simulate(scenario)
    exported = aw.export.export_fmu(scenario, tmp_path / "plant.fmu", platforms=this_platform(), version=version)
    x = states(exported.path, run, 100, 1e-3)
    np.testing.assert_array_equal(x[:, : arm.n], run.q.values)
    np.testing.assert_array_equal(x[:, arm.n : 2 * arm.n], run.qd.values)


def rows_of(schedule, ticks, period):
    """Rows (ticks, entries) of a schedule at the ticks."""
    row = np.searchsorted(schedule.times, np.arange(ticks) * period * (1.0 + 1e-12), side="right") - 1
    return schedule.commands[row]


def blown(scenario, ticks):
    """The scenario with blows on the tip at ticks, and delays whose sums with a period are exact."""
    period = scenario.loop.period
    blows = np.random.default_rng(1).normal(scale=5.0, size=(ticks, 6)) * (np.arange(ticks)[:, None] % 3 == 1)
    wrench = aw.Schedule(10 * period * np.arange(ticks), blows, ("fx", "fy", "fz", "mx", "my", "mz"))
    delay = period / 2.0 if scenario.loop.timing.command_delay else 0.0
    loop = replace(scenario.loop, timing=replace(scenario.loop.timing, command_delay=delay))
    return replace(scenario, loop=loop, inputs=aw.Inputs(wrench=wrench))


def references(scenario, run, ticks):
    """Positions, speeds and accelerations (ticks, 3 n) of the scenario's reference."""
    from armwright.simulation.loop.references import reference_rows

    return reference_rows(scenario.arm, scenario.loop.reference, np.arange(ticks) * scenario.loop.period)


@pytest.mark.study
@pytest.mark.parametrize("name", CONTROLLERS)
def test_arm_and_controller_in_one_unit_do_what_was_simulated(name, tmp_path):
    """With delays, jitter, losses, noise, quantisation, clock drift, saturation and blows in the loop."""
    ticks = 120
    scenario = blown(CONTROLLERS[name](ticks), ticks)
    period, n = scenario.loop.period, scenario.arm.n
    run = aw.simulate(scenario)
    fmu = Instance(aw.export.export_fmu(scenario, tmp_path / "loop.fmu", part="both", platforms=this_platform()).path)
    given = {"r": references(scenario, run, ticks), "wrench": rows_of(scenario.inputs.wrench, ticks, period)}
    names = {prefix: fmu.names(prefix, "input") for prefix in given}
    x, y, u = (fmu.names(prefix, "output") for prefix in "xyu")
    fmu.begin()
    for k in range(ticks):
        np.testing.assert_array_equal(fmu.get(*x)[: 2 * n], np.concatenate([run.q[k], run.qd[k]]))
        np.testing.assert_array_equal(fmu.get(*y)[:n], run.q_measured[k])
        for prefix, values in given.items():
            for variable, value in zip(names[prefix], values[k], strict=True):
                fmu.set(variable, value)
        fmu.step(k * period, period)
        np.testing.assert_array_equal(fmu.get(*u), run.u_issued[k])
    fmu.close()


@pytest.mark.sample(1)
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_loops_at_their_own_rates_have_their_turns_as_simulated(version, tmp_path):
    ticks, scenario = 100, three_rates(100)
    run = aw.simulate(scenario)
    path = aw.export.export_fmu(
        scenario, tmp_path / "loop.fmu", part="both", platforms=this_platform(), version=version
    ).path
    fmu, r = Instance(path), references(scenario, run, ticks)
    fmu.begin()
    for k in range(ticks):
        for variable, value in zip(fmu.names("r", "input"), r[k], strict=True):
            fmu.set(variable, value)
        fmu.step(k * 1e-3, 1e-3)
        np.testing.assert_array_equal(fmu.get(*fmu.names("u", "output")), run.u_issued[k])
    fmu.close()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_plant_and_controller_connected_run_as_simulated_one_tick_later(name, tmp_path):
    """A unit that computes in a step has its outputs at the step's end: connected units add one tick to the command's delay."""
    ticks = 120
    scenario = blown(CONTROLLERS[name](ticks), ticks)
    loop, arm = scenario.loop, scenario.arm
    late = replace(loop.timing, command_delay=loop.timing.command_delay + loop.period)
    run = aw.simulate(replace(scenario, loop=replace(loop, timing=late)))
    plant, controller = (
        Instance(aw.export.export_fmu(scenario, tmp_path / f"{part}.fmu", part=part, platforms=this_platform()).path)
        for part in ("plant", "controller")
    )
    r, wrench = references(scenario, run, ticks), rows_of(scenario.inputs.wrench, ticks, loop.period)
    measured, commands = plant.names("y", "output"), plant.names("u", "input")
    assert measured == controller.names("y", "input")
    assert commands == controller.names("u", "output")
    plant.begin()
    controller.begin(**dict(zip(measured, plant.get(*measured), strict=True)))
    for k in range(ticks):
        np.testing.assert_array_equal(plant.get(*plant.names("x", "output"))[: arm.n], run.q[k])
        y, u = plant.get(*measured), controller.get(*commands)
        for unit, names, values in (
            (controller, measured, y),
            (controller, controller.names("r", "input"), r[k]),
            (plant, commands, u),
            (plant, plant.names("wrench", "input"), wrench[k]),
        ):
            for variable, value in zip(names, values, strict=True):
                unit.set(variable, value)
        for unit in (plant, controller):
            unit.step(k * loop.period, loop.period)
    plant.close()
    controller.close()
