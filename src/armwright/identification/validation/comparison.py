"""A fitted record beside the record that it replaces, on runs that were held out, by the measures of `validate`.

Both records predict the same rows: the same filter, the same rows at rest left out. With e₀ the residuals of the record that came
in and e those of the fitted one, over the rows in which a joint moves, the fitted record predicts worse if

    mean e² − mean e₀² > max(√2 t s₀ + d, 1e-4 var y)

s₀ is the standard deviation of mean e₀², from the means of 20 consecutive batches of rows, which are independent as long as the
residuals' correlation is shorter than a batch [LawKelton2000]; t is the 99 % point of Student's distribution, √2 as two runs of
this length differ by chance. d is what the fit's own deviations add on these rows, where its covariance is known, for residuals
no larger than e₀: those of a model that lacks an effect are no noise. An error of 1 % of the signal's standard deviation is small
beside every calibration, and about what filters leave without noise.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import stats

from armwright.errors import ArmwrightError
from armwright.fitting.measures import Agreement
from armwright.identification.estimate import Estimate
from armwright.identification.logs.log import Log
from armwright.identification.logs.row_checks import runs_at_rest
from armwright.identification.validation.joint_measures import JointMeasures, moving_rows
from armwright.identification.validation.prediction import Quantity
from armwright.identification.validation.validate import Validation, validate
from armwright.model import Model
from armwright.results.table import Table, number

BATCHES = 20
LEAST = 8  # rows of a batch; shorter runs have fewer batches
CERTAIN = 0.99
NEGLIGIBLE = 1e-4  # of the signal's variance
LEAST_HELD_OUT = 0.5  # R² of a joint that moves, on rows that were not fitted, for "identified"
HELD_OUT = " (held out)"  # behind a quantity and a joint, among the measures of a fit
BEFORE = " (held out, by the record before)"
NO_HOLD_OUT = (
    'no run is held out: mark one use = "hold-out" in the log, and the fitted record is judged there, beside the one that it '
    "replaces"
)
NO_VERDICT = "the runs held out do not judge the record"


class FitNoise(NamedTuple):
    """Mean square error that the deviations of a fit make, and mean square of the residual that these deviations come from."""

    error: float
    residual: float


HEADS = ("joint", "quantity", "R²", "RMS", "R² before", "RMS before", "unit", "")


@dataclass(frozen=True)
class Compared:
    """One quantity of one joint, predicted by two records on the same rows.

    Attributes:
        joint, quantity, unit.   written: of the fitted record.   before: of the one that it replaces; None: it predicts nothing.
        explained: largest RMS of the fitted record's residual that noise explains, in the unit; NaN without `before`.
    """

    joint: str
    quantity: Quantity
    unit: str
    written: Agreement
    before: Agreement | None
    explained: float

    @property
    def is_worse(self) -> bool:
        """True if the fitted record predicts worse by more than noise explains."""
        return self.before is not None and not self.written.rms <= self.explained

    def __str__(self) -> str:
        assert self.before is not None
        return (
            f"{self.joint}: on the runs held out the fitted record predicts the {self.quantity} worse than the record that it "
            f"replaces: RMS of the residual {self.written.rms:.3g} instead of {self.before.rms:.3g} {self.unit}, "
            f"R² {self.written.r2:.3f} instead of {self.before.r2:.3f}; noise explains up to {self.explained:.3g} {self.unit}"
        )


@dataclass(frozen=True, eq=False)
class RecordComparison:
    """A fitted record judged on the runs held out, beside the record that it replaces.

    Attributes:
        written: validation of the fitted record.   before: of the record that came in; None if it predicts nothing.
        rows: every judged quantity of every joint that moves.   reason: there is no `before`, in words; "" if there is one.
    """

    written: Validation
    before: Validation | None
    rows: tuple[Compared, ...]
    reason: str = ""

    def table(self) -> Table:
        """A row for each quantity of each joint: R² and RMS of both records."""
        rows = []
        for each in self.rows:
            both = ((a.r2, a.rms) if a else (None, None) for a in (each.written, each.before))
            measures = (number(value) for pair in both for value in pair)
            rows.append([each.joint, each.quantity, *measures, each.unit, "worse" if each.is_worse else ""])
        return Table("the record on the runs held out", HEADS, rows, ("quantity", "unit", ""))

    @property
    def worse(self) -> list[str]:
        """A sentence for each quantity that the fitted record predicts worse."""
        return [str(each) for each in self.rows if each.is_worse]

    @property
    def remarks(self) -> list[str]:
        """A sentence if there was nothing to compare with."""
        return [f"runs held out are predicted by the fitted record alone: {self.reason}"] if self.reason else []

    @property
    def measures(self) -> dict[str, dict[str, float]]:
        """Measures of both records, by quantity and joint, for an estimate."""
        found = {}
        for each in self.rows:
            found[f"{each.quantity} of {each.joint}{HELD_OUT}"] = each.written.by_name
            if each.before is not None:
                found[f"{each.quantity} of {each.joint}{BEFORE}"] = each.before.by_name
        return found


def compare_records(
    written: Model, before: Model | None, log: Log, runs: Sequence[str], *, simulation: bool = True, reason: str = "",
    noise: Mapping[str, FitNoise] | None = None, cutoff: float | None = None,
) -> RecordComparison:  # fmt: skip
    """Both records on some runs of a log, by the quantities that `validate` judges by default.

    Args:
        written: the fitted arm.   before: the arm that came in; None: there was none, for this reason.   log: with these runs.
        runs: names.   simulation: False: torques alone.
        noise: of the fit, by joint, on these rows; None: not known.   cutoff: of both in Hz; None: what each would take.
    Raises:
        ArmwrightError: as `validate`, of the fitted record; if the other one cannot predict, its error is the `reason`.
    """
    after = validate(written, log, runs=runs, simulation=simulation, cutoff=cutoff, progress=False)
    first = None
    if before is not None:
        try:
            first = validate(before, log, runs=runs, simulation=simulation, cutoff=cutoff, progress=False)
        except ArmwrightError as error:
            reason = f"the record that came in does not predict them, {error}"
    judged = {check.quantity for check in after.checks}
    rows = tuple(
        _compared(after, first, each, noise or {}) for each in after.measures if each.quantity in judged and each.runs
    )
    return RecordComparison(after, first, rows, reason)


def judged_by(estimate: Estimate, comparison: RecordComparison, doubts: Sequence[str] = ()) -> Estimate:
    """The estimate with a comparison's measures and remarks; a worse record, or doubts about it, make it "not identified"."""
    doubts = [*doubts, *comparison.worse]
    return replace(
        estimate,
        fit={**estimate.fit, **comparison.measures},
        remarks=(*estimate.remarks, *comparison.remarks, *doubts),
        verdict="not identified" if doubts else estimate.verdict,
    )


