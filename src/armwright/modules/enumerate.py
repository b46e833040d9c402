"""All arms that a library's connectors allow, each with its mass, reach and payload."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice

from armwright.entry import expect
from armwright.errors import DescriptionError
from armwright.model import Model
from armwright.model.model import assembled
from armwright.modules.assemble import assemble
from armwright.modules.assembly import Assembly
from armwright.modules.chains import ModuleChain, Rules, chains, possible_modules
from armwright.modules.library import ModuleLibrary
from armwright.modules.statics import holding
from armwright.progress import Shown, automatic
from armwright.results.result import Result
from armwright.results.table import Table, number

COUNTED = 200_000  # at most so many chains are counted


@dataclass(frozen=True)
class Candidate:
    """An arm of modules, with its mass, reach and payload."""

    assembly: Assembly
    joints: int
    mass: float  # [kg]
    reach: float  # [m], upper bound of the distance from the base to the tip
    payload: float  # [kg] at the tip, held at rest in the worst pose
    holds_itself: bool
    weakest: str  # the joint that reaches its limit first


@dataclass(frozen=True)
class Enumeration(Result):
    """Arms found, the number of candidates, and excluded modules with reasons."""

    candidates: tuple[Candidate, ...]
    total: int  # arms that the connectors allow; COUNTED: that many or more
    left_out: Mapping[str, str]

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{len(self.candidates)} of {self.total} arms"

    def tables(self) -> list[Table]:
        """A row for each arm."""
        rows = []
        for c in self.candidates:
            weakest = c.weakest if c.holds_itself else f"{c.weakest}, under the arm's own weight"
            rows.append([c.assembly.name, *map(number, (c.joints, c.mass, c.reach, c.payload)), weakest])
        heads = ("modules", "joints", "mass [kg]", "reach [m]", "payload at the worst pose [kg]", "weakest joint")
        return [Table(self.heading, heads, rows, ("weakest joint",))]

    def sentences(self) -> list[str]:
        """Modules that are left out, and why."""
        return [f"module {name} is left out: {reason}" for name, reason in self.left_out.items()]


def enumerate_assemblies(
    library: ModuleLibrary,
    *,
    max_joints: int = 6,
    min_joints: int = 1,
    max_links: int = 1,
    limit: int = 1000,
    seed: int = 0,
    progress: Shown = None,
) -> Enumeration:
    """Every chain of modules from the ground that the connectors allow, those with fewer modules first.

    Each module is used as often as it is available. Left out are impossible modules, modules that move like another
    one, and arms that differ from another by a turn about the vertical. Payload: at rest, without friction, in the worst of
    256 poses spread over the joints' ranges and 768 more about the worst of them.

    Args:
        library: the modules.   max_joints: of an arm.   min_joints: of an arm.
        max_links: how many modules without joints may stand on each other, not counting one that ends the arm.
        limit: how many are computed.   seed: of the poses.   progress: True or None: a bar where it is seen;
            False: none; a function is called with (done, of how many).
    Returns:
        enumeration: `candidates`, `total` that there are, and `left_out` modules with the reason.
    Raises:
        DescriptionError: no module with a ground, or limits that leave nothing.
    Example:
        >>> library = aw.modules.read_modules("improv")
        >>> found = aw.modules.enumerate_assemblies(library, max_joints=2, limit=10)
        >>> found.total, len(found.candidates)
        (645, 10)
    """
    rules = Rules(max_joints, min_joints, max_links)
    every, left_out = counted_chains(library, rules, limit)
    candidates = []
    with automatic(progress, f"{library.name}: assembling") as tell:
        for chain in every[:limit]:
            assembly, arm = arm_of(chain, library)
            held = holding(arm, seed)
            mass = robot_mass(arm)
            candidates.append(
                Candidate(assembly, arm.n, mass, chain.reach, held.payload, held.holds_itself, held.joint)
            )
            tell(len(candidates), min(limit, len(every)))
    return Enumeration(tuple(candidates), len(every), left_out)


def arm_of(chain: ModuleChain, library: ModuleLibrary) -> tuple[Assembly, Model]:
    """Assembly and model of a chain; its modules have been checked."""
    assembly = chain.assembly(library)
    return assembly, assembled(assemble(assembly, [library]))


def robot_mass(arm: Model) -> float:
    """Mass of all links [kg]."""
    assert arm.description is not None
    return arm.description.total_mass


def counted_chains(library: ModuleLibrary, rules: Rules, limit: int) -> tuple[list[ModuleChain], dict[str, str]]:
    """All chains of a library, at most COUNTED of them, and the modules that are left out with the reason."""
    expect(library, ModuleLibrary, "library", "a module library, as aw.modules.read_modules returns", DescriptionError)
    if limit < 1:
        raise DescriptionError(place="limit", value=limit, expected="1 or more")
    place = f"library {library.name!r}"
    modules, left_out = possible_modules(library)
    if not any(module.ground for module in modules):
        raise DescriptionError("no module has a ground = ..., the connector that an arm stands on", place=place)
    every = list(islice(chains(modules, rules), COUNTED))
    if not every:
        what = f"the connectors allow no arm of {rules.min_joints} to {rules.max_joints} joints"
        raise DescriptionError(what, place=place)
    return every, left_out
