"""References: where the arm should be, from a pose, a schedule of poses, or a trajectory, for all lanes or each its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, ShapeError
from armwright.interfaces import UNTRACEABLE, JointReference, called, why
from armwright.kernels.stages import Call, RowsStage, Stage, TableStage
from armwright.model import Model
from armwright.model.joint_signals import motion_layout
from armwright.parameters import Batch, LaneFields
from armwright.program import Program, interpret, trace
from armwright.scalar import Array, Scalar
from armwright.signals import Layout
from armwright.simulation.checks import check_arguments
from armwright.simulation.inputs.input_schedule import InputSchedule, in_order, input_schedule, values_at_ticks
from armwright.simulation.inputs.schedule import Schedule

FAR = 1e-9  # [rad | m] past a limit that is no rounding
AWAY = 1e-3  # [rad | m] between the arm and the beginning of a reference: no rounding of a pose in a file
PARAMETERS = "c_reference"  # block of a trajectory's own values in each lane


@dataclass(frozen=True, eq=False)
class LoopReference:
    """The reference of a loop, in block "r".

    Attributes:
        layout: of r.   table: (ticks + 1, size), where all lanes share it.   rows: of each lane.
        program: (tick, parameters) → r, of a trajectory with batches.   values: (lanes, k) of its parameters.
        final: (lanes or 1, n) positions at the end; None of a reference without q.   notes: for the user.
    """

    layout: Layout
    table: np.ndarray | None = None
    rows: InputSchedule | None = None
    program: Program | None = None
    values: np.ndarray | None = None
    final: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, arm: Model, reference: Any, start: np.ndarray, ticks: range, period: float) -> LoopReference:
        """The reference of a run.

        Args:
            arm: the model.   reference: as `Scenario.reference`; None: the initial position.
            start: (lanes or 1, n) initial positions.   ticks: of the run.   period: [s] of a tick.
        Raises:
            ScenarioError: what is no reference of this arm; names what was expected.
        """
        n, layout, last = arm.n, reference_layout(arm, reference), np.array([float(ticks[-1])])
        if reference is None:
            same = bool((start == start[0]).all())
            reference = start[0] if same else Batch(start)
        if isinstance(reference, Batch):
            rows = _lane_rows(arm, reference)
            final = values_at_ticks(rows, last, period)[:, 0, :n]
            return cls(layout, rows=rows, final=final)
        lanes = LaneFields.of(reference, "reference")
        if not lanes.names:
            notes: list[str] = []
            try:
                times = np.arange(ticks.start, ticks.stop) * period
                table = np.ascontiguousarray(reference_rows(arm, reference, times, notes))
            except MemoryError:
                size = f"{len(ticks) - 1} ticks of {period:g} s take {8e-9 * layout.size * len(ticks):.3g} GB"
                what = f"{size}, more than there is memory for"
                raise ScenarioError(what, place="reference", expected="a shorter run") from None
            if "qdd" in layout:
                notes += reference_notes(arm, table, times)
            return cls(layout, table, final=layout.part(table[-1:], "q") if "q" in layout else None, notes=tuple(notes))
        shapes = {"tick": (1,), PARAMETERS: lanes.values.shape[1:]}
        try:
            program = trace(
                "reference",
                lambda tick, c: _values(arm, layout, lanes.with_values(c), tick[0] * period),
                shapes,
                ("r",),
            )
        except UNTRACEABLE as error:
            if isinstance(error, ScenarioError):
                raise
            what = f"with a Batch it must be compiled, and cannot be ({why(error)})"
            expected = "a trajectory written with armwright.scalar"
            raise ScenarioError(what, place=f"reference {called(reference)!r}", expected=expected) from None
        final = interpret(program, last, lanes.values)
        return cls(
            layout, program=program, values=lanes.values, final=layout.part(final, "q") if "q" in layout else None
        )

    def stage(self) -> Stage:
        """The stage that fills block "r"."""
        if self.program is not None:
            return Call(self.program)
        return TableStage("r", self.layout.size) if self.rows is None else RowsStage("r", self.layout.size)


def reference_layout(arm: Model, reference: Any) -> Layout:
    """Layout of a reference: of the joints' motion, or of a trajectory's own signals.

    Raises:
        ScenarioError: signals that are none.
    """
    if not hasattr(reference, "signals"):
        return motion_layout(arm)
    try:
        return Layout.of(reference.signals(arm))
    except (ShapeError, TypeError, AttributeError) as error:
        place = f"reference {called(reference)!r}"
        raise ScenarioError(f"signals: {error}", place=place, expected="aw.Signal objects") from None


def _lane_rows(arm: Model, batch: Batch) -> InputSchedule:
    """Poses, or schedules of poses, one for each lane, as rows of positions, speeds and accelerations."""
    if batch.shape is None and not all(isinstance(each, Schedule) for each in batch.values):
        expected = "a batch of poses or schedules; of a trajectory, its fields may be batches"
        raise ScenarioError(place="reference", value=batch, expected=expected)
    rows, n = input_schedule("reference", batch, arm.names), arm.n
    if isinstance(rows, np.ndarray):
        return np.pad(rows, ((0, 0), (0, 2 * n)))
    names = tuple(f"{name} {signal}" for signal in ("q", "qd", "qdd") for name in arm.names)
    assert isinstance(rows, list)
    return [Schedule(each.times, np.pad(each.commands, ((0, 0), (0, 2 * n))), names) for each in rows]


def reference_rows(arm: Model, reference: Any, t: np.ndarray, notes: list[str] | None = None) -> np.ndarray:
    """The reference at times t (k,) [s]: (k, size) rows of its layout; of the joints, positions, speeds and accelerations.

    Args:
        arm: the model.
        reference: a pose (n,); rows (k, n) or (k, 3n), one for each time; a Schedule of poses, held from row to row; or a
            trajectory, a function of time. One that has `at` as a `Motion` does is asked for all times at once.
        t: times of the ticks [s].   notes: takes notes for the user on how it was read.
    Raises:
        ScenarioError: names its shape or value, and what was expected.
    """
    n, layout = arm.n, reference_layout(arm, reference)
    rows = np.zeros((len(t), layout.size))
    if isinstance(reference, Schedule):
        row = np.searchsorted(reference.times, t * (1.0 + 1e-12), side="right") - 1
        rows[:, :n] = in_order("reference", reference, arm.names).commands[np.maximum(row, 0)]
    elif callable(reference) and hasattr(reference, "at") and "qdd" in layout:
        rows = _of_motion(arm, reference, t)
        if rows is None:
            rows = _of_function(arm, layout, reference, t, [] if notes is None else notes)
    elif callable(reference):
        rows = _of_function(arm, layout, reference, t, [] if notes is None else notes)
    else:
        poses = f"a pose ({n},), rows ({len(t)}, {n}) or ({len(t)}, {3 * n}), a Schedule"
        try:
            values = scalar.real_numbers(reference)
        except ValueError:
            what, place = "neither numbers nor a function of time", f"reference {called(reference)!r}"
            if isinstance(reference, (list, tuple, np.ndarray)):
                what, place = "not numbers alone, or rows of unequal length", "reference"
            elif hasattr(reference, "at"):
                what = "has `at` and no `__call__`"
            expected = (
                f"{poses}, or a trajectory: called with t [s] it gives q or (q, qd, qdd); `at` may stand beside that"
            )
            raise ScenarioError(what, place=place, expected=expected) from None
        if values.shape == (n,):
            rows[:, :n] = values
        elif values.shape in ((len(t), n), (len(t), 3 * n)):
            rows[:, : values.size // len(t)] = values
        else:
            expected = f"{poses}, or a function of time"
            raise ScenarioError(f"shape {values.shape}", place="reference", expected=expected)
    if not np.isfinite(rows).all():
        k, column = np.argwhere(~np.isfinite(rows))[0]
        where = arm.names[column % n] if "qdd" in layout else f"entry {column}"
        place = f"reference of {where} at t = {t[k]:g} s"
        raise ScenarioError(place=place, value=float(rows[k, column]), expected="finite numbers")
    return rows


def _of_motion(arm: Model, motion: Any, t: np.ndarray) -> np.ndarray | None:
    """Rows of a motion that gives all times at once, so that one of thousands of pieces costs no more than a short one.

    None if its `at` gives positions alone, whose derivatives its `__call__` has.
    """
    parts = motion.at(t)
    if not isinstance(parts, tuple) and np.shape(parts) == (len(t), arm.n):
        return None
    if len(parts) != 3 or any(np.shape(part) != (len(t), arm.n) for part in parts):
        what = f"`at` gave shapes {[np.shape(part) for part in parts]}"
        expected = f"q, or q, qd, qdd, each (times, {arm.n})"
        raise ScenarioError(what, place=f"reference {called(motion)!r}", expected=expected)
    return np.concatenate([np.asarray(part, dtype=float) for part in parts], axis=1)


def _of_function(
    arm: Model, layout: Layout, function: Callable[[Any], Any], t: np.ndarray, notes: list[str]
) -> np.ndarray:
    """Rows of a trajectory: traced and differentiated where it can be; else called time by time."""
    check_arguments(function, ("t",), f"reference {called(function)!r}")
    try:
        program = trace("reference", lambda time: _values(arm, layout, function, time[0]), {"t": (1,)}, ("r",))
        return np.asarray(interpret(program, t.reshape(-1, 1))).reshape(len(t), layout.size)
    except UNTRACEABLE as error:
        if isinstance(error, ScenarioError):
            raise
        reason = why(error)
    rows, only_positions, n = np.zeros((len(t), layout.size)), False, arm.n
    for k, time in enumerate(t):
        value = function(float(time))
        motion = _motion(arm, layout, value)
        only_positions |= motion is None
        rows[k] = np.concatenate([_pose(arm, value), np.zeros(2 * n)]) if motion is None else motion
    speeds = "with the speeds and accelerations that it gave"
    if only_positions:
        speeds = (
            "its speeds and accelerations are taken as 0; written with armwright.scalar it is differentiated, "
            "or let it give (q, qd, qdd)"
        )
    notes.append(f"reference {called(function)!r} cannot be traced ({reason}): called tick by tick, {speeds}")
    return rows


def _values(arm: Model, layout: Layout, function: Callable[[Any], Any], t: Scalar) -> np.ndarray:
    """r (size,) of a trajectory at a time; positions alone are differentiated."""
    motion = _motion(arm, layout, function(t))
    if motion is not None:
        return motion

    def position(x: Array) -> np.ndarray:
        return _pose(arm, function(x[0]))

    def speed(x: Array) -> np.ndarray:
        return scalar.jacobian(position, x)[:, 0]

    at = scalar.array([t])
    return scalar.array(np.concatenate([position(at), speed(at), scalar.jacobian(speed, at)[:, 0]]))


def _motion(arm: Model, layout: Layout, value: Any) -> np.ndarray | None:
    """r (size,) from the value of a trajectory; None where it gave positions alone."""
    if isinstance(value, JointReference):
        value = (value.q, value.qd, value.qdd)
    if isinstance(value, Mapping):
        try:
            return layout.vector(value)
        except ShapeError as error:
            raise ScenarioError(str(error), place="reference") from None
    if isinstance(value, tuple) and len(value) == 3 and all(np.shape(part) == (arm.n,) for part in value):
        return scalar.array(np.concatenate([scalar.array(part) for part in value]))
    return None


def _pose(arm: Model, value: Any) -> np.ndarray:
    if np.shape(value) != (arm.n,):
        what, expected = f"the function gave shape {np.shape(value)}", f"q ({arm.n},) or (q, qd, qdd)"
        raise ScenarioError(what, place="reference", expected=expected)
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


def start_notes(arm: Model, reference: LoopReference | None) -> list[str]:
    """A note where a motion begins at rest away from 0, where an arm starts whose initial positions nobody stated."""
    if reference is None or reference.table is None or "q" not in reference.layout:
        return []
    rows = reference.table[:, : arm.n]
    if len(rows) < 2 or np.ptp(rows, axis=0).max() < FAR:  # a pose is a step that was asked for
        return []
    if np.abs(rows[0]).max() < AWAY or np.abs(rows[1] - rows[0]).max() > AWAY:
        return []
    k = int(np.abs(rows[0]).argmax())
    pose = ", ".join(f"{value + 0.0:.4g}" for value in rows[0].round(9))
    return [
        f"{arm.names[k]}: the reference begins at {rows[0, k]:.4g} and the arm at 0, since no start is stated; "
        f"start q = [{pose}] begins on the reference"
    ]
