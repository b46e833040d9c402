"""Work that only some lanes need: a separate program, which compiled code skips for tiles without such a lane.

A lane has the same bits either way: results are used where they are needed, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from armwright import scalar
from armwright.program.program import NEEDED
from armwright.program.trace import call, trace_within
from armwright.scalar import Array, Scalar


class WhereNeeded:
    """A function (…) → (k,) that is computed where it is needed.

    Args:
        name: of its program.   function: takes one array per input; it may use symbols of the trace around it.
        inputs: name and shape of every input.
    """

    def __init__(self, name: str, function: Callable[..., Array], inputs: Mapping[str, tuple[int, ...]]):
        self._name, self._function, self._inputs = name, function, inputs
        self._traced = None

    def __call__(self, needed: Scalar, otherwise: Array, *arguments: Array) -> np.ndarray:
        """The function's value where `needed` is not 0, else `otherwise`.

        Args:
            needed: () 1 or 0.   otherwise: (k,).   arguments: of the function.
        """
        if not scalar.is_symbolic(needed):
            return self._function(*arguments) if needed else otherwise
        if self._traced is None:
            shapes = {NEEDED: (), **self._inputs}
            self._traced = trace_within(self._name, lambda _, *given: self._function(*given), shapes)
        program, free = self._traced
        value = call(program, needed, *arguments, *([free] if len(free) else []))
        return scalar.array(scalar.where(needed, value, otherwise))
