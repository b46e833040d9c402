"""Joint motions along tool paths: the path kept, derivatives, limits, and paths that no joint motion follows."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.errors import ModelError, ScenarioError
from armwright.scalar import Symbol
from physics.arms import arm, description
from raises_at import raises_at
from trajectory.path_problems import HOME, largest_use, random_tool_motion


@functools.cache
def compiled(name):
    return aw.compile(arm(name))


def moved(pose, way=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    """A pose further on in base axes."""
    new = np.array(pose, dtype=float)
    new[:3, 3] += way
    new[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ new[:3, :3]
    return new


def home(name):
    """A pose of the tip in the middle of its space."""
    return compiled(name).forward_kinematics(np.array(HOME[name]))


def errors(poses, others):
    """Largest distance and angle between poses (k, 4, 4)."""
    turn = Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(others[:, :3, :3], 1, 2)).magnitude()
    return np.linalg.norm((poses - others)[:, :3, 3], axis=1).max(), turn.max()


def corner(name, blend=0.01):
    """A path of two lines and an arc."""
    start = home(name)
    middle = moved(start, [0.0, 0.1, 0.02], [0.1, 0.0, 0.2])
    end = moved(middle, [-0.1, 0.0, 0.05], [0.0, 0.1, 0.0])
    arc = aw.trajectories.Arc(moved(end, [-0.03, -0.03, 0.0])[:3, 3], moved(end, [-0.03, -0.08, 0.02]))
    return aw.trajectories.CartesianPath(
        [aw.trajectories.Line(middle), aw.trajectories.Line(end), arc], start, blend=blend
    )


def solved(model, path, near):
    """The solution of a path, or the sentence why there is none."""
    try:
        return aw.trajectories.solve_path(model, path, near=near)
    except ScenarioError as error:
        return str(error)


@pytest.mark.study
@settings(max_examples=9)
@given(st.sampled_from(sorted(HOME)), st.integers(0, 2**32 - 1))
def test_random_lines_are_straight(name, seed):
    """Between poses that are reachable: solved within 1e-6 m and rad on a dense grid, or refused for a reason."""
    rng, dyn, start = np.random.default_rng(seed), compiled(name), np.array(HOME[name])
    goal = dyn.forward_kinematics(start + rng.uniform(-0.5, 0.5, len(start)))
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(goal)], home(name))
    solution = solved(arm(name), path, start)
    if isinstance(solution, str):
        assert any(word in solution for word in ("singular", "out of reach", "leaves its limits"))
        return
    s = np.linspace(0.0, path.length, 2777)
    q, first, _ = solution.at(s)
    off, angle = errors(dyn.forward_kinematics(q), path.at(s)[0])
    assert max(off, angle) < 1e-6
    low, high = aw.trajectories.MotionLimits.of(arm(name)).position.T
    assert ((q > low - 1e-6) & (q < high + 1e-6)).all()
    assert np.abs(np.diff(q, axis=0)).max() < 1.1 * np.abs(first).max() * path.length / 2776  # nothing jumps


@settings(max_examples=12)
@given(st.integers(0, 10**6))
@pytest.mark.study
def test_limits_hold_on_a_denser_grid_at_random(seed):
    """Whatever the path and its blend, and whatever is slower; of 2,000 seeds: tools/motion_seeds.py."""
    try:
        model, motion, limits = random_tool_motion(seed)
    except ScenarioError:
        return
    assert largest_use(model, motion, limits, 40) <= 1.0 + 1e-6
    jerk = np.abs(motion.profile.derivative().derivative().extrema(1)).max()
    assert jerk <= 50.0 * (1.0 + 1e-6)  # an acceleration of 5 m/s² is reached in 0.1 s
    t, h = np.random.default_rng(seed).uniform(0.0, motion.duration, 20_000), 1e-6
    joints = (motion.at(t + h)[2] - motion.at(t - h)[2])[(t > h) & (t < motion.duration - h)] / (2.0 * h)
    assert np.abs(joints).max() <= 500.0 * (1.0 + 1e-4)  # by differences


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", sorted(HOME))
def test_the_tool_stays_on_its_path_as_pinocchio_has_it(name):
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from reference.peers import Pinocchio

    model = arm(name)
    path = corner(name)
    solution = aw.trajectories.solve_path(model, path, near=HOME[name])
    peer = Pinocchio(description(name), model.tree.names)
    s = np.linspace(0.0, path.length, 400)
    poses = np.array([peer.forward_kinematics(q) for q in solution.at(s)[0]])
    assert max(errors(poses, path.at(s)[0])) < 1e-6
    assert max(solution.deviation) < 1e-6


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", sorted(HOME))
def test_velocity_and_acceleration_of_the_tool_are_the_paths(name):
    model, path = arm(name), corner(name)
    motion = aw.trajectories.follow_path(model, path, 0.1, 0.5, near=HOME[name])
    t = np.linspace(0.0, motion.duration, 101)[1:-1]
    q, qd, qdd = motion.at(t)
    s, rate, change = (each[:, 0] for each in motion.profile.at(t))
    _, first, second = path.at(s)
    jacobian, drift = compiled(name).jacobian(q), compiled(name).jacobian_dot_qd(q, qd)
    twist = (jacobian @ qd[:, :, None])[:, :, 0]
    np.testing.assert_allclose(twist, first * rate[:, None], atol=1e-5)
    bend = second * rate[:, None] ** 2 + first * change[:, None]
    np.testing.assert_allclose((jacobian @ qdd[:, :, None])[:, :, 0] + drift, bend, atol=2e-3)


def test_a_motion_is_even_between_smooth_ends_and_its_derivatives_are_its_own():
    model, path = arm("puma560"), corner("puma560", blend=0.02)
    motion = aw.trajectories.follow_path(model, path, 0.1, 2.0, near=HOME["puma560"], time=0.5)
    assert motion.slowed == 1.0
    t = np.linspace(0.5, 0.5 + motion.duration, 1501)
    q, qd, qdd = motion.at(t)
    np.testing.assert_allclose(qd[[0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(qdd[[0, -1]], 0.0, atol=1e-6)
    h = 1e-5
    (low, slow, _), (high, fast, _) = motion.at(t[1:-1] - h), motion.at(t[1:-1] + h)
    np.testing.assert_allclose((high - low) / (2.0 * h), qd[1:-1], atol=1e-6)
    np.testing.assert_allclose((fast - slow) / (2.0 * h), qdd[1:-1], atol=2e-3)
    speed = np.linalg.norm((compiled("puma560").jacobian(q) @ qd[:, :, None])[:, :3, 0], axis=1)
    cruising = (t > 0.7) & (t < 0.3 + motion.duration)
    np.testing.assert_allclose(speed[cruising], 0.1, rtol=1e-4)
    np.testing.assert_array_equal(motion.at(0.0)[0], motion.at(0.5)[0])
    np.testing.assert_array_equal(motion.at(99.0)[1], 0.0)
    assert motion.breaks[0] == 0.5
    assert motion.breaks[-1] == pytest.approx(0.5 + motion.duration)


@pytest.mark.study
def test_limits_slow_the_whole_motion_or_are_named():
    model, path, near = arm("puma560"), corner("puma560"), HOME["puma560"]
    limits = aw.trajectories.MotionLimits.of(model, velocity=0.3, acceleration=2.0, jerk=30.0)
    motion = aw.trajectories.follow_path(model, path, 0.5, 20.0, near=near, limits=limits)
    assert motion.slowed > 1.0
    assert motion.reasons
    t, h = np.linspace(0.0, motion.duration, 50_001), 1e-6
    _, qd, qdd = motion.at(t)
    jerk = (motion.at(t + h)[2] - motion.at(t - h)[2])[1:-1] / (2.0 * h)
    shares = [np.abs(qd).max() / 0.3, np.abs(qdd).max() / 2.0, np.abs(jerk).max() / 30.0]
    assert 0.999 < max(shares) < 1.0 + 1e-4  # of jerk, by differences; no slower than need be
    assert max(shares[:2]) < 1.0 + 1e-6
    with pytest.raises(ScenarioError, match="would need") as error:
        aw.trajectories.follow_path(model, path, 0.5, 20.0, near=near, limits=limits, slow="nowhere")
    assert "path at s" in error.value.place
    allowed = aw.trajectories.follow_path(model, path, 0.5 / motion.slowed, 20.0, near=near, limits=limits)
    assert allowed.slowed < motion.slowed


def test_the_tools_acceleration_counts_its_bends():
    path = corner("puma560", blend=0.005)
    motion = aw.trajectories.follow_path(arm("puma560"), path, 0.3, 1.0, near=HOME["puma560"])
    assert motion.slowed > 1.0
    assert "tool's acceleration" in motion.reasons[0]
    t = np.linspace(0.0, motion.duration, 20001)
    s, rate, change = (each[:, 0] for each in motion.profile.at(t))
    _, first, second = path.at(s)
    acceleration = (second * rate[:, None] ** 2 + first * change[:, None])[:, :3]
    assert 0.99 < np.linalg.norm(acceleration, axis=1).max() < 1.0 + 1e-6


def test_the_best_solution_at_the_beginning_is_found_without_a_pose():
    path, model = corner("lwa4p"), arm("lwa4p")
    solution = aw.trajectories.solve_path(model, path)
    q = solution.at(np.linspace(0.0, path.length, 500))[0]
    assert max(errors(compiled("lwa4p").forward_kinematics(q), path.at(np.linspace(0.0, path.length, 500))[0])) < 1e-6


def test_a_redundant_arm_moves_little_or_goes_to_a_posture():
    model, path = arm("panda"), corner("panda")
    near = np.array(HOME["panda"])
    still = aw.trajectories.solve_path(model, path, near=near)
    posture = near + np.array([0.4, 0.0, -0.4, 0.0, 0.2, 0.0, 0.0])
    drawn = aw.trajectories.solve_path(model, path, near=near, posture=posture)
    ends = [each.at(path.length)[0] for each in (still, drawn)]
    assert np.linalg.norm(ends[1] - posture) < 0.85 * np.linalg.norm(ends[0] - posture)
    ways = [np.abs(each.at(np.linspace(0.0, path.length, 500))[1]).mean() for each in (still, drawn)]
    assert ways[0] < ways[1]
    assert max(*still.deviation, *drawn.deviation) < 1e-6


def test_positions_alone_leave_the_rotation_free():
    model = arm("two-link")
    start = aw.forward_kinematics(model, np.array([0.4, 1.0]))
    goal = aw.forward_kinematics(model, np.array([0.9, 1.4]))
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(goal[:3, 3])], start)
    solution = aw.trajectories.solve_path(model, path, near=[0.4, 1.0], aim="position")
    s = np.linspace(0.0, path.length, 300)
    poses = aw.compile(model).forward_kinematics(solution.at(s)[0])
    np.testing.assert_allclose(poses[:, :3, 3], path.at(s)[0][:, :3, 3], atol=1e-6)
    with pytest.raises(ScenarioError):  # two joints cannot keep a rotation as well
        aw.trajectories.solve_path(model, path, near=[0.4, 1.0])


def test_stops_and_turns_in_place():
    model, start = arm("puma560"), home("puma560")
    turned = moved(start, turn=[0.2, 0.3, 0.0])
    path = aw.trajectories.CartesianPath(
        [aw.trajectories.Line(turned), aw.trajectories.Line(moved(turned, [0.0, 0.05, 0.0]))], start
    )
    with raises_at(ScenarioError, "angular_speed", "in place"):
        aw.trajectories.follow_path(model, path, 0.1, 1.0, near=HOME["puma560"])
    motion = aw.trajectories.follow_path(
        model, path, 0.1, 1.0, tool=aw.trajectories.ToolLimits(None, 0.5, 2.0), near=HOME["puma560"]
    )
    assert len(motion.solution.runs) == 2
    t = motion.times([path.breaks[1]])
    np.testing.assert_allclose(motion.at(t)[1], 0.0, atol=1e-6)
    poses = compiled("puma560").forward_kinematics(motion.at(np.linspace(0.0, motion.duration, 1000))[0])
    on_path = path.at(motion.profile.at(np.linspace(0.0, motion.duration, 1000))[0][:, 0])[0]
    assert max(errors(poses, on_path)) < 1e-6


def test_a_loop_follows_the_motion():
    model = arm("puma560")
    motion = aw.trajectories.follow_path(model, corner("puma560"), 0.1, 0.5, near=HOME["puma560"])
    run = aw.simulate(
        aw.Scenario(
            model, duration=1.0, start=motion.at(0.0)[0],
            loop=aw.Loop(aw.ComputedTorque(kp=400.0, kd=40.0), motion, 1e-3),
        )
    )  # fmt: skip
    assert run.attrs["controller"] == "compiled"
    np.testing.assert_allclose(run.q_reference.values[500], motion.at(0.5)[0], atol=1e-12)
    with pytest.raises(ScenarioError, match="traced"):
        motion(Symbol.named("t"))


def wrist_path(offset):
    """A line of `puma560` that passes its wrist's singularity, where two axes lie on one line, at a distance."""
    q = np.array([0.2, -0.8, 0.4, 0.3, 0.0, 0.2])
    middle = compiled("puma560").forward_kinematics(q)
    side = moved(middle, [0.0, 0.0, offset])
    return aw.trajectories.CartesianPath(
        [aw.trajectories.Line(moved(side, [0.0, 0.1, 0.0]))], moved(side, [0.0, -0.1, 0.0])
    )


