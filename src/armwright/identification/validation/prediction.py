"""Predictions beside measurements, and checks that an arm and a log can be compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.columns import check_gears
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.identification.logs.spectrum import HIGHEST
from armwright.model import Model

if TYPE_CHECKING:
    import xarray as xr

    from armwright.kernels.compiled import CompiledArm

Quantity = Literal["torque", "position", "speed"]
SIGNALS: dict[Quantity, str] = {"torque": "tau", "position": "q", "speed": "qd"}
POSES = 8  # in which an arm's torques are compared


@dataclass(frozen=True, eq=False)
class Prediction:
    """One quantity of all joints over one run of a log, measured and predicted.

    Attributes:
        quantity: "torque", "position" or "speed".   how: it was predicted, in words.   run, use: of the log.
        joints, units: (n,) of the columns.   rate: rows in a second, in Hz.   every: rows of the log to one row.
        t: (rows,) [s].   part: (rows,) number of the stretch, or of the window that was simulated.
        measured, predicted: (rows, n); NaN where the log has none, or a simulation diverged.
        speed, acceleration: (rows, n) of the joints, where they are known.
        inputs: (rows, n) what drove the prediction, for the cross-correlation; `input_name` in words.
        diverged: windows whose simulation left the finite numbers.
        direction: (rows, n) sign of the speed, through the filter that measured torques have passed.
    """

    quantity: Quantity
    how: str
    run: str
    use: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    rate: float
    every: int
    t: np.ndarray
    part: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    speed: np.ndarray | None = None
    acceleration: np.ndarray | None = None
    inputs: np.ndarray | None = None
    input_name: str = ""
    diverged: int = 0
    direction: np.ndarray | None = None

    @classmethod
    def of(
        cls, arm: Model, run: LogRun, quantity: Quantity, how: str, t: np.ndarray, part: np.ndarray, measured: np.ndarray,
        predicted: np.ndarray, **more: Any,
    ) -> Prediction:  # fmt: skip
        """A prediction at every row of a run."""
        names, units = tuple(arm.names), units_of(arm, quantity)
        head = (quantity, how, run.name, run.use, names, units, 1.0 / run.period, 1)
        return cls(*head, t, part, measured, predicted, **more)


def preparation_for(log: Log, run: str, decimate: int | None = None) -> Preparation:
    """The preparation of a run with the highest cut-off that any run of the log needs: of a run at rest, too, rows are left.

    Args:
        log: a checked log.   run: its name.   decimate: every how many rows to keep, instead of the choice.
    """
    rate = 1.0 / log.run(run).period
    cutoffs = [choose_preparation(log, each.name).cutoff for each in log.runs if each.period > 0]
    return choose_preparation(log, run, cutoff=min(max(cutoffs), HIGHEST * rate), decimate=decimate)


def units_of(arm: Model, quantity: Quantity) -> tuple[str, ...]:
    """(n,) units of a quantity, one for each joint."""
    return tuple(getattr(body.kind.units, quantity) for body in arm.coordinates)


def check_match(arm: Model, log: Log) -> None:
    """Refuses an arm that does not belong to the log.

    Raises:
        LogError: other joints or gears.   ModelError: an arm without masses.
    """
    if sorted(log.joints) != sorted(arm.names):
        theirs, ours = (", ".join(map(repr, names)) for names in (log.joints, arm.names))
        what = f"the log has {len(log.joints)} ({theirs}), {arm.name} has {arm.n} ({ours})"
        raise LogError(what, place="joints", expected="the same joints by name, in the log's joints", file=log.path)
    check_gears(log, arm)
    if all(float(body.mass) == 0.0 and not np.any(body.inertia) for body in arm.bodies) and not any(
        float(body.drive.rotor_inertia) for body in arm.coordinates
    ):
        what = f"{arm.name} states no masses: of kinematics alone nothing can be predicted"
        raise LogError(
            what, place="arm", expected="a record with masses, as `armwright identify` writes", file=log.path
        )


def columns_of(arm: Model, log: Log) -> list[int]:
    """(n,) column of the log for every joint of the arm."""
    return [log.joints.index(name) for name in arm.names]


def is_logged(log: Log, signal: str) -> bool:
    """True if the log has the signal for all of its joints."""
    return signal in log.layout and len(log.layout[signal].joints or ()) == len(log.joints)


def positions_of(arm: Model, dyn: CompiledArm, log: Log, data: xr.Dataset) -> np.ndarray:
    """Positions (rows, n) of a prepared run; 0 where none are logged and the arm's torques do not depend on them.

    Raises:
        LogError: they do.
    """
    if is_logged(log, "q"):
        return data["q"].values[:, columns_of(arm, log)]
    check_pose_free(arm, dyn, log)
    return np.zeros((data.sizes["time"], arm.n))


def check_pose_free(arm: Model, dyn: CompiledArm, log: Log) -> None:
    """Refuses a log without positions of an arm whose torques depend on them.

    Raises:
        LogError: names what is missing.
    """
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (POSES, arm.n))
    ones = np.ones_like(q)
    torques = dyn.inverse_dynamics(q, ones, ones)
    if np.abs(torques - torques[0]).max() > 1e-9 * max(np.abs(torques).max(), 1.0):
        what = f"not logged, and torques of {arm.name} depend on them"
        raise LogError(what, place="position", expected='[[signals]] with quantity = "position"', file=log.path)
