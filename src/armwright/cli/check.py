"""`armwright check`: physical plausibility of a robot file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from armwright.cli.arguments import Robot
from armwright.cli.excerpts import excerpt
from armwright.cli.tables import console_for_tables, table
from armwright.errors import ArmwrightError, Problem
from armwright.terminal import say

FOUND = 1  # the exit code where something was found


def check(
    robot: Robot,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 on warnings too, not only on errors.")] = False,
) -> None:
    """Check a robot file: missing numbers, impossible inertias, implausible values, meshes.

    Errors are impossible for a real arm, such as a negative inertia. Warnings look like a mistake, and name it; notes are
    correct on some arms. Exit code: 0 nothing found, 1 errors (with --strict: or warnings), 2 a file that cannot be read at
    all.

    \b
    Examples:
      armwright check my-arm.toml
      armwright check my-arm.urdf --strict
    """
    import armwright as aw
    from armwright.robotfiles.check import CHECKS

    try:
        report = aw.robotfiles.check(robot)
    except ArmwrightError as error:
        say(f"armwright: error: {_with_lines(error.problems, str(error).splitlines()[0])}", err=True)
        raise typer.Exit(2) from None
    console = console_for_tables()
    rows = []
    for name, about in CHECKS.items():
        levels = [finding.level for finding in report.findings if finding.check == name]
        rows.append([name, about, _counted(levels)])
    moving = f"{_plural(report.joints, 'joint')} that {'moves' if report.joints == 1 else 'move'}"
    console.print(table(f"{report.name}: {_plural(report.links, 'link')}, {moving}", HEADS, rows, HEADS))
    for level, style in (("error", "red"), ("warning", "yellow"), ("note", None)):
        for finding in report.findings:
            if finding.level == level:
                console.print(f"\n{level}: {finding.problem}", style=style, soft_wrap=True)
                shown = excerpt(finding.problem)
                if shown:
                    console.print(shown, soft_wrap=True)
    errors, warnings = len(report.errors), len(report.warnings)
    console.print(f"\n{_plural(errors, 'error')}, {_plural(warnings, 'warning')}")
    if errors or (strict and warnings):
        raise typer.Exit(FOUND)


def _with_lines(problems: Sequence[Problem], summary: str) -> str:
    """The summary, then each problem with its line of the file; a single problem is part of the summary."""
    ordered = sorted(problems, key=lambda problem: problem.line)
    told = [f"  {problem}" for problem in ordered] if len(ordered) > 1 else [""]
    pairs = zip(told, map(excerpt, ordered), strict=True)
    return "\n".join([summary, *(text for pair in pairs for text in pair if text)])


HEADS = ("check", "what it looks at", "found")


def _counted(levels: list[str]) -> str:
    counts = {level: levels.count(level) for level in ("error", "warning", "note")}
    return ", ".join(_plural(count, level) for level, count in counts.items() if count) or "nothing"


def _plural(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"
