"""Designed gains and linear models of arms, against python-control, SciPy, and the closed forms of their rules."""

from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

import armwright as aw
from armwright.control.design.rest_errors import rest_errors
from armwright.model.drive import Friction
from raises_at import raises_at

control = pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")


def scenario(law, name="two-link", period=1e-3, preset="one-tick", **more):
    loop = aw.Loop(law, period=period, timing=aw.Timing(preset=preset), **more)
    return aw.Scenario(aw.load(name), duration=1.2, loop=loop)


PID = aw.JointPID(kp=100.0, ki=50.0, kd=10.0, gravity=True)
PD = aw.JointPID(kp=100.0, kd=10.0, gravity=True)
CASCADE = aw.Cascade(position_kp=5.0, speed_kp=10.0, speed_ki=20.0)


@pytest.fixture(scope="module")
def arm():
    return aw.load("two-link")


def test_the_linear_model_is_the_arm_near_the_pose(arm):
    q = np.array([0.4, -0.7])
    system = aw.loops.state_space(arm, q)
    assert system.state_labels == ["q[shoulder]", "q[elbow]", "qd[shoulder]", "qd[elbow]"]
    assert system.input_labels == ["torque[shoulder]", "torque[elbow]"]
    assert system.output_labels == ["q[shoulder]", "q[elbow]", "qd[shoulder]", "qd[elbow]"]
    still = arm.replace(friction=None)
    hold, mass = aw.gravity_torques(arm, q), aw.mass_matrix(arm, q)
    a, step = aw.loops.state_space(still, q).A, 1e-6
    assert aw.loops.state_space(still, q).B[2:] == pytest.approx(np.linalg.inv(mass), rel=1e-9)
    for k in range(2):
        moved = q + step * np.eye(2)[k]
        slope = np.linalg.solve(aw.mass_matrix(arm, moved), hold - aw.gravity_torques(arm, moved)) / step
        assert a[2:, k] == pytest.approx(slope, rel=1e-4, abs=1e-4)


def test_drives_have_their_states_and_their_commands_names():
    system = aw.loops.state_space(aw.load("cmu-dd"))
    assert system.input_labels[0].startswith("voltage[")
    assert system.nstates >= 12
    assert all(name.startswith(("q[", "qd[", "current[")) for name in system.state_labels)


def test_the_sampled_model_is_that_of_python_control_and_delays_are_states(arm):
    q = np.array([0.4, -0.7])
    continuous, sampled = aw.loops.state_space(arm, q), aw.loops.state_space(arm, q, period=1e-3)
    same = control.c2d(continuous, 1e-3, "zoh")
    assert np.allclose(sampled.A, same.A, rtol=1e-10, atol=1e-12)
    assert np.allclose(sampled.B, same.B, rtol=1e-10, atol=1e-12)
    late = aw.loops.state_space(arm, q, period=1e-3, delay=1.4e-3)
    assert late.state_labels[4:] == [f"torque[{joint}], {k} ago" for k in (1, 2) for joint in arm.names]
    w = 20.0
    ratio = late(np.exp(1j * w * 1e-3))[0, 0] / continuous(1j * w)[0, 0]
    assert np.angle(ratio) == pytest.approx(-w * (1.4e-3 + 0.5e-3), abs=1e-5)


def test_regulators_and_kalman_filters_of_the_model_solve_riccatis_equations(arm):
    linalg = pytest.importorskip("scipy.linalg")
    system = aw.loops.state_space(arm, [0.4, -0.7], period=1e-3)
    q, r = np.diag([100.0, 100.0, 1.0, 1.0]), np.diag([1e-3, 1e-2])
    gain = control.dlqr(system, q, r)[0]
    p = linalg.solve_discrete_are(system.A, system.B, q, r)
    assert gain == pytest.approx(np.linalg.solve(r + system.B.T @ p @ system.B, system.B.T @ p @ system.A), rel=1e-6)
    assert np.abs(np.linalg.eigvals(system.A - system.B @ gain)).max() < 1.0
    c, w, v = system.C[:2], np.diag([1.0, 1.0]), 1e-8 * np.eye(2)
    observer = control.dlqe(system.A, system.B, c, w, v)[0]
    p = linalg.solve_discrete_are(system.A.T, c.T, system.B @ w @ system.B.T, v)
    filtered = p @ c.T @ np.linalg.inv(c @ p @ c.T + v)
    assert np.allclose(observer, filtered, rtol=1e-6) or np.allclose(observer, system.A @ filtered, rtol=1e-6)
    assert np.abs(np.linalg.eigvals(system.A - system.A @ filtered @ c)).max() < 1.0


