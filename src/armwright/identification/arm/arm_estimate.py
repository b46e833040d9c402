"""Result of the identification of an arm: base parameters with error bars, and the record that is written from them."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.arm.arm_record import RecordParameters, write_record
from armwright.identification.arm.bootstrap import Bootstrap
from armwright.identification.arm.cutoff import CutoffCurve
from armwright.identification.arm.fit import ArmFit, HeldOut
from armwright.identification.estimate import Estimate, EstimateResult
from armwright.identification.validation.comparison import RecordComparison
from armwright.identification.validation.validate import Validation
from armwright.results.page_parts import definitions, sentence
from armwright.results.table import Table, number

JOINTS = ("joint", "R²", "RMS", "of the torque [%]", "cross-validated [%]", "unit")


@dataclass(frozen=True, eq=False)
class ArmEstimate(EstimateResult):
    """Result of `identify_arm`.

    Attributes:
        estimate: base parameters with covariance, measures by joint, remarks and verdict.   fit: least squares behind it.
        formulas: of the base parameters.   structural: their number by the arm's structure alone, whatever its motion.
        held_out: errors on each part, of fits to the others.
        hold_out: the record judged on the runs that the log holds out, by the measures of `validate`; None where there are none.
        sensitive: names of parameters that leave their 95 % interval at another cut-off.
        record: physically possible parameters for a record; None where it was not asked for.   gears: N of the log, or None.
        cutoffs: held-out errors by the cut-off of the low-pass; None where it was given.
        bootstrap: deviations by blocks of the log; None where it was not asked for.
    """

    estimate: Estimate
    fit: ArmFit
    formulas: tuple[str, ...]
    structural: int
    held_out: tuple[HeldOut, ...]
    hold_out: RecordComparison | None
    sensitive: tuple[str, ...]
    record: RecordParameters | None
    gears: np.ndarray | None
    cutoffs: CutoffCurve | None = None
    bootstrap: Bootstrap | None = None

    @property
    def verdict(self) -> str:
        """ "identified" or "not identified"."""
        return self.estimate.verdict

    def sentences(self) -> list[str]:
        """The verdict, then remarks."""
        return [self.verdict, *map(sentence, self.estimate.remarks)]

    def tables(self) -> list[Table]:
        """Base parameters by their formulas; measures of each joint; the record on the runs held out."""
        parameters, *_ = self.estimate.tables()
        named = [[formula, *row[1:]] for formula, row in zip(self.formulas, parameters.cells, strict=True)]
        joints = []
        for j, body in enumerate(self.fit.equations.model.arm.coordinates):
            held = self.estimate.fit.get(body.joint, {}).get("held_out")
            share = 100.0 * self.fit.rms[j] / self.fit.torque_rms[j] if self.fit.torque_rms[j] > 0 else None
            unit = body.kind.units.torque
            shares = (number(share, ".3g"), number(None if held is None else 100.0 * held, ".3g"))
            joints.append([body.joint, number(self.fit.r2[j]), number(self.fit.rms[j]), *shares, unit])
        found = [replace(parameters, cells=named), Table("joints", JOINTS, joints, ("unit",))]
        return found if self.hold_out is None else [*found, self.hold_out.table()]

    def report(self, path: str | os.PathLike[str], validation: Validation | None = None) -> Path:
        """Writes a page: verdict, what to do next, parameters, correlations, fits, and how base parameters are grouped.

        Args:
            path: ending in .html.   validation: of the record that was written, if it was compared with the log.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        from armwright.identification.validation.report import write_report  # which draws

        formulas = [pair for pair in zip(self.estimate.names, self.formulas, strict=True) if pair[0] != pair[1]]
        grouped, fits = definitions("Regrouping", formulas), self.tables()[1:]
        if self.cutoffs is not None:
            fits.append(self.cutoffs.table(self.fit.equations.model.arm.names))
        return write_report(path, f"{self.estimate.log}: arm", self.estimate, validation, grouped, fits)

    def write(self, output: str | os.PathLike[str], key: str = "fit") -> Path:
        """Writes the robot's record with the fitted links, rotors and friction, source of kind `fit`.

        Links are physically possible and have the fitted base parameters as nearly as that allows; the base parameters
        themselves, with their deviations, stand in `[fits.KEY]`.

        Args:
            output: path of a TOML file.   key: of the source and of the fit.
        Raises:
            IdentificationError: the record's values were not asked for.   OutputError, DescriptionError: as `write_into`.
        """
        if self.record is None:
            raise IdentificationError("no values for a record", place="record", expected="identify_arm(…, record=True)")
        return write_record(self.fit, self.record, self.gears, self.estimate, output, key)
