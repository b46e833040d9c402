"""Enumerating arms of modules, what they hold and reach, and ranking them for a task."""

from __future__ import annotations

import itertools
from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import DescriptionError
from armwright.kinematics import forward_kinematics
from armwright.model import Model, build_model
from armwright.modules.assemble import assemble
from armwright.modules.chains import Rules, chains, possible_modules
from armwright.modules.cycle_time import rest_to_rest, shortest_round
from armwright.modules.enumerate import arm_of
from armwright.modules.inverse_kinematics import inverse_kinematics
from armwright.modules.library import ModuleLibrary
from armwright.modules.rank import STARTS
from armwright.modules.statics import holding, ranges, static_torques
from armwright.modules.task import Task
from armwright.validation import validated
from modules.modules_of_tests import body, frame, library
from raises_at import raises_at


def toy(document: dict[str, Any] | None = None) -> ModuleLibrary:
    return validated(ModuleLibrary, document or library(), file="toy.modules.toml")


@pytest.fixture(scope="module")
def lwa4p() -> Model:
    return build_model(aw.modules.assemble("lwa4p"))


def sequences(document: dict[str, Any], max_joints: int, max_links: int) -> set[tuple[tuple[str, int], ...]]:
    """Chains of the toy library by brute force: every word over its modules, kept where it obeys the rules."""
    steps = {"elbow": 4, "bar": 4, "hand": 2}
    found = set()
    for length in range(1, 2 * max_joints + 3):
        for word in itertools.product(["elbow", "bar", "hand"], repeat=length):
            joints, counts = word.count("elbow"), {name: word.count(name) for name in steps}
            if not 1 <= joints <= min(max_joints, 2) or counts["bar"] > 1 or counts["hand"] > 1:
                continue
            if "hand" in word[:-1]:  # nothing stands on its grip
                continue
            runs = [
                len(list(run)) for moving, run in itertools.groupby(word, lambda name: name == "elbow") if not moving
            ]
            ending = word[-1] == "hand"
            if any(run - (ending and k == len(runs) - 1) > max_links for k, run in enumerate(runs)):
                continue
            turns = [range(1 if k == 0 else steps[name]) for k, name in enumerate(word)]
            found |= {tuple(zip(word, turn, strict=True)) for turn in itertools.product(*turns)}
    return found


@pytest.mark.parametrize(("max_joints", "max_links"), [(1, 0), (1, 1), (2, 1), (2, 2)])
def test_every_chain_is_there_once(max_joints: int, max_links: int) -> None:
    """Against brute force. The first module is not turned: that would only turn the arm about the vertical."""
    modules, left_out = possible_modules(toy())
    assert not left_out
    listed = [
        tuple((step.module, step.turn[0] if step.turn else 0) for step in chain.steps[1:])
        for chain in chains(modules, Rules(max_joints, 1, max_links))
    ]
    assert len(listed) == len(set(listed))
    assert set(listed) == sequences(library(), max_joints, max_links)


def test_turned_about_the_vertical_only_where_a_task_asks() -> None:
    modules, _ = possible_modules(toy())
    plain, turned = (sum(1 for _ in chains(modules, Rules(2, 1, 1, turned=t))) for t in (False, True))
    assert plain < turned <= 4 * plain


def test_modules_that_move_alike_are_one() -> None:
    document = library()
    twin = {**document["modules"][1], "name": "elbow2", "title": "the same again", "available": 3}
    document["modules"].append(twin)
    modules, left_out = possible_modules(toy(document))
    assert left_out == {"elbow2": "it is like elbow"}
    assert next(module for module in modules if module.name == "elbow").available == 5
    twin["joints"] = [{**twin["joints"][0], "limits": {"torque_n_m": 61.0}}]
    assert not possible_modules(toy(document))[1]


def test_impossible_modules_are_left_out_and_named() -> None:
    found = aw.modules.enumerate_assemblies(aw.modules.read_modules("improv"), max_joints=2, limit=3)
    assert set(found.left_out) == {"PB24", "L5"}
    assert "triangle inequality" in found.left_out["L5"]
    assert len(found.candidates) == 3 < found.total


