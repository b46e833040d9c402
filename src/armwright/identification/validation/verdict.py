"""Verdict of a validation, `NAME.verdict.toml`, stored beside its record with the checksums of record and log."""

from __future__ import annotations

import importlib.metadata
import os
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import Field

from armwright.description.toml_file import toml_tables
from armwright.entry import as_path, expect
from armwright.errors import LogError
from armwright.identification.validation.validate import Validation, record_sha256
from armwright.output import check_destination, whole_file
from armwright.quantity import Record
from armwright.reading import read_file
from armwright.results.result import Result
from armwright.validation import validated

ENDING = ".verdict.toml"
MEASURES = ("r2", "fit", "vaf", "nrmse", "rms", "gain", "correlation")


class VerdictTable(Record):
    """The file."""

    passed: bool
    verdict: str
    date: str
    armwright: str
    record: str
    record_sha256: str
    log: str
    log_sha256: str
    runs: tuple[str, ...]
    held_out: bool
    notes: tuple[str, ...] = ()
    limits: dict[str, Any] = Field(default_factory=dict)
    measures: dict[str, dict[str, dict[str, Any]]] = Field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class StoredVerdict(Result):
    """A verdict read from a file.

    Attributes:
        path: of its file.   table: what it says.   belongs: whether its checksum is that of the record as it is now.
    """

    path: Path
    table: VerdictTable
    belongs: bool

    @property
    def passed(self) -> bool:
        """True for a passing verdict on the unchanged record."""
        return self.table.passed and self.belongs

    def __str__(self) -> str:
        if not self.belongs:
            return f"{self.path}: of another state of the record, which has changed since {self.table.date}"
        return f"{self.path}: {self.table.verdict} ({self.table.date}, log {self.table.log})"


def verdict_path(record: str | os.PathLike[str]) -> Path:
    """Path of the verdict on a record: arm.toml has arm.verdict.toml beside it."""
    return Path(as_path(record, "record", LogError)).with_suffix(ENDING)


def check_verdict(record: str | os.PathLike[str]) -> None:
    """Refuses a record beside which no verdict can be written, such as a built-in arm; to be called before long work.

    Raises:
        OutputError: no permission to write there.
    """
    if Path(record).is_file():
        check_destination(verdict_path(record))


def write_verdict(validation: Validation) -> Path:
    """Writes the verdict of a validation beside its record.

    Args:
        validation: of a record that has a path.
    Returns:
        path: of the file.
    Raises:
        LogError: a built-in arm, or one made in Python.   OutputError: the file cannot be written.
    Example:
        >>> log = "examples/logs/lwa4p/lwa4p.log.toml"
        >>> path = aw.robotfiles.convert("lwa4p", "arm.toml").written[0]
        >>> found = aw.identification.validate(path, log, simulation=False)
        >>> aw.identification.write_verdict(found).name
        'arm.verdict.toml'
    """
    expect(validation, Validation, "validation", "what aw.identification.validate returns", LogError)
    if validation.record is None:
        raise LogError(
            "has no file, so no verdict can be stored beside it", place="record", value=validation.arm.name,
            expected="the path of a robot or scenario file",
        )  # fmt: skip
    path = verdict_path(validation.record)
    document = tomlkit.document()
    about = "Written by `armwright validate`. It belongs to the record with the checksum below and to no other."
    document.add(tomlkit.comment(about))
    for name, value in _head(validation).items():
        document[name] = value
    document["limits"] = validation.limits.model_dump(exclude_none=True, exclude_defaults=True)
    measures: dict[str, Any] = {}
    for each in validation.measures:
        values: dict[str, Any] = {
            name: float(f"{v:.6g}") for name in MEASURES if isfinite(v := getattr(each.overall, name))
        }
        if each.remarks:
            values["remarks"] = list(each.remarks)
        measures.setdefault(each.joint, {})[each.quantity] = {"rows": each.overall.rows, **values}
    document["measures"] = measures
    with whole_file(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8", newline="\n")
    return path


def _head(validation: Validation) -> dict[str, Any]:
    assert validation.record is not None
    return {
        "passed": validation.passed,
        "verdict": validation.verdict,
        "date": validation.date,
        "armwright": importlib.metadata.version("armwright"),
        "record": validation.record.name,
        "record_sha256": validation.record_sha256,
        "log": validation.log.path.name,
        "log_sha256": validation.log.sha256,
        "runs": list(validation.runs),
        "held_out": validation.held_out,
        "notes": list(validation.notes),
    }


def stored_verdict(record: str | os.PathLike[str], sha256: str | None = None) -> StoredVerdict | None:
    """The verdict beside a record; its `passed` says if it is a passing one for the unchanged record.

    Args:
        record: path of a robot's file; of a scenario together with its checksum.
        sha256: of the record; None: of the file's bytes. Of a scenario that `read_scenario` has read it is
            `validate.record_sha256(path, scenario)`.
    Returns:
        verdict: None where there is none.
    Raises:
        LogError: no such record, or a verdict that cannot be read.
    Example:
        >>> path = aw.robotfiles.convert("two-link", "arm.toml").written[0]
        >>> aw.identification.stored_verdict(path) is None  # nothing was validated yet
        True
    """
    path = verdict_path(record)
    if not path.exists():
        read_file(record, "a record", LogError)
        return None
    with toml_tables(path, LogError) as tables:
        table = validated(VerdictTable, tables, file=path, error=LogError)
    return StoredVerdict(path, table, (sha256 or record_sha256(Path(record))) == table.record_sha256)


def passing_verdict(record: str | os.PathLike[str], sha256: str | None = None) -> StoredVerdict:
    """The passing verdict on a record in its present form; to be called before a model may act on an arm.

    Args:
        record: path of its file.   sha256: of a scenario's record, as of `stored_verdict`.
    Returns:
        verdict: that was found.
    Raises:
        LogError: no verdict, one that failed, or one of another state of the record.
    Example:
        >>> path = aw.robotfiles.convert("two-link", "arm.toml").written[0]
        >>> try:
        ...     aw.identification.passing_verdict(path)
        ... except aw.ArmwrightError as error:
        ...     print(error.expected)
        a record that `armwright validate RECORD LOG` has passed since its last change
    """
    found = stored_verdict(record, sha256)
    if found is None or not found.passed:
        what = "no verdict on this record" if found is None else "the verdict is of another state of the record"
        what = f"the record {found.table.verdict}" if found is not None and found.belongs else what
        expected = "a record that `armwright validate RECORD LOG` has passed since its last change"
        raise LogError(what, file=record, expected=expected)
    return found
