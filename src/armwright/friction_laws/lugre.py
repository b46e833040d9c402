"""LuGre: the map of its steady state; the bristles themselves are `actuators.lugre`. [CanudasEtAl1995]"""

from __future__ import annotations

from armwright.friction_laws.coulomb import Coulomb
from armwright.friction_laws.law import OwnKey


class LuGre(Coulomb):
    """Bristles that bend and slip, whose steady sliding is Coulomb's law."""

    name = "lugre"
    equation = """
    `law = "lugre"`: in the simulator  f = offset + viscous q̇ + bristle_stiffness z + bristle_damping ż,
    ż = q̇ - bristle_stiffness z |q̇| / g,  g the bracket of the Coulomb law; that law itself in the kernels. [CanudasEtAl1995]"""
    own = (
        OwnKey("bristle_stiffness", "stiffness", "σ0 of LuGre.", "Positive"),
        OwnKey("bristle_damping", "damping", "σ1 of LuGre.", "NotNegative"),
    )
    dry = "needed"
    sticks = False  # its bristles hold it
    bristles = True
    bends = True
    feature = "LuGre friction"
    lost = "the bristles of the friction law 'lugre'"
    step_limits = (("the bristle stiffness", 0, 0), ("the bristle damping", 1, 1))
