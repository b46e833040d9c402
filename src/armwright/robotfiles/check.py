"""Everything physical that can be doubted about a record, as a list."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from armwright.description import RobotDescription, read_description
from armwright.lint.feasibility import check_bodies, check_drives, impossible_links
from armwright.lint.hulls import implausible_shapes
from armwright.lint.plausibility import implausible_values
from armwright.model import build_model
from armwright.model.build import massless, places_of_joints
from armwright.model.load import outdated

CHECKS = {  # what each looks at
    "reading": "what was left out or guessed when another format was read",
    "mass properties": "every link's pseudo-inertia is one that a real body can have",
    "drives": "gears that lock themselves, motor constants that contradict each other",
    "plausibility": "tensors about the wrong point or in wrong units, placeholders, joints that move no mass",
    "shapes": "densities and tensors against what the links look like",
    "age": "whether the parts or modules behind the file have changed since it was built",
}


@dataclass(frozen=True)
class Finding:
    """One sentence of a check.

    Attributes:
        level: "error" for what no real arm can be, "warning" for what looks like a mistake.
        check: which one found it.   text: what, and where.
    """

    level: Literal["error", "warning"]
    check: str
    text: str


@dataclass(frozen=True)
class Report:
    """What `check` found.

    Attributes:
        name: of the arm.   links, joints: how many were looked at; joints those that move.
        findings: errors first.
    """

    name: str
    links: int
    joints: int
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """What no real arm can be."""
        return tuple(finding for finding in self.findings if finding.level == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """What looks like a mistake, or was accepted with a reason."""
        return tuple(finding for finding in self.findings if finding.level == "warning")


def check(name_or_path: str | os.PathLike[str] | RobotDescription, **reading: Any) -> Report:
    """Makes all physical checks of a record, those that open meshes included.

    Args:
        name_or_path: a built-in name, a path, or a description.   reading: what a URDF or an MJCF leaves open, as for `load`.
    Returns:
        report: its `errors` and `warnings`.
    Raises:
        DescriptionError: a file that cannot be read as a record at all.
    """
    if isinstance(name_or_path, RobotDescription):
        robot, aged = name_or_path, []
    else:
        robot = read_description(name_or_path, **reading)
        aged = outdated(robot, Path(name_or_path))
    model = build_model(robot, on_impossible="warn")
    refused = {link.name for link in impossible_links(robot) if link.accept_impossible is None}
    bodies = zip(impossible_links(robot), check_bodies(robot, "warn"), strict=True)
    findings = [
        *(Finding("error" if link.name in refused else "warning", "mass properties", str(p)) for link, p in bodies),
        *_warnings("reading", robot.remarks),
        *_warnings("drives", check_drives(robot)),
        *_warnings("plausibility", [*implausible_values(robot, places_of_joints(robot, model)), *massless(model)]),
        *_warnings("shapes", implausible_shapes(robot)),
        *_warnings("age", aged),
    ]
    ordered = sorted(findings, key=lambda finding: finding.level != "error")
    return Report(robot.name, len(robot.links), model.n, tuple(ordered))


def _warnings(name: str, found: Iterable[Any]) -> list[Finding]:
    return [Finding("warning", name, str(each)) for each in found]