def viscous(arm, joint):
    friction = arm.coordinates[joint].friction
    return 0.0 if friction is None else friction.viscous


@pytest.mark.parametrize(("law", "zeta"), [(PD, 1.0), (PD, 0.7), (PID, 1.0), (CASCADE, 0.8)])
def test_placed_poles_lie_where_they_were_asked_for(law, zeta):
    w = 8.0
    design = aw.loops.design_gains(scenario(law), "pole-placement", bandwidth=w, damping=zeta, poses=50)
    arm = aw.load("two-link").replace(gravity=[0.0, 0.0, 0.0])  # which the law compensates, or the integral
    gains = design.gains
    if isinstance(law, aw.Cascade):
        p, s, i = (gains[name] for name in ("position_kp", "speed_kp", "speed_ki"))
        gains = {"kp": s * p + i, "ki": i * p, "kd": s}
    poses = aw.loops.joint_inertias(arm, 50, 0)
    for joint in range(2):
        q = poses.q[poses.held[:, joint].argmax()]
        # the joint alone: all others held still
        inertia = aw.mass_matrix(arm, q)[joint, joint]
        damping = viscous(arm, joint)
        kp, ki, kd = (gains.get(name, np.zeros(2))[joint] for name in ("kp", "ki", "kd"))
        plant = control.tf([1.0], [inertia, damping, 0.0])
        loop = control.feedback(plant * control.tf([kd, kp, ki], [1.0, 0.0]), 1)
        poles = np.sort_complex(loop.poles())
        wanted = np.roots([1.0, 2.0 * zeta * w, w * w])
        for pole in wanted:
            assert np.abs(poles - pole).min() < 2e-3 * w
        if ki > 0.0:
            assert np.abs(poles + 0.1 * w).min() < 1e-3 * w


def test_the_symmetric_optimum_is_kesslers():
    design = aw.loops.design_gains(scenario(CASCADE, "lwa4p", 4e-3), bandwidth=1.0 / (2.0 * 6e-3), poses=50)
    lag = 6e-3  # half a period of hold, one of delay
    assert design.method == "symmetric-optimum"
    assert design.lag == pytest.approx(lag)
    assert design.gains["speed_kp"] == pytest.approx(design.inertia / (2.0 * lag))
    assert design.gains["speed_ki"] == pytest.approx(design.gains["speed_kp"] / (4.0 * lag))
    # 36.87° of phase at the crossover of an integrator with the lag, by python-control
    m, kp, ki = (each[0] for each in (design.inertia, design.gains["speed_kp"], design.gains["speed_ki"]))
    open_loop = control.tf([kp, ki], [1.0, 0.0]) * control.tf([1.0], [m, 0.0]) * control.tf([1.0], [lag, 1.0])
    _, phase, _, crossover = control.margin(open_loop)
    assert phase == pytest.approx(np.degrees(np.arctan(2.0) - np.arctan(0.5)), abs=1e-3)
    assert crossover == pytest.approx(1.0 / (2.0 * lag), rel=1e-6)


