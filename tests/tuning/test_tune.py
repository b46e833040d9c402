"""Tuned gains: better on held-out lanes, never without margins, the same for a seed, and clear about bad input."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.errors import Interrupted
from armwright.tuning.margins import MarginTest
from armwright.tuning.objective import BEYOND, Objective
from armwright.tuning.space import GainSpace
from raises_at import raises_at

pytest.importorskip("cma", reason="cma is not installed: pip install armwright[control]")


def scenario(kp=(600.0, 120.0), kd=(60.0, 10.0), period=2e-3, **more):
    law = aw.JointPID(kp=np.array(kp), kd=np.array(kd), gravity=True)
    loop = aw.Loop(law, reference=[0.3, 0.2], period=period, timing=aw.Timing(preset="one-tick"))
    return aw.Scenario(aw.load("two-link"), duration=0.4, loop=loop, **more)


def quick(found, gains=None, *, lanes=16, generations=6, poses=100, **more):
    margins = aw.tuning.MarginConstraint(more.pop("gain_margin", None), more.pop("phase_margin", None), poses)
    asked = {
        name: more.pop(name)
        for name in ("over", "seed", "method", "candidates", "improve_each", "front")
        if name in more
    }
    search = aw.tuning.Search(generations=generations, **asked)
    return aw.tuning.tune(found, gains, lanes=lanes, margins=margins, search=search, **more)


@pytest.fixture(scope="module")
def result():
    return quick(scenario())


@pytest.mark.study
def test_a_detuned_controller_gets_better_on_lanes_that_nobody_tuned_in(result):
    assert result.start_keeps
    assert result.improved
    assert result.score[1] < 0.9 * result.score[0]
    # judged anew, by arms of another seed and a plain simulation
    rng = np.random.default_rng(12345)
    vary = {
        f"{link}.mass_kg": aw.Batch(mass * rng.uniform(0.7, 1.3, 20))
        for link, mass in (("upper_arm", 6), ("forearm", 4))
    }
    errors = []
    for each in (scenario(), result.scenario):
        run = aw.simulate(replace(each, vary=vary, recording=aw.Recording(what="none", reduce=("rms_error",))))
        errors.append(run.rms_error.values.mean(axis=0))
    assert (errors[1] / errors[0]).mean() < 0.85


def test_the_returned_gains_keep_the_margins_at_poses_of_another_draw(result):
    loop = aw.loops.LinearLoop(result.scenario)
    margins = loop.margins(np.random.default_rng(5).uniform(-2.0, 2.0, (40, 2)))
    # asked for at extreme poses: a factor of 2 and 30°
    assert margins.radius.max() < 1.0
    assert margins.gain_up.min() > 1.98
    assert margins.gain_down.max() < 0.51
    assert np.degrees(margins.phase.min()) > 29.5


@pytest.mark.study
def test_without_the_margin_better_gains_exist_so_that_it_binds(result):
    free = quick(scenario(), gain_margin=1.0, phase_margin=0.0)
    tight = quick(scenario(), phase_margin=np.radians(55.0))
    assert free.score[1] < tight.score[1]
    q = np.random.default_rng(5).uniform(-2.0, 2.0, (40, 2))
    assert np.degrees(aw.loops.LinearLoop(tight.scenario).margins(q).phase.min()) > 54.0


@pytest.mark.study
def test_a_seed_gives_the_same_gains_and_numpys_global_numbers_stay(result):
    global_numbers: Any = np.random.get_state
    state = global_numbers()[1].copy()
    again = quick(scenario())
    assert all(np.array_equal(again.gains[name], result.gains[name]) for name in result.gains)
    assert np.array_equal(again.history, result.history)
    assert np.array_equal(global_numbers()[1], state)
    other = quick(scenario(), seed=1)
    assert any((other.gains[name] != result.gains[name]).any() for name in result.gains)


def test_a_start_that_nothing_beats_is_returned():
    # of which a torque drive without limits has none
    found = quick(scenario(), generations=2, objectives={"saturation": 1.0})
    assert not found.improved
    assert found.score == (0.0, 0.0)
    assert found.gains["kp"].tolist() == [600.0, 120.0]
    assert found.scenario.controller.kd.tolist() == [60.0, 10.0]
    assert "the start is returned" in found.sentences()[0]


@pytest.mark.sample(1)
@pytest.mark.parametrize("noise", [0.9, 1.1])
def test_what_is_worse_in_one_objective_improves_nothing_where_each_shall_be_better(monkeypatch, noise):
    """Of a start and gains that are compared on lanes held out."""
    means = Objective.means

    def compared(self, values, scales):
        found = means(self, values, scales)
        held_out = self.levels is None and len(found["noise_gain"]) == 2
        return {"rms_error": np.array([1.0, 0.5]), "noise_gain": np.array([1.0, noise])} if held_out else found

    monkeypatch.setattr(Objective, "means", compared)
    found = quick(scenario(), objectives={"rms_error": 1.0, "noise_gain": 0.01}, improve_each=True)
    assert found.improved == (noise < 1.0)


def test_ctrl_c_keeps_a_complete_generation():
    def stop(done, total):
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="after 1 of 6 generations") as stopped:
        quick(scenario(), progress=stop)
    assert len(stopped.value.found.history) == 2


def test_lanes_of_the_scenario_are_the_uncertainty():
    varied = scenario(start=aw.Start(aw.Draw.uniform([-0.2, -0.2], [0.2, 0.2])), lanes=12)
    found = quick(varied, {"kp": (100.0, 4000.0)}, generations=3, over="worst")
    assert found.lanes == (6, 6)
    assert found.scenario.lane_count == 12
    assert set(found.gains) == {"kp"}
    assert found.score[1] <= found.score[0]


def test_a_joint_at_rest_is_measured_by_a_tenth_of_those_that_move_as_it_does():
    """A micrometre, or a microradian, of a joint at rest must not weigh what a moving joint's whole error does."""
    arm = aw.load("examples/scara.toml")  # whose third joint slides
    loop = aw.Loop(aw.JointPID(kp=100.0, kd=10.0), reference=np.zeros(4), period=1e-3)
    asked: Any = (
        aw.Scenario(arm, duration=0.01, loop=loop),
        None,
        {"rms_error": 1.0, "peak_torque": 1.0},
        {},
        False,
        None,
    )
    values = np.array([[[0.02, 1e-6, 1e-5, 0.004]]])  # rad, rad, m, rad
    scales = Objective(*asked).scales({"rms_error": values, "peak_torque": values})
    assert scales["rms_error"] == pytest.approx([0.02, 0.002, 1e-5, 0.004])
    assert scales["peak_torque"] == pytest.approx([0.02, 2e-5, 2e-5, 0.004])


