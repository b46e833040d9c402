"""Identification of an arm: a log of positions and torques → base parameters with error bars → a record."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from armwright.entry import as_arm, as_log, expect
from armwright.errors import IdentificationError, Interrupted, check_known
from armwright.identification.arm.arm_estimate import ArmEstimate
from armwright.identification.arm.arm_record import RecordParameters, record_parameters
from armwright.identification.arm.bootstrap import block_bootstrap
from armwright.identification.arm.closed_loop import Feedback
from armwright.identification.arm.cutoff import CutoffCurve, cutoff_curve
from armwright.identification.arm.fit import HeldOut, cross_validated
from armwright.identification.arm.gear_loss import LossyModel, lossy_model
from armwright.identification.arm.held_out import judged_record
from armwright.identification.arm.methods import METHODS, FittedLog, check_losses, fitted
from armwright.identification.arm.options import ArmTerms, FitRows
from armwright.identification.arm.remarks import with_remarks
from armwright.identification.arm.samples import Stream, stream_of
from armwright.identification.arm.sensitivity import sensitive_parameters
from armwright.identification.arm.separating import sentences
from armwright.identification.arm.torque_model import USUAL_FRICTION, TorqueModel, torque_model
from armwright.identification.estimate import Estimate
from armwright.identification.logs.log import Log
from armwright.identification.validation.comparison import NO_HOLD_OUT
from armwright.model import Model
from armwright.progress import Progress, progress

T = TypeVar("T")
CHECKS = ("cutoff", "bootstrap")
# after the choice of the cut-off; from the third on they check a fit that stands
STAGES = ("fit", "record", "parts held out", "other cut-offs", "bootstrap", "runs held out", "residuals")


def identify_arm(
    log: Log,
    arm: Model | None = None,
    *,
    method: str = "wls",
    friction: Collection[str] = USUAL_FRICTION,
    terms: ArmTerms | None = None,
    rows: FitRows | None = None,
    feedback: Feedback | tuple[Any, Any, float] | None = None,
    forgetting: float = 1.0,
    record: bool = True,
    checks: Collection[str] = ("cutoff",),
) -> ArmEstimate:
    """Masses, rotors and friction of an arm from a log of positions and motor torques, currents or voltages.

    tau = Y(q, q̇, q̈) π  is linear in the parameters; the combinations of them that torques depend on, the base parameters, are
    fitted by least squares to prepared rows, read in blocks. [GautierKhalil1990]  Of an arm whose record has gear efficiencies or
    load-proportional friction, links and friction are those beside this loss (`gear_loss`).

    Args:
        log: what `read_log` returned.   arm: a full record or kinematics alone; None: the log's robot.
        method: least squares "ols"; "wls", every joint weighted by its residuals; "irls" or "tukey", which also let outliers
            count less; "essential", which leaves out what the log hardly tells; "recursive", row by row. Or by a simulated loop:
            "iv", instruments against the bias of feedback; "didim", from torques alone; "cloe", from positions alone.
        friction: terms, of "viscous", "coulomb", "offset", "asymmetric" (Coulomb's level by direction) and "stribeck"; link
            torques, measured behind the gears, have the sensors' zeros in their place.
        terms: springs, a Stribeck speed, gear efficiencies to fit, and terms that the measured torques lack; None: those of the
            log's file, and nothing else.
        rows: runs to fit, cut-off of the low-pass and decimation; None: the log's runs, and a chosen low-pass.
        feedback: of the log's one run, for "iv", "didim" and "cloe"; or (kp, kd, period) of a controller whose reference is not
            known, in whose place the logged positions stand.   forgetting: of "recursive", for each row, at most 1.
        record: also find physically possible values for a record; runs held out judge it, so that then it is found in any case.
        checks: "cutoff", fits at cut-offs 30 % lower and higher; "bootstrap", deviations by blocks of the log ("ols", "wls").
    Returns:
        result: `result.estimate` has the base parameters, `result.write(path)` writes the record.
    Raises:
        IdentificationError: no robot, no torques, too few rows, an unknown term; of gears with loss a method or a torque that
            goes without, an efficiency to fit of which the log hardly says anything.
        LogError: joints of the robot that are not in the log, a filter that the log's rate does not allow.
        Interrupted: Ctrl-C during the checks; `found` holds the result with the checks until then, "not identified".
    Example:
        >>> arm, rng = aw.load("two-link"), np.random.default_rng(0)
        >>> pushes = aw.Schedule(np.arange(16) / 2, rng.uniform(-20, 20, (16, 2)), arm.names)
        >>> run = aw.simulate(aw.Scenario(arm, 8.0, command=pushes, start=[-1.5, 0.0]))
        >>> aw.save(run, "swing.csv")
        >>> log = aw.identification.write_log(run, "swing.csv", "swing.log.toml", arm)
        >>> aw.identification.identify_arm(log, arm, friction=()).verdict
        'identified'
    """
    check_known(IdentificationError, method, METHODS, place="method")
    for name in checks:
        check_known(IdentificationError, name, CHECKS, place="checks")
    terms, rows = ArmTerms() if terms is None else terms, FitRows() if rows is None else rows
    expect(terms, ArmTerms, "terms", "an aw.identification.ArmTerms", IdentificationError)
    expect(rows, FitRows, "rows", "an aw.identification.FitRows", IdentificationError)
    log = as_log(log)
    arm = log.arm if arm is None else as_arm(arm)
    if arm is None:
        expected = "an arm, or kinematics alone, here or in the log's file"
        raise IdentificationError("missing", place="arm", expected=expected)
    stream = stream_of(log, arm, rows.runs, cutoff=rows.cutoff, decimate=rows.decimate)
    lacks = stream.lacks if terms.lacks is None else terms.lacks
    if stream.source == "tau_link":
        arm, friction = _behind_gears(arm, friction)
    model = _model(arm, method, friction, replace(terms, lacks=lacks), stream.gears)
    with progress(f"identifying {arm.name}") as tell:
        # of a lossy arm the columns are linear about the record alone, and no measure of a cut-off
        free = rows.cutoff is None and not isinstance(model, LossyModel)
        curve = cutoff_curve(stream, model, tell, len(STAGES)) if free else None
        guard = _Guard(tell, 0 if curve is None else len(curve.hz))
        stream = stream if curve is None else stream.at(curve.chosen, rows.decimate, curve.reason)
        guard.tell("fit")
        found = fitted(stream, model, method, feedback, forgetting, strict=terms.fit_efficiency != "all")
        stream = replace(stream, moving=found.stuck > 0)
        guard.tell("record")
        values = record_parameters(found.fit, stream.kept) if record or stream.fresh else None
        result = _checked(arm, stream, found, values, method, curve, checks, guard)
    if guard.missing:
        raise Interrupted(f"before these checks: {', '.join(guard.missing)}", found=result)
    return result


class _Guard:
    """Checks of a fit that stands: Ctrl-C ends the one at work and skips those that are left.

    Attributes:
        missing: names of the checks that were not done.
    """

    def __init__(self, progress: Progress, before: int) -> None:
        self.missing: list[str] = []
        self._progress, self._before = progress, before

    def tell(self, stage: str) -> None:
        """Shows that a stage begins."""
        self._progress(self._before + STAGES.index(stage), self._before + len(STAGES))

    def checked(self, stage: str, check: Callable[[], T], skipped: T) -> T:
        """Result of a check, or what stands in its place where it was not done."""
        if not self.missing:
            try:
                self.tell(stage)
                return check()
            except KeyboardInterrupt:
                pass
        self.missing.append(stage)
        return skipped


def _checked(
    arm: Model, stream: Stream, found: FittedLog, values: RecordParameters | None, method: str, curve: CutoffCurve | None,
    checks: Collection[str], guard: _Guard,
) -> ArmEstimate:  # fmt: skip
    """The result of a fit that stands, with its checks; "not identified" if one is missing, which a remark says."""
    fit, by_parts = found.fit, METHODS[method].parts
    held_out: tuple[HeldOut, ...] = ()
    sensitive: tuple[str, ...] = ()
    by_blocks = None
    if by_parts and len(fit.equations.parts) > 1:
        held_out = guard.checked("parts held out", lambda: tuple(cross_validated(fit)), ())
    if by_parts and "cutoff" in checks:
        sensitive = guard.checked("other cut-offs", lambda: sensitive_parameters(stream, fit), ())
    if "bootstrap" in checks:
        by_blocks = guard.checked(
            "bootstrap", lambda: block_bootstrap(found.rows(), fit, stream.seconds, len(stream.filters)), None
        )
    about = (
        f"{METHODS[method].about} of {fit.equations.rows.max()} rows, {arm.n} joints, cut-off {stream.cutoff:.4g} Hz"
    )
    estimate = Estimate(
        tuple(fit.base.names), fit.values, fit.covariance, stream.sha256, about, tuple(fit.base.units),
        condition=fit.condition, log=stream.name, preparation=stream.settings,
    )  # fmt: skip
    comparison, said = None, [NO_HOLD_OUT]
    if values is not None and stream.fresh:
        judged = lambda: judged_record(stream, arm, fit, values, estimate)  # noqa: E731
        comparison, said = guard.checked("runs held out", judged, (None, []))
    result = ArmEstimate(
        estimate,
        fit,
        tuple(fit.base.formulas),
        len(found.structural),
        held_out,
        comparison,
        sensitive,
        values,
        stream.gears,
        curve,
        by_blocks,
    )

    def remarked() -> Estimate:
        directions = sentences(fit, found.rows(), found.base, found.structural)
        return with_remarks(result, found, directions, stream, [*stream.warnings, *said])

    estimate = guard.checked("residuals", remarked, estimate)
    if guard.missing:
        missing = f"not checked, as Ctrl-C stopped the identification: {', '.join(guard.missing)}"
        estimate = replace(estimate, remarks=(*estimate.remarks, missing), verdict="not identified")
    return replace(result, estimate=estimate)


def _behind_gears(arm: Model, friction: Collection[str]) -> tuple[Model, tuple[str, ...]]:
    """The arm as sensors behind its gears see it, without loss, and their zeros in place of friction.

    Raises:
        IdentificationError: friction was asked for.
    """
    if tuple(friction) != USUAL_FRICTION:
        expected = "none: torques behind the gears are without the motors' friction"
        raise IdentificationError(place="friction", value=", ".join(friction), expected=expected)
    return arm.replace(efficiency=None), ("zero",)


def _model(
    arm: Model, method: str, friction: Collection[str], terms: ArmTerms, gears: np.ndarray | None
) -> TorqueModel:
    """The torque model of an arm, with its gear loss if it has one.

    Raises:
        IdentificationError: unknown terms, or gear loss that the method does not know.
    """
    lacks, speed = terms.lacks or (), terms.stribeck_speed
    model = torque_model(
        arm, friction=friction, springs=terms.springs, lacks=lacks, stribeck_speed=speed, gears=gears, loads=True
    )
    lossy = lossy_model(model, terms.fit_efficiency)
    if lossy is None:
        return model
    check_losses(lossy, method, lacks)
    return lossy
