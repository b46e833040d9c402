"""Versions and processor of a run, which decide its last bits."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from armwright.kernels.target import select_target

PACKAGES = ("armwright", "casadi", "llvmlite", "numpy")


@cache
def provenance(target: str | None = None) -> Mapping[str, str]:
    """Names and versions, as texts."""
    chosen = select_target(target)
    on = sorted(feature[1:] for feature in chosen.features.split(",") if feature.startswith("+"))
    versions = {name: importlib.import_module(name).__version__ for name in PACKAGES}  # metadata takes 10 ms to read
    return MappingProxyType(
        versions | {"processor": chosen.cpu, "features": " ".join(on), "lanes at once": str(chosen.width)}
    )
