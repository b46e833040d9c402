"""Noise of measured positions: H2 norms beside SciPy and noisy simulations, limit cycles of counts beside simulations of them."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

import armwright as aw
from armwright.control.analysis import LinearLoop, limit_cycles
from armwright.control.analysis.instability import growing_mode
from armwright.control.analysis.limit_cycles import rounding_factor
from armwright.control.analysis.small_signal import small_signal_arm
from armwright.model.drive import Elasticity, Friction
from raises_at import raises_at

PERIOD = 2e-3
POSE = np.array([0.2, 0.9])
CONTROLLERS = {
    "pid": aw.JointPID(kp=400.0, kd=60.0, ki=50.0, gravity=True),
    "three rates": aw.Cascade(position_kp=12.0, speed_kp=40.0, speed_ki=100.0, position_every=4, speed_every=2),
}


def scenario(controller, duration=1.0, late=0.0, **sensors):
    """A loop about `POSE`, with gravity held there."""
    loop = aw.Loop(
        controller, POSE, PERIOD, sensors=aw.Sensors(velocity="difference", **sensors),
        timing=aw.Timing("one-tick", command_delay=late),
    )  # fmt: skip
    arm = small_signal_arm(aw.load("two-link"))
    return aw.Scenario(arm, duration, loop=loop, start=POSE, solver=aw.Solver("rk4", substeps=2))


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_noisy_simulation_has_the_standard_deviations_of_the_norms(name):
    deviation = 1e-6
    gain = aw.loops.noise_gain(LinearLoop(scenario(CONTROLLERS[name])), POSE)
    law = aw.FeedForward(CONTROLLERS[name], gravity=True) if name == "three rates" else CONTROLLERS[name]
    noisy = scenario(law, 4.0, position_noise=deviation)
    run = aw.simulate(replace(noisy, start=aw.Batch(np.tile(POSE, (64, 1)))))
    for values, norms in ((run.u.values[:, 400:-1], gain.command), (run.q.values[:, 400:], gain.position)):
        expected = deviation * np.sqrt((norms**2).sum(axis=1))
        assert values.std(axis=(0, 1)) == pytest.approx(expected, rel=0.04)


@pytest.mark.parametrize("name", ["elastic", "coupled", "elastic and coupled"])
def test_noise_of_an_encoder_on_a_motor_counts_at_the_joint(name):
    """An elastic gear's motor turns 50 rad where its joint turns 1; encoders of coupled motors see several joints."""
    made = scenario(aw.JointPID(kp=400.0, kd=40.0))
    shoulder, elbow = made.arm.bodies
    drive = replace(elbow.drive, gear_ratio=-50.0, rotor_inertia=4e-4, coupling=())
    if "coupled" in name:
        drive = replace(drive, coupling=(("shoulder", -40.0),))
    elasticity = Elasticity(stiffness=2e4, damping=20.0) if "elastic" in name else None
    arm = replace(
        made.arm.replace(gravity=np.zeros(3)), bodies=(shoulder, replace(elbow, drive=drive, elasticity=elasticity))
    )
    gain = aw.loops.noise_gain(LinearLoop(replace(made, arm=arm)), POSE)
    deviation = 1e-6
    loop = replace(made.loop, sensors=aw.Sensors(velocity="difference", position_noise=deviation))
    run = aw.simulate(replace(made, arm=arm, loop=loop, start=aw.Batch(np.tile(POSE, (32, 1)))))
    for values, norms in ((run.u.values[:, 100:-1], gain.command), (run.q.values[:, 100:], gain.position)):
        expected = deviation * np.sqrt((norms**2).sum(axis=1))
        assert values.std(axis=(0, 1)) == pytest.approx(expected, rel=0.06)


