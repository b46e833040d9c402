"""Event-exact motion of an arm without a loop: SciPy's rules between events that SciPy locates, none of our integrators.

Contacts and directions of motion are held between events. An event is a depth that changes its sign, a speed that comes to 0
where friction, a brake or gear loss is dry, and a load that passes what holds a joint at rest. Equations and the laws at rest are
the plant's own (`Plant.derivative`, `Sticking.present`); other tests hold these against closed forms and other programs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from armwright import scalar
from armwright.model import Model
from armwright.program import trace
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant

RTOL, ATOL = 1e-11, 1e-13
LONGEST = 0.01  # [s] of a step where there are contacts: one that begins and ends within a step is not seen
HAIR = 1e-13  # [rad | m, rad/s | m/s] beyond 0 where events are: the next one is not the same again, by rounding
STIFF = 2e4  # [1/s] beyond which an explicit rule would take too many steps
LATE = 1e-8  # [rad/s² | m/s²] beyond what holds, from which on something moves: the laws at rest are as exact as that
MOST_EVENTS, MOST_AT_ONCE = 100_000, 40


class Compiled:
    """A traced function of x and other arguments (sizes by name), which it keeps, on NumPy arrays in some microseconds a call."""

    def __init__(self, name: str, function: Callable[..., Any], sizes: Mapping[str, int]):
        graph = trace(name, function, {name: (size,) for name, size in sizes.items()}).graph
        self._buffer, self._evaluate = graph.buffer()
        self.arguments = {name: np.zeros(size) for name, size in sizes.items()}
        self._x, self._result = self.arguments["x"], np.zeros(graph.size1_out(0))
        for k, values in enumerate(self.arguments.values()):
            self._buffer.set_arg(k, memoryview(values))
        self._buffer.set_res(0, memoryview(self._result))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The result in a state x."""
        self._x[:] = x
        self._evaluate()
        return self._result.copy()


