"""A sampled loop about poses at rest as one linear map from tick to tick, with stability and margins.

Between ticks the plant goes on exactly (`hold`), with all delays of the loop as one delay of the commands: measuring d earlier
is the same as moving d later, for a plant that does not depend on time. A loop of several rates repeats itself after a *cycle*
of ticks; the product of its maps over one cycle says whether it is stable: all its eigenvalues lie within the unit circle.

Margins are those of a factor κ in a joint's command, with the other loops closed as they are: how much larger or smaller than 1
it may be, and which angle it may have as e^{-jφ}, before an eigenvalue meets the unit circle. For a single rate and a single
joint these are the classical gain and phase margins; for several rates they are those of the lifted system.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.control.analysis.hold import Held, split_delay, zero_order_hold
from armwright.control.analysis.small_signal import SUPPORT, LoopSlopes, SmallPlant, SmallSignal
from armwright.control.analysis.workspace import checked_poses
from armwright.entry import as_scenario
from armwright.errors import ScenarioError
from armwright.parameters import batches, has_draws
from armwright.simulation.checks import check_time, is_whole
from armwright.simulation.loop.timing import Delays
from armwright.simulation.scenario import Scenario

GAINS = np.geomspace(1.0, 1e6, 61)  # factors among which the first unstable one is looked for
ANGLES = np.linspace(0.0, np.pi, 31)
PARTS = 6  # of these ranges, looked at in turn
HALVINGS = 24  # of the interval where a margin ends


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of each joint's loop at poses (…), the other loops closed; NaN for an unstable loop.

    Attributes:
        gain_up, gain_down: (…, n) factors of the command, above and below 1, at which stability ends; inf and 0 if never.
        phase: (…, n) [rad] lag of the command at which it ends; π if never.
        radius: (…,) largest magnitude of an eigenvalue over a cycle, as one for each tick; below 1 the loop is stable.
    """

    gain_up: np.ndarray
    gain_down: np.ndarray
    phase: np.ndarray
    radius: np.ndarray


