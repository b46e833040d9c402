"""Motions that excite an arm for identification: Fourier series of the best condition, within limits. [SweversEtAl1997]

    minimise    condition number, or -log det, of the base regressor over a cycle
    subject to  rest at both ends, and limits of position, speed, acceleration, torque, voltage and of the tip's place

IPOPT solves it from several random starts [WachterBiegler2006]; the regressor and the torques are traced from the same
dynamics as all kernels. The motion is then judged on ten times as many instants by the compiled kernels; limits that it
exceeds between those of the design are tightened by the excess, and it is solved again. What a last round still exceeds is taken
away by a smaller swing of that joint.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import casadi
import numpy as np
from scipy.linalg import block_diag, null_space

from armwright.entry import AnyArm, as_arm
from armwright.errors import Interrupted, ScenarioError, check_known
from armwright.identification.experiments.columns import DRIVES, BaseRegressor
from armwright.identification.experiments.information import Criterion, condition_number, criterion_function
from armwright.identification.experiments.limits import ExcitationLimits, excitation_limits
from armwright.kernels.compiled import KERNELS
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.progress import Shown, automatic
from armwright.results.csv_tables import joint_columns, write_table
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.scalar import real_number
from armwright.trajectory.fourier import Fourier, rest_rows, series_matrices
from armwright.trajectory.limits import MotionLimits

SUPPORT = KERNELS.named("excite")

SAMPLES = 12  # instants of the design for each harmonic
DENSER = 10  # times as many for the judgement
ROUNDS = 6  # of tightening the limits
SPARE = 1e-3  # part of a limit that is left free beyond a measured excess
KEPT = 1.0 + 1e-9  # part of a limit that a motion may use: rounding
ITERATIONS = 300  # of IPOPT in the first round, at most
LATER_ITERATIONS = 60  # in those after it, which begin beside their solution
HISTORY = 6  # steps of the Hessian's approximation: each costs two solutions of the linear system in every iteration
SMALLEST_SPEED = 0.01  # of the largest: smooths the sign in Coulomb's column, where the record has no smoothing speed
SIZE_WEIGHT = 0.05  # of logdet beside the condition number: the larger of two motions counts
DRAWN = 50  # random motions for a start, which is the best of them
RATE = 500.0  # [Hz] of rows of a saved motion
MINIMISED: dict[str, str] = {
    "condition": "the condition number of the base regressor with columns of length 1",
    "condition_si": "the condition number of the base regressor in SI units",
    "logdet": "-log det of the information of the base regressor",
}
FIRST = 0.5  # part of the limits of position and speed that a random start uses


@dataclass(frozen=True, eq=False)
class Excitation(Result):
    """A designed motion.

    Attributes:
        limits: that it keeps.   trajectory: one cycle, from rest to rest.
        condition: number of the base regressor with columns of length 1.
        condition_si: the same in SI units, as most papers state it.   logdet: log det of WᵀW.
        columns: (p,) names of the base columns that it excites.
        used: by quantity (n,) part of each joint's limit that is used on the dense grid; NaN without a limit.
        starts: condition number of the motion from each start; infinite without a motion within the limits.
        reasons: sentences: what was minimised, what is not honoured and why.
    """

    limits: ExcitationLimits
    trajectory: Fourier
    condition: float
    condition_si: float
    logdet: float
    columns: tuple[str, ...]
    used: dict[str, np.ndarray]
    starts: tuple[float, ...] = ()
    reasons: tuple[str, ...] = ()

    @property
    def arm(self) -> Model:
        """The model."""
        return self.limits.arm

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about effects of the record that torques and voltages of the design approximate."""
        return SUPPORT.notes(self.arm)

    @property
    def margins(self) -> dict[str, np.ndarray]:
        """By quantity (n,) unused share of each joint's limit."""
        return {name: 1.0 - part for name, part in self.used.items()}

    def states(self, rate: float = RATE) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """t (k,) [s] and q, q̇, q̈ (k, n) of the cycle, both ends included, `rate` rows a second."""
        t = np.append(np.arange(0.0, self.trajectory.duration, 1.0 / rate), self.trajectory.duration)
        return t, *self.trajectory.at(t)

    def save(self, path: str | os.PathLike[str], rate: float = RATE) -> Path:
        """Writes the motion as CSV: t, then q, q̇ and q̈ of every joint, units in the header.

        Args:
            path: the file, replaced as a whole.   rate: rows in a second.
        Returns:
            path: of the file.
        Raises:
            OutputError: the file cannot be written.
        """
        t, *states = self.states(rate)
        columns = {"t [s]": t}
        for name, values in zip(("q", "qd", "qdd"), states, strict=True):
            columns |= joint_columns(name, self.arm.names, joint_units(self.arm, name), values)
        write_table(path, columns)
        return Path(path)

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return (
            f"{self.arm.name}: excitation of {len(self.columns)} base parameters, condition number {self.condition:.4g}"
        )

    def sentences(self) -> list[str]:
        """Remarks: the objective, constraints that are not kept and why, effects that are approximated."""
        return [*self.reasons, *self.notes]

    def tables(self) -> list[Table]:
        """A row for each joint: the largest part of each limit that is used."""
        heads = ("joint", *(f"{name} [% of its limit]" for name in self.used))
        rows = [
            [name, *(number(100.0 * part[k]) for part in self.used.values())] for k, name in enumerate(self.arm.names)
        ]
        return [Table(self.heading, heads, rows)]

    def __str__(self) -> str:
        width = max(len("joint"), *(len(name) for name in self.arm.names))
        lines = [
            f"{self.arm.name}: {len(self.columns)} base parameters, condition number {self.condition:.4g} "
            f"({self.condition_si:.4g} in SI units)",
            "largest part of its limit that is used:",
            f"{'joint':{width}}" + "".join(f"{name:>14}" for name in self.used),
        ]
        for k, name in enumerate(self.arm.names):
            cells = (f"{'':>14}" if np.isnan(part[k]) else f"{part[k]:>14.1%}" for part in self.used.values())
            lines.append(f"{name:{width}}{''.join(cells)}")
        return "\n".join([*lines, *self.reasons, *(f"note: {note}" for note in self.notes)])


