"""Traced functions as straight-line programs."""

from armwright.program.interpret import evaluate, interpret
from armwright.program.program import Instruction, Port, Program
from armwright.program.repeat import repeated
from armwright.program.trace import call, trace

__all__ = ["Instruction", "Port", "Program", "call", "evaluate", "interpret", "repeated", "trace"]
