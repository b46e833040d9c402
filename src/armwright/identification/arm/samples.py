"""Prepared rows of a log as an arm's states and motor torques, block by block in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import sosfiltfilt

from armwright.actuators.coupling import shares_of, to_joints
from armwright.errors import IdentificationError, LogError
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import (
    EDGE,
    SEAM,
    Preparation,
    choose_preparation,
    prepared_blocks,
    settling,
)


@dataclass(frozen=True, eq=False)
class Samples:
    """Some prepared rows of a log for an arm.

    Attributes:
        run, stretch: which part of the log.   t: (rows,) [s].   q, qd, qdd: (rows, n).
        tau: (rows, n) [N m | N] measured motor torque, joint side; NaN for joints without.
        dry: (rows, d) values of the model's `dry` columns, filtered as the torques are; None: not filtered.
    """

    run: str
    stretch: int
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    tau: np.ndarray
    dry: np.ndarray | None = None

    def part(self, chosen: slice | np.ndarray) -> Samples:
        """Some of its rows."""
        dry = None if self.dry is None else self.dry[chosen]
        parts = {name: getattr(self, name)[chosen] for name in ("t", "q", "qd", "qdd", "tau")}
        return replace(self, **parts, dry=dry)


def samples_of(
    log: Log,
    model: TorqueModel,
    runs: Sequence[str] | None = None,
    preparation: Preparation | Mapping[str, Preparation] | None = None,
) -> Iterator[Samples]:
    """Prepared rows of a log's runs as an arm's states and motor torques, block by block in bounded memory.

    Torques are the log's, or follow from its currents by Kt of the record, or from its voltages by eq. (12).

    Args:
        log: a checked log.   model: of the arm; its joints are in the log, by name.
        runs: names; None: those to fit.   preparation: of all runs, or of each by its name; None: chosen for each run.
    Raises:
        LogError: joints of the arm that are not in the log.
        IdentificationError: joints of the arm without positions, or neither torque, current nor voltage.
        ModelError: currents or voltages of motors without constants.
    """
    order = joints_of(log, model.arm.names)
    source = torque_source(log)
    for run in log.fit if runs is None else runs:
        chosen = preparation[run] if isinstance(preparation, Mapping) else preparation or choose_preparation(log, run)
        for stretch, t, values, dry in _with_dry(log, run, model, chosen, order):
            yield Samples(
                run, stretch, t, values["q"], values["qd"], values["qdd"], _torque(model, source, values), dry
            )


def _with_dry(
    log: Log, run: str, model: TorqueModel, chosen: Preparation, order: list[int]
) -> Iterator[tuple[int, np.ndarray, dict[str, np.ndarray], np.ndarray]]:
    """Stretch, times, signals (rows, n) and dry friction's columns (rows, d), these filtered too, then decimated.

    A torque that jumps leaves the filter as a smooth step; its column must do the same, or Coulomb friction takes what is
    inertia's. The columns are made of all rows, and rows on either side of a block are kept until the filter has settled.
    """
    seam, behind = settling(chosen.sections, SEAM), None
    for stretch, block in prepared_blocks(log, run, replace(chosen, decimate=1)):
        values = {name: _full(log, name, each)[:, order] for name, each in block.values.items()}
        if behind is not None and behind.stretch != stretch:
            yield behind.rows(model, chosen, 0)
            behind = None
        behind = _Behind(stretch, block.t, values, 0, 0) if behind is None else behind.plus(block.t, values)
        if len(behind.t) - behind.done > 2 * seam:
            yield behind.rows(model, chosen, seam)
            behind = behind.after(seam)
    if behind is not None:
        yield behind.rows(model, chosen, 0)


@dataclass(frozen=True, eq=False)
class _Behind:
    """Rows of a stretch that wait for those after them; the first `done` are only there for the filter."""

    stretch: int
    t: np.ndarray
    values: dict[str, np.ndarray]
    done: int
    first: int  # number of the first row in the stretch

    def plus(self, t: np.ndarray, values: dict[str, np.ndarray]) -> _Behind:
        """With the rows after them."""
        joined = {name: np.concatenate([each, values[name]]) for name, each in self.values.items()}
        return replace(self, t=np.concatenate([self.t, t]), values=joined)

    def rows(
        self, model: TorqueModel, chosen: Preparation, seam: int
    ) -> tuple[int, np.ndarray, dict[str, np.ndarray], np.ndarray]:
        """Every k-th of the rows but for the last `seam`."""
        dry = model.dry_values(self.values["qd"])
        if dry.size and len(dry) > 1:
            pad = min(3 * settling(chosen.sections, EDGE), len(dry) - 1)
            dry = np.asarray(sosfiltfilt(chosen.sections, dry, axis=0, padlen=pad))
        numbers = np.arange(self.done, len(self.t) - seam)
        numbers = numbers[(self.first + numbers) % chosen.decimate == 0]
        return self.stretch, self.t[numbers], {name: each[numbers] for name, each in self.values.items()}, dry[numbers]

    def after(self, seam: int) -> _Behind:
        """What is left when all rows but the last `seam` are done, with as many before them for the filter."""
        cut = max(len(self.t) - 2 * seam, 0)
        rest = {name: each[cut:] for name, each in self.values.items()}
        return _Behind(self.stretch, self.t[cut:], rest, len(self.t) - seam - cut, self.first + cut)


def joints_of(log: Log, names: Sequence[str]) -> list[int]:
    """Numbers of the log's joints in the order of an arm's, by name.

    Raises:
        LogError: the log has not all joints of the arm.   IdentificationError: it has no positions of one.
    """
    if not set(names) <= set(log.joints):
        theirs, ours = (", ".join(map(repr, each)) for each in (log.joints, names))
        what = f"the log has {len(log.joints)} ({theirs}), the arm has {len(names)} ({ours})"
        raise LogError(what, place="joints", expected="the same joints by name, in the log's joints", file=log.path)
    order = [log.joints.index(name) for name in names]
    measured = () if "q" not in log.layout else log.layout["q"].joints or ()
    for name, k in zip(names, order, strict=True):
        if k not in measured:
            raise IdentificationError(f"no positions of {name!r}", place="signals", expected="position", file=log.path)
    return order


def torque_source(log: Log) -> str:
    """The signal that motor torques come from: "tau", else "current", else "voltage".

    Raises:
        IdentificationError: the log has none of them.
    """
    for name in ("tau", "current", "voltage"):
        if name in log.layout:
            return name
    expected = "a torque, current or voltage: without one no mass can be told"
    raise IdentificationError("no torques", place="signals", expected=expected, file=log.path)


def check_efforts(log: Log, names: Sequence[str], runs: Sequence[str]) -> None:
    """Refuses a joint that moves while its torque, current or voltage never changes: an offset alone would explain it.

    Raises:
        IdentificationError: with the joint.
    """
    source = torque_source(log)
    for name, joint in zip(names, joints_of(log, names), strict=True):
        q, effort = (_extremes(log, signal, joint, runs) for signal in ("q", source))
        if q[0] < q[1] and effort[0] == effort[1]:
            what = f"never changes while joint {name!r} moves: it says nothing about inertia and friction"
            raise IdentificationError(what, place=f"signal {source}", expected="efforts that move it", file=log.path)


def _extremes(log: Log, signal: str, joint: int, runs: Sequence[str]) -> tuple[float, float]:
    """Lowest and highest value of a joint's signal over some runs; NaN if it is not measured."""
    joints = log.layout[signal].joints or ()
    censuses = [census for name in runs if (census := log.run(name).census) is not None]
    if joint not in joints or not censuses:
        return np.nan, np.nan
    k, counted = joints.index(joint), [census.signals[signal] for census in censuses]
    return min(float(each.low[k]) for each in counted), max(float(each.high[k]) for each in counted)