def test_a_singularity_on_the_path_is_named_with_its_place_and_joint():
    with pytest.raises(ScenarioError, match=r"singular: joint '(wrist|flange)_roll'") as error:
        aw.trajectories.solve_path(arm("puma560"), wrist_path(0.0))
    assert "s = 0.1 of 0.2 m" in error.value.place


def test_a_singularity_beside_the_path_is_named_with_the_speed_that_it_would_need():
    model = arm("puma560")
    limits = aw.trajectories.MotionLimits.of(model, velocity=4.0)
    path = wrist_path(1e-4)
    with pytest.raises(ScenarioError, match=r"joint '\w+' .* [\d.]+ rad/s") as error:
        aw.trajectories.follow_path(model, path, 0.25, 1.0, limits=limits)
    assert 0.09 < float(str(error.value.place).split()[4]) < 0.11
    solution = aw.trajectories.solve_path(model, path)  # it exists, and needs those speeds
    rates = np.abs(solution.at(np.linspace(0.095, 0.105, 2001))[1]).max()
    said = float(str(error.value).split("would need ")[1].split()[0])
    assert said == pytest.approx(0.25 * rates, rel=0.02)


def test_a_path_out_of_reach_says_where_and_how_far():
    model, start = arm("puma560"), home("puma560")
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(moved(start, [0.8, 0.0, 0.0]))], start)
    with pytest.raises(ScenarioError, match="of reach") as error:
        aw.trajectories.solve_path(model, path, near=HOME["puma560"])
    place = float(str(error.value.place).split()[4])
    reachable = aw.inverse_kinematics(model, path.at(np.array([place - 1e-3, place + 1e-3]))[0]).success
    np.testing.assert_array_equal(reachable, [True, False])
    far = moved(start, [5.0, 0.0, 0.0])
    with pytest.raises(ScenarioError, match="of reach") as error:
        aw.trajectories.solve_path(model, aw.trajectories.CartesianPath([aw.trajectories.Line(start)], far))
    assert "s = 0 of" in error.value.place


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("name", "q", "way", "off"),
    [
        ("lwa4p", np.zeros(6), [0.0, 5.0, 0.0], None),  # stretched out, sideways
        ("two-link", np.zeros(2), [0.0, 0.05, 0.0], np.hypot(1.8, 0.05) - 1.8),
        ("puma560", [0.3, -0.8, 0.4, 0.2, 0.0, 0.0], [5.0, 0.0, 0.0], None),  # a straight wrist
    ],
)
def test_a_goal_out_of_reach_is_said_of_a_path_that_begins_in_a_singularity(name, q, way, off):
    start = compiled(name).forward_kinematics(np.array(q))
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(start[:3, 3] + way)], start)
    with pytest.raises(ScenarioError, match=r"of reach .* mm") as error:
        aw.trajectories.solve_path(arm(name), path, near=q, aim="pose" if len(q) > 2 else "position")
    if off is not None:
        assert f"nearest pose is {1e3 * off:.3g} mm off" in str(error.value)


