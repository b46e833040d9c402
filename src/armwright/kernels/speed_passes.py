"""Two passes of time-optimal path parametrisation over grid cells, in native code. [PhamPham2018]

In a cell of length Δ the path acceleration u is constant and the squared path speed goes from x to x + 2 Δ u. Each cell has
lines of two kinds, u ≤ p + s x and -u ≤ p' + s' x, and the least of each kind is concave in x. Together they leave room for u
where `room(x) = upper(x) + lower(x) ≥ 0`, which is concave as well. So the two-variable linear programs of both passes are solved
exactly, in a few steps each: Newton's method from outside reaches the end of the x with room.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache

import numpy as np

from armwright.kernels.engine import Engine
from armwright.kernels.llvm import LlvmModule
from armwright.kernels.target import select_target

ROUNDING = 1e-15  # of the terms of which room is the sum
_ARRAYS = ("upper", "upper_slope", "lower", "lower_slope", "steps", "cap", "low", "high", "x")


@dataclass(frozen=True, eq=False)
class CellLines:
    """Lines of every cell:  u ≤ upper + upper_slope x  and  -u ≤ lower + lower_slope x.

    Attributes:
        upper, upper_slope, lower, lower_slope: (m - 1, r), finite.
        cap: (m,) largest x at the grid points, finite.   steps: (m - 1,) Δ.
        mirrored: the sign of `lower_slope` is turned: for symmetric limits both kinds share their arrays.
    """

    upper: np.ndarray
    upper_slope: np.ndarray
    lower: np.ndarray
    lower_slope: np.ndarray
    cap: np.ndarray
    steps: np.ndarray
    mirrored: bool = False


def controllable(lines: CellLines, last: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest x (m,) from which x = last is reached at the end; (1, -1) where there is none."""
    low, high = np.ones(len(lines.cap)), -np.ones(len(lines.cap))
    if last <= lines.cap[-1]:
        low[-1] = high[-1] = last
        _run("backward", lines, low, high, low)
    return low, high


def greedy(lines: CellLines, low: np.ndarray, high: np.ndarray, first: float) -> np.ndarray:
    """Largest x (m,) within controllable sets (m,) that is reached from x = first, which lies within the first of them."""
    x = np.empty(len(low))
    x[0] = first
    _run("forward", lines, low, high, x)
    return x


def _run(name: str, lines: CellLines, low: np.ndarray, high: np.ndarray, x: np.ndarray) -> None:
    arrays = {"steps": lines.steps, "cap": lines.cap, "low": low, "high": high, "x": x}
    kinds = {each: getattr(lines, each) for each in _ARRAYS[:4]}
    rows = [np.ascontiguousarray((kinds | arrays)[each], dtype=float) for each in _ARRAYS]
    sign = -1.0 if lines.mirrored else 1.0
    _functions()[name](len(lines.steps), lines.upper.shape[1], sign, *(each.ctypes.data for each in rows))


@cache
def _functions() -> dict[str, ctypes._CFunctionType]:
    engine = Engine(select_target(), passes_module)
    arguments = [ctypes.c_int64, ctypes.c_int64, ctypes.c_double, *[ctypes.c_void_p] * len(_ARRAYS)]
    return {name: engine.function(name, *arguments) for name in ("backward", "forward")}


def passes_module(width: int) -> LlvmModule:
    """The module of `backward` and `forward`, both `void (cells, rows, sign, arrays…)`; `width` does not matter."""
    module = LlvmModule(width)
    module.declarations.add("declare double @llvm.fabs.f64(double)")
    module.declarations.add("declare double @llvm.maxnum.f64(double, double)")
    module.declarations.add("declare double @llvm.minnum.f64(double, double)")
    module.functions |= {"least": _LEAST, "room": _ROOM, "end": _END}
    module.functions |= {"backward": _pass("backward", _BACKWARD), "forward": _pass("forward", _FORWARD)}
    return module


