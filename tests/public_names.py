"""Every public name with its value: those of `aw`, and those of its groups as GROUP.NAME."""

from __future__ import annotations

import inspect
from typing import Any

import armwright as aw

TOP = {name: getattr(aw, name) for name in aw.__all__}
GROUPS = {name: value for name, value in TOP.items() if inspect.ismodule(value)}
PUBLIC: dict[str, Any] = {name: value for name, value in TOP.items() if name not in GROUPS} | {
    f"{group}.{name}": getattr(module, name)
    for group, module in GROUPS.items()
    for name in module.__all__
    if name not in TOP
}
BY_NAME = {name.rpartition(".")[2]: value for name, value in PUBLIC.items()}