def judged_on_torques(
    estimate: Estimate, written: Callable[[], Model], before: Model, log: Log, joints: Collection[str]
) -> Estimate:
    """The estimate judged by the torques of the runs held out, which its record and the one before predict.

    Args:
        estimate: that says nothing of these runs.   written: makes the arm with it.   before: the arm that came in.
        log: with runs held out.   joints: names of those whose torque the record is to explain.
    """
    try:
        comparison = compare_records(written(), before, log, list(log.hold_out), simulation=False)
    except ArmwrightError as error:
        return replace(estimate, remarks=(*estimate.remarks, f"{NO_VERDICT}: {error}"))
    return judged_by(estimate, comparison, unexplained(joints, comparison))


def unexplained(joints: Collection[str], comparison: RecordComparison) -> list[str]:
    """Sentences about moving joints whose torque the fitted record predicts poorly on the runs held out."""
    r2s = {each.joint: each.written.r2 for each in comparison.rows if each.quantity == "torque"}
    return poorly_predicted(joints, r2s, "on the runs held out")


def poorly_predicted(joints: Collection[str], r2s: Mapping[str, float], where: str) -> list[str]:
    """Sentences about joints, by their names, with R² of the torque below `LEAST_HELD_OUT` on such rows, in words."""
    return [
        f"{joint}: R² {r2s[joint]:.2f} {where}, below {LEAST_HELD_OUT:g}: its torque is not explained by this model"
        for joint in joints
        if joint in r2s and r2s[joint] < LEAST_HELD_OUT
    ]


def _compared(
    after: Validation, first: Validation | None, found: JointMeasures, noise: Mapping[str, FitNoise]
) -> Compared:
    joint, quantity = found.joint, found.quantity
    own = [] if first is None else [each for each in first.measures if (each.joint, each.quantity) == (joint, quantity)]
    if first is None or not own or not own[0].runs or own[0].diverged:
        return Compared(joint, quantity, found.unit, found.overall, None, np.nan)
    column, still = first.arm.names.index(joint), runs_at_rest(first.log, joint, first.runs)
    measured, predicted = moving_rows([each for each in first.predictions if each.quantity == quantity], column, still)
    explained = largest_explained(measured - predicted, measured, noise.get(joint))
    return Compared(joint, quantity, found.unit, found.overall, own[0].overall, 0.0 if found.diverged else explained)


def largest_explained(residual: np.ndarray, measured: np.ndarray, noise: FitNoise | None = None) -> float:
    """Largest RMS on these rows that noise explains of a record as good as the one with this residual.

    Args:
        residual: e₀ (rows,) of consecutive rows.   measured: y (rows,).   noise: of the fit on these rows.
    """
    squares = residual**2
    count = int(np.clip(len(squares) // LEAST, 1, BATCHES))
    means = np.array([each.mean() for each in np.array_split(squares, count)])
    spread = stats.t.ppf(CERTAIN, count - 1) * means.std(ddof=1) / count**0.5 if count > 1 else np.inf
    added = 0.0 if noise is None else noise.error * min(1.0, squares.mean() / noise.residual)
    return float(np.sqrt(squares.mean() + max(2**0.5 * spread + added, NEGLIGIBLE * measured.var())))
