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
from functools import partial
from typing import Any

import numpy as np

from armwright.actuators.coupling import shares_of, to_joints
from armwright.errors import IdentificationError, LogError
from armwright.identification.arm.equations import Samples, SampleSource
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.checks import of_robot
from armwright.identification.logs.columns import check_gears
from armwright.identification.logs.log import Log, bridged
from armwright.identification.logs.preparation import Preparation, choose_preparation, settling
from armwright.identification.logs.prepared import SEAM, prepared_blocks, resting_speeds, zero_phase
from armwright.model import Model

CHUNK_VALUES = 2**21  # of the columns that pass the filter at once: 16 MB

IN_MEMORY = 20_000_000  # numbers of prepared rows that stay in memory: 160 MB; longer logs are read again

Moving = tuple[int, np.ndarray, dict[str, np.ndarray]]  # stretch, times (rows,), values (rows, n) by their names
Memory = dict[str, list[Moving]]  # by the run's name


class Stream:
    """Rows of some runs of a log for an arm: the log is looked at once, its rows are read block by block in bounded memory.

    Attributes:
        log: a checked log.   arm: whose joints are in the log, by name.   runs: names.   prepared: their low-passes, by name.
        source: of motor torques: the log's, or from its currents by Kt of the record, or from its voltages by eq. (12).
        order: indices of the log's joints in the arm's order.   gears: (n, n) θ_motor = gears q of the log, or None.
        seconds: of all runs together.   hold_out: names of other runs, that the log holds out.   lacks: terms that its torques
        are without.   name, sha256, warnings: of the log, for an estimate.
    """

    def __init__(
        self,
        log: Log,
        arm: Model,
        runs: Sequence[str] | None = None,
        preparation: Preparation | Mapping[str, Preparation] | None = None,
        **choices: Any,
    ):
        """The rows of a log.

        Args:
            log: a checked log.   arm: its joints are in the log, by name.   runs: names; None: those to fit.
            preparation: of all runs, or of each by its name; None: chosen for each run, by `choices` of `choose_preparation`.
        Raises:
            LogError: joints of the arm that are not in the log, or gears that are not the arm's.
            IdentificationError: joints of the arm without positions, or neither torque, current nor voltage.
        """
        self.order, self.source = joints_of(log, arm.names), torque_source(log)
        check_gears(log, arm)
        self.log, self.arm, self.runs = log, arm, tuple(log.fit if runs is None else runs)
        self.hold_out = [run for run in log.hold_out if run not in self.runs]
        self.name, self.sha256, self.warnings = log.path.name, log.sha256, [str(each) for each in log.warnings]
        self.lacks = tuple(dict.fromkeys(term for signal in log.table.signals for term in signal.lacks))
        self.gears = None if log.gears is None else log.gears[np.ix_(self.order, self.order)]
        self.seconds = sum(log.run(name).duration for name in self.runs)
        self._rows = {name: log.run(name).rows for name in self.runs}
        own = preparation if isinstance(preparation, Mapping) else dict.fromkeys(self.runs, preparation)
        self.prepared = {name: own[name] or choose_preparation(log, name, **choices) for name in self.runs}
        self._resting = {name: resting_speeds(log, name)[self.order] for name in self.runs}

    def kept(self, model: TorqueModel, memory: Memory | None = None) -> SampleSource:
        """Samples for a model at each call: in memory where they are few, else read again.

        Args:
            model: of the arm.   memory: as of `samples`, where rows are few.
        """
        rows = sum(self._rows[name] / each.decimate for name, each in self.prepared.items())
        if rows * (model.arm.n * (len(model) + 5) + 1) >= IN_MEMORY:
            return lambda: self.samples(model)
        return partial(iter, list(self.samples(model, memory)))

    def samples(self, model: TorqueModel, memory: Memory | None = None) -> Iterator[Samples]:
        """Rows as states, motor torques and columns of a model of the arm, block by block.

        Args:
            model: of the arm.
            memory: where the motion and torques of runs stay that passed the wide low-pass, for further models; None: nowhere.
        Raises:
            LogError: no stretch is long enough.   ModelError: currents or voltages of motors without constants.
        """
        is_empty = True
        for run in self.runs:
            for block in self._parallel_filtered(run, model, memory):
                is_empty = False
                yield block
        if is_empty:
            run = self.runs[-1]
            longest = max((stretch.rows for stretch in bridged(self.log, self.log.run(run))), default=0)
            expected = f"more than {2 * self.prepared[run].edge} rows without a gap; or a higher cut-off"
            what = f"the longest stretch has {longest} rows"
            raise LogError(what, place=f"run {run!r}", expected=expected, file=self.log.path)

    def _parallel_filtered(self, run: str, model: TorqueModel, memory: Memory | None) -> Iterator[Samples]:
        """Samples of a run: the wide low-pass, torques and columns, the preparation's low-pass, its decimation.

        Rows on either side of a block are kept until the filter has settled.
        """
        first = self.prepared[run].of_motion
        second = replace(self.prepared[run], rate=self.prepared[run].rate / first.decimate)
        seam = settling(second.sections, SEAM)
        rows = max(CHUNK_VALUES // max(int(model.of_joint.sum()), 1), 4 * seam) * first.decimate
        moving: Iterable[Moving] = self._moving(run, model, first, rows)
        if memory is not None:
            moving = memory[run] = memory.get(run) or list(moving)
        through, behind = (run, model, second, first, self._resting[run]), None
        for stretch, t, states in moving:
            if behind is not None and behind.stretch != stretch:
                yield from behind.samples(0, *through)
                behind = None
            behind = _Behind(stretch, t, states, 0, 0) if behind is None else behind.plus(t, states)
            if len(behind.t) - behind.done > 2 * seam:
                yield from behind.samples(seam, *through)
                behind = behind.after(seam)
        if behind is not None:
            yield from behind.samples(0, *through)

    def _moving(self, run: str, model: TorqueModel, first: Preparation, rows: int) -> Iterator[Moving]:
        """Motion, motor torques and temperatures of a run that passed the wide low-pass, some rows of it at once."""
        for stretch, block in prepared_blocks(self.log, run, first, rows):
            values = {name: _full(self.log, name, each)[:, self.order] for name, each in block.values.items()}
            states = {name: values[name] for name in ("q", "qd", "qdd", "temperature") if name in values}
            states["tau"] = _torque(model, self.source, values)
            yield stretch, block.t, states


def samples_of(
    log: Log,
    model: TorqueModel,
    runs: Sequence[str] | None = None,
    preparation: Preparation | Mapping[str, Preparation] | None = None,
    memory: Memory | None = None,
) -> Iterator[Samples]:
    """Prepared rows of a log's runs as an arm's states and motor torques, as `Stream` has them.

    Args:
        log, runs, preparation: of the `Stream`.   model, memory: of its `samples`.
    Raises:
        LogError, IdentificationError, ModelError: as of both.
    """
    return Stream(log, model.arm, runs, preparation).samples(model, memory)


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
        self, seam: int, run: str, model: TorqueModel, second: Preparation, first: Preparation, slowest: np.ndarray
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


def checked(log: Log, arm: Model, runs: Sequence[str] | None = None) -> Log:
    """The log, with what else is found with an arm that its file does not name.

    Raises:
        IdentificationError: a joint moves with a constant torque, current or voltage: an offset alone would explain it.
        LogError: as `of_robot`.
    """
    source = torque_source(log)
    censuses = [census for name in runs or log.fit if (census := log.run(name).census) is not None]
    for name, joint in zip(arm.names, joints_of(log, arm.names), strict=True):
        moves = []
        for signal in ("q", source):
            joints = log.layout[signal].joints or ()
            k = joints.index(joint) if joint in joints else None
            each = [] if k is None else [(c.signals[signal].low[k], c.signals[signal].high[k]) for c in censuses]
            moves.append(min(low for low, _ in each) < max(high for _, high in each) if each else None)
        if moves == [True, False]:
            what = f"never changes while joint {name!r} moves: it says nothing about inertia and friction"
            raise IdentificationError(what, place=f"signal {source}", expected="efforts that move it", file=log.path)
    return of_robot(log, arm)


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
