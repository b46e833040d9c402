"""Every feature with every consumer: what is declared is what happens, and nothing is ignored in silence.

Each consumer answers twice, for a small arm or scenario with the feature and for one without it.
"""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.content import checksum
from armwright.description.robot import RobotDescription
from armwright.features import ARM, CONSUMERS as DECLARED, FEATURES, GROUPS, SCENARIO, declared
from features.cases import ARMS, SCENARIOS, TOGETHER, arms, base, together
from features.consumers import CONSUMERS

PAIRS = [
    (name, feature)
    for name, each in CONSUMERS.items()
    for feature in declared(each.support).features
    if each.each_alone or feature not in TOGETHER or declared(each.support).outcome(feature)[0] != "exact"
]
SMALLER = {"branches", "mimic joints", "payload", "locked joints"}  # whose key is none of the record's


def same(a, b):
    """True if both answers have the same bits."""
    return len(a) == len(b) and all(_equal(x, y) for x, y in zip(a, b, strict=True))


def _equal(x, y):
    if isinstance(x, str) or isinstance(y, str):
        return x == y
    x, y = np.asarray(x), np.asarray(y)
    return x.shape == y.shape and np.array_equal(x, y, equal_nan=x.dtype.kind == "f")


def subjects(consumer, feature):
    """An arm or a scenario with the feature, and one without it, as the consumer takes them."""
    if feature in SCENARIO:
        return SCENARIOS[feature](base(consumer.command))
    return tuple(each if consumer.of is None else consumer.of(each) for each in arms(feature, consumer.command))


def names_it(text, feature):
    """True if a text has the feature's words or a part of its key."""
    groups = {group for group, features in GROUPS.items() if feature in features}
    words = {feature, FEATURES[feature].about, FEATURES[feature].key.rpartition(".")[2], *groups}
    return any(word.lower() in text.lower() for word in words)


BARE = {}  # answers for arms without a feature, which most features share, by consumer and arm


def without_it(name, feature, without, folder, moved):
    """A consumer's answer for what has not the feature."""
    answer = CONSUMERS[name].answer
    if moved or feature in SCENARIO:
        return answer(without, folder, **moved)
    key = (name, checksum(getattr(without, "arm", without)))
    if key not in BARE:
        BARE[key] = replace(answer(without, folder), found=None)
    return BARE[key]


def check(name, feature, folder):
    """Asserts that a consumer does with a feature what it declares."""
    consumer = CONSUMERS[name]
    support = declared(consumer.support)
    outcome, words = support.outcome(feature)
    made, without = subjects(consumer, feature)
    for part in ("with", "without"):
        (folder / part).mkdir()
    if outcome == "refused":
        with pytest.raises(aw.ArmwrightError) as error:
            consumer.answer(made, folder / "with")
        assert names_it(str(error.value), feature) or words in str(error.value), str(error.value)
        return
    logged = "moved" in inspect.signature(consumer.answer).parameters and outcome != "exact"
    moved = {"moved": made} if logged else {}  # the same log of the arm with the feature, for either record
    answer = consumer.answer(made, folder / "with", **moved)
    bare = without_it(name, feature, without, folder / "without", moved)
    if outcome == "without effect":
        assert same(answer.values, bare.values), f"{feature} has an effect"
    elif outcome == "approximated":
        own = [line for line in answer.notes.splitlines() if line not in bare.notes]
        assert any(names_it(line, feature) for line in own), f"no note about {feature}: {answer.notes!r}"
        assert FEATURES[feature].about not in bare.notes, f"a note about {feature}, which is not there"
    else:
        assert not same(answer.values, bare.values), f"{feature} is ignored"
        if consumer.each_pair:
            consumer.law(made, answer, folder / "with")


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", CONSUMERS)
def test_what_a_consumer_counts_exactly_it_counts_together(name, tmp_path):
    consumer = CONSUMERS[name]
    support = declared(consumer.support)
    served = [feature for feature in TOGETHER if support.outcome(feature)[0] == "exact"]
    arm = together(served, consumer.command)
    made = arm if consumer.of is None else consumer.of(arm)
    consumer.law(made, consumer.answer(made, tmp_path), tmp_path)


