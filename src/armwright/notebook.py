"""Arms, compiled arms and scenarios as notebooks and prompts show them.

HTML is made by `pictures.notebook`, which is imported on first use. The rooms of these objects know no pictures, as pictures are
made of them; so the module is looked up by its name.
"""

from __future__ import annotations

import importlib
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any

SHOWN_BY = "armwright.pictures.notebook"


def repr_html(thing: Any) -> str:
    """HTML of an arm, compiled arm or scenario for a notebook: a small picture, the joints, and a summary."""
    return importlib.import_module(SHOWN_BY).html_of(thing)


def stated(thing: Any) -> str:
    """A dataclass, and those in it, as the call that makes it, without the arguments that have their defaults."""
    texts = {each.name: _text(getattr(thing, each.name)) for each in fields(thing) if each.repr}
    kept = [
        f"{each.name}={texts[each.name]}" for each in fields(thing) if each.repr and texts[each.name] != _default(each)
    ]
    return f"{type(thing).__name__}({', '.join(kept)})"


def _text(value: Any) -> str:
    by_decorator = is_dataclass(value) and hasattr(type(value).__repr__, "__wrapped__")  # which a class's own has not
    return stated(value) if by_decorator else repr(value)


def _default(each: Field[Any]) -> str | None:
    """A field's default as text; None without one."""
    default = each.default if each.default_factory is MISSING else each.default_factory()
    return None if default is MISSING else _text(default)
