"""PID of every joint: its law by hand, its rules against wind-up, its gains."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.control import JointPID
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.trajectory import Step
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of

PERIOD = 1e-3
N = 6


def random_inputs(seed=0):
    r = np.random.default_rng(seed)
    return JointReference(*r.normal(size=(3, N))), Measurement(*r.normal(size=(4, N)))


def test_all_terms_are_what_the_equation_says():
    model = arm("cmu-dd")
    r, y = random_inputs()
    law = JointPID(kp=2.0, ki=5.0, kd=0.3, speed_feedforward=0.7, acceleration_feedforward=0.05, gravity=True)
    law = law.configure(model, PERIOD)
    s = law.init(model, y)
    integral = np.full(N, 0.25)
    s[:N] = integral
    u, following = law.step(0.0, r, y, s)
    weight = aw.motor_voltage(model, np.zeros(N), aw.gravity_torques(model, y.q))
    expected = 2.0 * (r.q - y.q) + integral + 0.3 * (r.qd - y.qd) + 0.7 * r.qd + 0.05 * r.qdd + weight
    np.testing.assert_allclose(u, expected, rtol=1e-12)
    np.testing.assert_allclose(following[:N], integral + 5.0 * PERIOD * (r.q - y.q), rtol=1e-12)


def test_the_derivative_of_the_measurement_knows_no_reference():
    model = arm("cmu-dd")
    r, y = random_inputs()
    law = JointPID(kp=0.0, kd=0.3, derivative="measurement").configure(model, PERIOD)
    np.testing.assert_allclose(law.step(0.0, r, y, law.init(model, y))[0], -0.3 * y.qd, rtol=1e-12)


def test_a_filtered_derivative_tends_to_the_slope_of_the_positions():
    model, cutoff, slope = arm("cmu-dd"), 30.0, 0.8
    law = JointPID(kp=0.0, kd=1.0, cutoff_hz=cutoff).configure(model, PERIOD)
    still = JointReference(*np.zeros((3, N)))
    at = lambda k: Measurement(np.full(N, slope * k * PERIOD), np.zeros(N), np.zeros(N), np.zeros(N))  # noqa: E731
    s = law.init(model, at(0))
    keep = np.exp(-2.0 * np.pi * cutoff * PERIOD)
    for k in range(1, 60):
        u, s = law.step(k * PERIOD, still, at(k), s)
        np.testing.assert_allclose(u, -slope * (1.0 - keep**k), rtol=1e-9)


def test_a_gear_that_turns_the_other_way_needs_no_negative_gain():
    model = arm("puma560")
    ratios = np.array([body.drive.gear_ratio for body in model.bodies])
    assert (ratios < 0).any()
    run = aw.simulate(
        aw.Scenario(
            model, duration=1.5,
            loop=aw.Loop(controller=JointPID(kp=400.0, kd=20.0, gravity=True), reference=np.full(6, 0.1), period=PERIOD),
        )
    )  # fmt: skip
    assert run.attrs["controller"] == "compiled"
    np.testing.assert_allclose(run.q.values[-1], 0.1, atol=0.02)


def step_response(**fields):
    """A large step of the first joint, whose output stage has far too few volts for its gains."""
    model = arm("cmu-dd")
    goal = np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    law = JointPID(kp=[100.0, 900, 300, 150, 30, 20], ki=[300.0, 0, 0, 0, 0, 0], kd=[30.0, 90, 30, 12, 3, 2], **fields)
    return aw.simulate(
        aw.Scenario(
            model, duration=4.0,
            loop=aw.Loop(controller=law, reference=Step(np.zeros(6), goal), period=PERIOD, initial_command=np.zeros(6),
                command_filter=aw.CommandFilter(limit=[12.0, 80, 80, 60, 24, 24])),
        )
    )  # fmt: skip


def overshoot(run):
    return run.q.values[:, 0].max() / 1.5 - 1.0


@pytest.mark.study
def test_rules_against_wind_up_take_the_overshoot_away():
    wound = overshoot(step_response())
    clamped = overshoot(step_response(anti_windup="clamping"))
    tracked = overshoot(step_response(anti_windup="back-calculation", tracking_time=0.1))
    assert wound > 0.5
    assert clamped < 0.2 * wound
    assert tracked < 0.2 * wound


@pytest.mark.study
def test_where_nothing_is_cut_off_the_rules_do_nothing():
    common = {"reference": np.full(6, 1e-3), "period": PERIOD, "duration": 0.2, "vary": {}}
    laws = [
        JointPID(kp=100.0, ki=50.0, kd=10.0, **more)
        for more in ({}, {"anti_windup": "clamping"}, {"anti_windup": "back-calculation", "tracking_time": 0.05})
    ]
    plain, *others = [aw.simulate(scenario_of(arm("cmu-dd"), controller=law, **common)).q.values for law in laws]
    for other in others:
        np.testing.assert_allclose(other, plain, atol=1e-12)


@pytest.mark.study
def test_a_command_that_is_late_is_compared_with_its_own():
    """One tick late, what the drive did belongs to the command before the last: nothing is missing."""
    common = {"reference": np.full(6, 1e-3), "period": PERIOD, "duration": 0.2, "timing": aw.Timing("one-tick")}
    rule = {"anti_windup": "back-calculation", "tracking_time": 0.05}
    more = ({}, rule | {"delay_ticks": 1}, rule, rule | {"delay_ticks": 0})
    laws = [JointPID(kp=100.0, ki=50.0, kd=10.0, **each) for each in more]
    runs = [aw.simulate(scenario_of(arm("cmu-dd"), controller=law, **common)) for law in laws]
    plain, knows, fitted, ignores = [run.q.values for run in runs]
    np.testing.assert_allclose(knows, plain, atol=1e-12)
    assert (fitted == knows).all()  # absent: those of the loop's timing
    assert np.abs(ignores - plain).max() > 1e-9


def test_a_limit_of_its_own_is_kept():
    run = step_response(limit=5.0, anti_windup="clamping")
    assert np.abs(run.u_issued.values).max() == 5.0


@pytest.mark.study
def test_gains_may_be_a_batch():
    kp = np.array([50.0, 100.0, 200.0])
    common = {"reference": np.full(6, 0.1), "period": PERIOD, "duration": 0.1}
    many = aw.simulate(scenario_of(arm("cmu-dd"), controller=JointPID(kp=aw.Batch(kp), kd=20.0), **common))
    assert many.sizes["lane"] == 3
    for lane in range(3):
        one = aw.simulate(scenario_of(arm("cmu-dd"), controller=JointPID(kp=kp[lane], kd=20.0), **common))
        np.testing.assert_allclose(many.q.values[lane], one.q.values, atol=1e-11)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"kp": [1.0, 2.0]}, r"JointPID.kp: shape \(2,\); .*\(6,\): joint1, joint2"),
        ({"kp": np.ones((3, 6))}, r"JointPID.kp: shape \(3, 6\); .* Batch"),
        ({"kp": aw.Batch([1.0, -2.0])}, "'joint1' of lane 1 = -2.0: "),
        ({"kp": "much"}, "kp = 'much': expected a number"),
        ({"kp": True}, "kp = True: expected a number"),
        ({"kp": "20"}, "kp = '20': expected a number"),
        ({"kp": 1.0, "gravity": "false"}, "JointPID.gravity = 'false': .*true or false"),
        ({"kp": 1.0, "model": "puma560"}, "JointPID.model = 'puma560': expected an arm"),
        ({"kp": np.array(["a", "b"])}, r"kp = \['a', 'b'\]: expected a number"),
        ({"kp": 1.0, "kd": [1.0, 1, -2, 1, 1, 1]}, "kd of joint 'joint3' = -2.0"),
        ({"kp": 1.0, "limit": 0.0}, "limit of joint 'joint1' = 0.0"),
        ({"kp": 1.0, "anti_windup": "clampin"}, "anti_windup = 'clampin': unknown; .*clamping?"),
        ({"kp": 1.0, "anti_windup": "back-calculation"}, "tracking_time = None: anti_windup = 'back-calculation'; expected"),
        ({"kp": 1.0, "tracking_time": 1.0}, "tracking_time = 1.0: anti_windup = 'none'"),
        ({"kp": 1.0, "derivative": "both"}, "derivative = 'both': unknown"),
        ({"kp": 1.0, "cutoff_hz": 0.0}, "cutoff_hz = 0.0: expected a number above 0"),
        ({"kp": 1.0, "delay_ticks": -1}, "delay_ticks = -1: expected a whole number"),
    ],
)  # fmt: skip
def test_gains_that_do_not_fit_are_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        aw.Scenario(arm("cmu-dd"), duration=0.1, loop=aw.Loop(controller=JointPID(**fields), period=PERIOD))


def test_a_model_of_other_joints_is_refused():
    law = JointPID(kp=1.0, model=arm("two-link"))
    with raises_at(ScenarioError, "JointPID.model", "2 joints.* 6 of cmu-dd: joint1"):
        aw.Scenario(arm("cmu-dd"), duration=0.1, loop=aw.Loop(controller=law, period=PERIOD))
