"""Long programs cut into pieces, because compilers take more than linear time over a straight block.

Values that cross a cut go through numbered slots; a slot is used again when its value is dead, so the work memory stays small.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

from armwright.program.passes import in_ready_order, in_recursion_order, turns_first
from armwright.program.program import Instruction, Value

LONGEST = 400  # instructions in a piece; of 100 joints forward dynamics loses 3 % in pieces of 300, the mass matrix 6 % in 500
WHOLE = 5000  # a program up to this long stays in one piece


@dataclass(frozen=True)
class Piece:
    """Instructions in order, and the slots of values that they load from earlier pieces and store for later ones."""

    instructions: tuple[Instruction, ...]
    loads: dict[Value, int]
    stores: dict[Value, int]


@dataclass(frozen=True)
class Cut:
    """A program in pieces, and how many slots they share."""

    pieces: tuple[Piece, ...]
    slots: int

    @property
    def traffic(self) -> int:
        """Number of loads and stores of slots."""
        return sum(len(piece.loads) + len(piece.stores) for piece in self.pieces)


def cut(instructions: Sequence[Instruction], longest: int = LONGEST) -> Cut:
    """The instructions in pieces of at most `longest`, in the one of three orders that takes fewest values through slots.

    Along long chains Newton and Euler's recursion gains a third by `in_recursion_order`, the mass matrix a tenth; articulated
    bodies gain a tenth by `in_ready_order`; derivatives would lose as much by either.
    """
    orders = (turns_first(order(instructions)) for order in (list, in_ready_order, in_recursion_order))
    return min((in_pieces(order, longest) for order in orders), key=lambda each: each.traffic)


def in_pieces(instructions: Sequence[Instruction], longest: int = LONGEST) -> Cut:
    """The instructions as they stand in pieces of at most `longest`; each makes the constants and reads the inputs it needs."""
    constants = {i.results[0]: i for i in instructions if i.operation in ("CONST", "INPUT")}
    working = [i for i in instructions if i.operation not in ("CONST", "INPUT")]
    chunks = [working[k : k + longest] for k in range(0, len(working), longest)]
    piece_of = {value: k for k, chunk in enumerate(chunks) for i in chunk for value in i.results}
    last = {value: k for k, chunk in enumerate(chunks) for i in chunk for value in i.arguments}
    slot: dict[Value, int] = {}
    free: list[int] = []
    slots, pieces = 0, []
    for k, chunk in enumerate(chunks):
        needed = {value for i in chunk for value in i.arguments}
        loads = {value: slot[value] for value in needed if value not in constants and piece_of[value] < k}
        for value in [v for v, at in slot.items() if last[v] < k]:
            heapq.heappush(free, slot.pop(value))
        stores = {}
        for value in (v for i in chunk for v in i.results if last.get(v, k) > k):
            if not free:
                heapq.heappush(free, slots)
                slots += 1
            slot[value] = stores[value] = heapq.heappop(free)
        first = [constants[value] for value in sorted(needed & set(constants))]
        pieces.append(Piece((*first, *chunk), loads, stores))
    return Cut(tuple(pieces), slots)
