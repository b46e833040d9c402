"""Numbers that users get do not change unnoticed.

A change that is meant freezes anew with `make frozen ARGS=--write`, and stands in *Changed* of the changelog.
"""

from __future__ import annotations

import pytest

from frozen.numbers import ROOMS, alike, cases, computed, differing, kept

EVERY = [
    pytest.param(room, name, marks=[pytest.mark.study] if case.study else [])
    for room in ROOMS
    for name, case in cases(room).items()
]


@pytest.mark.parametrize(("room", "name"), EVERY)
def test_public_functions_answer_with_the_same_numbers(room, name, tmp_path):
    assert differing(kept(room)[name], computed(room, name, tmp_path), cases(room)[name].close) == []


@pytest.mark.parametrize("room", ROOMS)
def test_all_that_is_kept_is_compared(room):
    assert set(kept(room)) == set(cases(room))
    assert all(kept(room).values())


def test_a_changed_number_is_seen():
    before = {"a": 1.0, "b": [1.0, 1e-9, "text"], "c": None}
    assert differing(before, {"a": 1.0 + 1e-9, "b": [1.0, 2e-9, "text"], "c": None}) == []
    assert len(differing(before, {"a": 1.0 + 1e-5, "b": [1.0, 1e-4, "text"], "d": True})) == 4
    assert not alike([1.0], [1.0, 2.0], 1.0)
