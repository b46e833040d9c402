"""Classes that public functions take or return have a public name themselves."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re

import armwright as aw
from public_names import BY_NAME, PUBLIC

ALIASES = {
    "Aim",
    "Arm",
    "Feedback",
    "Method",
    "Options",
    "Quantity",
    "Shown",
    "Values",
    "Verdict",
}  # of texts and forms, not classes


def ours() -> set[str]:
    """Names of all classes of the package."""
    names = (each.name for each in pkgutil.walk_packages(aw.__path__, "armwright.") if "__main__" not in each.name)
    modules = [importlib.import_module(name) for name in names]
    return {
        name
        for each in modules
        for name, value in [*vars(each).items()]
        if inspect.isclass(value) and value.__module__ == each.__name__
    }


def test_types_of_public_signatures_are_public() -> None:
    known = ours() - set(BY_NAME) - ALIASES
    found = {
        (name, word)
        for name, value in PUBLIC.items()
        if inspect.isfunction(value)
        for annotation in value.__annotations__.values()
        for word in re.findall(r"[A-Za-z_]\w*", str(annotation))
        if word in known
    }
    assert not found
