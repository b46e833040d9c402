"""Validation of a record against a log: predictions, measures of every joint, and comparison with the limits."""

from __future__ import annotations

import datetime
import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armwright.description import builtin_names
from armwright.entry import as_log, expect
from armwright.errors import ArmwrightError, LogError
from armwright.identification.arm.torque_model import MEASURED
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import (
    Preparation,
    choose_preparation,
    leaving_rows,
    measured_limits,
    shared_preparations,
    stored_preparations,
)
from armwright.identification.logs.prepared import logged_motion
from armwright.identification.logs.row_checks import runs_at_rest
from armwright.identification.logs.torques import Source
from armwright.identification.validation.free_simulation import WINDOW, driving_signal, simulate_log, simulate_scenario
from armwright.identification.validation.joint_measures import JointMeasures, joint_measures
from armwright.identification.validation.limits import DEFAULT, Check, Limits, check_limits, checks_of, read_limits
from armwright.identification.validation.match import Match, match
from armwright.identification.validation.prediction import Prediction, Quantity
from armwright.identification.validation.torque import as_logged, predict_torque
from armwright.kernels.compiled import compile_arm
from armwright.model import Model
from armwright.model.load import load
from armwright.progress import Shown, automatic
from armwright.reading import read_file
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.simulation.scenario import Scenario

SUPPORT = replace(
    MEASURED,
    consumer="validate",
    approximated={name: f"in predicted torques, {how}" for name, how in MEASURED.approximated.items()},
    without_effect={
        "brakes": "they are released",
        **dict.fromkeys(("servo", "servo counts"), "logged voltages, currents or torques act behind its loop"),
    },
)

QUANTITIES: tuple[Quantity, ...] = ("torque", "position", "speed")
HEADS = ("joint", "quantity", "R²", "fit %", "VAF %", "RMS", "unit", "runs from … to", "limit")


@dataclass(frozen=True, eq=False)
class Validation(Result):
    """Result of `validate`; printed, it is a table.

    Attributes:
        arm: the record's model.   scenario: the closed loop that was compared; None: the arm alone.
        record: path of the record or scenario; None: built in, or made in Python.   record_sha256: of it; "" without a path.
        log: what was compared with.   runs: names.   held_out: whether these were kept from fitting.
        predictions: of every quantity and run.   measures: of every quantity and joint.
        limits: that were asked for.   by_default: whether they are the default ones.   checks: each limit that was judged.
        notes: what belongs to the numbers, one sentence each.   date: ISO 8601.
    """

    arm: Model
    scenario: Scenario | None
    record: Path | None
    record_sha256: str
    log: Log
    runs: tuple[str, ...]
    held_out: bool
    predictions: tuple[Prediction, ...]
    measures: tuple[JointMeasures, ...]
    limits: Limits
    by_default: bool
    checks: tuple[Check, ...]
    notes: tuple[str, ...]
    date: str

    @property
    def passed(self) -> bool:
        """True if at least one limit was judged and all judged limits are kept."""
        return bool(self.checks) and all(check.passed for check in self.checks)

    @property
    def verdict(self) -> str:
        """The verdict as one sentence."""
        failed = [check for check in self.checks if not check.passed]
        if not self.checks:
            return "fails its limits: nothing moved that a limit could judge"
        if not failed and self.unjudged:
            count, names = len(self.checks), ", ".join(self.unjudged)
            return f"passes: all {count} limits that could be judged are kept; not judged: {names}"
        if not failed:
            return f"passes: all {len(self.checks)} limits are kept"
        joints = list(dict.fromkeys(check.joint for check in failed))
        return f"fails its limits: {len(failed)} of {len(self.checks)}, for {', '.join(joints)}"

    @property
    def unjudged(self) -> tuple[str, ...]:
        """Names of the joints without a judged limit: they rested, or what the limits are of was not logged."""
        judged = {check.joint for check in self.checks}
        return tuple(name for name in self.arm.names if name not in judged)

    def of(self, quantity: str, joint: str) -> JointMeasures:
        """Measures of one quantity of one joint.

        Raises:
            LogError: there are none.
        """
        for each in self.measures:
            if (each.quantity, each.joint) == (quantity, joint):
                return each
        known = [f"{each.quantity} of {each.joint}" for each in self.measures]
        raise LogError("not predicted", value=f"{quantity} of {joint}", choices=known)

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.arm.name}: validation"

    @property
    def good(self) -> bool:
        """True if it passes."""
        return self.passed

    def sentences(self) -> list[str]:
        """The verdict, then notes and remarks on joints."""
        remarks = [f"{each.joint}, {each.quantity}: {remark}" for each in self.measures for remark in each.remarks]
        return [self.verdict, *self.notes, *remarks]

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Writes a page: verdict, measures, plots of every joint, method.

        Args:
            path: ending in .html.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        from armwright.identification.validation.report import write_report  # which draws

        return write_report(path, f"{self.arm.name}: validation", validation=self)

    def tables(self) -> list[Table]:
        """A row for each quantity and joint."""
        rows = []
        for each in self.measures:
            a, checks = each.overall, [c for c in self.checks if (c.joint, c.quantity) == (each.joint, each.quantity)]
            low, high = each.spread
            forms = (".3f", ".1f", ".1f", ".4g")
            values = [*map(number, (a.r2, a.fit, a.vaf, a.rms), forms)] if each.runs else ["at rest", "", "", ""]
            spread = f"{low:.3g} … {high:.3g}" if len(each.runs) > 1 else ""
            judged = "; ".join(("" if c.passed else "FAILS ") + str(c) for c in checks)
            rows.append([each.joint, each.quantity, *values, each.unit, spread, judged])
        return [Table(self.heading, HEADS, rows, (HEADS[1], HEADS[6], HEADS[8]))]