@pytest.mark.parametrize("integral", [20.0, 0.0])
def test_the_symmetric_optimum_of_a_damped_joint_is_not_slower_than_its_bandwidth_allows(integral):
    one = scenario(replace(CASCADE, speed_ki=integral), period=4e-3)
    bodies = tuple(replace(body, friction=Friction(viscous=150.0)) for body in one.arm.bodies)
    damped = replace(one, arm=replace(one.arm, bodies=bodies).replace(gravity=[0.0, 0.0, 0.0]))
    w, lag = 40.0, 6e-3  # half a period of hold, one of delay
    design = aw.loops.design_gains(damped, bandwidth=w, poses=50)
    gains = {"speed_ki": np.zeros(2), **design.gains}
    columns = (gains[name] for name in ("position_kp", "speed_kp", "speed_ki"))
    for m, p, s, i in zip(design.inertia, *columns, strict=True):
        assert 150.0 / m > w * w * lag  # the joint's own time constant is shorter than Kessler's integral time
        if integral:
            assert i / s == pytest.approx(150.0 / m)  # which the integral cancels: the magnitude optimum
        speed = control.feedback(control.tf([s, i], [1.0, 0.0]) * control.tf([1.0], [m, 150.0]), 1)
        loop = control.feedback(p * control.minreal(speed, verbose=False) * control.tf([1.0], [1.0, 0.0]), 1)
        poles = loop.poles()
        assert -poles.real.max() > 0.24 * w
        assert (-poles.real / np.abs(poles)).min() > 0.99  # ζ = 1


def test_a_shaped_loop_crosses_with_the_phase_that_belongs_to_the_damping():
    w, zeta = 10.0, 0.6
    design = aw.loops.design_gains(scenario(PD), "loop-shaping", bandwidth=w, damping=zeta, poses=50)
    arm, law = aw.load("two-link").replace(gravity=[0.0, 0.0, 0.0]), design.gains
    poses = aw.loops.joint_inertias(arm, 50, 0)
    for joint in range(2):
        q = poses.q[poses.held[:, joint].argmax()]
        inertia = aw.mass_matrix(arm, q)[joint, joint]
        plant = control.c2d(control.tf([1.0], [inertia, viscous(arm, joint), 0.0]), 1e-3, "zoh")
        delayed = plant * control.tf([1.0], [1.0, 0.0], 1e-3)
        value = delayed(np.exp(1j * w * 1e-3)) * (law["kp"][joint] + 1j * w * law["kd"][joint])
        assert abs(value) == pytest.approx(1.0, abs=1e-4)
        phase = np.arctan2(2 * zeta, np.sqrt(np.sqrt(1 + 4 * zeta**4) - 2 * zeta**2))
        assert np.angle(-value) == pytest.approx(phase, abs=1e-4)


def test_the_regulator_of_a_joint_without_damping_is_the_closed_form():
    one = replace(scenario(PD), arm=aw.load("two-link").replace(friction=None))
    design = aw.loops.design_gains(one, "lqr", bandwidth=6.0, poses=50)
    # coupling changes it a little; without it  kp = m ω²,  kd = √2 m ω
    assert design.gains["kp"] == pytest.approx(design.inertia * 36.0, rel=0.4)
    assert design.gains["kd"] == pytest.approx(design.inertia * 6.0 * np.sqrt(2.0), rel=0.4)


@pytest.mark.sample(1)
@pytest.mark.parametrize("method", ["pole-placement", "symmetric-optimum", "loop-shaping", "lqr"])
@pytest.mark.parametrize("law", [PD, CASCADE], ids=["pd", "cascade"])
def test_gains_without_a_stated_bandwidth_keep_the_margins_at_other_poses(method, law):
    design = aw.loops.design_gains(scenario(law, period=2e-3), method, poses=100)
    assert design.keeps
    margins = aw.loops.LinearLoop(design.scenario).margins(np.random.default_rng(7).uniform(-3.0, 3.0, (30, 2)))
    assert margins.radius.max() < 1.0
    assert np.degrees(margins.phase.min()) > 29.0
    assert margins.gain_up.min() > 1.95
    slower = aw.loops.design_gains(scenario(law, period=2.4e-3), method, poses=100)
    assert (slower.bandwidth < design.bandwidth).all()


def test_computed_torque_is_designed_for_double_integrators():
    design = aw.loops.design_gains(scenario(aw.ComputedTorque(kp=1.0, kd=1.0)), bandwidth=10.0, poses=50)
    assert design.gains["kp"].tolist() == [100.0, 100.0]
    assert design.gains["kd"].tolist() == [20.0, 20.0]


