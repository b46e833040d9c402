"""All physical checks of a robot file, with their findings as a list."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

from armwright.description import RobotDescription
from armwright.description.record_of import record_of
from armwright.description.toml_file import read_text
from armwright.errors import ABSENT, Problem
from armwright.lint.feasibility import check_bodies, check_drives, impossible_links, senses_of_gears
from armwright.lint.hulls import implausible_shapes
from armwright.lint.plausibility import implausible_values, moved_without_mass
from armwright.model import Model, build_model
from armwright.model.build import massless, places_of_joints
from armwright.model.cylinder_lengths import implausible_lengths
from armwright.model.load import built, described, outdated
from armwright.results.result import Result
from armwright.results.table import Table
from armwright.toml_text import TomlText

CHECKS = {  # name of a check → its subject
    "reading": "what was left out or guessed when another format was read",
    "mass properties": "every link's pseudo-inertia is one that a real body can have",
    "drives": "gears and friction that would hold still, numbers of a motor that contradict each other",
    "plausibility": "tensors about the wrong point or in wrong units, placeholders, joints or links without mass",
    "cylinders": "lengths that the arm never has, ends that meet",
    "shapes": "densities and tensors against what the links look like",
    "age": "parts or modules that have changed since the file was built from them",
}


NAMED = re.compile(r"(?P<kind>joint|link)s? (?P<names>'[^']*'(?:, '[^']*')*)(?P<rest>.*)")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")
Level = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Attributes:
        level: "error" for an arm that cannot exist, "warning" for a probable mistake, "note" for what is right on some arms.
        check: name of the check.   problem: what is wrong, and where.
    """

    level: Level
    check: str
    problem: Problem


@dataclass(frozen=True)
class Report(Result):
    """Result of `check`.

    Attributes:
        name: of the arm.   links, joints: numbers of links, and of joints that move.
        findings: errors first.
    """

    name: str
    links: int
    joints: int
    findings: tuple[Finding, ...]

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        moving = f"{_plural(self.joints, 'joint')} that {'moves' if self.joints == 1 else 'move'}"
        return f"{self.name}: {_plural(self.links, 'link')}, {moving}"

    @property
    def good(self) -> bool:
        """True without errors."""
        return not self.errors

    def kinds(self) -> list[Finding]:
        """The findings in their order, those that differ in numbers and names only as one, which names them all."""
        kinds: dict[object, list[Finding]] = {}
        for finding in self.findings:
            kinds.setdefault(_kind(finding), []).append(finding)
        return [_of_one_kind(findings) for findings in kinds.values()]

    def sentences(self) -> list[str]:
        """The count of errors and warnings."""
        return [f"{_plural(len(self.errors), 'error')}, {_plural(len(self.warnings), 'warning')}"]

    def tables(self) -> list[Table]:
        """A row for each check; then one for each finding."""
        found = {name: [each.level for each in self.findings if each.check == name] for name in CHECKS}
        rows = [[name, about, _counted(found[name])] for name, about in CHECKS.items()]
        findings = [[each.level, each.check, str(each.problem)] for each in self.findings]
        heads, of_finding = ("check", "what it looks at", "found"), ("level", "check", "problem")
        return [Table(self.heading, heads, rows, heads), Table("findings", of_finding, findings, of_finding)]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that are impossible for a real arm."""
        return tuple(finding for finding in self.findings if finding.level == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings that look like a mistake, or were accepted with a reason."""
        return tuple(finding for finding in self.findings if finding.level == "warning")


def _of_one_kind(findings: Sequence[Finding]) -> Finding:
    """One finding with the names of all, and with a range where their numbers differ: `17 to 37 times the tensor`."""
    first = findings[0].problem
    if len(findings) == 1:
        return findings[0]
    places = [NAMED.match(each.problem.place) for each in findings]
    names = dict.fromkeys(name for found in places if found for name in re.findall("'[^']*'", found["names"]))
    found = places[0]
    place = f"{found['kind']}s {', '.join(names)}{found['rest']}" if found else first.place
    values = [each.problem.value for each in findings]
    texts = {field: _with_ranges([getattr(each.problem, field) for each in findings]) for field in ("what", "expected")}
    value = first.value if all(each == first.value for each in values) else ABSENT
    return replace(findings[0], problem=replace(first, place=place, value=value, **texts))


