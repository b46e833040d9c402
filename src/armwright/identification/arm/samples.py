"""Prepared rows of a log as an arm's states, motor torques and columns of its torque model, block by block in bounded memory.

Every low-pass makes a motion smaller at its fast end, and the model's columns are no linear functions of the motion. So columns
of a motion that passed a narrow filter are not those of the torques that passed it, and a fit to them is biased. Therefore

    F τ = Σ_k F y_k(G q, G q̇, G q̈) π_k,

G a low-pass of a cut-off WIDER than the preparation's, which leaves the motion as it is, F that of the preparation, which takes
the noise of accelerations and torques away: parallel filtering. [Gautier1997]
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armwright.actuators.coupling import shares_of, to_joints
from armwright.errors import IdentificationError, LogError
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.columns import check_gears
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation, settling
from armwright.identification.logs.prepared import SEAM, bridged, prepared_blocks, resting_speeds, zero_phase

CHUNK_VALUES = 2**21  # of the columns that pass the filter at once: 16 MB

Moving = tuple[int, np.ndarray, dict[str, np.ndarray]]  # stretch, times (rows,), values (rows, n) by their names
Memory = dict[str, list[Moving]]  # by the run's name


@dataclass(frozen=True, eq=False)
class Samples:
    """Some prepared rows of a log for an arm.

    Attributes:
        run, stretch: which part of the log.   t: (rows,) [s].   q, qd, qdd: (rows, n).
        tau: (rows, n) [N m | N] measured motor torque, joint side; NaN for joints without.
        temperature: (rows, n) [°C] of the motors, NaN for joints without; None if it is not logged.
        columns, known: (rows, n, p) `rows` and (rows, n) `known_torques` of the model, filtered as the torques are; None: not yet
            computed, then those of the states.
        fitted: (rows, n) False where a torque is not fitted (`TorqueModel.known_rows`); None: all are.
    """

    run: str
    stretch: int
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    tau: np.ndarray
    temperature: np.ndarray | None = None
    columns: np.ndarray | None = None
    known: np.ndarray | None = None
    fitted: np.ndarray | None = None

    def part(self, chosen: slice | np.ndarray) -> Samples:
        """Some of its rows."""
        names = ("t", "q", "qd", "qdd", "tau", "temperature", "columns", "known", "fitted")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names if getattr(self, name) is not None})

    def regressor(self, model: TorqueModel) -> np.ndarray:
        """Y (rows, n, p) of the model that the samples were prepared for."""
        return model.rows(self.q, self.qd, self.qdd) if self.columns is None else self.columns

    def unknown_torque(self, model: TorqueModel) -> np.ndarray:
        """Y π (rows, n) [N m | N]: measured torque without what the model knows; NaN where it is not fitted."""
        known = model.known_torques(self.q, self.qd, self.qdd) if self.known is None else self.known
        unknown = self.tau - known
        return unknown if self.fitted is None else np.where(self.fitted, unknown, np.nan)


def samples_of(
    log: Log,
    model: TorqueModel,
    runs: Sequence[str] | None = None,
    preparation: Preparation | Mapping[str, Preparation] | None = None,
    memory: Memory | None = None,
) -> Iterator[Samples]:
    """Prepared rows of a log's runs as an arm's states and motor torques, block by block in bounded memory.

    Torques are the log's, or follow from its currents by Kt of the record, or from its voltages by eq. (12).

    Args:
        log: a checked log.   model: of the arm; its joints are in the log, by name.
        runs: names; None: those to fit.   preparation: of all runs, or of each by its name; None: chosen for each run.
        memory: where the motion and torques of runs stay that passed the wide low-pass, for further models; None: nowhere.
    Raises:
        LogError: joints of the arm that are not in the log, gears that are not the arm's, or no stretch that is long enough.
        IdentificationError: joints of the arm without positions, or neither torque, current nor voltage.
        ModelError: currents or voltages of motors without constants.
    """
    order = joints_of(log, model.arm.names)
    check_gears(log, model.arm)
    source, is_empty = torque_source(log), True
    for run in log.fit if runs is None else runs:
        chosen = preparation[run] if isinstance(preparation, Mapping) else preparation or choose_preparation(log, run)
        for block in _parallel_filtered(log, run, model, chosen, order, source, memory):
            is_empty = False
            yield block
        if is_empty and run == (log.fit if runs is None else runs)[-1]:
            longest = max((stretch.rows for stretch in bridged(log, log.run(run))), default=0)
            expected = f"more than {2 * chosen.edge} rows without a gap; or a higher cut-off"
            raise LogError(
                f"the longest stretch has {longest} rows", place=f"run {run!r}", expected=expected, file=log.path
            )


def _parallel_filtered(
    log: Log, run: str, model: TorqueModel, chosen: Preparation, order: list[int], source: str, memory: Memory | None
) -> Iterator[Samples]:
    """Samples of a run: the wide low-pass, torques and columns, the preparation's low-pass, its decimation.

    Rows on either side of a block are kept until the filter has settled.
    """
    first = chosen.of_motion
    second = replace(chosen, rate=chosen.rate / first.decimate)
    seam = settling(second.sections, SEAM)
    rows = max(CHUNK_VALUES // max(int(model.of_joint.sum()), 1), 4 * seam) * first.decimate
    slowest, behind = resting_speeds(log, run)[order], None
    moving: Iterable[Moving] = _moving(log, run, model, first, order, source, rows)
    if memory is not None:
        moving = memory.setdefault(run, [])
        if not moving:
            moving.extend(_moving(log, run, model, first, order, source, rows))
    for stretch, t, states in moving:
        if behind is not None and behind.stretch != stretch:
            yield from behind.samples(run, model, second, 0, first, slowest)
            behind = None
        behind = _Behind(stretch, t, states, 0, 0) if behind is None else behind.plus(t, states)
        if len(behind.t) - behind.done > 2 * seam:
            yield from behind.samples(run, model, second, seam, first, slowest)
            behind = behind.after(seam)
    if behind is not None:
        yield from behind.samples(run, model, second, 0, first, slowest)


def _moving(
    log: Log, run: str, model: TorqueModel, first: Preparation, order: list[int], source: str, rows: int
) -> Iterator[Moving]:
    """Motion, motor torques and temperatures of a run that passed the wide low-pass, some rows of it at once."""
    for stretch, block in prepared_blocks(log, run, first, rows):
        values = {name: _full(log, name, each)[:, order] for name, each in block.values.items()}
        states = {name: values[name] for name in ("q", "qd", "qdd", "temperature") if name in values}
        states["tau"] = _torque(model, source, values)
        yield stretch, block.t, states


@dataclass(frozen=True, eq=False)
class _Behind:
    """Rows of a stretch that wait for those after them; the first `done` are only there for the filter."""

    stretch: int
    t: np.ndarray
    values: dict[str, np.ndarray]
    done: int
    first: int  # number of the first row in the stretch

    def plus(self, t: np.ndarray, values: dict[str, np.ndarray]) -> _Behind:
        """The buffer extended by further rows."""
        joined = {name: np.concatenate([each, values[name]]) for name, each in self.values.items()}
        return replace(self, t=np.concatenate([self.t, t]), values=joined)

    def samples(
        self, run: str, model: TorqueModel, second: Preparation, seam: int, first: Preparation, slowest: np.ndarray
    ) -> Iterator[Samples]:
        """Every k-th of the rows but for the last `seam`, and those that the filter's settling spoils at the stretch's ends."""
        spoilt, step = (second.edge - first.edge) // first.decimate, second.decimate // first.decimate
        end = len(self.t) - (seam or spoilt)
        numbers = np.arange(self.done, max(end, self.done))
        numbers = numbers[self.first + numbers >= spoilt]
        numbers = numbers[(self.first + numbers - spoilt) % step == 0]
        if not len(numbers):
            return
        q, qd, qdd = (self.values[name] for name in ("q", "qd", "qdd"))
        motion = q, np.where(np.abs(qd) < slowest, 0.0, qd), qdd
        used = model.of_joint
        columns = np.zeros((len(numbers), *used.shape))
        rows, known = model.terms(*motion)
        columns[:, used] = zero_phase(second, rows[:, used])[numbers]
        values = {**self.values, "known": known}
        filtered = {name: zero_phase(second, each)[numbers] for name, each in values.items()}
        fitted = model.known_rows(motion[1][numbers], filtered["qd"])
        yield Samples(run, self.stretch, self.t[numbers], columns=columns, fitted=fitted, **filtered)

    def after(self, seam: int) -> _Behind:
        """The remaining rows when all but the last `seam` are done, with as many before them for the filter."""
        cut = max(len(self.t) - 2 * seam, 0)
        rest = {name: each[cut:] for name, each in self.values.items()}
        return _Behind(self.stretch, self.t[cut:], rest, len(self.t) - seam - cut, self.first + cut)


def joints_of(log: Log, names: Sequence[str]) -> list[int]:
    """Indices of the log's joints in the order of an arm's, by name.

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
    """The signal used for motor torques: "tau", else "current", else "voltage".

    Raises:
        IdentificationError: the log has none of them.
    """
    for name in ("tau", "current", "voltage"):
        if name in log.layout:
            return name
    expected = "a torque, current or voltage: without one no mass can be identified"
    raise IdentificationError("no torques", place="signals", expected=expected, file=log.path)


def check_efforts(log: Log, names: Sequence[str], runs: Sequence[str]) -> None:
    """Refuses a joint that moves with a constant torque, current or voltage: an offset alone would explain it.

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
