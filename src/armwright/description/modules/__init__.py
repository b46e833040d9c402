"""Modules of arms, and the arms that they make."""

from armwright.description.modules.assemble import assemble
from armwright.description.modules.assembly import (
    Assembly,
    Placed,
    assembly_names,
    library_names,
    read_assembly,
    read_modules,
)
from armwright.description.modules.library import Connector, Module, ModuleBody, ModuleLibrary

__all__ = [
    "Assembly",
    "Connector",
    "Module",
    "ModuleBody",
    "ModuleLibrary",
    "Placed",
    "assemble",
    "assembly_names",
    "library_names",
    "read_assembly",
    "read_modules",
]
