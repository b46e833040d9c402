"""Kernels of `puma560` through the public API, beside Pinocchio on the same arm: ns per state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from peers.pinocchio_peer import NoLoop, PinocchioArm, PinocchioLoop, compiled_loop, pin
from timing import Check, Contestant, Pair, relative_error

import armwright as aw
from armwright.actuators.friction import joint_friction
from armwright.errors import ModelError

ROBOT = "puma560"
BATCH = 4096
TOLERANCE = 1e-9  # relative to a state's largest entry
INPUTS = {"inverse_dynamics": ("q", "qd", "qdd"), "forward_dynamics": ("q", "qd", "tau"), "mass_matrix": ("q",)}
EXPECTED = {  # issue 2: on AVX-512, on x86-64-v3
    "inverse_dynamics": (40.0, 25.0),
    "forward_dynamics": (40.0, 25.0),
    "mass_matrix": (28.0, 18.0),
}


def kernel_pairs(quick: bool) -> tuple[list[list[Pair]], list[str]]:
    """Races of the kernels, and what a reader of the table should know."""
    arm = aw.load(ROBOT).replace(efficiency=None)
    smooth = arm.replace(friction=None)
    states = random_states(arm, BATCH)
    wheel = PinocchioArm(smooth)
    notes = [
        f"{ROBOT}: rotor inertia on, gear loss off on both sides; friction off but where a row says so",
        f"error: of all {BATCH} states, relative to a state's largest entry, against {wheel.name} from Python "
        "(with friction: f(qd) on floats added to its torques)",
    ]
    native, reason = None, ""
    try:
        compiled_loop(build=not quick)
        native = PinocchioLoop(smooth)
    except NoLoop as why:
        reason = str(why)
    if native is not None:
        notes.append(f"peer: {native.name}, its own loop over the states")
    else:
        notes.append(f"peer: {wheel.name} from its wheel, …InParallel with one thread; no C++ loop here ({reason})")
    here = aw.compile(smooth)
    targets = {f"this processor, W = {here.target.width}": here}
    try:
        targets["x86-64-v3"] = aw.compile(smooth, target="x86-64-v3")
    except ModelError as error:
        notes.append(f"no rows for x86-64-v3: {error}")
    friction = np.stack([joint_friction(b.friction, states["qd"][:, i]) for i, b in enumerate(arm.bodies)], axis=1)
    races = []
    for kernel, names in INPUTS.items():
        inputs = [states[name] for name in names]
        truth = getattr(wheel, kernel)(*inputs)
        check = checked(truth)
        parallel = in_parallel(wheel, kernel, inputs, check)
        peer = in_loop(native, kernel, inputs, truth, check) if native is not None else parallel
        pairs = []
        for (label, dyn), expected in zip(targets.items(), expectations(kernel, here), strict=False):
            pairs.append(Pair(kernel, ours(label, dyn, kernel, inputs, check), peer, expected))
        if native is not None and kernel != "mass_matrix":
            pairs.append(Pair(kernel, pairs[0].ours, parallel, note="the wheel, for reference"))
        if kernel != "mass_matrix":
            truth = with_friction(wheel, kernel, states, friction)
            rough = ours("with friction", aw.compile(arm), kernel, inputs, checked(truth))
            pairs.append(Pair(kernel, rough, peer, note="the peer without"))
        races += [pairs, [single(here, wheel, kernel, inputs)]]
    return races, notes


def random_states(arm: aw.Model, count: int) -> dict[str, np.ndarray]:
    """Random states and torques, of the size that the arm has in motion."""
    rng = np.random.default_rng(2)
    shape = (count, arm.n)
    q, qd, qdd = (scale * rng.uniform(-1.0, 1.0, shape) for scale in (np.pi, 2.0, 5.0))
    return {"q": q, "qd": qd, "qdd": qdd, "tau": rng.uniform(-20.0, 20.0, shape)}


def expectations(kernel: str, here: aw.CompiledArm) -> tuple[float, float]:
    """Expected ratios on this processor and on x86-64-v3."""
    wide, narrow = EXPECTED[kernel]
    return (wide if here.target.width == 8 else narrow), narrow


def checked(truth: np.ndarray) -> Callable[[Any], Check]:
    return lambda result: Check(relative_error(result, truth, truth.ndim - 1), TOLERANCE)


def ours(
    label: str,
    dyn: aw.CompiledArm,
    kernel: str,
    inputs: list[np.ndarray],
    check: Callable[[Any], Check],
) -> Contestant:
    """A batch through the public API, one thread."""
    dyn.threads = 1
    method = getattr(dyn, kernel)
    out = method(
        *inputs
    )  # used again and again, as a program that cares for speed does; both sides' begin at a cache line
    out[...] = np.nan
    return Contestant(label, lambda: method(*inputs, out=out), len(out), check)


def in_loop(
    native: PinocchioLoop, kernel: str, inputs: list[np.ndarray], like: np.ndarray, check: Callable[[Any], Check]
) -> Contestant:
    room = np.full(like.size + 8, np.nan)
    start = -room.ctypes.data // 8 % 8
    out = room[start : start + like.size].reshape(like.shape)
    return Contestant("Pinocchio C++", lambda: native.call(kernel, out, *inputs), len(out), check)


def in_parallel(
    wheel: PinocchioArm, kernel: str, inputs: list[np.ndarray], check: Callable[[Any], Check]
) -> Contestant:
    """The wheel's own loop with one thread; for the mass matrix it has none, and Python loops."""
    if kernel == "mass_matrix":
        return Contestant("pin.crba, Python loop", lambda: wheel.mass_matrix(*inputs), BATCH, check)
    function = pin.rneaInParallel if kernel == "inverse_dynamics" else pin.abaInParallel
    columns = [np.asfortranarray(values.T) for values in inputs]
    out = np.full(columns[0].shape, np.nan, order="F")

    def run() -> np.ndarray:
        function(1, wheel.pool, *columns, out)
        return out.T

    return Contestant(f"pin.{function.__name__}", run, BATCH, check)


def with_friction(wheel: PinocchioArm, kernel: str, states: dict[str, np.ndarray], friction: np.ndarray) -> np.ndarray:
    """Pinocchio's results with our friction f(qd), evaluated on floats, added to or taken from its torques."""
    q, qd = states["q"], states["qd"]
    if kernel == "inverse_dynamics":
        return wheel.inverse_dynamics(q, qd, states["qdd"]) + friction
    return wheel.forward_dynamics(q, qd, states["tau"] - friction)


def single(dyn: aw.CompiledArm, wheel: PinocchioArm, kernel: str, inputs: list[np.ndarray]) -> Pair:
    """One state a call, from Python on both sides."""
    state = [values[0].copy() for values in inputs]
    truth = getattr(wheel, kernel)(*(values[None] for values in state))[0]
    check, out, method = checked(truth), np.full_like(truth, np.nan), getattr(dyn, kernel)
    function = {"inverse_dynamics": pin.rnea, "forward_dynamics": pin.aba, "mass_matrix": pin.crba}[kernel]
    model, data = wheel.model, wheel.data

    def symmetric(result: np.ndarray) -> Check:
        return check(result if kernel != "mass_matrix" else np.triu(result) + np.triu(result, 1).T)

    mine = Contestant("one state a call", lambda: method(*state, out=out), 1, check)
    peer = Contestant(f"pin.{function.__name__}, one call", lambda: function(model, data, *state), 1, symmetric)
    return Pair(kernel, mine, peer, note="both from Python")
