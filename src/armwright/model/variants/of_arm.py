"""From the description of a variant to its model; what `replace` changed of the arm stays changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from armwright.description.robot import RobotDescription
from armwright.errors import ModelError
from armwright.lint.feasibility import impossible_links
from armwright.model.build import build_model
from armwright.model.model import Model
from armwright.model.variants.subchain import subchain
from armwright.spatial import rotated


def told(arm: Model) -> RobotDescription:
    """The description of an arm.

    Raises:
        ModelError: it was made without one.
    """
    if arm.description is None:
        raise ModelError(f"{arm.name}: this model was not made from a description, of which a variant could be made")
    return arm.description


def variant(arm: Model, robot: RobotDescription, changes: Mapping[str, Any] | None = None) -> Model:
    """The model of a variant of an arm's description.

    Args:
        arm: what it was.   robot: what it is now.   changes: to be made again; by default those made to the arm.
    Raises:
        DescriptionError: a link that no real body can be, unless the arm itself was loaded with such links.
    """
    own = told(arm)
    warned = any(link.accept_impossible is None for link in impossible_links(own))
    model = build_model(robot, on_impossible="warn" if warned else "error")
    of_file = [w for w in arm.warnings if w not in build_model(own, on_impossible="warn").warnings]
    model = dataclasses.replace(model, warnings=(*model.warnings, *of_file))
    return model.replace(**dict(arm.changes if changes is None else changes))


def subchain_of(arm: Model, base: str, tip: str) -> Model:
    """`subchain` of an arm; gravity that `replace` has set is turned with it."""
    part = subchain(told(arm), base, tip)
    changes = {what: value for what, value in arm.changes.items() if what != "tip"}
    if "gravity" in changes:
        changes["gravity"] = rotated(part.base.rotation.T, changes["gravity"])
    return variant(arm, part.robot, changes)
