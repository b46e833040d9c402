"""The frozen numeric tree that the algorithms read, and how it is built from a description."""

from armwright.model.arguments import one_state as one_state, one_state_with_masses as one_state_with_masses
from armwright.model.drive import (
    Brake as Brake,
    Cogging as Cogging,
    Drive as Drive,
    DriveLimits as DriveLimits,
    EfficiencyTable as EfficiencyTable,
    Elasticity as Elasticity,
    Firmware as Firmware,
    Friction as Friction,
    Stops as Stops,
    Supply as Supply,
    Thermal as Thermal,
)
from armwright.model.mimics import Mimics as Mimics, on_tree as on_tree
from armwright.model.model import Model as Model, build_model as build_model
from armwright.model.springs import (
    LinearSpring as LinearSpring,
    Spring as Spring,
    SpringCylinder as SpringCylinder,
    TableSpring as TableSpring,
)
from armwright.model.tree import BASE as BASE, Body as Body, Frame as Frame
