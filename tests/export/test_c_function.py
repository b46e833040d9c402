"""Forms of a kernel: one word for its inputs and options, the same in Python, on the command line and in C."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError
from armwright.export.c_function import parse_form
from armwright.kernels.signatures import SIGNATURES
from physics.arms import arm, random_state
from raises_at import raises_at


@pytest.mark.parametrize(
    ("word", "words", "inputs"),
    [
        ("inverse_dynamics", ("inverse_dynamics",), ["q", "qd", "qdd"]),
        ("inverse_dynamics+wrench", ("inverse_dynamics", "wrench"), ["q", "qd", "qdd", "wrench"]),
        ("jacobian:frame=link3", ("jacobian", "link3"), ["q"]),
        ("jacobian:frame=a:b+c=d", ("jacobian", "a:b+c=d"), ["q"]),
    ],
)
def test_a_word_is_read_and_written(word, words, inputs):
    form = parse_form(word)
    assert form.name == word
    assert form.words == words
    outputs = [argument.name for argument in form.signature.outputs]
    assert [argument.name for argument in form.arguments] == inputs + outputs


@pytest.mark.parametrize("name", SIGNATURES)
def test_what_is_left_out_and_what_is_taken_are_all_there_is(name):
    signature = SIGNATURES[name]
    bare = parse_form(name)
    full = parse_form("+".join([name, *(argument.name for argument in signature.optional)]))
    assert bare.left_out == signature.optional == full.optional
    assert full.left_out == bare.optional == ()


def test_a_form_is_traced_and_evaluated():
    """The plain function with the same arguments."""
    model = arm("puma560")
    q, qd, qdd = random_state(model, 0)
    wrench = np.arange(6.0)
    pushed = parse_form("inverse_dynamics+wrench")
    assert [port.name for port in pushed.trace(model).inputs] == ["q", "qd", "qdd", "wrench"]
    assert np.array_equal(pushed.evaluate(model, q, qd, qdd, wrench)[0], aw.inverse_dynamics(model, q, qd, qdd, wrench))
    (pose,) = parse_form("forward_kinematics:frame=link3").evaluate(model, q)
    assert np.array_equal(pose, aw.forward_kinematics(model, q, frame="link3"))


@pytest.mark.parametrize(
    ("word", "place", "value", "choices"),
    [
        ("gravity", "function", "gravity", SIGNATURES),
        ("", "function", "", SIGNATURES),
        ("mass_matrix+wrench", "mass_matrix+wrench: optional input", "wrench", ()),
        ("inverse_dynamics+q", "inverse_dynamics+q: optional input", "q", ("wrench",)),
        ("jacobian:fram=tool", "jacobian:fram=tool: option", "fram", ("frame",)),
        ("mass_matrix:frame=tool", "mass_matrix:frame=tool: option", "frame", ()),
    ],
)
def test_unknown_names_are_refused(word, place, value, choices):
    with pytest.raises(ModelError) as error:
        parse_form(word)
    assert (error.value.place, error.value.value, error.value.choices) == (place, value, tuple(choices))


@pytest.mark.parametrize(
    ("word", "what"),
    [
        ("inverse_dynamics+wrench+wrench", "named twice"),
        ("jacobian:frame=a:frame=b", "named twice"),
        ("jacobian:frame", "no value"),
        ("jacobian:frame=", "no value"),
    ],
)
def test_a_word_is_complete_and_names_nothing_twice(word, what):
    with pytest.raises(ModelError) as error:
        parse_form(word)
    assert error.value.what == what
    assert error.value.place.startswith(f"{word}: ")


def test_a_frame_that_the_arm_lacks():
    with raises_at(ModelError, "frame", "base, link1", value="hand"):
        parse_form("jacobian:frame=hand").trace(arm("puma560"))
