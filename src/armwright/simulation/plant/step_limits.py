"""The largest step for an arm, from the linearised arm with its motors before a simulation runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright.actuators.gear import loses_power
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.program import Program, interpret, kept
from armwright.simulation.integrate.integrators import Integrator
from armwright.simulation.integrate.stepping import speed_pairs
from armwright.simulation.plant.linearised import Slopes, linearised
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.recommended_step import recommended_step, step_of, written_step
from armwright.simulation.plant.step_causes import LEFT, Cause, Weakened
from armwright.simulation.plant.step_states import linearisation_states

REACH = 4.0  # no explicit rule of order 3 or 4 is stable beyond |h λ| = 4
RAYS = np.linspace(0.0, 1.0, 2049)[1:]
TURNING = 0.5  # h |λ| of a mode that swings or grows: a dozen steps a period, or the rule follows it nowhere
LONGEST = 0.1  # [s] the longest step that is tried of a rule with exact parts
FINE = 1.05  # how well its largest step is found, as a ratio
SLACK = 1e-4  # of a mode's growth in a step: what rounding makes of modes that neither grow nor die
SINGULAR = 1e-13  # of the largest eigenvalue of the mass matrix
NOTABLE = 1.05  # by how much the step must grow without an effect that is named
OTHER_STEPS = 'integrator = "auto" or "rodas3", which choose their steps'


@dataclass(frozen=True, eq=False)
class Limit:
    """The step that an integrator may take.

    Attributes:
        step: [s] up to which modes that die away do so in the simulation, and the others are followed; ∞ without modes.
        constant: [s] 1/|λ| of the mode that allows no larger step.   state: (size,) where it does; None without modes.
    """

    step: float
    constant: float
    state: np.ndarray | None = None


class StepLimit:
    """Linearised plants of an arm at states that matter, and the step that an integrator may take with them."""

    def __init__(self, model: Model, slopes: Program | None = None, values: np.ndarray | None = None):
        """The arm; `slopes`: its linearisation as `linearised` has it, with the varied parameters' `values`, to use again."""
        self.model, self.plant = model, Plant.of(model, brakes=True)
        self._program, self._values = slopes, [] if values is None else [values]
        self._limits: dict[tuple[Integrator, bytes], Limit] = {}
        self._linear: dict[bytes, tuple[Slopes, np.ndarray]] = {}

    @cached_property
    def states(self) -> np.ndarray:
        """(m, size) states to linearise at."""
        return linearisation_states(self.plant)

    @cached_property
    def _jacobian(self) -> Program:
        return self._program or kept(("linearised", self.model.sha256), lambda: linearised(self.model))

    def _slopes(self, command: np.ndarray) -> tuple[Slopes, np.ndarray]:
        """The plant linearised about those of the states (m, size) that have finite slopes, and these states."""
        key = command.tobytes()
        if key not in self._linear:
            slopes, fast = self._evaluated(self._jacobian, self.states, command, *self._values)
            finite = np.isfinite(slopes).all(axis=(1, 2))
            self._linear[key] = Slopes(slopes[finite], fast[finite], self.plant.stiff), self.states[finite]
        return self._linear[key]

    def _evaluated(
        self, program: Program, states: np.ndarray, command: np.ndarray, *values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Slopes (m, size, size) and λ (m, k) at some states, brakes applied."""
        brakes = [np.ones(len(self.plant.braked))] if self.plant.brakes else []
        result = interpret(program, states, command, *brakes, *values)
        return result if isinstance(result, tuple) else (result, np.zeros((len(result), 0)))

    def rates(self, command: np.ndarray) -> np.ndarray:
        """Eigenvalues [1/s] of the linearised plant at all those states: its time constants are 1/|Re λ|."""
        return np.ravel(self._slopes(command)[0].rates)

    def exact_rates(self, name: str, command: np.ndarray) -> np.ndarray:
        """λ [1/s] at all those states of the entries of one signal that are integrated exactly; none of a plant without it."""
        if name not in self.plant.layout:
            return np.zeros(0)
        place = self.plant.layout.place(name)
        entries = [k for k, at in enumerate(self.plant.stiff) if place.start <= at < place.stop]
        return self._slopes(command)[0].fast[:, entries]

    def largest_step(self, integrator: Integrator, command: np.ndarray) -> float:
        """The step [s] up to which modes that die away do so in the simulation, and the others are followed."""
        return self.limit(integrator, command).step

    def limit(self, integrator: Integrator, command: np.ndarray) -> Limit:
        """`largest_step`, and the mode and state that allow no larger one."""
        key = (integrator, command.tobytes())
        if key not in self._limits:
            slopes, states = self._slopes(command)
            step, constant, worst = self._limit(slopes, integrator, command)
            self._limits[key] = Limit(step, constant, None if worst is None else states[worst])
        return self._limits[key]

    def _limit(self, slopes: Slopes, integrator: Integrator, command: np.ndarray) -> tuple[float, float, int | None]:
        if not slopes.stiff:
            return _limit(slopes.rates, integrator)
        return _limit_exponential(slopes, integrator.paired(speed_pairs(self.plant.layout)), command)

    def recommended(
        self, limit: Limit, integrator: Integrator, command: np.ndarray, whole: Sequence[float] = ()
    ) -> float:
        """The step [s] that is accurate at the limit's state, where that allows one, and divides the times `whole`."""
        if limit.state is None:
            return written_step(limit.step, whole)
        slope, rate = (each[0] for each in self._evaluated(self._jacobian, limit.state[None], command, *self._values))
        rule = integrator.paired(speed_pairs(self.plant.layout))
        return recommended_step(slope, step_of(rule, slope, rate, self.plant.stiff, command), limit.step, whole)

    def cause(self, limit: Limit, integrator: Integrator, command: np.ndarray) -> Cause | None:
        """The effect without which a limit's state allows the largest step; or, if each alone changes little, as of two joints
        that are equally fast, the one that has the largest part in the fastest mode.
        """
        weakened = Weakened.of(self.model)
        if limit.state is None or not weakened.causes:
            return None
        program, count = linearised(self.model, weakened), len(weakened.causes)
        factors = 1.0 - (1.0 - LEFT) * np.eye(count)
        slopes, fast = self._evaluated(program, np.tile(limit.state, (count, 1)), command, factors)
        steps = [
            self._limit(Slopes(slope[None], rate[None], self.plant.stiff), integrator, command)[0]
            if np.isfinite(slope).all()
            else 0.0
            for slope, rate in zip(slopes, fast, strict=True)
        ]
        best = int(np.argmax(steps))
        if steps[best] <= NOTABLE * limit.step:
            whole, _ = self._evaluated(self._jacobian, limit.state[None], command, *self._values)
            best = _largest_part(whole[0], np.nan_to_num(whole - slopes), 1.0 / limit.constant)
        return weakened.causes[best]

    def check_step(
        self,
        name: str,
        integrator: Integrator,
        step: float,
        commands: np.ndarray,
        substeps: int | None = None,
        where: str = "",
        whole: Sequence[float] = (),
    ) -> None:
        """Refuses a step that is too large for the arm's fastest time constant.

        Args:
            name, integrator: the rule.   step: [s].   commands: (k, n) whose load is checked too, where losses grow with it.
            substeps: of a loop, whose period stays; None without a loop.   where: which of several arms it is, for the error.
            whole: [s] times that must hold a whole number of steps, beside that period.
        Raises:
            ScenarioError: names the time constant, the effect and key that it comes from, and what would do.
        """
        loaded = loads(self.model, commands)
        limits = [self.limit(integrator, command) for command in loaded]
        worst = int(np.argmin([limit.step for limit in limits]))
        limit = limits[worst]
        if step <= limit.step:
            return
        period = () if substeps is None else (substeps * step,)
        accurate = self.recommended(limit, integrator, loaded[worst], (*period, *whole))
        enough = f"{accurate:.12g} s"
        if substeps is not None:
            enough += f", by substeps = {round(substeps * step / accurate)}"
        cause = self.cause(limit, integrator, loaded[worst])
        of = "" if cause is None else f", that of {cause}"
        remedies = [cause.remedy] if cause is not None and cause.remedy else []
        raise ScenarioError(
            f"too large for the fastest time constant of {self.model.name}, {limit.constant:.3g} s{of}{where}: "
            f"{name} would blow up or lose track",
            place="step",
            value=step,
            expected="; or ".join([enough, *remedies, OTHER_STEPS]),
        )


def loads(arm: Model, commands: np.ndarray) -> list[np.ndarray]:
    """Commands (n,) at which an arm is linearised: none, and where losses or a bus make slopes grow with load, the most."""
    unloaded = np.zeros(arm.n)
    if arm.supply is None and not any(loses_power(body) for body in arm.coordinates):
        return [unloaded]
    most = np.abs(commands).max(axis=0)
    return [unloaded, most, -most]


def _limit(rates: np.ndarray, integrator: Integrator) -> tuple[float, float, int | None]:
    """Largest step, 1/|λ| of the mode that allows no larger one, and its row, from eigenvalues (m, k)."""
    size = np.abs(rates)
    dies = (-np.real(rates) > np.abs(np.imag(rates))) & (size > 0.0)
    reach = np.where(size > 0.0, TURNING, np.inf)  # h |λ| up to which each mode is as it should be
    # Modes that do not swing have all the same way.
    ways, which = np.unique(rates[dies] / size[dies], return_inverse=True)
    unstable = np.where(integrator.growth(np.outer(ways, REACH * RAYS)) > 1.0, REACH * RAYS, np.inf)
    reach[dies] = unstable.min(axis=1, initial=np.inf)[which]
    with np.errstate(divide="ignore"):
        steps = reach / size
    if not np.isfinite(steps).any():  # masses alone
        return np.inf, np.inf, None
    row, mode = np.unravel_index(np.argmin(steps), steps.shape)
    return float(steps[row, mode]), float(1.0 / size[row, mode]), int(row)


def _limit_exponential(linear: Slopes, rule: Integrator, command: np.ndarray) -> tuple[float, float, int | None]:
    """The same for a rule that integrates stiff parts exactly: the rule's own step of the linearised plants is tried."""
    slopes, fast = linear.slopes, linear.fast
    values = np.linalg.eigvals(slopes)
    swings = (-values.real <= np.abs(values.imag)) & (np.abs(values) > 0.0)
    swinging = np.where(swings, np.abs(values), 0.0)
    fastest = float(swinging.max(initial=0.0))
    high = min(LONGEST, TURNING / fastest if fastest else np.inf)
    growing = np.maximum(values.real.max(axis=1), 0.0)

    def failing(step: float, row: int) -> float | None:
        """1/|λ| of a mode of that row which this step does not hold; None where it holds all of them."""
        slope = slopes[row]
        factors, modes = np.linalg.eig(step_of(rule, slope, fast[row], linear.stiff, command)(step))
        worst = int(np.abs(factors).argmax())
        if np.abs(factors[worst]) > np.exp(growing[row] * step) + SLACK:
            return 1.0 / abs(_nearest_rate(slope, modes[:, worst]))
        return None

    # Every row halves the same interval, and those that hold the least step found so far need not: so the search takes little
    # more than one step of each row.
    found: tuple[float, float, int] | None = None
    for row in range(len(slopes)):
        fails = failing(high if found is None else found[0], row)
        if fails is None:
            continue
        low, least, constant = 1e-6 * high, high, fails
        while least > FINE * low:
            middle = float(np.sqrt(low * least))
            fails = failing(middle, row)
            if fails is None:
                low = middle
            else:
                least, constant = middle, fails
        found = low, constant, row
    if found is None:
        row = int(np.argmax(swinging.max(axis=1)))
        return high, 1.0 / fastest if fastest else LONGEST, row
    # Of the rest, if there is any, whose errors may make slow modes grow.
    explicit = 1.0 / max(float(np.abs(linear.rates).max(initial=0.0)), 1.0 / LONGEST)
    low, constant, row = found
    return low, min(constant, explicit), row


def _largest_part(slope: np.ndarray, parts: np.ndarray, size: float) -> int:
    """Index of the part (k, n, n) of a slope (n, n) that changes the mode of |λ| nearest to `size` [1/s] the most.

    To first order  δλ = wᴴ δA v / wᴴ v  with the left and right eigenvectors w and v of λ.
    """
    import scipy.linalg  # slow to import, and needed only for what is said of a step that is too long

    rates, left, right = scipy.linalg.eig(slope, left=True, right=True)  # type: ignore[misc]
    mode = int(np.argmin(np.abs(np.abs(rates) - size)))
    return int(np.argmax(np.abs(left[:, mode].conj() @ parts @ right[:, mode])))


def _nearest_rate(slope: np.ndarray, moved: np.ndarray) -> complex:
    """Eigenvalue [1/s] of a linearised plant whose mode takes the largest part in another vector (size,)."""
    rates, modes = np.linalg.eig(slope)
    parts = np.linalg.lstsq(modes, moved, rcond=None)[0]
    return rates[int(np.abs(np.where(rates == 0.0, 0.0, parts)).argmax())]


def full_voltage(arm: Model) -> np.ndarray:
    """Commands (n,) of a loop that load a supply's bus the most: all its voltage; 0 for other drives, and without a supply."""
    volts = 0.0 if arm.supply is None else float(arm.supply.voltage)
    return np.array([volts * (body.drive.command == "voltage") for body in arm.coordinates])


def check_inertia(arm: Model, q: np.ndarray) -> None:
    """Refuses an arm with a joint that nothing gives inertia to.

    Raises:
        ScenarioError: names the joint.
    """
    values, vectors = np.linalg.eigh(Plant.of(arm).inertia(q).astype(float))
    if values[0] <= SINGULAR * values[-1]:
        joint = arm.names[int(np.abs(vectors[:, 0]).argmax())]
        raise ScenarioError(
            "it moves no inertia (a massless link without a rotor?), the mass matrix is singular at the initial position",
            place=f"joint {joint}",
            expected="mass or rotor_inertia_kg_m2 behind every joint",
        )
