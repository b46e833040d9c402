"""Scenario files: everything that decides a run, written down; many lanes of it; and a run done again."""

from armwright.scenarios.file import read_scenario
from armwright.scenarios.reproduce import reproduce
from armwright.scenarios.writer import write_scenario

__all__ = ["read_scenario", "reproduce", "write_scenario"]