def test_a_limit_of_position_is_named_with_the_joint_and_how_far():
    model = arm("puma560")
    limits = aw.trajectories.MotionLimits.of(model, position={"elbow": (0.35, 0.6)})
    path = corner("puma560")
    with pytest.raises(ScenarioError, match=r"joint 'elbow' .* [\d.]+ rad") as error:
        aw.trajectories.solve_path(model, path, near=HOME["puma560"], limits=limits)
    free = aw.trajectories.solve_path(model, path, near=HOME["puma560"])
    elbow = free.at(np.linspace(0.0, path.length, 2000))[0][:, 2]
    beyond = max(0.35 - elbow.min(), elbow.max() - 0.6)
    assert float(str(error.value).split("and is ")[1].split()[0]) == pytest.approx(beyond, rel=0.02)


@pytest.mark.parametrize(
    ("changes", "kind", "place"),
    [
        ({"speed": 0.0}, ScenarioError, "speed"),
        ({"acceleration": None}, ScenarioError, "acceleration"),
        ({"near": [0.0]}, ScenarioError, "near"),
        ({"tool": 3.0}, ScenarioError, "tool"),
        ({"time": np.inf}, ScenarioError, "time"),
        ({"path": 3}, ScenarioError, "path"),
        ({"arm": 5}, ModelError, "arm"),
        ({"limits": 3.0}, ScenarioError, "limits"),
        ({"limits": aw.trajectories.MotionLimits.of(arm("panda"))}, ScenarioError, "limits"),
    ],
)
def test_arguments_that_make_no_motion_are_refused(changes, kind, place):
    values = {"arm": arm("puma560"), "path": corner("puma560"), "speed": 0.1, "acceleration": 1.0} | changes
    with pytest.raises(kind) as error:
        aw.trajectories.follow_path(**values)
    assert error.value.place == place