@pytest.mark.study
def test_limits_hold_a_peak_back():
    peaks = [
        quick(scenario(), limits=limits).held_out["peak_torque"][1].max()
        for limits in ({"peak_torque": 1e6}, {"peak_torque": 150.0})
    ]
    assert peaks[1] < 0.8 * peaks[0]


def test_a_start_without_margins_is_tuned_for_them_or_refused():
    slow = scenario(kp=(150.0, 40.0), kd=(5.0, 1.0))
    try:
        found = quick(slow, {"kp": 1.01}, generations=2)
    except aw.ArmwrightError as error:
        text = str(error)
        assert "no gains found that keep a gain margin" in text
        assert "\n" not in text
    else:
        pytest.fail(f"returned {found.gains}")


def test_a_start_without_margins_is_tuned_from_the_gains_that_loops_recommends():
    fast = scenario(kp=(9000.0, 1200.0), kd=(300.0, 60.0))
    slower = aw.loops.analyse_loops(fast, poses=100).remedies.gains
    found = quick(fast, generations=1, candidates=4)
    assert not found.start_keeps
    nearest = [np.abs(row / np.concatenate([slower["kp"], slower["kd"]]) - 1.0).max() for row in found.tried.gains]
    assert min(nearest) < 1e-3  # rounded to four digits


