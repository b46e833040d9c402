"""Online filter for any reference, jumps included: limits of speed, acceleration and jerk are kept tick by tick.

The filter moves every joint as the time-optimal control of a triple integrator does.  [KrogerWahl2010], [BiagiottiZanasi2010]
With S the position at which the joint would stop if it braked now as hard as it may, and r the reference:

    S short of r:  it drives towards r, as hard as the limits allow, for as much of the tick as S stays short of r;
    for the rest of the tick, and while S = r, it brakes.

Both manoeuvres are three phases of constant jerk, ±j, 0, ∓j, and are evaluated exactly wherever in a tick a phase ends.
Hence nothing is lost by sampling: S never passes r, so a reference that stays is met without overshoot, in the shortest time.
A reference that moves is followed in coordinates that move along with it at its own speed q̇_r.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.control.gains import positive_limit
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement, called
from armwright.model import Model
from armwright.parameters import UNSET, NumbersOrNone, lane_values
from armwright.program.repeat import repeated
from armwright.scalar import Array, Scalar
from armwright.trajectory.limits import MotionLimits

SEARCH = 9  # steps for the instant at which braking begins; what they leave is made good in the next tick
TINY = 1e-300  # keeps 0 / 0 from the secant of a joint that stands
LIMITS = ("velocity", "acceleration", "jerk")


@dataclass(frozen=True, eq=False)
class ReferenceFilter:
    """A controller behind a filter that holds its reference within limits of speed, acceleration and jerk.

    The filter begins at rest at the measured position. Every joint follows q_r, at its speed q̇_r, by itself, in the shortest
    time and without overshoot; where q̇_r is beyond the limit, the limit takes its place. The filtered reference is what was
    asked one tick earlier, moved on by q̇_r. [KrogerWahl2010]

    Args:
        controller: gets the filtered reference; a function (t, r, y) → u or an object with `init` and `step`.
        velocity: [rad/s | m/s].   acceleration: [rad/s² | m/s²].   jerk: [rad/s³ | m/s³]; one number for all joints, (n,), or
            a `Batch` of either; absent: the limits of the arm's record.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> pid = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0], gravity=True)
        >>> control = aw.trajectories.ReferenceFilter(pid, 1.0, 5.0, 50.0)  # speed to jerk
        >>> loop = aw.Loop(control, aw.trajectories.Step([0.0, 0.0], [0.5, -0.5]), period=0.002)
        >>> aw.simulate(aw.Scenario("two-link", 1.5, loop=loop)).q.values[-1].round(2)
        array([ 0.5, -0.5])
    """

    controller: Any
    velocity: NumbersOrNone = UNSET
    acceleration: NumbersOrNone = UNSET
    jerk: NumbersOrNone = UNSET
    arm: Model | None = None  # both are set by `configure`
    period: float | None = None

    def configure(self, arm: Model, period: float) -> ReferenceFilter:
        """The filter for an arm and a sample period [s].

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a limit that is absent or infinite; a controller that is called for all lanes at once.
        """
        record = MotionLimits.of(arm)
        limits: dict[str, Any] = {}
        for name in LIMITS:
            value = getattr(self, name)
            value = getattr(record, name) if value is None else value
            limits[name] = positive_limit(arm, "ReferenceFilter", name, value)
            rows = np.asarray(lane_values(limits[name]))
            if not np.isfinite(rows).all():
                joint = arm.names[np.argwhere(~np.isfinite(rows))[0][1]]
                expected = "a finite number for each joint, here or in the arm's record"
                raise ScenarioError(f"no limit of joint {joint!r}", place=f"ReferenceFilter.{name}", expected=expected)
        if getattr(self.controller, "vectorised", False):
            expected = "one that sees the arrays of one lane"
            raise ScenarioError(place="ReferenceFilter.controller", value=called(self.controller), expected=expected)
        inner = self.controller
        inner = inner.configure(arm, period) if hasattr(inner, "configure") else inner
        return replace(self, controller=inner, arm=arm, period=period, **limits)

    def init(self, arm: Model, y: Measurement) -> Array:
        """Initial state: at rest at the measured position, and the controller's own state."""
        rest = scalar.zeros(arm.n)
        inner = [self.controller.init(arm, y)] if hasattr(self.controller, "init") else []
        return scalar.array(np.concatenate([y.q, rest, rest, *(np.atleast_1d(each) for each in inner)]))

    def step(self, t: Scalar, r: JointReference, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick: commands (n,) and the next state."""
        assert self.period is not None
        n = len(r.q)
        state, inner = s[: 3 * n].reshape(3, n), s[3 * n :]
        limited = JointReference(*state)
        if hasattr(self.controller, "step"):
            u, inner = self.controller.step(t, limited, y, inner)
        else:
            u = self.controller(t, limited, y)
        state = filtered(state, r.q, r.qd, self.velocity, self.acceleration, self.jerk, self.period)
        return u, scalar.array(np.concatenate([state.ravel(), inner]))


def filtered(
    state: Array, q: Array, qd: Array, velocity: Array, acceleration: Array, jerk: Array, period: Scalar
) -> np.ndarray:
    """The filter's state one tick later.

    Args:
        state: (3, n) positions, speeds and accelerations [rad | m, …/s, …/s²], within the limits.
        q, qd: (n,) reference [rad | m, …/s].
        velocity, acceleration, jerk: (n,) limits [rad/s | m/s, …/s², …/s³].   period: [s] of a tick.
    Returns:
        state: (3, n) after the tick.
    """
    x, v, a = state
    velocity, acceleration, jerk = (np.broadcast_to(each, np.shape(x)) for each in (velocity, acceleration, jerk))
    if not scalar.is_symbolic(state, q, qd, velocity, acceleration, jerk):
        return np.stack(_joint_filtered(x, v, a, q, qd, velocity, acceleration, jerk, period))
    joints = zip(x, v, a, q, qd, velocity, acceleration, jerk, strict=True)
    return scalar.array([_joint_filtered(*each, period) for each in joints]).T  # pyright: ignore[reportCallIssue]


def _joint_filtered(
    x: Scalar, v: Scalar, a: Scalar, r: Scalar, rd: Scalar, most: Scalar, a_most: Scalar, j: Scalar, h: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Position, speed and acceleration of a joint after a tick."""
    rd = scalar.clip(rd, -most, most)
    y, w = x - r, v - rd  # seen from the reference
    short = _stop(y, w, a, a_most, j)
    way = scalar.where(scalar.less_equal(short, 0.0), 1.0, -1.0)
    y, w, a = way * y, way * w, way * a  # the reference now lies ahead
    fastest = most - way * rd
    tau = _time_to_brake(scalar.abs(short), y, w, a, fastest, a_most, j, h)
    y, w, a = _towards(y, w, a, fastest, a_most, j, tau)
    y, w, a = _towards(y, w, a, 0.0, a_most, j, h - tau)
    return way * y + (r + rd * h), way * w + rd, way * a


def _time_to_brake(
    gap: Scalar, y: Scalar, w: Scalar, a: Scalar, fastest: Scalar, a_most: Scalar, j: Scalar, h: Scalar
) -> Scalar:
    """The largest time τ ≤ h after which braking still stops at 0 or before: a bracket, narrowed by secants and halves.

    The lower end is taken, at which the stop is short of the reference by what the search has left.
    """

    def left(tau: Scalar, y: Scalar, w: Scalar, a: Scalar, fastest: Scalar, a_most: Scalar, j: Scalar) -> Scalar:
        return -1.0 * _stop(*_towards(y, w, a, fastest, a_most, j, tau), a_most, j)

    def narrowed(state: Array, values: Array) -> np.ndarray:
        low, left_low, high, left_high, kind = state
        gap = values[-1]
        secant = left_low / (left_low - left_high)
        # from rest the way grows with τ³: its fourth root is nearly a straight line
        first, last = (_fourth_root(scalar.maximum(gap - each, 0.0)) for each in (left_low, left_high))
        rooted = (_fourth_root(gap) - first) / scalar.maximum(last - first, TINY)
        share = scalar.where(scalar.less(kind, 1.0), rooted, scalar.where(scalar.less(kind, 2.0), secant, 0.5))
        tau = low + (high - low) * scalar.clip(share, 0.0, 1.0)
        at = left(tau, *values[:-1])
        before = scalar.less_equal(0.0, at)
        return np.stack(
            [
                scalar.where(before, tau, low), scalar.where(before, at, left_low),
                scalar.where(before, high, tau), scalar.where(before, left_high, at),
                scalar.where(scalar.less(kind, 2.0), kind + 1.0, 0.0),
            ]
        )  # fmt: skip

    values = (y, w, a, fastest, a_most, j)
    at_end = left(h + 0.0 * y, *values)
    beyond = scalar.minimum(at_end, -TINY)  # where it is not, the bracket is not used
    begin = np.stack(np.broadcast_arrays(0.0 * y, gap, h + 0.0 * y, beyond, 0.0 * y))
    found = repeated("time_to_brake", narrowed, begin, (np.stack(np.broadcast_arrays(*values, gap)),), SEARCH)
    return scalar.where(scalar.less_equal(0.0, at_end), h, found[0])


def _fourth_root(value: Scalar) -> Scalar:
    return scalar.sqrt(scalar.sqrt(value))


def _phases(w: Scalar, a: Scalar, goal: Scalar, a_most: Scalar, j: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Jerk of the first phase and durations of the three that bring (speed, acceleration) to (goal, 0) soonest.

    The acceleration rises to  p = min(a_most, √(j Δw + a²/2)),  stays, and falls to 0; Δw = goal - w, all in the sense of the
    way from  w + a|a|/2j,  the speed that is left when the acceleration is taken back at once, to the goal.
    """
    sense = scalar.where(scalar.less_equal(w + a * scalar.abs(a) / (2.0 * j), goal), 1.0, -1.0)
    change, a = sense * (goal - w), sense * a
    free = scalar.sqrt(scalar.maximum(j * change + 0.5 * a * a, 0.0))
    peak = scalar.minimum(a_most, free)
    rise = scalar.maximum((peak - a) / j, 0.0)
    rest = change - (a_most * a_most - 0.5 * a * a) / j  # of the speed, at the largest acceleration
    hold = scalar.where(scalar.less(a_most, free), scalar.maximum(rest, 0.0) / a_most, 0.0)
    return sense * j, rise, hold, peak / j


def _towards(
    y: Scalar, w: Scalar, a: Scalar, goal: Scalar, a_most: Scalar, j: Scalar, t: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Position, speed and acceleration after a time t of driving to a goal of the speed, and of keeping it then."""
    sense_j, rise, hold, fall = _phases(w, a, goal, a_most, j)
    y, w, a = _cubic(y, w, a, sense_j, scalar.clip(t, 0.0, rise))
    y, w, a = _cubic(y, w, a, 0.0, scalar.clip(t - rise, 0.0, hold))
    y, w, a = _cubic(y, w, a, -1.0 * sense_j, scalar.clip(t - rise - hold, 0.0, fall))
    over = t - rise - hold - fall
    there = scalar.less_equal(0.0, over)
    y = y + scalar.maximum(over, 0.0) * goal
    return y, scalar.where(there, goal, w), scalar.where(there, 0.0, a)  # without the phases' rounding


def _stop(y: Scalar, w: Scalar, a: Scalar, a_most: Scalar, j: Scalar) -> Scalar:
    """Position at which braking ends."""
    sense_j, rise, hold, fall = _phases(w, a, 0.0, a_most, j)
    y, w, a = _cubic(y, w, a, sense_j, rise)
    y, w, a = _cubic(y, w, a, 0.0, hold)
    return _cubic(y, w, a, -1.0 * sense_j, fall)[0]


def _cubic(y: Scalar, w: Scalar, a: Scalar, j: Scalar, t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Position, speed and acceleration after a time t of constant jerk."""
    return y + t * (w + t * (0.5 * a + t * (j / 6.0))), w + t * (a + 0.5 * (t * j)), a + t * j
