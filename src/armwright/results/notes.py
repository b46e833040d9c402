"""What a user should know about a run: limits that clipped, and limits that were passed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armwright.model import Body, Model
from armwright.model.joint_signals import command_unit

ROUNDING = 1e-9  # of the largest command of a run: less is no clipping
UNREAL = 1e12  # [rad | m, or a second]: sines of such angles are rounding


def limit_notes(
    arm: Model, q: np.ndarray, qd: np.ndarray, u: np.ndarray, outputs: Mapping[str, np.ndarray], t: np.ndarray
) -> list[str]:
    """A line for every limit that a joint or its drive came to.

    Args:
        arm: the model.   q, qd, u: (lanes, rows, n), commands in force.   outputs: of the plant, the same; none: only motion is
            looked at.   t: (rows,) [s].
    """
    notes, coupled = [], any(body.drive.coupling for body in arm.coordinates)
    for j, body in enumerate(arm.coordinates):
        lost = (np.abs(q[..., j]) > UNREAL) | (np.abs(qd[..., j]) > UNREAL)
        if lost.any():
            notes.append(
                f"{body.joint}: beyond {UNREAL:g} at t = {_first(t, lost):g} s; from there on these numbers mean nothing"
            )
        command = body.drive.command
        if outputs and _is_told(body, coupled):
            asked, applied = u[..., j], outputs["tau" if command == "torque" else command][..., j]
            finite = np.isfinite(asked) & np.isfinite(applied)  # lanes that diverged may command anything
            asked, applied = np.where(finite, asked, 0.0), np.where(finite, applied, 0.0)
            clipped = np.abs(applied - asked) > ROUNDING * max(np.abs(asked).max(), np.abs(applied).max())
            if clipped.any():
                unit = command_unit(command, body.kind == "prismatic")
                notes.append(
                    f"{body.joint}: the drive's limits clipped its {command} in {clipped.mean():.0%} of the rows, "
                    f"first at t = {_first(t, clipped):g} s (asked for up to {np.abs(asked[clipped]).max():.4g} {unit})"
                )
        low, high = body.limits.position
        outside = (q[..., j] < low) | (q[..., j] > high)
        if outside.any():
            end = "; nothing stops it there" if body.stops is None else ", into its stop"
            notes.append(
                f"{body.joint}: passed its position limits [{low:.4g}, {high:.4g}] at t = {_first(t, outside):g} s{end}"
            )
        fast = np.abs(qd[..., j]) > body.limits.velocity
        if fast.any():
            notes.append(
                f"{body.joint}: passed its velocity limit {body.limits.velocity:.4g} at t = {_first(t, fast):g} s"
            )
    return notes


def _is_told(body: Body, coupled: bool) -> bool:
    """Whether a drive that does less than asked can only have come to a limit, and not to its winding's lag, heat or coupling."""
    drive = body.drive
    if drive.command == "voltage":
        return True
    return drive.inductance is None and drive.thermal is None and not (coupled and drive.command == "torque")


def _first(t: np.ndarray, happened: np.ndarray) -> float:
    """The first time at which something happened in any lane."""
    return float(t[np.nonzero(happened.any(axis=0))[0][0]])