def design_excitation(
    arm: AnyArm,
    *,
    limits: MotionLimits | None = None,
    box: Any = None,
    cycle: float = 10.0,
    harmonics: int = 5,
    criterion: Criterion = "condition",
    drives: Sequence[str] = DRIVES,
    starts: int = 4,
    seed: int = 0,
    progress: Shown = None,
) -> Excitation:
    """A periodic motion from rest to rest that excites all base parameters of an arm, within its limits. [SweversEtAl1997]

    Args:
        arm: a full record, or kinematics alone; then only motion limits are honoured. A payload of the record counts.
        limits: `MotionLimits.of(arm, velocity=…, torque=…)`, the record's but for these; None: the record's. Jerk does not count.
        box: (2, 3) lowest and highest x, y, z of the tip in base axes [m].
        cycle: duration of the motion [s], after which it repeats itself.   harmonics: of each joint, 2 or more.
        criterion: "condition" of the base regressor with columns of length 1, "condition_si" of that in SI units, or "logdet" of
            its information, which asks for large motions as well.
        drives: columns beside the links': "rotor", "viscous", "coulomb", "offset".
        starts: random ones, from `seed`; the best motion counts.   seed: of the starts.
        progress: True or None: a bar where it is seen; False: none; a function is called with starts done, and all.
    Returns:
        excitation: trajectory, condition number, used part of every limit, reasons.
    Raises:
        ScenarioError: numbers that are none, a joint that nothing bounds, or no motion within the limits.
        Interrupted: Ctrl-C; `found` holds the best motion of the starts until then.
    Example:
        >>> limits = aw.trajectories.MotionLimits.of("two-link", position=1.0, velocity=2.0)
        >>> found = aw.identification.design_excitation("two-link", limits=limits, starts=1)
        >>> found.condition < 30
        True
    """
    arm = as_arm(arm)
    _check(cycle, harmonics, starts, criterion, seed)
    bounds = excitation_limits(arm, limits, box)
    columns = BaseRegressor.of(arm, drives, _smoothing(bounds, cycle, harmonics))
    problem = ExcitationProblem.of(bounds, columns, cycle, harmonics, criterion)
    found = []
    with automatic(progress, f"designing a motion of {arm.name}") as tell:
        try:
            for k in range(starts):
                tell(k, starts)
                with _heard():
                    found.append(problem.solved(np.random.default_rng([seed, k])))
            tell(starts, starts)
        except KeyboardInterrupt:
            if all(each is None for each in found):
                raise
    within = [each for each in found if each is not None]
    if not within:
        raise ScenarioError(
            f"no motion within the limits was found from {starts} starts", place=arm.name,
            expected="wider limits, a longer cycle or more starts",
        )  # fmt: skip
    result = _result(problem, min(within, key=problem.value), found)
    if len(found) < starts:
        raise Interrupted(f"after {len(found)} of {starts} starts", found=result)
    return result


