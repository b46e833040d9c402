"""Forward sensitivities against closed forms and against differences of whole runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.errors import ScenarioError
from frozen.runs import GEARED, controlled, swing
from simulation.fields import scenario_of, with_fields
from simulation.first_steps import geared_motor
from simulation.plants import COULOMB, LUGRE, MANY, MOTOR, chain, pendulum

JOINT = "joint0"


def slope(scenario, name, value, change):
    """(signal → derivative) by a central difference of two runs; change: (scenario, value) → scenario."""
    step = 1e-5 * max(abs(value), 0.1)
    runs = [aw.simulate(change(scenario, value + sign * step)) for sign in (1, -1)]
    return {signal: (runs[0][signal].values - runs[1][signal].values) / (2 * step) for signal in ("q", "qd")}


def varied(name):
    return lambda scenario, value: replace(scenario, vary={**scenario.vary, name: value})


def start(field, entry):
    def change(scenario, value):
        values = np.array(getattr(scenario.start, field), dtype=float)
        values[entry] = value
        return replace(scenario, start=replace(scenario.start, **{field: values}))

    return change


@pytest.mark.sample(1)
@pytest.mark.parametrize("integrator", ["rk3", "rk4", "semi_implicit_euler"])
def test_commands_over_time(integrator):
    scenario = aw.Scenario(
        GEARED, command=aw.Schedule([0.0, 0.0203], [[9.0, -3.0], [-6.0, 2.0]], GEARED.names), duration=0.05,
        start=aw.Start([0.3, -0.2], [0.1, 0.2]), solver=aw.Solver(step=2.5e-4, integrator=integrator),
    )  # fmt: skip
    found = aw.simulation.sensitivities(scenario, ["rod1.mass_kg", "joint0.motor.resistance_ohm", "start.q[1]"])
    # the run itself is the same to the bit
    np.testing.assert_array_equal(found.q.values, aw.simulate(scenario).q.values)
    assert list(found.parameter.values) == ["rod1.mass_kg", "joint0.motor.resistance_ohm", "start.q[1]"]
    changes = [("rod1.mass_kg", 3.0, varied("rod1.mass_kg")), ("start.q[1]", -0.2, start("q", 1))]
    changes.append(("joint0.motor.resistance_ohm", 1.2, varied("joint0.motor.resistance_ohm")))
    for name, value, change in changes:
        for signal, expected in slope(scenario, name, value, change).items():
            own = found[f"d_{signal}"].sel(parameter=name).values
            np.testing.assert_allclose(own, expected, atol=1e-6 * np.abs(expected).max())
            assert np.abs(expected).max() > 1e-6


@pytest.mark.sample(1)
@pytest.mark.parametrize("effect", ["inductance", "thermal", "lugre", "elastic", "load", "all"])
def test_every_drive(effect):
    model = MANY[effect]
    n, name = model.n, "rod0.mass_kg"
    scenario = aw.Scenario(
        model,
        command=np.full(n, 9.0),
        duration=0.02,
        start=aw.Start(np.full(n, 0.3), np.full(n, 0.8)),
        solver=aw.Solver(step=1e-4, integrator="rk3"),
    )
    found = aw.simulation.sensitivities(scenario, [name, f"{JOINT}.motor.resistance_ohm", "start.qd[0]"])
    for column, value, change in (
        (name, 3.0, varied(name)), (f"{JOINT}.motor.resistance_ohm", 1.2, varied(f"{JOINT}.motor.resistance_ohm")),
        ("start.qd[0]", 0.8, start("qd", 0)),
    ):  # fmt: skip
        for signal, expected in slope(scenario, column, value, change).items():
            own = found[f"d_{signal}"].sel(parameter=column).values
            np.testing.assert_allclose(own, expected, atol=2e-6 * np.abs(expected).max(), err_msg=f"{column} {signal}")


def test_a_sampled_loop():
    """Gains, the arm and the start, through an observer, old measurements and commands that come a tick late."""
    law = aw.JointPID(kp=[30.0, 20.0], ki=40.0, kd=3.0, gravity=True)
    drive = {"command": "voltage", "motor": MOTOR, "friction": COULOMB}
    scenario = aw.Scenario(
        chain([drive, drive], gravity=2.0), duration=0.1, start=aw.Start([0.05, -0.05], [0.2, -0.1]),
        loop=aw.Loop(controller=law, reference=swing, period=2e-3, timing=aw.Timing("one-tick", measurement_delay=4e-3),
            sensors=aw.Sensors(velocity="observer", cutoff_hz=60.0)),
        solver=aw.Solver(substeps=8, integrator="rk3"),
    )  # fmt: skip
    names = ["rod1.mass_kg", "loop.controller.kp[0]", "loop.controller.kd", "start.qd[0]"]
    found = aw.simulation.sensitivities(scenario, names)
    assert list(found.parameter.values) == [
        "rod1.mass_kg",
        "loop.controller.kp[0]",
        "loop.controller.kd[0]",
        "loop.controller.kd[1]",
        "start.qd[0]",
    ]
    assert "lane" not in found.dims
    np.testing.assert_array_equal(found.q.values, aw.simulate(scenario).q.values)

    def gain(field, entry):
        def change(given, value):
            rows = np.array(np.broadcast_to(getattr(law, field), 2), dtype=float)
            rows[entry] = value
            return with_fields(given, controller=replace(law, **{field: rows}))

        return change

    for name, value, change in (
        ("rod1.mass_kg", 3.0, varied("rod1.mass_kg")), ("loop.controller.kp[0]", 30.0, gain("kp", 0)),
        ("loop.controller.kd[1]", 3.0, gain("kd", 1)), ("start.qd[0]", 0.2, start("qd", 0)),
    ):  # fmt: skip
        for signal, expected in slope(scenario, name, value, change).items():
            own = found[f"d_{signal}"].sel(parameter=name).values
            np.testing.assert_allclose(own, expected, atol=1e-5 * np.abs(expected).max(), err_msg=f"{name} {signal}")
            assert np.abs(expected).max() > 1e-9


def test_lanes_are_those_of_single_runs():
    scenario = aw.Scenario(GEARED, command=[9.0, -3.0], duration=0.02, solver=aw.Solver(step=5e-4, integrator="rk3"))
    start = np.array([[0.3, -0.2], [0.1, 0.4], [-0.2, 0.0]])
    many = aw.simulation.sensitivities(with_fields(scenario, q0=aw.Batch(start)), ["rod1.mass_kg"])
    for k, q0 in enumerate(start):
        alone = aw.simulation.sensitivities(with_fields(scenario, q0=q0), ["rod1.mass_kg"])
        np.testing.assert_array_equal(many.d_q.values[k], alone.d_q.values)


@pytest.mark.study
def test_a_reversal_under_coulomb_friction():
    """J q̈ = u - Fc sgn q̇ with u < -Fc: from v it stops at t₁ = J v / (Fc - u), then goes back. By the jump formula, at T,

        ∂q̇/∂Fc = 1/J · [ -(t₁) + (T - t₁) ] - (jump of q̈) ∂t₁/∂Fc,  q̈ jumping by 2 Fc / J,  ∂t₁/∂Fc = -t₁ / (Fc - u).

    The smoothed law tends to that with its speed, in steps below its limit.
    """
    inertia, level, torque, speed, end = 0.1 + 3.0 * 0.09, 2.0, -6.0, 1.0, 0.1
    stop = inertia * speed / (level - torque)
    assert 0.0 < stop < end
    exact = ((end - stop) - stop) / inertia + 2.0 * level / inertia * stop / (level - torque)
    errors = []
    for smoothing in (2e-2, 4e-3, 8e-4, 1.6e-4):
        friction = {**COULOMB, "viscous_n_m_s_per_rad": 0.0, "smoothing_rad_per_s": smoothing}
        friction |= {"coulomb_positive_n_m": level, "coulomb_negative_n_m": level}
        model = pendulum("torque", gravity=0.0, friction=friction)
        scenario = aw.Scenario(
            model,
            command=[torque],
            duration=end,
            start=aw.Start(qd=[speed]),
            solver=aw.Solver(step=end / 2**14, integrator="rk4"),
            recording=aw.Recording(every=0),
        )
        names = [f"{JOINT}.friction.coulomb_positive_n_m", f"{JOINT}.friction.coulomb_negative_n_m"]
        slopes = aw.simulation.sensitivities(scenario, names).d_qd.values[-1, 0]
        errors.append(abs(slopes.sum() - exact))  # both levels are one number here
    assert errors[-1] < 2e-3 * abs(exact)
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


def test_what_has_no_derivative_is_refused():
    rough = {key: value for key, value in COULOMB.items() if not key.startswith("smoothing")}
    sticking = pendulum(motor=MOTOR, friction=rough)
    open_loop = {"command": [1.0], "duration": 0.01, "step": 1e-4}
    mass = ["rod0.mass_kg"]
    cases = [
        (scenario_of(sticking, **open_loop), ["start.qd"], r"start.qd\[0\] = 0.0: joint 'joint0' starts at rest"),
        (
            aw.Scenario(MANY["plain"], command=[1.0], duration=0.01, solver=aw.Solver(integrator="rk45")),
            mass,
            "integrator",
        ),
        (controlled(sensors=aw.Sensors(counts=100)), mass, "loop.sensors.counts = 100"),
        (controlled(timing=aw.Timing(command_delay=1e-3)), mass, "whole ticks"),
        (controlled(), ["loop.controller.kp"], "the controller has no such field"),
        (controlled(), ["start.q[2]"], "start"),
        (controlled(), [], "list of names"),
    ]
    for scenario, by, match in cases:
        with pytest.raises(ScenarioError, match=match):
            aw.simulation.sensitivities(scenario, by)


def test_steps_are_fixed_for_the_accuracy_and_the_dataset_says_so():
    """A pendulum's swing from 0.3 rad: dq/dq₀ is right to the accuracy asked for, beside differences of CVODES' runs."""
    arm = pendulum("torque", friction={"viscous_n_m_s_per_rad": 0.05})
    scenario = aw.Scenario(arm, 0.5, command=[0.0], start=aw.Start([0.3]), recording=aw.Recording(period=0.05))
    exact = slope(replace(scenario, solver=aw.Solver("cvodes", 0.05)), "start.q[0]", 0.3, start("q", 0))
    wrong, steps = [], []
    for accuracy in (1e-2, 1e-3, 1e-6):
        found = aw.simulation.sensitivities(replace(scenario, solver=aw.Solver(accuracy=accuracy)), ["start.q[0]"])
        assert (found.attrs["integrator"], found.attrs["accuracy"]) == ("rk3", accuracy)
        assert "steps that are fixed: rk3 with" in found.attrs["notes"]
        assert "is coarse" not in found.attrs["notes"]
        steps.append(found.attrs["step_s"])
        wrong.append(np.abs(found.d_qd.values[..., 0] - exact["qd"]).max() / np.ptp(exact["qd"]))
        assert wrong[-1] < accuracy
    assert steps[0] >= steps[1] > 5.0 * steps[2]


def test_a_coarse_step_given_by_hand_is_noted():
    by_hand = aw.Scenario(geared_motor(), 0.02, command=[24.0], solver=aw.Solver("rk3", 5e-3))
    notes = aw.simulation.sensitivities(by_hand, ["start.q[0]"]).attrs["notes"]
    assert "a step of 0.005 s is coarse" in notes
    assert notes.endswith("would do")


def test_an_unknown_parameter_is_named():
    with pytest.raises(aw.ArmwrightError, match="X one of mass_kg") as caught:
        aw.simulation.sensitivities(
            aw.Scenario(GEARED, command=[1.0, 0.0], duration=0.01, solver=aw.Solver(step=1e-4)), ["rod0.weight"]
        )
    assert (caught.value.place, caught.value.value) == ("vary", "rod0.weight")


def test_laws_in_numpy_have_them_too():
    """A user's own law and trajectory, written with `armwright.scalar`."""

    def law(t, r, y):
        return scalar.array([4.0 * (r.q[0] - y.q[0]) - y.qd[0] * scalar.abs(y.qd[0]), 1.0 * (r.q[1] - y.q[1])])

    scenario = controlled(controller=law, q0=[0.1, 0.1])
    expected = slope(scenario, "rod0.mass_kg", 3.0, varied("rod0.mass_kg"))["q"]
    own = aw.simulation.sensitivities(scenario, ["rod0.mass_kg"]).d_q.values[..., 0]
    np.testing.assert_allclose(own, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.study
def test_bristles_turn_round_smoothly():
    """LuGre needs no jump formula: its state is continuous through a reversal."""
    model = pendulum(motor=MOTOR, friction=LUGRE)
    rows = aw.Schedule([0.0, 0.02], [[12.0], [-12.0]], [JOINT])
    scenario = aw.Scenario(model, command=rows, duration=0.06, solver=aw.Solver(step=5e-5, integrator="rk4"))
    run = aw.simulate(scenario)
    assert run.qd.values.max() > 0.01 > -0.01 > run.qd.values.min()
    name = f"{JOINT}.friction.coulomb_positive_n_m"
    expected = slope(scenario, name, 2.0, varied(name))["q"]
    own = aw.simulation.sensitivities(scenario, [name]).d_q.values[..., 0]
    np.testing.assert_allclose(own, expected, atol=1e-4 * np.abs(expected).max())