@pytest.mark.parametrize(
    ("changes", "kind", "place"),
    [
        ({"near": [0.0]}, ScenarioError, "near"),
        ({"posture": [np.nan] * 6}, ScenarioError, "posture"),
        ({"tolerance": 0.0}, ScenarioError, "tolerance"),
        ({"aim": "turn"}, ModelError, "aim"),
        ({"path": 3}, ScenarioError, "path"),
    ],
)
def test_arguments_that_make_no_solution_are_refused(changes, kind, place):
    with pytest.raises(kind) as error:
        aw.trajectories.solve_path(**{"arm": arm("puma560"), "path": corner("puma560")} | changes)
    assert error.value.place == place


@pytest.mark.parametrize("limit", ["jerk", "angular_speed", "angular_acceleration"])
def test_a_limit_of_the_tool_that_is_none_is_refused(limit):
    for value in (-1.0, np.nan, "fast"):
        with pytest.raises(ScenarioError) as error:
            aw.trajectories.ToolLimits(**{limit: value})
        assert error.value.place == limit


def test_a_solution_of_another_arm_or_with_another_beginning_is_refused():
    solution = aw.trajectories.solve_path(arm("puma560"), corner("puma560"), near=HOME["puma560"])
    with pytest.raises(ScenarioError) as error:
        aw.trajectories.follow_path(arm("panda"), solution, 0.1, 1.0)
    assert error.value.place == "path"
    with pytest.raises(ScenarioError) as error:
        aw.trajectories.follow_path(arm("puma560"), solution, 0.1, 1.0, near=HOME["puma560"])
    assert error.value.place == "near"


