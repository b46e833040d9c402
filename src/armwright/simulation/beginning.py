"""What is there before the first tick of a controlled arm: a command in force, measurements, memories. Design section 4."""

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
from armwright.program import Program, interpret, trace
from armwright.scalar import Array
from armwright.simulation.sampling.law import Law, hidden_state, measurement_of
from armwright.simulation.sampling.protocols import UNTRACEABLE, why
from armwright.simulation.sampling.tick_parts import Parts, Sampling
from armwright.simulation.scenario import Scenario

BEGUN = ("u_0", "y_0", "m_0", "s_0")
FEW = 64  # lanes whose beginnings are interpreted sooner than compiled


class Beginning:
    """How lanes of a controlled scenario begin.

    Attributes:
        program: (x, c, p, payload, u?) → the command in force, what is measured, what sensors remember, the controller's state.
        untraced: why the controller's own beginning is not traced; None where it is.
    """

    def __init__(self, scenario: Scenario, parts: Parts, law: Law):
        self.scenario, self.parts, self.law = scenario, parts, law
        self.count = scenario.lanes or 1
        self.untraced: str | None = None
        scenario.sensors.check(parts.arm)
        scenario.shaping.check(parts.arm)
        self.program = self._program()
        self._kernel = Kernel(self.program, select_target(scenario.target)) if self.count > FEW else None
        self._given = scenario.first_command

    @property
    def states(self) -> int:
        """Entries of the controller's state."""
        return self.program.outputs[-1].size

    def _program(self) -> Program:
        scenario, parts, n = self.scenario, self.parts, self.parts.arm.n
        sensors, period = scenario.sensors, scenario.tick
        exact = replace(sensors, position_noise=0.0, velocity_noise=0.0, current_noise=0.0)
        shapes = {"x": (parts.bare.size,), "c": self.law.values.shape[1:], "p": scenario.parameters.shape[1:]}
        shapes["payload"] = (10 * len(parts.hands),)
        if scenario.first_command is not None:
            shapes["u"] = (n,)

        def begin(law: Law, x: Array, c: Array, p: Array, payload: Array, *given: Array) -> tuple[Array, ...]:
            plant = parts.plant({"p": p, "payload": payload})
            arm = plant.model
            u = given[0] if given else holding_command(arm, gravity_torques(arm, plant.part(x, "q")))
            seen, speed, current = plant.measured(x, u, sensors.side)
            memory = exact.memory(arm, seen, speed)
            seen, speed, current, _ = exact.measure(arm, period, seen, speed, current, memory, np.zeros(0))
            seen, speed = plant.of_joints(seen, speed, sensors.side)
            y = scalar.array(np.concatenate([seen, speed, current, plant.applied(x, u)]))
            return scalar.array(u), y, scalar.array(memory), law.initial(arm, measurement_of(y, n), c)

        def alone() -> Program:
            """Without the controller: where its `init` is not traced, it has a state of its own kind, which Python keeps."""
            nothing = Law(None, (), (), self.law.values)
            return trace("begin", lambda *given: begin(nothing, *given), shapes, BEGUN)

        if self.law.vectorised:
            self.untraced = "it asks for all lanes at once"
            return alone()
        try:
            return trace("begin", lambda *given: begin(self.law, *given), shapes, BEGUN)
        except HiddenStateError:
            raise hidden_state(self.law.name) from None
        except UNTRACEABLE as error:
            self.untraced = why(error)
            return alone()

    def blocks(self, lanes: Lanes, x: np.ndarray, payload: np.ndarray, sampling: Sampling) -> dict[str, np.ndarray]:
        """Values of blocks for a group of lanes, (count, …) each, or (1, …) where they are the same for all.

        Args:
            lanes: the group.   x: (count or 1, size) where they begin.   payload: (count or 1, 10 hands) then carried.
            sampling: of the loop.
        """
        n, d = self.parts.arm.n, sampling.delays
        c, p = lanes.own(self.law.values), lanes.own(self.scenario.parameters)
        rows = [x, c, p, payload, *([] if self._given is None else [lanes.own(self._given)])]
        given = [np.ascontiguousarray(np.broadcast_to(row, (lanes.count, row.shape[1]))) for row in rows]
        found = interpret(self.program, *given) if self._kernel is None else self._kernel(*given)
        u, y, memory, s = (np.asarray(each) for each in found)
        numbers = [lanes.own(each) for each in (d.later, d.jitter, d.drift, d.command_loss, d.measurement_loss)]
        return {
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
