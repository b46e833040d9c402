"""Number formats of compiled code: double precision and, on request, single."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ModelError


@dataclass(frozen=True)
class Format:
    """A binary format of IEEE 754, and what NumPy, LLVM and C call it.

    Attributes:
        name: NumPy's.   real: C's, and LLVM's too.   bits: of the whole number.   mantissa: bits that are stored of it.
        suffix: of libm's functions.
    """

    name: str
    real: str
    bits: int
    mantissa: int
    suffix: str

    @property
    def bytes(self) -> int:
        """Size of one number."""
        return self.bits // 8

    @property
    def exponent_bias(self) -> int:
        """Number added to the exponent of a normal number when it is stored."""
        return (1 << (self.bits - self.mantissa - 2)) - 1

    @property
    def dtype(self) -> np.dtype:
        """NumPy's type, the same object every time."""
        return np.dtype(self.name)

    @property
    def integer(self) -> str:
        """LLVM's integer of as many bits."""
        return f"i{self.bits}"

    def rounded(self, number: float) -> float:
        """The nearest number of the format; infinite beyond its largest."""
        with np.errstate(over="ignore"):
            return float(self.dtype.type(number))


DOUBLE = Format("float64", "double", 64, 52, "")
SINGLE = Format("float32", "float", 32, 23, "f")

FORMATS = {each.name: each for each in (DOUBLE, SINGLE)}


def select_format(dtype: Any) -> Format:
    """The format of that name; NumPy's own type or dtype will do as well.

    Raises:
        ModelError: a format that no kernel computes in.
    """
    name = dtype if isinstance(dtype, str) else getattr(dtype, "name", getattr(dtype, "__name__", None))
    if name not in FORMATS:
        raise ModelError(place="dtype", value=dtype, expected=" or ".join(FORMATS))
    return FORMATS[name]
