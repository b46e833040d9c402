"""Which step is too large for an arm: found from the linearised arm with its motors before a simulation runs."""

from __future__ import annotations

from functools import cached_property
from math import floor, log10

import casadi
import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Body, Model
from armwright.program import Program, interpret, trace
from armwright.simulation.integrators import Integrator
from armwright.simulation.plant import plant_derivative

POSES = 16  # drawn over the joints' ranges, always the same ones
REACH = 4.0  # no explicit rule of order 3 or 4 is stable beyond |h λ| = 4
RAYS = np.linspace(0.0, 1.0, 2049)[1:]
TURNING = 0.5  # h |λ| of a mode that swings or grows: a dozen steps a period, or the rule follows it nowhere
STILL = 1e-3  # of a smoothing speed: just beside standstill, where friction may have another slope on either side


class Stability:
    """Linearised plants of an arm at states that matter, and the step that an integrator may take with them."""

    def __init__(self, model: Model):
        self.model = model
        self._largest: dict[tuple[Integrator, bytes], float] = {}
        self._rates: dict[bytes, np.ndarray] = {}

    @cached_property
    def _jacobian(self) -> Program:
        """∂(dx/dt)/∂x, from the plant's own graph."""
        n = self.model.n
        plant = trace("plant", lambda x, u: plant_derivative(self.model, x, u), {"x": (2 * n,), "u": (n,)}, ("xd",))
        x, u = casadi.SX.sym("x", 2 * n), casadi.SX.sym("u", n)  # type: ignore[arg-type]
        slope = casadi.densify(casadi.jacobian(plant.graph(x, u), x))
        graph = casadi.Function("plant_slope", [x, u], [slope.T.reshape((4 * n * n, 1))])
        return Program("plant_slope", plant.inputs, (plant.outputs[0].__class__("slope", (2 * n, 2 * n)),), graph)

    @cached_property
    def states(self) -> np.ndarray:
        """(m, 2n) states to linearise at: poses over the joints' ranges, at speeds where friction is steep."""
        n = self.model.n
        low = np.array([max(body.limits.position[0], -np.pi) for body in self.model.bodies])
        high = np.array([min(body.limits.position[1], np.pi) for body in self.model.bodies])
        poses = low + (high - low) * np.random.default_rng(0).uniform(size=(POSES, n))
        poses[0] = np.clip(0.0, low, high)
        speeds = np.array([_steep_speeds(body) for body in self.model.bodies]).T
        return np.concatenate([np.hstack([poses, np.broadcast_to(speed, poses.shape)]) for speed in speeds])

    def rates(self, command: np.ndarray) -> np.ndarray:
        """Eigenvalues [1/s] of the linearised plant at all those states: its time constants are 1/|Re λ|."""
        key = command.tobytes()
        if key not in self._rates:
            slopes = interpret(self._jacobian, self.states, command)
            self._rates[key] = np.ravel(np.linalg.eigvals(slopes[np.isfinite(slopes).all(axis=(1, 2))]))
        return self._rates[key]

    def largest_step(self, integrator: Integrator, command: np.ndarray) -> float:
        """The step [s] up to which modes that die away do so in the simulation, and the others are followed."""
        key = (integrator, command.tobytes())
        if key not in self._largest:
            rates = self.rates(command)
            rates = rates[np.abs(rates) > 0.0]
            dying = rates[-np.real(rates) > np.abs(np.imag(rates))]
            others = rates[-np.real(rates) <= np.abs(np.imag(rates))]
            stable = np.inf
            if dying.size:
                z = np.outer(dying / np.abs(dying), REACH * RAYS)
                reach = np.where(integrator.growth(z) > 1.0, REACH * RAYS, np.inf).min(axis=1)
                stable = float(np.min(reach / np.abs(dying)))
            followed = TURNING / float(np.abs(others).max()) if others.size else np.inf
            self._largest[key] = min(stable, followed)
        return self._largest[key]

    def check_step(self, name: str, integrator: Integrator, step: float, commands: np.ndarray) -> None:
        """Refuses a step that is too large for the arm's fastest time constant.

        Args:
            name, integrator: the rule.   step: [s].   commands: (k, n) whose load is checked too, where gears have a loss.
        Raises:
            ScenarioError: names the time constant and the step that would do.
        """
        loaded = [np.zeros(self.model.n)]
        if any(body.drive.efficiency is not None for body in self.model.bodies):
            most = np.abs(commands).max(axis=0)  # a gear's loss has a slope that grows with the torque through it
            loaded += [most, -most]
        largest, command = min(((self.largest_step(integrator, u), k) for k, u in enumerate(loaded)))
        if step <= largest:
            return
        constant = 1.0 / np.abs(self.rates(loaded[command])).max()
        raise ScenarioError(
            f"{self.model.name}: step = {step:g} s is too large for the arm's fastest time constant of {constant:.3g} s "
            f"(motors and friction slope included): {name} would blow up or lose track; "
            f"a step of {_round_down(0.8 * largest):g} s would do"
        )


def _steep_speeds(body: Body) -> list[float]:
    """Speeds [rad/s | m/s] at which a joint's friction and gear loss are steepest, always as many."""
    smoothing = [
        part.smoothing for part in (body.friction, body.drive) if part is not None and part.smoothing is not None
    ]
    s = float(min(smoothing)) if smoothing else 1e-3
    _, slope, shift = (
        (0.0, 1.0, 0.0) if body.friction is None or body.friction.sigmoid is None else body.friction.sigmoid
    )
    middle = -float(shift)
    return [
        0.0,
        STILL * s,
        -STILL * s,
        0.5 * s,
        -0.5 * s,
        2.0 * s,
        -2.0 * s,
        middle,
        middle + 1 / slope,
        middle - 1 / slope,
    ]


def _round_down(value: float) -> float:
    """One significant digit: a step that people would choose."""
    digit = 10.0 ** floor(log10(value))
    return floor(value / digit) * digit
