"""Experiments for one motor: step, staircase, PRBS, multisine and chirp, sized from a coarse first guess. [Ljung1999]

The guess is a first-order motor with a dead zone:   T dw/dt + w = gain · (u beyond the dead zone),   dθ/dt = w.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from armwright import scalar
from armwright.errors import ModelError, ScenarioError, check_known
from armwright.kernels.compiled import compile_arm
from armwright.model import Model
from armwright.results.csv_tables import write_table
from armwright.results.result import Result
from armwright.simulation.inputs.schedule import Schedule

USED = 0.9  # part of a limit that an experiment is sized for: the guess is coarse
SETTLED = 5.0  # time constants after which a step has settled to 0.7 %
FINEST = 50  # samples of a time constant, of the chirp
OF_FASTEST = 20  # samples of the multisine's fastest sine
FASTEST, SLOWEST = 10.0, 0.1  # times the corner frequency 1 / 2πT that an experiment reaches
LEVELS = 8  # of the staircase, either way
BITS = 9  # of the PRBS: its longest pulse lasts 3 T with a clock of T / 3
CLOCK = 3  # clock periods of the PRBS in a time constant
LINES = 40  # frequencies of the multisine, before the lowest are rounded to whole harmonics
SWEEP = 10.0  # periods of the lowest frequency that the chirp lasts
CLIPPED = 200  # rounds that lower the multisine's crest
OUT_OF_ZONE = 2.0  # times the dead zone that a command must reach at least


@dataclass(frozen=True)
class MotorGuess:
    """A coarse first guess of a motor with its load, and its limits.

    Args:
        gain: steady speed for a command beyond the dead zone [rad/s per unit of the command].   time_constant: T [s].
        most: largest command [V | A | N m].   dead_zone: command below which nothing moves.
        speed: largest speed [rad/s].   travel: how far it may move to either side of its start [rad].
        unit: of the command.   joint: its name, the head of columns.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> guess = aw.identification.MotorGuess(gain=5.0, time_constant=0.05, most=10.0)
        >>> guess.dead_zone
        0.0
    """

    gain: float
    time_constant: float
    most: float
    dead_zone: float = 0.0
    speed: float = np.inf
    travel: float = np.inf
    unit: str = "V"
    joint: str = "motor"

    def __post_init__(self) -> None:
        for name in ("gain", "time_constant", "most", "dead_zone", "speed", "travel"):
            number = scalar.real_number(getattr(self, name))
            is_open = name in ("speed", "travel")  # they may be infinite
            least = number == 0.0 if name == "dead_zone" else False
            if number is None or not (number > 0.0 or least) or (number == np.inf and not is_open):
                expected = "0 or more" if name == "dead_zone" else "a number above 0"
                raise ScenarioError(place=f"MotorGuess.{name}", value=getattr(self, name), expected=expected)
        if self.dead_zone * OUT_OF_ZONE > self.most:
            expected = f"{OUT_OF_ZONE:g} times the dead zone, {OUT_OF_ZONE * self.dead_zone:g}, or more"
            raise ScenarioError(
                "hardly leaves the dead zone", place="MotorGuess.most", value=self.most, expected=expected
            )

    @classmethod
    def of(cls, arm: Model, joint: str | None = None, q: object = None, most: float | None = None) -> MotorGuess:
        """The guess from a record for one joint's voltage, the others at rest.

        gain = 1 / (n Ke),  T = R J / (n² Kt Ke),  J the joint's entry of the mass matrix,
        dead zone = R Fc / (n Kt) + that of the stage.

        Args:
            arm: with motor constants.   joint: its name; None: the only one, or the first.   q: (n,) pose [rad | m]; None: 0.
            most: largest voltage [V]; None: the record's limit.
        Raises:
            ModelError: no such joint, or a drive without its constants or limits.
        """
        name = arm.names[0] if joint is None else joint
        check_known(ModelError, name, arm.names, "no joint of the arm", place="joint")
        k = arm.names.index(name)
        body, pose = arm.coordinates[k], np.zeros(arm.n) if q is None else np.asarray(q, dtype=float)
        drive, limits, friction = body.drive, body.limits, body.friction
        volts = float(limits.voltage) if most is None else most
        known = {
            "resistance": drive.resistance is not None, "torque constant": drive.torque_constant is not None,
            "largest voltage": np.isfinite(volts),
        }  # fmt: skip
        missing = [what for what, there in known.items() if not there]
        if drive.resistance is None or drive.torque_constant is None or missing:
            expected = "a record that has it" + (
                ", or most=… (--max-command)" if missing == ["largest voltage"] else ""
            )
            raise ModelError(f"no {', no '.join(missing)}", place=f"joint {name!r}", expected=expected)
        kt = abs(float(drive.gear_ratio) * float(drive.torque_constant))
        ke = kt if drive.back_emf_constant is None else abs(float(drive.gear_ratio) * float(drive.back_emf_constant))
        inertia = float(compile_arm(arm).mass_matrix(pose)[k, k])
        coulomb = 0.0 if friction is None else max(float(friction.coulomb_positive), float(friction.coulomb_negative))
        room = min(limits.position[1] - pose[k], pose[k] - limits.position[0])
        resistance, stage = float(drive.resistance), 0.0 if drive.dead_zone is None else float(drive.dead_zone)
        return cls(
            1.0 / ke, resistance * inertia / (kt * ke), volts, resistance * coulomb / kt + stage,
            float(limits.velocity), float(room), "V", name,
        )  # fmt: skip

    @property
    def corner_hz(self) -> float:
        """The corner frequency 1 / 2πT, in Hz."""
        return 1.0 / (2.0 * np.pi * self.time_constant)

    def response(self, values: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
        """Predicted speed and angle (k + 1,) for commands (k,) held for `period` [s] each."""
        beyond = np.sign(values) * np.maximum(np.abs(values) - self.dead_zone, 0.0)
        decay = np.exp(-period / self.time_constant)
        speed = np.concatenate([[0.0], signal.lfilter([1.0 - decay], [1.0, -decay], self.gain * beyond)])
        goal = self.gain * beyond  # angle of an exponential approach to `goal` over each sample, exact
        change = goal * period + (speed[:-1] - goal) * self.time_constant * (1.0 - decay)
        return speed, np.concatenate([[0.0], np.cumsum(change)])


@dataclass(frozen=True, eq=False)
class MotorExperiment(Result):
    """A command over time, one value for each period.

    Attributes:
        kind: "step", "staircase", "prbs", "multisine" or "chirp".   guess: that it was sized from.
        period: [s] that each value is held.   values: (k,) commands.   reasons: sentences on its size.
    """

    kind: str
    guess: MotorGuess
    period: float
    values: np.ndarray
    reasons: tuple[str, ...] = ()

    @property
    def times(self) -> np.ndarray:
        """(k,) [s] start time of each value."""
        return np.arange(len(self.values)) * self.period

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return len(self.values) * self.period

    @property
    def crest(self) -> float:
        """Crest factor: peak divided by RMS."""
        return float(np.abs(self.values).max() / np.sqrt(np.mean(self.values**2)))

    @property
    def schedule(self) -> Schedule:
        """The command for `Scenario(command=…)`; rows only at changes."""
        changed = np.concatenate([[True], np.diff(self.values) != 0.0])
        return Schedule(self.times[changed], self.values[changed][:, None], (self.guess.joint,))

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the experiment as CSV: t and the command, a row for every period, as `read_schedule` reads it.

        Returns:
            path: of the file.
        Raises:
            OutputError: the file cannot be written.
        """
        write_table(path, {"t [s]": self.times, f"{self.guess.joint} [{self.guess.unit}]": self.values})
        return Path(path)

    def __str__(self) -> str:
        speed, angle = self.guess.response(self.values, self.period)
        head = f"{self.kind}: {self.duration:.4g} s in {len(self.values)} values of {self.period:.4g} s, crest {self.crest:.3g}"
        peaks = f"expected: up to {np.abs(self.values).max():.4g} {self.guess.unit}, {np.abs(speed).max():.4g} rad/s"
        return "\n".join([head, f"{peaks}, {np.abs(angle).max():.4g} rad from the start", *self.reasons])