def _kind(finding: Finding) -> tuple[object, ...]:
    """Equal for findings that differ in numbers and in the names of joints or links only."""
    problem = finding.problem
    place = NAMED.match(problem.place)
    at = (place["kind"], place["rest"]) if place else problem.place
    what, expected = (NUMBER.sub("#", text) for text in (problem.what, problem.expected))
    return finding.level, finding.check, at, what, expected, problem.choices, problem.file.rpartition(":")[0]


def _with_ranges(texts: Sequence[str]) -> str:
    """The first of several texts that differ in numbers, with the least and the largest of each that differs."""
    rows = list(zip(*(NUMBER.findall(text) for text in texts), strict=True))
    numbers = iter(row[0] if len(set(row)) == 1 else f"{min(row, key=float)} to {max(row, key=float)}" for row in rows)
    return NUMBER.sub(lambda _: next(numbers), texts[0])


def _counted(levels: list[str]) -> str:
    counts = {level: levels.count(level) for level in get_args(Level)}
    return ", ".join(_plural(count, level) for level, count in counts.items() if count) or "nothing"


def _plural(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def check(name_or_path: str | os.PathLike[str] | Model | RobotDescription, **reading: Any) -> Report:
    """Physical checks of a robot file, including those that open meshes.

    Args:
        name_or_path: a built-in name, a path, an arm, or a description.
        reading: what a URDF or an MJCF leaves open, as for `load`.
    Returns:
        report: its `errors` and `warnings`.
    Raises:
        DescriptionError: a file that cannot be read as a record at all.   ModelError: an arm that differs from its description.
    Example:
        >>> report = aw.robotfiles.check("examples/scara.toml")
        >>> print(report.good, len(report.findings))
        True 0
    """
    if isinstance(name_or_path, (Model, RobotDescription)):
        robot, aged, file = record_of(name_or_path), [], ""
    else:
        robot, file = described(name_or_path, **reading), os.fspath(name_or_path)
        aged = outdated(robot, Path(name_or_path))
    model = built(robot, file, "warn") if file else build_model(robot, on_impossible="warn")
    refused = {link.name for link in impossible_links(robot) if link.accept_impossible is None}
    bodies = zip(impossible_links(robot), check_bodies(robot, "warn"), strict=True)
    others = {
        "reading": robot.remarks,
        "drives": check_drives(robot),
        "plausibility": [
            *implausible_values(robot, places_of_joints(robot, model)),
            *massless(model),
            *moved_without_mass(robot),
        ],
        "cylinders": [*implausible_lengths(model)],
        "shapes": implausible_shapes(robot),
        "age": aged,
    }
    findings = [
        *(_finding("mass properties", note, "error" if link.name in refused else "warning") for link, note in bodies),
        *(_finding(name, note) for name, notes in others.items() for note in notes),
        *(_finding("drives", note, "note") for note in senses_of_gears(robot)),
    ]
    if file.endswith(".toml"):
        text = TomlText(read_text(Path(file)), file)
        findings = [replace(finding, problem=text.with_line(finding.problem)) for finding in findings]
    ordered = sorted(findings, key=lambda finding: get_args(Level).index(finding.level))
    return Report(robot.name, len(robot.links), model.n, tuple(ordered))


def _finding(check: str, note: Problem | str, level: Level = "warning") -> Finding:
    """A finding; remarks of a file are text, of which what names joints or links is the place."""
    if isinstance(note, Problem):
        return Finding(level, check, note)
    place, colon, what = note.partition(": ")
    named = colon and NAMED.fullmatch(place)
    return Finding(level, check, Problem(what, place) if named else Problem(note))
