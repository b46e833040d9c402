"""Plants with every effect and rule, their inputs, starts and states: to the bit in FMPy."""

import numpy as np
import pytest

import armwright as aw
from export.fmu.fmus import Instance, this_platform
from export.fmu.test_co_simulation import commanded, states
from features.cases import SCENARIOS, base
from simulation.plants import BRAKE, COULOMB, MANY, MOTOR, pendulum
from simulation.sticking import block, dry
from simulation.test_servo import PLAIN, pendulum as servo
from simulation.test_switching import PLAY, STOPS

TICKS = 60
LOADED = {  # as a servo's
    **{key: value for key, value in COULOMB.items() if key.startswith("coulomb")},
    "law": "load-dependent",
    "stribeck_torque_n_m": 0.8,
    "stribeck_speed_rad_per_s": 0.5,
    "stribeck_exponent": 1.4,
    "load_motor": 0.2,
    "load_external": 0.1,
    "load_motor_stribeck": 0.05,
    "load_external_stribeck": 0.08,
    "load_motor_quadratic_per_n_m": 0.01,
    "load_external_quadratic_per_n_m": 0.02,
}
BETWEEN = {"stops": STOPS, "limits": {"position_rad": [-0.02, 0.02]}}
PLANTS = {
    "all, auto": (MANY["all"], aw.Solver()),
    "all, rodas3": (MANY["all"], aw.Solver("rodas3")),
    "harmonic, rk4": (MANY["harmonic"], aw.Solver("rk4", step=1e-4)),
    "load, rk45": (MANY["load"], aw.Solver("rk45")),
    "friction by loads, rk3": (pendulum(motor=MOTOR, friction=LOADED), aw.Solver(step=1e-3)),
    "friction by loads, auto": (pendulum(motor=MOTOR, friction=LOADED), aw.Solver()),
    "supply, semi-implicit": (MANY["supply"], aw.Solver("semi_implicit_euler", step=1e-4)),
    "stops, rk3": (pendulum(motor=MOTOR, friction=COULOMB, **BETWEEN), aw.Solver(step=1e-3)),
    "play, rk4": (pendulum(motor=MOTOR, friction=COULOMB, elasticity=PLAY), aw.Solver("rk4", step=5e-4)),
    "play, auto": (pendulum(motor=MOTOR, friction=COULOMB, elasticity=PLAY), aw.Solver()),
    "sticking, rk3": (block(weight=2.0, friction=dry(2.5)), aw.Solver(step=1e-3)),
    "sticking, auto": (block(weight=2.0, friction=dry(2.5)), aw.Solver()),
}


def exported(scenario, path, **options):
    return aw.export.export_fmu(scenario, path, platforms=this_platform(), **options).path


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", PLANTS)
def test_every_effect_and_rule_has_the_simulations_bits(name, tmp_path):
    arm, solver = PLANTS[name]
    scenario = commanded(arm, TICKS, solver=solver)
    step = solver.step or 1e-3
    ticks = round(TICKS * 1e-3 / step)
    run = aw.simulate(scenario)
    x = states(exported(scenario, tmp_path / "plant.fmu"), run, ticks, step)
    np.testing.assert_array_equal(x[:, : arm.n], run.q.values)
    np.testing.assert_array_equal(x[:, arm.n : 2 * arm.n], run.qd.values)
    for signal in ("winding_temperature", "bristle"):
        if signal in run:
            known = ~np.isnan(run[signal].values[0])
            assert known.any()
    assert np.ptp(run.q.values) > 0.0


def test_brakes_wrenches_and_payloads_are_inputs(tmp_path):
    arm = pendulum(motor=MOTOR, friction=COULOMB, brake=BRAKE)
    times = np.array([0.0, 0.02, 0.04])
    inputs = aw.Inputs(
        brake=aw.Schedule(times, np.array([[0.0], [1.0], [0.0]]), ("joint0",)),
        payload=aw.Payload(0.03, 0.7, com=[0.02, 0.0, 0.0], inertia=np.diag([1e-3, 2e-3, 2e-3]), frame="rod0"),
    )
    scenario = commanded(arm, TICKS, inputs=inputs)
    run = aw.simulate(scenario)
    at = np.arange(TICKS) * 1e-3
    brake = ((at > 0.0195) & (at < 0.0395)).astype(float)[:, None]
    m, c = 0.7, 0.02
    load = (at > 0.0295)[:, None] * np.array([m, m * c, 0, 0, 1e-3, 0, 0, 2e-3 + m * c * c, 0, 2e-3 + m * c * c])
    x = states(exported(scenario, tmp_path / "plant.fmu"), run, TICKS, 1e-3, brake=brake, payload=load)
    np.testing.assert_allclose(x[:, 0], run.q.values[:, 0], atol=1e-13)
    assert np.abs(run.q.values[30:] - aw.simulate(commanded(arm, TICKS)).q.values[30:]).max() > 1e-4


