"""Forms of a kernel: one word for its inputs and options, the same in Python, on the command line and in C."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError
from armwright.export.form import parse_form
from armwright.kernels.signatures import SIGNATURES
from physics.arms import arm, random_state


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
    assert bare.left_out == signature.optional == full.given
    assert full.left_out == bare.given == ()


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
    ("word", "message"),
    [
        ("gravity", "no function 'gravity'; there is inverse_dynamics, forward_dynamics, "),
        ("", "no function ''; there is inverse_dynamics"),
        ("mass_matrix+wrench", r"mass_matrix\+wrench: no optional input 'wrench'; mass_matrix has none"),
        ("inverse_dynamics+q", r"inverse_dynamics\+q: no optional input 'q'; there is wrench"),
        ("inverse_dynamics+wrench+wrench", "optional input 'wrench' is named twice"),
        ("jacobian:fram=tool", "jacobian:fram=tool: no option 'fram'; there is frame"),
        ("jacobian:frame", "option 'frame' has no value; expected jacobian:frame=VALUE"),
        ("jacobian:frame=", "option 'frame' has no value; expected jacobian:frame=VALUE"),
        ("jacobian:frame=a:frame=b", "option 'frame' is named twice"),
        ("mass_matrix:frame=tool", "mass_matrix:frame=tool: no option 'frame'; mass_matrix has none"),
    ],
)
def test_refusals(word, message):
    with pytest.raises(ModelError, match=message):
        parse_form(word)


def test_a_frame_that_the_arm_lacks():
    with pytest.raises(ModelError, match="puma560: no frame 'hand'; there is base, link1"):
        parse_form("jacobian:frame=hand").trace(arm("puma560"))
