"""A run as the beginning of another: the complete state of its plant in its last row, and the command in force there."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.simulation.plant.plant import Plant


def check_run(arm: Model, run: Any) -> None:
    """Refuses what an arm cannot begin with.

    Raises:
        ScenarioError: no run, one of other joints, one without rows, or one with lanes that did not come to their end.
    """
    import xarray

    if not isinstance(run, xarray.Dataset) or not {"q", "qd", "u"} <= set(run.data_vars) or not run.sizes.get("time"):
        told = "a dataset without such rows" if isinstance(run, xarray.Dataset) else f"of type {type(run).__name__}"
        raise ScenarioError(f"initial: {told}; expected a run that recorded q, qd and u, as simulate returns")
    missing = {"joint", "command"} - set(run.coords)
    if missing:
        raise ScenarioError(f"initial: no coordinate {min(missing)!r}; expected a run, as simulate returns")
    joints, commands = [str(name) for name in run["joint"].values], [str(name) for name in run["command"].values]
    if joints != arm.names:
        raise ScenarioError(f"initial: a run of the joints {', '.join(joints)}; expected {', '.join(arm.names)}")
    own = [body.drive.command for body in arm.coordinates]
    if commands != own:
        raise ScenarioError(f"initial: a run of drives told {', '.join(commands)}; expected {', '.join(own)}")
    for name in ("diverged_at", "stalled_at"):
        if name in run and run[name].notnull().any():
            lane = int(np.argmax(run[name].notnull().values))
            at = float(run[name].values.ravel()[lane])
            raise ScenarioError(f"initial: lane {lane} stopped at t = {at:g} s; expected lanes that came to their end")


def last_row(run: Any, name: str) -> np.ndarray:
    """(lanes or 1, …) of a variable in the last row."""
    return np.atleast_2d(run[name].isel(time=-1).transpose(..., "joint").to_numpy())


def last_state(run: Any, plant: Plant) -> np.ndarray:
    """(lanes or 1, size) the plant's state in the last row of a run.

    Raises:
        ScenarioError: a state that the run has not recorded.
    """
    start = zip(last_row(run, "q"), last_row(run, "qd"), strict=True)
    x = np.array([plant.initial(q, qd) for q, qd in start], dtype=float)
    for part in plant.parts[2:]:
        if part.name not in run:
            if part.name == "brake":  # released until now: unloaded
                continue
            raise ScenarioError(f"initial: the run tells no {part.name}; expected one of this arm, with record = 'all'")
        last = run[part.name].isel(time=-1)
        x[:, part.place] = (
            last_row(run, part.name)[:, part.joints] if part.joints else np.reshape(last.to_numpy(), (-1, 1))
        )
    return x
