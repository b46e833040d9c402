"""`armwright diff`: two robot files compared number by number, and the effect on the dynamics."""

from __future__ import annotations

import armwright as aw
from armwright.cli.arguments import argument
from armwright.cli.tables import show

ARM = "The {}: name of a built-in arm, or path of a robot's TOML, URDF or MJCF file."


def diff(a: str = argument("A", ARM.format("first")), b: str = argument("B", ARM.format("second"))) -> None:
    """Compare two arms number by number, with the effect on the dynamics.

    The effect is shown as total mass, and the largest changes of gravity torques and inertias (of the mass matrix's
    diagonal, rotors included) at q = 0 and at 32 poses within the limits of A.

    \b
    Examples:
      armwright diff old-arm.toml new-arm.toml
      armwright diff puma560 my-puma.urdf
    """
    show(aw.robotfiles.diff(a, b))
