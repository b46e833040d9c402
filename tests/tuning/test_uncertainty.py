"""Differences between the lanes that gains are tuned over."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.model import build_model
from armwright.parameters import lane_values, numbers_by_lane
from armwright.simulation.loop.references import LoopReference
from armwright.tuning.lanes import scenario_lanes
from armwright.tuning.uncertainty import Uncertainty
from raises_at import raises_at


def scenario(**loop):
    law = aw.JointPID(kp=100.0, kd=10.0)
    return aw.Scenario(aw.load("two-link"), duration=0.4, loop=aw.Loop(law, period=2e-3, **loop))


def drawn(one, draws, lanes=200):
    return scenario_lanes(one, draws, lanes, 3)


def test_masses_and_friction_stay_within_what_was_asked():
    arm = aw.load("lwa4p")
    one = aw.Scenario(arm, duration=0.4, loop=aw.Loop(aw.JointPID(kp=10.0), period=4e-3))
    found = drawn(one, {"mass": 0.2, "friction": 2.0})
    masses = lane_values(found.vary["link2.mass_kg"]) / 1.62
    assert 0.8 < masses.min() < 0.83
    assert 1.17 < masses.max() < 1.2
    viscous = lane_values(found.vary["joint1.friction.viscous_n_m_s_per_rad"]) / 17.89
    assert 0.5 < viscous.min() < 0.55
    assert 1.85 < viscous.max() < 2.0
    assert abs(np.log(viscous).mean()) < 0.1
    coulomb = lane_values(found.vary["joint1.friction.coulomb_positive_n_m"]) / 6.84
    assert coulomb == pytest.approx(viscous)  # all torques of a joint together


def test_friction_is_announced_only_of_arms_that_have_some():
    words = Uncertainty.of({"mass": 0.2, "friction": 2.0}).words
    assert words(aw.load("lwa4p")) == ["masses within ±20 %", "friction within a factor of 2"]
    for arm in (aw.load("cmu-dd").replace(friction=None), aw.load("lwa4p").replace(friction=None)):
        assert words(arm)[1] == "no friction, of which the arm has none"


def test_numbers_of_the_record_are_drawn_by_their_deviations():
    record = aw.load("two-link").record
    link = record.links[0]
    heavy = link.replace(mass_kg=link.mass_kg.replace(std=0.05))
    arm = build_model(record.replace(links=(heavy, *record.links[1:])))
    found = drawn(replace(scenario(), arm=arm), {"record": True})
    name = f"{link.name}.mass_kg"
    assert set(found.vary) == {name}
    values = lane_values(found.vary[name])
    assert values.std() == pytest.approx(0.05, rel=0.2)
    assert values.mean() == pytest.approx(float(link.mass_kg), abs=0.02)


def test_start_and_reference_are_moved_together_within_the_limits():
    arm = aw.load("lwa4p")
    high = np.array([body.limits.position[1] for body in arm.coordinates])
    start, end = high - 0.5, high - 0.05
    motion = aw.trajectories.Quintic(start=start, goal=end, duration=0.3)
    one = aw.Scenario(arm, duration=0.4, start=start, loop=aw.Loop(aw.JointPID(kp=10.0), reference=motion, period=4e-3))
    found = drawn(one, {"poses": 0.3})
    assert found.loop is not None
    offset = lane_values(found.start.q) - start
    assert (offset <= 0.05 + 1e-12).all()
    assert offset.min() < -0.28
    reference = LoopReference.of(arm, found.loop.reference, lane_values(found.start.q), range(101), 4e-3)
    assert reference.final == pytest.approx(offset + end)
    pose = drawn(scenario(reference=[0.3, 0.2]), {"poses": 0.1})
    assert pose.loop is not None
    assert lane_values(pose.loop.reference) - [0.3, 0.2] == pytest.approx(lane_values(pose.start.q))


def test_payloads_delays_and_jitter():
    found = drawn(scenario(timing=aw.Timing("one-tick")), {"payload_kg": [0.5, 2.0], "delay_s": 1e-3, "jitter_s": 2e-4})
    assert found.loop is not None
    masses, delays = found.inputs.payload.mass.values, numbers_by_lane(found.loop.timing.command_delay)
    assert 0.5 <= masses.min() < 0.55
    assert 1.95 < masses.max() <= 2.0
    assert delays.min() >= 0.0
    assert 0.9e-3 < delays.max() <= 1e-3
    assert found.loop.timing.jitter == 2e-4
    assert found.lane_count == 200


def test_draws_join_the_lanes_that_the_scenario_has():
    own = replace(scenario(reference=[0.3, 0.2]), start=aw.Start(aw.Draw.uniform([-0.1, -0.1], [0.1, 0.1])), lanes=12)
    found = drawn(own, {"mass": 0.1, "forearm.mass_kg": aw.Draw.uniform(2.0, 3.0)}, lanes=64)
    assert found.lane_count == 12
    assert len(found.start.q) == 12
    assert lane_values(found.vary["forearm.mass_kg"]).max() <= 3.0
    assert set(drawn(own, None).vary) == set()


@pytest.mark.parametrize(
    ("draws", "words"),
    [
        ({"masses": 0.1}, "mass"),
        ({"mass": 1.5}, "below 1"),
        ({"friction": 0.5}, "above 1"),
        ({"poses": -1.0}, "poses"),
        ({"payload_kg": [2.0, 1.0]}, "the most"),
        ({"jitter_s": "much"}, "jitter_s"),
        ({"record": True}, "nothing differs"),
        (0.3, "by name"),
    ],
)
def test_bad_draws(draws, words):
    with pytest.raises(aw.ArmwrightError) as caught:
        drawn(scenario(), draws)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_payloads_beside_payloads_are_refused():
    loaded = replace(scenario(), inputs=aw.Inputs(payload=aw.Payload(0.0, 1.0, np.zeros(3), np.zeros(3))))
    with raises_at(aw.ArmwrightError, "draws.payload_kg", r"\[lanes\.vary\]"):
        drawn(loaded, {"payload": (0.0, 1.0)})
