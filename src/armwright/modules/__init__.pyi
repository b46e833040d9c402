"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.modules.assemble import assemble as assemble
from armwright.modules.assembly import Assembly as Assembly, read_modules as read_modules
from armwright.modules.enumerate import Enumeration as Enumeration, enumerate_assemblies as enumerate_assemblies
from armwright.modules.library import ModuleLibrary as ModuleLibrary
from armwright.modules.rank import Ranking as Ranking, rank_assemblies as rank_assemblies
from armwright.modules.task import Task as Task, read_task as read_task
