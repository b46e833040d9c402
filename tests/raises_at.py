"""A refusal by its fields: the place that is refused, the value or file, and at most a name or number of the sentence.

The English around them is not the test's business: it may be written better.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import pytest

from armwright.errors import ABSENT, ArmwrightError

AnyError = TypeVar("AnyError", bound=ArmwrightError)


@contextmanager
def raises_at(
    kind: type[AnyError],
    place: str | re.Pattern = "",
    match: str | None = None,
    *,
    value: Any = ABSENT,
    file: Any = None,
) -> Iterator[pytest.ExceptionInfo[AnyError]]:
    """Passes if the block raises an error of this kind at this place; gives what `pytest.raises` gives.

    Args:
        place: the error's `place`, whole; a pattern where it holds numbers that are computed.
        match: as of `pytest.raises`: a name, number or unit that the user must see.
        value, file: the error's, where stated.
    """
    with pytest.raises(kind, match=match) as caught:
        yield caught
    _check(caught.value, place, value, file)
    caught.value.__traceback__ = None  # it holds this frame: a cycle would keep what the block made
    del caught


def _check(error: ArmwrightError, place: str | re.Pattern, value: Any, file: Any) -> None:
    assert re.fullmatch(place, error.place) if isinstance(place, re.Pattern) else error.place == place, error.place
    assert value is ABSENT or error.value == value, error.value
    assert file is None or error.file == str(file), error.file