# The least of a cell's lines at x: its value is returned, and the line is stored. Begins with a line that is stored already.
_LEAST = """define internal double @least(i64 %rows, double %sign, ptr %p, ptr %s, double %x, ptr %line) noinline nounwind {
entry:
  %slope.at = getelementptr double, ptr %line, i64 1
  %p0 = load double, ptr %line
  %s0 = load double, ptr %slope.at
  %sx0 = fmul double %s0, %x
  %v0 = fadd double %p0, %sx0
  br label %row
row:
  %k = phi i64 [ 0, %entry ], [ %k.next, %row ]
  %best = phi double [ %v0, %entry ], [ %best.next, %row ]
  %best.p = phi double [ %p0, %entry ], [ %p.next, %row ]
  %best.s = phi double [ %s0, %entry ], [ %s.next, %row ]
  %p.at = getelementptr double, ptr %p, i64 %k
  %s.at = getelementptr double, ptr %s, i64 %k
  %pk = load double, ptr %p.at
  %s.raw = load double, ptr %s.at
  %sk = fmul double %s.raw, %sign
  %sx = fmul double %sk, %x
  %v = fadd double %pk, %sx
  %less = fcmp olt double %v, %best
  %best.next = select i1 %less, double %v, double %best
  %p.next = select i1 %less, double %pk, double %best.p
  %s.next = select i1 %less, double %sk, double %best.s
  %k.next = add i64 %k, 1
  %again = icmp ult i64 %k.next, %rows
  br i1 %again, label %row, label %done
done:
  store double %p.next, ptr %line
  store double %s.next, ptr %slope.at
  ret double %best.next
}"""

# Room at x between the lines of both kinds and the way to the next set [lo, hi] of x + step u; both least lines are stored.
_CELL = "i64 %rows, double %sign, ptr %up, ptr %us, ptr %lp, ptr %ls, double %inverse, double %lo, double %hi"
_ROOM = f"""define internal double @room({_CELL}, double %x, ptr %upper, ptr %lower) noinline nounwind {{
entry:
  %hi.p = fmul double %hi, %inverse
  %hi.s = fneg double %inverse
  %lo.n = fneg double %lo
  %lo.p = fmul double %lo.n, %inverse
  %us.at = getelementptr double, ptr %upper, i64 1
  %ls.at = getelementptr double, ptr %lower, i64 1
  store double %hi.p, ptr %upper
  store double %hi.s, ptr %us.at
  store double %lo.p, ptr %lower
  store double %inverse, ptr %ls.at
  %u = call double @least(i64 %rows, double 1.0, ptr %up, ptr %us, double %x, ptr %upper)
  %l = call double @least(i64 %rows, double %sign, ptr %lp, ptr %ls, double %x, ptr %lower)
  %sum = fadd double %u, %l
  ret double %sum
}}"""

# The end of the x with room, from outside; `way` 1: the highest from a cap, -1: the lowest from 0. -1 where there is no room.
_END = f"""define internal double @end({_CELL}, double %begin, double %way) noinline nounwind {{
entry:
  %upper = alloca [2 x double]
  %lower = alloca [2 x double]
  br label %step
step:
  %x = phi double [ %begin, %entry ], [ %root, %newton ]
  %room = call double @room({_CELL}, double %x, ptr %upper, ptr %lower)
  %us.at = getelementptr double, ptr %upper, i64 1
  %ls.at = getelementptr double, ptr %lower, i64 1
  %p1 = load double, ptr %upper
  %p2 = load double, ptr %lower
  %s1 = load double, ptr %us.at
  %s2 = load double, ptr %ls.at
  %p = fadd double %p1, %p2
  %s = fadd double %s1, %s2
  %p1.size = call double @llvm.fabs.f64(double %p1)
  %p2.size = call double @llvm.fabs.f64(double %p2)
  %size = fadd double %p1.size, %p2.size
  %rounding = fmul double %size, {-ROUNDING:e}
  %inside = fcmp oge double %room, %rounding
  br i1 %inside, label %found, label %outside
outside:
  %rise = fmul double %s, %way
  %falls = fcmp olt double %rise, 0.0
  br i1 %falls, label %newton, label %none
newton:
  %negative = fneg double %p
  %root = fdiv double %negative, %s
  %moved = fsub double %x, %root
  %moved.way = fmul double %moved, %way
  %goes.on = fcmp ogt double %moved.way, 0.0
  br i1 %goes.on, label %step, label %found
found:
  ret double %x
none:
  ret double -1.0
}}"""