def test_scipy_s_lyapunov_equation_has_the_same_norm():
    """One joint held, PD, no delay:  z = (q, q̇, last q),  u = -kp (q + v) - kd (q + v - last)/T."""
    law, joint = aw.JointPID(kp=300.0, kd=30.0), 1
    made = scenario(law)
    made = replace(made, loop=replace(made.loop, timing=aw.Timing(), controller=law))
    loop = LinearLoop(made)
    slopes = loop.slopes(POSE, joint=joint)
    held = loop.held(slopes)
    feedback = np.array([[-300.0 - 30.0 / PERIOD, 0.0, 30.0 / PERIOD]])
    whole = np.zeros((3, 3))
    whole[:2, :2] = held.a
    whole[2, 0] = 1.0
    entry = np.vstack([held.new, [[0.0]]])
    noise = entry * feedback[0, 0] + np.array([[0.0], [0.0], [1.0]])
    covariance = solve_discrete_lyapunov(whole + entry @ feedback, noise @ noise.T)
    expected = np.sqrt(feedback @ covariance @ feedback.T + feedback[0, 0] ** 2)[0, 0]
    alone = aw.loops.noise_gain(loop, POSE, joint=joint)
    assert alone.command == pytest.approx(expected, rel=1e-9)
    assert alone.position == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-9)


def test_an_unstable_loop_has_no_norm():
    gain = aw.loops.noise_gain(LinearLoop(scenario(CONTROLLERS["pid"], late=20e-3)), np.array([POSE, POSE]))
    assert gain.command.shape == (2, 2, 2)
    assert np.isnan(gain.command).all()


def test_counts_make_a_limit_cycle_where_a_rounded_sample_is_too_large():
    """An arm without friction under PD on encoders of 500 counts: with a gain margin below 2 the elbow swings for ever."""
    counts = 500
    count = 2 * np.pi / counts
    pose = np.array([0.0, 72 * count])

    def made(factor):
        law = aw.JointPID(kp=[400.0, 400.0 * factor], kd=[60.0, 60.0 * factor])
        found = scenario(law, 4.0, side="link", counts=counts)
        return replace(found, arm=found.arm.replace(gravity=np.zeros(3)), loop=replace(found.loop, reference=pose))

    largest = LinearLoop(made(1.0)).margins(pose).gain_up[1]
    for margin, swings in ((1.1, True), (2.5, False)):
        one = made(largest / margin)
        found = aw.loops.quantisation(LinearLoop(one), pose)
        assert found.count == pytest.approx(count)
        assert found.gain_up[1] == pytest.approx(margin, rel=1e-6)  # of PD, the same as in the command
        assert list(found.may_swing) == [False, swings]
        run = aw.simulate(replace(one, start=pose + np.array([0.0, 3.0 * count])))
        # without friction it drifts from count to count
        reversals = (np.diff(np.sign(run.qd.values[1000:, 1])) != 0).mean()
        assert (reversals > 0.2) == swings
        assert (reversals < 0.02) != swings
        if swings:
            assert 0.5 * np.ptp(run.q.values[1000:, 1]) == pytest.approx(count, rel=0.2)


def test_a_rounded_sine_has_the_factor_of_its_first_harmonic():
    angle = 2.0 * np.pi * (np.arange(200_000) + 0.5) / 200_000
    for amplitude in (0.3, 0.6, 1.0, 1.7, 5.3):
        rounded = np.round(amplitude * np.sin(angle))
        expected = 2.0 * (rounded * np.sin(angle)).mean() / amplitude
        assert rounding_factor(amplitude, 1.0) == pytest.approx(expected, abs=1e-4)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("force", "swings"), [(0.0, True), (2.0, True), (80.0, False)])