def validate(
    arm: Any,
    log: Any,
    *,
    limits: Any = None,
    runs: Sequence[str] | None = None,
    window: float | None = None,
    simulation: bool = True,
    preparation: Preparation | None = None,
    cutoff: float | None = None,
    record: str | os.PathLike[str] | None = None,
    progress: Shown = None,
) -> Validation:
    """Torque prediction and free simulation of an arm against a log, measured for every joint and judged by limits.

    Judged are the runs that the log marks `use = "hold-out"`; without any, all runs, and a note says so. By default torques
    need R² ≥ 0.9; where no torque or current is logged, or currents and voltages are, motions need a fit of 70 %.

    Args:
        arm: name or path of a robot, a `Model`, or a `Scenario`, whose own run is then compared instead of a free simulation.
        log: path of a `*.log.toml`, or what `read_log` returned.   limits: path of a TOML file or its tables; None: the default.
        runs: names, instead of the choice above.
        window: [s] after which a free simulation starts again from the log; default 0.5 s, or whole stretches of logged speeds
            without positions.
        simulation: False leaves the simulation out.
        preparation: of the log; None: as of the record's last fit that states one, else what `choose_preparation` says.
        cutoff: of the low-pass in Hz, instead of that; of a run too short for it the next one that leaves rows.
        record: path of what `arm` was read from, where that is a `Model` or a `Scenario`.
        progress: True or None: a bar where it is seen; False: none; a function is called with steps done, and all.
    Returns:
        validation: `passed`, `measures`, `checks`, `notes`; printed, a table.
    Raises:
        LogError: an arm that does not match the log, a log without what is needed, unknown joints in the limits.
        ArmwrightError: an invalid record or scenario, or one that cannot run.
    Example:
        >>> arm, rng = aw.load("two-link"), np.random.default_rng(0)
        >>> pushes = aw.Schedule(np.arange(16) / 2, rng.uniform(-20, 20, (16, 2)), arm.names)
        >>> run = aw.simulate(aw.Scenario(arm, 8.0, command=pushes, start=[-1.5, 0.0]))
        >>> aw.save(run, "swing.csv")
        >>> log = aw.identification.write_log(run, "swing.csv", "swing.log.toml", arm)
        >>> aw.identification.validate(arm, log, simulation=False).verdict
        'passes: all 2 limits are kept'
    """
    expect(preparation, Preparation | None, "preparation", "an aw.identification.Preparation", LogError)
    with automatic(progress, "validating") as tell:
        scenario = arm if isinstance(arm, Scenario) else None
        model, path = _record(arm, record)
        data = as_log(log)
        asked = DEFAULT if limits is None else read_limits(limits)
        check_limits(asked, model, limits if isinstance(limits, (str, os.PathLike)) else "")
        chosen, held_out, notes = _runs(data, runs)
        matched = match(model, data)
        notes += map(str, data.warnings)
        tell(0, 3)
        given = None if preparation is None else dict.fromkeys(chosen, preparation)
        prepared = given or _preparations(model, data, chosen, cutoff)
        predictions, remarks = _torques(model, data, matched, chosen, prepared)
        notes += remarks
        tell(1, 3)
        if simulation or scenario is not None:
            predictions += _motions(model, scenario, data, matched, chosen, window, bool(predictions), notes)
        if not predictions:
            expected = "torques, currents or voltages beside positions or speeds"
            raise LogError("; ".join(notes) or "nothing to predict", place="signals", expected=expected, file=data.path)
        tell(2, 3)
        measures = _measures(model, data, chosen, predictions)
        default = None if limits is not None else _default_order(matched.source, scenario is not None)
        checks = _checks(asked, measures, default, matched.source == "current" and "voltage" in matched.signals)
        if any(each.at_rest for each in measures if each.quantity == "torque"):
            notes.append(
                "rows in which a joint stands still are left out of its torque's measures: friction there has any value"
            )
        tell(3, 3)
    return Validation(
        model,
        scenario,
        path,
        "" if path is None else record_sha256(path, scenario),
        data,
        tuple(chosen),
        held_out,
        tuple(predictions),
        tuple(measures),
        asked,
        limits is None,
        tuple(checks),
        tuple(notes),
        datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    )


