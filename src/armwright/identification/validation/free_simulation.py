"""Free simulation: an arm under the logged commands, or a scenario's closed loop, compared with the logged motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.errors import LogError, ScenarioError
from armwright.fitting.residuals import parts_of
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.preparation import shared_preparations
from armwright.identification.logs.prepared import prepare_log
from armwright.identification.logs.torques import COMMANDS, with_command
from armwright.identification.validation.match import Match, check_pose_free, match
from armwright.identification.validation.prediction import SIGNALS, Prediction, Quantity
from armwright.identification.validation.torque import as_logged, check_constants
from armwright.kernels.compiled import compile_arm
from armwright.model import Model
from armwright.parameters import Batch
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Recording, Start
from armwright.simulation.simulation import Simulation, simulate

if TYPE_CHECKING:
    import xarray as xr

WINDOW = 0.5  # [s] after which an arm that drifts starts again from the log
LEAST = 8  # steps of a window


@dataclass(frozen=True, eq=False)
class _Driven:
    """A run as a simulation needs it, at the rows where the filter has settled.

    Attributes:
        t: (rows,) [s].   windows: row numbers (k + 1,) of each window; the first is where it begins.
        start_q, start_qd: (rows, n), filtered.   commands: (rows, n), as logged.   q, qd: (rows, n) as logged; None: not logged.
        left_out: number of windows in which a command is missing.
    """

    run: LogRun
    t: np.ndarray
    windows: list[np.ndarray]
    start_q: np.ndarray
    start_qd: np.ndarray
    commands: np.ndarray
    q: np.ndarray | None
    qd: np.ndarray | None
    left_out: int


def driving_signal(arm: Model, matched: Match) -> str | None:
    """The input signal of a simulation: the record's command, else voltage, current or torque; None if none is logged.

    Behind the loops of servos, whose commands are positions, it is a voltage, current or torque.
    """
    own = {command: signal for signal, command in COMMANDS.items()}
    kinds = {body.drive.command for body in arm.coordinates}
    first = [own[kind] for kind in kinds if kind in own] if len(kinds) == 1 else []
    return next((signal for signal in (*first, *COMMANDS) if signal in matched.logged), None)


def simulate_log(arm: Model, log: Log, runs: Sequence[str], window: float | None = WINDOW) -> list[Prediction]:
    """Motion of an arm under the logged commands, held from row to row, in windows that each start from the log.

    A window begins with the position and speed of the filtered log; within it nothing is corrected. Robots drift in open
    loop, so the length of the windows belongs to every number that is made of them. Rows at the ends of a stretch that make
    no whole window are left out.

    Args:
        arm: a full record.   log: what `read_log` returned.   runs: names.
        window: [s]; None: whole stretches.
    Returns:
        predictions: of the position and of the speed of each run, where they are logged.
    Raises:
        LogError: an arm that does not match, no command or no motion in the log, a window too short.
        ArmwrightError: as `Simulation`.
    """
    matched = match(arm, log)
    signal = driving_signal(arm, matched)
    if signal is None:
        expected = "voltages, currents or torques of all joints"
        raise LogError("nothing logged that drives the arm", place="signals", expected=expected, file=log.path)
    check_constants(arm, signal, log)
    arm = as_logged(arm, log.lacks if signal == "tau" else ())
    if window is not None and not (isinstance(window, (int, float)) and window > 0):
        raise LogError(place="window", value=window, expected="a time above 0 [s]")
    if "q" not in matched.logged:
        check_pose_free(arm, compile_arm(arm), log)
    driven = [_driven(arm, log, matched, log.run(name), signal, window) for name in runs]
    moved = _simulated(with_command(arm, COMMANDS[signal]), driven)
    kept = f"{COMMANDS[signal]}s of the log held from row to row"
    length = "whole stretches" if window is None else f"windows of {window:g} s, each started from the log"
    how = f"free simulation, {kept}; {length}"
    if left_out := sum(run.left_out for run in driven):
        count = left_out + sum(len(run.windows) for run in driven)
        how += f", of which {left_out} of {count} are left out: a {COMMANDS[signal]} is missing there"
    return [
        prediction
        for run, windows in zip(driven, moved, strict=True)
        for prediction in _predictions(arm, run, windows, how, COMMANDS[signal])
    ]


def _driven(arm: Model, log: Log, matched: Match, run: LogRun, signal: str, window: float | None) -> _Driven:
    """A run with its windows.

    Raises:
        LogError: no speed, or a window that no stretch holds.
    """
    order = matched.columns
    # Filtered rows say where a window begins; what drives it, and what it is compared with, stays as it was logged.
    smooth = prepare_log(log, run.name, shared_preparations(log, [run.name], decimate=1)[run.name])
    if "qd" not in smooth:
        raise LogError("neither position nor speed logged", place="signals", expected="one of them", file=log.path)
    raw, t = log.dataset(run.name), smooth["time"].values
    at = np.minimum(np.searchsorted(raw["time"].values, t - 0.5 * run.period), raw.sizes["time"] - 1)
    commands = raw[signal].values[at][:, order]
    if signal == "tau":  # of the motors, where they are coupled
        commands = commands @ np.linalg.inv(motor_shares(arm))
    windows = _windows(smooth["stretch"].values, None if window is None else round(window / run.period))
    if not windows:
        longest = max((part.stop - part.start for part in parts_of(smooth["stretch"].values)), default=0)
        expected = f"{LEAST} rows at least, and no more than a stretch has, {longest * run.period:.4g} s"
        raise LogError(place="window", value=window, expected=expected, file=log.path)
    whole = [rows for rows in windows if np.isfinite(commands[rows[:-1]]).all()]
    if not whole:
        expected = f"a window of {len(windows[0]) - 1} rows in which none is missing"
        raise LogError(
            f"a {COMMANDS[signal]} is missing in every window", place="signals", expected=expected, file=log.path
        )
    logged = {name: raw[name].values[at][:, order] if name in matched.logged else None for name in ("q", "qd")}
    start_q = smooth["q"].values[:, order] if "q" in smooth else np.zeros((len(t), arm.n))
    start_qd, left_out = smooth["qd"].values[:, order], len(windows) - len(whole)
    return _Driven(run, t, whole, start_q, start_qd, commands, logged["q"], logged["qd"], left_out)


def _windows(stretch: np.ndarray, steps: int | None) -> list[np.ndarray]:
    """Row numbers of every window of so many steps; None: of every stretch."""
    found = []
    for part in parts_of(stretch):
        rows = part.stop - part.start
        length = min(rows - 1, steps or rows)
        if length >= LEAST:
            begins = range(part.start, part.stop - length, length)
            found += [np.arange(begin, begin + length + 1) for begin in begins]
    return found


def _simulated(arm: Model, driven: Sequence[_Driven]) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """q and q̇ (k, n) at the rows of every window of every run after its first; windows of the same length run side by side."""
    groups: dict[tuple[int, float], list[tuple[int, np.ndarray]]] = {}
    for number, each in enumerate(driven):
        for rows in each.windows:
            groups.setdefault((len(rows), round(each.run.period, 12)), []).append((number, rows))
    loop, found = None, {}
    for (count, period), members in groups.items():
        times = period * np.arange(count - 1)
        commands = [Schedule(times, driven[k].commands[rows[:-1]], tuple(arm.names)) for k, rows in members]
        start = Start(
            Batch(np.array([driven[k].start_q[rows[0]] for k, rows in members])),
            Batch(np.array([driven[k].start_qd[rows[0]] for k, rows in members])),
        )
        recording = Recording(period=period, what="state")
        scenario = Scenario(arm, (count - 1) * period, command=Batch(commands), start=start, recording=recording)
        simulation = Simulation(scenario, loop=loop)
        loop = simulation.loop
        run = simulation.run(keep_state=False)
        stopped = _stopped(run)
        for lane, (number, rows) in enumerate(members):
            q, qd = (run[name].values[lane, 1:] * (np.nan if stopped[lane] else 1.0) for name in ("q", "qd"))
            found[number, int(rows[0])] = (q, qd)
    return [[found[number, int(rows[0])] for rows in each.windows] for number, each in enumerate(driven)]


def _stopped(run: xr.Dataset) -> np.ndarray:
    """(lanes,) True where a lane diverged or ran out of steps."""
    stopped = np.zeros(run.sizes["lane"], dtype=bool)
    for name in ("diverged_at", "stalled_at"):
        if name in run:
            stopped |= np.isfinite(run[name].values)
    return stopped


def _predictions(
    arm: Model, run: _Driven, windows: list[tuple[np.ndarray, np.ndarray]], how: str, command: str
) -> Iterator[Prediction]:
    """Position and speed of a run, as far as they are logged."""
    rows = np.concatenate([each[1:] for each in run.windows])
    part = np.concatenate([np.full(len(each) - 1, k) for k, each in enumerate(run.windows)])
    diverged = sum(bool(np.isnan(q).any()) for q, _ in windows)
    logged: list[tuple[Quantity, np.ndarray | None, int]] = [("position", run.q, 0), ("speed", run.qd, 1)]
    for quantity, measured, which in logged:
        if measured is not None:
            predicted = np.concatenate([each[which] for each in windows])
            yield Prediction.of(
                arm, run.run, quantity, how, run.t[rows], part, measured[rows], predicted, speed=run.start_qd[rows],
                inputs=run.commands[rows - 1], input_name=command, diverged=diverged,
            )  # fmt: skip


def simulate_scenario(scenario: Scenario, log: Log, runs: Sequence[str]) -> list[Prediction]:
    """Closed-loop motion of a scenario, compared with runs of a log with the same reference and controller.

    Time 0 of the scenario is the first row of a run. Where the scenario states no initial position, it starts where the log
    does. Positions, speeds and torques are compared at the log's rows, as long as both last.

    Args:
        scenario: one without lanes.   log: what `read_log` returned.   runs: names.
    Returns:
        predictions: of all that is logged of position, speed and torque.
    Raises:
        LogError: an arm that does not match, nothing to compare.   ScenarioError: a scenario with lanes, or one that cannot run.
    """
    arm = scenario.arm
    matched = match(arm, log)
    if scenario.lane_count is not None:
        raise ScenarioError(
            place="lanes", value=scenario.lane_count, expected="a single run, to be compared with a log"
        )
    signals: dict[Quantity, str] = {quantity: name for quantity, name in SIGNALS.items() if name in matched.logged}
    if not signals:
        raise LogError("neither position, speed nor torque logged", place="signals", file=log.path)
    order, how = matched.columns, "the scenario's run, time 0 at the first row"
    found = []
    for name in runs:
        chosen, raw = log.run(name), log.dataset(name)
        states_none = isinstance(scenario.start, Start) and scenario.start.q is None
        start = Start(_first(raw, "q", order), _first(raw, "qd", order)) if states_none else scenario.start
        run = simulate(replace(scenario, start=start, recording=Recording()))
        inside = raw["time"].values <= float(run["time"][-1]) + 1e-9
        t = raw["time"].values[inside]
        for quantity, signal in signals.items():
            values = run[signal].values
            if signal == "tau":
                values = values @ motor_shares(arm)
            predicted = np.stack([np.interp(t, run["time"].values, each) for each in values.T], axis=1)
            speed = raw["qd"].values[inside][:, order] if "qd" in matched.logged else None
            part, measured = np.zeros(len(t), dtype=int), raw[signal].values[inside][:, order]
            found.append(Prediction.of(arm, chosen, quantity, how, t, part, measured, predicted, speed=speed))
    return found


def _first(raw: xr.Dataset, signal: str, order: list[int]) -> np.ndarray | None:
    """(n,) first row of a signal that is whole; None where it is not logged."""
    if signal not in raw:
        return None
    values = raw[signal].values[:, order]
    whole = np.flatnonzero(np.isfinite(values).all(axis=1))
    return values[whole[0]] if len(whole) else None
