"""The largest step for a varied arm, each of whose lanes is an arm with time constants of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright.content import checksum
from armwright.model.vary import Varied
from armwright.program import Program, interpret, kept
from armwright.simulation.integrate.integrators import Integrator
from armwright.simulation.plant.linearised import linearised
from armwright.simulation.plant.step_limits import StepLimit, loads

LOOKED_AT = 256  # lanes, beside those with the least and the most of every parameter
UNLIKE = 20_000  # lanes of which those with equal values are found
FULLY = 2  # lanes that are checked in every state, of each kind of mode
STATES = 10  # in which modes of lanes are compared
FEW_STATES, ROUGHLY = 3, 12  # in which all lanes are compared at first, and lanes of each kind of mode that remain


@dataclass(frozen=True, eq=False)
class VariedStepLimit:
    """Step limits of a varied arm: one model, with its time constants, per lane.

    Attributes:
        varied: the arm with its parameters left open.   values: (lanes or 1, k) of them.   laned: whether lanes have numbers.
    """

    varied: Varied
    values: np.ndarray
    laned: bool

    def check_step(
        self,
        name: str,
        integrator: Integrator,
        step: float,
        commands: np.ndarray,
        substeps: int | None = None,
        *,
        whole: Sequence[float] = (),
    ) -> None:
        """Refuses a step that is too large for one of the lanes; of many lanes, those with the fastest modes are tried.

        Args:
            name, integrator: the rule.   step: [s].   commands: (k, n) whose load is checked too.   substeps: of a loop.
            whole: [s] times that must hold a whole number of steps.
        Raises:
            ScenarioError: names the lane, its time constant and the step that would do.
        """
        lanes = self._examined_lanes()
        asked = (name, step, checksum(commands), substeps, tuple(whole))

        def check() -> None:
            slopes = kept(("linearised", *self._key), lambda: linearised(self.varied.arm, self.varied))
            for lane in self._fastest(slopes, lanes, loads(self.varied.arm, commands)):
                values = ", ".join(f"{p} = {v:g}" for p, v in zip(self.varied.names, self.values[lane], strict=True))
                where = f" (in lane {lane}, with {values})" if self.laned else f" (with {values})"
                limit = StepLimit(self.varied.model(self.values[lane]), slopes, self.values[lane])
                limit.check_step(name, integrator, step, commands, substeps, where, whole)

        kept(("steps", *self._key, self.values[lanes].tobytes(), *asked), check)  # of what was refused nothing is kept

    @cached_property
    def _key(self) -> tuple[str, tuple[str, ...]]:
        """The arm by its content, and what varies."""
        return self.varied.arm.sha256, self.varied.names

    def _examined_lanes(self) -> np.ndarray:
        """Numbers of lanes with unlike values: those with the least and the most of each, and others evenly among all."""
        count = len(self.values)
        lanes = np.arange(count)
        if count <= UNLIKE:  # candidates of a tuning have the same arms
            lanes = np.sort(np.unique(self.values, axis=0, return_index=True)[1])
        rows = self.values[lanes]
        ends = [*np.argmin(rows, axis=0), *np.argmax(rows, axis=0)]
        chosen = np.unique([*ends, *np.linspace(0, len(lanes) - 1, min(len(lanes), LOOKED_AT)).astype(int)])
        _, first = np.unique(rows[chosen], axis=0, return_index=True)
        return lanes[chosen[np.sort(first)]]

    def _fastest(self, slopes: Program, lanes: np.ndarray, loaded: list[np.ndarray]) -> list[int]:
        """Numbers of the lanes whose modes are the fastest, of those that swing or grow as of those that die away."""
        # Eigenvalues take time: the slow are left out early.
        for states, count in ((FEW_STATES, ROUGHLY), (STATES, FULLY)):
            if len(lanes) > 2 * count:
                speeds = []
                for eigenvalues in (each for command in loaded for each in self._modes(slopes, lanes, command, states)):
                    swings = -np.real(eigenvalues) <= np.abs(np.imag(eigenvalues))
                    speeds += [np.where(kind, np.abs(eigenvalues), 0.0).max(axis=1) for kind in (swings, ~swings)]
                lanes = lanes[np.unique([np.argsort(-speed, kind="stable")[:count] for speed in speeds])]
        return [int(lane) for lane in lanes]

    def _modes(self, slopes: Program, lanes: np.ndarray, command: np.ndarray, count: int) -> list[np.ndarray]:
        """Eigenvalues (lanes, k) [1/s] of the linearised plants in some states, without what is integrated exactly.

        With a bus also those with its voltage, whose share by the motors' load is not integrated exactly.
        """
        nominal = StepLimit(self.varied.arm)
        plant, states = nominal.plant, nominal.states[:: max(1, len(nominal.states) // count)]
        brakes = [np.ones(len(plant.braked))] if plant.brakes else []
        result = interpret(slopes, states, command, *brakes, self.values[lanes][:, None, :])
        slope = result[0] if isinstance(result, tuple) else result
        slope = np.where(np.isfinite(slope).all(axis=(2, 3), keepdims=True), slope, 0.0)
        kept = [np.setdiff1d(np.arange(plant.size), plant.stiff)]
        if "bus_voltage" in plant.layout:
            kept.append(np.append(kept[0], plant.layout.place("bus_voltage").start))
        return [np.linalg.eigvals(slope[..., rows[:, None], rows]).reshape(len(lanes), -1) for rows in kept]