def _torques(
    model: Model, log: Log, matched: Match, runs: Sequence[str], prepared: Mapping[str, Preparation]
) -> tuple[list[Prediction], list[str]]:
    """Torque predictions of runs, and notes on them or why there are none."""
    if reason := matched.without_torques(model):
        return [], [f"{reason}: no torque prediction"]
    dyn = compile_arm(as_logged(model, matched.lacks))
    motions = (logged_motion(log, run, prepared[run]) for run in runs)
    predictions = [predict_torque(model, log, motion, dyn, matched) for motion in motions]
    return predictions, [*_torque_notes(model, matched.lacks, predictions[0].rate), *_cut_off(predictions)]


def _cut_off(predictions: Sequence[Prediction]) -> list[str]:
    """Sentences about joints whose torques are compared only where no limit cuts them off."""
    known = np.concatenate([np.isfinite(each.measured) for each in predictions])
    return [
        f"{joint}: {1.0 - share:.0%} of its torques are not compared: cut off at a limit, or filtered together with such"
        for joint, share in zip(predictions[0].joints, known.mean(axis=0), strict=True)
        if 0.0 < share < 1.0
    ]


def _preparations(model: Model, log: Log, runs: Sequence[str], cutoff: float | None) -> dict[str, Preparation]:
    """Preparations of the runs: with a cut-off that was asked for, as of the record's last fit, or as the log suggests."""
    if cutoff is not None:
        return {run: leaving_rows(log, run, choose_preparation(log, run, cutoff=cutoff)) for run in runs}
    fits = () if model.description is None else model.description.fits.values()
    stored = [fit.preparation for fit in fits if fit.preparation is not None]
    return stored_preparations(log, runs, stored[-1].model_dump()) if stored else shared_preparations(log, runs)


def _measures(model: Model, log: Log, runs: Sequence[str], predictions: Sequence[Prediction]) -> list[JointMeasures]:
    """Measures of every quantity and joint that has numbers; torques of some joints may not be logged."""
    return [
        joint_measures(group, k, runs_at_rest(log, joint, runs))
        for quantity in QUANTITIES
        for group in [_logged(predictions, quantity)]
        for k, joint in enumerate(model.names)
        if any(np.isfinite(each.measured[:, k]).any() for each in group)
    ]


def record_sha256(path: Path, scenario: Scenario | None = None) -> str:
    """Checksum of a record's file; for a scenario, of all files it names."""
    if scenario is not None and scenario.document is not None:
        return hashlib.sha256(scenario.document.encode()).hexdigest()
    return hashlib.sha256(read_file(path, "a record", LogError)).hexdigest()


def _record(arm: Any, record: str | os.PathLike[str] | None) -> tuple[Model, Path | None]:
    """The model, and the path of what it was read from; None of a built-in one, or one made in Python."""
    path = None if record is None else Path(record)
    if isinstance(arm, Scenario):
        return arm.arm, path
    if isinstance(arm, Model):
        return arm, path
    return load(arm), path or (None if arm in builtin_names() else Path(arm))