def test_gains_that_fail_at_all_poses_are_told_apart():
    fast = scenario(kp=(24000.0, 4800.0), kd=(1000.0, 200.0))
    margins = MarginTest(fast, GainSpace.of(fast, None), 100, 0, (2.0, np.pi / 6.0))
    fastest = np.array([24000.0, 4800.0, 1000.0, 200.0])
    gains = np.array([fastest, 0.9 * fastest, [600.0, 120.0, 60.0, 10.0]])
    far, near, kept = margins.excess(gains)
    assert far > near > kept == 0.0


def test_a_limit_costs_by_its_excess():
    """Relative to the limit, as the mean of the joints: 4 N m at a limit of 2 are once the limit beyond it."""
    one = scenario()
    limits = {"peak_torque": np.array([4.0, 2.0])}
    objective = Objective(
        one, GainSpace.of(one, None), {"rms_error": 1.0}, limits, worst=False, linear=lambda *_: np.zeros(2)
    )
    values = {"rms_error": np.ones((1, 1, 2)), "peak_torque": np.array([[[2.0, 4.0]]])}
    assert objective.score(values, {"rms_error": np.ones(2)}) == pytest.approx(1.0 + BEYOND * 0.5)


def test_runs_that_fail_count_as_infinite():
    one = scenario(vary={"forearm.mass_kg": aw.Batch([3.0, 4.0, 5.0, 6.0])})
    space = GainSpace.of(one, None)
    objective = Objective(one, space, {"rms_error": 1.0}, {}, worst=False, linear=lambda name, gains: gains)
    wild = np.array([space.start, np.array([4e7, 2e7, 0.0, 0.0])])
    values = objective.values(wild, np.arange(4))
    scores = objective.score(values, objective.scales({name: each[:1] for name, each in values.items()}))
    assert np.isfinite(scores[0])
    assert np.isinf(scores[1])


@pytest.mark.parametrize(
    ("gains", "more", "words"),
    [
        ({"kq": 2.0}, {}, "'kq'"),
        ({"kp": 1.0}, {}, "a factor above 1"),
        ({"kp": (1.0, 2.0)}, {}, "hold the start"),
        ({"kp": (0.0, 2.0)}, {}, "0 < low < high"),
        ({"kp": "wide"}, {}, "a factor above 1"),
        ({"ki": 2.0}, {}, "is 0 at the start"),
        ({}, {}, "bounds by name"),
        (None, {"objectives": {"rms": 1.0}}, "rms_error"),
        (None, {"objectives": {"rms_error": -1.0}}, "0 or more"),
        (None, {"objectives": {"rms_error": 0.0}}, "above 0"),
        (None, {"limits": {"peak_torque": 0.0}}, "above 0"),
        (None, {"limits": {"peak_force": 1.0}}, "limits = 'peak_force': unknown"),
        (None, {"limits": {"peak_voltage": 1.0}}, "voltage"),
        (None, {"lanes": 2}, "lanes"),
        (None, {"generations": 0}, "generations"),
        (None, {"candidates": 1}, "candidates"),
        (None, {"over": "median"}, "over"),
        (None, {"gain_margin": 0.5}, "gain_margin"),
        (None, {"draws": {"arm.mass": aw.Draw.uniform(1, 2)}}, "arm.mass"),
        (None, {"draws": {}}, "nothing differs"),
    ],
)
def test_bad_input(gains, more, words):
    with pytest.raises(aw.ArmwrightError) as caught:
        quick(scenario(), gains, **more)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unstable_start_gains_are_refused():
    with raises_at(aw.ArmwrightError, "loop.controller", "unstable"):
        quick(scenario(period=0.05))


def test_an_arm_that_only_holds_its_pose_has_nothing_to_tune_for():
    still = scenario(start=[-np.pi / 2, 0.0])  # hanging, which no mass changes
    assert still.loop is not None
    with raises_at(aw.ArmwrightError, "loop.reference", "to track"):
        quick(replace(still, loop=replace(still.loop, reference=None)))


def test_a_scenario_without_a_controller():
    with raises_at(aw.ArmwrightError, "loop", "no controller"):
        quick(aw.Scenario(aw.load("two-link"), duration=0.1, command=[0.0, 0.0]))
