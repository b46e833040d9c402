"""CUDA C as a dialect of C: what differs from C99 are the words for integers, bits and functions of the device."""

from __future__ import annotations

from armwright.kernels.c_syntax import Dialect

CUDA = Dialect(
    integer="unsigned long long",
    literal="0x{:016x}ULL",
    function="static __device__ ",
    apart="static __device__ __noinline__ ",
    infinity="__longlong_as_double(0x7ff0000000000000LL)",
    nan="__longlong_as_double(0x7ff8000000000000LL)",
    guarded=False,
)

#: What the machine calls for the bits of a double; NVRTC includes no headers, and these need none.
BITS = """\
static __device__ unsigned long long {prefix}bits_of(double x)
{{
    return (unsigned long long)__double_as_longlong(x);
}}

static __device__ double {prefix}from_bits(unsigned long long i)
{{
    return __longlong_as_double((long long)i);
}}
"""
