"""One thread at a time with symbols: CasADi gives up Python's lock while it works, and counts constants that all share."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_turn = threading.RLock()


def alone(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function as called by one thread at a time, until the symbols that it made are gone."""

    @functools.wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with _turn:
            return function(*args, **kwargs)

    return called
