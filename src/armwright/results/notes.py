"""Notes of a run about limits: clipped commands, and joints that exceeded a limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from armwright.actuators.dead_zone import beyond
from armwright.errors import Problem
from armwright.model import Body, Model
from armwright.model.joint_signals import command_unit

if TYPE_CHECKING:
    import xarray as xr

ROUNDING = 1e-9  # of the largest command of a run: less is no clipping
UNREAL = 1e12  # [rad | m, or a second]: sines of such angles are rounding


def limit_notes(
    arm: Model, q: np.ndarray, qd: np.ndarray, u: np.ndarray, outputs: Mapping[str, np.ndarray], t: np.ndarray
) -> list[Problem]:
    """A note for every limit reached by a joint or its drive.

    Args:
        arm: the model.   q, qd, u: (lanes, rows, n), commands in force.   outputs: of the plant, the same shape; empty: only
            the motion is checked.   t: (rows,) [s].
    """
    notes = []

    def first(happened: np.ndarray) -> str:
        """The first time at which something happened in any lane."""
        return f"t = {t[happened.any(axis=0).argmax()]:g} s"

    # most runs reach no limit: their extremes say so in one pass, without a row being looked at
    ends = [(np.fmin.reduce(each, axis=(0, 1)), np.fmax.reduce(each, axis=(0, 1))) for each in (q, qd)]
    for j, body in enumerate(arm.coordinates):
        position, speed, command = q[..., j], qd[..., j], body.drive.command
        (lowest, highest), (slowest, fastest) = ((low[j], high[j]) for low, high in ends)
        reached: list[str] = []
        if max(-lowest, highest, -slowest, fastest) > UNREAL:
            unreal = (np.abs(position) > UNREAL) | (np.abs(speed) > UNREAL)
            reached.append(f"beyond {UNREAL:g} at {first(unreal)}; from there on these numbers mean nothing")
        firmware, duty = body.drive.firmware, outputs.get("duty")
        if firmware is not None and duty is not None:
            full = np.abs(duty[..., j]) >= firmware.limit
            if full.mean() > 0.0:
                reached.append(
                    f"its loop gave all its duty, {firmware.limit:g}, in {percentage(full.mean())} of the rows, first at "
                    f"{first(full)}"
                )
        name = "tau" if command == "torque" else command
        if outputs and firmware is None and _only_limits(body) and not np.array_equal(u[..., j], outputs[name][..., j]):
            commanded, applied = u[..., j], outputs[name][..., j]
            finite = np.isfinite(commanded) & np.isfinite(applied)  # lanes that diverged may command anything
            commanded, applied = np.where(finite, commanded, 0.0), np.where(finite, applied, 0.0)
            wanted = beyond(commanded, body.drive.dead_zone)  # a dead zone is no limit
            clipped = np.abs(applied - wanted) > ROUNDING * max(np.abs(commanded).max(), np.abs(applied).max())
            if clipped.any():
                unit, share = command_unit(command, body.kind.units), percentage(clipped.mean())
                reached.append(
                    f"the drive's limits clipped its {command} in {share} of the rows, first at {first(clipped)} "
                    f"(asked for up to {np.abs(commanded[clipped]).max():.4g} {unit})"
                )
        low, high = body.limits.position
        if lowest < low or highest > high:
            outside = (position < low) | (position > high)
            end = "; the model has no end stop" if body.stops is None else ", into its stop"
            reached.append(f"passed its position limits [{low:.4g}, {high:.4g}] at {first(outside)}{end}")
        if max(-slowest, fastest) > body.limits.velocity:
            fast = np.abs(speed) > body.limits.velocity
            reached.append(f"passed its velocity limit {body.limits.velocity:.4g} at {first(fast)}")
        notes += [Problem(what, place=body.joint) for what in reached]
    return notes


def notes_of(run: xr.Dataset) -> list[str]:
    """The notes in a run's attributes."""
    return str(run.attrs.get("notes", "")).splitlines()


def limit_notes_of(arm: Model, run: xr.Dataset) -> list[str]:
    """The limit notes of a run of one lane, or of several runs that were joined to one."""
    rows = {name: run[name].values[None] for name in ("q", "qd", "u", "tau", "voltage", "current") if name in run}
    outputs = {name: rows[name] for name in ("tau", "voltage", "current") if name in rows}
    return [str(note) for note in limit_notes(arm, rows["q"], rows["qd"], rows["u"], outputs, run["time"].values)]


def _only_limits(body: Body) -> bool:
    """True if only a limit keeps this drive from its command: its winding's lag and heat do not."""
    drive = body.drive
    if drive.command == "voltage":
        return True
    return drive.inductance is None and drive.thermal is None


def percentage(share: float) -> str:
    """A share in percent: 0.28 → "28%", 0.003 → "0.3%"."""
    return f"{share:.0%}" if share >= 0.01 else f"{100 * share:.1g}%"
