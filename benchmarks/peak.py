"""The machine's limit: as many fused multiply-adds as it can do, in a loop that LLVM makes for the same target and width.

Nothing is loaded or stored, and no addition waits for another: what is measured is vector lanes × FMA ports × clock.
"""

from __future__ import annotations

import ctypes
import functools
import re
from collections.abc import Callable

import numpy as np
from llvmlite import binding
from timing import Check, Contestant

from armwright.kernels.llvm import batch_module
from armwright.kernels.target import Target
from armwright.program import Program

ROUNDS = 20_000
ARITHMETIC = re.compile(
    r"= (?:tail )?(fadd|fsub|fmul|fdiv|call)\b[^@\n]*?<\d+ x (?:double|float)> (?:@llvm\.(fma|sqrt)\.)?"
)


def operations(program: Program, width: int) -> dict[str, int]:
    """Vector operations a state, from the LLVM text that the kernel is compiled from, sines and cosines written out.

    Returns:
        slots: additions, products and fused products, each an operation of a floating-point port.
        flops: the same with two for a fused product.   divisions: and square roots, which are in neither.
    """
    found = [call or plain for plain, call in ARITHMETIC.findall(batch_module(width, program).text())]
    fused = found.count("fma")
    slots = fused + sum(found.count(name) for name in ("fadd", "fsub", "fmul"))
    divisions = found.count("fdiv") + found.count("sqrt")
    return {"slots": slots, "flops": slots + fused, "divisions": divisions}


def peak(target: Target) -> Contestant:
    """The loop: ns a lane's fused multiply-add."""
    run, out = fma_loop(target)
    chains = len(out)

    def check(_: object) -> Check:
        return Check(float(np.abs(out - 2.0).max()), 1e-12)  # a ← a/2 + 1 ends at 2, from wherever it starts

    return Contestant("fused multiply-adds", run, ROUNDS * chains * target.width, check)


def fma_loop(target: Target, rounds: int = ROUNDS) -> tuple[Callable[[], None], np.ndarray]:
    """The loop, and where it leaves its (chains, width) numbers; it runs beside others, without the GIL."""
    function = _compiled(target)
    chains = _chains(target)
    room = np.full(chains * target.width + 8, np.nan)
    start = -room.ctypes.data // 8 % 8
    out = room[start : start + chains * target.width].reshape(chains, target.width)
    return lambda: function(rounds, out.ctypes.data), out


def _chains(target: Target) -> int:
    """Sums that do not wait for each other: twice what covers the latency, or what 16 registers hold."""
    return 24 if target.width == 8 or not binding.get_default_triple().startswith("x86_64") else 12


@functools.cache
def _compiled(target: Target) -> Callable[[int, int], None]:
    parsed = binding.parse_assembly(_text(target.width, _chains(target)))
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=target.cpu, features=target.features, opt=3, jit=True
    )
    engine = binding.create_mcjit_compiler(parsed, machine)
    engine.finalize_object()
    function = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p)(engine.get_function_address("fma_loop"))
    function.engine = engine  # type: ignore[attr-defined]
    return function


def _text(width: int, chains: int) -> str:
    v = f"<{width} x double>"
    fma = f"@llvm.fma.v{width}f64"
    text = [f"declare {v} {fma}({v}, {v}, {v})", "define void @fma_loop(i64 %rounds, ptr %out) {", "entry:"]
    text += ["  br label %loop", "loop:", "  %i = phi i64 [ 0, %entry ], [ %i.next, %loop ]"]
    text += [f"  %a{k} = phi {v} [ splat (double {k}.0), %entry ], [ %b{k}, %loop ]" for k in range(chains)]
    given = f"{v} splat (double 0.5), {v} splat (double 1.0)"
    text += [f"  %b{k} = call {v} {fma}({v} %a{k}, {given})" for k in range(chains)]
    text += ["  %i.next = add i64 %i, 1", "  %more = icmp ult i64 %i.next, %rounds"]
    text += ["  br i1 %more, label %loop, label %done", "done:"]
    for k in range(chains):
        text += [f"  %p{k} = getelementptr {v}, ptr %out, i64 {k}", f"  store {v} %b{k}, ptr %p{k}, align 8"]
    return "\n".join([*text, "  ret void", "}"])
