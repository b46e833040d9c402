"""The same kernels of `puma560` in other forms: fewer lanes, with friction, with springs, with gears that lose power, in single
precision, with parameters left open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from arms import GEARS, random_states, sprung_arms, timed_arm
from peers.pinocchio_peer import PinocchioLoop
from records import Record, Task, record
from rows_kernels import BATCH, QUICK_BATCH, WORKS, batch, checked, compiled, looped, pinocchio, pinocchio_loop
from timing import Check, Contestant, Entry, race, relative_error

import armwright as aw
from armwright.actuators.friction import joint_friction
from armwright.errors import ModelError

ROBOT = "puma560"
NARROW = "x86-64-v3"
VARIED = ("link6.mass_kg", "link6.com_m")  # what a payload changes
SINGLE_TOLERANCE = 1e-3  # of a state's largest entry: 2^-24 and what inverting the mass matrix loses


def tasks(quick: bool) -> list[Task]:
    """A race for every kernel of the table that all forms have."""
    names = [name for name, work in WORKS.items() if work.expected is not None]
    return [
        Task("variants", f"{ROBOT} {name} variants", partial(variant_records, name, quick))
        for name in (names[:1] if quick else names)
    ]


def variant_records(name: str, quick: bool, repetitions: int) -> list[Record]:
    """A row for every form, beside the usual one and Pinocchio's loop."""
    work, arm = WORKS[name], timed_arm(ROBOT)
    states = random_states(arm, QUICK_BATCH if quick else BATCH)
    inputs = [states[key] for key in work.inputs]
    truth = getattr(pinocchio(ROBOT), name)(*inputs)
    check = checked(truth)
    dyn = compiled(ROBOT)
    columns = {"usual": batch(f"W = {dyn.target.width}", getattr(dyn, name), inputs, check)}
    native = pinocchio_loop(ROBOT)
    if native is not None:
        columns["pinocchio_loop"] = looped(native, name, inputs, truth, check)
    forms: list[tuple[str, Contestant]] = [
        *narrow(name, inputs, check),
        *rough(name, states),
        *sprung(name, states),
        *geared(name, states),
        *single(name, inputs, truth),
        *varied(name, inputs, check),
    ]
    entries = []
    for form, contestant in forms:
        beside = dict.fromkeys(columns, "variant")
        expected = {}
        if form == NARROW and native is not None and work.expected is not None and not quick:
            expected = {"pinocchio_loop": work.expected[1]}
        labels = {"arm": ROBOT, "joints": arm.n, "work": name, "form": form}
        entries.append(Entry(labels, {"variant": contestant, **columns}, beside, expected))
    return [record(row) for row in race(entries, repetitions)]


def narrow(name: str, inputs: list[np.ndarray], check: Callable[[Any], Check]) -> Iterator[tuple[str, Contestant]]:
    """For AVX2: four lanes; nothing where the processor is another, or has no more anyway."""
    try:
        dyn = compiled(ROBOT, NARROW)
    except ModelError:
        return
    if compiled(ROBOT).target.width > dyn.target.width:
        yield NARROW, batch(f"W = {dyn.target.width}", getattr(dyn, name), inputs, check)


def rough(name: str, states: dict[str, np.ndarray]) -> Iterator[tuple[str, Contestant]]:
    """With friction; the truth is Pinocchio's with f(qd) on floats added to its torques."""
    if name not in ("inverse_dynamics", "forward_dynamics"):
        return
    arm = aw.load(ROBOT).replace(efficiency=None)
    friction = np.stack([joint_friction(b.friction, states["qd"][:, i]) for i, b in enumerate(arm.bodies)], axis=1)
    wheel, dyn = pinocchio(ROBOT), aw.compile(arm)
    dyn.threads = 1
    inputs = [states[key] for key in WORKS[name].inputs]
    if name == "inverse_dynamics":
        truth = wheel.inverse_dynamics(*inputs) + friction
    else:
        truth = wheel.forward_dynamics(states["q"], states["qd"], states["tau"] - friction)
    yield "with friction (the peer without)", batch("friction", getattr(dyn, name), inputs, checked(truth))