def _full(log: Log, name: str, values: np.ndarray) -> np.ndarray:
    """A signal (rows, joints of the log), NaN for joints that do not have it."""
    source = name if name in log.layout else "qd" if name == "qdd" and "qd" in log.layout else "q"
    joints = list(log.layout[source].joints or ())
    full = np.full((len(values), len(log.joints)), np.nan)
    full[:, joints] = values
    return full


def _torque(model: TorqueModel, source: str, values: dict[str, np.ndarray]) -> np.ndarray:
    """Motor torques (rows, n) referred to the joints."""
    if source == "tau":
        return values["tau"]
    arm = model.arm
    if source == "voltage":
        own = model.dyn.motor_torque(values["qd"], values["voltage"])
    else:
        lacking = [b.joint for b in arm.coordinates if b.drive.torque_constant is None]
        if lacking:
            raise IdentificationError(
                "currents of a motor without a torque constant",
                place=f"joint {lacking[0]!r} motor.torque_constant_n_m_per_a",
                expected="Kt in the robot's record, or torques in the log",
            )
        factors = [float(b.drive.gear_ratio) * float(b.drive.torque_constant or 0) for b in arm.coordinates]
        own = values["current"] * np.array(factors)
    shares = shares_of(arm)
    if not any(shares):
        return own
    return np.asarray(to_joints(shares, own.T)).astype(float).T
