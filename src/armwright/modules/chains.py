"""Every chain of modules that the connectors allow, the short ones first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from math import pi
from typing import Any, NamedTuple

import numpy as np

from armwright.errors import DescriptionError
from armwright.modules.assembly import Assembly, Placed
from armwright.modules.library import Connector, Module, ModuleLibrary
from armwright.modules.mounting import MEETING, angle_steps, fitting
from armwright.modules.reach_bound import Passage, passage
from armwright.quantity import Quantity, Record
from armwright.spatial import Placement, rotation_z

NOT_MECHANICAL = ("title", "source", "sources", "date", "std", "visuals", "available")  # do not change the motion


@dataclass(frozen=True)
class Rules:
    """Limits on the chains that are wanted; `turned`: arms that differ only by a turn about the vertical are listed too."""

    max_joints: int
    min_joints: int = 1
    max_links: int = 1
    turned: bool = False

    def __post_init__(self) -> None:
        least = {"min_joints": 1, "max_joints": self.min_joints, "max_links": 0}
        for name, bound in least.items():
            if getattr(self, name) < bound:
                raise DescriptionError(place=name, value=getattr(self, name), expected=f"{bound} or more")


class ChainStep(NamedTuple):
    """A module of a chain, as `Placed` has it; the angle in steps of a turn."""

    module: str
    called: str
    on: str | None = None
    by: str | None = None
    turn: tuple[int, int] | None = None  # (step, steps a turn); None where there is one way only

    @property
    def angle(self) -> float:
        """[rad]."""
        return 0.0 if self.turn is None else 2 * pi * self.turn[0] / self.turn[1]

    @property
    def label(self) -> str:
        """The module; with its connector where several fit, and with the angle in degrees where it is not 0."""
        degrees = f"@{self.angle * 180 / pi:.4g}".replace(".", "_") if self.angle else ""
        return f"{self.module}{'' if self.by is None else f':{self.by}'}{degrees}"

    def placed(self, module: str) -> Placed:
        """The table of an assembly's file, with a module of that name."""
        name = self.called if self.called != module else None
        angle = None if self.turn is None else Quantity(value=self.angle)
        return Placed(module=module, name=name, on=self.on, by=self.by, angle_rad=angle)


class Extension(NamedTuple):
    """A module that can be put on a connector, and the connector that is then the chain's end."""

    module: Module
    by: str | None
    turns: tuple[tuple[int, int] | None, ...]
    end: str | None
    ends_here: bool  # nothing can stand on that end
    passage: Passage


@dataclass(frozen=True, eq=False)
class ModuleChain:
    """Modules one on another: their steps, the connector at the end, joints, jointless modules since the last joint."""

    steps: tuple[ChainStep, ...]
    module: Module
    end: str | None
    joints: int
    links: int
    length: float  # [m] from the base to `point` at most
    point: np.ndarray  # (3,) [m], of the last joint's axis, in the end's frame
    mass: float  # [kg]

    @property
    def reach(self) -> float:
        """Upper bound of the distance from the base to the end [m]."""
        return self.length + float(np.linalg.norm(self.point))

    def assembly(self, library: ModuleLibrary) -> Assembly:
        """Assembly named after its modules; where a module is used up, the next one of the library that moves like it is used."""
        tip = None if self.end is None else f"{self.steps[-1].called}.{self.end}"
        name, placed = "-".join(step.label for step in self.steps), []
        used: Counter[str] = Counter()
        for step in self.steps:
            free = (module.name for module in alike(library, step.module) if not _used_up(module, used[module.name]))
            module = next(free, step.module)
            used[module] += 1
            placed.append(step.placed(module))
        return Assembly(name=name, source="definition", libraries=(library.name,), modules=tuple(placed), tip=tip)


def alike(library: ModuleLibrary, name: str) -> list[Module]:
    """Modules of the library that move like the one of that name, itself first."""
    module = library.module(name)
    mechanics = _mechanics(module)
    return [module, *(m for m in library.modules if m is not module and _mechanics(m) == mechanics)]


def possible_modules(library: ModuleLibrary) -> tuple[list[Module], dict[str, str]]:
    """Physically possible modules, one of each kind that moves alike, and by name the reasons why the others are left out."""
    kept: dict[Any, Module] = {}
    left_out: dict[str, str] = {}
    for module in library.modules:
        fault, key = module.impossible_body(), _mechanics(module)
        twin = kept.get(key)
        if fault is not None:
            left_out[module.name] = f"it is {fault.what}"
        elif twin is None:
            kept[key] = module
        else:
            left_out[module.name] = f"it is like {twin.name}"
            counts = (twin.available, module.available)
            available = None if None in counts else sum(counts)  # type: ignore[arg-type]
            kept[key] = twin.model_copy(update={"available": available})
    return list(kept.values()), left_out