def sprung(name: str, states: dict[str, np.ndarray]) -> Iterator[tuple[str, Contestant]]:
    """With a spring of each kind at joint 2; the truth is Pinocchio's with s(q) on floats added to its torques."""
    if name not in ("inverse_dynamics", "forward_dynamics"):
        return
    wheel, inputs = pinocchio(ROBOT), [states[key] for key in WORKS[name].inputs]
    for kind, arm in sprung_arms(ROBOT).items():
        s = np.stack([aw.spring_torques(arm, q) for q in states["q"]])
        if name == "inverse_dynamics":
            truth = wheel.inverse_dynamics(*inputs) + s
        else:
            truth = wheel.forward_dynamics(states["q"], states["qd"], states["tau"] - s)
        dyn = aw.compile(arm)
        dyn.threads = 1
        yield f"with {kind} (the peer without)", batch(kind, getattr(dyn, name), inputs, checked(truth))


def geared(name: str, states: dict[str, np.ndarray]) -> Iterator[tuple[str, Contestant]]:
    """With gears that lose power at all joints; the truth is what Pinocchio's links need, through the gears' law on floats."""
    if name not in ("inverse_dynamics", "forward_dynamics"):
        return
    arm, (q, qd, qdd) = timed_arm(ROBOT), (states[key] for key in ("q", "qd", "qdd"))
    rotors = np.array([body.drive.reflected for body in arm.bodies]) * qdd
    leaving = pinocchio(ROBOT).inverse_dynamics(q, qd, qdd) - rotors
    for kind, gear in GEARS.items():
        tau = gear.entering(leaving, qd) + rotors
        inputs, truth = ([q, qd, qdd], tau) if name == "inverse_dynamics" else ([q, qd, tau], qdd)
        dyn = aw.compile(gear.fitted(arm))
        dyn.threads = 1
        yield f"with {kind} (the peer without)", batch(kind, getattr(dyn, name), inputs, checked(truth))


def single(name: str, inputs: list[np.ndarray], truth: Any) -> Iterator[tuple[str, Contestant]]:
    """In single precision: twice as many lanes."""
    dyn = aw.compile(timed_arm(ROBOT), dtype="float32")
    dyn.threads = 1
    truths = truth if isinstance(truth, tuple) else (truth,)

    def check(result: Any) -> Check:
        parts = result if isinstance(result, tuple) else (result,)
        errors = [relative_error(p.astype(float), t, t.ndim - 1) for p, t in zip(parts, truths, strict=True)]
        return Check(float(np.max(errors)), SINGLE_TOLERANCE)

    arrays = [values.astype(np.float32) for values in inputs]
    yield "float32", batch("float32", getattr(dyn, name), arrays, check)


def varied(name: str, inputs: list[np.ndarray], check: Callable[[Any], Check]) -> Iterator[tuple[str, Contestant]]:
    """With the last link's mass and centre of mass as inputs, one of each a state."""
    dyn = aw.compile(timed_arm(ROBOT), vary=VARIED)
    dyn.threads = 1
    assert dyn.varied is not None
    parameters = np.tile(dyn.varied.nominal, (len(inputs[0]), 1))
    form = f"vary={', '.join(VARIED)}: {parameters.shape[1]} inputs more"
    yield form, batch("varied", getattr(dyn, name), [*inputs, parameters], check)


def notes(quick: bool) -> dict[str, list[str]]:
    return {
        "variants": [
            f"the usual form: float64 for this processor, W = {compiled(ROBOT).target.width} states in a vector",
            f"beside {PinocchioLoop.name}, where it is there",
            "vary: every call looks at its parameters first, so that no impossible body is computed with; it is in the time",
        ]
    }
