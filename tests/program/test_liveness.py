"""Number of values that are live at once, counted by hand."""

from __future__ import annotations

from armwright.program import trace
from armwright.program.liveness import most_alive
from armwright.program.passes import optimised
from armwright.program.program import Instruction
from armwright.scalar import array, sin


def alive(function, size: int) -> int:
    return most_alive(optimised(trace("f", function, {"x": (size,)}).instructions))


def test_a_chain_needs_one_place_at_a_time():
    """A result and the argument it is made of wait together, whatever the length."""
    assert alive(lambda x: sin(sin(sin(sin(x[0])))), 1) == 2


def test_results_wait_until_the_end():
    """Nothing is stored before all is computed, as outputs may lie over inputs."""
    assert alive(lambda x: array([sin(x[k]) for k in range(5)]), 5) == 6
    assert alive(lambda x: array([x[1], x[0], 1.0]), 2) == 0  # handed through, and a constant


def test_what_is_kept_waits_too():
    made = [Instruction("INPUT", (0,), (), (0, 0)), *(Instruction("SIN", (k + 1,), (0,)) for k in range(3))]
    assert most_alive(made) == 1  # results that nobody needs are not made
    assert most_alive(made, {1, 2, 3}) == 4
