"""Cache of traced programs."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar

from armwright.program.turns import alone

Made = TypeVar("Made")
MOST = 32  # results that are kept: those of a few arms
_made: OrderedDict[Hashable, object] = OrderedDict()


@alone
def kept(key: Hashable, make: Callable[[], Made]) -> Made:
    """The cached result of `make` for an equal key, or a new one.

    Args:
        key: everything that the result depends on.   make: traces; it may use nothing but what the key holds.
    """
    if key in _made:
        _made.move_to_end(key)
        return _made[key]  # type: ignore[return-value]
    result = make()
    _made[key] = result
    while len(_made) > MOST:
        _made.popitem(last=False)
    return result
