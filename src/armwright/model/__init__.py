"""The frozen numeric tree that the algorithms read, and how it is built from a description."""

from armwright.model.arguments import one_state, one_state_with_masses
from armwright.model.drive import (
    Brake,
    Cogging,
    Drive,
    EfficiencyTable,
    Elasticity,
    Friction,
    Limits,
    Stops,
    Supply,
    Thermal,
)
from armwright.model.mimics import Mimics, on_tree
from armwright.model.model import Model, build_model
from armwright.model.springs import Cylinder, LinearSpring, Spring, TableSpring
from armwright.model.tree import BASE, Body, Frame

__all__ = [
    "BASE",
    "Body",
    "Brake",
    "Cogging",
    "Cylinder",
    "Drive",
    "EfficiencyTable",
    "Elasticity",
    "Frame",
    "Friction",
    "Limits",
    "LinearSpring",
    "Mimics",
    "Model",
    "Spring",
    "Stops",
    "Supply",
    "TableSpring",
    "Thermal",
    "build_model",
    "on_tree",
    "one_state",
    "one_state_with_masses",
]
