"""Where the arm should be, tick by tick: from a pose, a schedule of poses, or a function of time."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.program import interpret, trace
from armwright.scalar import Array, Scalar
from armwright.simulation.acting.inputs import by_name
from armwright.simulation.acting.schedule import Schedule
from armwright.simulation.sampling.protocols import UNTRACEABLE, called, why

FAR = 1e-9  # [rad | m] past a limit that is no rounding


def reference_rows(arm: Model, reference: Any, t: np.ndarray, notes: list[str] | None = None) -> np.ndarray:
    """The reference at times t (k,) [s]: (k, 3n) positions, speeds and accelerations.

    Args:
        arm: the model.
        reference: a pose (n,); rows (k, n) or (k, 3n), one for each time; a Schedule of poses, held from row to row; or a
            function of time that gives q, or (q, q̇, q̈), each (n,). One that gives q alone and is written with
            `armwright.scalar` is differentiated exactly; one that cannot be traced has speeds and accelerations of 0.
        t: times of the ticks [s].   notes: takes a line of what a user should know of how it was read.
    Raises:
        ScenarioError: names what was given and what was expected.
    """
    n, rows = arm.n, np.zeros((len(t), 3 * arm.n))
    if isinstance(reference, Schedule):
        held = np.searchsorted(reference.times, t * (1.0 + 1e-12), side="right") - 1
        rows[:, :n] = by_name("reference", reference, arm.names).commands[np.maximum(held, 0)]
    elif callable(reference):
        rows = _of_function(arm, reference, t, [] if notes is None else notes)
    else:
        try:
            given = np.asarray(reference, dtype=float)
        except (TypeError, ValueError):
            given = np.full(0, np.nan)
        if given.shape == (n,):
            rows[:, :n] = given
        elif given.shape in ((len(t), n), (len(t), 3 * n)):
            rows[:, : given.size // len(t)] = given
        else:
            raise ScenarioError(
                f"reference of shape {given.shape}: expected a pose ({n},), rows ({len(t)}, {n}) or ({len(t)}, {3 * n}), "
                "a Schedule, or a function of time"
            )
    if not np.isfinite(rows).all():
        k, column = np.argwhere(~np.isfinite(rows))[0]
        raise ScenarioError(
            f"reference: {arm.names[column % n]} is {rows[k, column]} at t = {t[k]:g} s; expected numbers"
        )
    return rows


def _of_function(arm: Model, function: Callable[[Any], Any], t: np.ndarray, notes: list[str]) -> np.ndarray:
    """Traced and differentiated where it can be; else called time by time."""
    n = arm.n
    _check_arguments(function)
    try:
        program = trace("reference", lambda time: _moving(arm, function, time[0]), {"t": (1,)}, ("r",))
        return np.asarray(interpret(program, t.reshape(-1, 1))).reshape(len(t), 3 * n)
    except UNTRACEABLE as error:
        if isinstance(error, ScenarioError):
            raise
        reason = why(error)
    rows, alone = np.zeros((len(t), 3 * n)), False
    for k, time in enumerate(t):
        value = function(float(time))
        told = _parts(arm, value)
        alone |= told is None
        rows[k] = np.concatenate([_pose(arm, value), np.zeros(2 * n)] if told is None else told)
    speeds = (
        "its speeds and accelerations are taken as 0" if alone else "with the speeds and accelerations that it gave"
    )
    more = "; written with armwright.scalar it is differentiated, or let it give (q, qd, qdd)" if alone else ""
    notes.append(f"reference {called(function)!r} cannot be traced ({reason}): called tick by tick, {speeds}{more}")
    return rows


def _check_arguments(function: Callable[[Any], Any]) -> None:
    """Refuses a function of other things than time.

    Raises:
        ScenarioError: names it, and what it takes.
    """
    try:
        taken = inspect.signature(function)
    except ValueError:  # a built-in function that does not tell
        return
    try:
        taken.bind("t")
    except TypeError:
        raise ScenarioError(f"reference {called(function)!r}: takes {taken}, expected (t)") from None


def _moving(arm: Model, function: Callable[[Any], Any], t: Scalar) -> np.ndarray:
    parts = _parts(arm, function(t))
    if parts is None:

        def position(x: Array) -> np.ndarray:
            return _pose(arm, function(x[0]))

        def speed(x: Array) -> np.ndarray:
            return scalar.jacobian(position, x)[:, 0]

        at = scalar.array([t])
        parts = position(at), speed(at), scalar.jacobian(speed, at)[:, 0]
    return scalar.array(np.concatenate(parts))


def _parts(arm: Model, value: Any) -> tuple[np.ndarray, ...] | None:
    """(q, q̇, q̈) where three arrays were given."""
    if isinstance(value, tuple) and len(value) == 3 and all(np.shape(part) == (arm.n,) for part in value):
        return tuple(scalar.array(part) for part in value)
    return None


def _pose(arm: Model, value: Any) -> np.ndarray:
    if np.shape(value) != (arm.n,):
        raise ScenarioError(
            f"reference: the function gave shape {np.shape(value)}; expected q ({arm.n},) or (q, qd, qdd)"
        )
    return scalar.array(value)


def reference_notes(arm: Model, rows: np.ndarray, t: np.ndarray) -> list[str]:
    """Warnings: a reference outside the joints' limits, or one that jumps."""
    n, notes = arm.n, []
    for j, body in enumerate(arm.coordinates):
        q, (low, high) = rows[:, j], body.limits.position
        outside = (q < low - FAR) | (q > high + FAR)
        if outside.any():
            notes.append(
                f"{body.joint}: the reference leaves its position limits [{low:.4g}, {high:.4g}] at t = {t[outside][0]:g} s"
            )
        fast = np.abs(rows[:, n + j]) > body.limits.velocity
        if fast.any():
            notes.append(
                f"{body.joint}: the reference is faster than its velocity limit {body.limits.velocity:.4g} "
                f"at t = {t[fast][0]:g} s"
            )
        if len(t) > 1:
            moved, explained = np.abs(np.diff(q)), np.abs(rows[1:, n + j]) + np.abs(rows[:-1, n + j])
            jumps = moved > 1e-6 + 2.0 * explained * np.diff(t)
            if jumps.any():
                k = int(np.argmax(jumps))
                notes.append(f"{body.joint}: the reference jumps by {moved[k]:.4g} at t = {t[k + 1]:g} s")
    return notes
