"""Heat of motors as a limit of time-optimal motions: closed forms, an integral of its own over the motion, bad input."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from trajectory.path_problems import largest_use, random_path

WAY = 1.2  # [rad] of the first joint alone


def mean_torque(arm: aw.Model, motion: Motion, count: int = 100_001) -> np.ndarray:
    """√(∫ tau² dt / T) (n,) by even times and the trapezoidal rule."""
    t = np.linspace(motion.breaks[0], motion.breaks[-1], count)
    return np.sqrt(np.trapezoid(aw.compile(arm).inverse_dynamics(*motion.at(t)) ** 2, t, axis=0) / np.ptp(t))


def turntable() -> tuple[aw.Model, float]:
    """An arm whose first joint turns it without weight and friction, and its inertia [kg m²] about that joint."""
    arm = aw.load("two-link").replace(gravity=[0.0, 0.0, 0.0], friction=None, efficiency=None)
    return arm, float(aw.mass_matrix(arm, np.zeros(2))[0, 0])


def test_a_mass_on_a_straight_line_takes_no_more_time_than_with_its_mean_torque_all_the_way() -> None:
    """T = 2 √(J Δq / tau) forth and back; with a = a₀ (1 - 2 t/T), the optimum, the mean is J a₀/√3 and the way a₀ T²/6.
    A cruise at v between accelerations a, which takes T = Δq/v + v/a, has the mean J a √(2 v / (a T))."""
    arm, inertia = turntable()
    limits = MotionLimits.of(arm, torque=50.0, velocity=np.inf, voltage=np.inf)
    motion = aw.trajectories.time_optimal(arm, [[0.0, 0.0], [WAY, 0.0]], limits, rms_torque={"shoulder": 10.0})
    best = np.sqrt(6.0 * inertia * WAY / (np.sqrt(3.0) * 10.0))
    assert best < motion.duration < 2.002 * np.sqrt(inertia * WAY / 10.0)
    assert mean_torque(arm, motion)[0] == pytest.approx(10.0, rel=2e-3)


def test_a_trapezoid_of_speed_is_the_fastest_that_its_heat_allows() -> None:
    """Of all cruises at v or less: 2 v J² a = tau_rms² (Δq/v + v/a) is quadratic in the acceleration a at both ends."""
    arm, inertia = turntable()
    fastest, allowed = 0.5, 3.0
    limits = MotionLimits.of(arm, torque=50.0, velocity=fastest, voltage=np.inf)
    motion = aw.trajectories.time_optimal(arm, [[0.0, 0.0], [WAY, 0.0]], limits, rms_torque={"shoulder": allowed})
    durations = []
    for v in np.linspace(0.3 * fastest, fastest, 400):
        a = float(np.max(np.roots([2.0 * v * inertia**2, -(allowed**2) * WAY / v, -(allowed**2) * v])))
        durations.append(WAY / v + v / a)
    assert motion.duration == pytest.approx(min(durations), rel=2e-3)
    assert mean_torque(arm, motion)[0] <= allowed * (1.0 + 1e-3)


@pytest.mark.parametrize(("name", "seed"), [("cmu-dd", 0), ("cmu-dd", 1), ("lwa4p", 0)])
@pytest.mark.sample(1)
def test_motors_stay_within_their_mean_torque_and_all_other_limits(name: str, seed: int) -> None:
    arm = aw.load(name)
    path, limits = random_path(arm, seed, 4), MotionLimits.of(arm)
    fast = aw.trajectories.time_optimal(arm, path, limits, grid=200)
    hot = mean_torque(arm, fast)
    allowed, low, high = 0.85 * hot, 0.0, 1.0
    for _ in range(12):  # played slower as a whole until the same heat is kept
        middle = 0.5 * (low + high)
        is_cool = (mean_torque(arm, replace(fast, x=middle * fast.x), 5001) <= allowed).all()
        low, high = (middle, high) if is_cool else (low, middle)
    slow = fast.duration / np.sqrt(low)
    motion = aw.trajectories.time_optimal(arm, path, limits, grid=200, rms_torque=allowed)
    found = mean_torque(arm, motion)
    np.testing.assert_allclose(motion.rms_torque, found, rtol=1e-4)
    assert (found <= allowed * (1.0 + 1e-4)).all()
    assert (found / allowed).max() > 0.995
    assert largest_use(arm, motion, limits) <= 1.0 + 1e-6
    assert fast.duration < motion.duration < 1.001 * slow


@pytest.mark.study
@pytest.mark.parametrize("torques", [True, False])
def test_motors_stay_cool_beside_a_limit_of_jerk(torques: bool) -> None:
    arm = aw.load("cmu-dd")
    path, limits = random_path(arm, 0, 4), MotionLimits.of(arm, acceleration=20.0, jerk=400.0)
    limits = limits if torques else limits.replace(torque=np.inf, voltage=np.inf)
    smooth = aw.trajectories.time_optimal(arm, path, limits)
    hot = mean_torque(arm, smooth)
    motion = aw.trajectories.time_optimal(arm, path, limits, rms_torque=0.85 * hot)
    found = mean_torque(arm, motion)
    np.testing.assert_allclose(motion.rms_torque, found, rtol=1e-4)
    assert 0.995 < (found / (0.85 * hot)).max() <= 1.0 + 1e-4
    assert largest_use(arm, motion, limits) <= 1.0 + 1e-6
    assert motion.polynomial.largest(3).max() <= 400.0 * (1.0 + 1e-6)
    assert smooth.duration < motion.duration < 1.2 * smooth.duration


def test_a_limit_that_is_kept_anyway_changes_nothing() -> None:
    arm = aw.load("cmu-dd")
    path = random_path(arm, 0)
    usual = aw.trajectories.time_optimal(arm, path, grid=60)
    motion = aw.trajectories.time_optimal(arm, path, grid=60, rms_torque=1.01 * mean_torque(arm, usual))
    np.testing.assert_array_equal(motion.x, usual.x)
    assert usual.rms_torque is None
    np.testing.assert_allclose(motion.rms_torque, mean_torque(arm, usual), rtol=1e-4)


def test_motors_that_get_too_hot_and_bad_input_are_named() -> None:
    arm = aw.load("two-link")
    path = aw.trajectories.JointPath([[0.0, 0.0], [1.2, 0.4]])
    for changes, said in (
        (
            {"rms_torque": {"shoulder": 1.0}},
            r"rms_torque = 1.*holding the arm along the path takes [\d.]+ N m of shoulder",
        ),
        ({"rms_torque": -1.0}, "rms_torque = -1"),
        ({"rms_torque": {"knee": 1.0}}, "rms_torque = 'knee': no joint of the arm"),
        ({"rms_torque": 100.0, "speeds": (0.1, 0.0)}, "speeds = .*rms_torque"),
    ):
        with pytest.raises(ScenarioError, match=said):
            aw.trajectories.time_optimal(arm, path, MotionLimits.of(arm, torque=500.0), grid=60, **changes)
