"""A joint that does not move: its child is one body with its parent."""

from __future__ import annotations

from dataclasses import dataclass

from armwright.joint_kinds.kind import JointKind


@dataclass(frozen=True)
class Fixed(JointKind):
    """A joint without a coordinate."""

    name = "fixed"
    about = "A joint that does not move: its child is one body with its parent."
    moves, turns, slides = False, False, False