def test_a_run_is_planned_time_optimally_and_stays_on_the_path():
    model, path = arm("puma560"), corner("puma560", blend=0.02)
    solution = aw.trajectories.solve_path(model, path, near=HOME["puma560"])
    limits = aw.trajectories.MotionLimits.of(model, velocity=1.0, acceleration=8.0, torque=np.inf, voltage=np.inf)
    fastest = aw.trajectories.time_optimal(model, solution.runs[0], limits)
    even = aw.trajectories.follow_path(model, path, 0.3, 5.0, near=HOME["puma560"], limits=limits)
    assert fastest.duration < even.duration
    reached = compiled("puma560").forward_kinematics(fastest.at(np.linspace(0.0, fastest.duration, 300))[0])
    dense = path.at(np.linspace(0.0, path.length, 20001))[0][:, :3, 3]
    gaps = np.linalg.norm(reached[:, None, :3, 3] - dense, axis=2).min(axis=1)
    assert gaps.max() < 2.0 * path.length / 20000


def test_a_solution_is_for_its_arm_and_within_the_limits():
    """Of another arm with joints of the same names, and beyond limits that are given later."""
    lwa4p, q = aw.load("lwa4p"), [0.2, 0.4, 0.6, 0.1, 0.5, 0.2]
    end = (start := aw.compile(lwa4p).forward_kinematics(q)).copy()
    end[2, 3] -= 0.05
    solution = aw.trajectories.solve_path(
        lwa4p, aw.trajectories.CartesianPath([aw.trajectories.Line(end)], start), near=q
    )
    assert aw.trajectories.follow_path(lwa4p, solution, 0.05, 0.5).duration > 1.0
    with pytest.raises(ScenarioError, match="solved for lwa4p"):
        aw.trajectories.follow_path(aw.load("cmu-dd"), solution, 0.05, 0.5)
    limits = aw.trajectories.MotionLimits.of("lwa4p", position=0.1)
    with pytest.raises(ScenarioError, match="'joint1' leaves"):
        aw.trajectories.follow_path(lwa4p, solution, 0.05, 0.5, limits=limits)
