"""The target platform of code: processor, vector width, and allowed functions of libm.

Linking code from the cache needs no more than this.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from llvmlite import binding

from armwright.errors import ModelError, check_known
from armwright.kernels.format import DOUBLE, FORMATS, Format

WIDTHS = {"x86-64-v4": 8, "x86-64-v3": 4, "x86-64-v2": 2, "x86-64": 2}  # doubles in a vector register
LAST_CACHE = Path("/sys/devices/system/cpu/cpu0/cache/index3/size")  # of Linux: "32768K"
NEEDS = {"x86-64-v4": "avx512f", "x86-64-v3": "avx2", "x86-64-v2": "sse4.2", "x86-64": "sse2"}


#: Functions of libm for doubles, each with one for floats: ours by `Machine.call`, and those that LLVM calls for an
#: instruction which the processor lacks (fma, floor …).
_OF_REALS = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("exp", "expm1", "log", "log1p", "pow", "hypot", "erf", "erfc", "fmod", "remainder"),
    *("fma", "floor", "ceil", "trunc", "rint", "nearbyint", "sqrt"),
)

#: Functions that compiled code may call: libm's, and those by which LLVM moves memory.
LIBM = (*(f"{name}{f.suffix}" for f in FORMATS.values() for name in _OF_REALS), "memcpy", "memset", "memmove")


@dataclass(frozen=True)
class Target:
    """The target processor of code, and its vector width."""

    cpu: str
    features: str
    width: int

    def lanes_of(self, format: Format) -> Target:
        """The same for a format, where `width` counts doubles: a register holds twice as many floats."""
        return replace(self, width=self.width * DOUBLE.bytes // format.bytes)

    def doubled(self) -> Target:
        """Two registers for each value: a program that waits for a chain of divisions does two tiles in the same time."""
        return replace(self, width=2 * self.width)


@functools.cache
def select_target(name: str | None = None, format: Format = DOUBLE) -> Target:
    """The processor this runs on, or a named level of it such as "x86-64-v3".

    Args:
        name: of the level.   format: of the numbers that it computes with.

    Raises:
        ModelError: a level that is unknown, or that this processor does not reach.
    """
    _initialise()
    features = _host_features()
    if name is None:
        width = 8 if features.get("avx512f") else 4 if features.get("avx") else 2
        if features.get("avx512f"):
            features["prefer-256-bit"] = False  # or LLVM leaves half of every register empty
        return Target(binding.get_host_cpu_name(), binding.FeatureMap(features).flatten(), width).lanes_of(format)
    check_known(ModelError, name, WIDTHS, place="target")
    if not features.get(NEEDS[name]):
        missing = f"this processor ({binding.get_host_cpu_name()}) has no {NEEDS[name]}"
        raise ModelError(missing, place="target", value=name)
    return Target(name, "-prefer-256-bit", WIDTHS[name]).lanes_of(format)


def last_cache() -> int:
    """Bytes of the last cache before memory; 0 where the system does not say."""
    try:
        return 1024 * int(LAST_CACHE.read_text(encoding="ascii").strip().removesuffix("K"))
    except (OSError, ValueError):
        return 0


def _host_features() -> dict[str, bool]:
    try:
        return dict(binding.get_host_cpu_features())
    except RuntimeError:  # LLVM knows them on x86 and some others; the processor's name is enough elsewhere
        return {}


@functools.cache
def _initialise() -> None:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    register_libm()


def register_libm() -> None:
    """Makes the functions of `LIBM` known to every engine of this process by their C99 names, on every platform.

    Once a process, before code that calls them is linked or loaded from the cache. Repeating it does no harm.
    """
    if sys.platform == "win32":
        library = ctypes.CDLL("ucrtbase")
    elif sys.platform == "darwin":
        library = ctypes.CDLL("/usr/lib/libSystem.B.dylib")
    else:
        library = ctypes.CDLL(None)  # the interpreter itself is linked with libm, wherever that lies
    for name in LIBM:
        function = getattr(library, name)  # every C library that we run on has them all
        binding.add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)
