"""Estimate: the result of every fit to a log, and the robot file into which it is written."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import InlineTable

from armwright.description import builtin_names
from armwright.description.database import parse, read_description
from armwright.description.paths import quantities, split_path, unit_at
from armwright.description.record_of import Arm, record_of
from armwright.description.robot import Link, NamedFrame, RobotDescription, Source
from armwright.description.toml_file import read_text
from armwright.description.writer import for_folder, to_toml
from armwright.entry import expect
from armwright.errors import DescriptionError, IdentificationError, ModelError, OutputError, check_known
from armwright.lint.feasibility import body_problems
from armwright.output import check_destination, whole_file
from armwright.results.result import Result
from armwright.results.table import Table, number

Verdict = Literal["identified", "not identified"]
HALF_95 = 1.959963984540054  # standard deviations from the middle to the end of a normal 95 % interval
TOP = ("gravity_m_s2", "supply")  # tables of a robot file that hold numbers and have no name


@dataclass(frozen=True, eq=False)
class Estimate(Result):
    """Parameter values from a log, with their uncertainty and the quality of the prediction.

    Attributes:
        names: (n) paths of the record, "joint1.motor.resistance_ohm", or names of what no record has: "base3",
            "delay_s", "prbs: offset_v".
        values: (n,).   covariance: (n, n); NaN where it is not known.   units: (n).
        at_bound: (n,) True where a value stands at a bound of its search: its deviation means nothing.
        identifiable: (n,) False if the log does not determine the number, which stays at the record's value.
        remarks: sentences for the user: indistinguishable numbers, numbers at a bound, and remedies.
        condition: number of the scaled Jacobian or regressor.   fit: measures by signal or joint: fit_percent, r2, rms.
        sha256: of the log.   method: one line.   verdict: "identified" or "not identified".   log: its file's name.
        preparation: of the log, as `[fits]` keeps it; empty: none.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    sha256: str
    method: str
    units: tuple[str, ...] = ()
    at_bound: np.ndarray | None = None
    identifiable: np.ndarray | None = None
    remarks: tuple[str, ...] = ()
    condition: float = float("nan")
    fit: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    verdict: Verdict = "identified"
    log: str = ""
    preparation: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.names, Sequence) or not all(isinstance(name, str) for name in self.names):
            raise IdentificationError(place="Estimate.names", value=self.names, expected="names")
        names, count = tuple(self.names), len(self.names)
        defaults = {"at_bound": np.zeros(count, dtype=bool), "identifiable": np.ones(count, dtype=bool)}
        for name, default in defaults.items():
            given = getattr(self, name)
            object.__setattr__(self, name, default if given is None else np.asarray(given, dtype=bool))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "values", np.asarray(self.values, dtype=float))
        object.__setattr__(self, "covariance", np.asarray(self.covariance, dtype=float))
        object.__setattr__(self, "units", tuple(self.units) or tuple(unit_at(name) for name in names))
        for name, shape in (("values", (count,)), ("covariance", (count, count))):
            if np.shape(given := getattr(self, name)) != shape:
                what, expected = f"shape {np.shape(given)}", f"{shape}, as there are {count} names"
                raise IdentificationError(what, place=f"Estimate.{name}", expected=expected)

    @property
    def std(self) -> np.ndarray:
        """(n,) standard deviations; NaN if unknown, meaningless at a bound, or not identifiable from the log."""
        with np.errstate(invalid="ignore"):
            std = np.sqrt(np.diag(self.covariance))
        return np.where(self._known, std, np.nan)

    @property
    def correlation(self) -> np.ndarray:
        """(n, n) matrix of correlations, 1 on its diagonal; off-diagonal 0 if unknown."""
        std = np.sqrt(np.maximum(np.nan_to_num(np.diag(self.covariance)), 0.0))
        scale = np.where(std > 0.0, std, np.inf)
        matrix = np.clip(np.nan_to_num(self.covariance / np.outer(scale, scale)), -1.0, 1.0)
        np.fill_diagonal(matrix, 1.0)
        return matrix

    @property
    def _known(self) -> np.ndarray:
        return np.asarray(self.identifiable) & ~np.asarray(self.at_bound)

    def __getitem__(self, name: str) -> float:
        """The value of that name.

        Raises:
            ModelError: no such name.
        """
        return float(self.values[self.number(name)])

    def number(self, name: str) -> int:
        """Index of a name.

        Raises:
            ModelError: no such name.
        """
        check_known(ModelError, name, self.names, "not estimated", place="name")
        return self.names.index(name)

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % confidence interval, for a normal error; NaN if unknown."""
        k = self.number(name)
        return self.values[k] - HALF_95 * self.std[k], self.values[k] + HALF_95 * self.std[k]

    def select(self, names: Sequence[str]) -> Estimate:
        """The estimate reduced to some of its parameters, in the given order."""
        places = [self.number(name) for name in names]
        return replace(
            self,
            names=tuple(names),
            values=self.values[places],
            covariance=self.covariance[np.ix_(places, places)],
            units=tuple(self.units[k] for k in places),
            at_bound=np.asarray(self.at_bound)[places],
            identifiable=np.asarray(self.identifiable)[places],
        )

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.log or 'log'}: {self.method}"

    @property
    def good(self) -> bool:
        """True if the log determines the parameters."""
        return self.verdict == "identified"

    def sentences(self) -> list[str]:
        """The verdict, then remarks."""
        return [self.verdict, *self.remarks]

    def tables(self) -> list[Table]:
        """Numbers with standard deviations; then measures of the fit."""
        rows = []
        for k, name in enumerate(self.names):
            value, std = self.values[k], self.std[k]
            relative = number(100.0 * std / abs(value) if value else None, ".2g")
            note = "at its bound" if np.asarray(self.at_bound)[k] else ""
            note = note if np.asarray(self.identifiable)[k] else "not identified: as the record has it"
            unit = "" if self.units[k] == "1" else self.units[k]
            rows.append([name, number(value, ".6g"), number(std, ".2g"), unit, relative, note])
        found = [Table(self.heading, ("parameter", "value", "± std", "unit", "relative [%]", ""), rows, ("unit", ""))]
        if self.fit:
            names = list(dict.fromkeys(name for each in self.fit.values() for name in each))
            cells = [[signal, *(number(each.get(name), ".4g") for name in names)] for signal, each in self.fit.items()]
            found.append(Table("fit to the log", ("", *map(_words, names)), cells))
        return found

    def report(self, path: str | os.PathLike[str], title: str | None = None) -> Path:
        """Writes a page: verdict, what to do next, parameters, correlations, fits.

        Args:
            path: ending in .html.   title: of the page; by default its own.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        from armwright.identification.validation.report import write_report  # which is made of estimates

        return write_report(path, title or self.heading, self)