def motor_experiment(kind: str, guess: MotorGuess, *, period: float = 1e-3, seed: int = 0) -> MotorExperiment:
    """An experiment that identifies a motor, as large as the limits of the guess allow.

    "step": up, back to zero, down, and back, each for 5 T: gain, time constant, delay. "staircase": 8 levels up and down
    either way, each for 5 T: the static curve, dead zone and friction. "prbs": a maximum-length sequence with a clock of T / 3:
    linear models.
    "multisine": frequencies from 0.1 to 10 times the corner with a low crest: frequency response, nonlinear distortions.
    "chirp": the same band, swept.

    Args:
        kind: one of these.   guess: of the motor.
        period: sample period [s] of the device that plays the command; each value is held for a multiple of it.
        seed: of the PRBS's beginning.
    Returns:
        experiment: its command, with reasons.
    Raises:
        ScenarioError: an unknown kind, or travel or speed that leave no room for it; says how much it would take.
    Example:
        >>> guess = aw.identification.MotorGuess(gain=5.0, time_constant=0.05, most=10.0)
        >>> test = aw.identification.motor_experiment("step", guess)
        >>> test.kind
        'step'
    """
    check_known(ScenarioError, kind, KINDS, "unknown", place="kind")
    number = scalar.real_number(period)
    if number is None or not 0.0 < number <= guess.time_constant:
        expected = f"a time above 0, up to the time constant {guess.time_constant:g} s"
        raise ScenarioError(place="period", value=period, expected=expected)
    shape, held, reasons = KINDS[kind](guess, period, seed)
    size, bound = _size(kind, guess, shape, held)
    values = size * shape
    reason = f"as large as {bound} allows: {size:.4g} {guess.unit}"
    return MotorExperiment(kind, guess, held, values, (*reasons, reason))