@pytest.mark.study
def test_every_assembly_is_one_that_can_be_made() -> None:
    """Names, masses and joints of what is listed are those of the arm that `assemble` makes."""
    seen = []
    found = aw.modules.enumerate_assemblies(
        toy(), max_joints=2, limit=40, progress=lambda done, total: seen.append((done, total))
    )
    assert seen[-1] == (40, 40)
    for candidate in found.candidates[::7]:
        arm = build_model(assemble(candidate.assembly, [toy()]))
        assert arm.n == candidate.joints
        assert arm.description is not None
        assert arm.description.total_mass == pytest.approx(candidate.mass)
        low, high = ranges(arm)
        for q in np.random.default_rng(0).uniform(low, high, (20, arm.n)):
            assert np.linalg.norm(forward_kinematics(arm, q)[:3, 3]) <= candidate.reach + 1e-9


def test_the_reach_of_a_known_arm() -> None:
    """Straight up is as far as the LWA 4P comes: 0.1013 + 0.35 + 0.3012 + 0.0748 m."""
    modules, _ = possible_modules(aw.modules.read_modules("improv"))
    names = ["base", "PB21", "L1", "PB22", "L2", "PB23"]
    for chain in chains(modules, Rules(6, 6, 1)):
        if [step.module for step in chain.steps] == names:
            assert chain.reach == pytest.approx(0.8273, abs=1e-12)
            assert chain.mass == pytest.approx(12.32)
            return
    pytest.fail("the LWA 4P is not among them")


def lever(torque: float = 50.0, sense: float = 1.0) -> Model:
    """A horizontal axis 0.5 m up with a lever of 1.1 m: 3 kg whose centre of mass is 0.4 m out."""
    document = library()
    document["modules"][1] |= {
        "bodies": [body("lower"), body("upper", 3.0, (0.0, 0.0, 0.4))],
        "joints": [
            {"name": "turn", "type": "revolute", "parent": "lower", "child": "upper", "frame": frame(0.0, 0.0, 0.3),
             "axis": [0.0, sense, 0.0], "limits": {"torque_n_m": torque}}
        ],
    }  # fmt: skip
    document["modules"][1]["connectors"][1]["frame"] = frame(0.0, 0.0, 1.1)
    modules, _ = possible_modules(toy(document))
    chain = next(chain for chain in chains(modules, Rules(1)) if chain.steps[-1].module == "elbow")
    return arm_of(chain, toy(document))[1]


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_payload_of_a_lever(sense: float) -> None:
    """Stretched out:  L = g (m c + payload l)."""
    g = 9.80665
    held = holding(lever(sense=sense))
    assert held.payload == pytest.approx((50.0 / g - 3.0 * 0.4) / 1.1, rel=1e-4)
    assert held.holds_itself
    assert held.joint == "elbow_turn"
    assert abs(np.sin(held.q[0])) == pytest.approx(1.0, abs=1e-3)
    weak = holding(lever(torque=5.0, sense=sense))
    assert (weak.payload, weak.holds_itself) == (0.0, False)


def test_payload_is_the_worst_of_many_poses(lwa4p: Model) -> None:
    """Twenty thousand other poses find none that is worse by more than a percent."""
    held = holding(lwa4p)
    low, high = ranges(lwa4p)
    gravity, load = static_torques(lwa4p, np.random.default_rng(5).uniform(low, high, (20_000, 6)))
    limits = np.array([body.limits.torque for body in lwa4p.bodies])
    worst = ((limits - np.sign(load) * gravity) / np.maximum(np.abs(load), 1e-9)).min()
    assert held.payload <= 1.01 * worst
    assert held.payload > 0.0


def test_static_torques_are_the_float_reference(lwa4p: Model) -> None:
    q, com = np.random.default_rng(6).uniform(-2, 2, (3, 6)), np.array([0.03, -0.02, 0.1])
    gravity, load = static_torques(lwa4p, q, com)
    for k in range(3):
        np.testing.assert_allclose(gravity[k], aw.gravity_torques(lwa4p, q[k]), atol=1e-12)
        arm = forward_kinematics(lwa4p, q[k])[:3, :3] @ com
        wrench = np.concatenate([lwa4p.gravity, np.cross(arm, lwa4p.gravity)])
        both = aw.inverse_dynamics(lwa4p.replace(friction=None), q[k], np.zeros(6), np.zeros(6), wrench)
        np.testing.assert_allclose(gravity[k] + load[k], both, atol=1e-12)


