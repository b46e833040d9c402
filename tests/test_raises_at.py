"""The check of a refusal fails for another place, value or file, another kind, other words, and for no error."""

from __future__ import annotations

import gc
import re
import weakref

import numpy as np
import pytest

from armwright.errors import ModelError, ScenarioError, ShapeError
from raises_at import raises_at


def refuse() -> None:
    raise ModelError("not known", place="frame at 0.5", value=3, file="arm.toml:7")


@pytest.mark.parametrize("place", ["frame at 0.5", re.compile(r"frame at [\d.]+")])
def test_what_it_takes(place):
    with raises_at(ModelError, place, "known", value=3, file="arm.toml:7") as caught:
        refuse()
    assert caught.value.what == "not known"


@pytest.mark.parametrize(
    ("arguments", "fields"),
    [
        ((ModelError, "frame"), {}),
        ((ModelError, re.compile("frame at ")), {}),
        ((ModelError,), {"file": "arm.toml:7"}),
        ((ModelError, "frame at 0.5", "missing"), {}),
        ((ModelError, "frame at 0.5"), {"value": 4}),
        ((ModelError, "frame at 0.5"), {"file": "arm.toml"}),
    ],
)
def test_what_it_does_not_take(arguments, fields):
    with pytest.raises(AssertionError), raises_at(*arguments, **fields):
        refuse()


def test_other_errors_and_none():
    with pytest.raises(ModelError), raises_at(ScenarioError, "frame at 0.5"):
        refuse()
    with pytest.raises(pytest.fail.Exception), raises_at(ShapeError, "q"):
        pass


def test_it_keeps_nothing_alive():
    gc.disable()
    try:
        large = np.zeros(3)
        gone = weakref.ref(large)
        with raises_at(ShapeError, "q"):
            raise ShapeError(place="q", value=large)
        del large
        assert gone() is None
    finally:
        gc.enable()
