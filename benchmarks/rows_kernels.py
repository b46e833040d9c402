"""Kernels through the public API beside Pinocchio and MuJoCo on the same arms: ns per state."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from arms import joint_count, random_states, timed_arm
from peak import operations, peak
from peers.mujoco_peer import MuJoCoLoop, compiled_loop as mujoco_loop
from peers.native import NoLoop, Results, aligned
from peers.pinocchio_peer import PinocchioArm, PinocchioLoop, compiled_loop, pin, symmetric
from records import Record, Task, record
from timing import Check, Contestant, Entry, race, relative_error

import armwright as aw

ARMS = ("puma560", "lwa4p", "panda", "chain-6", "chain-12", "chain-20", "chain-30", "chain-60", "chain-100")
QUICK_ARMS = ("puma560", "chain-2", "chain-4")
BATCH, QUICK_BATCH = 4096, 256
FEW = (
    512  # states that the peers get of arms longer than LONG: their time a state does not depend on how many there are
)
LONG = 12  # joints
TOLERANCE = 1e-9  # relative to a state's largest entry
WANTED = {"inverse_dynamics": 0.5}  # of the machine's limit


@dataclass(frozen=True)
class Work:
    """Work of a kernel, and who does it.

    Args:
        inputs: names of the states' arrays.   single: Pinocchio's function, from Python.
        mujoco: whether MuJoCo has it.   longest: number of joints of the arms it is timed on.
        expected: least ratios wanted on `puma560`: a batch on AVX-512, on AVX2, a bound single call.
    """

    inputs: tuple[str, ...]
    single: Callable[..., Any]
    mujoco: bool = False
    longest: int = 1000
    expected: tuple[float, float, float] | None = None


FORWARD = ("q", "qd", "tau")
WORKS = {
    "inverse_dynamics": Work(("q", "qd", "qdd"), pin.rnea, True, expected=(60.0, 35.0, 1.8)),
    "mass_matrix": Work(("q",), pin.crba, True, expected=(30.0, 18.0, 1.5)),
    "forward_dynamics": Work(FORWARD, pin.aba, True, expected=(70.0, 40.0, 2.5)),
    "inverse_dynamics_derivatives": Work(
        ("q", "qd", "qdd"),
        pin.computeRNEADerivatives,
        longest=30,
        expected=(35.0, 20.0, 2.0),
    ),
    "forward_dynamics_derivatives": Work(FORWARD, pin.computeABADerivatives, longest=20, expected=(20.0, 12.0, 1.5)),
}


def tasks(quick: bool) -> list[Task]:
    """A race for every arm and kernel."""
    return [
        Task("kernels", f"{arm} {name}", partial(kernel_records, arm, name, quick))
        for arm in (QUICK_ARMS if quick else ARMS)
        for name, work in WORKS.items()
        if joint_count(arm) <= work.longest
    ]


def kernel_records(arm: str, name: str, quick: bool, repetitions: int) -> list[Record]:
    """One row: a batch, a single call bound and plain, the peers, and the machine's limit, in one race."""
    work, model = WORKS[name], timed_arm(arm)
    dyn = compiled(arm)
    kernel, method = dyn.kernel(name), getattr(dyn, name)
    states = random_states(model, QUICK_BATCH if quick else BATCH)
    inputs = [states[key] for key in work.inputs]
    few = len(inputs[0]) if model.n <= LONG else min(FEW, len(inputs[0]))
    wheel = pinocchio(arm)
    truth = getattr(wheel, name)(*(values[:few] for values in inputs))
    check = checked(truth)
    state = [values[0].copy() for values in inputs]
    contestants = {
        "batch": batch("a batch", method, inputs, check),
        "bound": Contestant(
            "one state, bound", dyn.bind(name, **dict(zip(work.inputs, state, strict=True))), 1, first(check)
        ),
        "plain": Contestant("one state", lambda: method(*state), 1, first(check)),
        "pinocchio_python": pinocchio_single(wheel, name, state, check),
        "peak": peak(dyn.target),
    }
    for column, loop in (("pinocchio_loop", pinocchio_loop(arm)), ("mujoco", mujoco_arm(arm) if work.mujoco else None)):
        if loop is not None:
            contestants[column] = looped(loop, name, [values[:few] for values in inputs], truth, check)
    beside = {"pinocchio_loop": "batch", "pinocchio_python": "bound", "mujoco": "batch"}
    expected: dict[str, float] = {}
    if arm == "puma560" and work.expected is not None and not quick:
        wide, narrow, single = work.expected
        expected = {"pinocchio_loop": wide if dyn.target.width == 8 else narrow, "pinocchio_python": single}
    wanted = {"wanted": WANTED[name]} if name in WANTED and not quick else {}
    entry = Entry(
        {"arm": arm, "joints": model.n, "work": name, "states": len(inputs[0])},
        contestants,
        {column: ours for column, ours in beside.items() if column in contestants},
        expected,
        operations(kernel.program, kernel.target.width) | wanted,
    )
    return [record(row) for row in race([entry], repetitions)]


