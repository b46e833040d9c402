"""HTML of arms, compiled arms and scenarios for notebooks, made by `pictures.notebook`, which is imported on first use.

The rooms of these objects know no pictures, as pictures are made of them; so the module is looked up by its name.
"""

from __future__ import annotations

import importlib
from typing import Any

SHOWN_BY = "armwright.pictures.notebook"


def repr_html(thing: Any) -> str:
    """HTML of an arm, compiled arm or scenario for a notebook: a small picture, the joints, and a summary."""
    return importlib.import_module(SHOWN_BY).html_of(thing)