class ExactPlant:
    """An arm whose motion between changes of its inputs is exact to about 1e-9 of its range.

    Args:
        arm: the model.   brakes: whether its brakes take part.
    """

    def __init__(self, arm: Model, *, brakes: bool = False):
        self.plant = plant = Plant.of(arm, brakes=brakes)
        self._sticking, contacts = plant.sticking, sum(plant.contacts)
        elements = 0 if self._sticking is None else len(self._sticking.places)
        sizes = {"x": plant.size, "command": arm.n, "brake": len(plant.braked), "contacts": contacts}
        self._sizes = {name: size for name, size in sizes.items() if size}
        self._moving = self._sizes | ({"directions": elements} if elements else {})
        self._contacts, self._elements = np.zeros(contacts), elements
        self._rate = Compiled("rate", lambda x, *rest: plant.derivative(x, self._inputs(rest)), self._moving)
        self._depths = Compiled("depths", lambda x: plant.contact_depths(x), {"x": plant.size}) if contacts else None
        if contacts or elements:
            late = {"late": elements} if elements else {}
            self._events = Compiled("events", self._left, self._moving | late)
        if elements:
            self._present = Compiled(
                "present", lambda x, *rest: self._sticking.present(x, self._inputs(rest)), self._sizes
            )
            still = {"x": plant.size, "still": elements}
            self._at_rest = Compiled("rest", lambda x, still: self._sticking._with_zero_speeds(x, list(still)), still)

    def _inputs(self, rest: Sequence[Any]) -> PlantInputs:
        """The plant's inputs from arguments behind x."""
        return PlantInputs(**dict(zip([name for name in self._moving if name != "x"], rest, strict=False)))

    def _left(self, x: Any, *rest: Any) -> Any:
        """Event functions: an event comes where one of these falls through 0."""
        inputs, found = self._inputs(rest), []
        if len(self._contacts):
            made = zip(inputs.contacts, self.plant.contact_depths(x), strict=True)
            found += [scalar.where(contact, depth, -depth) + HAIR for contact, depth in made]
        if self._sticking is not None:
            ways = zip(
                inputs.directions, self._sticking.speeds(x), self._sticking._excess(x, inputs), rest[-1], strict=True
            )
            found += [
                scalar.where(scalar.equal(way, 0.0), late - excess, way * speed + HAIR)
                for way, speed, (excess, _, _), late in ways
            ]
        return scalar.array(found)

    def run(
        self,
        times: np.ndarray,
        q: Any,
        qd: Any,
        changes: Sequence[tuple[float, Mapping[str, Any]]],
        rtol: float = RTOL,
    ) -> np.ndarray:
        """States (rows, size) at times (rows,) [s] from 0 on, from q (n,) and q̇ (n,) at 0.

        Args:
            changes: times [s], the first at 0, and from then on the `command` (n,), and the `brake` (brakes,) if any.
            rtol: of a step.
        """
        x, rows = self.plant.initial(np.asarray(q, float), np.asarray(qd, float)), []
        if self._depths is not None:
            self._contacts[:] = self._depths(x) >= 0.0
        self.events = 0
        for k, (begin, inputs) in enumerate(changes):
            end = changes[k + 1][0] if k + 1 < len(changes) else times[-1]
            for name, values in inputs.items():
                self._hold(name, values)
            inside = times[(times > begin) & (times <= end)]
            part, x = self._piece(x, begin, end, inside, rtol)
            rows += [part]
        return np.vstack([self.plant.initial(np.asarray(q, float), np.asarray(qd, float)), *rows])

    def _hold(self, name: str, values: Any) -> None:
        for program in (getattr(self, each, None) for each in ("_rate", "_events", "_present")):
            if program is not None and name in program.arguments:
                program.arguments[name][:] = values

    def _piece(
        self, x: np.ndarray, t: float, end: float, times: np.ndarray, rtol: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """States at times within (t, end], and that at `end`, inputs constant."""
        rows, count, at_once = np.empty((0, self.plant.size)), len(self._contacts), 0
        late = np.full(self._elements, LATE)
        while t < end:
            self._hold("contacts", self._contacts)
            if self._elements:
                directions = self._present(x)
                self._hold("directions", directions)
                self._hold("late", late)
            functions = [_event(self._events, k) for k in range(count + self._elements)]
            wanted = times[len(rows) :]
            if not len(wanted) or wanted[-1] < end:
                wanted = np.append(wanted, end)
            method = "LSODA" if self._fastest(x) > STIFF else "DOP853"
            part = solve_ivp(
                lambda _, x: self._rate(x), (t, end), x, method, wanted, events=functions or None,
                rtol=rtol, atol=ATOL, max_step=LONGEST if count else np.inf,
            )  # fmt: skip
            assert part.status >= 0, part.message
            states = np.asarray(part.y).reshape(self.plant.size, -1).T
            rows = np.vstack([rows, states[: len(times) - len(rows)]])
            if part.status == 0:
                return rows, states[-1]
            k = next(k for k, at in enumerate(part.t_events) if len(at))
            at_once = at_once + 1 if part.t_events[k][0] - t < 1e-12 else 0
            self.events += 1
            assert max(self.events / MOST_EVENTS, at_once / MOST_AT_ONCE) < 1.0, f"events pile up at {t} s"
            t, x = part.t_events[k][0], part.y_events[k][0]
            if k < count:
                self._contacts[k] = 1.0 - self._contacts[k]
                continue
            way = directions[k - count]
            if way == 0.0:  # it comes loose; if the laws at rest do not say so yet, a little later
                self._hold("contacts", self._contacts)
                late[k - count] = 10.0 * late[k - count] if self._present(x)[k - count] == 0.0 else LATE
            else:
                stands = directions == 0.0
                stands[k - count] = True
                self._at_rest.arguments["still"][:] = stands
                x = self._at_rest(x)
        return rows, x

    def _fastest(self, x: np.ndarray) -> float:
        """The largest eigenvalue [1/s] of ∂ẋ/∂x, by differences."""
        step = 1e-7 * np.maximum(np.abs(x), 1e-3)
        base = self._rate(x)
        slopes = np.array([(self._rate(x + h * row) - base) / h for h, row in zip(step, np.eye(len(x)), strict=True)])
        return float(np.abs(np.linalg.eigvals(slopes)).max())


def _event(events: Compiled, k: int) -> Callable[[float, np.ndarray], float]:
    """Entry k of all events' functions as SciPy takes it."""

    def left(_: float, x: np.ndarray) -> float:
        return events(x)[k]

    left.terminal, left.direction = True, -1  # type: ignore[attr-defined]
    return left
