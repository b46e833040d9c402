"""The accurate reference: SUNDIALS' CVODES moves each lane from change to change, nearly to rounding. [HindmarshEtAl2005]

Slow, and for some lanes only. All that is around the plant (sensors, controller, delays, schedules) is the compiled loop's own,
so that what differs from another integrator's run is the integration and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import casadi
import numpy as np

from armwright.errors import ScenarioError
from armwright.kernels.loop import Lanes
from armwright.program import trace
from armwright.scalar import Array
from armwright.simulation.stepping import Adaptivity

MOST_LANES = 1000  # more would take hours
MOST_INNER = 10**6  # of CVODES' own steps from one change to the next
LONGEST = 1024  # ticks of one call; powers of two below it serve any number
METHODS = ("adams", "bdf")  # of high order where nothing is stiff; and where something is


def check_lanes(lanes: int) -> None:
    """Refuses what would take hours.

    Raises:
        ScenarioError: too many lanes.
    """
    if lanes > MOST_LANES:
        raise ScenarioError(
            f"integrator = 'cvodes': {lanes} lanes; expected at most {MOST_LANES}, or integrator = 'rk45' with a small rtol"
        )


class Cvodes:
    """A plant's solutions.

    Args:
        derivative: (x, u, …) → dx/dt.   shapes: of its arguments by name, "x" and "u" first, then at most one other.
        adaptivity: tolerances.   stiff: whether the plant has fast parts that die away.
    """

    def __init__(
        self,
        derivative: Callable[..., Array],
        shapes: Mapping[str, tuple[int, ...]],
        adaptivity: Adaptivity,
        stiff: bool,
    ):
        self._f = trace("plant", derivative, shapes, ("xd",)).graph
        self._adaptivity = adaptivity
        self._methods = METHODS[::-1] if stiff else METHODS
        self._solvers: dict[tuple[int, str], casadi.Function] = {}

    def after(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, span: float, count: int = 1) -> np.ndarray | None:
        """The states (count, nx) each `span` seconds, u and p held; None where no step is small enough.

        Args:
            x: (nx,).   u: (nu,).   p: (np,) of the plant.   span: [s].   count: how often.
        """
        rows: list[np.ndarray] = []
        while len(rows) < count:
            block = 1 << min(count - len(rows), LONGEST).bit_length() - 1
            states = self._block(rows[-1] if rows else x, u, p, span, block)
            if states is None:
                return None
            rows += list(states)
        return np.array(rows)

    def _block(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, span: float, count: int) -> np.ndarray | None:
        if not np.isfinite(x).all():
            return None
        for method in self._methods:
            try:
                found = self._solver(count, method)(x0=x, p=np.concatenate([u, p, [span]]))["xf"]
            except RuntimeError:  # CVODES gave up; it has told why on its own stream, which is silenced
                continue
            states = np.array(found).T
            if np.isfinite(states).all():
                return states
        return None

    def _solver(self, count: int, method: str) -> casadi.Function:
        """Over `count` units of time, each as long as the last parameter says."""
        if (count, method) not in self._solvers:
            sizes = [self._f.size1_in(k) for k in range(self._f.n_in())]
            x, *given = (casadi.SX.sym(f"i{k}", size) for k, size in enumerate(sizes))  # type: ignore[arg-type]
            span = casadi.SX.sym("span")  # type: ignore[arg-type]
            rate = span * self._f(x, *given)
            options = {
                "reltol": self._adaptivity.rtol,
                "abstol": self._adaptivity.atol,
                "max_num_steps": MOST_INNER,
                "linear_multistep_method": method,
                "nonlinear_solver_iteration": "newton",
                "show_eval_warnings": False,
                "disable_internal_warnings": True,
            }
            problem = {"x": x, "p": casadi.vertcat(*given, span), "ode": rate}
            times = [float(k) for k in range(1, count + 1)]
            self._solvers[count, method] = casadi.integrator("plant", "cvodes", problem, 0.0, times, options)
        return self._solvers[count, method]

    def held(
        self, x: np.ndarray, tick: np.ndarray, offset: np.ndarray, commands: np.ndarray, ticks: int, h: float
    ) -> Iterator[tuple[int, np.ndarray]]:
        """Ticks of h seconds under commands that hold from their rows on: (k, states at the ends of some ticks up to k).

        Args:
            x: (nx,) at t = 0.   tick, offset: (rows,) when each row holds: [s] behind that tick.   commands: (rows, nu).
            ticks: how many; it ends earlier where CVODES gives up.
        """
        k, row, u = 0, 0, commands[0]
        while k < ticks:
            begin, states = 0.0, None
            while row < len(tick) and tick[row] == k:
                if offset[row] > begin:
                    states = self.after(x, u, np.zeros(0), offset[row] - begin)
                    if states is None:
                        return
                    x, begin = states[-1], float(offset[row])
                u, row = commands[row], row + 1
            count = 1 if begin > 0.0 else int(min(tick[row], ticks) if row < len(tick) else ticks) - k
            states = self.after(x, u, np.zeros(0), h - begin, count)
            if states is None:
                return
            x, k = states[-1], k + count
            yield k, states

    def extend(self, lanes: Lanes) -> None:
        """Adds the blocks that `tick` needs, none of the lanes frozen, where the loop has not made them."""
        names = ("frozen", "see_at") if "x_seen" in lanes.blocks else ("frozen",)
        for name in names:
            lanes.blocks.setdefault(name, np.full((lanes.tiles, 1, lanes.width), -1.0))

    def tick(self, lanes: Lanes, k: int, h: float) -> None:
        """What `kernels.stages.Integrate` does in tick k of h seconds, on the same blocks."""
        values = {name: lanes.get(name).copy() for name in ("x", "u", "frozen")}
        empty = np.zeros((lanes.count, 0))
        plan, begins, p = (lanes.get(name) if name in lanes.blocks else empty for name in ("u_plan", "u_from", "p"))
        if "x_seen" in lanes.blocks:
            values["x_seen"], see_at = lanes.get("x_seen").copy(), lanes.get("see_at")
        else:
            see_at = np.full((lanes.count, 1), h)
        for lane in np.flatnonzero(values["frozen"][:, 0] < 0):
            x, u = values["x"][lane], values["u"][lane]
            commands = plan[lane].reshape(-1, len(u))
            edges = sorted({h, *(t for t in (*begins[lane], *see_at[lane]) if 0.0 < t < h)})
            for begin, end in zip([0.0, *edges], edges, strict=False):
                for s, command in enumerate(commands):
                    if s == 0 or begins[lane, s - 1] <= begin:
                        u = command
                states = self.after(x, u, p[lane], end - begin)
                if states is None:
                    values["frozen"][lane] = k
                    break
                x = states[0]
                if "x_seen" in values and end == see_at[lane, 0]:
                    values["x_seen"][lane] = x
            values["x"][lane], values["u"][lane] = x, u
        for name, value in values.items():
            lanes.set(name, value)
