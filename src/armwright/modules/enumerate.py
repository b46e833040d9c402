"""All arms that a library's connectors allow, each with what it weighs, reaches and holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice

from armwright.errors import DescriptionError
from armwright.model import Model
from armwright.model.build import assembled
from armwright.modules.assemble import assemble
from armwright.modules.assembly import Assembly
from armwright.modules.chains import Chain, Rules, chains, possible_modules
from armwright.modules.library import Module, ModuleLibrary
from armwright.modules.statics import holding

COUNTED = 200_000  # chains are counted so far, and no further
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Candidate:
    """An arm of modules, and what it can do."""

    assembly: Assembly
    joints: int
    mass: float  # [kg]
    reach: float  # [m], base to tip pulled straight
    payload: float  # [kg] at the tip, held at rest in the worst pose
    holds_itself: bool
    weakest: str  # the joint that gives in first


@dataclass(frozen=True)
class Enumeration:
    """What was found, of how many, and which modules were left out and why."""

    candidates: tuple[Candidate, ...]
    total: int  # that the connectors allow; COUNTED: that many or more
    left_out: Mapping[str, str]


def enumerate_assemblies(
    library: ModuleLibrary,
    *,
    max_joints: int = 6,
    min_joints: int = 1,
    max_links: int = 1,
    limit: int = 1000,
    seed: int = 0,
    progress: Progress = lambda done, total: None,
) -> Enumeration:
    """Every chain of modules from the ground that the connectors allow, those with fewer modules first.

    Each module is used as often as there are of it. Left out are modules that cannot be, modules that move like another
    one, and arms that a turn about the vertical makes of another. Payload: at rest, friction aside, in the worst of
    256 poses spread over the joints' ranges and 768 more about the worst of them.

    Args:
        library: what there is.   max_joints: of an arm.   min_joints: of an arm.
        max_links: how many modules without joints may stand on each other, not counting one that ends the arm.
        limit: how many are computed.   seed: of the poses.   progress: is told (done, of how many).
    Returns:
        found: `candidates`, `total` that there are, and `left_out` modules with the reason.
    Raises:
        DescriptionError: no module with a ground, or limits that leave nothing.
    """
    rules = Rules(max_joints, min_joints, max_links)
    modules, total, left_out = counted(library, rules, limit)
    found = []
    for chain in islice(chains(modules, rules), limit):
        found.append(_candidate(chain, library, seed))
        progress(len(found), min(limit, total))
    return Enumeration(tuple(found), total, left_out)


def arm_of(chain: Chain, library: ModuleLibrary) -> Model:
    """The model of a chain; its modules have been checked."""
    return assembled(assemble(chain.assembly(library), [library]))


def counted(library: ModuleLibrary, rules: Rules, limit: int) -> tuple[list[Module], int, dict[str, str]]:
    """The modules to use, and how many chains there are."""
    if limit < 1:
        raise DescriptionError(f"limit = {limit}: expected 1 or more")
    modules, left_out = possible_modules(library)
    if not any(module.ground for module in modules):
        raise DescriptionError(f"{library.name}: no module has a ground = ..., the connector that an arm stands on")
    total = sum(1 for _ in islice(chains(modules, rules), COUNTED))
    if not total:
        raise DescriptionError(
            f"{library.name}: the connectors allow no arm of {rules.min_joints} to {rules.max_joints} joints"
        )
    return modules, total, left_out


def _candidate(chain: Chain, library: ModuleLibrary, seed: int) -> Candidate:
    arm = arm_of(chain, library)
    held = holding(arm, seed)
    record = arm.description
    assert record is not None
    return Candidate(
        chain.assembly(library),
        arm.n,
        record.total_mass,
        chain.reach,
        held.payload,
        held.holds_itself,
        held.joint,
    )
