"""Passes over a program's instructions, in the order of `PASSES`: functions from instructions to instructions.

Which operations a program does is decided here and nowhere else, so that it is one sequence of IEEE operations in every
back end, whatever a compiler would contract.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace

from armwright.program.program import Instruction, Value

Instructions = Sequence[Instruction]


def shared_reciprocals(instructions: Instructions) -> list[Instruction]:
    """Divisions that share their divisor become one reciprocal and products: a division costs as much as 16 products."""
    divisors = Counter(i.arguments[1] for i in instructions if i.operation == "DIV")
    fresh = _first_fresh(instructions)
    reciprocal: dict[Value, Value] = {i.arguments[0]: i.results[0] for i in instructions if i.operation == "INV"}
    defined: set[Value] = set()
    passed = []
    for i in instructions:
        if i.operation == "DIV" and (divisors[i.arguments[1]] > 1 or reciprocal.get(i.arguments[1]) in defined):
            divisor = i.arguments[1]
            if reciprocal.get(divisor) not in defined:
                reciprocal[divisor], fresh = fresh, fresh + 1
                passed.append(Instruction("INV", (reciprocal[divisor],), (divisor,)))
                defined.add(reciprocal[divisor])
            i = replace(i, operation="MUL", arguments=(i.arguments[0], reciprocal[divisor]))
        passed.append(i)
        defined.update(i.results)
    return passed


def fused_products(instructions: Instructions) -> list[Instruction]:
    """A product that is used once, in a sum or difference, is done with it in one rounding: FMA, FMS or FNMA.

    Where both operands are such products, the one computed last is fused: its factors come later.
    """
    uses = Counter(value for i in instructions for value in i.arguments)
    products = {i.results[0]: i for i in instructions if i.operation in ("MUL", "SQ") and uses[i.results[0]] == 1}
    fused: set[Value] = set()
    replaced: dict[Value, Instruction] = {}
    for i in instructions:
        if i.operation not in ("ADD", "SUB"):
            continue
        chosen = max((value for value in i.arguments if value in products), default=None)
        if chosen is None or i.arguments[0] == i.arguments[1]:
            continue
        factors = products[chosen].arguments * (2 if products[chosen].operation == "SQ" else 1)
        is_first = i.arguments[0] == chosen
        other = i.arguments[1] if is_first else i.arguments[0]
        name = "FMA" if i.operation == "ADD" else "FMS" if is_first else "FNMA"
        replaced[i.results[0]] = replace(i, operation=name, arguments=(*factors, other))
        fused.add(chosen)
    return [
        replaced.get(i.results[0], i) if i.results else i
        for i in instructions
        if not (i.results and i.results[0] in fused)
    ]


def _first_fresh(instructions: Instructions) -> Value:
    return max((value for i in instructions for value in i.results), default=-1) + 1


def in_need_order(instructions: Instructions) -> list[Instruction]:
    """Each instruction right before the first that needs it, the longest chain of its arguments first: few values live at once.

    Which operations are done does not change, so neither do the bits.
    """
    source = {result: i for i in instructions for result in i.results}
    depth: dict[Value, int] = {}
    for i in instructions:
        deep = 1 + max((depth[a] for a in i.arguments), default=0)
        depth.update(dict.fromkeys(i.results, deep))
    ordered: list[Instruction] = []
    done: set[int] = set()
    wanted = [i for i in instructions if not i.results]
    stack = [(i, False) for i in reversed(wanted)]
    while stack:
        i, ready = stack.pop()
        if id(i) in done:
            continue
        if ready:
            done.add(id(i))
            ordered.append(i)
            continue
        stack.append((i, True))
        stack += [(source[a], False) for a in sorted(i.arguments, key=lambda a: depth[a])]
    return ordered


def in_ready_order(instructions: Instructions) -> list[Instruction]:
    """As `in_need_order`, but an instruction whose arguments are all computed follows at once.

    In a recursion outward and inward, the forces of the bodies then wait for the way back, not everything they come from.
    """
    source = {result: i for i in instructions for result in i.results}
    constants = {i.results[0]: i for i in instructions if i.operation == "CONST"}
    users: defaultdict[Value, list[Instruction]] = defaultdict(list)
    missing: dict[int, int] = {}
    for i in instructions:
        awaited = {argument for argument in i.arguments if argument not in constants}
        missing[id(i)] = len(awaited)
        for argument in awaited:
            users[argument].append(i)
    ordered: list[Instruction] = []
    done: set[int] = set()
    for first in in_need_order(instructions):
        ready = [first]
        while ready:
            i = ready.pop()
            if id(i) in done or missing[id(i)]:
                continue
            for each in (*(source[a] for a in i.arguments if a in constants), i):
                if id(each) not in done:
                    done.add(id(each))
                    ordered.append(each)
            following = [user for result in i.results for user in users[result]]
            for user in following:
                missing[id(user)] -= 1
            if i.operation != "INPUT":  # an input waits for nothing, and what asks for it alone can wait as well
                ready += reversed(following)
    return ordered


def in_recursion_order(instructions: Instructions) -> list[Instruction]:
    """Entry by entry: by the last entry of any input that is needed, then by the last output that needs it, latest first.

    A recursion along a chain, outward and inward again, stays in the order of its joints, and only what the way back needs waits.
    """
    needs: dict[Value, int] = {}  # the last entry of any input that a value depends on
    for i in instructions:
        last = i.place[1] if i.operation == "INPUT" and i.place else max((needs[a] for a in i.arguments), default=-1)
        needs.update(dict.fromkeys(i.results, last))
    serves: dict[Value, int] = {}  # the last entry of any output that depends on it
    keys: dict[int, tuple[int, int]] = {}
    for i in reversed(instructions):
        last = (
            i.place[1]
            if i.operation == "OUTPUT" and i.place
            else max((serves.get(r, -1) for r in i.results), default=-1)
        )
        keys[id(i)] = max((needs[value] for value in (*i.results, *i.arguments)), default=-1), -last
        for argument in i.arguments:
            serves[argument] = max(serves.get(argument, -1), last)
    return sorted(instructions, key=lambda i: keys[id(i)])


def turns_first(instructions: Instructions) -> list[Instruction]:
    """Sines and cosines of inputs, or of sums of inputs and constants, before everything else; those of one angle side by side.

    Far from 0 they call libm behind a branch, and values that are alive at a branch go through memory: at the start few are.
    """
    source = {result: i for i in instructions for result in i.results}
    turns: defaultdict[Value, list[Instruction]] = defaultdict(list)
    for i in instructions:
        if i.operation in ("SIN", "COS"):
            turns[i.arguments[0]].append(i)
    front: dict[int, Instruction] = {}
    for angle, functions in turns.items():
        sources = [source[a] for a in source[angle].arguments]
        if all(source.operation in ("INPUT", "CONST") for source in sources):
            front.update((id(i), i) for i in (*sources, source[angle], *functions))
    return [*front.values(), *(i for i in instructions if id(i) not in front)]


PASSES = (shared_reciprocals, fused_products, in_need_order)


def after_each(instructions: Instructions) -> Iterator[tuple[str, list[Instruction]]]:
    """Name of every pass, and the instructions after it; `Program.listing` prints them."""
    for each in PASSES:
        instructions = each(instructions)
        yield each.__name__, list(instructions)


def optimised(instructions: Instructions) -> list[Instruction]:
    """The instructions after all passes."""
    return [after for _, after in after_each(instructions)][-1]