def test_the_supply_and_what_switches_servos_off_are_inputs(tmp_path):
    supply = aw.Schedule([0.0, 0.02], [[7.4], [5.7]], ["supply"])
    enabled = aw.Schedule([0.0, 0.03, 0.04], [[1.0], [0.0], [1.0]], ["q"])
    scenario = commanded(servo(PLAIN), TICKS, inputs=aw.Inputs(supply=supply, enabled=enabled))
    run = aw.simulate(scenario)
    made = aw.export.export_fmu(scenario, tmp_path / "plant.fmu", platforms=this_platform())
    assert made.inputs[1:] == ("supply.voltage", "enabled.q")
    assert "changes supply.… and enabled.…" in made.notes[0]
    at = np.arange(TICKS)[:, None] * 1e-3
    volts, on = np.where(at > 0.0195, 5.7, 7.4), np.where((at > 0.0295) & (at < 0.0395), 0.0, 1.0)
    np.testing.assert_array_equal(states(made.path, run, TICKS, 1e-3, supply=volts, enabled=on)[:, :1], run.q.values)
    assert np.abs(states(made.path, run, TICKS, 1e-3)[:, :1] - run.q.values).max() > 1e-6


def test_what_a_motion_grips_is_an_input_of_the_plant(tmp_path):
    """As `inputs.payload` is; the plant has no motion that could take it up."""
    gripping, given = (SCENARIOS[name](base())[0] for name in ("grips of a motion", "payloads over time"))
    found, same = (aw.export.export_fmu(each, tmp_path / "a.fmu", platforms=[]) for each in (gripping, given))
    assert found.inputs == same.inputs
    assert any(each.startswith("payload.") for each in found.inputs)
    assert all("payload." in each.notes[0] for each in (found, same))


@pytest.mark.parametrize(("name", "options", "noted"), [
    ("grips of a motion", {"part": "both"}, True), ("grips of a motion", {"part": "controller"}, False),
    ("payloads over time", {"interface": "model-exchange"}, True), ("wrench", {}, False),
])  # fmt: skip
def test_inputs_that_change_during_the_scenario_are_noted(tmp_path, name, options, noted):
    """The FMU has no schedule of them; those that stay at their first values are right as they are."""
    made = aw.export.export_fmu(SCENARIOS[name](base())[0], tmp_path / "a.fmu", platforms=[], **options)
    assert any("payload.…" in note for note in made.notes) == bool(made.notes) == noted


@pytest.mark.study
def test_a_plant_begins_where_its_start_parameters_say(tmp_path):
    """Exported from one pose and begun in another: as exported from that one, motors, windings and temperatures too."""
    arm = MANY["all"]
    q, qd = [0.4, -0.2], [0.1, 0.3]
    there = commanded(arm, TICKS, start=aw.Start(q, qd))
    run = aw.simulate(there)
    fmu = Instance(exported(commanded(arm, TICKS), tmp_path / "plant.fmu"))
    fmu.begin(**dict(zip(fmu.names("start", "parameter"), [*q, *qd], strict=True)))
    with pytest.raises(Exception, match="fmi3SetFloat64"):
        fmu.set("start.q.joint0", 0.0)
    assert "cannot be set after initialization" in fmu.messages[-1]
    x = fmu.names("x", "output")
    for k in range(TICKS):
        np.testing.assert_array_equal(fmu.get(*x)[:2], run.q.values[k])
        for name, value in zip(fmu.names("u", "input"), run.u.values[k], strict=True):
            fmu.set(name, value)
        fmu.step(k * 1e-3, 1e-3)
    fmu.close()


@pytest.mark.sample(1)
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_states_are_kept_restored_and_serialised(version, tmp_path):
    """A copy goes on to the bit: in place, after a reset, and in another instance by way of bytes."""
    sensors = aw.Sensors(counts=4096, position_noise=1e-4)
    timing = aw.Timing("one-tick", measurement_delay=2.5e-3, jitter=4e-4)
    loop = aw.Loop(period=1e-3, sensors=sensors, timing=timing)
    path = exported(aw.Scenario(MANY["all"], loop=loop, seed=4), tmp_path / "plant.fmu", version=version)
    first, second = Instance(path), Instance(path)

    def go(fmu, start, count):
        rows = []
        for k in range(start, start + count):
            for j, name in enumerate(fmu.names("u", "input")):
                fmu.set(name, np.sin(0.3 * k + j))
            fmu.step(k * 1e-3, 1e-3)
            rows.append(fmu.get(*fmu.names("x", "output"), *fmu.names("y", "output")))
        return np.array(rows)

    first.begin()
    go(first, 0, 20)
    kept = first.keep()
    after = go(first, 20, 20)
    first.restore(kept)
    np.testing.assert_array_equal(go(first, 20, 20), after)
    first.restore(kept)
    data = first.serialise(kept)
    first.release(kept)
    first.fmu.reset()
    first.begin()
    first.restore(first.deserialise(data))
    np.testing.assert_array_equal(go(first, 20, 20), after)
    second.begin()
    second.restore(second.deserialise(data))
    np.testing.assert_array_equal(go(second, 20, 20), after)
    with pytest.raises(Exception, match=r"(?i)deserialize"):
        second.deserialise(b"x" + bytes(data)[1:])
    assert second.messages == ["these bytes are no serialised state of this FMU"]
    first.close()
    second.close()


