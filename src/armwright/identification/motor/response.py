"""Response of a drive to a logged command: free simulation of the record's own plant, with its derivatives, compiled.

Between two rows of a log the command is held. With a delay of  d = (m + φ) samples, 0 < φ ≤ 1, the plant sees command
u(k - m - 1) for the first φ of sample k and u(k - m) for the rest; both parts are integrated in equal substeps whose length
holds φ, so that the derivative by the delay is exact, and continuous where d passes a whole number. One motor with Coulomb and
viscous friction is integrated exactly instead, whatever its inductance (`affine`).

Dry friction without a smoothing speed sticks as in every simulation (`plant.sticking`). The state is a continuous function of
parameters there, and its derivative that of the branch taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright import scalar
from armwright.description.paths import with_values
from armwright.identification.motor.affine import SEGMENTS, direction, equations, event, is_affine, segment
from armwright.kernels.loop import LaneGroup, LoopArrays, NativeLoop
from armwright.kernels.stages import Call, RecordStage, Stage, TableStage
from armwright.kernels.target import select_target
from armwright.model.model import Model
from armwright.model.vary import Varied
from armwright.program.derivative import with_tangents
from armwright.program.trace import call, trace
from armwright.program.where_needed import WhereNeeded
from armwright.simulation.integrate.integrators import INTEGRATORS, Integrator
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant

RULE = "rk3"
LEAST_PART = 1e-6  # of a sample: in no time at all nothing sticks
EDGE = 1e-3  # of a substep: a rest nearer to its ends is taken as there
SIGNALS = ("q", "qd", "qd_mean", "current", "tau")  # that a log may be compared with


@dataclass(frozen=True, eq=False)
class DriveInputs:
    """Inputs of a response: one stretch of a log.

    Attributes:
        period: (rows) [s] from each row to the next; the last is that before.   command: (rows, n) [V | A | N m | N].
    """

    period: np.ndarray
    command: np.ndarray


class _InlinePlant(Plant):
    """A plant whose rules copy its derivative instead of calling it."""

    def program(self, inputs: Any) -> Any:
        """The plant itself, which `split`s as its program does."""
        return self


def _plant_of(model: Model) -> Plant:
    """The plant as rules call it; with play a copy of its derivative, whose tangents as a call would be no numbers there."""
    gaps = any(body.elasticity is not None and body.elasticity.backlash is not None for body in model.coordinates)
    return (_InlinePlant if gaps else Plant).of(model)


def _substep(plant: Plant, rule: Integrator, x: Any, command: Any, h: Any) -> Any:
    """The state a substep of h later, in two steps: halves, or parted where the first of the joints that stick comes to rest.

    A step in which a joint comes to rest is of order 1 only; one that ends there is not. When it does is known to second
    order, from its accelerations now and then, and its speed is 0 there.
    """
    if plant.sticking is None:
        half = plant.step(rule, x, command, 0.5 * h)
        return plant.step(rule, half, command, 0.5 * h)
    n, one = plant.model.n, 0.0 * h + 1.0
    ways = scalar.array([scalar.sign(speed) for speed in plant.sticking.speeds(x)])
    inputs = replace(PlantInputs(command), directions=ways)
    derivative = plant.program(inputs).split  # one program, as the rule calls it
    now, _ = derivative(x, inputs)
    parts = []
    for k in range(n, 2 * n):
        stops = scalar.less(x[k] * (x[k] + h * now[k]), 0.0)
        part = scalar.where(stops, -x[k] / scalar.where(stops, h * now[k], 1.0), one)
        then, _ = derivative(x + (h * part) * now, inputs)
        mean = 0.5 * (now[k] + then[k])
        stops = stops * scalar.less(x[k] * mean, 0.0)
        part = scalar.where(stops, -x[k] / scalar.where(stops, h * mean, 1.0), one)
        parts.append(scalar.where(scalar.less(part, 1.0), scalar.clip(part, EDGE, 1.0 - EDGE), one))
    least = parts[0]
    for part in parts[1:]:
        least = scalar.minimum(least, part)
    comes = scalar.less(least, 1.0)
    first = scalar.where(comes, least, 0.5 * one)
    middle = list(plant.step(rule, x, command, first * h))
    for k, part in enumerate(parts, start=n):
        middle[k] = scalar.where(comes * scalar.less_equal(part, least), 0.0, middle[k])
    return plant.step(rule, scalar.array(middle), command, (1.0 - first) * h)


class Response:
    """A plant's compiled response, with derivatives by parameters, delay, input offsets and initial state.

    Columns of a lane's parameters: those of `varied`, then φ of the delay, then an offset of each command. Directions of its
    derivatives: the same, then the initial state.
    """

    def __init__(self, varied: Varied, signals: Sequence[str], most_delay: int, substeps: int):
        """The response of an arm with some of its numbers open.

        Args:
            varied: the arm and what varies.   signals: of `SIGNALS`, that are returned, for each joint.
            most_delay: longest delay in whole samples; 0: none, the command acts at once.   substeps: of each part of a sample.
        """
        self.varied, self.signals, self.most_delay = varied, tuple(signals), most_delay
        n, own = varied.arm.n, len(varied.parameters)
        self.n, self.columns = n, own + 1 + n
        nominal = Plant.of(varied.arm)
        self.layout, self.size = nominal.layout, nominal.size
        self.directions = self.columns + self.size
        self.carried = self._carried(nominal)
        rule = INTEGRATORS[RULE]

        def substep(x, command, p, part):
            """`part` holds the substep's length without and with the delay's fraction [s]."""
            h = part[0] + part[1] * p[own]
            plant, u = _plant_of(varied.model(p[:own])), command + p[own + 1 :]
            return _substep(plant, rule, x, u, h)

        x_p = {"x": (self.size,), "command": (n,), "p": (self.columns,)}
        self._affine = is_affine(nominal)
        if not self._affine:
            self._inner = trace("substep", substep, {**x_p, "part": (2,)}, ("x_next",))
        self._substeps = substeps

    def _carried(self, plant: Plant) -> np.ndarray:
        """(size, size) matrix that puts motors behind elastic gears where their links are, and leaves the rest of a state."""
        carried, zero = np.eye(self.size), np.zeros(self.n)
        for name, link in (("motor_q", 0), ("motor_qd", self.n)):
            if name in self.layout:
                place = self.layout.place(name)
                for k, unit in enumerate(np.eye(self.n)):
                    state = plant.initial(*((unit, zero) if link == 0 else (zero, unit)))
                    carried[place, link + k] = np.asarray(state, dtype=float)[place]
                carried[place, place] = 0.0
        return carried

    def _stages(self) -> tuple[Stage, ...]:
        """Stages of the loop over the rows, with derivatives."""
        n, varied, most_delay = self.n, self.varied, self.most_delay
        own = len(varied.parameters)

        def sample(held):
            def taken(x, row, lag, p):
                before, now = self._acting(row, lag)
                h, zero = row[0], 0.0 * row[0]
                parts = [(now, (h, zero))] if most_delay == 0 else [(before, (zero, h)), (now, (h, -h))]
                for command, part in parts:
                    x = held(x, command, p, scalar.array(list(part)))
                return scalar.array(list(x))

            return taken

        def measured(x, q_before, row, lag, p):
            before, now = self._acting(row, lag)
            command = (now if most_delay == 0 else before) + p[own + 1 :]
            return self._outputs(Plant.of(varied.model(p[:own])), x, q_before, row, command), scalar.array(list(x[:n]))

        lags = most_delay + 1
        row = {"row": (2 + n * (lags + 1),), "lag": (lags,), "p": (self.columns,)}
        count, size = len(self.signals) * n, 1 + self.directions
        measure = trace("measured", measured, {"x": (self.size,), "q_before": (n,), **row}, ("y", "q_before_next"))
        seeds = {"p": np.eye(self.columns, self.directions)}
        measure = with_tangents(measure, {"x", "q_before"}, seeds, self.directions)
        held = self._by_segments(seeds) if self._affine else self._by_substeps(seeds)
        sampled = trace("sample", sample(held), {"x": (self.size * size,), **row}, ("x_next",))
        compared = RecordStage("run", ("y",), (count * size,))
        return TableStage("row", 2 + n * (lags + 1)), Call(measure), compared, Call(sampled)

    def _by_substeps(self, seeds: dict[str, np.ndarray]) -> Callable[..., Any]:
        """(x with tangents, command, p, part) → x with tangents behind a part of a sample, in equal substeps."""
        # 2 * substeps copies compile for seconds
        step = with_tangents(self._inner, {"x"}, seeds, self.directions, noinline=True)

        def held(x, command, p, part):
            for _ in range(self._substeps):
                x = call(step, x, command, p, part / self._substeps)
            return x

        return held

    def _by_segments(self, seeds: dict[str, np.ndarray]) -> Callable[..., Any]:
        """The same, exactly from one change of direction to the next; the state has the time that is spent behind it."""
        own, size = len(self.varied.parameters), self.size + 1

        def known(x, command, p, part):
            plant, u = _plant_of(self.varied.model(p[:own])), command + p[own + 1 :]
            return *equations(plant, u), part[0] + part[1] * p[own] - x[-1]

        def event_of(x, command, p, part, way):
            A, forth, back, left = known(x, command, p, part)
            now = direction(A, forth, back, x[1:-1], way[0])
            time, behind = event(A, forth, back, x[1:-1], now, left)
            return scalar.array([now, time, behind, scalar.less(time, left)])

        def segment_of(last):
            def moved(x, command, p, part, found):
                A, forth, back, left = known(x, command, p, part)
                after, time = segment(A, forth, back, x[:-1], left, tuple(found), last)
                return scalar.array([*after, x[-1] + time])

            return moved

        shapes = {"x": (size,), "command": (self.n,), "p": (self.columns,), "part": (2,)}
        events = trace("event", event_of, {**shapes, "way": (1,)}, ("found",), noinline=True)
        segments = [
            with_tangents(
                trace(("segment", "last_segment")[last], segment_of(last), {**shapes, "found": (3,)}, ("x_next",)),
                {"x"}, seeds, self.directions, noinline=True,
            )
            for last in (False, True)
        ]  # fmt: skip

        def further(last):
            """Segment behind the first: x and its tangents, direction behind it, and 1 if time is left."""

            def moved(x, command, p, part, way):
                found = call(events, x[:size], command, p, part, way)
                return scalar.array([*call(segments[last], x, command, p, part, found[:3]), *found[2:]])

            return moved

        shapes |= {"x": (size * (1 + self.directions),), "way": (1,)}

        def held(x, command, p, part):
            zero = 0.0 * x[0]
            x = scalar.array([*x[: self.size], zero, *x[self.size :], *([zero] * self.directions)])
            whole = further(False)(x, command, p, part, scalar.array([zero]))
            for number in range(1, SEGMENTS):
                needed = WhereNeeded(f"further{number}", further(number == SEGMENTS - 1), shapes)
                none = scalar.array([*whole[:-2], zero, zero])
                whole = needed(whole[-1], none, whole[:-2], command, p, part, whole[-2:-1])
            x = whole[:-2]
            return scalar.array([*x[: self.size], *x[size : -self.directions]])

        return held

    def initial(self, arm: Model) -> np.ndarray:
        """(size,) state at rest at 0 of an arm of this structure."""
        zero = np.zeros(self.n)
        return np.asarray(Plant.of(arm).initial(zero, zero), dtype=float)

    def _acting(self, row, lag):
        """Commands before and behind the delay's fraction of a sample, (n,) each, chosen by the lane's whole delay."""
        n, lags = self.n, self.most_delay + 1
        commands = row[2:].reshape(lags + 1, n)
        now = sum(lag[j] * commands[j] for j in range(lags))
        before = sum(lag[j] * commands[j + 1] for j in range(lags))
        return before, now

    def _outputs(self, plant, x, q_before, row, command):
        n = self.n
        values = {"q": x[:n], "qd": x[n : 2 * n], "qd_mean": (x[:n] - q_before) / row[1]}
        if {"current", "tau"} & set(self.signals):
            joints = plant.outputs(x, command)
            values |= {"current": joints["current"], "tau": joints["tau"]}
        return scalar.array([value for name in self.signals for value in values[name]])

    @cached_property
    def loop(self) -> NativeLoop:
        """The compiled loop."""
        return NativeLoop(self._stages(), select_target())

    def table(self, inputs: DriveInputs) -> np.ndarray:
        """(rows, …) of the loop: this period, the last one, then commands u(k), u(k - 1), …; before the first row, the first."""
        rows, lags = len(inputs.period), self.most_delay + 1
        before = np.concatenate([inputs.period[:1], inputs.period[:-1]])
        places = np.maximum(np.arange(rows)[:, None] - np.arange(lags + 1), 0)
        commands = inputs.command[places].reshape(rows, -1)
        return np.ascontiguousarray(np.column_stack([inputs.period, before, commands]))

    def run(
        self, table: np.ndarray, p: np.ndarray, delay: np.ndarray, start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Signals of some lanes over one stretch, and their derivatives.

        Args:
            table: of the stretch.   p: (lanes, k) parameters of `varied`, then (n) input offsets.   delay: (lanes,) [samples].
            start: (lanes, size) initial states.
        Returns:
            y: (lanes, rows, signals · n).   dy: (lanes, rows, signals · n, directions).
        """
        lanes = LaneGroup(len(p), self.loop.target.width)
        self.loop.extend(lanes)
        whole = np.clip(np.ceil(delay).astype(int) - 1, 0, self.most_delay)
        fraction = np.clip(delay - whole, LEAST_PART, 1.0 - LEAST_PART)
        own = len(self.varied.parameters)
        lanes.set("p", np.concatenate([p[:, :own], fraction[:, None], p[:, own:]], axis=1))
        lanes.set("lag", np.eye(self.most_delay + 1)[whole])
        d = self.directions
        tangent = np.zeros((len(p), self.size, d))
        tangent[:, np.arange(self.size), self.columns + np.arange(self.size)] = 1.0
        n = self.n
        lanes.set("x", np.concatenate([start, tangent.reshape(len(p), -1)], axis=1))
        lanes.set("q_before", np.concatenate([start[:, :n], tangent[:, :n].reshape(len(p), -1)], axis=1))
        count = len(self.signals) * n
        record = np.empty((len(table), lanes.tiles * lanes.width, count * (1 + d)))
        arrays = LoopArrays({"row": table}, records={"run": record})
        self.loop.run(lanes, 1.0, (0, len(table)), arrays, last=len(table), every=1)
        rows = record[:, : len(p)].transpose(1, 0, 2)
        return rows[..., :count], rows[..., count:].reshape(*rows.shape[:2], count, d)


KEPT = 8  # responses of a process: tracing one takes as long as a tenth of a fit
_kept: dict[tuple[object, ...], Response] = {}


def response_of(varied: Varied, signals: Sequence[str], most_delay: int, substeps: int) -> Response:
    """The `Response` of an arm; reused if the arm differs only in varied numbers.

    Args:
        varied, signals, most_delay, substeps: as of `Response`.
    """
    record = with_values(varied.arm.description, {each.path: 1.0 for each in varied.parameters if each.entry is None})
    key = repr(record), varied.names, tuple(signals), most_delay, substeps
    if key not in _kept:
        while len(_kept) >= KEPT:
            del _kept[next(iter(_kept))]  # the oldest
        _kept[key] = Response(varied, signals, most_delay, substeps)
    return _kept[key]
