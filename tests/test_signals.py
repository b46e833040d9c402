"""Layouts: one place that turns names into slices."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.errors import ShapeError
from armwright.model.joint_signals import joint_signal, motion_layout
from armwright.signals import Layout, Signal, SignalValues
from physics.arms import arm
from raises_at import raises_at
from simulation.runs import mixed_arm

LAYOUT = Layout.of([Signal("q", "rad", (2,)), Signal("T", "1", (2, 2)), Signal("mass", "kg")])


def test_names_are_places():
    assert LAYOUT.size == 7
    assert LAYOUT.place("T") == slice(2, 6)
    vector = np.arange(14.0).reshape(2, 7)
    parts = LAYOUT.parts(vector)
    assert {name: part.shape for name, part in parts.items()} == {"q": (2, 2), "T": (2, 2, 2), "mass": (2,)}
    np.testing.assert_array_equal(parts["T"][1], [[9, 10], [11, 12]])
    one = {name: part[0] for name, part in parts.items()}
    np.testing.assert_array_equal(LAYOUT.vector(one), vector[0])
    assert (LAYOUT + Layout.of([Signal("u", "V", (1,))])).place("u") == slice(7, 8)
    assert "mass" in LAYOUT
    assert LAYOUT.units == ("rad", "rad", "1", "1", "1", "1", "kg")


def test_what_does_not_fit_is_refused():
    with pytest.raises(ShapeError, match="occurs twice"):
        LAYOUT + Layout.of([Signal("q", "rad")])
    with raises_at(ShapeError, "signal", value="mas"):
        LAYOUT.place("mas")
    with raises_at(ShapeError, "signal 'T'"):
        LAYOUT.vector({"q": [0, 0]})
    with pytest.raises(ShapeError, match="shape"):
        LAYOUT.vector({"q": [0, 0, 0], "T": np.eye(2), "mass": 1.0})
    wrong = [("2q", "rad"), ("q", ("rad",), (2,)), ("f", "N", (3,), None, ("x",))]
    for given in wrong:
        with pytest.raises(ShapeError):
            Signal(*given)


def test_values_have_names():
    values = SignalValues({"force": 1.0})
    assert values.force == values["force"] == 1.0
    assert dict(values) == {"force": 1.0}
    with pytest.raises(AttributeError, match=r"'forces'; .* force\?"):
        _ = values.forces


def test_joints_have_units_of_their_own(tmp_path):
    model = mixed_arm(tmp_path)
    assert joint_signal(model, "q").units == ("rad", "m", "rad")
    assert joint_signal(model, "u").units == ("V", "N", "A")
    assert joint_signal(model, "q").unit == "rad | m"
    assert joint_signal(model, "heat", "W", joints=(2,)).units == ("W",)
    assert motion_layout(arm("two-link")).names == ("q", "qd", "qdd")


@pytest.mark.parametrize(
    ("fields", "place"),
    [
        ({"name": 3}, "signal"),
        ({"shape": 2}, "signal 'x' shape"),
        ({"shape": ["a"]}, "signal 'x' shape"),
        ({"shape": (-1,)}, "signal 'x' shape"),
        ({"units": [1]}, "signal 'x' units"),
        ({"joints": np.zeros(1)}, "signal 'x' joints"),
        ({"labels": "ab"}, "signal 'x' labels"),
    ],
)
def test_fields_of_another_type_are_refused(fields, place):
    with pytest.raises(ShapeError) as error:
        Signal(**{"name": "x", "units": "m", **fields})
    assert error.value.place == place