class EstimateResult(Result):
    """Base of results around an `estimate`, which has the verdict."""

    estimate: Estimate

    @property
    def good(self) -> bool:
        """True if the log determines the parameters."""
        return self.estimate.good

    def sentences(self) -> list[str]:
        """The verdict, then remarks."""
        return self.estimate.sentences()


def _words(measure: str) -> str:
    return {"fit_percent": "fit [%]", "r2": "R²", "rms": "RMS"}.get(measure, measure.replace("_", " "))


def write_into(
    arm: str | os.PathLike[str] | Arm | RobotDescription,
    estimate: Estimate,
    output: str | os.PathLike[str],
    key: str = "fit",
) -> Path:
    """Writes the robot's file with the estimated numbers: source of kind `fit`, deviation, log's checksum, correlation.

    Numbers that the log does not determine are unchanged. `[fits.KEY]` lists names, correlations, bounds, measures and all other
    estimates, such as delays. A TOML file keeps its comments and its order.

    Args:
        arm: an arm, its description, its name or the path of its file.   estimate: the numbers.
        output: path of the file to write, ending in .toml; it may be the robot's own.   key: of the source and of the fit.
    Returns:
        path: of the file.
    Raises:
        OutputError: the file cannot be written.   IdentificationError: a path without a number.
        DescriptionError: the robot is invalid, with these numbers or without; then nothing is written.
    Example:
        >>> log = "examples/logs/lwa4p/lwa4p.log.toml"
        >>> fit = aw.identification.identify_friction(log, "lwa4p", candidates=())
        >>> path = aw.identification.write_into("lwa4p", fit, "arm.toml")
        >>> arm = aw.load(path)  # with friction of the kind `fit`
    """
    expect(estimate, Estimate, "estimate", "an aw.identification.Estimate", IdentificationError)
    path = check_destination(output, (".toml",))
    text = updated_text(arm, estimate, path.parent, key)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return path


def updated_text(
    arm: str | os.PathLike[str] | Arm | RobotDescription, estimate: Estimate, folder: Path, key: str = "fit"
) -> str:
    """The text of the file that `write_into` writes.

    Raises:
        OutputError, DescriptionError: as `write_into`.
    """
    text, lost = _text_of(arm, folder)
    estimate = replace(estimate, remarks=(*estimate.remarks, *(f"left out: {each}" for each in lost)))
    record = parse(tomlkit.parse(text).unwrap(), "robot", folder)
    parts = _parts(text)
    kept = np.asarray(estimate.identifiable)
    own = [_is_of(record, name) for name in estimate.names]
    written = [k for k, name in enumerate(estimate.names) if own[k] and kept[k]]
    std = estimate.std
    for k in written:
        _set_number(parts, record, estimate.names[k], float(estimate.values[k]), float(std[k]), key)
    _add_tables(parts, estimate, key, written, own)
    text = "".join(tomlkit.dumps(part) for part in parts)
    parse(tomlkit.parse(text).unwrap(), "the robot with its estimate", folder)  # refuses an invalid record
    return text


