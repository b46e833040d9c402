"""Kernels of `puma560` through the public API, beside Pinocchio on the same arm: ns per state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from peers.pinocchio_peer import NoLoop, PinocchioArm, PinocchioLoop, Results, compiled_loop, pin, symmetric
from timing import Check, Contestant, Pair, relative_error

import armwright as aw
from armwright.actuators.friction import joint_friction
from armwright.errors import ModelError

ROBOT = "puma560"
BATCH = 4096
TOLERANCE = 1e-9  # relative to a state's largest entry
INPUTS = {
    "inverse_dynamics": ("q", "qd", "qdd"),
    "forward_dynamics": ("q", "qd", "tau"),
    "mass_matrix": ("q",),
    "inverse_dynamics_derivatives": ("q", "qd", "qdd"),
    "forward_dynamics_derivatives": ("q", "qd", "tau"),
}
EXPECTED = {  # ratios that we want: on AVX-512, on x86-64-v3, a bound single call beside one of `pin` from Python
    "inverse_dynamics": (60.0, 35.0, 1.8),
    "forward_dynamics": (70.0, 40.0, 2.5),
    "mass_matrix": (30.0, 18.0, 1.5),
    "inverse_dynamics_derivatives": (35.0, 20.0, 2.0),
    "forward_dynamics_derivatives": (20.0, 12.0, 1.5),
}
PARALLEL = {"inverse_dynamics": pin.rneaInParallel, "forward_dynamics": pin.abaInParallel}  # the wheel's own loops
SINGLE = {
    "inverse_dynamics": pin.rnea,
    "forward_dynamics": pin.aba,
    "mass_matrix": pin.crba,
    "inverse_dynamics_derivatives": pin.computeRNEADerivatives,
    "forward_dynamics_derivatives": pin.computeABADerivatives,
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
        if native is not None and kernel in PARALLEL:
            pairs.append(Pair(kernel, pairs[0].ours, parallel, note="the wheel, for reference"))
        if kernel in PARALLEL:
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
    wide, narrow, _ = EXPECTED[kernel]
    return (wide if here.target.width == 8 else narrow), narrow


def together(results: Results) -> np.ndarray:
    """Results of one kernel as one array, those of a kernel that has several side by side."""
    return np.stack(results, axis=-3) if isinstance(results, tuple) else results


def checked(truth: Results) -> Callable[[Any], Check]:
    whole = together(truth)
    axes = 2 if isinstance(truth, tuple) else whole.ndim - 1  # each of several results by its own largest entry
    return lambda result: Check(relative_error(together(result), whole, axes), TOLERANCE)


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
    out = method(*inputs)  # used again, as a program that cares for speed does; both sides' begin at a cache line
    for array in out if isinstance(out, tuple) else (out,):
        array[...] = np.nan
    return Contestant(label, lambda: method(*inputs, out=out), len(inputs[0]), check)


def in_loop(
    native: PinocchioLoop, kernel: str, inputs: list[np.ndarray], like: Results, check: Callable[[Any], Check]
) -> Contestant:
    out = tuple(map(aligned, like)) if isinstance(like, tuple) else aligned(like)
    return Contestant("Pinocchio C++", lambda: native.call(kernel, out, *inputs), len(inputs[0]), check)


def aligned(like: np.ndarray) -> np.ndarray:
    """An array of the same shape that begins at a cache line."""
    room = np.full(like.size + 8, np.nan)
    start = -room.ctypes.data // 8 % 8
    return room[start : start + like.size].reshape(like.shape)


def in_parallel(
    wheel: PinocchioArm, kernel: str, inputs: list[np.ndarray], check: Callable[[Any], Check]
) -> Contestant:
    """The wheel's own loop with one thread; for the mass matrix it has none, and Python loops."""
    if kernel not in PARALLEL:
        slow = f"pin.{SINGLE[kernel].__name__}, Python loop"
        return Contestant(slow, lambda: getattr(wheel, kernel)(*inputs), BATCH, check)
    function = PARALLEL[kernel]
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
    """One state a call, from Python on both sides; ours bound to its arrays, as a control loop would have it."""
    state = [values[0].copy() for values in inputs]
    truths = getattr(wheel, kernel)(*(values[None] for values in state))
    check = checked(tuple(part[0] for part in truths) if isinstance(truths, tuple) else truths[0])
    function, model, data = SINGLE[kernel], wheel.model, wheel.data
    bound = dyn.bind(kernel, **dict(zip(INPUTS[kernel], state, strict=True)))
    results: dict[str, Callable[[Any], Any]] = {
        "mass_matrix": symmetric,
        "inverse_dynamics_derivatives": lambda _: (data.dtau_dq, data.dtau_dv, symmetric(data.M)),
        "forward_dynamics_derivatives": lambda _: (data.ddq_dq, data.ddq_dv, symmetric(data.Minv)),
    }
    whole = results.get(kernel, lambda result: result)
    mine = Contestant("one state, bound", bound, 1, check)
    peer = Contestant(f"pin.{function.__name__}", lambda: function(model, data, *state), 1, lambda r: check(whole(r)))
    return Pair(kernel, mine, peer, EXPECTED[kernel][2], note="both from Python")
