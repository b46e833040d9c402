"""Which step is too large for an arm: found from the linearised arm with its motors before a simulation runs."""

from __future__ import annotations

from functools import cached_property
from math import floor, log10

import casadi
import numpy as np

from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.program import Program, interpret, trace
from armwright.simulation.integrators import Integrator
from armwright.simulation.plant import plant_derivative

POSES = 32  # drawn over the joints' ranges, always the same ones
SPEEDS = (0.0, 0.5, -0.5, 2.0, -2.0)  # in units of each joint's smoothing speed: friction is steepest near standstill
FAST = 1e-3  # of the fastest rate: slower modes, and those that grow by nature, put no bound on the step
REACH = 4.0  # no explicit rule of order 3 or 4 is stable beyond |h λ| = 4
RAYS = np.linspace(0.0, 1.0, 2049)[1:]


class Stability:
    """Linearised plants of an arm at states that matter, and the step that an integrator may take with them."""

    def __init__(self, model: Model):
        self.model = model
        self._largest: dict[Integrator, float] = {}

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
        """(m, 2n) states to linearise at: poses over the joints' ranges, at rest and just moving."""
        n = self.model.n
        low = np.array([max(body.limits.position[0], -np.pi) for body in self.model.bodies])
        high = np.array([min(body.limits.position[1], np.pi) for body in self.model.bodies])
        poses = low + (high - low) * np.random.default_rng(0).uniform(size=(POSES, n))
        poses[0] = np.clip(0.0, low, high)
        scale = np.array([_smoothing(body) for body in self.model.bodies])
        return np.concatenate([np.hstack([poses, np.broadcast_to(speed * scale, poses.shape)]) for speed in SPEEDS])

    @cached_property
    def rates(self) -> np.ndarray:
        """Eigenvalues [1/s] of the linearised plant at all those states: its time constants are 1/|Re λ|."""
        slopes = interpret(self._jacobian, self.states, np.zeros(self.model.n))
        return np.asarray(np.linalg.eigvals(slopes[np.isfinite(slopes).all(axis=(1, 2))])).ravel()

    def largest_step(self, integrator: Integrator) -> float:
        """The step [s] up to which every mode that dies away in the arm dies away in the simulation."""
        if integrator not in self._largest:
            self._largest[integrator] = self._search(integrator)
        return self._largest[integrator]

    def _search(self, integrator: Integrator) -> float:
        if self.rates.size == 0:
            return np.inf
        rates: np.ndarray = self.rates
        size = np.abs(rates).max()
        dying = rates[(np.real(rates) < -FAST * size) & (np.abs(rates) > FAST * size)]
        if dying.size == 0:
            return np.inf
        z = np.outer(dying / np.abs(dying), REACH * RAYS)
        stable = np.where(integrator.growth(z) > 1.0, REACH * RAYS, np.inf).min(axis=1)
        return float(np.min(stable / np.abs(dying)))

    def check_step(self, name: str, integrator: Integrator, step: float) -> None:
        """Refuses a step that is too large for the arm's fastest time constant.

        Raises:
            ScenarioError: names the time constant and the step that would do.
        """
        largest = self.largest_step(integrator)
        if step <= largest:
            return
        constant = 1.0 / np.abs(np.real(self.rates)).max()
        raise ScenarioError(
            f"{self.model.name}: step = {step:g} s is too large for the arm's fastest time constant of {constant:.3g} s "
            f"(motors and friction slope included): {name} would blow up; a step of {_round_down(0.8 * largest):g} s would do"
        )


def _smoothing(body) -> float:
    smoothing = body.friction.smoothing if body.friction is not None else None
    return float(smoothing) if smoothing is not None else 1e-3


def _round_down(value: float) -> float:
    """One significant digit: a step that people would choose."""
    digit = 10.0 ** floor(log10(value))
    return floor(value / digit) * digit
