"""All physical checks of a robot file, with their findings as a list."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from armwright.description import RobotDescription, read_description
from armwright.description.record_of import record_of
from armwright.errors import DescriptionError, Problem
from armwright.lint.feasibility import check_bodies, check_drives, impossible_links
from armwright.lint.hulls import implausible_shapes
from armwright.lint.plausibility import implausible_values
from armwright.model import Model, build_model
from armwright.model.build import massless, places_of_joints
from armwright.model.cylinder_lengths import implausible_lengths
from armwright.model.load import outdated

CHECKS = {  # name of a check → its subject
    "reading": "what was left out or guessed when another format was read",
    "mass properties": "every link's pseudo-inertia is one that a real body can have",
    "drives": "gears and friction that would hold still, motor constants that contradict each other",
    "plausibility": "tensors about the wrong point or in wrong units, placeholders, joints that move no mass",
    "cylinders": "lengths that the arm never has, ends that meet",
    "shapes": "densities and tensors against what the links look like",
    "age": "parts or modules that have changed since the file was built from them",
}


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Attributes:
        level: "error" for an arm that cannot exist, "warning" for a probable mistake.
        check: name of the check.   problem: what is wrong, and where.
    """

    level: Literal["error", "warning"]
    check: str
    problem: Problem


@dataclass(frozen=True)
class Report:
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
    def errors(self) -> tuple[Finding, ...]:
        """Findings that no real arm has."""
        return tuple(finding for finding in self.findings if finding.level == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings that look like a mistake, or were accepted with a reason."""
        return tuple(finding for finding in self.findings if finding.level == "warning")


def check(name_or_path: str | os.PathLike[str] | Model | RobotDescription, **reading: Any) -> Report:
    """Makes all physical checks of a record, those that open meshes included.

    Args:
        name_or_path: a built-in name, a path, an arm, or a description.
        reading: what a URDF or an MJCF leaves open, as for `load`.
    Returns:
        report: its `errors` and `warnings`.
    Raises:
        DescriptionError: a file that cannot be read as a record at all.   ModelError: an arm that differs from its description.
    """
    if isinstance(name_or_path, (Model, RobotDescription)):
        robot, aged, file = record_of(name_or_path), [], ""
    else:
        robot, file = read_description(name_or_path, **reading), os.fspath(name_or_path)
        aged = outdated(robot, Path(name_or_path))
    try:
        model = build_model(robot, on_impossible="warn")
    except DescriptionError as error:  # it knows the robot, not the file
        raise error.within(file=file) from None
    refused = {link.name for link in impossible_links(robot) if link.accept_impossible is None}
    bodies = zip(impossible_links(robot), check_bodies(robot, "warn"), strict=True)
    others = {
        "reading": robot.remarks,
        "drives": check_drives(robot),
        "plausibility": [*implausible_values(robot, places_of_joints(robot, model)), *massless(model)],
        "cylinders": [*implausible_lengths(model)],
        "shapes": implausible_shapes(robot),
        "age": aged,
    }
    findings = [
        *(_finding("mass properties", note, "error" if link.name in refused else "warning") for link, note in bodies),
        *(_finding(name, note) for name, notes in others.items() for note in notes),
    ]
    ordered = sorted(findings, key=lambda finding: finding.level != "error")
    return Report(robot.name, len(robot.links), model.n, tuple(ordered))


def _finding(check: str, note: Problem | str, level: Literal["error", "warning"] = "warning") -> Finding:
    """A finding; remarks of a file are text."""
    return Finding(level, check, note if isinstance(note, Problem) else Problem(note))
