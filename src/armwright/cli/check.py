"""`armwright check`: physical plausibility of a robot file."""

from __future__ import annotations

from collections.abc import Sequence

import typer

import armwright as aw
from armwright.cli.arguments import Robot, flag
from armwright.cli.excerpts import excerpt
from armwright.cli.tables import console_for_tables
from armwright.errors import ArmwrightError, Problem, keys_to_fill_in
from armwright.terminal import say

FOUND = 1  # the exit code where something was found


def check(
    robot: Robot,
    strict: bool = flag("--strict", "Exit with 1 on warnings too, not only on errors."),
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
    try:
        report = aw.robotfiles.check(robot)
    except ArmwrightError as error:
        say(f"armwright: error: {_with_lines(error.problems, str(error).splitlines()[0])}", err=True)
        raise typer.Exit(2) from None
    console = console_for_tables()
    console.print(report.tables()[0])
    for level, style in (("error", "red"), ("warning", "yellow"), ("note", None)):
        for finding in report.kinds():
            if finding.level == level:
                console.print(f"\n{level}: {finding.problem}", style=style, soft_wrap=True)
                shown = excerpt(finding.problem)
                if shown:
                    console.print(shown, soft_wrap=True)
    console.print(f"\n{report.sentences()[0]}")
    if report.errors or (strict and report.warnings):
        raise typer.Exit(FOUND)


def _with_lines(problems: Sequence[Problem], summary: str) -> str:
    """The summary, then each problem with its line of the file; a single problem is part of the summary."""
    ordered = sorted(problems, key=lambda problem: problem.line)
    keys, ordered = keys_to_fill_in(ordered)
    listed = [f"  {problem}" for problem in ordered] if len(problems) > 1 else [""]
    pairs = zip(listed, map(excerpt, ordered), strict=True)
    advice = ["a comment beside each, written by `armwright new robot`, says what is wanted"] if keys else []
    shown = [*(f"  {line}" for line in keys), *(text for pair in pairs for text in pair if text), *advice]
    return "\n".join([summary, *shown])
