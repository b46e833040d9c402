"""Every chain of modules that the connectors allow, the short ones first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from math import pi
from typing import Any, NamedTuple

import numpy as np

from armwright.description.inertia_point import impossible
from armwright.errors import DescriptionError
from armwright.modules.assembly import Assembly, Placed
from armwright.modules.fit import angle_steps, fitting
from armwright.modules.library import Connector, Module, ModuleLibrary
from armwright.modules.mount import MEETING, root_body
from armwright.modules.reach_bound import Passage, passage
from armwright.quantity import Quantity
from armwright.spatial import Placement, rotation_z

TELLS_NOTHING = ("name", "title", "source", "sources", "date", "std", "visuals", "available")  # of how a module moves


@dataclass(frozen=True)
class Rules:
    """Which chains are wanted."""

    max_joints: int
    min_joints: int = 1
    max_links: int = 1
    turned: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.min_joints <= self.max_joints:
            raise DescriptionError(
                f"joints from {self.min_joints} to {self.max_joints}: expected at least 1, and the smaller number first"
            )
        if self.max_links < 0:
            raise DescriptionError(f"max_links = {self.max_links}: expected 0 or more")


class Step(NamedTuple):
    """A module of a chain, as `Placed` has it; the angle in steps of a turn."""

    module: str
    called: str
    on: str | None = None
    by: str | None = None
    turn: tuple[int, int] | None = None  # how many of how many steps; None where there is one way only

    @property
    def angle(self) -> float:
        """[rad]."""
        return 0.0 if self.turn is None else 2 * pi * self.turn[0] / self.turn[1]

    @property
    def label(self) -> str:
        """The module, with what is not plain about how it is put on: its connector, and the angle in degrees."""
        degrees = f"@{self.angle * 180 / pi:.4g}".replace(".", "_") if self.angle else ""
        return f"{self.module}{'' if self.by is None else f':{self.by}'}{degrees}"

    def placed(self) -> Placed:
        """The table of an assembly's file."""
        name = self.called if self.called != self.module else None
        angle = None if self.turn is None else Quantity(value=self.angle)
        return Placed(module=self.module, name=name, on=self.on, by=self.by, angle_rad=angle)


class Way(NamedTuple):
    """How a module can be put on a connector, and the connector that is then the chain's end."""

    module: Module
    by: str | None
    turns: tuple[tuple[int, int] | None, ...]
    end: str | None
    ends_here: bool  # nothing can stand on that end
    passage: Passage


@dataclass(frozen=True, eq=False)
class Chain:
    """Modules one on another: their steps, the connector at the end, joints, jointless modules since the last joint."""

    steps: tuple[Step, ...]
    module: Module
    end: str | None
    joints: int
    links: int
    length: float  # [m] from the base to `point` at most
    point: np.ndarray  # (3,) [m], of the last joint's axis, in the end's frame
    mass: float  # [kg]

    @property
    def reach(self) -> float:
        """How far the end can be from the base [m]: no pose is further out."""
        return self.length + float(np.linalg.norm(self.point))

    def assembly(self, library: ModuleLibrary) -> Assembly:
        """What `assemble` takes, called after its modules; where a module is used up, its next twin of the library stands in."""
        tip = None if self.end is None else f"{self.steps[-1].called}.{self.end}"
        name, placed = "-".join(step.label for step in self.steps), []
        taken: Counter[str] = Counter()
        limits = {module.name: module.available for module in library.modules}
        for step in self.steps:
            each = step.placed()
            free = [n for n in twins(library, each.module) if limits[n] is None or taken[n] < limits[n]]  # type: ignore[operator]
            own = free[0] if free else each.module
            taken[own] += 1
            placed.append(each if own == each.module else each.model_copy(update={"module": own, "name": step.called}))
        return Assembly(name=name, source="definition", libraries=(library.name,), modules=tuple(placed), tip=tip)


def twins(library: ModuleLibrary, name: str) -> list[str]:
    """Modules of the library that move like the one of that name, itself first."""
    meanings = {module.name: _meaning(module) for module in library.modules}
    return [name, *(other for other, meaning in meanings.items() if other != name and meaning == meanings[name])]


def possible_modules(library: ModuleLibrary) -> tuple[list[Module], dict[str, str]]:
    """Modules that can be, one of each kind that moves alike, and why the others are left out, by name."""
    kept: dict[Any, Module] = {}
    left: dict[str, str] = {}
    for module in library.modules:
        faults = [
            impossible(float(body.mass_kg), np.array(body.com_m), body.inertia_kg_m2.matrix(), body.inertia_about)
            for body in module.bodies
            if body.accept_impossible is None
        ]
        fault = next((fault for fault in faults if fault), None)
        if fault is not None:
            left[module.name] = f"it is impossible: {fault}"
            continue
        key = _meaning(module)
        twin = kept.get(key)
        if twin is None:
            kept[key] = module
            continue
        left[module.name] = f"it is like {twin.name}"
        several = None if None in (twin.available, module.available) else twin.available + module.available  # type: ignore[operator]
        kept[key] = twin.model_copy(update={"available": several})
    return list(kept.values()), left


