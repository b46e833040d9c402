"""Linear model of a sampled loop about poses at rest: slopes of plant, sensors and controller, from the simulation's own code."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright import scalar
from armwright.actuators import holding_command
from armwright.dynamics import holding_torques
from armwright.errors import ScenarioError
from armwright.features import Support
from armwright.interfaces import UNTRACEABLE, why
from armwright.model import DriveLimits, Model
from armwright.model.drive import Friction
from armwright.program import Program, trace
from armwright.program.interpret import interpret
from armwright.scalar import Array
from armwright.simulation.loop.controller import ControllerAdapter, counters_of, place_of, traced_controller
from armwright.simulation.loop.references import reference_layout
from armwright.simulation.loop.sensor_set import SensorSet
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.slopes import plant_slopes
from armwright.simulation.plant.view import PlantView

LEFT_OUT = "left out"
EMPTY_HAND = "left out, the margins are those of an arm that carries none of it"
SERVOS = "arm.replace(firmware=None), with the servo's loop in the controller"
SUPPORT = Support(
    "loops",
    scenario=True,
    approximated={
        "lanes": "the nominal arm is analysed, without their variations",
        **dict.fromkeys(("grips of a motion", "payloads over time"), EMPTY_HAND),
    }
    | dict.fromkeys(
        (
            *("gear loss", "dry friction", "smoothed friction", "friction by direction", "friction offset"),
            *("Stribeck friction", "sigmoid friction", "LuGre friction", "friction by temperature", "play"),
            "load-dependent friction",
            *("kinematic error", "cogging", "stops", "heat", "coasting", "dead zone", "supply"),
            *("jitter", "lost samples", "clock drift", "sensor noise", "encoder counts", "command filter"),
        ),
        LEFT_OUT,
    ),
    without_effect={
        "brakes": "they are released unless inputs.brake applies them",
        **dict.fromkeys(
            ("pose", "schedule of poses", "motion", "moving start"),
            "small motions about rest are those of any reference",
        ),
        **dict.fromkeys(("wrench", "applied brakes", "supply over time"), "the loop is that without them"),
    },
    refused={"commands over time": "a loop and its controller", "servos": SERVOS},
)


def small_signal_arm(arm: Model) -> Model:
    """The arm for small motions about rest: with viscous friction and elasticity, without non-smooth or saturating terms."""

    def body_of(body: Any) -> Any:
        friction, elasticity = body.friction, body.elasticity
        if friction is not None:
            friction = Friction(viscous=friction.viscous, on_motor=friction.on_motor)
        if elasticity is not None:
            elasticity = replace(elasticity, cubic=None, backlash=None, error=None)
        drive = replace(
            body.drive, efficiency=None, smoothing=None, thermal=None, cogging=None, coasts=False, dead_zone=None
        )
        limits = DriveLimits(position=body.limits.position)
        return replace(
            body, drive=drive, friction=friction, elasticity=elasticity, limits=limits, stops=None, brake=None
        )

    return replace(arm, bodies=tuple(body_of(body) for body in arm.bodies), supply=None)


@dataclass(frozen=True, eq=False)
class LoopSlopes:
    """Matrices of a loop, linearised about poses (…).

    With x the plant's state, E dx/dt = A x + B u; in tick k, u_k and the next memories of sensors and controller are linear in
    (x, memories, u in force), by the rows of `ticks[k]`.

    Attributes:
        e, a: (…, N, N).   b: (…, N, n).   ticks: each (…, n + M, N + M + n), one for each tick of a cycle.
    """

    e: np.ndarray
    a: np.ndarray
    b: np.ndarray
    ticks: tuple[np.ndarray, ...]

    def alone(self, joint: int, states: np.ndarray, free: bool = False) -> LoopSlopes:
        """The loop of one joint by itself; `states` are the joint's indices in x.

        The others are held still, or `free`, without torque: then E = ((E⁻¹)_ss)⁻¹, which holds 1/(H⁻¹)_jj in place of H_jj.
        """
        size, n = self.b.shape[-2:]
        memory = self.ticks[0].shape[-2] - n
        rows = np.r_[joint, n : n + memory]
        columns = np.r_[states, size : size + memory, size + memory + joint]
        ticks = tuple(tick[..., rows[:, None], columns] for tick in self.ticks)
        e, a = (matrix[..., states[:, None], states] for matrix in (self.e, self.a))
        if free:
            e = np.linalg.inv(np.linalg.inv(self.e)[..., states[:, None], states])
        return LoopSlopes(e, a, self.b[..., states, joint : joint + 1], ticks)


class SmallPlant:
    """Linear model of an arm with its drives about poses at rest, for any controller.

    Attributes:
        arm: as `small_signal_arm`.   plant: of the arm.
    """

    def __init__(self, arm: Model):
        self.arm = small_signal_arm(arm)
        self.plant = Plant.of(self.arm)

    def at_rest(self, q: Array) -> tuple[Array, Array]:
        """The plant's state (size,) and the commands (n,) that hold the arm at q (n,) [rad | m]."""
        u = holding_command(self.arm, holding_torques(self.arm, q), q)
        return scalar.array(self.plant.initial(q, scalar.zeros(self.arm.n))), scalar.array(u)

    @cached_property
    def program(self) -> Program:
        """q → E, A, B of  E dx/dt = A x + B u."""

        def slopes(q: Array) -> tuple[Array, Array, Array]:
            x, u = self.at_rest(q)
            _, a, e = plant_slopes(self.plant, x, PlantInputs(u))
            by_command = scalar.jacobian(lambda u: self.plant.derivative(x, PlantInputs(u)), u)
            return scalar.array(e), scalar.array(a), scalar.array(e @ by_command)

        return trace("plant_at_rest", slopes, {"q": (self.arm.n,)}, ("e", "a", "b"))

    def slopes(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """E (…, N, N), A (…, N, N) and B (…, N, n) at poses q (…, n) [rad | m]."""
        e, a, b = interpret(self.program, q)
        return e, a, b

    def states_of(self, joint: int, names: Sequence[str] | None = None) -> np.ndarray:
        """Indices of a joint's states in the plant's state, for parts with some names or for all."""
        layout, states = self.plant.layout, []
        for name in layout.names if names is None else names:
            place = layout.place(name)
            joints = layout[name].joints or tuple(range(self.arm.n))
            states += [place.start + k for k, each in enumerate(joints) if each == joint]
        return np.array(states, dtype=int)


class SmallSignal:
    """Linear model of a sampled loop about poses at rest: plant, sensors and controller.

    Attributes:
        plant: of the arm.   period: [s].   cycle: ticks after which a controller of several rates repeats itself.
    """

    def __init__(self, plant: SmallPlant, controller: Any, sensors: tuple[Any, ...], period: float):
        """The loop of a controller.

        Args:
            plant: of its arm.   controller: as of `Loop`; fields that are a `Batch` are given anew with each pose.
            sensors: of the loop.   period: [s].
        Raises:
            ScenarioError: a controller that does not fit the arm.
        """
        self.small, self.plant, self.period = plant, plant.plant, period
        exact = tuple(
            replace(each, counts=None, counts_per_m=None) if isinstance(each, Sensors) else each for each in sensors
        )
        self._sensors = SensorSet.of(self.plant, exact).without_noise()
        layout = reference_layout(plant.arm, None)
        self._adapter = ControllerAdapter.of(controller, plant.arm, period, self._sensors.y, layout)
        self.cycle = cycle_of(self._adapter.control)

    @property
    def gains(self) -> np.ndarray:
        """(lanes or 1, k) values of the controller's batched fields."""
        return self._adapter.values

    @property
    def memories(self) -> int:
        """Number of memory entries of sensors and controller."""
        return self.program.outputs[0].shape[0] - self.plant.model.n

    @cached_property
    def program(self) -> Program:
        """(q, c) → the slopes of every tick of a cycle.

        Raises:
            ScenarioError: a controller that cannot be traced.
        """
        names = [f"tick{k}" for k in range(self.cycle)]
        shapes = {"q": (self.plant.model.n,), "c": self._adapter.values.shape[1:]}

        def slopes(q: Array, c: Array) -> tuple[Array, ...]:
            n, size, seen, found = self.plant.model.n, self.plant.size, self._seen(q, c), []
            first = size + sum(self._sensors.memories)  # of the controller's state, behind which stand n commands
            counting = [first + entry for entry in self._counters(len(seen) - first - n)]
            for k in range(self.cycle):
                tick = self._tick(k, q, c, len(seen))
                found.append(scalar.jacobian(tick, seen))
                if counting:  # all else rests
                    following = tick(seen)
                    seen = scalar.array([following[n + e - size] if e in counting else v for e, v in enumerate(seen)])
            return tuple(found)

        try:
            return trace("ticks_at_rest", slopes, shapes, names)
        except UNTRACEABLE as error:
            if isinstance(error, ScenarioError):
                raise
            what = f"cannot be traced ({why(error)})"
            raise ScenarioError(what, place=place_of(self._adapter.name), expected="a controller of arrays") from error

    def _seen(self, q: Array, c: Array) -> Array:
        """All that a tick sees where the arm is held at q: the plant's state, memories, commands in force."""
        x, u = self.small.at_rest(q)
        view = PlantView(self.plant, x, PlantInputs(u), self.period)
        memory = self._sensors.memory(view)
        seen, _ = self._sensors.measure(view, memory, self._draws)
        y = scalar.array(np.concatenate([seen, self.plant.applied(x, u)]))
        return scalar.array(np.concatenate([x, memory, self._initial(y, c), u]))

    def _initial(self, y: Array, c: Array) -> Array:
        return scalar.array(self._adapter.initial(self.plant.model, y, c))

    def _counters(self, states: int) -> list[int]:
        """Entries of the controller's state of that many numbers that count ticks."""
        if self.cycle == 1:
            return []
        return counters_of(traced_controller(self._adapter, self.plant.model, self.period, states))

    @property
    def _draws(self) -> np.ndarray:
        return np.full(sum(self._sensors.draws), 0.5)

    def _tick(self, k: int, q: Array, c: Array, count: int) -> Callable[[Array], Array]:
        """(x, memories, u in force) → (u, next memories) of tick k."""
        n, size, memory = self.plant.model.n, self.plant.size, sum(self._sensors.memories)
        ends = [size, size + memory, count - n]
        reference = scalar.array(np.concatenate([q, scalar.zeros(2 * n)]))

        def tick(seen: Array) -> Array:
            x, remembered, states, u = np.split(seen, ends)
            view = PlantView(self.plant, x, PlantInputs(u), self.period)
            values, kept = self._sensors.measure(view, remembered, self._draws)
            y = scalar.array(np.concatenate([values, self.plant.applied(x, u)]))
            command, following = self._adapter.step(k * self.period, reference, y, states, c)
            return scalar.array(np.concatenate([scalar.array(command), kept, scalar.array(following)]))

        return tick

    def slopes(self, q: Any, gains: Any = None) -> LoopSlopes:
        """Slopes at poses q (…, n) [rad | m], with gains (…, k) in place of the controller's batched fields."""
        q = np.asarray(q, dtype=float)
        gains = self._adapter.values[0] if gains is None else np.asarray(gains, dtype=float)
        ticks = interpret(self.program, q, gains)
        e, a, b = self.small.slopes(q)
        return LoopSlopes(e, a, b, ticks if isinstance(ticks, tuple) else (ticks,))


def cycle_of(control: Any) -> int:
    """Number of ticks after which a multirate controller repeats: least common multiple of its fields `…_every`.

    Those of the controller inside it count too.
    """
    if not is_dataclass(control):
        return 1
    rates = [int(getattr(control, each.name)) for each in fields(control) if each.name.endswith("_every")]
    inner = [getattr(control, each.name) for each in fields(control) if each.name in ("inner", "controller")]
    return math.lcm(*rates, *map(cycle_of, inner))
