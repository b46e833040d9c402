"""Held-out runs: their free simulation with the fitted parameters, from their own initial state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from armwright.description.robot import RobotDescription
from armwright.errors import LogError
from armwright.identification.logs.log import Log
from armwright.identification.motor.fitting import Fitted
from armwright.identification.motor.measured import Measured, measured
from armwright.identification.motor.output_error import Places, Problem, refined
from armwright.identification.motor.predictions import predictions_of
from armwright.identification.motor.problem import speeds_of, starts_of
from armwright.identification.motor.unknowns import Unknown, values_of
from armwright.model.model import build_model

Measures = Mapping[str, Mapping[str, float]]
MARK = " (held out)"  # behind a run's name, among measures


def held_out(
    log: Log, record: RobotDescription, data: Measured, done: Fitted, locked: bool
) -> tuple[dict[str, Any], Measures, list[str]]:
    """Predictions by run, measures by run and signal, and remarks, for the held-out runs.

    Numbers that every run has of its own stand at their means. Initial state, and an offset if one was fitted, are the run's.

    Args:
        log: with runs for fitting and others.   record: that was simulated.   data: what was fitted.   done: the fit.
        locked: the rotors were held.
    """
    runs = [name for name in log.hold_out if name not in {each.run for each in data.stretches}]
    if not runs:
        return {}, {}, []
    names = ["qd" if name == "qd_mean" else name for name in data.signals]
    try:
        fresh = measured(
            log, runs, data.joints, "difference" if "qd_mean" in data.signals else "instant", names, locked=locked
        )
    except LogError as error:
        return {}, {}, [f"not simulated: {', '.join(runs)}, held out: {error.problems[0].what or error}"]
    if (fresh.signals, fresh.command) != (data.signals, data.command):
        what = f"{', '.join(fresh.signals)} driven by {fresh.command}"
        return {}, {}, [f"not simulated: {', '.join(runs)}, held out, which have {what}"]
    problem, z = _fresh(record, fresh, done)
    z = refined(problem, z) if len(z) else z
    predictions, measures = predictions_of(problem, z, fresh, MARK)
    return predictions, measures, []


def _fresh(record: RobotDescription, data: Measured, done: Fitted) -> tuple[Problem, np.ndarray]:
    """The problem of new stretches in which the numbers of a fit are fixed, and where its search begins."""
    old, n = done.problem, len(data.joints)
    values, _ = values_of(old.unknowns, done.z)
    nominal, delays = old.nominal.copy(), []
    columns: dict[int, list[float]] = {}
    for at in old.places:
        for column, k in enumerate(at.parameters):
            if k >= 0:
                columns.setdefault(column, []).append(float(values[k]))
        delays.append(float(values[at.delay]) if at.delay >= 0 else old.delay)
    for column, each in columns.items():
        nominal[column] = np.mean(each)
    unknowns: list[Unknown] = []
    labels: list[str] = []
    speed = float(max(np.abs(speeds_of(s)).max() for s in data.stretches))
    arm, places = build_model(record), []
    for number, stretch in enumerate(data.stretches):
        start, fixed = starts_of(stretch, number, old.response, arm, unknowns, labels, speed, data)
        offsets = np.full(n, -1)
        for k in {int(k) for at in old.places for k in at.offsets if k >= 0}:
            offsets[_joint_of(old, k)] = len(unknowns)
            unknowns.append(replace(old.unknowns[k], guess=float(values[k]), run=stretch.run))
        none = np.full(len(nominal), -1)
        places.append(Places(none, offsets, -1, start, fixed))
    moving = [d for d, at in zip(delays, old.places, strict=True) if at.start.max(initial=-1) >= 0] or delays
    problem = Problem(
        old.response, tuple(unknowns), data.stretches, tuple(places), old.sigma, nominal, float(np.mean(moving))
    )
    return problem, np.array([each.to_coordinate(each.guess) for each in unknowns])


def _joint_of(problem: Problem, unknown: int) -> int:
    """Number of the joint whose command has that offset."""
    return next(int(np.flatnonzero(at.offsets == unknown)[0]) for at in problem.places if unknown in at.offsets)