def chains(modules: list[Module], rules: Rules) -> Iterator[Chain]:
    """Chains from a module with a ground outward, those with fewer modules first; a module as often as there are of it.

    `rules.turned` keeps arms that differ only by a turn about the vertical through the base, which a task tells apart.
    """
    ways: dict[tuple[str, str, bool], list[Way]] = {}
    level = [
        start
        for module in modules
        if module.ground and _moving(module) <= rules.max_joints
        for start in _starts(module, module.connector(module.ground))
    ]
    while level:
        yield from (chain for chain in level if chain.joints >= rules.min_joints)
        level = [longer for chain in level for longer in _longer(chain, modules, rules, ways)]


def _starts(module: Module, ground: Connector) -> Iterator[Chain]:
    for end in _free(module, ground.name):
        length, point = passage(module, ground, end).extend(0.0, np.zeros(3), np.eye(3))
        yield Chain((Step(module.name, module.name),), module, end, _moving(module), 0, length, point, _mass(module))


def _longer(
    chain: Chain, modules: list[Module], rules: Rules, ways: dict[tuple[str, str, bool], list[Way]]
) -> Iterator[Chain]:
    if chain.end is None:
        return
    first = len(chain.steps) == 1 and not rules.turned
    key = (chain.module.name, chain.end, first)
    if key not in ways:
        ways[key] = list(_ways(chain.module, chain.end, modules, straight=first))
    on = f"{chain.steps[-1].called}.{chain.end}"
    for way in ways[key]:
        name, moving = way.module.name, _moving(way.module)
        joints, links = chain.joints + moving, 0 if moving else chain.links + 1
        if joints > rules.max_joints or (links > rules.max_links and not way.ends_here):
            continue
        used = sum(step.module == name for step in chain.steps)
        if way.module.available is not None and used >= way.module.available:
            continue
        called = f"{name}-{used + 1}" if used else name
        for turn in way.turns:
            steps = (*chain.steps, Step(name, called, on, way.by, turn))
            length, point = way.passage.extend(chain.length, chain.point, _turned(turn))
            yield Chain(steps, way.module, way.end, joints, links, length, point, chain.mass + _mass(way.module))


def _ways(below: Module, end: str, modules: list[Module], *, straight: bool) -> Iterator[Way]:
    """All ways to put a module on that connector; `straight`: not turned where a turn would only turn the whole arm."""
    carrier = below.connector(end)
    straight = straight and _about_vertical(below, carrier)
    for module in modules:
        fits = fitting(carrier, module)
        for own in fits:
            steps = angle_steps(carrier, own)
            turns = (None,) if steps == 1 else tuple((k, steps) for k in range(1 if straight else steps))
            by = own.name if len(fits) > 1 else None
            for free in _free(module, own.name):
                ends_here = not _carries(module, free, modules)
                yield Way(module, by, turns, free, ends_here, passage(module, own, free))


def _free(module: Module, taken: str | None) -> list[str | None]:
    """Connectors of a module that a chain can end with, or go on from; None where all are taken."""
    free = [connector.name for connector in module.connectors if connector.name not in (taken, module.ground)]
    return free or [None]  # type: ignore[return-value]


def _carries(module: Module, connector: str | None, modules: list[Module]) -> bool:
    """Whether any module can stand on that connector."""
    return connector is not None and any(fitting(module.connector(connector), other) for other in modules)


@cache
def _turned(turn: tuple[int, int] | None) -> np.ndarray:
    """The rotation of a module that is put on with so many steps of a turn."""
    return np.eye(3) if turn is None else rotation_z(2 * pi * turn[0] / turn[1])


def _mass(module: Module) -> float:
    return sum(float(body.mass_kg) for body in module.bodies)


def _moving(module: Module) -> int:
    return sum(joint.type != "fixed" for joint in module.joints)


def _about_vertical(module: Module, carrier: Connector) -> bool:
    """Whether a turn about this face only turns the whole arm about the vertical through the base."""
    ground = None if module.ground is None else module.connector(module.ground)
    if ground is not None and (ground.body != carrier.body):
        return False
    if ground is None and carrier.body != root_body(module):
        return False
    stands = Placement.identity() if ground is None else MEETING @ ground.placement().inverse()
    face = stands @ carrier.placement()
    return bool(np.abs(face.rotation[:2, 2]).max() < 1e-9 and np.abs(face.position[:2]).max() < 1e-9)


def _meaning(value: Any) -> Any:
    """What of a record decides how an arm moves, as something that can be compared."""
    if isinstance(value, Quantity):
        return value.value
    if hasattr(value, "model_fields_set"):
        skipped = TELLS_NOTHING if isinstance(value, Module) else TELLS_NOTHING[1:]
        kept = ((name, _meaning(getattr(value, name))) for name in type(value).model_fields if name not in skipped)
        return tuple(kept)
    return tuple(_meaning(item) for item in value) if isinstance(value, tuple) else value
