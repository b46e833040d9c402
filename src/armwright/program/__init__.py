"""Traced functions as straight-line programs."""

from armwright.program.interpret import evaluate, interpret
from armwright.program.kept_programs import kept
from armwright.program.program import Instruction, Port, Program
from armwright.program.repeat import repeated
from armwright.program.trace import call, trace
from armwright.program.where_needed import WhereNeeded

__all__ = [
    "Instruction",
    "Port",
    "Program",
    "WhereNeeded",
    "call",
    "evaluate",
    "interpret",
    "kept",
    "repeated",
    "trace",
]
