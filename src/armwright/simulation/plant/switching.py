"""Steps of fixed rules that end where a contact begins or ends, or friction turns round, so that the rules keep their order.

A rule's error shrinks with its order only where what it integrates is smooth. Contacts therefore stay within a step as they
are at its beginning, and functions s of the state say where that no longer holds: a step over which some of them change
their signs is taken again to just beyond the first such place, and then the rest of it. With x(θ) the state after a step of
θ h, that place is where

    g(θ) = max s_e(x(θ)) / s_e(x(1))      over those e that change

passes through 0: g is below 0 at the beginning, and 1 at the end. It is found by regula falsi with halved weights, the
"Illinois" rule, each guess moved by a hair towards the end, so that the upper end of the bracket closes in. [DowellJarratt1971]

Directions of motion may be held in the same way: s is then, of what slides, its speed in its direction, and of what sticks,
by how much the load is less than what would set it in motion. A speed that came to 0 is 0 at the end of its step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from armwright import scalar
from armwright.kernels.stages import NEXT
from armwright.program import Program, call, trace
from armwright.scalar import Array, Scalar

HAIR = 2.0**-32  # of a step: how far beyond the place a guess goes


@dataclass(frozen=True)
class Watched:
    """Contacts and switching functions of a plant.

    Attributes:
        depths: (x, u, …) → (contacts,) how deep every contact is; one touches where its depth is not below 0.
        functions: (x, u, …, touching) → s (k,) of a state under these contacts; least (k,): one changes from a to b where
            a b < -least².
        contacts: how many.
        elements: how many directions are held, where they are; the rest is None otherwise.
        present: (x, u, …, touching) → directions (elements,) in which a step begins.
        sliding, keeping: (x, u, …, touching, directions) → s (elements,), below 0 where a direction holds no longer; `sliding`
            is that of what slides alone, 1 of the rest, and costs little.
        settled: (x, u, …, touching, directions) → x, where speeds that passed 0 are 0.
    """

    depths: Callable[..., Array]
    functions: Callable[..., tuple[Array, Array]]
    contacts: int
    elements: int = 0
    present: Callable[..., Array] | None = None
    sliding: Callable[..., Array] | None = None
    keeping: Callable[..., Array] | None = None
    settled: Callable[..., Array] | None = None

    @property
    def block(self) -> dict[str, tuple[int, ...]]:
        """The blocks of contacts and directions, behind the other arguments of what depends on them."""
        blocks = {"touching": (self.contacts,), "directions": (self.elements,)}
        return {name: shape for name, shape in blocks.items() if shape[0]}


class Switching:
    """Contacts, directions and other switching functions of a plant, as functions of the arguments of its programs.

    Depths are computed by one program that all others call: what is beyond 0 to one of them is so to all, to the last bit.
    """

    def __init__(self, watched: Watched, shapes: Mapping[str, tuple[int, ...]]):
        """`shapes`: of the arguments of the depths of what is watched, "x" and "u" first."""
        self.watched, self.shapes = watched, shapes
        self.constant = {**{name: shape for name, shape in shapes.items() if name != "x"}, **watched.block}
        self._deep = trace("depths", watched.depths, shapes, noinline=True) if watched.contacts else None
        moving = {"x": shapes["x"], **self.constant}
        others = (
            trace("least", lambda x, *inputs: scalar.array(watched.functions(x, *inputs)[1]), moving).outputs[0].size
        )
        self.count = watched.contacts + watched.elements + others

    def depths(self, x: Array, inputs: Sequence[Array]) -> Array:
        """(contacts,) of a state; `inputs`: what follows x."""
        return () if self._deep is None else call(self._deep, x, *inputs[: len(self.shapes) - 1])

    def begun(self, x: Array, *inputs: Array) -> tuple[Array, ...]:
        """Contacts and directions of a state, those of them that are held; `inputs` without these."""
        depths, present = self.depths(x, inputs), self.watched.present
        touching = [scalar.array([scalar.less_equal(0.0, depth) for depth in depths])] if self._deep else []
        return (*touching, *([] if present is None else [present(x, *inputs, *touching)]))

    def values(self, x: Array, *inputs: Array) -> tuple[list[Scalar], list[Scalar], Array]:
        """Depths, the other functions, and the least of those that are no directions'."""
        keeping = () if self.watched.keeping is None else self.watched.keeping(x, *inputs)
        switching, least = self.watched.functions(x, *inputs)
        return [*self.depths(x, inputs)], [*keeping, *switching], least

    def changes(self, x: Array, after: Array, *inputs: Array) -> tuple[list[Scalar], list[Scalar], list[Scalar]]:
        """1 for each function that changes over a step, and all of them before it and behind."""
        elements, held = self.watched.elements, len(self.watched.block)
        (deep_before, before, least), (deep_after, end, _) = self.values(x, *inputs), self.values(after, *inputs)
        entered = inputs[-held] if deep_after else ()
        changed = [scalar.less((it - 0.5) * b, 0.0) for it, b in zip(entered, deep_after, strict=True)]
        changed += [scalar.less(b, 0.0) for b in end[:elements]]
        for a, b, little in zip(before[elements:], end[elements:], least, strict=True):
            changed.append(scalar.less(a * b, -(little * little)))
        return changed, [*deep_before, *before], [*deep_after, *end]