@pytest.mark.study
@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**31))
def test_poses_that_can_be_reached_are_reached(seed: int) -> None:
    arm = build_model(aw.modules.assemble("lwa4p"))
    low, high = ranges(arm)
    poses = np.stack([forward_kinematics(arm, q) for q in np.random.default_rng(seed).uniform(low, high, (4, 6))])
    q, off, angle = inverse_kinematics(arm, poses, np.array([True, True, False, True]), STARTS)
    assert (q >= low).all()
    assert (q <= high).all()
    best = np.argmin(off + angle * np.array([1, 1, 0, 1])[:, None], axis=1)
    for k in range(4):
        pose = forward_kinematics(arm, q[k, best[k]])
        np.testing.assert_allclose(pose[:3, 3], poses[k, :3, 3], atol=1e-6)
        if k != 2:
            np.testing.assert_allclose(pose, poses[k], atol=1e-5)


def test_times_from_rest_to_rest() -> None:
    v, a = np.array([2.0, np.inf, 1.0]), np.array([4.0, 8.0, np.inf])
    assert rest_to_rest(np.array([3.0, 0, 0]), v, a) == pytest.approx(3 / 2 + 2 / 4)
    assert rest_to_rest(np.array([-0.25, 0, 0]), v, a) == pytest.approx(2 * np.sqrt(0.25 / 4))
    assert rest_to_rest(np.array([0, 2.0, 0]), v, a) == pytest.approx(1.0)
    assert rest_to_rest(np.array([0, 0, 5.0]), v, a) == pytest.approx(5.0)
    assert rest_to_rest(np.array([1.0, 1.0]), np.array([np.inf] * 2), np.array([np.inf] * 2)) == 0.0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 4))
def test_the_shortest_round_is_the_shortest(seed: int, poses: int) -> None:
    random = np.random.default_rng(seed)
    choices = [random.normal(size=(random.integers(1, 4), 2)) for _ in range(poses)]
    v, a = np.array([1.0, 2.0]), np.array([3.0, 1.0])

    def length(picked: tuple[int, ...]) -> float:
        stops = [c[k] for c, k in zip(choices, picked, strict=True)]
        return sum(float(rest_to_rest(stops[k] - stops[(k + 1) % poses], v, a)) for k in range(poses))

    time, picked = shortest_round(choices, v, a)
    assert time == pytest.approx(min(length(word) for word in itertools.product(*(range(len(c)) for c in choices))))
    assert time == pytest.approx(length(tuple(picked)))


def task(**changes: Any) -> Task:
    poses = [
        {"name": "pick", "xyz_m": [0.35, 0.15, 0.35], "rpy_rad": [pi, 0.0, 0.0]},
        {"name": "place", "xyz_m": [0.30, -0.25, 0.30]},
    ]
    fields = {"name": "sort", "source": "definition", "payload_kg": 2.0, "payload_com_m": [0.0, 0.0, 0.05],
              "cycle_time_s": 8.0, "position_tolerance_m": 1e-3, "angle_tolerance_rad": 1e-2, "poses": poses}  # fmt: skip
    return validated(Task, {**fields, **changes}, file="sort.task.toml")


