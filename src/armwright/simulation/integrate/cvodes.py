"""The accurate reference: SUNDIALS' CVODES moves each lane from change to change, nearly to rounding. [HindmarshEtAl2005]

Slow, and for some lanes only. All that is around the plant (sensors, controller, delays, schedules) is the compiled loop's own,
so that what differs from another integrator's run is the integration and nothing else.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial

import casadi
import numpy as np

from armwright.errors import ScenarioError
from armwright.features import Support
from armwright.kernels.loop import LaneGroup, Schedules
from armwright.kernels.stages import CURSOR, NEARLY_DUE, NEVER, SECANTS, SEEN, TURNS, Turn
from armwright.program import trace
from armwright.scalar import Array
from armwright.simulation.integrate.stepping import Adaptivity
from armwright.simulation.plant.switching import Watched, switching_programs

SUPPORT = Support(
    "cvodes",
    scenario=True,
    without_effect={"brakes": "they are released unless inputs.brake applies them"},
    refused={
        "dry friction": "a smoothing speed, or another integrator",
        "gear efficiency": "a smoothing speed, or another integrator",
        "efficiency table": "a smoothing speed, or another integrator",
    },
)

MOST_LANES = 1000  # more would take hours
MOST_PIECES = 1000  # of a tick that end where something switches
MOST_INNER = 10**6  # of CVODES' own steps from one change to the next
LONGEST = 1024  # ticks of one call; powers of two below it serve any number
METHODS = ("adams", "bdf")  # of high order where nothing is stiff; and where something is
GAVE_UP = "gave_up"  # block: 0, or the place in `WHY` from 1 on
WHY = {  # why CVODES could not go on, by its flag
    "CV_TOO_MUCH_WORK": f"it needed more than {MOST_INNER} steps",
    "CV_TOO_MUCH_ACC": "the tolerances are finer than numbers of 64 bits",
    "CV_ERR_FAILURE": "no step was small enough for the tolerances",
    "CV_CONV_FAILURE": "Newton's iteration did not converge, however small the step",
    "": "for a reason of its own",
    "switching": f"contacts or servos' limits switched more than {MOST_PIECES} times in one tick",
}


class CvodesStopped(Exception):
    """A state from which CVODES cannot go on.

    Attributes:
        why: the place in `WHY` from 1 on; 0 where numbers are infinite or NaN.
    """

    def __init__(self, why: int):
        super().__init__(why)
        self.why = why


def check_lanes(lanes: int) -> None:
    """Refuses numbers of lanes that would take hours.

    Raises:
        ScenarioError: too many lanes.
    """
    if lanes > MOST_LANES:
        expected = f"at most {MOST_LANES}, or integrator = 'rk45' with a small rtol"
        raise ScenarioError(f"{lanes} lanes", place="solver.integrator", value="cvodes", expected=expected)


class Cvodes:
    """A plant's solutions.

    Args:
        derivative: (x, u, …) → dx/dt.   shapes: of its arguments, blocks by name, "x" and "u" first.
        adaptivity: tolerances.   stiff: whether the plant has fast parts that die away.
        watched: what may switch; solutions end and begin where something does. `derivative` then takes the contacts as well.
        turn: of servos' loops, at which they do so, too.
    """

    def __init__(
        self,
        derivative: Callable[..., Array],
        shapes: Mapping[str, tuple[int, ...]],
        adaptivity: Adaptivity,
        stiff: bool,
        watched: Watched | None = None,
        turn: Turn | None = None,
    ):
        contacts = {} if watched is None else watched.block
        self._f = trace("plant", derivative, {**shapes, **contacts}, ("xd",)).graph
        self._landing = switching_programs(watched, shapes)
        self._other_sizes = {name: int(np.prod(shape)) for name, shape in shapes.items() if name not in ("x", "u")}
        self._adaptivity, self._turn = adaptivity, turn
        self._methods = METHODS[::-1] if stiff else METHODS
        self._solvers: dict[tuple[int, str], casadi.Function] = {}
        self._ahead: dict[int, list[np.ndarray]] = {}  # states of a lane at the ticks that follow

    def after(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, span: float, count: int = 1) -> np.ndarray:
        """The states (rows, nx) each `span` seconds, u and p held: `count` rows, or those until CVODES cannot go on.

        Args:
            x: (nx,).   u: (nu,).   p: (np,) of the plant.   span: [s].   count: how often.
        Raises:
            CvodesStopped: it cannot go on from x.
        """
        rows: list[np.ndarray] = []
        most = LONGEST
        while len(rows) < count:
            block = 1 << min(count - len(rows), most).bit_length() - 1
            try:
                rows += list(self._block(rows[-1] if rows else x, u, p, span, block))
            except CvodesStopped:  # a block is solved whole or not at all: shorter ones find the tick in which it stops
                if block > 1:
                    most = block // 2
                elif rows:
                    break
                else:
                    raise
        return np.array(rows)

    def _block(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, span: float, count: int) -> np.ndarray:
        """Up to `count` states, at least one: those before something switches, or the one behind it."""
        constant = np.concatenate([u, p])
        if not self._landing:
            return self._solved(x, constant, span, count)
        touching = self._switching("touching", x, constant)[0]
        states = self._solved(x, np.concatenate([constant, touching]), span, count)
        rows = [x, *states]
        for k in range(count):
            ended = bool((self._switching("touching", rows[k], constant)[0] != touching).any())  # at that very row
            if ended or self._switching("switched", rows[k], rows[k + 1], constant, touching)[0][0]:
                break
        else:
            return states
        if k:
            return states[:k]
        return self._through(x, constant, span)[None]

    def _through(self, x: np.ndarray, constant: np.ndarray, span: float) -> np.ndarray:
        """The state `span` seconds later, in pieces that end where something switches; as `kernels.stages` says."""
        left = span
        for _ in range(MOST_PIECES):
            touching = self._switching("touching", x, constant)[0]
            with_contacts = np.concatenate([constant, touching])
            step = partial(self._step, x, with_contacts)
            end = step(left)
            if not self._switching("switched", x, end, constant, touching)[0][0]:
                return end
            weights, bracket, part = self._switching("bracket", x, end, constant, touching)
            for _ in range(SECANTS):
                tried = step(part[0] * left)
                bracket, part = self._switching("narrow", tried, constant, touching, weights, bracket, part)
            x, left = step(bracket[1] * left), left - bracket[1] * left
        raise CvodesStopped(_why("switching"))

    def _switching(self, name: str, *inputs: np.ndarray) -> list[np.ndarray]:
        """Outputs of a program of `switching`, for states, constant inputs and whatever else it takes."""
        program, numbers = self._landing[name], np.concatenate(inputs)
        ends = np.cumsum([port.size for port in program.inputs])
        return [np.asarray(each).ravel() for each in program.graph.call(np.split(numbers, ends[:-1]))]

    def _step(self, x: np.ndarray, constant: np.ndarray, span: float) -> np.ndarray:
        return self._solved(x, constant, span, 1)[0]

    def _solved(self, x: np.ndarray, constant: np.ndarray, span: float, count: int) -> np.ndarray:
        """The states at `count` times, the inputs constant.

        Raises:
            CvodesStopped: by neither of its methods, with the reason of the last.
        """
        why = 0
        if np.isfinite(x).all() and np.isfinite(np.array(self._f(x, *self._blocks_of(constant)))).all():
            for method in self._methods:
                try:
                    solution = self._solver(count, method)(x0=x, p=np.concatenate([constant, [span]]))["xf"]
                except RuntimeError as error:
                    flag = re.search(r"CV_\w+", str(error))
                    why = _why("" if flag is None else flag[0])
                    continue
                states = np.array(solution).T
                if np.isfinite(states).all():
                    return states
        raise CvodesStopped(why)

    def _blocks_of(self, constant: np.ndarray) -> list[np.ndarray]:
        """Arguments of the derivative behind x, from one after the other."""
        return np.split(constant, np.cumsum([self._f.size1_in(k) for k in range(1, self._f.n_in())])[:-1])

    def _solver(self, count: int, method: str) -> casadi.Function:
        """Solver over `count` units of time; the last parameter is the length of the unit [s]."""
        if (count, method) not in self._solvers:
            sizes = [self._f.size1_in(k) for k in range(self._f.n_in())]
            x, *constant = (casadi.SX.sym(f"i{k}", size) for k, size in enumerate(sizes))  # type: ignore[arg-type]
            span = casadi.SX.sym("span")  # type: ignore[arg-type]
            rate = span * self._f(x, *constant)
            options = {
                "reltol": self._adaptivity.allowed.rtol,
                "abstol": self._adaptivity.allowed.atol,
                "max_num_steps": MOST_INNER,
                "linear_multistep_method": method,
                "nonlinear_solver_iteration": "newton",
                "show_eval_warnings": False,
                "disable_internal_warnings": True,
            }
            problem = {"x": x, "p": casadi.vertcat(*constant, span), "ode": rate}
            times = [float(k) for k in range(1, count + 1)]
            self._solvers[count, method] = casadi.integrator("plant", "cvodes", problem, 0.0, times, options)
        return self._solvers[count, method]

    def extend(self, lanes: LaneGroup) -> None:
        """Adds the blocks that `tick` needs, none of the lanes frozen, where the loop has not made them."""
        for name, entries in self._other_sizes.items():
            lanes.blocks.setdefault(name, np.zeros((lanes.tiles, entries, lanes.width)))
        if self._turn is not None:
            lanes.blocks.setdefault(TURNS, np.zeros((lanes.tiles, 1, lanes.width)))
        lanes.blocks.setdefault(GAVE_UP, np.zeros((lanes.tiles, 1, lanes.width)))
        names = ("frozen", "see_at") if f"x{SEEN}" in lanes.blocks else ("frozen",)
        for name in names:
            lanes.blocks.setdefault(name, np.full((lanes.tiles, 1, lanes.width), -1.0))

    def tick(self, lanes: LaneGroup, k: int, h: float, schedules: Mapping[str, Schedules], steady: int = 1) -> None:
        """Does the work of `kernels.stages.Integrate` in tick k of h seconds, on the same blocks.

        Args:
            lanes, k, h: as there.   schedules: of the loop's rows, by block.
            steady: ticks, this one included, in which nothing but rows changes a command: they are solved in one go.
        """
        names = [*self._other_sizes, *schedules, *(f"{name}.{part}" for name in schedules for part in CURSOR)]
        names += [TURNS] * (self._turn is not None)
        values = {name: lanes.get(name).copy() for name in dict.fromkeys(["x", "u", "frozen", GAVE_UP, *names])}
        empty = np.zeros((lanes.count, 0))
        plan, begins = (lanes.get(name) if name in lanes.blocks else empty for name in ("u_plan", "u_from"))
        seen = {
            name: lanes.get(name + SEEN).copy()
            for name in ("x", "u", *self._other_sizes)
            if name + SEEN in lanes.blocks
        }
        see_at = lanes.get("see_at") if seen else np.full((lanes.count, 1), h)
        for lane in np.flatnonzero(values["frozen"][:, 0] < 0):
            lane_values = {name: value[lane] for name, value in values.items()}
            commands = plan[lane].reshape(-1, len(lane_values["u"]))
            rows = _rows_within(lane_values, k, schedules)
            changes = {t for t in (*begins[lane], *see_at[lane], *(at for at, _, _ in rows)) if 0.0 < t < h}
            edges = sorted({h, *changes, *self._turns(float(lane_values.get(TURNS, [0.0])[0]), k, h, changes)})
            ticks = (
                1 if len(edges) > 1 or self._turn is not None else _ticks_to_next_row(lane_values, k, schedules, steady)
            )
            for begin, end in zip([0.0, *edges], edges, strict=False):
                for s, command in enumerate(commands):
                    if s == 0 or begins[lane, s - 1] <= begin:
                        lane_values["u"][:] = command
                for _, name, row in (row for row in rows if row[0] == begin):
                    lane_values[name][:] = row
                self._turn_loops(lane_values, k * h + begin)
                try:
                    lane_values["x"][:] = self._next(lanes.first + int(lane), lane_values, end - begin, ticks)
                except CvodesStopped as stopped:
                    lane_values["frozen"][:], lane_values[GAVE_UP][:] = k, stopped.why
                    break
                if end == see_at[lane, 0]:
                    for name, kept in seen.items():
                        kept[lane] = lane_values[name]
        for name, value in [*values.items(), *((name + SEEN, kept) for name, kept in seen.items())]:
            lanes.set(name, value)

    def _turns(self, number: float, k: int, h: float, changes: set[float]) -> list[float]:
        """[s] in tick k at which servos' loops turn, but those that come with another change."""
        if self._turn is None:
            return []
        period, near = self._turn.period, NEARLY_DUE * self._turn.period
        times = (number + np.arange(np.ceil(h / period) + 1)) * period - k * h
        return [float(t) for t in times if near < t < h - near and not any(abs(t - at) <= near for at in changes)]

    def _turn_loops(self, lane_values: Mapping[str, np.ndarray], t: float) -> None:
        """Servos' loops turn if it is time."""
        turn = self._turn
        if turn is None or lane_values[TURNS][0] * turn.period > t + NEARLY_DUE * turn.period:
            return
        values = [lane_values[port.name] for port in turn.program.inputs]
        lane_values["x"][:] = np.asarray(turn.program.graph.call(values)[0]).ravel()
        lane_values[TURNS][:] += 1.0

    def _next(self, lane: int, lane_values: Mapping[str, np.ndarray], span: float, count: int) -> np.ndarray:
        """The state `span` seconds later, and those `count` times as much later put by."""
        if not self._ahead.get(lane):
            p = np.concatenate([lane_values[name] for name in self._other_sizes]) if self._other_sizes else np.zeros(0)
            states = self.after(lane_values["x"], lane_values["u"], p, span, count)
            self._ahead[lane] = list(states[::-1])
        return self._ahead[lane].pop()


