"""Prepared rows of a log as an arm's states, motor torques and columns of its torque model, block by block in bounded memory.

Every low-pass makes a motion smaller at its fast end, and the model's columns are no linear functions of the motion. So columns
of a motion that passed a narrow filter are not those of the torques that passed it, and a fit to them is biased. Therefore

    F τ = Σ_k F y_k(G q, G q̇, G q̈) π_k,

G a low-pass of a cut-off WIDER than the preparation's, which leaves the motion as it is, F that of the preparation, which takes
the noise of accelerations and torques away: parallel filtering. [Gautier1997]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from armwright.errors import IdentificationError, LogError
from armwright.identification.arm.equations import Samples, SampleSource
from armwright.identification.arm.torque_model import TorqueModel
from armwright.identification.logs.blocks import Block
from armwright.identification.logs.checks import of_robot
from armwright.identification.logs.even_rows import EvenStretch
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import (
    HIGHEST,
    LITTLE,
    Preparation,
    RunFilters,
    beyond_limits,
    choose_preparation,
    fewest_rows,
    filters_of,
    leaving_rows,
    settling,
    shared_preparations,
    without_rest,
)
from armwright.identification.logs.prepared import SEAM, prepared_blocks, prepared_excerpt, too_short, zero_phase
from armwright.identification.logs.torques import Source, missing_terms, torque_source, torques_on_joints
from armwright.model import Model

CHUNK_VALUES = 2**19  # of the columns that pass the filter at once: 4 MB

CUT_OFF = "cut off"  # signal that is 1 in rows where a full converter cuts the torque off
IN_MEMORY = 20_000_000  # numbers of prepared rows that stay in memory: 160 MB; longer logs are read again

Moving = tuple[int, np.ndarray, dict[str, np.ndarray]]  # stretch, times (rows,), values (rows, n) by their names
Memory = dict[str, list[Moving]]  # by the run's name


@dataclass(frozen=True, eq=False)
class Stream:
    """Rows of some runs of a log for an arm, read block by block in bounded memory; `stream_of` makes one.

    Attributes:
        log: checked with the arm.   filters: of each run, by its name.   fresh: of the other runs that the log holds out.
        source: of motor torques: the log's, or from its currents by Kt of the record, or from its voltages by eq. (12).
        order: indices of the log's joints in the arm's order.   gears: (n, n) θ_motor = gears q of the log, or None.
        seconds: of all runs together.   rows: in all, behind the low-passes.   name, sha256, lacks, warnings: of the log.
        moving: rows near standstill are not fitted.
    """

    log: Log
    filters: Mapping[str, RunFilters]
    fresh: Mapping[str, RunFilters]
    source: Source
    order: list[int]
    gears: np.ndarray | None
    seconds: float
    rows: float
    name: str
    sha256: str
    lacks: tuple[str, ...]
    warnings: tuple[str, ...]
    moving: bool = False

    @property
    def cutoff(self) -> float:
        """Of the first run's low-pass in Hz."""
        return next(iter(self.filters.values())).narrow.cutoff

    @property
    def settings(self) -> dict[str, Any]:
        """Of the first run's preparation."""
        return next(iter(self.filters.values())).narrow.settings

    def at(self, cutoff: float, decimate: int | None = None, reason: str = "as asked for") -> Stream:
        """The stream with another cut-off in Hz of its low-passes, or the highest below it that a run's rate allows."""

        def changed(each: RunFilters) -> Preparation:
            return _at(each.narrow, cutoff, decimate, reason)

        filters = {name: each.with_low_pass(changed(each)) for name, each in self.filters.items()}
        fresh = {
            name: each.with_low_pass(leaving_rows(self.log, name, changed(each))) for name, each in self.fresh.items()
        }
        return replace(self, filters=filters, fresh=fresh)

    def kept(self, model: TorqueModel, memory: Memory | None = None) -> SampleSource:
        """Samples for a model at each call: in memory where they are few, else read again.

        Args:
            model: of the arm.   memory: as of `samples`, where rows are few.
        """
        if self.rows * (model.arm.n * (len(model) + 5) + 1) >= IN_MEMORY:
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
        for run in self.filters:
            moving: Iterable[Moving] = self._moving(run, model)
            if memory is not None:
                moving = memory[run] = memory.get(run) or list(moving)
            for block in self._parallel_filtered(run, model, moving):
                is_empty = False
                yield block.in_motion() if self.moving else block
        if is_empty:
            last = list(self.filters)[-1]
            raise too_short(self.log, self.log.run(last), self.filters[last].narrow)

    def of_excerpts(self, model: TorqueModel, changed: Callable[[str, EvenStretch], EvenStretch]) -> Iterator[Samples]:
        """Samples of the runs' excerpts, each stretch as a function of run and rows changes it."""
        for run, filters in self.filters.items():
            rows = prepared_excerpt(self.log, run, filters.wide, partial(changed, run))
            moving = ((stretch, block.t, self._states(model, block, block, filters)) for stretch, block, _ in rows)
            yield from self._parallel_filtered(run, model, moving)

    def _parallel_filtered(self, run: str, model: TorqueModel, moving: Iterable[Moving]) -> Iterator[Samples]:
        """Samples of a run: the wide low-pass, torques and columns, the preparation's low-pass, its decimation.

        Rows on either side of a block are kept until the filter has settled.
        """
        filters = self.filters[run]
        second = replace(filters.narrow, rate=filters.narrow.rate / filters.wide.decimate)
        seam = settling(second.sections, SEAM)
        through, behind = (run, model, second, filters), None
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

    def _moving(self, run: str, model: TorqueModel) -> Iterator[Moving]:
        """Motion, motor torques and temperatures of a run that passed the wide low-pass, some rows of it at once."""
        filters = self.filters[run]
        second = replace(filters.narrow, rate=filters.narrow.rate / filters.wide.decimate)
        most = max(CHUNK_VALUES // max(int(model.of_joint.sum()), 1), 4 * settling(second.sections, SEAM))
        rows = most * filters.wide.decimate
        if self.source == "current":
            _check_torque_constants(model.arm)
        for stretch, block in prepared_blocks(self.log, run, self.filters[run].wide, rows):
            yield stretch, block.t, self._states(model, block, block, filters)

    def _states(self, model: TorqueModel, block: Block, measured: Block, filters: RunFilters) -> dict[str, np.ndarray]:
        """Motion and temperatures (rows, n) of a block, torques of the same rows as measured, and where they are cut off."""
        values = {name: each[:, self.order] for name, each in block.values.items()}
        states = {name: values[name] for name in ("q", "qd", "qdd", "temperature") if name in values}
        efforts = measured.values[self.source][:, self.order]
        tau = torques_on_joints(model.arm, self.source, efforts, values["qd"], model.dyn)
        cut_off = beyond_limits(efforts, filters.limits) & (np.abs(values["qd"]) > filters.resting)
        return {**states, "tau": tau} | ({CUT_OFF: cut_off.astype(float)} if np.isfinite(filters.limits).any() else {})

    def as_measured(self, model: TorqueModel) -> Iterator[Samples]:
        """Rows of the runs' excerpts behind the narrow low-pass, beside torques that pass no filter."""
        for run, filters in self.filters.items():
            for stretch, block, measured in prepared_excerpt(self.log, run, filters.narrow):
                states = self._states(model, block, measured, filters)
                states.pop(CUT_OFF, None)
                rate = filters.narrow.rate / filters.narrow.decimate
                states["qd"] = without_rest(states["qd"], filters.resting, rate)
                yield Samples(run, stretch, block.t, **states, fitted=model.known_rows(states["qd"], states["qd"]))


def stream_of(
    log: Log,
    arm: Model,
    runs: Sequence[str] | None = None,
    preparation: Preparation | Mapping[str, Preparation] | None = None,
    **choices: Any,
) -> Stream:
    """Rows of a log for an arm; the log is looked at once.

    Args:
        log: what `read_log` returned.   arm: its joints are in the log, by name.   runs: names; None: those to fit.
        preparation: of all runs, or of each by its name; None: chosen for each run, by `choices` of `choose_preparation`.
    Raises:
        LogError, IdentificationError: as `checked`.
    """
    log, order = checked(log, arm, runs), joints_of(log, arm.names)
    names = tuple(log.fit if runs is None else runs)
    fresh = [name for name in log.hold_out if name not in names]
    gears = None if log.gears is None else log.gears[np.ix_(order, order)]
    seconds, counts = sum(log.run(name).duration for name in names), {name: log.run(name).rows for name in names}
    source = needed_source(log)
    facts = (log.path.name, log.sha256, missing_terms(log.lacks, source), tuple(map(str, log.warnings)))
    own = preparation if isinstance(preparation, Mapping) else dict.fromkeys(names, preparation)
    prepared = {name: own[name] or choose_preparation(log, name, **choices) for name in names}
    rows = sum(counts[name] / each.decimate for name, each in prepared.items())
    filters, others = (filters_of(log, each, order, source) for each in (prepared, shared_preparations(log, fresh)))
    return Stream(log, filters, others, source, order, gears, seconds, rows, *facts)


def _at(prepared: Preparation, cutoff: float, decimate: int | None, reason: str) -> Preparation:
    """A preparation at another cut-off in Hz, with no fewer rows than the rate allows."""
    cutoff = min(cutoff, HIGHEST * prepared.rate)
    return prepared.at(cutoff, None if decimate is None else min(decimate, fewest_rows(prepared.rate, cutoff)), reason)


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
        self, seam: int, run: str, model: TorqueModel, second: Preparation, filters: RunFilters
    ) -> Iterator[Samples]:
        """Every k-th of the rows but for the last `seam`, and those that the filter's settling spoils at the stretch's ends."""
        wide = filters.wide
        spoilt, step = (second.edge - wide.edge) // wide.decimate, second.decimate // wide.decimate
        end = len(self.t) - (seam or spoilt)
        numbers = np.arange(self.done, max(end, self.done))
        numbers = numbers[self.first + numbers >= spoilt]
        numbers = numbers[(self.first + numbers - spoilt) % step == 0]
        if not len(numbers):
            return
        q, qd, qdd = (self.values[name] for name in ("q", "qd", "qdd"))
        slow = near_standstill(qd, qdd, second, filters.wide.cutoff)
        qd = without_rest(qd, filters.resting, second.rate)
        motion = q, qd, qdd
        used = model.of_joint
        columns = np.zeros((len(numbers), *used.shape))
        rows, known = model.terms(*motion)
        speeds = between_rows(qd, wide.decimate) if wide.decimate > 1 else qd[None]
        loaded = model.loaded_friction(*motion[:2], self.values["tau"], speeds)
        by_loads = {} if loaded is None else {"loaded": loaded}
        known = known if loaded is None else known + loaded
        if wide.decimate > 1:
            rows = model.directed(rows, speeds)
        columns[:, used] = zero_phase(second, rows[:, used])[numbers]
        values = {**self.values, "known": known, **by_loads, "slow": slow}
        filtered = {name: zero_phase(second, each)[numbers] for name, each in values.items()}
        fitted = model.known_rows(motion[1][numbers], filtered["qd"])
        if CUT_OFF in filtered:
            measured = np.abs(filtered.pop(CUT_OFF)) < LITTLE
            fitted = measured if fitted is None else fitted & measured
        yield Samples(run, self.stretch, self.t[numbers], columns=columns, fitted=fitted, **filtered)

    def after(self, seam: int) -> _Behind:
        """The remaining rows when all but the last `seam` are done, with as many before them for the filter."""
        cut = max(len(self.t) - 2 * seam, 0)
        rest = {name: each[cut:] for name, each in self.values.items()}
        return _Behind(self.stretch, self.t[cut:], rest, len(self.t) - seam - cut, self.first + cut)


