"""Which arms a set of modules can make, what each can do, and which of them does a task best."""

from armwright.modular.enumerate import Candidate, enumerate_assemblies
from armwright.modular.rank import Ranked, rank_assemblies
from armwright.modular.task import Task, read_task

__all__ = ["Candidate", "Ranked", "Task", "enumerate_assemblies", "rank_assemblies", "read_task"]