def write_numbers(
    arm: str | os.PathLike[str] | Arm | RobotDescription,
    numbers: Mapping[str, tuple[float, float]],
    source: Source,
    output: str | os.PathLike[str],
    key: str,
) -> Path:
    """Writes the robot's file with other numbers of a source; fits that gave these numbers before name them no more.

    Args:
        arm: an arm, its description, its name or the path of its file.   numbers: value and deviation by path of the record.
        source: of them.   output: path of the file to write, ending in .toml.   key: of the source.
    Returns:
        path: of the file.
    Raises:
        OutputError: the file cannot be written.   IdentificationError: a path without a number.
        DescriptionError: the robot is invalid with these numbers; then nothing is written.
    """
    path = check_destination(output, (".toml",))
    text, _ = _text_of(arm, path.parent)
    record = parse(tomlkit.parse(text).unwrap(), "robot", path.parent)
    known = {name for name, _, _ in quantities(record)}
    for name in numbers:
        if name.partition("[")[0] not in known:
            raise IdentificationError("no number of the robot", place="path", value=name, choices=tuple(known))
    if any(set(fit.names) & numbers.keys() for fit in record.fits.values()):
        record = record.replace(fits={each: fit.without(tuple(numbers)) for each, fit in record.fits.items()})
        text = to_toml(record, path.parent)
    parts = _parts(text)
    for name, (value, std) in numbers.items():
        _set_number(parts, record, name, value, std, key)
    table = tomlkit.table()
    table["kind"], table["text"] = source.kind, source.text
    _add_table(parts, "sources", key, table)
    text = "".join(tomlkit.dumps(part) for part in parts)
    changed = parse(tomlkit.parse(text).unwrap(), "the robot with its numbers", path.parent)
    faults = [fault for fault in body_problems(changed) if fault not in body_problems(record)]
    if faults:
        raise DescriptionError.of(*faults)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return path


def _text_of(arm: Any, folder: Path) -> tuple[str, tuple[str, ...]]:
    """The robot's own file if its text is valid in that folder, else the description as TOML; and what that loses."""
    if isinstance(arm, (str, os.PathLike)):
        description, path = read_description(arm), Path(os.fspath(arm))
        if os.fspath(arm) in builtin_names() and isinstance(arm, str):
            return (resources.files("armwright.robots") / f"{arm}.toml").read_text(encoding="utf-8"), ()
        same = path.resolve().parent == folder.resolve()
        if path.suffix == ".toml" and (
            same or not (description.built_from or any(x.visuals for x in description.links))
        ):
            return read_text(path), ()
    else:
        description = record_of(arm)
    description, lost = for_folder(description, folder)
    return to_toml(description, folder), lost


def _parts(text: str) -> list[Any]:
    """A robot's text cut before every joint, link, frame and cylinder, each part a document of its own.

    tomlkit moves tables of one list together where others stand between them, as the links between joints.
    """
    cut = re.split(r"(?m)^(?=[ \t]*\[\[[ \t]*(?:joints|links|frames|cylinders)[ \t]*\]\])", text)
    try:
        return [tomlkit.parse(part) for part in cut]
    except TOMLKitError:  # such a line within a text of several lines
        return [tomlkit.parse(text)]


def _is_of(record: RobotDescription, name: str) -> bool:
    """True for the path of a number that the record has or may have: it begins with a joint, a link or a frame."""
    first, rest = split_path(name)
    items = {each.name for each in (*record.joints, *record.links, *record.frames)}
    return name.partition("[")[0] in TOP or (bool(rest) and (first in items or first in TOP))


