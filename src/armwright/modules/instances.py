"""Modules of an assembly, each with the library that it is from, in the order in which they are put on each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from armwright.errors import DescriptionError
from armwright.modules.assembly import Assembly, Placed
from armwright.modules.library import Module, ModuleLibrary


@dataclass(frozen=True)
class Instance:
    """A module of an assembly: its table there, and the library's."""

    placed: Placed
    module: Module
    library: ModuleLibrary

    @property
    def name(self) -> str:
        """Name in the assembly."""
        return self.placed.called

    def link(self, body: str) -> str:
        """Name of the link that a body becomes."""
        return self.name if len(self.module.bodies) == 1 else f"{self.name}_{body}"


def instances_of(assembly: Assembly, libraries: list[ModuleLibrary]) -> dict[str, Instance]:
    """Modules of an assembly by their names there.

    Raises:
        DescriptionError: a module in no library or in several, a name twice, more of a module than are available.
    """
    homes: dict[str, list[ModuleLibrary]] = {}
    for library in libraries:
        for module in library.modules:
            homes.setdefault(module.name, []).append(library)
    instances: dict[str, Instance] = {}
    for placed in assembly.modules:
        home = homes.get(placed.module, [])
        if not home:
            raise DescriptionError("no such module", place="module", value=placed.module, choices=homes)
        if len(home) > 1:
            names = " and ".join(library.name for library in home)
            raise DescriptionError(f"is in {names}", place="module", value=placed.module, expected="it in one library")
        if placed.called in instances:
            expected = "a name = ... of its own for each"
            raise DescriptionError("two modules have this name", place="module", value=placed.called, expected=expected)
        instances[placed.called] = Instance(placed, home[0].module(placed.module), home[0])
    for module in {instance.module.name: instance.module for instance in instances.values()}.values():
        used = [name for name, instance in instances.items() if instance.module is module]
        if module.available is not None and len(used) > module.available:
            what = f"is used {len(used)} times, as {', '.join(used)}"
            expected = f"at most {module.available}, as many as are available"
            raise DescriptionError(what, place="module", value=module.name, expected=expected)
    return instances


def ground_first(instances: dict[str, Instance]) -> Iterator[Instance]:
    """Modules in the file's order, each after the one that carries it; exactly one stands on the ground."""
    carriers: dict[str, str] = {}
    for name, instance in instances.items():
        if instance.placed.on is not None:
            carriers[name] = instance.placed.on.split(".")[0]
            if carriers[name] not in instances:
                known = [f"{other}.{c.name}" for other, i in instances.items() for c in i.module.connectors]
                place = f"module {name!r} on"
                raise DescriptionError("no such module", place=place, value=instance.placed.on, choices=known)
    roots = [name for name in instances if name not in carriers]
    if not roots:
        raise DescriptionError("every module stands on another one", expected="one module without on = ...")
    if len(roots) > 1:
        both = f"modules {roots[0]!r} and {roots[1]!r} both stand on the ground"
        raise DescriptionError(both, expected="on = ... for all but one")
    done, waiting = set(), list(instances)
    while waiting:
        ready = next((name for name in waiting if name not in carriers or carriers[name] in done), None)
        if ready is None:
            names = " and ".join(map(repr, waiting))
            raise DescriptionError(f"modules {names} carry each other: closed chains are not supported")
        done.add(ready)
        waiting.remove(ready)
        yield instances[ready]
