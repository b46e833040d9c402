"""Result of a kinematic calibration: corrections with deviations, errors of poses held out, and the record."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.description.paths import path_name
from armwright.identification.estimate import Estimate
from armwright.identification.geometry.fitting import GeometryFit, Noise
from armwright.identification.geometry.problem import ROTATION
from armwright.identification.geometry.record import GeometryRecord
from armwright.results.page_parts import definitions, sentence, shown_table
from armwright.results.result import BLUE, Result
from armwright.results.svg import ink_axes
from armwright.results.table import Table, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ORANGE = "#d9822b"  # seen on white and on black


ERRORS = {
    "record": "record",
    "calibrated": "calibrated",
    "most": "largest",
    "record_all": "record, outliers too",
    "calibrated_all": "calibrated, outliers too",
}


@dataclass(frozen=True)
class HeldOutError:
    """Errors of one kind of measurement: rms lengths in m, of rotations in rad.

    Attributes:
        group: "position", "rotation" or "distance".   fit: of the calibrated arm on all poses, which it was fitted to.
        record, calibrated: of poses held out, with the record as it is and calibrated, of those that count.
        record_all, calibrated_all: the same of all poses, those that are far off included.   most: the largest that counts.
    """

    group: str
    fit: float
    record: float
    calibrated: float
    record_all: float
    calibrated_all: float
    most: float


@dataclass(frozen=True)
class TriedTerm:
    """A further term of the geometry, and whether poses held out are predicted better with it.

    Attributes:
        term: its name.   found: True if it lowers their mean square by more than two standard errors, beside those found before.
        without, held_out: rms of a coordinate without and with it [m].   values: name, value, deviation and unit of each number.
    """

    term: str
    found: bool
    without: float
    held_out: float
    values: tuple[tuple[str, float, float, str], ...]


@dataclass(frozen=True, eq=False)
class Calibration(Result):
    """Result of `calibrate`.

    Attributes:
        estimate: corrections of the identifiable directions with covariance, remarks and verdict.   fit: behind it.
        errors: by kind of measurement.   noise: variances of the measurements' errors, from what the fit leaves.
        tried_priors: held-out rms of a coordinate [m] by the strength σ/τ of the prior.   tried_terms: that were not asked for.
        by_pose: (2, poses) rms error of each pose held out, of the record as it is and calibrated [m].
    """

    estimate: Estimate
    fit: GeometryFit
    errors: tuple[HeldOutError, ...]
    noise: Noise
    tried_priors: Mapping[float, float]
    tried_terms: tuple[TriedTerm, ...]
    by_pose: np.ndarray

    @property
    def verdict(self) -> str:
        """ "identified" or "not identified"."""
        return self.estimate.verdict

    @property
    def good(self) -> bool:
        """True if poses held out are predicted better than by the record as it is, by two standard errors of their squares."""
        return self.estimate.good

    @property
    def formulas(self) -> tuple[str, ...]:
        """Combinations of corrections that the numbers stand for."""
        return tuple(self.fit.setting.grouped.formulas)

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.estimate.log}: corrections of {self.fit.setting.arm.name}"

    def sentences(self) -> list[str]:
        """The verdict, then remarks."""
        return [self.verdict, *map(sentence, self.estimate.remarks)]

    def tables(self) -> list[Table]:
        """Corrections; errors; terms that were tried."""
        estimate, setting, rows = self.estimate, self.fit.setting, []
        columns = zip(setting.kept, setting.grouped.names, estimate.values, estimate.std, strict=True)
        for column, name, value, std in columns:
            if column.joint:
                share = number(abs(value) / std if std > 0 else None, ".1f")
                rows.append([name, number(value, ".4g"), number(std, ".2g"), column.unit, share])
        heads = ("correction", "value", "± std", "unit", "|value| / std")
        found = [Table(self.heading, heads, rows, ("unit",))]
        errors = [
            [each.group, *(number(1e3 * getattr(each, key), ".3g") for key in ERRORS), unit]
            for each in self.errors
            for unit in ("mrad" if each.group == ROTATION else "mm",)
        ]
        words = ("rms, poses held out", *ERRORS.values(), "unit")
        found.append(Table("errors", words, errors, ("unit",)))
        terms = []
        for each in self.tried_terms:
            both = (number(1e3 * rms, ".4g") for rms in (each.without, each.held_out))
            terms.append([each.term, "found" if each.found else "not found", *both])
        if terms:
            heads = ("further term", "", "rms of a coordinate, held out: without [mm]", "with it [mm]")
            found.append(Table("terms that were tried", heads, terms, ("",)))
        values = [each for term in self.tried_terms if term.found for each in term.values]
        seen = [[name, number(value, ".4g"), number(std, ".2g"), unit] for name, value, std, unit in values]
        if seen:
            found.append(Table("of the terms that were found", ("number", "value", "± std", "unit"), seen, ("unit",)))
        return found

    def frames(self) -> Table:
        """Measuring frame, points of the tool and points that do not move: numbers of the named frames that the record gets."""
        joints = tuple(f"{path_name(joint.name)}." for joint in self.fit.setting.arm.record.joints)
        record = GeometryRecord(self.fit, "geometry").estimate(self.estimate)
        numbers = zip(record.names, record.values, record.std, record.units, strict=True)
        rows = [
            [name, number(value, ".6g"), number(std, ".2g"), unit]
            for name, value, std, unit in numbers
            if name.endswith("]") and not name.startswith(joints)
        ]
        return Table("frames", ("number", "value", "± std", "unit"), rows, ("unit",))

    def sections(self) -> list[tuple[str, str]]:
        """Frames, and what each correction stands for."""
        pairs = zip(self.fit.setting.grouped.names, self.formulas, strict=True)
        grouped = definitions("Regrouping", [pair for pair in pairs if pair[0] != pair[1]])
        frames = self.frames()
        return [("Frames", shown_table(frames)), *grouped] if frames.cells else grouped

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws the error of every pose held out, with the record as it is and calibrated; crosses do not count."""
        axes, poses = figure.subplots(), np.arange(1, self.by_pose.shape[1] + 1)
        out = np.isin(poses - 1, self.fit.outliers)
        axes.vlines(poses, *(1e3 * self.by_pose), color=quiet, linewidth=0.8)
        names = (("record as it is", ORANGE, "record"), ("calibrated", BLUE, "calibrated"))
        for values, (words, colour, key) in zip(1e3 * self.by_pose, names, strict=True):
            label = f"{words}, held out: rms {1e3 * getattr(self.errors[0], key):.3g} mm"
            axes.plot(poses[~out], values[~out], "o", color=colour, label=label)
            axes.plot(poses[out], values[out], "x", color=colour)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("pose", color=ink)
        axes.set_ylabel("error [mm]", color=ink)
        ink_axes(axes, ink)
        figure.legend(loc="outside upper right", ncols=2, frameon=False, labelcolor=ink)

    def write(self, output: str | os.PathLike[str], key: str = "geometry") -> Path:
        """Writes the robot's record with the calibrated geometry, numbers of kind `fit`.

        Rows and frames of joints have new numbers, and so has the frame whose pose was measured. The measuring frame, points on
        the tool and points that do not move become named frames. All corrections with their deviations stand in `[fits.KEY]`.

        Args:
            output: path of a TOML file.   key: of the source and of the fit.
        Returns:
            path: of the file.
        Raises:
            IdentificationError: corrections that a record has no number for: eccentricity and compliance.
            OutputError, DescriptionError: as `write_into`.
        """
        return GeometryRecord(self.fit, key).write(self.estimate, output)