def test_what_wraps_the_controller_stays():
    wrapped = aw.FeedForward(PD, inertia="joint")
    design = aw.loops.design_gains(scenario(wrapped), bandwidth=5.0, poses=50)
    assert type(design.scenario.controller) is aw.FeedForward
    plain = aw.loops.design_gains(scenario(PD), bandwidth=5.0, poses=50)
    assert design.scenario.controller.inner.kp.tolist() == plain.scenario.controller.kp.tolist()


def test_a_current_loop_is_designed_by_the_magnitude_optimum():
    cascade = aw.Cascade(position_kp=5.0, speed_kp=1.0, speed_ki=2.0, current_kp=1.0, current_ki=1.0, speed_every=4)
    torque_driven = scenario(PD, period=2.5e-4)
    assert torque_driven.loop is not None
    motor = {"command": "voltage", "torque_constant": 2.0, "resistance": 1.5, "inductance": 5e-3, "gear_ratio": 10.0}
    motor["back_emf_constant"] = 2.0
    wound, one = (
        replace(
            torque_driven,
            arm=_driven(torque_driven.arm, motor | changes),
            loop=replace(torque_driven.loop, controller=cascade),
        )
        for changes in ({}, {"inductance": None})
    )
    with raises_at(aw.ArmwrightError, "current_kp", "inductance .*'shoulder'"):
        aw.loops.design_gains(one, poses=50)
    design = aw.loops.design_gains(wound, poses=50)
    assert design.keeps
    late = 2.5e-4 * 1.5  # half a period of hold, one of delay
    assert design.gains["current_kp"] == pytest.approx(5e-3 / (2.0 * late))
    assert design.gains["current_ki"] == pytest.approx(1.5 / (2.0 * late))
    assert design.lag == pytest.approx(np.full(2, 4 * 2.5e-4 / 2.0 + 2.5e-4 + 2.0 * late))
    held = aw.loops.joint_inertias(wound.arm, 50, 0).held.max(axis=0)
    assert design.inertia == pytest.approx(held / 20.0)  # N m/A at the joint


def _driven(arm, drive):
    return replace(arm, bodies=tuple(replace(body, drive=replace(body.drive, **drive)) for body in arm.bodies))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"method": "ziegler"}, "pole-placement"),
        ({"bandwidth": 0.0}, "above 0"),
        ({"bandwidth": [1.0, 2.0, 3.0]}, "2 of them"),
        ({"bandwidth": 1e4}, "small delays"),
        ({"bandwidth": [10.0, 1e4]}, "small delays"),
        ({"damping": 0.0}, "0.1 to 3"),
        ({"poses": 0}, "poses"),
        ({"gain_margin": 0.5}, "gain_margin"),
        ({"phase_margin": 3.5}, "200.535°; expected an angle from 0 to below"),
    ],
)
def test_bad_input(changes, words):
    with pytest.raises(aw.ArmwrightError) as caught:
        aw.loops.design_gains(scenario(PD), **{"poses": 20, **changes})
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_margins_that_no_bandwidth_keeps_say_what_would():
    slow = scenario(aw.JointPID(kp=100.0, kd=10.0), period=0.2)  # upright it falls, faster than the loop can see
    with raises_at(aw.ArmwrightError, "margins") as caught:
        aw.loops.design_gains(slow, poses=20)
    assert "a sample period of" in str(caught.value)


def test_a_joint_whose_inertia_varies_much_gets_the_bandwidth_that_keeps_its_margins(tmp_path):
    text = (resources.files("armwright") / "robots" / "two-link.toml").read_text(encoding="utf-8")
    (tmp_path / "column.toml").write_text(text.replace("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 1.0, 0.0]", 1))
    arm = aw.load(tmp_path / "column.toml")  # turns about the vertical, with the forearm's mass out or above the axis
    light = {"upper_arm.mass_kg": 0.1, "upper_arm.inertia_kg_m2.yy": 0.02, "upper_arm.inertia_kg_m2.zz": 0.02}
    arm = arm.with_values({**light, "forearm.com_m[0]": 1.0})
    design = aw.loops.design_gains(replace(scenario(PD, period=2e-3, preset="ideal"), arm=arm), poses=100)
    assert design.keeps
    assert design.bandwidth[0] < 10.0  # a hundredth of the highest, 1 / 1 ms


