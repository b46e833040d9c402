"""Names of a package that are imported when they are first used; each is stated once, in the package's `.pyi`."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

TREE_ONLY = 1024  # of `compile`: no code (`ast.PyCF_ONLY_AST`, without the import of `ast`)


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package whose stub says where each name lives.

    Its lines: `from armwright.ROOM import NAME as NAME`; `from . import GROUP as GROUP`, relative, for a package;
    `HERE = THERE` for a public name that is another's.

    Args:
        package: its name, as `__name__` says it.
    """
    module = sys.modules[package]
    stub = Path(str(module.__file__)).with_suffix(".pyi")
    tree: Any = compile(stub.read_text(encoding="utf-8"), str(stub), "exec", TREE_ONLY)
    lines = [each for each in tree.body if type(each).__name__ == "ImportFrom"]
    others = [each for each in tree.body if type(each).__name__ == "Assign"]
    found = {alias.name: (line, alias.name) for line in lines for alias in line.names}
    homes = {alias.name: found[alias.name] for line in lines for alias in line.names if alias.asname}
    homes |= {each.targets[0].id: found[each.value.id] for each in others}

    class Lazy(ModuleType):
        """A package whose names stay what the stub says when Python binds a file of the same name to it."""

        def __setattr__(self, name: str, value: Any) -> None:
            if name not in homes or not isinstance(value, ModuleType) or homes[name][0].level:
                super().__setattr__(name, value)

        def __reduce__(self) -> tuple[Callable[[str], ModuleType], tuple[str]]:
            """The package by its name, as cloudpickle (joblib, Dask, Ray) writes modules; it knows plain modules alone."""
            return importlib.import_module, (package,)

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(absent(name), name=name, obj=module)  # Python adds the nearest name
        line, there = homes[name]
        if line.level:
            value = importlib.import_module(".".join(filter(None, (package, line.module, there))))
        else:
            value = getattr(importlib.import_module(line.module), there)
        setattr(module, name, value)
        return value

    def absent(name: str) -> str:
        text = f"module {package!r} has no attribute {name!r}"
        if any(stub.with_name(file).exists() for file in (name, f"{name}.py")):
            return text  # a file that Python imports next
        from armwright.other_names import advice

        groups = [each for each in homes if homes[each][0].level]
        return text + advice(name, [*homes, *(f"{group}.{each}" for group in groups for each in get(group).__all__)])

    module.__class__ = Lazy
    return get, lambda: sorted([*homes, *(["__version__"] if hasattr(module, "__version__") else [])]), sorted(homes)
