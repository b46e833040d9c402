"""A controller's programs in native code, as in the simulation, called once a tick with the values from the bus."""

from __future__ import annotations

import numpy as np

from armwright.kernels.batch import Kernel
from armwright.kernels.stages import NEXT
from armwright.kernels.target import select_target
from armwright.twin.rehearsal import SimulatedRun


class Law:
    """A controller's programs in native code, called once a tick: `command(tick, r, q, applied)`."""

    def __init__(self, rehearsal: SimulatedRun):
        stages = self._stages = rehearsal.stages
        target = select_target(rehearsal.scenario.solver.target)
        self._begin, self._law, self._shape = (
            Kernel(each, target) for each in (stages.begin, stages.law, stages.shape)
        )
        self._c = np.asarray(stages.gains.values[0], dtype=float)
        self._outputs = [port.name for port in stages.shape.outputs]
        self._y = np.zeros(stages.measured.size + stages.applied.size)
        self._last = np.asarray(stages.initial_command, dtype=float)
        self._s = np.zeros(0)

    def begin(self, q: np.ndarray, applied: np.ndarray) -> None:
        """The state before the first tick, from the arm's measured position."""
        self._s = np.asarray(self._begin(self._measured(q, applied), self._c))

    def _measured(self, q: np.ndarray, applied: np.ndarray) -> np.ndarray:
        n = len(q)
        self._y[:n], self._y[-n:] = q, applied
        return self._y

    def command(self, tick: int, r: np.ndarray, q: np.ndarray, applied: np.ndarray) -> np.ndarray:
        """The command (n,) of a tick."""
        y = self._measured(q, applied)
        values = {"tick": np.array([float(tick)]), "r": r, "y": y, "s": self._s, "c": self._c}
        asked, following = self._law(*[values[port.name] for port in self._stages.law.inputs])
        self._s = np.array(following)
        shaped = self._shape(np.asarray(asked), self._last)
        outputs = dict(zip(self._outputs, shaped if isinstance(shaped, tuple) else (shaped,), strict=True))
        issued = np.array(outputs[f"u_issued{NEXT}"])
        self._last = np.array(outputs.get(f"u_kept{NEXT}", issued))
        return issued
