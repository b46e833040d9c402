"""Initial values of a loop: state of the plant, command in force, measurement, memories. Design section 4."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armwright import scalar
from armwright.actuators import holding_command
from armwright.dynamics import holding_torques
from armwright.errors import HiddenStateError
from armwright.interfaces import UNTRACEABLE, why
from armwright.kernels.batch import Kernel
from armwright.kernels.loop import LaneGroup
from armwright.kernels.stages import NEVER
from armwright.kernels.target import select_target
from armwright.parameters import LaneFields
from armwright.program import Program, kept, trace
from armwright.scalar import Array
from armwright.signals import Layout
from armwright.simulation.loop.config import LoopConfig, Sampling
from armwright.simulation.loop.controller import ControllerAdapter, hidden_state
from armwright.simulation.loop.sensor_set import SensorSet
from armwright.simulation.plant.inputs import OF_DRIVES, PlantInputs
from armwright.simulation.plant.view import PlantView

OF_PLANT, OF_LOOP = ("x_0",), ("u_0", "y_0", "m_0", "s_0")
BEGUN = {  # blocks of a sampled loop, by the result of the program that they begin with
    "x": "x_0",
    "x_seen": "x_0",
    "m_sensors": "m_0",
    "y": "y_0",
    "y_kept": "y_0",  # without what the drives applied, which stands behind it
    "s": "s_0",
    **dict.fromkeys(("u", "u_issued", "u_kept", "u_base", "u_seen"), "u_0"),
}
NO_CONTROLLER = ControllerAdapter(LaneFields(None), Layout(), Layout())


class Initialisation:
    """Initial values of a loop, one row per lane.

    They are computed by one compiled program however many lanes there are, so that a lane's bits do not depend on their number.

    Attributes:
        program: (start, c, p, payload, wrench, c_sensors, u?, supply?, enabled?) → initial state of the plant and, of a sampled
            loop, the command in force, the measurement, what sensors remember and the controller's state. None where the state
            is the start itself.
        untraced: why the controller's own beginning is not traced; None where it is.
    """

    def __init__(
        self,
        config: LoopConfig,
        start: np.ndarray,
        parameters: np.ndarray,
        command: np.ndarray | None,
        controller: ControllerAdapter | None,
        sensors: SensorSet | None,
        period: float,
        target: str | None,
    ):
        """The beginning of a loop.

        Args:
            config: the loop, without what is sampled.
            start: (lanes or 1, 2n) positions and speeds, or (lanes or 1, size) whole states of the plant.
            parameters: (lanes or 1, k) of the arm that vary.   command: (lanes or 1, n) in force; None: what holds the arm.
            controller, sensors: of a sampled loop.   period: [s].   target: processor level, as in `compile`.
        """
        self.config, self._start, self._parameters, self._command = config, start, parameters, command
        self._controller, self._sensors, self._period = controller or NO_CONTROLLER, sensors, period
        self._whole = start.shape[1] == config.bare.size
        self.untraced: str | None = None
        self._kernel = None if sensors is None and self._whole else self._compiled(target)
        self.program = None if self._kernel is None else self._kernel.program
        law = self._of_law()
        self._law_kernel = None if law is None else Kernel(law, select_target(target))

    @property
    def states(self) -> int:
        """Entries of the controller's state."""
        return 0 if self.program is None else self.program.outputs[-1].size

    def _compiled(self, target: str | None) -> Kernel:
        """The program in native code; without a controller it depends on the arm and what varies alone, and is kept."""

        def made() -> Kernel:
            return Kernel(self._program(), select_target(target))

        shapes = self._start.shape[1], self._parameters.shape[1]
        return made() if self._sensors else kept(("begin", self.config.structure, *shapes, target), made)

    def _program(self) -> Program:
        config, sensors, controller = self.config, self._sensors, self._controller
        shapes = {"start": self._start.shape[1:], "c": controller.values.shape[1:], "p": self._parameters.shape[1:]}
        shapes |= {"payload": (10 * len(config.payload_frames),), "wrench": (config.inputs.get("wrench", 0),)}
        shapes["c_sensors"] = (0,) if sensors is None else sensors.values.shape[1:]
        if sensors is not None and self._command is not None:
            shapes["u"] = (config.arm.n,)
        if sensors is not None:
            shapes |= {name: (size,) for name, size in config.inputs.items() if name in OF_DRIVES}

        def begin(controller: ControllerAdapter, *arguments: Array) -> tuple[Array, ...]:
            given = dict(zip(shapes, arguments, strict=True))
            plant, n, start = config.plant(given), config.arm.n, given["start"]
            arm, x = plant.model, start if self._whole else plant.initial(start[:n], start[n:])
            if sensors is None:
                return (scalar.array(x),)
            q = plant.part(x, "q")
            u = given["u"] if "u" in given else holding_command(arm, holding_torques(arm, q), q)
            inputs = PlantInputs.named(u, {name: given[name] for name in config.inputs if name in given})
            view = PlantView(plant, x, inputs, self._period)
            exact = sensors.of_lane(given["c_sensors"]).without_noise()
            memory = exact.memory(view)
            seen, _ = exact.measure(view, memory, np.full(sum(exact.draws), 0.5))
            y = scalar.array(np.concatenate([seen, plant.applied(x, inputs)]))
            s = np.zeros(0) if controller.control is None else controller.initial(arm, y, given["c"])
            return scalar.array(x), scalar.array(u), y, scalar.array(memory), s

        def alone() -> Program:
            """Without the controller: where its `init` is not traced, it has a state of its own kind, which Python keeps."""
            return trace("begin", lambda *arguments: begin(NO_CONTROLLER, *arguments), shapes, OF_PLANT + OF_LOOP)

        if sensors is None:
            return trace("begin", lambda *arguments: begin(NO_CONTROLLER, *arguments), shapes, OF_PLANT)
        if controller.vectorised:
            self.untraced = "it asks for all lanes at once"
            return alone()
        try:
            return trace("begin", lambda *arguments: begin(controller, *arguments), shapes, OF_PLANT + OF_LOOP)
        except HiddenStateError:
            raise hidden_state(controller.name) from None
        except UNTRACEABLE as error:
            self.untraced = why(error)
            return alone()

    def _of_law(self) -> Program | None:
        """(y, c, p, payload) → the controller's state; None where there is nothing that it remembers.

        Apart from `program`, whose arithmetic it would share: a controller in C begins from the measured numbers alone.
        """
        config, controller = self.config, self._controller
        if self._sensors is None or controller.control is None or self.untraced is not None or not self.states:
            return None

        def begin(y: Array, c: Array, p: Array, payload: Array) -> Array:
            return controller.initial(config.plant({"p": p, "payload": payload}).model, y, c)

        shapes = {"y": (controller.y.size,), "c": controller.values.shape[1:], "p": self._parameters.shape[1:]}
        return trace("begin", begin, {**shapes, "payload": (10 * len(config.payload_frames),)}, ("s_0",))

    def blocks(
        self, lanes: LaneGroup, acting: Mapping[str, np.ndarray], sampling: Sampling | None
    ) -> dict[str, np.ndarray]:
        """Initial values of blocks for a group of lanes, (count, …) each, or (1, …) where they are the same for all.

        Args:
            lanes: the group.   acting: (count or 1, entries) inputs then acting, by name.   sampling: of a sampled loop.
        """
        if self._kernel is None:
            return {"x": lanes.own(self._start)}
        arguments = self.arguments(lanes, acting)
        values = self._kernel(*arguments)
        if sampling is None:
            return {"x": np.asarray(values)}
        results = dict(zip(OF_PLANT + OF_LOOP, (np.asarray(each) for each in values), strict=True))
        if self._law_kernel is not None:
            results["s_0"] = np.asarray(self._law_kernel(results["y_0"], *arguments[1:4]))
        begun = {name: results[result] for name, result in BEGUN.items()}
        d = sampling.delays
        numbers = [lanes.own(each) for each in (d.later, d.jitter, d.drift, d.command_loss, d.measurement_loss)]
        return begun | {
            "y_kept": begun["y"][:, : sampling.sensors.layout.size],
            "see_at": (sampling.period * (1.0 - lanes.own(d.earlier)))[:, None],
            "d_measured": lanes.own(d.measured)[:, None],
            "arrivals": np.full((lanes.count, 1), NEVER),
            "d_commanded": lanes.own(d.commanded)[:, None],
            "d": np.stack(np.broadcast_arrays(*numbers), axis=1),
            "c": arguments[1],
            "c_sensors": arguments[5],
        }

    def arguments(self, lanes: LaneGroup, acting: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        """Arguments of the program for a group of lanes, (count, entries) each; acting: as `blocks`."""
        assert self.program is not None
        sensors = np.zeros((1, 0)) if self._sensors is None else self._sensors.values
        own = {"start": self._start, "c": self._controller.values, "p": self._parameters, "c_sensors": sensors}
        own |= {} if self._command is None else {"u": self._command}
        names = [port.name for port in self.program.inputs]
        rows = [lanes.own(own[name]) if name in own else acting[name] for name in names]
        return [np.ascontiguousarray(np.broadcast_to(row, (lanes.count, row.shape[1]))) for row in rows]
