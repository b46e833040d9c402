"""Initial values of a loop: state of the plant, command in force, measurement, memories. Design section 4."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armwright import scalar
from armwright.actuators import holding_command
from armwright.dynamics import gravity_torques
from armwright.errors import HiddenStateError
from armwright.kernels.batch import Kernel
from armwright.kernels.loop import Lanes
from armwright.kernels.stages import NEVER
from armwright.kernels.target import select_target
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.sampling.law import Law, hidden_state, measurement_of
from armwright.simulation.sampling.protocols import UNTRACEABLE, why
from armwright.simulation.sampling.tick_parts import Parts, Sampling
from armwright.simulation.scenario import Scenario

OF_PLANT, OF_LOOP = ("x_0",), ("u_0", "y_0", "m_0", "s_0")


class Beginning:
    """Initial values of a loop, one row per lane.

    They are computed by one compiled program however many lanes there are, so that a lane's bits do not depend on their number.

    Attributes:
        program: (start, c, p, payload, u?) → initial state of the plant and, of a controlled arm, the command in force, the
            measurement, what sensors remember and the controller's state. None where the state is the start itself.
        untraced: why the controller's own beginning is not traced; None where it is.
    """

    def __init__(self, scenario: Scenario, parts: Parts, law: Law | None, continued: np.ndarray | None):
        """Of a scenario; continued: (lanes or 1, size) states of the plant to begin in, None: at rest as `Plant.initial` says."""
        self.scenario, self.parts, self.law = scenario, parts, law
        self.untraced: str | None = None
        self._start = scenario.initial_state if continued is None else continued
        self._whole = continued is not None or len(parts.bare.parts) == 2
        self._values = np.zeros((1, 0)) if law is None else law.values
        self._given = None if law is None else scenario.first_command
        self.program = None if law is None and self._whole else self._program()
        self._kernel = None if self.program is None else Kernel(self.program, select_target(scenario.target))

    @property
    def states(self) -> int:
        """Entries of the controller's state."""
        return 0 if self.program is None else self.program.outputs[-1].size

    def _program(self) -> Program:
        scenario, parts, n, law = self.scenario, self.parts, self.parts.arm.n, self.law
        sensors, period = scenario.sensors, scenario.tick
        exact = replace(sensors, position_noise=0.0, velocity_noise=0.0, current_noise=0.0)
        shapes = {"start": self._start.shape[1:], "c": self._values.shape[1:], "p": scenario.parameters.shape[1:]}
        shapes["payload"] = (10 * len(parts.hands),)
        if self._given is not None:
            shapes["u"] = (n,)

        def begin(
            law: Law | None, start: Array, c: Array, p: Array, payload: Array, *given: Array
        ) -> tuple[Array, ...]:
            plant = parts.plant({"p": p, "payload": payload})
            arm, x = plant.model, start if self._whole else plant.initial(start[:n], start[n:])
            if law is None:
                return (scalar.array(x),)
            u = given[0] if given else holding_command(arm, gravity_torques(arm, plant.part(x, "q")))
            seen, speed, current = plant.measured(x, u, sensors.side)
            memory = exact.memory(arm, seen, speed)
            seen, speed, current, _ = exact.measure(arm, period, seen, speed, current, memory, np.zeros(0))
            seen, speed = plant.of_joints(seen, speed, sensors.side)
            y = scalar.array(np.concatenate([seen, speed, current, plant.applied(x, u)]))
            return scalar.array(x), scalar.array(u), y, scalar.array(memory), law.initial(arm, measurement_of(y, n), c)

        if law is None:
            return trace("begin", lambda *given: begin(None, *given), shapes, OF_PLANT)

        def alone() -> Program:
            """Without the controller: where its `init` is not traced, it has a state of its own kind, which Python keeps."""
            nothing = Law(None, (), (), self._values)
            return trace("begin", lambda *given: begin(nothing, *given), shapes, OF_PLANT + OF_LOOP)

        if law.vectorised:
            self.untraced = "it asks for all lanes at once"
            return alone()
        try:
            return trace("begin", lambda *given: begin(law, *given), shapes, OF_PLANT + OF_LOOP)
        except HiddenStateError:
            raise hidden_state(law.name) from None
        except UNTRACEABLE as error:
            self.untraced = why(error)
            return alone()

    def blocks(self, lanes: Lanes, payload: np.ndarray, sampling: Sampling | None) -> dict[str, np.ndarray]:
        """Initial values of blocks for a group of lanes, (count, …) each, or (1, …) where they are the same for all.

        Args:
            lanes: the group.   payload: (count or 1, 10 hands) then carried.   sampling: of the loop, where it is sampled.
        """
        c, p = lanes.own(self._values), lanes.own(self.scenario.parameters)
        rows = [lanes.own(self._start), c, p, payload, *([] if self._given is None else [lanes.own(self._given)])]
        if self._kernel is None:
            return {"x": rows[0]}
        given = [np.ascontiguousarray(np.broadcast_to(row, (lanes.count, row.shape[1]))) for row in rows]
        found = self._kernel(*given)
        if sampling is None:
            return {"x": np.asarray(found)}
        x, u, y, memory, s = (np.asarray(each) for each in found)
        n, d = self.parts.arm.n, sampling.delays
        numbers = [lanes.own(each) for each in (d.later, d.jitter, d.drift, d.command_loss, d.measurement_loss)]
        return {
            "x": x,
            "x_seen": x,
            "see_at": (sampling.period * (1.0 - lanes.own(d.earlier)))[:, None],
            "m_sensors": memory,
            "y": y,
            "y_kept": y[:, : 3 * n],
            "d_measured": lanes.own(d.measured)[:, None],
            "s": s,
            "u": u,
            "u_issued": u,
            "u_kept": u,
            "u_base": u,
            "arrivals": np.full((lanes.count, 1), NEVER),
            "d_commanded": lanes.own(d.commanded)[:, None],
            "d": np.stack(np.broadcast_arrays(*numbers), axis=1),
            "c": c,
        }