def _runs(log: Log, names: Sequence[str] | None) -> tuple[list[str], bool, list[str]]:
    """Runs to judge, whether they were held out, and a note where they were not.

    Raises:
        LogError: no such run.
    """
    if isinstance(names, str):
        names = [names]
    chosen = [log.run(name).name for name in names] if names is not None else list(log.hold_out)
    if names is not None and not chosen:
        raise LogError(place="runs", value=list(names), expected="one at least", choices=[run.name for run in log.runs])
    if chosen and all(log.run(name).use == "hold-out" for name in chosen):
        return chosen, True, []
    flatter = "the measures flatter a record that was fitted to them"
    if chosen:
        return chosen, False, [f"some judged runs are marked for fitting: {flatter}"]
    note = f'no run is marked use = "hold-out": all are judged, and {flatter}'
    return [run.name for run in log.runs], False, [note]


def _motions(
    arm: Model,
    scenario: Scenario | None,
    log: Log,
    matched: Match,
    runs: Sequence[str],
    window: float | None,
    has_torques: bool,
    notes: list[str],
) -> list[Prediction]:
    """Simulated motions of all runs; none, with a note, where nothing drives them.

    Raises:
        LogError: an error of the log that no torque prediction makes up for.
    """
    if scenario is not None:
        notes.append("simulation: the scenario's own run, its time 0 at the first row of each run")
        return simulate_scenario(scenario, log, runs)
    driving = driving_signal(arm, matched)
    if driving is None:
        notes.append("no voltages, currents or torques of all joints are logged: no simulation")
        return []
    if any(np.isfinite(measured_limits(log, run, driving)).any() for run in runs):
        notes.append(
            f"simulation: {driving} as logged, also where a limit cuts it off; the motion is that of a drive at its limit"
        )
    try:
        chosen = (WINDOW if "q" in matched.logged else None) if window is None else window
        found = simulate_log(arm, log, runs, chosen)
    except ArmwrightError as error:
        if not has_torques or window is not None:
            raise
        notes.append(f"no simulation: {error}")
        return []
    notes.append(found[0].how if found else "no simulation: positions and speeds of some joints are not logged")
    return found


def _logged(predictions: Sequence[Prediction], quantity: Quantity) -> list[Prediction]:
    """Predictions of one quantity, a run each."""
    return [each for each in predictions if each.quantity == quantity]


def _torque_notes(arm: Model, lacks: Sequence[str], rate: float) -> list[str]:
    """Notes on predicted torques: terms that the log lacks, the filter, and effects that inverse dynamics leaves out."""
    said = [f"the logged torques lack {', '.join(lacks)}, as the log says: the record is compared without"] * bool(
        lacks
    )
    rows = f"a row every {1e3 / rate:.3g} ms"
    return [*said, f"torque prediction: signals filtered without delay, {rows}", *SUPPORT.notes(arm)]


def _default_order(source: Source | None, closed_loop: bool) -> tuple[Quantity, ...]:
    """Quantities in the order in which the default limits judge the first that was predicted.

    Torques where they or currents were logged, else positions, else speeds.
    """
    return ("position", "speed", "torque") if closed_loop or source == "voltage" else QUANTITIES


def _checks(
    limits: Limits, measures: Sequence[JointMeasures], default: Sequence[Quantity] | None, both_logged: bool
) -> list[Check]:
    """Every limit against its measure; joints at rest are not judged.

    Args:
        limits: asked for.   measures: of all joints.   default: order of the default limits; None: all quantities are judged.
        both_logged: currents and voltages. Then both judge by default: currents masses and friction, the motion under the
            voltages also R and Ke.
    Raises:
        LogError: limits of a quantity that was not predicted.
    """
    found = list(dict.fromkeys(each.quantity for each in measures))
    judged = list(QUANTITIES) if default is None else [each for each in default if each in found][:1]
    if default is not None and both_logged:
        judged += [each for each in ("position", "speed") if each in found][:1]
    for quantity in QUANTITIES if default is None else ():
        if limits.limited(quantity) and quantity not in found:
            raise LogError("was not predicted for this log", place="limits", value=quantity, choices=found)
    return [
        check
        for each in measures
        if each.quantity in judged and each.runs
        for limit in [limits.of(each.joint, each.quantity, each.unit)]
        for check in checks_of(limit, each.joint, each.quantity, each.overall, each.diverged > 0)
    ]
