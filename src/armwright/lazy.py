"""Names of a package that are imported when they are first used; each is stated once, in the package's `.pyi`."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

TREE_ONLY = 1024  # of `compile`: no code (`ast.PyCF_ONLY_AST`, without the import of `ast`)


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package with lines `from HOME import NAME as NAME` and `HERE = THERE`.

    Args:
        package: its name, as `__name__` says it.
    """
    module = sys.modules[package]
    stub = Path(str(module.__file__)).with_suffix(".pyi")
    tree: Any = compile(stub.read_text(encoding="utf-8"), str(stub), "exec", TREE_ONLY)
    lines = [each for each in tree.body if type(each).__name__ == "ImportFrom"]
    others = [each for each in tree.body if type(each).__name__ == "Assign"]
    found = {alias.name: (line.module, alias.name) for line in lines for alias in line.names}
    homes = {alias.name: found[alias.name] for line in lines for alias in line.names if alias.asname}
    homes |= {each.targets[0].id: found[each.value.id] for each in others}

    def get(name: str) -> Any:
        if name not in homes:
            from armwright.other_names import advice

            text = f"module {package!r} has no attribute {name!r}{advice(name, homes)}"
            raise AttributeError(text, name=name, obj=module)  # Python adds the nearest name
        home, there = homes[name]
        value = getattr(importlib.import_module(home), there)
        setattr(module, name, value)
        return value

    names = sorted(homes)
    return get, lambda: sorted([*names, "__version__"]), names