def _size(kind: str, guess: MotorGuess, shape: np.ndarray, period: float) -> tuple[float, str]:
    """Largest factor of a shape within ±1 that the limits allow, and the limit that decides."""

    def over(size: float) -> dict[str, float]:
        speed, angle = guess.response(size * shape, period)
        return {
            "speed": np.abs(speed).max() / (USED * guess.speed),
            "travel": np.abs(angle).max() / (USED * guess.travel),
        }

    most = USED * guess.most
    if max(over(most).values()) <= 1.0:
        return most, "the largest command"
    low, high = 0.0, most
    for _ in range(60):  # bisection: speed and travel grow with the size
        middle = 0.5 * (low + high)
        low, high = (middle, high) if max(over(middle).values()) <= 1.0 else (low, middle)
    bound = max(over(high).items(), key=lambda item: item[1])[0]
    least = max(OUT_OF_ZONE * guess.dead_zone, 0.05 * guess.most)
    if low < least:
        limit, unit = (guess.speed, "rad/s") if bound == "speed" else (guess.travel, "rad")
        expected = f"{limit * over(least)[bound]:.4g} {unit} or more for {least:.4g} {guess.unit}"
        what = f"{bound} leaves no room for a {kind}"
        raise ScenarioError(what, place=f"MotorGuess.{bound}", value=limit, expected=expected)
    return low, f"the {bound}"


Shaped = tuple[np.ndarray, float, tuple[str, ...]]


def _held(period: float, sample: float) -> float:
    """The multiple of a sample period that is nearest, one at least [s]."""
    return max(round(period / sample), 1) * sample


def _steps(levels: np.ndarray, guess: MotorGuess, sample: float, reason: str) -> Shaped:
    return np.asarray(levels, dtype=float), _held(SETTLED * guess.time_constant, sample), (reason,)


def step_shape(guess: MotorGuess, sample: float, _seed: int) -> Shaped:
    """Shape of a step experiment: 0, up, 0, down, 0."""
    reason = f"each level for {SETTLED:g} time constants: it settles to 0.7 %"
    return _steps(np.array([0.0, 1.0, 0.0, -1.0, 0.0]), guess, sample, reason)


