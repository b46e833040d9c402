"""Inertias over the workspace, longest periods and gain regions, beside closed forms and brute force."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import armwright as aw
from armwright.control.analysis.analyse import HEADS, analyse_loops
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.region_picture import edge_distance
from armwright.errors import ScenarioError

PD = aw.JointPID(kp=300.0, kd=40.0, gravity=True)
POSES = np.array([[0.0, 0.0], [0.3, 1.5], [0.0, 3.0]])


def scenario(controller=None, period=2e-3, **timing):
    controller = controller or aw.JointPID(kp=300.0, kd=40.0, gravity=True)
    return aw.Scenario(
        aw.load("two-link"), duration=1.0, loop=aw.Loop(controller, period=period, timing=aw.Timing(**timing))
    )


def test_inertias_are_the_mass_matrix_s():
    arm = aw.load("puma560")
    found = aw.loops.joint_inertias(arm, 200, seed=3)
    limits = np.array([body.limits.position for body in arm.coordinates])
    assert ((found.q >= limits[:, 0]) & (found.q <= limits[:, 1])).all()
    for k in range(0, 200, 20):
        mass = aw.mass_matrix(arm, found.q[k])
        assert found.held[k] == pytest.approx(np.diag(mass), rel=1e-10)
        assert found.free[k] == pytest.approx(1.0 / np.diag(np.linalg.inv(mass)), rel=1e-9)
        for j in range(6):
            nudge = 1e-6 * (np.arange(6) == j)
            ends = [aw.gravity_torques(arm, found.q[k] + sign * nudge)[j] for sign in (1, -1)]
            assert found.slope[k, j] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-6)
    assert (found.free <= found.held * (1 + 1e-12)).all()
    assert ((found.coupling >= -1e-12) & (found.coupling < 1)).all()


def test_a_period_that_does_not_sample_a_filter_keeps_no_margins():
    slow = scenario(aw.Filtered(PD, [aw.LowPass(240.0)]))
    period, failing = aw.loops.longest_period(slow, POSES)
    assert 2e-3 < period < 0.5 / 240.0
    assert failing is not None
    assert failing == pytest.approx(0.5 / 240.0, rel=2e-3)
    assert analyse_loops(slow, poses=5, progress=False).period_stable == pytest.approx(period, rel=2e-3)


def test_the_longest_period_is_where_stability_ends():
    made = scenario(preset="one-tick")
    period, failing = aw.loops.longest_period(made, POSES)
    assert failing is not None
    assert 0 < failing - period < 1e-3 * period
    assert LinearLoop(made, 0.999 * period).radius(POSES).max() < 1.0 <= LinearLoop(made, failing).radius(POSES).max()
    with_margin, _ = aw.loops.longest_period(made, POSES, gain_margin=2.0, phase_margin=np.radians(30))
    assert with_margin < period


def test_a_loop_that_is_too_slow_is_told_the_rate_that_it_needs():
    slow = scenario(preset="one-tick", period=0.05)
    assert LinearLoop(slow).radius(POSES).max() > 1.0
    assert aw.loops.longest_period(slow, POSES)[0] == pytest.approx(
        aw.loops.longest_period(scenario(preset="one-tick"), POSES)[0], rel=1e-3
    )


@pytest.mark.study
def test_a_region_holds_what_margins_say():
    values = {"kp": np.geomspace(30, 3e4, 6), "kd": np.geomspace(4, 4e3, 6)}
    joint = "elbow"
    region = aw.loops.gain_region(scenario(preset="one-tick"), joint, values, POSES, gain_margin=2.0, phase_margin=0.5)
    assert region.own == (300.0, 40.0)
    assert region.units == ("N m/rad", "N m s/rad")
    assert 0 < region.keeps.sum() < region.keeps.size
    for i, kp in enumerate(values["kp"]):
        for k, kd in enumerate(values["kd"]):
            law = aw.JointPID(kp=[300.0, kp], kd=[40.0, kd], gravity=True)
            margins = LinearLoop(scenario(law, preset="one-tick")).margins(POSES, held=True)
            up, down, phase = (each[:, 1] for each in (margins.gain_up, margins.gain_down, margins.phase))
            assert region.keeps[i, k] == bool(((up > 2.0) & (down < 0.5) & (phase > 0.5)).all())


def test_the_drawn_edge_of_a_region_separates_the_points_of_the_grid():
    """Those that keep the margins lie inside, however thin the region; and a circle's edge has no stairs."""
    x, y = np.meshgrid(np.arange(25.0), np.arange(25.0))
    disc = np.hypot(x - 12, y - 12) < 8.3
    thin = np.zeros_like(disc)
    thin[5, 3:20] = thin[17, 9] = True
    for keeps in (disc, thin, np.ones_like(disc), np.zeros_like(disc)):
        np.testing.assert_array_equal(edge_distance(keeps) > 0, keeps)
    (edge,) = Figure().subplots().contour(edge_distance(disc), levels=[0.0]).allsegs[0]
    assert np.ptp(np.hypot(*(edge - 12).T)) < 0.5  # of the bare points it is 0.65


def test_a_scenario_s_lanes_do_not_change_a_region():
    values = {"kp": np.geomspace(30, 3e4, 3), "kd": np.geomspace(4, 4e3, 3)}
    one = scenario(preset="one-tick")
    lanes = replace(one, vary={"forearm.mass_kg": aw.Batch([1.0, 2.0])}, start=aw.Batch(np.zeros((2, 2))))
    regions = [aw.loops.gain_region(each, "elbow", values, POSES).keeps for each in (one, lanes)]
    np.testing.assert_array_equal(*regions)