def test_what_is_called_feasible_is() -> None:
    """Poses, torques and times of the first arms, computed again from the arms and the plain functions."""
    library, wanted = aw.modules.read_modules("improv"), task()
    ranking = aw.modules.rank_assemblies(library, wanted, min_joints=6, limit=8)
    assert len(ranking.ranked) == 8 < ranking.long_enough <= ranking.total
    order = [(not r.feasible, -len(r.reached), -r.margin, r.mass) for r in ranking.ranked]
    assert order == sorted(order)
    assert ranking.ranked[0].feasible
    for found in [r for r in ranking.ranked if r.feasible][:3]:
        arm = build_model(assemble(found.assembly, [library])).replace(friction=None)
        margins = []
        for q, pose in zip(found.q, wanted.poses, strict=True):
            tip = forward_kinematics(arm, q)
            assert np.linalg.norm(tip[:3, 3] - np.array(pose.xyz_m)) <= 1e-3
            if pose.rpy_rad is not None:
                assert np.arccos(min(1.0, (np.trace(tip[:3, :3].T @ pose.matrix()[:3, :3]) - 1) / 2)) <= 1e-2
            pull = 2.0 * arm.gravity
            wrench = np.concatenate([pull, np.cross(tip[:3, :3] @ [0, 0, 0.05], pull)])
            tau = aw.inverse_dynamics(arm, q, np.zeros(6), np.zeros(6), wrench)
            limits = np.array([body.limits.torque for body in arm.bodies])
            assert all(
                body.limits.position[0] <= v <= body.limits.position[1] for body, v in zip(arm.bodies, q, strict=True)
            )
            margins.append(float((1 - np.abs(tau) / limits).min()))
        assert found.torque_margin == pytest.approx(min(margins), abs=1e-9)
        assert found.torque_margin >= found.margin >= 0.0
        assert found.cycle_time <= 8.0


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"payload_kg": 80.0}, "of its torque limit at pose"),
        ({"cycle_time_s": 0.5}, "a round takes"),
    ],
)
def test_why_an_arm_does_not_do_it(changes: dict[str, Any], why: str) -> None:
    library = aw.modules.read_modules("improv")
    few = [library.module(name) for name in ("base", "PB21", "L1", "PB22", "L2", "PB23")]
    poses = [{"name": "pick", "xyz_m": [0.35, 0.15, 0.35]}, {"name": "place", "xyz_m": [0.30, -0.25, 0.30]}]
    wanted = task(**changes, poses=poses)
    first = aw.modules.rank_assemblies(library.replace(modules=few), wanted, min_joints=6, limit=4).ranked[0]
    assert not first.feasible
    assert why in first.why_not
    assert first.margin < 0.0


def test_poses_out_of_reach() -> None:
    far = task(poses=[{"name": "moon", "xyz_m": [0.0, 0.0, 30.0]}])
    found = aw.modules.rank_assemblies(toy(), far, max_joints=2)
    assert (found.ranked, found.long_enough) == ((), 0)
    below = task(poses=[{"name": "cellar", "xyz_m": [0.0, 0.0, -0.55]}])
    assert all(
        "does not come to cellar" in r.why_not
        for r in aw.modules.rank_assemblies(toy(), below, max_joints=1, limit=3).ranked
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"payload_kg": -1}, "payload_kg = -1: expected a number of 0 or more"),
        ({"angle_tolerance_rad": None}, "pose 'pick' has rpy_rad; expected angle_tolerance_rad"),
        ({"poses": []}, "poses"),
        (
            {"poses": [{"name": "a", "xyz_m": [0, 0, float("nan")]}]},
            "pose 'a' xyz_m = [0, 0, nan]: expected a finite number",
        ),
        ({"poses": [{"name": "a", "xyz_m": [0, 0, 1]}] * 2}, "name = 'a': two poses have this name"),
        ({"speed": 1}, "speed = 1: unknown key"),
    ],
)
def test_tasks_that_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        task(**changes)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("rules", "place", "value", "expected"),
    [
        ({"max_joints": 0}, "max_joints", 0, "1 or more"),
        ({"min_joints": 0}, "min_joints", 0, "1 or more"),
        ({"min_joints": 5, "max_joints": 4}, "max_joints", 4, "5 or more"),
        ({"max_links": -1}, "max_links", -1, "0 or more"),
        ({"limit": 0}, "limit", 0, "1 or more"),
    ],
)
def test_rules_that_are_refused(rules: dict[str, Any], place: str, value: int, expected: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        aw.modules.enumerate_assemblies(toy(), **rules)
    assert (caught.value.place, caught.value.value, caught.value.expected) == (place, value, expected)


def test_rules_that_leave_nothing_are_refused() -> None:
    with raises_at(DescriptionError, "library 'toy'", "6 to 6 joints"):
        aw.modules.enumerate_assemblies(toy(), min_joints=6)


def test_a_library_without_a_ground_makes_no_arm() -> None:
    document = library()
    del document["modules"][0]["ground"]
    with raises_at(DescriptionError, "library 'toy'", r"ground = \.\.\."):
        aw.modules.enumerate_assemblies(toy(document))