def staircase_shape(guess: MotorGuess, sample: float, _seed: int) -> Shaped:
    """Levels up and down, each followed by its opposite, so that the motor stays near its start."""
    levels = np.concatenate([np.arange(1, LEVELS + 1), np.arange(LEVELS, 0, -1)]) / LEVELS
    pairs = np.stack([levels, -levels], axis=1)
    pairs[1::2] = -pairs[1::2]
    reason = f"{LEVELS} levels up and down, each for {SETTLED:g} time constants and followed by its opposite"
    return _steps(np.concatenate([[0.0], pairs.ravel(), [0.0]]), guess, sample, reason)


def prbs_shape(guess: MotorGuess, sample: float, seed: int) -> Shaped:
    """A maximum-length sequence of ±1, with the flattest spectrum that two levels have."""
    bits = np.random.default_rng(seed).integers(0, 2, BITS)
    bits[0] = 1  # all zeros would stay so
    values = 2.0 * signal.max_len_seq(BITS, state=bits)[0] - 1.0
    period = _held(guess.time_constant / CLOCK, sample)
    band = 0.44 / period
    return values, period, (
        f"2^{BITS} - 1 values: its power falls to half at {band:.4g} Hz, {band / guess.corner_hz:.3g} times the corner",
    )  # fmt: skip


def multisine_shape(guess: MotorGuess, sample: float, _seed: int) -> Shaped:
    """A sum of sines of equal size with a low crest, one period of it. [Schroeder1970], [VanDerOuderaa1988]

    Phases by Schroeder for a flat spectrum, φ_k = -π k (k - 1) / K, then lowered further: peaks are cut off, and the phases of
    what is left are taken with the old amplitudes.
    """
    harmonics = np.unique(np.round(np.geomspace(1.0, FASTEST / SLOWEST, LINES)).astype(int))
    count = OF_FASTEST * int(harmonics[-1])
    period = _held(1.0 / (SLOWEST * guess.corner_hz * count), sample)
    lowest = 1.0 / (period * count)
    order = np.arange(1, len(harmonics) + 1)
    phases = -np.pi * order * (order - 1) / len(order)
    best = values = _sum_of_sines(harmonics, phases, count)
    for _ in range(CLIPPED):
        peak = np.abs(values).max()
        spectrum = np.fft.rfft(np.clip(values, -0.9 * peak, 0.9 * peak))
        values = _sum_of_sines(harmonics, np.angle(spectrum[harmonics]), count)
        if np.abs(values).max() < np.abs(best).max():  # RMS is always the same
            best = values
    band = f"from {lowest:.4g} to {lowest * harmonics[-1]:.4g} Hz"
    reason = f"{len(harmonics)} frequencies {band}; repeat it, and drop the first period"
    return best / np.abs(best).max(), period, (reason,)


def _sum_of_sines(harmonics: np.ndarray, phases: np.ndarray, count: int) -> np.ndarray:
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    spectrum[harmonics] = np.exp(1j * phases)
    return np.fft.irfft(spectrum, count)


def chirp_shape(guess: MotorGuess, sample: float, _seed: int) -> Shaped:
    """A sine with an exponentially growing frequency."""
    lowest, highest = SLOWEST * guess.corner_hz, FASTEST * guess.corner_hz
    period = _held(guess.time_constant / FINEST, sample)
    duration = SWEEP / lowest
    t = np.arange(round(duration / period)) * period
    values = signal.chirp(t, lowest, duration, highest, method="logarithmic", phi=-90)
    return values, period, (f"from {lowest:.4g} to {highest:.4g} Hz, the corner being at {guess.corner_hz:.4g} Hz",)


KINDS: dict[str, Callable[[MotorGuess, float, int], Shaped]] = {
    "step": step_shape, "staircase": staircase_shape, "prbs": prbs_shape, "multisine": multisine_shape, "chirp": chirp_shape,
}  # fmt: skip