_BACKWARD = f"""  %cap.k = load double, ptr %cap.at
  %top = call double @end({_CELL}, double %cap.k, double 1.0)
  %high.k = getelementptr double, ptr %high, i64 %k
  store double %top, ptr %high.k
  %some = fcmp oge double %top, 0.0
  br i1 %some, label %bottom, label %done
bottom:
  %low.x = call double @end({_CELL}, double 0.0, double -1.0)
  %low.k = getelementptr double, ptr %low, i64 %k
  %low.top = call double @llvm.minnum.f64(double %low.x, double %top)
  %low.set = call double @llvm.maxnum.f64(double %low.top, double 0.0)
  store double %low.set, ptr %low.k
  br label %next"""

# u is the greatest; where rounding leaves no room, that by the flatter of both lines, which rounding moves less.
_FORWARD = f"""  %room = call double @room({_CELL}, double %here, ptr %upper.line, ptr %lower.line)
  %us.at = getelementptr double, ptr %upper.line, i64 1
  %ls.at = getelementptr double, ptr %lower.line, i64 1
  %p1 = load double, ptr %upper.line
  %p2 = load double, ptr %lower.line
  %s1 = load double, ptr %us.at
  %s2 = load double, ptr %ls.at
  %s1.x = fmul double %s1, %here
  %s2.x = fmul double %s2, %here
  %most = fadd double %p1, %s1.x
  %least.negative = fadd double %p2, %s2.x
  %least = fneg double %least.negative
  %s1.size = call double @llvm.fabs.f64(double %s1)
  %s2.size = call double @llvm.fabs.f64(double %s2)
  %none = fcmp olt double %room, 0.0
  %steeper = fcmp ogt double %s1.size, %s2.size
  %by.least = and i1 %none, %steeper
  %u = select i1 %by.least, double %least, double %most
  %gain = fmul double %step, %u
  %reached = fadd double %here, %gain
  %below = call double @llvm.minnum.f64(double %reached, double %hi)
  %there = call double @llvm.maxnum.f64(double %below, double %lo)
  store double %there, ptr %x.next
  br label %next"""


def _pass(name: str, body: str) -> str:
    """A loop over the cells, backward from the last or forward from the first, until `done`."""
    backward = name == "backward"
    arrays = ", ".join(f"ptr %{each}" for each in _ARRAYS)
    kinds = zip(("up", "us", "lp", "ls"), _ARRAYS, strict=False)
    rows = "\n".join(f"  %{short} = getelementptr double, ptr %{long}, i64 %row" for short, long in kinds)
    return f"""define void @{name}(i64 %cells, i64 %rows, double %sign, {arrays}) nounwind {{
entry:
  %upper.line = alloca [2 x double]
  %lower.line = alloca [2 x double]
  br label %cell
cell:
  %count = phi i64 [ 0, %entry ], [ %count.next, %next ]
  %count.next = add i64 %count, 1
  %k = {"sub i64 %cells, %count.next" if backward else "add i64 %count, 0"}
  %after = add i64 %k, 1
  %row = mul i64 %k, %rows
{rows}
  %step.at = getelementptr double, ptr %steps, i64 %k
  %length = load double, ptr %step.at
  %step = fmul double %length, 2.0
  %inverse = fdiv double 1.0, %step
  %lo.at = getelementptr double, ptr %low, i64 %after
  %hi.at = getelementptr double, ptr %high, i64 %after
  %lo = load double, ptr %lo.at
  %hi = load double, ptr %hi.at
  %cap.at = getelementptr double, ptr %cap, i64 %k
  %x.at = getelementptr double, ptr %x, i64 %k
  %x.next = getelementptr double, ptr %x, i64 %after
  %here = load double, ptr %x.at
{body}
next:
  %more = icmp ult i64 %count.next, %cells
  br i1 %more, label %cell, label %done
done:
  ret void
}}"""