def test_a_law_that_no_rule_designs():
    with raises_at(aw.ArmwrightError, "loop.controller", r"aw\.JointPID"):
        aw.loops.design_gains(scenario(lambda t, r, y: 10.0 * (r.q - y.q)))


@pytest.mark.parametrize("changes", [{"q": [0.0]}, {"q": [0.0, np.nan]}, {"delay": 1e-3}, {"period": -1.0}])
def test_no_state_space(arm, changes):
    with pytest.raises(aw.ArmwrightError):
        aw.loops.state_space(arm, **changes)


@pytest.mark.sample(1)
@pytest.mark.parametrize("wrapped", [False, True])
def test_a_designed_cascade_arrives_though_its_commands_are_late(wrapped):
    """Kessler's rule lives on its integral, which must not take a late command for one that was cut off."""
    start, goal = np.array([0.2, 0.5]), np.array([1.0, -0.4])
    law = aw.FeedForward(CASCADE) if wrapped else CASCADE
    bodies = tuple(replace(body, friction=Friction(viscous=100.0)) for body in aw.load("two-link").bodies)
    one = scenario(law, period=4e-3, reference=aw.trajectories.Quintic(start, goal, 1.0))
    one = replace(one, arm=replace(one.arm, bodies=bodies), start=start)
    run = aw.simulate(aw.loops.design_gains(one, poses=50).scenario)
    assert np.abs(run.q.values[-1] - goal).max() < 2e-3
    known = replace(law, inner=replace(CASCADE, delay_ticks=1)) if wrapped else replace(CASCADE, delay_ticks=1)
    stated = replace(one, loop=replace(one.loop, controller=known))
    assert (aw.simulate(aw.loops.design_gains(stated, poses=50).scenario).q.values == run.q.values).all()


@pytest.mark.study
def test_what_is_left_at_rest_without_an_integral_is_said():
    start = np.array([0.3, 0.4])
    friction = Friction(viscous=1.0, coulomb_positive=3.0, coulomb_negative=2.0)
    bodies = [replace(body, friction=friction) for body in aw.load("two-link").bodies]
    one = scenario(
        replace(CASCADE, speed_ki=0.0), period=4e-3, reference=aw.trajectories.Quintic(start, start + 0.5, 0.6)
    )
    one = replace(one, arm=replace(one.arm, bodies=tuple(bodies)), start=start, duration=2.0)
    design = aw.loops.design_gains(one, poses=200)
    stiffness = design.gains["position_kp"] * design.gains["speed_kp"]
    assert design.friction_error == pytest.approx(3.0 / stiffness)
    error = np.abs(aw.simulate(design.scenario).q.values[-1] - start - 0.5)
    assert (error > 0.0).all()
    assert (error <= design.friction_error + design.weight_error).all()
    assert "without an integral, dry friction up to" in design.sentences()[-1]
    for law, left in ((CASCADE, False), (PD, True)):
        other = aw.loops.design_gains(replace(one, loop=replace(one.loop, controller=law)), poses=50)
        assert other.friction_error.all() == left
        assert not other.weight_error.any()  # PD: gravity = True
        assert len(other.sentences()) == 2 + left + len(other.notes)


@pytest.mark.parametrize("coupling", [(), (("shoulder", 60.0),)])
def test_weight_leaves_the_error_in_the_simulation_that_a_design_states(arm, coupling):
    """Of coupled motors, too, where what a motor gives reaches several joints."""
    elbow = replace(arm.bodies[1], drive=replace(arm.bodies[1].drive, gear_ratio=50.0, coupling=coupling))
    own = replace(arm, bodies=(arm.bodies[0], elbow))
    law, pose = aw.JointPID(kp=[8000.0, 6000.0], kd=[900.0, 150.0]), np.array([0.3, 0.5])
    loop = aw.Loop(law, pose, 1e-3)
    run = aw.simulate(aw.Scenario(own, 1.5, loop=loop, start=pose, solver=aw.Solver("rk4")))
    end = run.q.values[-1]
    _, weight = rest_errors(own, law, law, law.kp, end[None])
    assert np.abs(end - pose) == pytest.approx(weight, rel=1e-3)
