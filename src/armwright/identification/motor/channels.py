"""Wrong signs and exchanged columns of a motor's log, found before the fit.

A motor obeys  u = R i + Ke w  and follows its command with a lag. With R and Ke of the least squares:

| R   | Ke  | what is wrong                               |
|-----|-----|---------------------------------------------|
| > 0 | > 0 | nothing                                     |
| < 0 | > 0 | the sign of the current                     |
| < 0 | < 0 | the sign of the voltage                     |
| > 0 | < 0 | the sign of the speed, or of the gear ratio |

unless  i = R u + Ke w  has both above 0 and explains more: voltage and current are exchanged then. Without a current a wrong
sign is seen as a speed against the command, an exchange as a response that comes before its cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armwright.errors import LogError
from armwright.fitting.measures import r_squared
from armwright.identification.linear.records import RecordedStretch
from armwright.identification.linear.residuals import CERTAIN as CHANCE, feedback
from armwright.identification.motor.guess import Guess, first_order
from armwright.identification.motor.measured import Measured

CERTAIN = 12.0  # standard deviations from 0 at which the sign of R or Ke is sure: rows are not independent
FOLLOWS, AGAINST = 0.7, 0.3  # R² of a first-order response that explains a motion, and by how much it is the better one
LOST, FOUND = 0.75, 0.95  # R² with the columns as they are, and exchanged, at which they are: a lag runs one way
LATE = 10  # samples that a voltage may act late
Columns = Sequence[np.ndarray]  # of stretches


def check_channels(data: Measured, joint: int, found: Guess, ratio: float | None, alone: bool, file: Path) -> None:
    """Refuses a log with a wrong sign or exchanged columns.

    Args:
        data: measurements.   joint: number of the joint.   found: its coarse guess.   ratio: of its gear; None if unknown.
        alone: the motor moves by itself, and its speed follows its command alone.   file: of the log.
    Raises:
        LogError: names the signal, and what to write in the log's file.
    """
    moving = [name for name in ("q", "qd", "qd_mean") if name in data.signals]
    if not moving:
        return
    motion = {"q": "position", "qd": "speed", "qd_mean": "speed"}[moving[-1]]
    command, name, w = data.command, data.joints[joint], [s.speed(joint) for s in data.stretches]
    against = alone and found.r2_against > FOLLOWS and found.r2_against > found.r2 + AGAINST
    if data.command == "voltage" and "current" in data.signals:
        u = [s.inputs.command[:, joint] for s in data.stretches]
        i = [s.values["current"][:, joint] for s in data.stretches]
        signs, r2 = _electrical(u, i, w, ratio)
        if signs not in ((0, 0), (1, 1)) or r2 < FOLLOWS:
            swapped, swapped_r2 = _electrical(i, u, w, ratio)
            if swapped == (1, 1) and swapped_r2 > max(FOLLOWS, r2) and not against:
                raise _exchanged("voltage", "current", name, "u = R i + Ke w holds the other way round", file)
        if r2 > FOLLOWS and signs == (-1, 1):
            raise _wrong_sign("current", name, "u = R i + Ke w gives a negative resistance", file)
        if r2 > FOLLOWS and signs == (-1, -1):
            raise _wrong_sign("voltage", name, "u = R i + Ke w gives a negative resistance and back-EMF", file)
        if r2 > FOLLOWS and signs == (1, -1):
            raise _wrong_sign(motion, name, "the back-EMF is negative", file, ratio)
    if against:
        what = f"the motor moves against its {command}"
        raise _wrong_sign(f"{command} or {motion}", name, what, file, ratio)
    if alone and max(found.r2, found.r2_against) < LOST:
        _check_exchange(data, joint, command, motion, file)


def _electrical(u: Columns, i: Columns, w: Columns, ratio: float | None) -> tuple[tuple[int, int], float]:
    """Signs of R and Ke of  u = R i + Ke w, 0 where one of them is not sure, and its R² with the delay that explains the most."""
    matrix = np.concatenate([np.column_stack([a, b, np.ones(len(a))]) for a, b in zip(i, w, strict=True)])
    inverse, best = np.linalg.pinv(matrix), (-np.inf, np.zeros(3), np.zeros(3))
    for late in range(LATE + 1):
        target = np.concatenate([np.concatenate([np.full(late, each[0]), each])[: len(each)] for each in u])
        solution = inverse @ target
        rest = float(((target - matrix @ solution) ** 2).sum())
        r2 = float(r_squared(rest, float(((target - target.mean()) ** 2).sum())))
        if r2 > best[0]:
            best = r2, solution, np.sqrt((inverse**2).sum(axis=1) * rest / max(len(target) - 3, 1))
    r2, solution, spread = best
    if (np.abs(solution[:2]) <= CERTAIN * spread[:2]).any():
        return (0, 0), r2
    return (int(np.sign(solution[0])), int(np.sign(solution[1] * (ratio or 1.0)))), r2


def _check_exchange(data: Measured, joint: int, command: str, motion: str, file: Path) -> None:
    """Refuses columns that explain each other once they are exchanged."""
    columns = {command: [s.inputs.command[:, joint] for s in data.stretches]}
    columns[motion] = [s.speed(joint) for s in data.stretches]
    if motion == "position":
        columns["raw"] = [s.values["q"][:, joint] for s in data.stretches]
    for name in ("current", "tau"):
        if name in data.signals:
            columns["torque" if name == "tau" else name] = [s.values[name][:, joint] for s in data.stretches]
    pairs = [(motion, command), *((motion, other) for other in columns if other not in (command, motion, "raw"))]
    for first, second in pairs:
        swapped = dict(columns) | {first: columns[second], second: columns["raw" if motion == "position" else first]}
        if motion == "position":
            swapped[motion] = [np.gradient(column) / data.period for column in swapped[motion]]
        best = first_order(swapped[command], swapped[motion], data.period, 2)
        if max(best.r2, best.r2_against) > FOUND:  # a lag of the one behind the other, with noise, has less either way
            raise _exchanged(
                first, second, data.joints[joint], "with them exchanged the motor follows its command", file
            )


def _wrong_sign(signal: str, joint: str, why: str, file: Path, ratio: float | None = None) -> LogError:
    gear = "" if ratio is None else f"; or is the gear ratio {-ratio:g}, not {ratio:g}?"
    words = signal.split(" or ")
    tables = " or of ".join(f'quantity = "{word}"' for word in words)
    expected = f"signs = [-1] in the [[signals]] of {tables}{gear}"
    return LogError(f"wrong sign of the {signal}: {why}", place=f"joint {joint!r}", expected=expected, file=file)


def _exchanged(first: str, second: str, joint: str, why: str, file: Path) -> LogError:
    expected = f'the columns of quantity = "{first}" and quantity = "{second}" the other way round'
    return LogError(
        f"{first} and {second} look exchanged: {why}", place=f"joint {joint!r}", expected=expected, file=file
    )


def feedback_remark(data: Measured, joint: int) -> list[str]:
    """A sentence if the command depends on earlier disturbances of the motion; empty without feedback. [Ljung1999]"""
    if not {"q", "qd", "qd_mean"} & set(data.signals):
        return []
    stretches = [RecordedStretch(s.run, s.inputs.command[:, [joint]], s.speed(joint)[:, None]) for s in data.stretches]
    if feedback(stretches, 1).p >= CHANCE:
        return []
    what = f"the {data.command} follows past disturbances of the motion (closed loop)"
    return [
        f"{what}: a fit by simulation is biased there unless these are white noise of the sensors; compare with an open-loop log"
    ]
