"""Which step is too large for arms that are varied: looked for among the lanes that differ most from one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.errors import ScenarioError
from armwright.model.vary import Varied
from armwright.program import Program, interpret
from armwright.simulation.integrate.integrators import Integrator
from armwright.simulation.plant.step_limits import Stability, linearised

LOOKED_AT = 256  # lanes, beside those with the least and the most of every parameter
FULLY = 2  # lanes that are checked in every state, of each kind of mode
STATES = 10  # in which modes of lanes are compared


@dataclass(frozen=True, eq=False)
class VariedSteps:
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
            arm = Stability(self.varied.model(self.values[lane]), slopes, self.values[lane])
            try:
                arm.check_step(name, integrator, step, commands)
            except ScenarioError as error:
                told = ", ".join(f"{p} = {v:g}" for p, v in zip(self.varied.names, self.values[lane], strict=True))
                where = f"in lane {lane}, with {told}" if self.laned else f"with {told}"
                raise ScenarioError(f"{error} ({where})") from None

    def _fastest(self, slopes: Program) -> list[int]:
        """Numbers of the lanes whose modes are the fastest, of those that swing or grow as of those that die away."""
        count = len(self.values)
        ends = [*np.argmin(self.values, axis=0), *np.argmax(self.values, axis=0)]
        lanes = np.unique([*ends, *np.linspace(0, count - 1, min(count, LOOKED_AT)).astype(int)])
        _, first = np.unique(self.values[lanes], axis=0, return_index=True)
        lanes = lanes[np.sort(first)]
        if len(lanes) > 2 * FULLY:
            found = self._modes(slopes, lanes)
            swings = -np.real(found) <= np.abs(np.imag(found))
            speeds = [np.where(kind, np.abs(found), 0.0).max(axis=1) for kind in (swings, ~swings)]
            lanes = lanes[np.unique([np.argsort(-speed, kind="stable")[:FULLY] for speed in speeds])]
        return [int(lane) for lane in lanes]

    def _modes(self, slopes: Program, lanes: np.ndarray) -> np.ndarray:
        """Eigenvalues (lanes, k) [1/s] of the linearised plants in a few states, what is integrated exactly left out."""
        nominal = Stability(self.varied.arm)
        plant, states = nominal.plant, nominal.states[:: max(1, len(nominal.states) // STATES)]
        brakes = [np.ones(len(plant.braked))] if plant.brakes else []
        command, values = np.zeros(self.varied.arm.n), self.values[lanes][:, None, :]
        found = interpret(slopes, states, command, *brakes, values)
        slope = found[0] if isinstance(found, tuple) else found
        kept = np.setdiff1d(np.arange(plant.size), plant.stiff)
        slope = slope[..., kept[:, None], kept]
        slope = np.where(np.isfinite(slope).all(axis=(2, 3), keepdims=True), slope, 0.0)
        return np.linalg.eigvals(slope).reshape(len(lanes), -1)