def test_describing_functions_foresee_the_amplitude_of_counts_with_coulomb_friction(force, swings):
    """The elbow under PD at a gain margin of 1.1, begun within the limit cycle."""
    count = 2 * np.pi / 500
    pose = np.array([0.0, 72 * count])

    def made(factor):
        law = aw.JointPID(kp=[400.0, 400.0 * factor], kd=[60.0, 60.0 * factor])
        found = scenario(law, 4.0, side="link", counts=500)
        assert found.loop is not None
        arm = found.arm.replace(gravity=np.zeros(3))
        rubs = Friction(coulomb_positive=force, coulomb_negative=force)
        bodies = tuple(replace(body, friction=rubs) if body.joint == "elbow" else body for body in arm.bodies)
        return replace(found, arm=replace(arm, bodies=bodies), loop=replace(found.loop, reference=pose))

    one = made(LinearLoop(made(1.0)).margins(pose).gain_up[1] / 1.1)
    cycle = aw.loops.limit_cycle(LinearLoop(one), pose, 1)
    assert (cycle is not None) == swings
    speed = 5.0 if cycle is None else cycle.amplitude * cycle.frequency
    run = aw.simulate(replace(one, start=aw.Start(pose, np.array([0.0, speed]))))
    late = run.q.values[1000:, 1]
    if cycle is None:
        assert np.ptp(late) < 0.2 * count
        return
    assert 0.5 * np.ptp(late) == pytest.approx(cycle.amplitude, rel=0.15)
    reversals = (np.diff(np.sign(run.qd.values[1000:, 1])) != 0).mean()
    assert np.pi * reversals / PERIOD == pytest.approx(cycle.frequency, rel=0.05)


def test_friction_of_a_motor_damps_a_limit_cycle_behind_a_stiff_gear_as_that_of_its_joint():
    """The rotor's inertia is 0.1 kg m² at the joint, so that a torque and an acceleration differ by a factor of 10."""
    pose = np.array([0.0, 72 * 2 * np.pi / 500])
    made = scenario(aw.JointPID(kp=[400.0, 1387.0], kd=[60.0, 208.0]), counts=10)
    arm = made.arm.replace(gravity=np.zeros(3))
    drive = replace(arm.bodies[1].drive, gear_ratio=50.0, rotor_inertia=4e-5)

    def cycle(on_motor):
        rubs = Friction(coulomb_positive=6.0, coulomb_negative=6.0, on_motor=on_motor)
        elasticity = Elasticity(stiffness=1e7, damping=1e3)
        elbow = replace(arm.bodies[1], drive=drive, friction=rubs, elasticity=elasticity)
        loop = LinearLoop(replace(made, arm=replace(arm, bodies=(arm.bodies[0], elbow))))
        found = aw.loops.limit_cycle(loop, pose, 1)
        assert found is not None
        return found.amplitude, found.frequency

    assert cycle(True) == pytest.approx(cycle(False), rel=1e-3)


def test_a_mode_that_grows_is_that_of_the_joint_that_moves_not_of_a_motor_that_turns_fast():
    made = scenario(aw.JointPID(kp=[400.0, 4000.0], kd=[60.0, 3000.0]))
    arm = made.arm.replace(gravity=np.zeros(3))
    drive = replace(arm.bodies[0].drive, gear_ratio=500.0, rotor_inertia=4e-6)
    shoulder = replace(arm.bodies[0], drive=drive, elasticity=Elasticity(stiffness=2e4, damping=20.0))
    mode = growing_mode(LinearLoop(replace(made, arm=replace(arm, bodies=(shoulder, arm.bodies[1])))), POSE[None])
    assert mode is not None
    assert mode.joint == "elbow"


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_large_oscillation_grows_as_without_counts(name):
    """Of a loop of several rates too, whose maps of all ticks of a cycle count."""
    loop = LinearLoop(scenario(CONTROLLERS[name], counts=5000))
    slopes, count = loop.slopes(POSE), 2 * np.pi / 5000
    growth, _ = limit_cycles._growth(loop, slopes, 1, np.array([1e5 * count]), count, 0.0, 0)
    values = np.linalg.eigvals(reduce(lambda before, then: then @ before, loop.maps(slopes, loop.held(slopes))))
    assert growth[0] == pytest.approx(np.abs(values[np.abs(values.imag) > 1e-9]).max() ** (1.0 / loop.cycle), rel=1e-4)


def test_a_limit_cycle_of_counts_needs_counts():
    with raises_at(aw.ArmwrightError, "joint", "no counts", value="elbow"):
        aw.loops.limit_cycle(LinearLoop(scenario(CONTROLLERS["pid"])), POSE, 1)
    with pytest.raises(aw.ArmwrightError, match="one pose"):
        aw.loops.limit_cycle(LinearLoop(scenario(CONTROLLERS["pid"], counts=500)), [POSE, POSE], 1)
