"""Known placeholders: numbers in robot files that nobody meant. The list is `placeholders.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

MATCH = 1e-6  # relative; files print their fillers with more or fewer digits


@dataclass(frozen=True)
class InertialFiller:
    """A mass and tensor that a file has where the real ones are not known."""

    name: str
    why: str  # how it is known not to be the real one
    moments_kg_m2: tuple[float, ...]  # principal moments, ascending
    masses_kg: tuple[float, ...] = ()  # any of them; empty: any mass up to `heaviest_kg`
    heaviest_kg: float = np.inf

    def matches(self, mass: float, tensor: np.ndarray) -> bool:
        """True if mass [kg] and tensor about the centre of mass (3, 3) [kg m²] are this filler."""
        if self.masses_kg and not any(np.isclose(mass, known, rtol=MATCH, atol=0.0) for known in self.masses_kg):
            return False
        return mass <= self.heaviest_kg and np.allclose(
            np.linalg.eigvalsh(tensor), self.moments_kg_m2, rtol=MATCH, atol=0.0
        )


@dataclass(frozen=True)
class EffortFiller:
    """Effort limits [N m | N] of consecutive joints that belong to another robot."""

    name: str
    why: str  # how it is known not to be the real one
    efforts: tuple[float, ...]

    def found_in(self, efforts: Sequence[float]) -> int | None:
        """The first of the joints that bear them; None where they are not there."""
        width = len(self.efforts)
        starts = range(len(efforts) - width + 1)
        return next((k for k in starts if np.allclose(efforts[k : k + width], self.efforts, rtol=MATCH)), None)


@cache
def known_placeholders() -> tuple[tuple[InertialFiller, ...], tuple[EffortFiller, ...]]:
    """The list that comes with the package."""
    data = tomllib.loads((resources.files("armwright.lint") / "placeholders.toml").read_text(encoding="utf-8"))
    return tuple(InertialFiller(**_frozen(f)) for f in data["inertial"]), tuple(
        EffortFiller(**_frozen(f)) for f in data["efforts"]
    )


def _frozen(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}
