"""Runs whose oscillation grows, or is clipped again and again: those whose loop may be unstable.

Looking at the rows is cheap and proves nothing: a loop that is stable may be clipped after a large step. Where a run looks like
it, the linear analysis of the loop, in a room below, says whether the loop is unstable.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import ModelError, ScenarioError
from armwright.simulation.scenario import Scenario

if TYPE_CHECKING:
    import xarray

ANALYSED_BY = "armwright.control.analysis.instability"
ROWS = 40  # fewer rows show no oscillation
WINDOWS = 8  # of a run
REVERSALS = 8  # of a joint's acceleration in the second half of a run: fewer are no oscillation
GROWN, GROWING = 2.0, 1.02  # of the swing, from the first of four windows to the last, and from one window to the next
AT_MOST, OFTEN = 1e-6, 0.02  # of the largest command: as large; share of rows in which it is
LANES = 16  # that are looked at
ROUNDING = 1e-9  # of positions and speeds


def instability_note(scenario: Scenario, run: xarray.Dataset) -> str | None:
    """A sentence on the loop of a run if it is unstable and the run shows it, else None.

    Args:
        scenario: with a loop.   run: its rows.
    """
    if scenario.controller is None or "qd" not in run or run.sizes.get("time", 0) < ROWS:
        return None
    lanes = {
        name: run[name].values[None] if "lane" not in run[name].dims else run[name].values
        for name in SEEN
        if name in run
    }
    found = suspicious({name: values[:LANES] for name, values in lanes.items()})
    if found is None:
        return None
    lane, clipped = found
    q = lanes["q"][lane]
    q = q[np.isfinite(q).all(axis=1)]
    poses = np.array([q[0], q[3 * len(q) // 4 :].mean(axis=0)])
    return unstable_loop(scenario, poses, lane, clipped)


def unstable_loop(scenario: Scenario, poses: np.ndarray, lane: int = 0, clipped: str = "") -> str | None:
    """A sentence on an unstable loop; None of one that is stable at poses (k, n), or that cannot be analysed."""
    try:
        return importlib.import_module(ANALYSED_BY).unstable_sentence(scenario, poses, lane, clipped)
    except (
        ScenarioError,
        ModelError,
        np.linalg.LinAlgError,
    ):  # called in Python, draws in its loop, servos: nothing is known
        return None


SEEN = ("q", "qd", "q_reference", "u", "voltage", "current", "tau")


def suspicious(rows: dict[str, np.ndarray]) -> tuple[int, str] | None:
    """The lane that looks most like an unstable loop, and what clips it, "" if nothing; None if none does.

    Args:
        rows: by name (lanes, rows, n): q, qd and perhaps commands and what the drives did.
    """
    qd = rows["qd"]
    with np.errstate(invalid="ignore", over="ignore"):
        change = np.diff(qd, axis=1)
        scale = ROUNDING * (
            np.abs(rows["q"]).max(axis=(1, 2), keepdims=True) + np.abs(qd).max(axis=(1, 2), keepdims=True)
        )
        bend = np.diff(change, axis=1)
        late = change[:, change.shape[1] // 2 :]
        reverses = (np.sign(late[:, 1:]) * np.sign(late[:, :-1]) < 0).sum(axis=1) >= REVERSALS
        size = bend.shape[1] // WINDOWS * WINDOWS
        swing = np.sqrt((bend[:, -size:].reshape(len(bend), WINDOWS, -1, bend.shape[2]) ** 2).mean(axis=2))
    swing = np.where(np.isfinite(swing), swing, np.inf)
    grows = np.zeros_like(reverses)
    for first in range(WINDOWS - 3):
        four = swing[:, first : first + 4]
        with np.errstate(invalid="ignore"):
            steady = (four[:, 1:] >= GROWING * four[:, :-1]).all(axis=1) & (four[:, -1] >= GROWN * four[:, 0])
        grows |= steady & (four[:, -1] > scale[:, 0])
    clips: dict[str, np.ndarray] = {}
    for name in ("voltage", "current", "tau", "u"):
        if name in rows:
            second = np.abs(rows[name][:, rows[name].shape[1] // 2 :])
            most = np.nanmax(np.where(np.isfinite(second), second, np.nan), axis=1, keepdims=True, initial=0.0)
            clips[name] = (second >= most * (1.0 - AT_MOST)).mean(axis=1) >= OFTEN
    clipped = np.any([*clips.values(), np.zeros_like(reverses)], axis=0)
    chosen = reverses & (grows | clipped)
    if not chosen.any():
        return None
    lane, joint = np.unravel_index(int(np.argmax(np.where(chosen, swing[:, -1], -1.0))), chosen.shape)
    by = next((name for name, each in clips.items() if each[lane, joint]), "")
    return int(lane), {"tau": "torque", "u": "command"}.get(by, by)