class LinearLoop:
    """The loop of a scenario about poses at rest.

    Attributes:
        names: of the joints.   period: [s].   delay: [s] of measurements and commands together.
        cycle: ticks after which the loop repeats itself.
    Example:
        >>> scenario = aw.read_scenario("examples/bus-4ms.scenario.toml")
        >>> loop = aw.loops.LinearLoop(scenario)
        >>> bool(loop.radius(np.zeros(6)) < 1.0)  # the loop is stable
        True
    """

    def __init__(self, scenario: Scenario, period: float | None = None, plant: SmallPlant | None = None):
        """The loop of a scenario.

        Args:
            scenario: with a controller in its loop.   period: [s] in place of the loop's own; gains and delays in seconds stay.
            plant: of the same arm, where there is one already.
        Raises:
            ScenarioError: a scenario without a controller, or one that cannot be traced.
        """
        scenario = as_scenario(scenario)
        if period is not None:
            check_time("period", period)
        loop = scenario.loop
        if loop is None or loop.controller is None:
            raise ScenarioError("has no controller", place="loop", expected="a scenario with a loop and its controller")
        for part in ("timing", "sensors"):
            for place, batch in batches(getattr(loop, part), f"loop.{part}"):
                if len(batch) > 1:
                    raise ScenarioError(
                        "differs by lane", place=place, value=batch, expected="one value: one loop is analysed"
                    )
        if has_draws(loop):
            raise ScenarioError("has random draws", place="loop", expected="numbers: one loop is analysed")
        SUPPORT.refuse(scenario.arm, "servo")
        self.scenario = scenario
        self.period = scenario.tick if period is None else float(period)
        self.plant = SmallPlant(scenario.arm) if plant is None else plant
        self._small = SmallSignal(self.plant, loop.controller, loop.sensor_list, self.period)
        timing = Delays.of(loop.timing, self.period)
        parts = (timing.measured, timing.earlier, timing.commanded, timing.later)
        self._periods = float(sum(part[0] for part in parts))
        self.delay = self._periods * self.period
        self.names, self.cycle = scenario.arm.names, self._small.cycle

    def __repr__(self) -> str:
        return f"LinearLoop({self.scenario.arm.name!r}, {self.period:g} s, delay {1e3 * self.delay:.4g} ms)"

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about effects of the arm and the scenario that small motions about rest do not have."""
        return SUPPORT.notes(self.scenario.arm, self.scenario)

    def with_delay(self, delay: float) -> LinearLoop:
        """The loop with another delay [s] of measurements and commands together."""
        loop = copy.copy(self)
        loop._periods, loop.delay = delay / self.period, delay
        return loop

    @property
    def gains(self) -> np.ndarray:
        """(lanes, k) values of the controller's batches, side by side."""
        return self._small.gains

    def slopes(self, q: Any, gains: Any = None, joint: int | None = None, free: bool = False) -> LoopSlopes:
        """Matrices of plant, sensors and controller at poses q (…, n) [rad | m], without states that do not matter.

        Args:
            q: poses.   gains: in place of the controller's batches.   joint: its loop alone, the others held still, or
            free: without torque.
        Raises:
            ScenarioError: poses that are none of this arm.
        """
        q = checked_poses(q, len(self.names))
        if joint is not None and not (is_whole(joint, 0) and joint < len(self.names)):
            expected = f"the number of a joint, 0 to {len(self.names) - 1}"
            raise ScenarioError(place="joint", value=joint, expected=expected)
        count = self.gains.shape[-1]
        if gains is not None and np.shape(gains)[-1:] != (count,):
            expected = f"(…, {count}), the controller's batches side by side"
            raise ScenarioError(f"shape {np.shape(gains)}", place="gains", expected=expected)
        slopes = self._small.slopes(q, gains)
        return self._moving(slopes if joint is None else slopes.alone(joint, self.states_of(joint), free))

    def _moving(self, slopes: LoopSlopes) -> LoopSlopes:
        """Slopes without memories that decide nothing."""
        size, n = slopes.b.shape[-2:]
        ones = np.ones(slopes.b.shape)  # of a plant in which everything moves everything
        maps = self.maps(slopes, Held(np.ones(slopes.a.shape), ones, ones, split_delay(self._periods)[0]))
        memory = slopes.ticks[0].shape[-2] - n
        moving = moving_states(maps, size)
        kept = moving[(moving >= size) & (moving < size + memory)] - size
        rows, columns = np.r_[0:n, n + kept], np.r_[0:size, size + kept, size + memory : size + memory + n]
        return LoopSlopes(
            slopes.e, slopes.a, slopes.b, tuple(tick[..., rows[:, None], columns] for tick in slopes.ticks)
        )

    @property
    def elastic_motors(self) -> list[tuple[int, int, float]]:
        """Joint, place of the position [rad] in the plant's state, and gear ratio of each motor behind an elastic gear."""
        bodies = enumerate(self.scenario.arm.coordinates)
        elastic = [(j, float(body.drive.gear_ratio)) for j, body in bodies if body.elasticity is not None]
        return [(j, int(self.plant.states_of(j, ["motor_q"])[0]), ratio) for j, ratio in elastic]

    def encoders(self, joint: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Errors of the joints' encoders as changes of the plant's state that are measured likewise.

        Args:
            joint: its encoder alone, the other joints held; None: those of all k joints.
        Returns:
            errors: (k, N) change that is measured as an error of 1 rad or m, referred to the encoder's joint.
            parts: (k, N, N) change by state that is measured as an error as large as the encoder's own reading.
        """
        size, place = self.plant.plant.size, self.plant.plant.layout.place("q")
        assert self.scenario.loop is not None
        n = len(self.names)
        of_motors = self.scenario.loop.joint_sensors.side == "motor" and joint is None
        # encoders of coupled motors see several joints
        shares = motor_shares(self.scenario.arm) if of_motors else np.eye(n)
        errors, readings = np.zeros((n, size)), np.zeros((n, size))
        errors[:, place], readings[:, place] = np.linalg.inv(shares).T, shares
        parts = errors[:, :, None] * readings[:, None, :]
        for j, motor, ratio in self.elastic_motors:
            errors[j, motor], parts[j, motor, motor] = ratio, 1.0
        if joint is None:
            return errors, parts
        states = self.states_of(joint)
        return errors[[joint]][:, states], parts[[joint]][:, states[:, None], states]

    def states_of(self, joint: int) -> np.ndarray:
        """Indices of a joint's states in the plant's state."""
        return self.plant.states_of(joint)

    def held(self, slopes: LoopSlopes, extra: float = 0.0) -> Held:
        """The plant from tick to tick with all delays of the loop, and `extra` [s] on top."""
        ticks, part = split_delay(self._periods + extra / self.period)
        a, b = np.linalg.solve(slopes.e, slopes.a), np.linalg.solve(slopes.e, slopes.b)
        return zero_order_hold(a, b, self.period, (ticks + part) * self.period)

    def maps(self, slopes: LoopSlopes, held: Held, factors: np.ndarray | None = None) -> list[np.ndarray]:
        """Maps of one cycle's ticks, (…, Z, Z) each, for plant states, controller memory, and commands under way.

        Args:
            slopes, held: at poses (…).   factors: (…, commands) of the commands at the plant; None: 1.
        """
        size, n = slopes.b.shape[-2:]
        known = size + slopes.ticks[0].shape[-2] - n
        factor = np.ones(n) if factors is None else np.asarray(factors)
        new, old = held.new * factor[..., None, :], held.old * factor[..., None, :]
        total = known + n * (held.ticks + 1)
        looked_at = np.r_[0:known, total - n : total]  # the plant, the memories, and the command in force
        scale = np.concatenate([np.ones((*factor.shape[:-1], known)), factor], axis=-1)
        lead = np.broadcast_shapes(new.shape[:-2], factor.shape[:-1], slopes.ticks[0].shape[:-2])
        maps = []
        for tick in slopes.ticks:
            command, following = np.split(tick * scale[..., None, :], [n], axis=-2)
            whole = np.zeros((*lead, total, total), dtype=np.result_type(new, command))
            whole[..., :size, :size] = held.a
            whole[..., :size, total - n :] += old
            if held.ticks == 0:
                whole[..., :size, looked_at] += new @ command
            else:
                whole[..., :size, total - 2 * n : total - n] += new
            whole[..., size:known, looked_at] = following
            whole[..., known : known + n, looked_at] = command
            whole[..., known + n :, known : total - n] += np.eye(n * held.ticks)
            maps.append(whole)
        return maps

    def radius(self, q: Any, *, gains: Any = None, joint: int | None = None, free: bool = False) -> np.ndarray:
        """Spectral radius (…,) per tick at poses q (…, n): the loop is stable if below 1.

        Args:
            q: (…, n) [rad | m].   gains: in place of the controller's batches.   joint: alone, the others held, or
            free: without torque.
        """
        slopes = self.slopes(q, gains, joint, free)
        return self._radius(slopes, self.held(slopes))

    def _radius(self, slopes: LoopSlopes, held: Held, factors: np.ndarray | None = None) -> np.ndarray:
        maps = self.maps(slopes, held, factors)
        product = maps[0]
        for each in maps[1:]:
            product = each @ product
        return np.abs(np.linalg.eigvals(product)).max(axis=-1) ** (1.0 / self.cycle)

    def margins(self, q: Any, *, gains: Any = None, held: bool = False) -> Margins:
        """Margins of every joint's loop at poses q (…, n) [rad | m].

        Args:
            q: poses.   gains: in place of the controller's batches.
            held: with the other joints held still, as a servo drive tuned by itself would see it; else with their loops closed.
        """
        n, rows = len(self.names), []
        coupled = self.slopes(q, gains)
        radius = self._radius(coupled, self.held(coupled))
        whole = self._small.slopes(checked_poses(q, n), gains) if held else None
        for joint in range(n):
            slopes = coupled if whole is None else self._moving(whole.alone(joint, self.states_of(joint)))
            rows.append(self._margins(slopes, 0 if held else joint))
        up, down, phase = np.moveaxis(np.array(rows), 0, -1)
        return Margins(up, down, phase, radius)

    def keeps(self, slopes: LoopSlopes, gain: float, phase: float) -> np.ndarray:
        """(…,) True if the loop is stable, and remains so with a factor `gain`, 1/gain or e^{-j phase} in any one command."""
        return self.largest_radius(slopes, gain, phase) < 1.0

    def largest_radius(self, slopes: LoopSlopes, gain: float, phase: float) -> np.ndarray:
        """(…,) largest spectral radius per tick of the loop, with 1, `gain`, 1/gain or e^{-j phase} in any one command."""
        plant, n = self.held(slopes), slopes.b.shape[-1]
        largest = self._radius(slopes, plant)
        for factor in {complex(gain), complex(1.0 / gain), complex(np.exp(-1j * phase))} - {1.0 + 0.0j}:
            number = factor.real if factor.imag == 0.0 else factor
            for command in range(n):
                factors = np.where(np.arange(n) == command, number, 1.0)
                largest = np.maximum(largest, self._radius(slopes, plant, factors))
        return largest

    def _margins(self, slopes: LoopSlopes, command: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gain margins above and below, and the phase margin [rad], of one command; NaN where the loop is not stable."""
        plant, one = self.held(slopes), np.arange(slopes.b.shape[-1]) == command

        def unstable(factor: np.ndarray) -> np.ndarray:
            return self._radius(slopes, plant, np.where(one, factor[..., None], 1.0)) >= 1.0

        shape = plant.a.shape[:-2]
        stable = ~unstable(np.ones(shape))
        up = first_lost(unstable, GAINS, shape, np.inf)
        down = 1.0 / first_lost(lambda g: unstable(1.0 / g), GAINS, shape, np.inf)
        phase = first_lost(lambda p: unstable(np.exp(-1j * p)), ANGLES, shape, np.pi)
        up, down, phase = (np.where(stable, each, np.nan) for each in (up, down, phase))
        return up, down, phase

    def open_loop(self, q: Any, joint: int | None = None, *, gains: Any = None, held: bool = False) -> Any:
        """The loop at a pose, opened at its commands, as a `control.StateSpace` L(z) of python-control: 1 + L = 0 is unstable.

        Bode, Nyquist, root locus and margins follow from its functions; its characteristic loci are the eigenvalues of L.

        Args:
            q: (n,) one pose [rad | m].   joint: opened at its command alone; None: at all, a system of n inputs and outputs.
            gains: in place of the controller's batches.   held: with the other joints held still; else with their loops closed.
        Returns:
            system: of period `period`, from commands at the drives to those that the controller answers with, signs turned.
        Raises:
            ScenarioError: a loop of several rates, several poses, or no such joint.
        """
        import control

        self._check_one_rate()
        n = len(self.names)
        if checked_poses(q, n).ndim != 1:
            raise ScenarioError(f"shape {np.shape(q)}", place="q", expected=f"one pose ({n},)")
        _ = self.slopes(q, gains, joint)  # which checks the joint
        slopes = self.slopes(q, gains, joint if held else None)
        plant = self.held(slopes)
        size, count = slopes.b.shape
        known = size + slopes.ticks[0].shape[-2] - count
        closed = self.maps(slopes, plant)[0]
        opened = np.arange(count) if joint is None else np.array([0 if held else joint])
        entry = np.zeros((len(closed), len(opened)))  # of a command into its queue, or into the plant at once
        entry[known + opened, np.arange(len(opened))] = 1.0
        if plant.ticks == 0:
            entry[:size] = plant.new[:, opened]
        answer = closed[known + opened]
        return control.ss(
            closed - entry @ answer, entry, -answer, np.zeros((len(opened), len(opened))), self.period,
            inputs=[self.names[k] for k in ([joint] if joint is not None else range(n))],
        )  # fmt: skip

    def _check_one_rate(self) -> None:
        if self.cycle != 1:
            raise ScenarioError("has several rates", place="loop", expected="a loop of one rate, or its margins")

    def sensitivity(self, q: Any, *, gains: Any = None, points: int = 400) -> tuple[np.ndarray, np.ndarray]:
        """Largest magnitude of each joint's sensitivity at its command, the others closed; the modulus margin is its inverse.

        S(z) is how a disturbance added to a command comes back in that command. Only for a loop of one rate.

        Args:
            q: (…, n) poses [rad | m].   gains: in place of the controller's batches.   points: frequencies, evenly in log.
        Returns:
            peak: (…, n).   frequency: (…, n) [rad/s] where.
        Raises:
            ScenarioError: a loop of several rates.
        """
        self._check_one_rate()
        slopes = self.slopes(q, gains)
        n = len(self.names)
        held = self.held(slopes)
        base = self.maps(slopes, held)[0]
        w = np.geomspace(1e-4, 1.0, points) * np.pi / self.period
        z = np.exp(1j * w * self.period)
        peak = np.empty((*base.shape[:-2], n))
        where = np.empty_like(peak)
        for joint in range(n):
            opened = self.maps(slopes, held, factors=np.where(np.arange(n) == joint, 0.0, 1.0))[0]
            # S = 1 / (1 + L) = det(zI - opened) / det(zI - closed), as the factor is one of a single column
            far = [z - np.linalg.eigvals(each)[..., :, None] for each in (opened, base)]
            size = np.abs(np.prod(far[0] / far[1], axis=-2))
            best = size.argmax(axis=-1)
            peak[..., joint], where[..., joint] = size.max(axis=-1), w[best]
        return peak, where


def first_lost(
    unstable: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, shape: tuple[int, ...], never: float
) -> np.ndarray:
    """First value along a grid at which a loop becomes unstable, refined by halving; `never` if it stays stable."""
    lost = np.zeros((0, *shape), dtype=bool)
    for part in np.array_split(grid[1:], PARTS):  # most loops are lost early on the way
        more = unstable(np.broadcast_to(part.reshape(-1, *[1] * len(shape)), (len(part), *shape)))
        lost = np.concatenate([lost, more])
        if lost.any(axis=0).all():
            break
    first = lost.argmax(axis=0)
    low, high = grid[first], grid[first + 1]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        beyond = unstable(middle)
        high, low = np.where(beyond, middle, high), np.where(beyond, low, middle)
    return np.where(lost.any(axis=0), 0.5 * (low + high), never)


def moving_states(maps: list[np.ndarray], size: int) -> np.ndarray:
    """Indices of the states that the first `size`, the plant's, depend on and that depend on them; others have no effect."""
    links = np.zeros(maps[0].shape[-2:], dtype=bool)
    for each in maps:
        links |= (each != 0).reshape(-1, *links.shape).any(axis=0)

    def closed(links: np.ndarray) -> np.ndarray:
        """States that the plant's lead to."""
        reached = np.arange(len(links)) < size
        for _ in range(len(links)):
            reached = reached | links[:, reached].any(axis=1)
        return reached

    return np.flatnonzero(closed(links) & closed(links.T))
