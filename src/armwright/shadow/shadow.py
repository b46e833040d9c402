"""A model run beside its arm: residuals and alarms from the rows of a log, or from live rows."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from armwright.entry import AnyArm, AnyLog, as_arm, as_log
from armwright.errors import LogError, ScenarioError
from armwright.fitting.measures import rms
from armwright.identification.arm.torque_model import MEASURED
from armwright.identification.logs.log import Log
from armwright.identification.logs.torques import Source, torques_on_joints
from armwright.identification.validation.match import match
from armwright.identification.validation.prediction import units_of
from armwright.identification.validation.torque import as_logged, check_constants
from armwright.identification.validation.verdict import passing_verdict
from armwright.model import Model
from armwright.progress import Shown, automatic
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.shadow.alarms import FACTOR, AlarmWatch, ShadowAlarm
from armwright.shadow.observer import MomentumObserver, Residuals, ShadowBandwidths, with_kilogram
from armwright.shadow.page import write_shadow
from armwright.shadow.rows import ShadowEvent, event_lines
from armwright.shadow.uncertainty import Deviations, torque_deviations, verdict_of
from armwright.shadow.verdict import Judged, Verdict, verdict

SUPPORT = MEASURED.named("shadow")

HEADS = (
    "joint", "unit", "RMS of residual", "largest", "limit at rest", "friction at rest", "position RMS", "largest position",
    "alarms",
)  # fmt: skip
ROWS = 4096  # of a log that are handled at once


class ArmShadow:
    """A model that runs beside its arm, fed with measured rows.

        shadow = aw.shadow.ArmShadow("arm.toml")
        for t, q, tau in rows:                          # or blocks of any length
            for alarm in shadow.update([t], [q], [tau]):
                print(alarm)

    Args:
        arm: a full record: the path of its file, a name, or the model.
        record: path of the file, where `arm` is a model; beside it stands the verdict.
        deviation: (n,) or one number [N m | N], standard deviation of the torque residual; None: `torque_deviations`.
        factor: standard deviations that a residual may reach.   bandwidths: of the observer.
        held: whether torques act until the next row, as commands do.
        on_alarm: called with every alarm as it is raised, such as to stop the arm. This closes a loop over the model, so the
            record needs a passing verdict of `validate`.
    Raises:
        LogError: `on_alarm` without a passing verdict.   ScenarioError: a factor or a deviation that is not above 0.
    Example:
        >>> arm, q = aw.load("two-link"), np.tile([0.3, 0.5], (500, 1))  # at rest
        >>> tau = aw.gravity_torques(arm, q[0]) + [5.0, 0.0]  # 5 N m more than the model says
        >>> shadow = aw.shadow.ArmShadow(arm, deviation=0.2)
        >>> alarms = shadow.update(np.arange(500) * 2e-3, q, np.tile(tau, (500, 1)))
        >>> {alarm.joint for alarm in alarms}
        {'shoulder'}
    """

    def __init__(
        self,
        arm: Model | str | os.PathLike[str],
        *,
        record: str | os.PathLike[str] | None = None,
        deviation: Any = None,
        factor: float = FACTOR,
        bandwidths: ShadowBandwidths | None = None,
        held: bool = False,
        on_alarm: Callable[[ShadowAlarm], object] | None = None,
    ):
        if isinstance(arm, (str, os.PathLike)):
            record = record or arm
        arm = as_arm(arm)
        if on_alarm is not None:
            if record is None:
                expected = "the path of the record's file, beside which its verdict stands"
                raise LogError("not known", place="record", expected=expected)
            passing_verdict(record)
        self.arm, self.record, self._on_alarm = arm, record, on_alarm
        self.deviations: Deviations = torque_deviations(arm, record, deviation)
        self.limits = check_factor(factor) * self.deviations.values
        self.observer = MomentumObserver(arm, bandwidths, held, with_kilogram(arm))
        self.last: Residuals | None = None
        self.restart()

    @property
    def alarms(self) -> tuple[ShadowAlarm, ...]:
        """All alarms so far."""
        return tuple(self._watch.alarms)

    @property
    def active(self) -> bool:
        """True while an alarm lasts."""
        return self._watch.active

    @property
    def events(self) -> tuple[ShadowEvent, ...]:
        """Rows that were left out so far because of values that cannot be, and residuals that were not finite."""
        return self.observer.events

    @property
    def judged(self) -> Judged:
        """For how long each joint was judged so far."""
        return self._watch.judged

    def without_rows(self, time: float) -> None:
        """Counts a time [s] in which no rows came as not judged."""
        self._watch.judged += Judged(time, np.full(self.arm.n, time), np.zeros(self.arm.n))

    @property
    def verdict(self) -> Verdict:
        """Verdict on all rows so far."""
        return verdict(self.arm, self.judged, len(self.alarms))

    def restart(self) -> None:
        """Forgets all rows and alarms; to be called before another run."""
        self.observer.restart()
        self._watch = AlarmWatch(tuple(self.arm.names), self.limits)
        self.last = None

    def update(self, t: Any, q: Any, tau: Any, qd: Any = None) -> list[ShadowAlarm]:
        """New alarms raised by further rows; `last` has their residuals, `alarms` the later course of earlier ones.

        Args:
            t: (rows,) [s] increasing.   q: (rows, n) [rad | m].   tau: (rows, n) [N m | N] of the motors, on the joints.
            qd: (rows, n) [rad/s | m/s] if it is measured; None: from q.
                A row with a value or a time that cannot be is left out, and is one of `events`.
        Raises:
            ShapeError: an array of another shape.
        """
        self.last = self.observer.update(t, q, tau, qd)
        raised = self._watch.update(self.last)
        if self._on_alarm is not None:
            for alarm in raised:
                self._on_alarm(alarm)
        return raised


@dataclass(frozen=True, eq=False)
class ShadowRun:
    """Residuals and alarms over one run of a log.

    Attributes:
        run: its name.   residuals: of every row.   alarms, events: in order.   judged: for how long each joint was.
    """

    run: str
    residuals: Residuals
    alarms: tuple[ShadowAlarm, ...]
    events: tuple[ShadowEvent, ...]
    judged: Judged


@dataclass(frozen=True, eq=False)
class Shadow(Result):
    """Result of `shadow_log`.

    Attributes:
        arm: the model, without what the log's torques lack.   log: that was read.   runs: one for each.
        deviations: of the torque residual, with their source.   limits: (n,) [N m | N] of the alarms.   notes: for the user.
    """

    arm: Model
    log: Log
    runs: tuple[ShadowRun, ...]
    deviations: Deviations
    limits: np.ndarray
    notes: tuple[str, ...]

    @property
    def alarms(self) -> tuple[tuple[str, ShadowAlarm], ...]:
        """(run, alarm) of all runs."""
        return tuple((each.run, alarm) for each in self.runs for alarm in each.alarms)

    @property
    def events(self) -> tuple[tuple[str, ShadowEvent], ...]:
        """(run, event) of all runs."""
        return tuple((each.run, event) for each in self.runs for event in each.events)

    @property
    def verdict(self) -> Verdict:
        """Verdict on all runs."""
        judged = sum((each.judged for each in self.runs), Judged.of(self.arm.n))
        return verdict(self.arm, judged, len(self.alarms))

    def rms(self, signal: str = "torque") -> np.ndarray:
        """(n,) RMS of a residual, "torque" or "position", over all rows; NaN without rows."""
        return self._over_rows(signal, lambda values: rms(values, axis=0))

    def largest(self, signal: str = "torque") -> np.ndarray:
        """(n,) largest magnitude of a residual, "torque" or "position"."""
        return self._over_rows(signal, lambda values: np.abs(values).max(axis=0))

    def _over_rows(self, signal: str, measure: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        values = np.concatenate([getattr(each.residuals, signal) for each in self.runs])
        values = values[np.isfinite(values).all(axis=1)]
        return measure(values) if len(values) else np.full(self.arm.n, np.nan)

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.arm.name}: shadow of {self.log.title}"

    @property
    def good(self) -> bool:
        """True without alarms, where practically all was judged."""
        return self.verdict.clean

    def sentences(self) -> list[str]:
        """Verdict, alarms, events and notes."""
        alarms = [f"{name}: {alarm}" for name, alarm in self.alarms]
        return [*self.verdict.lines, *alarms, *event_lines(self.events), *self.notes]

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Writes a page: verdict and alarms, every joint's residuals and limits over time, and where the limits come from.

        Args:
            path: ending in .html.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        return write_shadow(path, self)

    def tables(self) -> list[Table]:
        """A row for each joint: residuals of torque and position, limits, alarms."""
        resting = np.max([each.residuals.resting.max(axis=0, initial=0.0) for each in self.runs], axis=0)
        hidden = np.where(resting > 0.0, resting, np.nan)
        columns = [self.rms(), self.largest(), self.limits, hidden, self.rms("position"), self.largest("position")]
        raised = [sum(alarm.joint == name for _, alarm in self.alarms) for name in self.arm.names]
        units = units_of(self.arm, "torque")
        rows = [
            [name, units[k], *(number(c[k], ".3g") for c in columns), str(raised[k] or "")]
            for k, name in enumerate(self.arm.names)
        ]
        return [Table(f"{self.arm.name} beside {self.log.title}", HEADS, rows, HEADS[:2])]


def shadow_log(
    log: AnyLog,
    arm: AnyArm | None = None,
    *,
    runs: Sequence[str] | None = None,
    deviation: Any = None,
    factor: float = FACTOR,
    bandwidths: ShadowBandwidths | None = None,
    record: str | os.PathLike[str] | None = None,
    progress: Shown = None,
) -> Shadow:
    """Residuals and alarms of a model along a log, computed causally: no row uses a later one.

    Args:
        log: what `read_log` returned, with positions, and torques or currents, of all joints.
        arm: path, name or model; None: the robot that the log names.   runs: names; None: all.
        deviation: (n,) or one number [N m | N], standard deviation of the torque residual; None: `torque_deviations`.
        factor: standard deviations that a residual may reach.   bandwidths: of the observer.
        record: path of the file, where `robot` is a model.   progress: True or None: a bar where it is
            seen; False: none; a function is called with rows done, and all.
    Returns:
        shadow: residuals, alarms and limits.
    Raises:
        LogError: another arm's log, positions or torques that are missing.   ScenarioError: as `ArmShadow`.
        ModelError: an arm without masses, or currents of motors whose constants are not known.
    Example:
        >>> log = "examples/logs/lwa4p/lwa4p.log.toml"
        >>> found = aw.shadow.shadow_log(log, "lwa4p", deviation=5.0)
        >>> len(found.alarms)
        0
    """
    log = as_log(log)
    if arm is None and log.arm is None:
        raise LogError("missing", place="arm", expected="a robot's file, here or in the log", file=log.path)
    if isinstance(arm, (str, os.PathLike)):
        record = record or arm
    arm = log.arm if arm is None else as_arm(arm)
    assert arm is not None
    matched = match(arm, log)
    sources: tuple[Source, ...] = ("tau", "current")
    source: Source | None = next((each for each in sources if each in matched.logged), None)
    if source is None or "q" not in matched.logged:
        what = "no torques or currents" if source is None else "no positions"
        raise LogError(
            f"{what} of all joints", place="signals", expected="positions, and torques or currents", file=log.path
        )
    check_constants(arm, source, log)
    names = [each.name for each in log.runs] if runs is None else [log.run(name).name for name in runs]
    known = torque_deviations(arm, record, deviation)
    limits, order = check_factor(factor) * known.values, matched.columns
    heavier, lacks = with_kilogram(arm), log.lacks if source == "tau" else ()
    observer = MomentumObserver(
        as_logged(arm, lacks),
        bandwidths,
        source in log.held,
        None if heavier is None else as_logged(heavier, lacks),
        arm,
    )
    total, done, found = sum(log.run(name).rows for name in names), 0, []
    with automatic(progress, f"beside {log.path.name}", "rows") as tell:
        for name in names:
            observer.restart()
            watch, parts = AlarmWatch(tuple(arm.names), limits), []
            for block in log.blocks(name, ROWS):
                values = {n: v[:, order] for n, v in block.values.items() if n in matched.logged}
                torques = torques_on_joints(arm, source, values[source], np.zeros_like(values["q"]))
                parts.append(observer.update(block.t, values["q"], torques, values.get("qd")))
                watch.update(parts[-1])
                done += len(block.t)
                tell(min(done, total), total)
            found.append(ShadowRun(name, _joined(parts), tuple(watch.alarms), observer.events, watch.judged))
    return Shadow(arm, log, tuple(found), known, limits, _notes(arm, log, known, record))


def check_factor(factor: float) -> float:
    """Refuses an invalid factor of the limits.

    Raises:
        ScenarioError: not above 0.
    """
    if isinstance(factor, bool) or not isinstance(factor, (int, float)) or not 0.0 < factor < np.inf:
        raise ScenarioError(place="factor", value=factor, expected="a number above 0")
    return factor


def _joined(parts: Sequence[Residuals]) -> Residuals:
    return Residuals(*(np.concatenate([getattr(each, field.name) for each in parts]) for field in fields(Residuals)))


def _notes(arm: Model, log: Log, known: Deviations, record: str | os.PathLike[str] | None) -> tuple[str, ...]:
    """Sentences for the user: where the limits come from, the verdict, and what the log's torques lack."""
    notes = [f"standard deviations of the residuals: {known.source}"]
    if not np.isfinite(known.values).all():
        notes.append("without them no alarm is raised: validate the record with a log of the arm, or state a deviation")
    verdict = verdict_of(record)
    notes.append(
        "no verdict on this record: `armwright validate` makes one" if verdict is None else f"verdict: {verdict}"
    )
    lacks = sorted(log.lacks)
    if lacks:
        notes.append(f"the log says that its torques lack {', '.join(lacks)}: so does the model here")
    if "coulomb" in lacks:
        loose = [body.joint for body in arm.coordinates if body.friction is None or not body.friction.is_dry]
        if loose:
            notes.append(f"the record states no dry friction of {', '.join(loose)}, which may hold them at rest")
    if "gravity" in lacks:
        notes.append("of a payload only its inertia shows in such torques")
    return (*notes, *SUPPORT.notes(arm))