def chains(modules: list[Module], rules: Rules) -> Iterator[ModuleChain]:
    """Chains from a ground module outward, those with fewer modules first; each module as often as available."""
    known: dict[tuple[str, str, bool], list[Extension]] = {}
    level = [
        start
        for module in modules
        if module.ground and module.moving_joints <= rules.max_joints
        for start in _starts(module, module.connector(module.ground))
    ]
    while level:
        yield from (chain for chain in level if chain.joints >= rules.min_joints)
        level = [longer for chain in level for longer in _longer(chain, modules, rules, known)]


def _starts(module: Module, ground: Connector) -> Iterator[ModuleChain]:
    for end in _free(module, ground.name):
        length, point = passage(module, ground, end).extend(0.0, np.zeros(3), np.eye(3))
        step = ChainStep(module.name, module.name)
        yield ModuleChain((step,), module, end, module.moving_joints, 0, length, point, module.mass)


def _longer(
    chain: ModuleChain, modules: list[Module], rules: Rules, known: dict[tuple[str, str, bool], list[Extension]]
) -> Iterator[ModuleChain]:
    if chain.end is None:
        return
    first = len(chain.steps) == 1 and not rules.turned
    key = (chain.module.name, chain.end, first)
    if key not in known:
        known[key] = list(_extensions(chain.module, chain.end, modules, straight=first))
    on = f"{chain.steps[-1].called}.{chain.end}"
    for extension in known[key]:
        module = extension.module
        joints, links = chain.joints + module.moving_joints, 0 if module.moving_joints else chain.links + 1
        used = sum(step.module == module.name for step in chain.steps)
        too_long = joints > rules.max_joints or (links > rules.max_links and not extension.ends_here)
        if too_long or _used_up(module, used):
            continue
        called = f"{module.name}-{used + 1}" if used else module.name
        for turn in extension.turns:
            steps = (*chain.steps, ChainStep(module.name, called, on, extension.by, turn))
            length, point = extension.passage.extend(chain.length, chain.point, _rotation(turn))
            yield ModuleChain(steps, module, extension.end, joints, links, length, point, chain.mass + module.mass)


def _used_up(module: Module, used: int) -> bool:
    return module.available is not None and used >= module.available


def _extensions(below: Module, end: str, modules: list[Module], *, straight: bool) -> Iterator[Extension]:
    """All ways to put a module on that connector; `straight`: not turned where a turn would only turn the whole arm."""
    carrier = below.connector(end)
    straight = straight and _about_vertical(below, carrier)
    for module in modules:
        fits = fitting(carrier, module)
        for connector in fits:
            steps = angle_steps(carrier, connector)
            turns = (None,) if steps == 1 else tuple((k, steps) for k in range(1 if straight else steps))
            by = connector.name if len(fits) > 1 else None
            for free in _free(module, connector.name):
                ends_here = not _carries(module, free, modules)
                yield Extension(module, by, turns, free, ends_here, passage(module, connector, free))


def _free(module: Module, taken: str | None) -> list[str | None]:
    """Connectors of a module that a chain can end with, or go on from; None where all are taken."""
    free = [connector.name for connector in module.connectors if connector.name not in (taken, module.ground)]
    return free or [None]  # type: ignore[return-value]


def _carries(module: Module, connector: str | None, modules: list[Module]) -> bool:
    """True if any module can stand on that connector."""
    return connector is not None and any(fitting(module.connector(connector), other) for other in modules)


@cache
def _rotation(turn: tuple[int, int] | None) -> np.ndarray:
    """Rotation of a module that is put on with so many steps of a turn."""
    return np.eye(3) if turn is None else rotation_z(2 * pi * turn[0] / turn[1])


def _about_vertical(module: Module, carrier: Connector) -> bool:
    """True if a turn about this face only turns the whole arm about the vertical through the base."""
    ground = None if module.ground is None else module.connector(module.ground)
    if carrier.body != (module.root if ground is None else ground.body):
        return False
    placed = Placement.identity() if ground is None else MEETING @ ground.placement().inverse()
    face = placed @ carrier.placement()
    return bool(np.abs(face.rotation[:2, 2]).max() < 1e-9 and np.abs(face.position[:2]).max() < 1e-9)


def _mechanics(value: Any) -> Any:
    """The entries of a record that decide the motion of an arm, as a value that can be compared."""
    if isinstance(value, Quantity):
        return value.value
    if isinstance(value, Record):
        skipped = (*NOT_MECHANICAL, "name") if isinstance(value, Module) else NOT_MECHANICAL
        return tuple(_mechanics(getattr(value, name)) for name in type(value).model_fields if name not in skipped)
    return tuple(_mechanics(item) for item in value) if isinstance(value, tuple) else value