def near_standstill(qd: np.ndarray, qdd: np.ndarray, narrow: Preparation, wide: float) -> np.ndarray:
    """(rows, n) 1 where the direction of a speed is not sure, else 0.

    There the narrow low-pass changes the speed by more than itself, as where a joint sticks for less time than either low-pass
    shows, or it turns back within the time 1/(2π f) of the wide one.

    Args:
        qd, qdd: (rows, n) speeds and accelerations behind the wide low-pass.   narrow: of the torques.   wide: cut-off f in Hz.
    """
    hidden = np.maximum(np.abs(qd - zero_phase(narrow, qd)), np.abs(qdd) / (2 * np.pi * wide))
    return (np.abs(qd) <= hidden).astype(float)


def between_rows(qd: np.ndarray, count: int) -> np.ndarray:
    """Speeds (2 count, rows, n) at the log's own rows around each `count`-th one, of the speeds (rows, n) there.

    Of each row half the rows from `count`/2 before it to the last one before `count`/2 after it, and half their mirror image: a
    row of the log between two that are kept belongs to both.
    """
    k, beside = np.arange(len(qd)), (np.arange(count) - count // 2) / count
    rows = k[None, :] + np.concatenate([beside, -beside])[:, None]
    return np.stack([np.interp(rows, k, each) for each in qd.T], axis=2)


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


def needed_source(log: Log) -> Source:
    """The signal used for motor torques: "tau", else "current", else "voltage".

    Raises:
        IdentificationError: the log has none of them.
    """
    source = torque_source(log.layout)
    if source is None:
        expected = "a torque, current or voltage: without one no mass can be identified"
        raise IdentificationError("no torques", place="signals", expected=expected, file=log.path)
    return source


def checked(log: Log, arm: Model, runs: Sequence[str] | None = None) -> Log:
    """The log, with what else is found with an arm that its file does not name.

    Raises:
        IdentificationError: neither torque, current nor voltage, no positions of a joint, or a joint moves with a constant
            torque, current or voltage: an offset alone would explain it.
        LogError: joints of the arm that are not in the log, or as `of_robot`.
    """
    source, order = needed_source(log), joints_of(log, arm.names)
    log = of_robot(log, arm)
    censuses = [log.run(name).census for name in runs or log.fit]
    for name, joint in zip(arm.names, order, strict=True):
        moves = []
        for signal in ("q", source):
            joints = log.layout[signal].joints or ()
            k = joints.index(joint) if joint in joints else None
            each = [] if k is None else [(c.signals[signal].low[k], c.signals[signal].high[k]) for c in censuses]
            moves.append(min(low for low, _ in each) < max(high for _, high in each) if each else None)
        if moves == [True, False]:
            what = f"never changes while joint {name!r} moves: it says nothing about inertia and friction"
            raise IdentificationError(what, place=f"signal {source}", expected="efforts that move it", file=log.path)
    return log


def _check_torque_constants(arm: Model) -> None:
    """Refuses currents of motors whose record states no torque constant.

    Raises:
        IdentificationError: names the first joint.
    """
    for body in arm.coordinates:
        if body.drive.torque_constant is None:
            place, expected = "motor.torque_constant_n_m_per_a", "Kt in the robot's record, or torques in the log"
            what = "currents of a motor without a torque constant"
            raise IdentificationError(what, place=f"joint {body.joint!r} {place}", expected=expected)
