"""Frozen dataclasses are frozen all the way down, and so are their copies."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from armwright.scalar import Symbol
from armwright.spatial import Frozen, Placement

COPIES = {
    "itself": lambda thing: thing,
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
}


@dataclass(frozen=True, eq=False)
class Drawer(Frozen):
    values: Any
    named: Any


@pytest.mark.parametrize("how", COPIES)
def test_nothing_inside_can_be_changed(how):
    drawer = COPIES[how](Drawer(np.array([1.0, 2.0]), {"a": 1}))
    with pytest.raises(ValueError, match="read-only"):
        drawer.values[0] = 5.0
    with pytest.raises(TypeError):
        drawer.named["b"] = 2
    with pytest.raises(AttributeError):
        drawer.named.pop("a")
    assert (drawer.values.tolist(), dict(drawer.named)) == ([1.0, 2.0], {"a": 1})


def test_what_was_given_stays_its_owners():
    values, named = np.zeros(2), {"a": 1}
    drawer = Drawer(values, named)
    values[0], named["b"] = 5.0, 2
    assert (drawer.values.tolist(), dict(drawer.named)) == ([0.0, 0.0], {"a": 1})


def test_numbers_are_floats_and_symbols_objects():
    assert Placement(np.eye(3, dtype=object), np.zeros(3, dtype=int)).rotation.dtype == float
    assert Placement(np.eye(3), np.zeros(3, dtype=int)).position.dtype == float
    held = Placement(np.eye(3), np.array([Symbol.named("x"), 0.0, 0.0], dtype=object)).position
    assert held.dtype == object
    assert not held.flags.writeable