def switching_programs(watched: Watched | None, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Program]:
    """The programs with which stages end steps where something switches; none where nothing does.

    Args:
        watched: what may switch.   shapes: of the arguments of its `depths`, "x" and "u" first.
    """
    if watched is None:
        return {}
    switching = Switching(watched, shapes)

    def switched(x: Array, after: Array, *inputs: Array) -> Array:
        return scalar.array([sum(switching.changes(x, after, *inputs)[0])])

    def begin(x: Array, after: Array, *inputs: Array) -> tuple[Array, Array, Array]:
        changed, begins, ends = switching.changes(x, after, *inputs)
        weights = scalar.array([scalar.where(it, 1.0 / b, 0.0) for it, b in zip(changed, ends, strict=True)])
        below = scalar.minimum(furthest(weights, begins), 0.0)
        bracket = [0.0, 1.0, below, 1.0, 0.0]  # its ends θ, g there, and which moved last: 1 the upper, -1 the lower
        return weights, scalar.array(bracket), scalar.array([_guess(bracket)])

    def narrow(after: Array, *rest: Array) -> tuple[Array, Array]:
        *inputs, weights, bracket, part = rest
        lower, upper, below, above, last = bracket
        found = switching.values(after, *inputs)
        g = furthest(weights, [*found[0], *found[1]])
        beyond = scalar.less(0.0, g)
        bracket = [
            scalar.where(beyond, lower, part[0]),
            scalar.where(beyond, part[0], upper),
            scalar.where(beyond, scalar.where(scalar.less(0.0, last), 0.5 * below, below), g),
            scalar.where(beyond, g, scalar.where(scalar.less(last, 0.0), 0.5 * above, above)),
            scalar.where(beyond, 1.0, -1.0),
        ]
        return scalar.array(bracket), scalar.array([_guess(bracket)])

    size, constant, after = shapes["x"], switching.constant, {f"x{NEXT}": shapes["x"]}
    searched = {"weights": (switching.count,), "bracket": (5,), "part": (1,)}
    programs = {
        "touching": trace("touching", switching.begun, shapes, tuple(watched.block), noinline=True),
        "switched": trace("switched", switched, {"x": size, **after, **constant}, noinline=True),
        "bracket": trace("bracket", begin, {"x": size, **after, **constant}, tuple(searched), noinline=True),
        "narrow": trace(
            "narrow", narrow, {**after, **constant, **searched}, (f"bracket{NEXT}", f"part{NEXT}"), noinline=True
        ),
    }
    if watched.settled is not None:
        programs["settle"] = trace("settle", watched.settled, {**after, **constant}, (f"x{NEXT}{NEXT}",))
    return programs


def furthest(weights: Array, values: Array) -> Scalar:
    """g: the largest s_e(x) / s_e(x(1)) of those that change; -1 where none does."""
    shares = [scalar.where(scalar.equal(w, 0.0), -1.0, w * s) for w, s in zip(weights, values, strict=True)]
    furthest = shares[0]
    for share in shares[1:]:
        furthest = scalar.maximum(furthest, share)
    return furthest


def _guess(bracket: list[Scalar]) -> Scalar:
    """The next θ to try; never 0, so that every piece of a step takes time."""
    lower, upper, below, above, _ = bracket
    return scalar.clip((lower * above - upper * below) / (above - below) + HAIR, lower, upper)