@contextlib.contextmanager
def _heard() -> Iterator[None]:
    """Ctrl-C ends the block, though CasADi takes it for an error of a function and goes on, or raises another error."""
    usual = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(usual):
        yield
        return
    heard: list[KeyboardInterrupt] = []

    def hear(number: int, frame: FrameType | None) -> None:
        try:
            usual(number, frame)
        except KeyboardInterrupt as stop:
            heard.append(stop)
            raise

    signal.signal(signal.SIGINT, hear)
    try:
        yield
    except SystemError:
        if not heard:
            raise
    finally:
        signal.signal(signal.SIGINT, usual)
    if heard:
        raise heard[0]


def _kept(used: dict[str, np.ndarray], outside: float) -> bool:
    """True if no limit is exceeded, and the tip stays in its box."""
    return all(np.nanmax(each, initial=0.0) <= KEPT for each in used.values()) and outside <= 0.0


def _check(cycle: Any, harmonics: Any, starts: Any, criterion: Any, seed: Any) -> None:
    if not 1e-6 < (real_number(cycle) or 0.0) < 1e6:
        raise ScenarioError(place="cycle", value=cycle, expected="a time from 1e-6 to 1e6 s")
    numbers = (("harmonics", harmonics, 2, 50), ("starts", starts, 1, 1000), ("seed", seed, 0, 2**63))
    for name, value, least, most in numbers:
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
            raise ScenarioError(place=name, value=value, expected=f"a whole number, {least} … {most}")
    check_known(ScenarioError, criterion, MINIMISED, "unknown", place="criterion")


def _smoothing(limits: ExcitationLimits, cycle: float, harmonics: int) -> np.ndarray:
    """(n,) speed that smooths Coulomb's sign: the record's, or a part of the largest speed."""
    natural = 0.5 * (limits.high - limits.low) * 2.0 * np.pi / cycle * harmonics
    usual = SMALLEST_SPEED * np.minimum(limits.most["velocity"], natural)
    known = [None if body.friction is None else body.friction.smoothing for body in limits.arm.coordinates]
    return np.array([usual[k] if speed is None else float(speed) for k, speed in enumerate(known)])


