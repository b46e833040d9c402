"""Motions as references of scenario files: every kind by its name, with limits of the record or of the file."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from physics.arms import arm

FILE = """
robot = "lwa4p"
duration_s = 0.05

[loop]
period_s = 0.01
controller = {{ kind = "computed_torque", kp = 100.0, kd = 20.0 }}

[loop.reference]
{reference}
"""
START, GOAL = "start = [0, 0, 0, 0, 0, 0]", "goal = [0.01, -0.02, 0, 0, 0.02, 0.01]"


def reference_of(tmp_path, text):
    path = tmp_path / "a.scenario.toml"
    path.write_text(FILE.format(reference=text))
    scenario = aw.read_scenario(path)
    return scenario, scenario.loop.reference


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("kind", "limits"),
    [
        ("cubic", ""),
        ("quintic", ""),
        ("minimum_jerk", "acceleration = 3.0\njerk = 50.0"),
        ("trapezoid", "acceleration = 3.0"),
        ("s_curve", "acceleration = { joint1 = 2.0, joint5 = 1.0 }\njerk = 50.0"),
    ],
)
def test_every_kind_runs(tmp_path, kind, limits):
    scenario, motion = reference_of(tmp_path, f'kind = "{kind}"\n{START}\n{GOAL}\n{limits}')
    np.testing.assert_array_equal(motion.limits.velocity, 1.2566)
    run = aw.simulate(scenario)
    np.testing.assert_allclose(run.q_reference.values, motion.at(run.time.values)[0], atol=1e-12)
    assert run.q_reference.values[-1, 0] > 0.0


def test_a_duration_needs_no_limits(tmp_path):
    _, motion = reference_of(tmp_path, f'kind = "quintic"\n{START}\n{GOAL}\nduration = 0.01')
    assert motion.limits is None
    assert motion.duration == 0.01


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f'kind = "trapezoid"\n{START}\n{GOAL}', "loop.reference.*acceleration .*joint1"),
        (f'kind = "trapezoid"\n{START}\n{GOAL}\nspeed = 1.0', "speed.*"),
        (f'kind = "trapezoid"\n{START}\n{GOAL}\nacceleration = -1.0', "acceleration = -1.0"),
        (f'kind = "trapezoid"\n{START}\n{GOAL}\nacceleration = {{ elbow = 1.0 }}', "'elbow': no joint"),
        (f'kind = "quintic"\n{START}\n{GOAL}\nduration = 0.01\nvelocity = 1.0', "duration = 0.01: expected 0.0"),
        ('kind = "piecewise_polynomial"', "unknown"),
        ('kind = "motion_limits"', "unknown"),
    ],
)
def test_bad_references_are_refused(tmp_path, text, said):
    with pytest.raises(ScenarioError, match=said):
        reference_of(tmp_path, text)


def test_a_planned_motion_is_followed():
    model = arm("two-link")
    limits = aw.trajectories.MotionLimits.of(model, position=3.0, velocity=3.0, acceleration=10.0, jerk=100.0)
    motion = aw.trajectories.SCurve([0.1, 0.2], [0.8, -0.4], limits, time=0.05)
    loop = aw.Loop(controller=aw.ComputedTorque(kp=400.0, kd=40.0), reference=motion, period=1e-3)
    run = aw.simulate(aw.Scenario(model, duration=1.6, start=[0.1, 0.2], loop=loop))
    np.testing.assert_allclose(run.q.values[-1], [0.8, -0.4], atol=1e-2)
