"""Checks of a log: each finding has numbers, place and consequence.

| check        | what it looks at                                                                                        |
|--------------|---------------------------------------------------------------------------------------------------------|
| clock        | rate, jitter, gaps, rows at the same time, time that goes backwards, rows without time                  |
| cells        | empty cells, columns that never change, stays at an extreme, rows repeated, spikes, quantisation        |
| units        | positions against limits, speed against the derivative of position, sizes: units, sides, signs          |
| delays       | speed behind position, torque behind motion, in fractions of a sample                                   |
| power        | torques, currents and voltages that would take energy out of a machine that only loses it               |
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from armwright.errors import LogError
from armwright.identification.logs.census import Census
from armwright.identification.logs.columns import check_gears
from armwright.identification.logs.effort_checks import power, torque_delays
from armwright.identification.logs.findings import Found, LogFinding
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.row_checks import cells, clock, motion, none, spikes
from armwright.identification.logs.smoothed import Smoothed, smoothed
from armwright.identification.logs.unit_checks import limits, sizes, speeds, temperatures
from armwright.model import Model

NUMBERS = re.compile(r"-?[\d.]+(e[+-]?\d+)?")
OF_ROWS: dict[str, tuple[Callable[[Log, LogRun, Census], Found], ...]] = {
    "clock": (clock,),
    "cells": (cells, none, spikes, motion),
    "units": (limits, temperatures, sizes),
}
OF_MOTION: dict[str, Callable[[Log, Smoothed], Found]] = {"units": speeds, "delays": torque_delays, "power": power}


def check_log(log: Log) -> list[LogFinding]:
    """All findings of the checks of a log with a census of its runs."""
    findings = []
    for run in log.runs:
        found = [
            (name, each)
            for name, functions in OF_ROWS.items()
            for check in functions
            for each in check(log, run, run.census)
        ]
        smooth = smoothed(log, run)
        if smooth is not None:
            found += [(name, each) for name, check in OF_MOTION.items() for each in check(log, smooth)]
        findings += [LogFinding(level, name, run.name, problem) for name, (level, problem) in found]
    return _once(_of_joints(findings, log), log)


def of_robot(log: Log, arm: Model) -> Log:
    """A log with a robot that its file does not name, and further findings from the robot's gears and limits.

    Raises:
        LogError: gears that are not the robot's, positions beyond its limits by a mistake that is known.
    """
    check_gears(log, arm)
    if log.arm is not None:
        return log
    known, found = replace(log, arm=arm), []
    for run in log.runs:
        found += [LogFinding(level, "units", run.name, each) for level, each in limits(known, run, run.census)]
    fresh = [each for each in _once(found, log) if each not in log.findings]
    errors = [each.problem.within(each.run and f"run {each.run!r}") for each in fresh if each.level == "error"]
    if errors:
        raise LogError.of(*errors).within(file=log.path)
    return replace(known, findings=(*log.findings, *fresh))


def _of_joints(findings: list[LogFinding], log: Log) -> list[LogFinding]:
    """Findings with the notes that columns of a signal share in a run, but for their numbers, as one with the first one's."""
    alike: dict[Any, list[LogFinding]] = {}
    for k, each in enumerate(findings):
        signal, _, joint = each.problem.place.partition(" ")
        shared = each.level == "note" and joint in log.joints
        alike.setdefault((each.run, signal, NUMBERS.sub("#", each.problem.what)) if shared else k, []).append(each)
    kept = []
    for first, *others in alike.values():
        if others:
            names = [each.problem.place.partition(" ")[2] for each in others]
            what = f"{first.problem.what}; alike: {', '.join(names)}"
            first = replace(first, problem=replace(first.problem, what=what))
        kept.append(first)
    return kept


def _once(findings: list[LogFinding], log: Log) -> list[LogFinding]:
    """Findings that several runs share, but for their numbers, as one, with the first run's numbers."""
    alike: dict[tuple[Any, ...], list[LogFinding]] = {}
    for each in findings:
        key = (each.level, each.check, each.problem.place, NUMBERS.sub("#", each.problem.what))
        before = sum(other.run == each.run for k, group in alike.items() if k[:4] == key for other in group)
        alike.setdefault((*key, before), []).append(each)  # a second of the same run stands for itself
    kept = []
    for first, *others in alike.values():
        if others:
            rest = len(log.runs) - 1
            more = "all other runs" if len(others) == rest else f"{len(others)} of {rest} other runs"
            first = replace(first, problem=replace(first.problem, what=f"{first.problem.what} (alike in {more})"))
        kept.append(first)
    return kept