@dataclass(frozen=True, eq=False)
class ExcitationProblem:
    """The optimisation problem: unknowns x (n K) are for each joint [centre, K - 1 coefficients] / scale.

    Attributes:
        limits: of the motion.   columns: of the base regressor.   cycle: [s].   harmonics: of each joint.
        criterion: what is minimised.   rest: (2 harmonics, K - 1) coefficients that start and end at rest.
        scale: (n,) of a joint's unknowns.
    """

    limits: ExcitationLimits
    columns: BaseRegressor
    cycle: float
    harmonics: int
    criterion: Criterion
    rest: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(
        cls, limits: ExcitationLimits, columns: BaseRegressor, cycle: float, harmonics: int, criterion: Criterion = "condition"
    ) -> ExcitationProblem:  # fmt: skip
        """The problem of an arm with its limits."""
        rest = np.asarray(block_diag(*(null_space(row[None]) for row in rest_rows(harmonics))))
        slow = limits.most["velocity"] * cycle / (2.0 * np.pi)  # amplitude at the speed limit
        return cls(
            limits, columns, cycle, harmonics, criterion, rest, np.minimum(0.5 * (limits.high - limits.low), slow)
        )

    @property
    def samples(self) -> int:
        """Number of instants of the design."""
        return SAMPLES * self.harmonics

    def basis(self, count: int) -> list[np.ndarray]:
        """Values of q, q̇, q̈ by a joint's unknowns, each (count, K), at instants spread over the cycle."""
        t = np.arange(count)[:, None] * (self.cycle / count)
        blocks = [part @ self.rest for part in series_matrices(self.harmonics, self.cycle, t)]
        return [np.hstack([np.full((count, 1), float(k == 0)), block]) for k, block in enumerate(blocks)]

    def states(self, x: np.ndarray, count: int) -> list[np.ndarray]:
        """q, q̇, q̈, each (count, n)."""
        coefficients = x.reshape(len(self.scale), -1).T * self.scale
        return [part @ coefficients for part in self.basis(count)]

    def trajectory(self, x: np.ndarray) -> Fourier:
        """The motion, one cycle of it."""
        rows = x.reshape(len(self.scale), -1) * self.scale[:, None]
        sine, cosine = np.split(rows[:, 1:] @ self.rest.T, 2, axis=1)
        return Fourier(rows[:, 0], sine, cosine, self.cycle, cycles=1)

    def information(self, x: np.ndarray) -> np.ndarray:
        """WᵀW (p, p) over the dense grid, by the compiled regressor, divided by its number of instants."""
        count = DENSER * self.samples
        return self.columns.information(*self.states(x, count)) / count

    def value(self, x: np.ndarray) -> float:
        """Objective of the optimisation, on the dense grid."""
        information = self.information(x)
        return -np.linalg.slogdet(information)[1] if self.criterion == "logdet" else self.condition(information)

    def condition(self, information: np.ndarray) -> float:
        """Condition number of the regressor: in SI units where these are minimised, else with columns of length 1."""
        return condition_number(information, "none" if self.criterion == "condition_si" else "columns")

    def solved(self, generator: np.random.Generator) -> np.ndarray | None:
        """The best x from a random start; None if no motion is within the limits."""
        (solver, bounds), (later, _) = self._solver(ITERATIONS), self._solver(LATER_ITERATIONS)
        drawn = [self.random(generator) for _ in range(DRAWN)]
        x = min(drawn, key=self.value)
        part = {name: np.ones(len(self.scale)) for name in self.limits.used_names}
        inset = 0.0
        for k in range(ROUNDS):
            low, high = bounds(part, inset)
            x = np.asarray((later if k else solver)(x0=x, lbg=low, ubg=high)["x"]).ravel()
            used, outside = self._judged(x)
            if _kept(used, outside):
                return x
            for name, each in used.items():
                part[name] = np.where(each > 1.0, part[name] / each * (1.0 - SPARE), part[name])
            inset += outside * (1.0 + SPARE) + (SPARE * 1e-3 if outside else 0.0)
        swing = self.possible_swing(x)
        x = self.swung(x, swing)
        return x if swing.min() > 0.0 and _kept(*self._judged(x)) else None

    def _judged(self, x: np.ndarray) -> tuple[dict[str, np.ndarray], float]:
        """Used parts of all limits, and how far the tip leaves its box, on the dense grid."""
        q, qd, qdd = self.states(x, DENSER * self.samples)
        return self.limits.used(q, qd, qdd), self.limits.outside_box(q)

    def possible_swing(self, x: np.ndarray) -> np.ndarray:
        """(n,) share of each joint's swing about its centre, at most 1, that keeps position, speed and acceleration limits."""
        q, qd, qdd = self.states(x, DENSER * self.samples)
        limits, centre = self.limits, x.reshape(len(self.scale), -1)[:, 0] * self.scale
        tiny = np.finfo(float).tiny
        return np.minimum.reduce([
            np.ones(len(centre)),
            (limits.high - centre) / np.maximum((q - centre).max(axis=0), tiny),
            (centre - limits.low) / np.maximum((centre - q).max(axis=0), tiny),
            limits.most["velocity"] / np.maximum(np.abs(qd).max(axis=0), tiny),
            limits.most["acceleration"] / np.maximum(np.abs(qdd).max(axis=0), tiny),
        ])  # fmt: skip

    def swung(self, x: np.ndarray, part: np.ndarray) -> np.ndarray:
        """x with shares (n,) of the joints' swings about their centres."""
        rows = x.reshape(len(self.scale), -1).copy()
        rows[:, 1:] *= part[:, None]
        return rows.ravel()

    def random(self, generator: np.random.Generator) -> np.ndarray:
        """A random x within the limits of position and speed."""
        n, size = len(self.scale), self.rest.shape[1] + 1
        x = np.zeros((n, size))
        x[:, 1:] = generator.normal(size=(n, size - 1)) / np.tile(np.arange(1.0, size // 2 + 1.0), 2)[: size - 1]
        x[:, 0] = (
            self.limits.middle + 0.2 * (self.limits.high - self.limits.low) * generator.uniform(-1, 1, n)
        ) / self.scale
        q, qd, _ = self.states(x.ravel(), DENSER * self.samples)
        centre = x[:, 0] * self.scale
        room = np.minimum(self.limits.high - centre, centre - self.limits.low)
        most = np.maximum(np.abs(q - centre).max(axis=0) / room, np.abs(qd).max(axis=0) / self.limits.most["velocity"])
        return self.swung(x.ravel(), FIRST / most)

    def _solver(self, iterations: int) -> tuple[Any, Any]:
        """IPOPT with at most so many iterations, and a function of the limits' parts → bounds of its constraints."""
        n, count = len(self.scale), self.samples
        basis = self.basis(count)
        x = casadi.MX.sym("x", n * basis[0].shape[1])
        coefficients = casadi.reshape(x, basis[0].shape[1], n) @ casadi.diag(casadi.DM(self.scale))
        q, qd, qdd = ((casadi.DM(part) @ coefficients).T for part in basis)  # (n, count)
        rows = self.columns.graph().map(count)(q, qd, qdd)  # Yᵀ (p, n count)
        information = rows @ rows.T / count
        objective = criterion_function(len(self.columns), self.criterion)(information)
        if self.criterion != "logdet":
            objective += SIZE_WEIGHT * criterion_function(len(self.columns), "logdet")(information)
        values, bounds = self._constraints(q, qd, qdd)
        options = {
            "ipopt.hessian_approximation": "limited-memory", "ipopt.limited_memory_max_history": HISTORY,
            "ipopt.max_iter": iterations, "ipopt.tol": 1e-4,
            # without second derivatives the last digits of the optimum take longest, and mean nothing here
            "ipopt.acceptable_iter": 8, "ipopt.acceptable_obj_change_tol": 1e-4, "ipopt.acceptable_tol": 1e3,
            "ipopt.acceptable_dual_inf_tol": 1e10, "ipopt.acceptable_constr_viol_tol": 1e-3,
            "ipopt.acceptable_compl_inf_tol": 1e-2, "ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False,
        }  # fmt: skip
        return casadi.nlpsol(
            "excitation", "ipopt", {"x": x, "f": objective, "g": casadi.vertcat(*values)}, options
        ), bounds

    def _constraints(self, q: Any, qd: Any, qdd: Any) -> tuple[list[Any], Any]:
        """Values that are bounded, in parts of their limits, and a function that gives the bounds."""
        limits, count = self.limits, self.samples
        values: list[Any] = []
        names: list[tuple[str, np.ndarray]] = []

        def add(name: str, matrix: Any, most: np.ndarray) -> None:
            bounded = np.flatnonzero(np.isfinite(most))
            if len(bounded):
                rows = casadi.diag(casadi.DM(1.0 / most[bounded])) @ matrix[[int(k) for k in bounded], :]
                values.append(casadi.vec(rows))
                names.append((name, bounded))

        add("position", q - casadi.repmat(casadi.DM(limits.middle), 1, count), 0.5 * (limits.high - limits.low))
        add("velocity", qd, limits.most["velocity"])
        add("acceleration", qdd, limits.most["acceleration"])
        if limits.bounded("torque").any() or limits.bounded("voltage").any():
            tau = _mapped(limits.arm, "inverse_dynamics", count)(q, qd, qdd)
            add("torque", tau, limits.most["torque"])
            if limits.bounded("voltage").any():
                add("voltage", _mapped(limits.dyn.arm, "motor_voltage", count)(qd, tau), limits.most["voltage"])
        if limits.has_box:
            pose = _mapped(limits.arm, "forward_kinematics", count)(q)  # row-major (4, 4)
            values.append(casadi.vec(pose[[3, 7, 11], :]))

        def bounds(part: dict[str, np.ndarray], inset: float) -> tuple[np.ndarray, np.ndarray]:
            high = [np.tile(part[name][bounded], count) for name, bounded in names]
            low = [-each for each in high]
            if limits.has_box:
                low.append(np.tile(limits.box[0] + inset, count))
                high.append(np.tile(limits.box[1] - inset, count))
            return np.concatenate(low), np.concatenate(high)

        return values, bounds


def _mapped(arm: Model, name: str, count: int) -> casadi.Function:
    """A kernel's function for `count` states, one a column."""
    return trace_kernel(arm, SIGNATURES[name]).graph.map(count)


def _result(problem: ExcitationProblem, x: np.ndarray, found: Sequence[np.ndarray | None]) -> Excitation:
    """The design as users have it."""
    information, count = problem.information(x), DENSER * problem.samples
    starts = tuple(np.inf if each is None else problem.condition(problem.information(each)) for each in found)
    reasons = [
        f"minimised: {MINIMISED[problem.criterion]}, from {len(found)} starts",
        f"limits judged at {count} instants of the cycle",
        *problem.limits.reasons,
        "self-collision is not checked: look at the motion before it runs",
    ]
    failed = sum(each is None for each in found)
    if failed:
        reasons.append(f"{failed} of {len(found)} starts led to no motion within the limits")
    return Excitation(
        problem.limits,
        problem.trajectory(x),
        condition_number(information),
        condition_number(information, "none"),
        float(np.linalg.slogdet(information)[1]),
        problem.columns.names,
        problem.limits.used(*problem.states(x, count)),
        starts,
        tuple(reasons),
    )
