"""Feed-forward against inverse dynamics at the reference, and as what lets a PD law follow a fast motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.control.commands import torque_commands
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from physics.arms import arm


def nothing(t, r, y):
    return 0.0 * r.q


def commands(model, rows, **fields):
    n = model.n
    law = aw.FeedForward(nothing, **fields).configure(model, 1e-3)
    y = Measurement(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))
    return law.step(0.0, JointReference(*rows), y, law.init(model, y))[0]


@pytest.mark.parametrize("name", ["two-link", "cmu-dd", "lwa4p", "puma560", "workshop", "gripper"])
def test_the_full_model_is_inverse_dynamics_at_the_reference(name):
    model = arm(name)
    rows = np.random.default_rng(5).normal(size=(3, model.n))
    expected = torque_commands(model, rows[1], aw.inverse_dynamics(model, *rows))
    given = commands(model, rows, inertia="full", friction=True)
    np.testing.assert_allclose(given, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["two-link", "cmu-dd", "lwa4p", "puma560"])
def test_inertia_of_a_joint_is_what_accelerating_it_alone_asks_for(name):
    """By the recursion of inverse dynamics, the other joints standing; gravity and friction as they are alone."""
    model = arm(name).replace(efficiency=None)  # a lossy gear is not linear
    q, qd, qdd = rows = np.random.default_rng(6).normal(size=(3, model.n))
    bare = model.replace(friction=None)
    still, weight = np.zeros(model.n), aw.inverse_dynamics(bare, q, 0.0 * q, 0.0 * q)
    rubbing = aw.bias_torques(model, q, qd) - aw.bias_torques(bare, q, qd)
    own = [(aw.inverse_dynamics(bare, q, still, row * qdd) - weight)[k] for k, row in enumerate(np.eye(model.n))]
    for fields, tau in (
        ({"gravity": True}, weight),
        ({"gravity": False, "friction": True}, rubbing),
        ({"gravity": False, "inertia": "joint"}, np.array(own)),
        ({"gravity": True, "friction": True, "inertia": "joint"}, weight + rubbing + own),
    ):
        np.testing.assert_allclose(
            commands(model, rows, **fields), torque_commands(model, qd, tau), rtol=1e-8, atol=1e-8
        )


def tracking(law, period=1e-3):
    model = arm("cmu-dd")
    motion = aw.trajectories.Quintic(np.zeros(6), np.array([0.8, 0.5, 0.3, 0.5, 0.2, 0.4]), 0.8)
    run = aw.simulate(aw.Scenario(model, duration=0.9, loop=aw.Loop(law, motion, period)))
    assert run.attrs["controller"] == "compiled"
    return np.abs(run.q.values - run.q_reference.values).max()


@pytest.mark.study
def test_a_direct_drive_arm_follows_a_fast_motion_by_it():
    servo = aw.JointPID(kp=[800, 1800, 600, 300, 60, 40], kd=[80, 180, 60, 24, 6, 4])
    alone = tracking(servo)
    joint = tracking(aw.FeedForward(servo, friction=True, inertia="joint"))
    full = [tracking(aw.FeedForward(servo, friction=True, inertia="full"), period) for period in (1e-3, 5e-4)]
    assert joint < 0.5 * alone
    assert full[0] < 0.2 * joint
    assert full[0] / full[1] == pytest.approx(2.0, rel=0.25)  # what holding over a period leaves


def test_anti_windup_sees_the_inner_command_alone():
    """An integrator does not take what was added for a drive that does not do as it is asked."""
    model = arm("two-link")
    gains: dict[str, Any] = {"kp": 30.0, "ki": 20.0, "kd": 6.0}
    rules: list[tuple[str, float | None]] = [("none", None), ("clamping", None), ("back-calculation", 0.05)]
    loops = [aw.JointPID(**gains, anti_windup=rule, tracking_time=time) for rule, time in rules]
    ends = [
        aw.simulate(
            aw.Scenario(model, duration=0.3, loop=aw.Loop(aw.FeedForward(each), np.array([0.3, -0.2]), 1e-3))
        ).q.values
        for each in loops
    ]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-9)
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-9)


def test_a_scenario_file_has_it_around_another(tmp_path):
    path = tmp_path / "a.scenario.toml"
    path.write_text(
        'robot = "two-link"\nduration_s = 0.05\n[loop]\nperiod_s = 0.001\n'
        '[loop.controller]\nkind = "feed_forward"\nfriction = true\ninertia = "joint"\n'
        'inner = { kind = "joint_pid", kp = 30.0, kd = [6.0, 5.0] }\n'
        '[loop.reference]\nkind = "quintic"\nstart = [0, 0]\ngoal = [0.1, 0.1]\nduration = 0.05\n'
    )
    scenario = aw.read_scenario(path)
    law: Any = scenario.loop and scenario.loop.controller
    assert (type(law).__name__, law.inertia, law.inner.kp) == ("FeedForward", "joint", 30.0)
    by_hand = aw.FeedForward(aw.JointPID(kp=30.0, kd=[6.0, 5.0]), friction=True, inertia="joint")
    loop = aw.Loop(by_hand, aw.trajectories.Quintic([0, 0], [0.1, 0.1], 0.05), 1e-3)
    expected = aw.simulate(aw.Scenario(arm("two-link"), duration=0.05, loop=loop))
    np.testing.assert_array_equal(aw.simulate(scenario).q.values, expected.q.values)
    text = path.read_text()
    for old, new, said in (
        ("kp = 30.0", 'kp = "a"', "kp = 'a': expected a number"),
        ("kp = 30.0", "kpp = 30.0", r"loop\.controller\.inner = 'kpp': no key of a joint_pid"),
        ("joint_pid", "nonsense", r"loop\.controller\.inner\.kind = 'nonsense': unknown"),
        ('kind = "joint_pid", ', "", r"loop\.controller\.inner\.kind"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(ScenarioError, match=said):
            aw.simulate(aw.read_scenario(path))


def test_the_loops_analysis_knows_the_rates_inside():
    model = arm("two-link")
    cascade = aw.Cascade(position_kp=5.0, speed_kp=3.0, position_every=4, speed_every=2)
    loops = [
        aw.loops.LinearLoop(aw.Scenario(model, duration=0.1, loop=aw.Loop(law, None, 1e-3)))
        for law in (cascade, aw.FeedForward(cascade))
    ]
    assert [loop.cycle for loop in loops] == [4, 4]
    plain, fed = (loop.margins(np.array([0.2, 0.3])) for loop in loops)
    np.testing.assert_allclose(fed.phase, plain.phase, rtol=1e-6)  # it adds nothing that depends on the arm's state


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"inertia": "all"}, r"FeedForward\.inertia = 'all'"),
        ({"gravity": 1.0}, r"FeedForward\.gravity = 1\.0: .*true or false"),
        ({"model": "puma560"}, r"FeedForward\.model"),
        ({"inner": 3.0}, "expected a function"),
    ],
)
def test_bad_fields_are_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        aw.FeedForward(**{"inner": nothing, **fields})