@pytest.mark.sample(1)
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_steps_are_whole_ticks(version, tmp_path):
    arm = MANY["plain"]
    path = exported(aw.Scenario(arm, loop=aw.Loop(period=2e-3)), tmp_path / "plant.fmu", version=version)
    fmu, one = Instance(path), Instance(path)
    for each in (fmu, one):
        each.begin(1.5)
        each.set("u.joint0", 3.0)
    for time, size, message in (
        (1.5, 1e-3, "a communication step of 0.001 s: expected a multiple of the tick, 0.002 s"),
        (1.5, 5e-3, "expected a multiple of the tick"),
        (1.5, 0.0, "expected a multiple of the tick"),
        (1.502, 2e-3, "a step from t = 1.502 s, but the model is at t = 1.5 s"),
    ):
        with pytest.raises(Exception, match="DoStep"):
            fmu.step(time, size)
        assert message in fmu.messages[-1]
    fmu.step(1.5, 6e-3)
    for k in range(3):
        one.step(1.5 + k * 2e-3, 2e-3)
    np.testing.assert_array_equal(fmu.get("time", "x.q.joint0"), one.get("time", "x.q.joint0"))
    fmu.close()
    one.close()


@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_a_tool_may_add_up_its_steps_for_hours(version, tmp_path):
    """Its sum of rounded steps, or the time of the model, or steps that are differences of times: 100 days behind 0."""
    path = exported(
        commanded(MANY["plain"], TICKS, solver=aw.Solver(step=1e-3)), tmp_path / "plant.fmu", version=version
    )
    fmu, start, steps = Instance(path), 1e7, 12_000
    fmu.begin(start)
    time = start
    for _ in range(steps):
        fmu.step(time, 1e-3)
        time += 1e-3
    assert abs(time - (start + 1e-3 * steps)) > 1e-6  # so far its sum is off
    for k in range(steps, steps + 100):
        now, then = (start + each * 1e-3 for each in (k, k + 1))
        fmu.step(now, then - now)
    assert fmu.get("time")[0] == start + 1e-3 * (steps + 100)
    with pytest.raises(Exception, match="DoStep"):
        fmu.step(time + 0.105, 1e-3)
    fmu.close()


def test_what_leaves_the_finite_numbers_is_an_error_with_its_time(tmp_path):
    arm = pendulum("torque", gravity=0.0)
    fmu = Instance(exported(commanded(arm, TICKS, solver=aw.Solver(step=1e-3)), tmp_path / "plant.fmu"))
    fmu.begin()
    fmu.step(0.0, 1e-3)
    fmu.set("u.joint0", np.nan)
    with pytest.raises(Exception, match="DoStep"):
        fmu.step(1e-3, 1e-3)
    assert "became infinite or not a number" in fmu.messages[-1]
    assert "t = 0.001 s" in fmu.messages[-1]
    fmu.close()


def test_another_units_token_is_refused(tmp_path):
    path = exported(aw.Scenario(MANY["plain"], loop=aw.Loop(period=1e-3)), tmp_path / "plant.fmu")
    with pytest.raises(Exception, match=r"(?i)instan"):
        Instance(path, token="{00000000-0000-0000-0000-000000000000}")


def test_open_numbers_of_the_record_and_gains_are_tunable(tmp_path):
    """Set to other values, the unit moves as the simulation with those."""
    arm = pendulum(motor=MOTOR, friction=COULOMB)

    def scenario(mass, kp):
        law = aw.JointPID(kp=aw.Batch([kp]), kd=2.0)
        loop = aw.Loop(law, reference=[0.3], period=1e-3)
        return aw.Scenario(arm, duration=1e-3 * TICKS, loop=loop, vary={"rod0.mass_kg": aw.Batch([mass])})

    run = aw.simulate(scenario(4.5, 60.0))
    fmu = Instance(exported(scenario(3.0, 40.0), tmp_path / "loop.fmu", part="both"))
    (mass,), (gain,) = fmu.names("p", "parameter"), fmu.names("c", "parameter")
    fmu.begin(**{mass: 4.5, gain: 60.0, "r.q.joint0": 0.3})
    for k in range(TICKS):
        np.testing.assert_array_equal(fmu.get("x.q.joint0"), run.q.values[0, k])
        fmu.step(k * 1e-3, 1e-3)
    fmu.close()