def _set_number(parts: list[Any], record: RobotDescription, name: str, value: float, std: float, source: str) -> None:
    """Puts a number into its table; tables that are missing on the way are made."""
    path, _, index = name.partition("[")
    first, rest = split_path(path)
    *inner, last = rest.split(".") if rest else (first,)
    first = first if rest else ""
    table: Any = parts[0] if not first else _table_of(parts, record, first, (*inner, last)[0])
    for part in inner:
        if part not in table:
            table[part] = tomlkit.inline_table() if isinstance(table, InlineTable) else tomlkit.table()
        table = table[part]
        if not isinstance(table, MutableMapping):
            expected = "the path of a number, such as link1.com_m[0]"
            raise IdentificationError("no number of the robot", place="path", value=name, expected=expected)
    number: Any = float(f"{value:.12g}")
    deviation: Any = float(f"{std:.4g}") if np.isfinite(std) else None
    if index:
        number, deviation = _with_element(table.get(last), record, path, int(index.rstrip("]")), number, deviation)
    table[last] = _inline({"value": number, **({} if deviation is None else {"std": deviation}), "source": source})


def _table_of(parts: list[Any], record: RobotDescription, name: str, key: str) -> Any:
    """The table of a joint, link or frame that may hold a key, or a table of the file's own."""
    # a joint and the link that it moves often have one name; no two of these records have a key for numbers in common
    kind = next(
        (kind for kind, keys in (("links", Link), ("frames", NamedFrame)) if key in keys.model_fields), "joints"
    )
    for part in parts:
        for table in part.get(kind, ()):
            if table.get("name") == name:
                return table
    for part in parts:  # after the joints: one of them may have the name of a key of the file, such as "base"
        if name in part:
            return part[name]
    raise OutputError("has no table", place=name, file=record.name, expected="its table in the robot's file")


def _with_element(
    old: Any, record: RobotDescription, path: str, index: int, number: float, deviation: float | None
) -> tuple[list[float], list[float] | None]:
    """All numbers of a vector and their deviations, one of them replaced."""
    known = next((quantity for place, quantity, _ in quantities(record) if place == path), None)
    value = old.get("value") if isinstance(old, dict) else old
    values = list(value if value is not None else np.asarray(known))
    spread = old.get("std") if isinstance(old, dict) else None
    stds = list(spread) if isinstance(spread, (list, tuple)) else [float(spread or 0.0)] * len(values)
    values[index], stds[index] = number, deviation or 0.0
    return [float(v) for v in values], [float(s) for s in stds]


def _add_tables(parts: list[Any], estimate: Estimate, key: str, written: list[int], own: list[bool]) -> None:
    """`[sources.KEY]` and `[fits.KEY]`."""
    source = tomlkit.table()
    source["kind"] = "fit"
    source["text"] = f"{estimate.method}; log {estimate.log or 'without a name'}, sha256 {estimate.sha256}"
    fit = tomlkit.table()
    fit["source"], fit["method"] = key, estimate.method
    fit["log_sha256"], fit["verdict"] = estimate.sha256, estimate.verdict
    fit["names"] = [estimate.names[k] for k in written]
    if len(written) > 1 and np.isfinite(estimate.covariance[np.ix_(written, written)]).any():
        matrix = estimate.correlation[np.ix_(written, written)]
        fit["correlation"] = [[float(f"{v:.9g}") for v in matrix[k, :k]] for k in range(len(written))]
    fit["at_bound"] = [estimate.names[k] for k in written if np.asarray(estimate.at_bound)[k]]
    kept = np.asarray(estimate.identifiable)
    fit["unidentified"] = [name for name, known in zip(estimate.names, kept, strict=True) if not known]
    if np.isfinite(estimate.condition):
        fit["condition"] = max(1.0, float(f"{estimate.condition:.6g}"))
    others = {
        name: {"value": float(f"{estimate.values[k]:.12g}")}
        | ({"std": float(f"{estimate.std[k]:.4g}")} if np.isfinite(estimate.std[k]) else {})
        for k, name in enumerate(estimate.names)
        if not own[k] and kept[k]
    }
    measures = {
        signal: {name: float(f"{v:.6g}") for name, v in each.items() if np.isfinite(v)}
        for signal, each in estimate.fit.items()
    }
    for name, each in (("others", others), ("measures", measures), ("preparation", estimate.preparation)):
        if each:
            fit[name] = _inline(each)
    fit["remarks"] = list(estimate.remarks)
    for name in ("at_bound", "unidentified", "remarks"):
        if not fit[name]:
            del fit[name]
    for name, table in (("sources", source), ("fits", fit)):
        _add_table(parts, name, key, table)


def _add_table(parts: list[Any], name: str, key: str, table: Any) -> None:
    """`[NAME.KEY]`, in place of an older one."""
    document: Any = next((part for part in parts if name in part), parts[0])
    if name not in document:
        document[name] = tomlkit.table(is_super_table=True)
    table.add(tomlkit.nl())
    document[name][key] = table


def _inline(values: Mapping[str, Any]) -> Any:
    table = tomlkit.inline_table()
    for name, value in values.items():
        table[name] = _inline(value) if isinstance(value, Mapping) else value
    return table