@functools.cache
def compiled(arm: str, target: str | None = None) -> aw.CompiledArm:
    """An arm's kernels, one thread."""
    dyn = aw.compile(timed_arm(arm), target=target)
    dyn.threads = 1
    return dyn


def batch(name: str, run: Callable[..., Any], inputs: list[np.ndarray], check: Callable[[Any], Check]) -> Contestant:
    """A batch into arrays that are used again, as a program that cares for speed does; they begin at a cache line."""
    out = run(*inputs)
    for array in out if isinstance(out, tuple) else (out,):
        array[...] = np.nan
    return Contestant(name, lambda: run(*inputs, out=out), len(inputs[0]), check)


def looped(loop: Any, name: str, inputs: list[np.ndarray], like: Results, check: Callable[[Any], Check]) -> Contestant:
    """A peer's loop over states in its own language."""
    out = tuple(map(aligned, like)) if isinstance(like, tuple) else aligned(like)
    return Contestant(loop.name, lambda: loop.call(name, out, *inputs), len(inputs[0]), check)


def pinocchio_single(
    wheel: PinocchioArm, name: str, state: list[np.ndarray], check: Callable[[Any], Check]
) -> Contestant:
    """One state a call, from Python."""
    function, model, data = WORKS[name].single, wheel.model, wheel.data
    results: dict[str, Callable[[Any], Any]] = {
        "mass_matrix": symmetric,
        "inverse_dynamics_derivatives": lambda _: (data.dtau_dq, data.dtau_dv, symmetric(data.M)),
        "forward_dynamics_derivatives": lambda _: (data.ddq_dq, data.ddq_dv, symmetric(data.Minv)),
    }
    whole = results.get(name, lambda result: result)
    one = first(check)
    return Contestant(
        f"pin.{function.__name__}", lambda: function(model, data, *state), 1, lambda result: one(whole(result))
    )


def checked(truth: Results) -> Callable[[Any], Check]:
    """Compares with the truth of the first states, as many as the result has; all of the result must be finite."""
    truths = truth if isinstance(truth, tuple) else (truth,)

    def check(result: Any) -> Check:
        parts = result if isinstance(result, tuple) else (result,)
        errors = []
        for part, true in zip(parts, truths, strict=True):
            count = min(len(part), len(true))
            finite = bool(np.isfinite(part).all())
            errors.append(relative_error(part[:count], true[:count], true.ndim - 1) if finite else np.nan)
        return Check(float(np.max(errors)), TOLERANCE)

    return check


def first(check: Callable[[Any], Check]) -> Callable[[Any], Check]:
    """The check of a result for the first state alone."""
    return lambda result: check(
        tuple(p[None] for p in result) if isinstance(result, tuple) else np.asarray(result)[None]
    )


@functools.cache
def pinocchio(arm: str) -> PinocchioArm:
    return PinocchioArm(timed_arm(arm))


@functools.cache
def pinocchio_loop(arm: str) -> PinocchioLoop | None:
    """None where the loop is not there; `prepare` says why."""
    try:
        return PinocchioLoop(timed_arm(arm))
    except NoLoop:
        return None


@functools.cache
def mujoco_arm(arm: str) -> MuJoCoLoop | None:
    try:
        return MuJoCoLoop(timed_arm(arm))
    except NoLoop:
        return None


def notes(quick: bool) -> dict[str, list[str]]:
    """Notes of a chapter for its reader; compiles the peers' loops first, where it may."""
    lines = [
        f"a batch: {QUICK_BATCH if quick else BATCH} states, one thread, into arrays that are used again; rotor inertia on, "
        "friction and gear loss off on both sides",
        f"error: of all states (of arms longer than {LONG} joints the first {FEW}, the rest finite), relative to a state's "
        f"largest entry, against {PinocchioArm.name} from Python; no time without a passed check",
    ]
    for peer, loop in (("Pinocchio C++", compiled_loop), ("MuJoCo", mujoco_loop)):
        try:
            loop(build=not quick)
        except NoLoop as why:
            lines.append(f"no loop of {peer} here: {why}")
    lines += [
        f"Pinocchio C++: {PinocchioLoop.name}, its own loop over the states; from Python: one state a call, beside ours bound",
        f"MuJoCo: {MuJoCoLoop.name} that an arm without contacts needs (kinematics, comPos, crb, factorM, comVel, rne, solveM)",
        "forward dynamics, ours: by composite bodies in a chain of up to 9 joints, by articulated ones beyond; Pinocchio's: "
        "articulated; MuJoCo's: composite",
        "derivatives, ours: automatic in a chain of up to 9 joints, analytic beyond; mass matrix, ours: in links' frames in a "
        "chain of up to 23 joints, in one frame beyond",
        "of the machine's limit: operations a state ÷ (vector lanes × FMA ports × clock); an addition, a product and a fused "
        "product are one operation each, counted in the LLVM text that is compiled, sines and cosines written out; the limit "
        "is a loop of nothing but fused products in the same race, at its best, against ours at the median; as flops: a fused "
        "product is two. Loads, stores, transposes, divisions, roots, comparisons and selections are in neither",
    ]
    return {"kernels": lines}