def test_regions_shrink_with_delay():
    values = {"kp": np.geomspace(30, 3e4, 12), "kd": np.geomspace(4, 4e3, 12)}
    regions = [
        aw.loops.gain_region(scenario(command_delay=delay), "shoulder", values, POSES).keeps
        for delay in (0.0, 2e-3, 6e-3)
    ]
    assert regions[0].sum() > regions[1].sum() > regions[2].sum() > 0


def test_an_analysis_says_what_is_sampled():
    found = analyse_loops(scenario(preset="one-tick"), 300)
    assert found.stable
    assert found.keeps_margins
    assert [row["joint"] for row in found.rows()] == ["shoulder", "elbow"]
    assert all(len(row) == len(HEADS) for row in found.rows())
    (table,) = found.tables()
    assert {"inertia held [kg m²]", "gravity slope [N m/rad]", "noise gain [N m/rad]"} <= set(table.heads)
    text = " ".join(found.sentences())
    assert "300 sampled poses" in text
    assert f"{1 / found.period_stable:.4g} Hz" in text
    for period, others in ((found.period_held, "held still"), (found.period_free, "free")):
        assert (
            f"up to {1e3 * period:.4g} ms ({100 * (period / found.period_stable - 1):+.2g} %) with the others {others}"
            in text
        )
    assert not replace(found, radius=np.where(np.arange(len(found.radius)) == 3, 1.01, found.radius)).stable
    unstable = analyse_loops(scenario(preset="one-tick", period=0.05), 50)
    assert not unstable.stable
    assert not unstable.keeps_margins
    assert "NOT stable" in unstable.sentences()[1]


@pytest.mark.parametrize(
    ("call", "place"),
    [
        (lambda: aw.loops.gain_region(scenario(), "wrist", {"kp": [1], "kd": [1]}, POSES), "joint"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", {"kp": [1]}, POSES), "gains"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", {"kp": [1], "speed_kp": [1]}, POSES), "gains"),
        (lambda: aw.loops.longest_period(scenario(), POSES, gain_margin=0.5), "gain_margin"),
        (lambda: aw.loops.longest_period(scenario(), POSES, phase_margin=4), "phase_margin"),
        (lambda: aw.loops.joint_inertias(aw.load("two-link"), 0), "poses"),
        (lambda: aw.loops.longest_period(scenario(), POSES, others="moving"), "others"),
        (lambda: aw.loops.longest_period(None, POSES), "scenario"),
        (lambda: aw.loops.longest_period(scenario(), POSES[:0]), "q"),
        (lambda: aw.loops.longest_period(scenario(aw.JointPID(kp=aw.Batch([1.0, 2.0]))), POSES), "loop.controller"),
        (lambda: aw.loops.gain_region(None, "elbow", {"kp": [1], "kd": [1]}, POSES), "scenario"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", None, POSES), "gains"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", {"kp": ["a"], "kd": [1]}, POSES), "gains['kp']"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", {"kp": [], "kd": [1]}, POSES), "gains['kp']"),
        (lambda: aw.loops.gain_region(scenario(aw.FeedForward(PD)), "elbow", {"kp": [1], "kd": [1]}, POSES), "gains"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", {"kp": [1], "kd": [1]}, np.zeros((0, 2))), "q"),
        (lambda: aw.loops.joint_inertias(aw.load("two-link"), "many"), "poses"),
        (lambda: aw.loops.joint_inertias(aw.load("two-link"), [[0.0, 0.0, 0.0]]), "q"),
        (lambda: aw.loops.analyse_loops(scenario(), 10, seed=-1), "seed"),
        (lambda: aw.loops.noise_gain(None, POSES), "loop"),
        (lambda: aw.loops.noise_gain(LinearLoop(scenario()), POSES, joint=7), "joint"),
        (lambda: LinearLoop(scenario()).radius(POSES, gains=[1.0, 2.0]), "gains"),
        (lambda: aw.loops.longest_period(scenario(), [[0.0]]), "q"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", {"kp": [1], "kd": [1]}, [0.0, 0.0, 0.0]), "q"),
        (lambda: aw.loops.gain_region(scenario(), "elbow", {"kp": [1], "kd": [1]}, ["0", "1"]), "q"),
    ],
)
def test_refused(call, place):
    with pytest.raises(ScenarioError) as error:
        call()
    assert error.value.problems[0].place == place


@pytest.mark.study
def test_a_direct_drive_joint_by_itself_is_no_answer():
    """Without gears the other joints decide: each joint by itself seems stable at periods at which the coupled loop is not."""
    arm = aw.load("cmu-dd")
    law = aw.JointPID(kp=[800, 1800, 600, 300, 60, 40], kd=[80, 180, 60, 24, 6, 4], gravity=True)
    made = aw.Scenario(arm, duration=1.0, loop=aw.Loop(law, period=1e-3, timing=aw.Timing("one-tick")))
    poses = aw.loops.joint_inertias(arm, 2000)
    q = poses.q[poses.extremes()][::4]
    coupled, held, free = (aw.loops.longest_period(made, q, others=others)[0] for others in ("closed", "held", "free"))
    assert held > 1.4 * coupled
    assert free > 1.1 * coupled
