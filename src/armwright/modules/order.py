"""Which module of which library each one of an assembly is, and the order in which they stand on each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from armwright.errors import DescriptionError, nearest
from armwright.modules.assembly import Assembly, Placed
from armwright.modules.library import Module, ModuleLibrary


@dataclass(frozen=True)
class Instance:
    """A module in its place: what it is called, and where it comes from."""

    placed: Placed
    module: Module
    library: ModuleLibrary

    @property
    def name(self) -> str:
        """What the assembly calls it."""
        return self.placed.called

    def link(self, body: str) -> str:
        """The link that a body becomes."""
        return self.name if len(self.module.bodies) == 1 else f"{self.name}_{body}"


def instances_of(assembly: Assembly, libraries: list[ModuleLibrary]) -> dict[str, Instance]:
    """The modules by what they are called here."""
    homes: dict[str, list[ModuleLibrary]] = {}
    for library in libraries:
        for module in library.modules:
            homes.setdefault(module.name, []).append(library)
    found: dict[str, Instance] = {}
    for placed in assembly.modules:
        home = homes.get(placed.module, [])
        if not home:
            raise DescriptionError(f"no module {placed.module!r}; {nearest(placed.module, homes)}")
        if len(home) > 1:
            names = " and ".join(library.name for library in home)
            raise DescriptionError(f"module {placed.module!r} is in {names}: expected it in one library")
        if placed.called in found:
            raise DescriptionError(
                f"two modules are called {placed.called!r}: expected a name = ... of its own for each"
            )
        found[placed.called] = Instance(placed, home[0].module(placed.module), home[0])
    for module in {instance.module.name: instance.module for instance in found.values()}.values():
        used = [name for name, instance in found.items() if instance.module is module]
        if module.available is not None and len(used) > module.available:
            raise DescriptionError(
                f"module {module.name!r} is used {len(used)} times, as {', '.join(used)}: expected at most "
                f"{module.available}, as many as are available"
            )
    return found


def ground_first(instances: dict[str, Instance]) -> Iterator[Instance]:
    """Modules in the file's order, each behind the one that carries it; exactly one stands on the ground."""
    carriers: dict[str, str] = {}
    for name, instance in instances.items():
        if instance.placed.on is not None:
            carrier = instance.placed.on.split(".")[0]
            if carrier not in instances:
                raise DescriptionError(
                    f"module {name!r}: on = {instance.placed.on!r}: no module is called {carrier!r}; "
                    f"{nearest(carrier, instances)}"
                )
            carriers[name] = carrier
    roots = [name for name in instances if name not in carriers]
    if not roots:
        raise DescriptionError(
            "every module stands on another one: expected one without on = ..., closed chains are not offered"
        )
    if len(roots) > 1:
        raise DescriptionError(
            f"modules {roots[0]!r} and {roots[1]!r} both stand on the ground: expected on = ... for all but one"
        )
    done, waiting = set(), list(instances)
    while waiting:
        ready = [name for name in waiting if name not in carriers or carriers[name] in done]
        if not ready:
            raise DescriptionError(
                f"modules {' and '.join(map(repr, waiting))} carry each other: closed chains are not offered"
            )
        done.add(ready[0])
        waiting.remove(ready[0])
        yield instances[ready[0]]
