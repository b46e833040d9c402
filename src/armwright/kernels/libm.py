"""The functions outside itself that compiled code may call, made known to the linker by their C99 names on every platform."""

from __future__ import annotations

import ctypes
import sys

from armwright.kernels.format import FORMATS

#: Functions of libm for doubles, each with one for floats: ours by `Machine.call`, and those that LLVM calls for an
#: instruction which the processor lacks (fma, floor …).
_OF_REALS = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("exp", "expm1", "log", "log1p", "pow", "hypot", "erf", "erfc", "fmod", "remainder"),
    *("fma", "floor", "ceil", "trunc", "rint", "nearbyint", "sqrt"),
)

#: Functions that compiled code may call: libm's, and those by which LLVM moves memory.
LIBM = (*(f"{name}{f.suffix}" for f in FORMATS.values() for name in _OF_REALS), "memcpy", "memset", "memmove")


def register_libm() -> None:
    """Make the functions of `LIBM` known to every engine of this process by their C99 names, on every platform.

    Once a process, before code that calls them is linked or loaded from the cache. Repeating it does no harm.
    """
    from llvmlite import binding

    if sys.platform == "win32":
        libraries = [ctypes.CDLL("ucrtbase")]
    elif sys.platform == "darwin":
        libraries = [ctypes.CDLL("/usr/lib/libSystem.B.dylib")]
    else:
        libraries = [ctypes.CDLL(None)]  # the interpreter itself is linked with libm, wherever that lies
    for name in LIBM:
        for library in libraries:
            function = getattr(library, name, None)
            if function is not None:
                binding.add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)
                break
        else:
            raise OSError(f"this system's C library has no function {name}")