def once(name):
    """The first refused feature of a consumer, and else the first one that is not exact."""
    support = declared(CONSUMERS[name].support)
    found = [(support.outcome(feature)[0], feature) for feature in support.features]
    return next((f for outcome, f in found if outcome == "refused"), next((f for o, f in found if o != "exact"), None))


@pytest.mark.study
@pytest.mark.parametrize(("name", "feature"), PAIRS)
def test_each_feature_is_to_each_consumer_what_it_declares(name, feature, tmp_path):
    check(name, feature, tmp_path)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", [name for name in CONSUMERS if once(name) is not None])
def test_what_is_not_exact_is_said(name, tmp_path):
    check(name, once(name), tmp_path)


def test_every_declaration_is_walked_and_every_feature_has_a_case():
    places = [place for group in DECLARED.values() for place in group]
    assert sorted(places) == sorted(each.support for each in CONSUMERS.values())
    assert set(ARMS) | {"payload", "locked joints"} == set(ARM)
    assert set(SCENARIOS) == set(SCENARIO)
    assert {name for group in GROUPS.values() for name in group} <= set(FEATURES)


@pytest.mark.parametrize("feature", [*ARMS, *SCENARIOS])
def test_a_feature_is_seen_where_it_is(feature):
    made, without = SCENARIOS[feature](base()) if feature in SCENARIOS else arms(feature)
    assert list(FEATURES[feature].where(made))
    if feature != "pose":
        assert not list(FEATURES[feature].where(without))


def test_every_optional_key_of_a_record_that_moves_an_arm_is_a_feature():
    """A new key of a joint, a motor or a friction is a feature, or stands here with the reason why it is none."""
    from armwright.description.drive import Motor, RotaryFriction
    from armwright.description.drive_effects import RotaryElasticity
    from armwright.description.robot import RevoluteJoint

    keys = {feature.key for feature in ARM.values()}
    for record, path, others in (
        (Motor, "joints.motor", NUMBERS),
        (RotaryFriction, "joints.friction", PARTS_OF_LAWS),
        (RotaryElasticity, "joints.elasticity", OF_ELASTICITY),
        (RevoluteJoint, "joints", STRUCTURE),
        (RobotDescription, "", OF_THE_FILE),
    ):
        optional = {name for name, each in record.model_fields.items() if not each.is_required()} - {"source"}
        missing = {name for name in optional - others if not any(key == f"{path}.{name}".lstrip(".") for key in keys)}
        assert not missing, (path, missing)


NUMBERS = {  # of the motor's plain law, which every consumer that needs it has or asks for by name
    *("torque_constant_n_m_per_a", "back_emf_constant_v_s_per_rad", "resistance_ohm", "basis"),
}
PARTS_OF_LAWS = {  # of a law that is a feature, or of the plain viscous one
    *("viscous_n_m_s_per_rad", "stribeck_speed_rad_per_s", "viscous_temperature_coefficient_per_k"),
    *("coulomb_temperature_coefficient_per_k", "sigmoid_amplitude_n_m", "sigmoid_slope_s_per_rad"),
    *("sigmoid_shift_rad_per_s", "bristle_stiffness_n_m_per_rad", "bristle_damping_n_m_s_per_rad"),
    *("stribeck_exponent", "load_motor", "load_external", "load_motor_stribeck", "load_external_stribeck"),
    *("load_motor_quadratic_per_n_m", "load_external_quadratic_per_n_m"),
}
OF_ELASTICITY = {"cubic_n_m_per_rad3", "error_phase_rad", "side"}
STRUCTURE = {"frame", "dh", "modified_dh", "axis", "command", "bus_period_s", "motor", "friction", "limits"}
OF_THE_FILE = {  # words about the file; where it stands; and keys of several joints, each of which is looked at
    *("title", "notes", "sources", "gravity_m_s2", "base", "command", "tip", "built_from", "fits", "remarks"),
    *("without_masses", "frames", "defaults"),
}
