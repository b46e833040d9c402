"""Largest number of values of a program that wait at once: an estimate of the stack that its code takes."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from armwright.program.program import Instruction, Value


def most_alive(instructions: Sequence[Instruction], needed_later: Collection[Value] = ()) -> int:
    """The largest number of values that are alive at once, in the order of the instructions.

    Args:
        instructions: after the passes.   needed_later: values that something behind the last instruction needs.
    Returns:
        count: results wait to be stored until the end; constants, and inputs that are handed through, wait nowhere.
    """
    end = len(instructions)
    last = {value: k for k, i in enumerate(instructions) for value in i.arguments}
    last.update(dict.fromkeys(needed_later, end))
    last.update({i.arguments[0]: end for i in instructions if i.operation == "OUTPUT"})
    alive: set[Value] = set()
    most = 0
    for k, i in enumerate(instructions):
        if i.operation != "CONST":
            alive.update(v for v in i.results if v in last and not (i.operation == "INPUT" and last[v] == end))
        most = max(most, len(alive))
        alive.difference_update([v for v in i.arguments if last[v] == k])
    return most
