"""Base of all solids: the moments of their volume, and the properties that follow from them."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import model_validator

from armwright.quantity import Record
from armwright.solids.moments import Moments
from armwright.validation import Invalid

LONGEST = 1000.0  # [m] of any dimension; longer ones are probably not in metres


class SolidRecord(Record):
    """A solid in its own frame. Each kind gives its `moments`."""

    source: str | None = None
    shape: Any

    @model_validator(mode="after")
    def _of_a_robot(self) -> Any:
        for name in type(self).model_fields:
            value = getattr(self, name)
            if name.endswith("_m") and np.abs(np.array(value)).max(initial=0.0) > LONGEST:
                raise Invalid(place=name, expected=f"metres, at most {LONGEST:g} of them")
        return self

    def moments(self) -> Moments:
        """∫ p pᵀ dV, p = [x, y, z, 1], over the solid in its own frame."""
        raise NotImplementedError

    @property
    def volume_m3(self) -> float:
        """[m³]."""
        return self.moments().amount

    @property
    def centroid_m(self) -> np.ndarray:
        """(3,) [m] in the solid's frame."""
        return self.moments().centre

    @property
    def second_moments_m5(self) -> np.ndarray:
        """(3, 3) [m⁵] tensor of inertia about the centroid at a density of 1, in the solid's axes."""
        return self.moments().tensor
