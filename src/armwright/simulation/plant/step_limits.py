"""The largest step for an arm, from the linearised arm with its motors before a simulation runs; for varied arms by lane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from math import floor, log10

import casadi
import numpy as np

from armwright.actuators.friction import LAWS
from armwright.actuators.gear import loses_power
from armwright.errors import ScenarioError
from armwright.model import Body, Model, TableSpring
from armwright.model.vary import Varied
from armwright.program import Program, interpret, trace
from armwright.program.program import Port
from armwright.scalar import Array
from armwright.simulation.integrate.exponential import Split
from armwright.simulation.integrate.integrators import Integrator
from armwright.simulation.integrate.stepping import speed_pairs
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant

POSES = 16  # drawn over the joints' ranges, always the same ones
REACH = 4.0  # no explicit rule of order 3 or 4 is stable beyond |h λ| = 4
RAYS = np.linspace(0.0, 1.0, 2049)[1:]
TURNING = 0.5  # h |λ| of a mode that swings or grows: a dozen steps a period, or the rule follows it nowhere
LONGEST = 0.1  # [s] the longest step that is tried of a rule with exact parts
FINE = 1.05  # how well its largest step is found, as a ratio
SLACK = 1e-4  # of a mode's growth in a step: what rounding makes of modes that neither grow nor die
TOUCH = 0.6  # of the play: just beyond the half where flanks touch
DEEP = 1e-6  # [rad | m] into a stop
SINGULAR = 1e-13  # of the largest eigenvalue of the mass matrix
LOOKED_AT = 256  # lanes, beside those with the least and the most of every parameter
FULLY = 2  # lanes that are checked in every state, of each kind of mode
STATES = 10  # in which modes of lanes are compared
STILL = 1e-3  # of a smoothing speed: just beside standstill, where friction may have another slope on either side


class StepLimit:
    """Linearised plants of an arm at states that matter, and the step that an integrator may take with them."""

    def __init__(self, model: Model, slopes: Program | None = None, values: np.ndarray | None = None):
        """The arm; `slopes`: its linearisation as `linearised` has it, with the varied parameters' `values`, to use again."""
        self.model, self.plant = model, Plant.of(model, brakes=True)
        self._slopes, self._values = slopes, [] if values is None else [values]
        self._limits: dict[tuple[Integrator, bytes], tuple[float, float]] = {}
        self._rates: dict[bytes, np.ndarray] = {}

    @cached_property
    def _jacobian(self) -> Program:
        return self._slopes or linearised(self.model)

    def _linearised(self, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slopes (m, size, size) and λ (m, k) at those of the states that have finite ones, brakes applied."""
        brakes = [np.ones(len(self.plant.braked))] if self.plant.brakes else []
        result = interpret(self._jacobian, self.states, command, *brakes, *self._values)
        slopes, fast = result if isinstance(result, tuple) else (result, np.zeros((len(result), 0)))
        finite = np.isfinite(slopes).all(axis=(1, 2))
        return slopes[finite], fast[finite]

    @cached_property
    def states(self) -> np.ndarray:
        """(m, size) states to linearise at: poses over the joints' ranges, at speeds where friction is steep."""
        n = self.model.n
        low = np.array([max(body.limits.position[0], -np.pi) for body in self.model.coordinates])
        high = np.array([min(body.limits.position[1], np.pi) for body in self.model.coordinates])
        poses = low + (high - low) * np.random.default_rng(0).uniform(size=(POSES, n))
        poses[0] = np.clip(0.0, low, high)
        for joint, body in enumerate(self.model.coordinates):
            if isinstance(body.spring, TableSpring):
                poses[-1, joint] = _steepest_position(body.spring)
        speeds = np.array([_steep_speeds(body) for body in self.model.coordinates]).T
        if self.plant.size == 2 * n and not any(self.plant.contacts):
            return np.concatenate([np.hstack([poses, np.broadcast_to(speed, poses.shape)]) for speed in speeds])
        states = np.array(
            [x for q in _with_stops(self.model, poses) for speed in speeds for x in self._contacts(q, speed)]
        )
        if self.model.supply is not None:  # just below the source's voltage, where its rectifier opens
            self.plant.part(states, "bus_voltage")[:] *= 1.0 - STILL
        return states

    def _contacts(self, q: np.ndarray, speed: np.ndarray) -> list[np.ndarray]:
        """The plant's state there; where gears have play, with flanks in touch on either side as well."""
        x = self.plant.initial(q, speed)
        gaps = [0.0 if body.elasticity is None else body.elasticity.backlash or 0.0 for body in self.model.coordinates]
        if not any(gaps):
            return [x]
        moved = np.zeros_like(x)
        self.plant.part(moved, "motor_q")[:] = [
            TOUCH * gaps[i] * body.drive.gear_ratio
            for i, body in enumerate(self.model.coordinates)
            if body.elasticity is not None
        ]
        return [x, x + moved, x - moved]

    def rates(self, command: np.ndarray) -> np.ndarray:
        """Eigenvalues [1/s] of the linearised plant at all those states: its time constants are 1/|Re λ|."""
        key = command.tobytes()
        if key not in self._rates:
            slopes, _ = self._linearised(command)
            if self.plant.stiff:  # what is integrated exactly has no say in this; its time constants are no limit
                kept = np.setdiff1d(np.arange(self.plant.size), self.plant.stiff)
                slopes = slopes[:, kept[:, None], kept]
            self._rates[key] = np.ravel(np.linalg.eigvals(slopes))
        return self._rates[key]

    def exact_rates(self, name: str, command: np.ndarray) -> np.ndarray:
        """λ [1/s] at all those states of the entries of one signal that are integrated exactly; none of a plant without it."""
        if name not in self.plant.layout:
            return np.zeros(0)
        place = self.plant.layout.place(name)
        return self._linearised(command)[1][
            :, [k for k, at in enumerate(self.plant.stiff) if place.start <= at < place.stop]
        ]

    def largest_step(self, integrator: Integrator, command: np.ndarray) -> float:
        """The step [s] up to which modes that die away do so in the simulation, and the others are followed."""
        return self.limit(integrator, command)[0]

    def limit(self, integrator: Integrator, command: np.ndarray) -> tuple[float, float]:
        """`largest_step`, and 1/|λ| of the mode that allows no larger one, both [s]."""
        key = (integrator, command.tobytes())
        if key not in self._limits:
            find = self._limit_exponential if self.plant.stiff else self._limit
            self._limits[key] = find(integrator, command)
        return self._limits[key]

    def _limit(self, integrator: Integrator, command: np.ndarray) -> tuple[float, float]:
        rates = self.rates(command)
        rates = rates[np.abs(rates) > 0.0]
        if not rates.size:  # masses alone
            return np.inf, np.inf
        dies = -np.real(rates) > np.abs(np.imag(rates))
        reach = np.full(len(rates), TURNING)  # h |λ| up to which each mode is as it should be
        z = np.outer(rates[dies] / np.abs(rates[dies]), REACH * RAYS)
        reach[dies] = np.where(integrator.growth(z) > 1.0, REACH * RAYS, np.inf).min(axis=1, initial=np.inf)
        steps = reach / np.abs(rates)
        limiting = int(np.argmin(steps))
        return float(steps[limiting]), float(1.0 / np.abs(rates[limiting]))

    def _limit_exponential(self, integrator: Integrator, command: np.ndarray) -> tuple[float, float]:
        """The same for a rule that integrates stiff parts exactly: the rule's own step of the linearised plants is tried."""
        slopes, fast = self._linearised(command)
        values = np.linalg.eigvals(slopes)
        swinging = np.abs(values)[(-values.real <= np.abs(values.imag)) & (np.abs(values) > 0.0)]
        high = min(LONGEST, TURNING / swinging.max() if swinging.size else np.inf)
        growing = np.maximum(values.real.max(axis=1), 0.0)
        rule = integrator.paired(speed_pairs(self.plant.layout)).exponential

        def failing(step: float) -> float | None:
            """1/|λ| of a mode that this step does not hold; None where it holds all of them."""
            for slope, rate, grows in zip(slopes, fast, growing, strict=True):
                split = Split.of(partial(_linear, slope, rate[:, None]), self.plant.stiff)
                factors, modes = np.linalg.eig(rule(split, np.eye(len(slope)), command, step))
                worst = int(np.abs(factors).argmax())
                if np.abs(factors[worst]) > np.exp(grows * step) + SLACK:
                    return 1.0 / abs(_nearest_rate(slope, modes[:, worst]))
            return None

        constant = failing(high)
        if constant is None:
            return high, 1.0 / float(swinging.max()) if swinging.size else LONGEST
        explicit = 1.0 / float(np.abs(self.rates(command)).max())  # of the rest, whose errors may make slow modes grow
        low = 1e-6 * high
        while high > FINE * low:
            middle = float(np.sqrt(low * high))
            fails = failing(middle)
            low, high, constant = (middle, high, constant) if fails is None else (low, middle, fails)
        return low, min(constant, explicit)

    def check_step(self, name: str, integrator: Integrator, step: float, commands: np.ndarray, where: str = "") -> None:
        """Refuses a step that is too large for the arm's fastest time constant.

        Args:
            name, integrator: the rule.   step: [s].   commands: (k, n) whose load is checked too, where losses grow with it.
            where: which of several arms it is, for the error.
        Raises:
            ScenarioError: names the time constant and the step that would do.
        """
        loaded = [np.zeros(self.model.n)]
        if self.model.supply is not None or any(loses_power(body) for body in self.model.coordinates):
            most = np.abs(commands).max(
                axis=0
            )  # slopes grow with torques through gears, and with currents from the bus
            loaded += [most, -most]
        largest, constant = min(self.limit(integrator, u) for u in loaded)
        if step <= largest:
            return
        included = "motors and friction slope included"
        if self.plant.stiff:
            included = "beside what is integrated exactly of currents, bristles and bus"
        raise ScenarioError(
            f"too large for the fastest time constant of {self.model.name}, {constant:.3g} s, {included}{where}: "
            f"{name} would blow up or lose track",
            place="step",
            value=step,
            expected=f"{round_down(0.8 * largest):g} s or less",
        )


@dataclass(frozen=True, eq=False)
class VariedStepLimit:
    """The lanes of a varied arm, each an arm of its own with time constants of its own.

    Attributes:
        varied: the arm with its parameters left open.   values: (lanes or 1, k) of them.   laned: whether lanes have numbers.
    """

    varied: Varied
    values: np.ndarray
    laned: bool

    def check_step(self, name: str, integrator: Integrator, step: float, commands: np.ndarray) -> None:
        """Refuses a step that is too large for one of the lanes; of many lanes, those with the fastest modes are tried.

        Args:
            name, integrator: the rule.   step: [s].   commands: (k, n) whose load is checked too.
        Raises:
            ScenarioError: names the lane, its time constant and the step that would do.
        """
        slopes = linearised(self.varied.arm, self.varied)
        for lane in self._fastest(slopes):
            values = ", ".join(f"{p} = {v:g}" for p, v in zip(self.varied.names, self.values[lane], strict=True))
            where = f" (in lane {lane}, with {values})" if self.laned else f" (with {values})"
            limit = StepLimit(self.varied.model(self.values[lane]), slopes, self.values[lane])
            limit.check_step(name, integrator, step, commands, where)

    def _fastest(self, slopes: Program) -> list[int]:
        """Numbers of the lanes whose modes are the fastest, of those that swing or grow as of those that die away."""
        count = len(self.values)
        ends = [*np.argmin(self.values, axis=0), *np.argmax(self.values, axis=0)]
        lanes = np.unique([*ends, *np.linspace(0, count - 1, min(count, LOOKED_AT)).astype(int)])
        _, first = np.unique(self.values[lanes], axis=0, return_index=True)
        lanes = lanes[np.sort(first)]
        if len(lanes) > 2 * FULLY:
            eigenvalues = self._modes(slopes, lanes)
            swings = -np.real(eigenvalues) <= np.abs(np.imag(eigenvalues))
            speeds = [np.where(kind, np.abs(eigenvalues), 0.0).max(axis=1) for kind in (swings, ~swings)]
            lanes = lanes[np.unique([np.argsort(-speed, kind="stable")[:FULLY] for speed in speeds])]
        return [int(lane) for lane in lanes]

    def _modes(self, slopes: Program, lanes: np.ndarray) -> np.ndarray:
        """Eigenvalues (lanes, k) [1/s] of the linearised plants in a few states, what is integrated exactly left out."""
        nominal = StepLimit(self.varied.arm)
        plant, states = nominal.plant, nominal.states[:: max(1, len(nominal.states) // STATES)]
        brakes = [np.ones(len(plant.braked))] if plant.brakes else []
        command, values = np.zeros(self.varied.arm.n), self.values[lanes][:, None, :]
        result = interpret(slopes, states, command, *brakes, values)
        slope = result[0] if isinstance(result, tuple) else result
        kept = np.setdiff1d(np.arange(plant.size), plant.stiff)
        slope = slope[..., kept[:, None], kept]
        slope = np.where(np.isfinite(slope).all(axis=(2, 3), keepdims=True), slope, 0.0)
        return np.linalg.eigvals(slope).reshape(len(lanes), -1)


def linearised(model: Model, varied: Varied | None = None) -> Program:
    """∂(dx/dt)/∂x and λ of what is integrated exactly, from the plant's own graph: (x, u, brake?, p?) → slope, fast?."""
    bare = Plant.of(model, brakes=True)
    size, count = bare.size, len(bare.stiff)
    names = {"x": (size,), "u": (model.n,)} | ({"brake": (len(bare.braked),)} if bare.brakes else {})
    names |= {} if varied is None else {"p": (len(varied.names),)}

    def plant(x: Array, u: Array, *rest: Array) -> tuple[np.ndarray, np.ndarray]:
        arguments = dict(zip(list(names)[2:], rest, strict=True))
        built = bare if varied is None else Plant.of(varied.model(arguments["p"]), brakes=True)
        return built.split(x, PlantInputs.named(u, arguments))

    split = trace("plant", plant, names, ("xd", "fast"))
    symbols = [casadi.SX.sym(name, shape[0]) for name, shape in names.items()]  # type: ignore[arg-type]
    xd, fast = split.graph(*symbols)
    slope = casadi.densify(casadi.jacobian(xd, symbols[0]))
    outputs = [slope.T.reshape((size * size, 1)), *([casadi.densify(fast)] if count else [])]
    graph = casadi.Function("plant_slope", symbols, outputs)
    ports = (Port("slope", (size, size)), *([Port("fast", (count,))] if count else []))
    return Program("plant_slope", split.inputs, ports, graph)


def _linear(slope: np.ndarray, rate: np.ndarray, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A linear plant, columns of x side by side."""
    return slope @ x, rate


def _nearest_rate(slope: np.ndarray, moved: np.ndarray) -> complex:
    """Eigenvalue [1/s] of a linearised plant whose mode takes the largest part in another vector (size,)."""
    rates, modes = np.linalg.eig(slope)
    parts = np.linalg.lstsq(modes, moved, rcond=None)[0]
    return rates[int(np.abs(np.where(rates == 0.0, 0.0, parts)).argmax())]


def _with_stops(model: Model, poses: np.ndarray) -> list[np.ndarray]:
    """The poses, and where joints have stops one in each end of them all."""
    stopped = np.array([body.stops is not None for body in model.coordinates])
    if not stopped.any():
        return list(poses)
    ends = np.array([body.limits.position for body in model.coordinates]).T
    return [*poses, *(np.where(stopped, end + sign * DEEP, poses[0]) for end, sign in zip(ends, (-1, 1), strict=True))]


def _steepest_position(spring: TableSpring) -> float:
    """Middle [rad | m] of the piece of a table where it is steepest, which no drawn pose may meet."""
    at, torques = np.array(spring.positions, dtype=float), np.array(spring.torques, dtype=float)
    steepest = int(np.abs(np.diff(torques) / np.diff(at)).argmax())
    return float(0.5 * (at[steepest] + at[steepest + 1]))


def _steep_speeds(body: Body) -> list[float]:
    """Speeds [rad/s | m/s] at which a joint's friction and gear loss are steepest, always as many."""
    smoothing = [
        part.smoothing for part in (body.friction, body.drive) if part is not None and part.smoothing is not None
    ]
    s = float(min(smoothing)) if smoothing else 1e-3
    middle, width = (0.0, 1.0) if body.friction is None else LAWS[body.friction.law].steep(body.friction)
    about_rest = [sign * share * s for share in (STILL, 0.5, 2.0) for sign in (1.0, -1.0)]
    return [0.0, *about_rest, middle, middle + width, middle - width]


def round_down(value: float) -> float:
    """One significant digit: a step that people would choose."""
    digit = 10.0 ** floor(log10(value))
    return floor(value / digit) * digit


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