def _why(flag: str) -> int:
    """The place of a flag in `WHY` from 1 on; 0 where the derivative is infinite or NaN."""
    if "RHSFUNC" in flag:
        return 0
    return 1 + list(WHY).index(flag if flag in WHY else "")


def _rows_within(
    lane_values: Mapping[str, np.ndarray], k: int, schedules: Mapping[str, Schedules]
) -> list[tuple[float, str, np.ndarray]]:
    """Rows of a lane that come inside tick k, [s] behind it, with the blocks they fill; its cursors move past them."""
    rows_within = []
    for name, rows in schedules.items():
        tick, offset, row, end = (lane_values[f"{name}.{part}"] for part in CURSOR)
        while tick[0] == k:
            rows_within.append((float(offset[0]), name, rows.values[int(row[0])]))
            row += 1.0
            another = row[0] < end[0]
            tick[0] = rows.tick[int(row[0])] if another else NEVER
            offset[0] = rows.offset[int(row[0])] if another else offset[0]
    return sorted(rows_within, key=lambda row: row[0])


def _ticks_to_next_row(
    lane_values: Mapping[str, np.ndarray], k: int, schedules: Mapping[str, Schedules], steady: int
) -> int:
    """Ticks up to the lane's next row, at most so many."""
    due = min((float(lane_values[f"{name}.{CURSOR[0]}"][0]) for name in schedules), default=NEVER)
    return int(min(steady, max(due - k, 1.0)))
